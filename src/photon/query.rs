//! The k nearest photons, and all photons within a radius.

use super::found::{Found, ROOM};
use super::map::PhotonMap;
use super::simd::{Level, Simd, Task};
use crate::math::Vec3;

/// Buffers of [`PhotonMap::nearest`], and what the last query taught about the next one.
///
/// Every thread has its own. Queries that follow each other in space (see [`morton_order`](super::morton_order)) are
/// faster, because the distance to the k-th neighbour cannot grow faster than one moves: `r_k(q') ≤ r_k(q) + |q − q'|`.
/// Results never depend on what a scratch was used for before.
pub struct KnnScratch {
    found: Found,
    last: Option<Last>,
    level: Level,
}

/// A full answer: `k` photons of a map within `radius` of `p`.
struct Last {
    map: u64,
    k: usize,
    p: Vec3,
    radius: f32,
}

impl Default for KnnScratch {
    fn default() -> Self {
        Self { found: Found::default(), last: None, level: Level::best() }
    }
}

impl KnnScratch {
    pub fn new() -> Self {
        Self::default()
    }

    #[cfg(test)]
    pub(crate) fn with_level(level: Level) -> Self {
        Self { level, ..Self::default() }
    }
}

/// The answer of [`PhotonMap::nearest`], in no particular order.
#[derive(Clone, Copy, Debug)]
pub struct Neighbours<'a> {
    /// Squared distances.
    pub d_sq: &'a [f32],
    /// Photon indices.
    pub index: &'a [u32],
    /// The squared radius of the estimate: that of the k-th photon if there are k, else the limit of the search.
    pub radius_sq: f32,
    /// True when k photons were found. The k-th then lies on the rim: the (k − 1) rule applies.
    pub full: bool,
}

impl Neighbours<'_> {
    #[inline]
    pub fn len(&self) -> usize {
        self.index.len()
    }

    #[inline]
    pub fn is_empty(&self) -> bool {
        self.index.is_empty()
    }

    /// Pairs of index and squared distance.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        self.index.iter().copied().zip(self.d_sq.iter().copied())
    }
}

impl PhotonMap {
    /// The `k` photons nearest to `p` whose squared distance is at most `max_r_sq`; which of several equally far ones are
    /// taken depends on the map and on `p` alone.
    pub fn nearest<'a>(&self, p: Vec3, k: usize, max_r_sq: f32, scratch: &'a mut KnnScratch) -> Neighbours<'a> {
        let bound = scratch.bound(self, p, k);
        let full = self.search(p, k, max_r_sq, bound, scratch, None::<fn(u32) -> bool>);
        scratch.last = full.map(|r_sq| Last { map: self.identity, k, p, radius: r_sq.sqrt() });
        scratch.answer(full, max_r_sq)
    }

    /// As [`PhotonMap::nearest`], among the photons that `accept` takes.
    pub fn nearest_where<'a>(
        &self,
        p: Vec3,
        k: usize,
        max_r_sq: f32,
        scratch: &'a mut KnnScratch,
        accept: impl FnMut(u32) -> bool,
    ) -> Neighbours<'a> {
        // The last answer bounds this one only if the same photons were acceptable.
        scratch.last = None;
        let full = self.search(p, k, max_r_sq, f32::INFINITY, scratch, Some(accept));
        scratch.answer(full, max_r_sq)
    }

    /// Fills `scratch.found` with the answer; returns the k-th squared distance if there are k.
    fn search(
        &self,
        p: Vec3,
        k: usize,
        max_r_sq: f32,
        bound: f32,
        scratch: &mut KnnScratch,
        accept: Option<impl FnMut(u32) -> bool>,
    ) -> Option<f32> {
        // Never ask for more than there are, so that a huge k costs no memory.
        let places = k.min(self.len());
        scratch.found.reset(2 * places + ROOM);
        // Written so that a NaN fails the test.
        let sane = p.is_finite() && max_r_sq >= 0.0;
        if places == 0 || !sane {
            return None;
        }
        let r_sq = max_r_sq.next_up().min(bound);
        let cold = bound == f32::INFINITY;
        let task = Nearest { map: self, q: p.to_array(), k, r_sq, cold, found: &mut scratch.found, accept };
        scratch.level.run(task)
    }

    /// Calls `visit(index, d_sq)` for every photon whose squared distance from `p` is at most `r_sq`.
    pub fn within(&self, p: Vec3, r_sq: f32, scratch: &mut KnnScratch, visit: impl FnMut(u32, f32)) {
        // Written so that a NaN fails the test.
        let sane = p.is_finite() && r_sq >= 0.0;
        if self.is_empty() || !sane {
            return;
        }
        scratch.found.reset(ROOM);
        let task = Within { map: self, q: p.to_array(), r_sq: r_sq.next_up(), found: &mut scratch.found, visit };
        scratch.level.run(task);
    }
}

