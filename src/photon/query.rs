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

    /// The nearest `k` of these whose squared distance is at most `max_r_sq`: what a search for them would have found, if this
    /// one was for as many at least and as far.
    pub fn nearest(&self, k: usize, max_r_sq: f32) -> Fewer {
        let mut within: Vec<(f32, u32)> =
            self.iter().filter(|n| n.1 <= max_r_sq).map(|(index, d_sq)| (d_sq, index)).collect();
        let full = within.len() >= k;
        if full {
            within.select_nth_unstable_by(k - 1, |a, b| a.0.total_cmp(&b.0));
            within.truncate(k);
        }
        let radius_sq = if full { within[k - 1].0 } else { max_r_sq };
        let (d_sq, index) = within.into_iter().unzip();
        Fewer { d_sq, index, radius_sq, full }
    }
}

/// Some of the photons that a query has found.
pub struct Fewer {
    d_sq: Vec<f32>,
    index: Vec<u32>,
    radius_sq: f32,
    full: bool,
}

impl Fewer {
    pub fn as_neighbours(&self) -> Neighbours<'_> {
        Neighbours { d_sq: &self.d_sq, index: &self.index, radius_sq: self.radius_sq, full: self.full }
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

    /// As [`PhotonMap::nearest`], among the photons that `accept` takes, which may be asked more than once about a photon.
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
        let full = self.search(p, k, max_r_sq, (f32::INFINITY, false), scratch, Some(accept));
        scratch.answer(full, max_r_sq)
    }

    /// Fills `scratch.found` with the answer; returns the k-th squared distance if there are k.
    fn search(
        &self,
        p: Vec3,
        k: usize,
        max_r_sq: f32,
        (bound, close): (f32, bool),
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
        let task = Nearest { map: self, q: p.to_array(), k, r_sq, close, found: &mut scratch.found, accept };
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
                walk(self.0, simd, self.1, self.2.next_up(), 1, &mut found, |found, r_sq| {
                    found.len = 0;
                    buckets += 1;
                    r_sq
                });
                buckets
            }
        }
        let buckets = Level::best().run(Lines(self, p.to_array(), r_sq));
        let in_a_block = self.positions.as_slice().len() / 16 / self.layout.buckets;
        buckets * in_a_block
    }
}

impl KnnScratch {
    /// A squared distance that k photons are certainly below, and whether it is worth knowing.
    #[inline]
    fn bound(&self, map: &PhotonMap, p: Vec3, k: usize) -> (f32, bool) {
        match &self.last {
            Some(last) if last.map == map.identity && k <= last.k => {
                // A few roundings of 2^-24 in each distance and sum: 1e-5 covers them. The floor covers underflow.
                let moved = last.p.distance(p);
                let r = (last.radius + moved) * (1.0 + 1e-5);
                ((r * r).max(1e-30), moved <= last.radius && last.k <= 4 * k)
            }
            _ => (f32::INFINITY, false),
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
    /// Hardly more than k photons are nearer than `r_sq`, and most of them have just been read.
    close: bool,
    found: &'a mut Found,
    accept: Option<A>,
}

/// Guessed radii that are tried before a search without one.
const GUESSES: usize = 2;

impl<A: FnMut(u32) -> bool> Task for Nearest<'_, A> {
    type Output = Option<f32>;

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) -> Option<f32> {
        let (mut guess, mut guesses) = (f32::INFINITY, 0);
        if !self.close && self.map.layout.buckets > 4 && self.k < self.map.len() / 4 {
            (guess, guesses) = (self.guess(simd), GUESSES);
        }
        loop {
            let guessed = guesses > 0 && 0.0 < guess && guess < self.r_sq;
            let r_sq = if guessed { guess } else { self.r_sq };
            // Where nothing is known, shrink the radius as soon as k are found; always when the buffer is full.
            let limit = if self.close || guessed { usize::MAX } else { self.k };
            let kth = self.collect(simd, r_sq, limit);
            if !guessed || kth.is_some() {
                return kth;
            }
            guesses -= 1;
            guess *= (2.0 * self.k as f32 / (self.found.len as f32 + 1.0)).min(16.0);
        }
    }
}