impl PhotonMap {
    /// How many cache lines of positions [`PhotonMap::within`] reads for this radius: what benchmarks measure the memory's
    /// share by.
    pub fn lines_within(&self, p: Vec3, r_sq: f32) -> usize {
        struct Lines<'a>(&'a PhotonMap, [f32; 3], f32);
        impl Task for Lines<'_> {
            type Output = usize;
            #[inline(always)]
            fn run<S: Simd>(self, simd: S) -> usize {
                let (mut found, mut buckets) = (Found::default(), 0);
                found.reset(ROOM);
                walk(self.0, simd, self.1, self.2.next_up(), &mut found, |found, r_sq| {
                    found.len = 0;
                    buckets += 1;
                    r_sq
                });
                buckets
            }
        }
        // A bucket is one run; between two of them lies a photon of an upper node, whose coordinates are on three lines.
        let buckets = Level::best().run(Lines(self, p.to_array(), r_sq));
        let in_a_block = self.positions.as_slice().len() / 16 / self.layout.buckets;
        buckets * in_a_block + 3 * buckets.saturating_sub(1)
    }
}

impl KnnScratch {
    /// A squared distance that k photons are certainly below.
    #[inline]
    fn bound(&self, map: &PhotonMap, p: Vec3, k: usize) -> f32 {
        match &self.last {
            Some(last) if last.map == map.identity && k <= last.k => {
                // A few roundings of 2^-24 in each distance and sum: 1e-5 covers them. The floor covers underflow.
                let r = (last.radius + last.p.distance(p)) * (1.0 + 1e-5);
                (r * r).max(1e-30)
            }
            _ => f32::INFINITY,
        }
    }

    fn answer(&self, full: Option<f32>, max_r_sq: f32) -> Neighbours<'_> {
        let len = self.found.len;
        Neighbours {
            d_sq: &self.found.d_sq[..len],
            index: &self.found.index[..len],
            radius_sq: full.unwrap_or(max_r_sq),
            full: full.is_some(),
        }
    }
}

struct Nearest<'a, A> {
    map: &'a PhotonMap,
    q: [f32; 3],
    k: usize,
    r_sq: f32,
    /// Nothing is known about the k-th distance yet.
    cold: bool,
    found: &'a mut Found,
    accept: Option<A>,
}

impl<A: FnMut(u32) -> bool> Task for Nearest<'_, A> {
    type Output = Option<f32>;

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) -> Option<f32> {
        let mut kth = None;
        let mut filtered = 0;
        // Shrink the radius as soon as k are known, then whenever the buffer is full.
        let mut limit = if self.cold { self.k } else { usize::MAX };
        walk(self.map, simd, self.q, self.r_sq, self.found, |found, r_sq| {
            if let Some(accept) = &mut self.accept {
                found.filter(filtered, accept);
                filtered = found.len;
            }
            if found.len <= self.k || (found.len < limit && found.has_room()) {
                return r_sq;
            }
            let nearer = found.keep_nearest(simd, self.k);
            (limit, filtered) = (usize::MAX, found.len);
            kth = Some(nearer);
            nearer
        });
        match self.found.len.cmp(&self.k) {
            std::cmp::Ordering::Less => None,
            std::cmp::Ordering::Equal => Some(kth.unwrap_or_else(|| simd.max(&self.found.d_sq[..self.k]))),
            std::cmp::Ordering::Greater => Some(self.found.keep_nearest(simd, self.k)),
        }
    }
}