impl<A: FnMut(u32) -> bool> Nearest<'_, A> {
    /// Fills `found` with the nearest k among the photons nearer than `r_sq`, or with all of them when they are fewer; returns
    /// the k-th squared distance.
    #[inline(always)]
    fn collect<S: Simd>(&mut self, simd: S, r_sq: f32, mut limit: usize) -> Option<f32> {
        let mut kth = None;
        let mut filtered = 0;
        self.found.len = 0;
        let ahead = if self.close || r_sq == f32::INFINITY { 1 } else { AHEAD };
        walk(self.map, simd, self.q, r_sq, ahead, self.found, |found, r_sq| {
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

    /// A squared radius in which the k nearest probably lie, if the photons around are as dense as those of the bucket on whose
    /// side of every plane `q` is, and on a surface.
    #[inline(always)]
    fn guess<S: Simd>(&mut self, simd: S) -> f32 {
        let map = self.map;
        let mut slot = 1;
        while slot < map.layout.buckets {
            let axis = map.splits.axis(slot);
            slot = 2 * slot + usize::from(self.q[axis] > map.splits.position(slot)[axis]);
        }
        // The buckets beside it will be needed as well.
        for beside in 1..if self.k > 100 { 4 } else { 2 } {
            let block = map.layout.block_of_bucket((slot ^ beside) - map.layout.buckets);
            simd.prefetch(map.block_positions(block).1);
        }
        let (first, positions) = map.block_positions(map.layout.block_of_bucket(slot - map.layout.buckets));
        self.found.len = 0;
        simd.scan(positions, first, self.q, f32::INFINITY, self.found);
        let nearest = smallest(&self.found.d_sq[..self.found.len]);
        if let Some(accept) = &mut self.accept {
            self.found.filter(0, accept);
        }
        if self.found.len == 0 {
            return f32::INFINITY;
        }
        let lanes = positions.len() / 3;
        let [x, y, z] = std::array::from_fn(|a| extent(&positions[a * lanes + 1..(a + 1) * lanes]));
        // The area of a piece of a plane from its projections. The margin covers the Poisson noise of both counts.
        let area = (x * x * y * y + y * y * z * z + z * z * x * x).sqrt();
        let (k, m) = (self.k as f32, self.found.len as f32);
        let margin = 1.15 + 2.0 / k.sqrt() + 1.0 / m.sqrt();
        nearest + margin * k * area / (std::f32::consts::PI * m)
    }
}

/// The smallest value; infinite without any.
#[inline(always)]
fn smallest(values: &[f32]) -> f32 {
    let (chunks, rest) = values.as_chunks::<16>();
    let smaller = |m: f32, v: f32| if v < m { v } else { m };
    let minima = chunks.iter().fold([f32::INFINITY; 16], |m, c| std::array::from_fn(|i| smaller(m[i], c[i])));
    minima.into_iter().chain(rest.iter().copied()).fold(f32::INFINITY, smaller)
}

/// The extent of the values that are finite.
#[inline(always)]
fn extent(values: &[f32]) -> f32 {
    let (chunks, rest) = values.as_chunks::<16>();
    let smaller = |m: f32, v: f32| if v < m { v } else { m };
    let larger = |m: f32, v: f32| if v > m && v < f32::INFINITY { v } else { m };
    let lo = chunks.iter().fold([f32::INFINITY; 16], |m, c| std::array::from_fn(|i| smaller(m[i], c[i])));
    let hi = chunks.iter().fold([f32::NEG_INFINITY; 16], |m, c| std::array::from_fn(|i| larger(m[i], c[i])));
    let lo = lo.into_iter().chain(rest.iter().copied()).fold(f32::INFINITY, smaller);
    let hi = hi.into_iter().chain(rest.iter().copied()).fold(f32::NEG_INFINITY, larger);
    hi - lo
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
        walk(self.map, simd, self.q, self.r_sq, AHEAD, self.found, |found, r_sq| {
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

/// A bucket to be scanned, after the photon of the upper node before it; 0 where there is none before it.
#[derive(Clone, Copy, Default)]
struct Visit {
    upper: u32,
    block: u32,
    /// Of the cell from `q`.
    d_sq: f32,
}

/// Buckets that are fetched from memory at a time.
const AHEAD: usize = 16;

/// Walks every subtree that has photons nearer than `r_sq` (exclusive), near ones first, and calls `after` with the
/// candidates whenever some may have been added; `after` returns the radius to go on with.
///
/// The walk descends the upper nodes plane by plane with the distance from the cell's nearest point [Wald 2022, "closest
/// corner tracking"], and scans the bottom subtrees as runs of the heap. Rounding is monotone, so a computed cell distance
/// never exceeds the computed distance of a photon in the cell: pruning loses nothing. `ahead` buckets, [`AHEAD`] at most,
/// are looked for before they are scanned, so that they come from memory together.
#[inline(always)]
fn walk<S: Simd>(
    map: &PhotonMap,
    simd: S,
    q: [f32; 3],
    mut r_sq: f32,
    ahead: usize,
    found: &mut Found,
    mut after: impl FnMut(&mut Found, f32) -> f32,
) {
    let buckets = map.layout.buckets;
    let mut later = [Later::default(); 32];
    let mut waiting = 0;
    let mut next = Later { slot: 1, ..Later::default() };
    let mut visits = [Visit::default(); AHEAD];
    let mut count = 0;
    loop {
        let Later { mut slot, offset, d_sq: cell_d_sq } = next;
        let upper = slot / 2;
        // Go down to the bucket on q's side of every plane; remember the other sides that are near enough.
        while slot < buckets {
            let axis = map.splits.axis(slot);
            let d = q[axis] - map.splits.position(slot)[axis];
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
        if ahead > 1 {
            simd.prefetch(map.block_positions(block).1);
        }
        visits[count] = Visit { upper: upper as u32, block: block as u32, d_sq: cell_d_sq };
        count += 1;

        // Take up the nearest subtree put off that still counts.
        loop {
            if count == ahead || waiting == 0 {
                for visit in &visits[..count] {
                    if visit.d_sq < r_sq {
                        scan(map, simd, q, r_sq, visit, found);
                        r_sq = after(found, r_sq);
                    }
                }
                count = 0;
                if waiting == 0 {
                    return;
                }
            }
            waiting -= 1;
            next = later[waiting];
            if next.d_sq < r_sq {
                break;
            }
        }
    }
}

/// Adds the photons of a bucket, and that of the upper node before it, which are near enough.
#[inline(always)]
fn scan<S: Simd>(map: &PhotonMap, simd: S, q: [f32; 3], r_sq: f32, visit: &Visit, found: &mut Found) {
    if visit.upper > 0 {
        let slot = visit.upper as usize;
        let p = map.splits.position(slot);
        let (dx, dy, dz) = (p[0] - q[0], p[1] - q[1], p[2] - q[2]);
        let d_sq = dx * dx + dy * dy + dz * dz;
        if d_sq < r_sq {
            found.push(d_sq, (map.layout.block(slot).0 - 1) as u32);
        }
    }
    let (first, positions) = map.block_positions(visit.block as usize);
    simd.scan(positions, first, q, r_sq, found);
}