struct Within<'a, V> {
    map: &'a PhotonMap,
    q: [f32; 3],
    r_sq: f32,
    found: &'a mut Found,
    visit: V,
}

impl<V: FnMut(u32, f32)> Task for Within<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        walk(self.map, simd, self.q, self.r_sq, self.found, |found, r_sq| {
            for (&index, &d_sq) in found.index[..found.len].iter().zip(&found.d_sq[..found.len]) {
                (self.visit)(index, d_sq);
            }
            found.len = 0;
            r_sq
        });
    }
}

/// A subtree put off: its first slot, and the offset and squared distance of `q` from its cell.
#[derive(Clone, Copy, Default)]
struct Later {
    slot: usize,
    d_sq: f32,
    offset: [f32; 3],
}

/// Walks every subtree that has photons nearer than `r_sq` (exclusive), near ones first, and calls `after` with the
/// candidates whenever some may have been added; `after` returns the radius to go on with.
///
/// The walk descends the upper nodes plane by plane with the distance from the cell's nearest point [Wald 2022, "closest
/// corner tracking"], and scans the bottom subtrees as runs of the heap. Rounding is monotone, so a computed cell distance
/// never exceeds the computed distance of a photon in the cell: pruning loses nothing.
#[inline(always)]
fn walk<S: Simd>(
    map: &PhotonMap,
    simd: S,
    q: [f32; 3],
    mut r_sq: f32,
    found: &mut Found,
    mut after: impl FnMut(&mut Found, f32) -> f32,
) {
    let buckets = map.layout.buckets;
    let positions = map.positions.as_slice();
    let mut later = [Later::default(); 32];
    let mut waiting = 0;
    let mut slot = 1;
    let mut offset = [0f32; 3];
    loop {
        // Go down to the bucket on q's side of every plane; remember the other sides that are near enough.
        while slot < buckets {
            let split = map.splits[slot];
            let axis = split.axis as usize;
            let d = q[axis] - split.at;
            let near = 2 * slot + usize::from(d > 0.0);
            let mut beyond = offset;
            beyond[axis] = d;
            let d_sq = beyond[0] * beyond[0] + beyond[1] * beyond[1] + beyond[2] * beyond[2];
            if d_sq < r_sq {
                later[waiting] = Later { slot: near ^ 1, d_sq, offset: beyond };
                waiting += 1;
            }
            slot = near;
        }
        let block = map.layout.block_of_bucket(slot - buckets);
        let (start, lanes) = map.layout.block(block);
        // Place 0 has no index: wrapping makes lane 1 of the first block 0.
        simd.scan(&positions[3 * start..3 * (start + lanes)], (start as u32).wrapping_sub(1), q, r_sq, found);
        r_sq = after(found, r_sq);

        // Take up the nearest subtree put off, if it still counts, with the photon on the plane before it.
        loop {
            if waiting == 0 {
                return;
            }
            waiting -= 1;
            let next = later[waiting];
            if next.d_sq < r_sq {
                test_one(map, next.slot / 2, q, r_sq, found);
                (slot, offset) = (next.slot, next.offset);
                break;
            }
        }
    }
}

/// Adds the photon of an upper slot, lane 0 of the block of that number, if it is near enough.
#[inline(always)]
fn test_one(map: &PhotonMap, slot: usize, q: [f32; 3], r_sq: f32, found: &mut Found) {
    let (start, lanes) = map.layout.block(slot);
    let block = &map.positions.as_slice()[3 * start..];
    let (dx, dy, dz) = (block[0] - q[0], block[lanes] - q[1], block[2 * lanes] - q[2]);
    let d_sq = dx * dx + dy * dy + dz * dz;
    if d_sq < r_sq {
        found.push(d_sq, (start - 1) as u32);
    }
}
