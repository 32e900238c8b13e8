//! A binary tree by binned SAH [Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies"].
//!
//! The tree is the same for any number of threads: work is cut by size, and merging boxes and counts is exact.

use glam::{Vec3Swizzles, Vec4, Vec4Swizzles};
use rayon::prelude::*;

use super::pages::Pages;
use super::wide::LANES;
use crate::math::Bounds3;

/// Bins per axis.
const BINS: usize = 32;
/// Deeper than any sensible tree: from here on ranges are halved, so that recursion stays bounded.
const MAX_SAH_DEPTH: u32 = 96;
/// Ranges longer than this are split by two tasks.
const PARALLEL_SPLIT: usize = 4096;
/// Ranges longer than this take the box of their centroids from their own box, which saves a pass.
const LOOSE: usize = 256;
/// Ranges longer than this are binned and partitioned in parallel.
const PARALLEL_SWEEP: usize = 1 << 17;

/// A box with the identity of what is inside.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct PrimRef {
    /// Lower corner; w holds the bits of the id.
    lo: Vec4,
    /// Upper corner; w holds the bits of the kind.
    hi: Vec4,
}

impl PrimRef {
    pub fn new(b: Bounds3, id: u32, kind: u32) -> Self {
        Self { lo: b.min.extend(f32::from_bits(id)), hi: b.max.extend(f32::from_bits(kind)) }
    }

    #[inline]
    pub fn id(&self) -> u32 {
        self.lo.w.to_bits()
    }

    #[inline]
    pub fn kind(&self) -> u32 {
        self.hi.w.to_bits()
    }

    pub fn bounds(&self) -> Bounds3 {
        Bounds3::new(self.lo.xyz(), self.hi.xyz())
    }
}

/// A node of the binary tree. The subtree over `n` references owns `2n − 1` consecutive slots and starts at its root;
/// the left child follows its parent, the right child follows the slots of the left one.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Node2 {
    lo: Vec4,
    hi: Vec4,
}

impl Node2 {
    fn new(b: &Box4, offset: u32, count: u32) -> Self {
        Self { lo: b.lo.xyz().extend(f32::from_bits(offset)), hi: b.hi.xyz().extend(f32::from_bits(count)) }
    }

    #[inline]
    pub fn bounds(&self) -> Bounds3 {
        Bounds3::new(self.lo.xyz(), self.hi.xyz())
    }

    #[inline]
    pub fn half_area(&self) -> f32 {
        half_area(self.lo, self.hi)
    }

    /// First reference of a leaf, or distance to the right child.
    #[inline]
    pub fn offset(&self) -> usize {
        self.lo.w.to_bits() as usize
    }

    /// References of a leaf; 0 for an inner node.
    #[inline]
    pub fn count(&self) -> usize {
        self.hi.w.to_bits() as usize
    }
}

#[inline(always)]
fn half_area(lo: Vec4, hi: Vec4) -> f32 {
    let e = (hi - lo).xyz();
    e.dot(e.yzx())
}

/// A box in vector registers; w is not used.
#[derive(Clone, Copy)]
struct Box4 {
    lo: Vec4,
    hi: Vec4,
}

impl Box4 {
    const EMPTY: Self = Self { lo: Vec4::INFINITY, hi: Vec4::NEG_INFINITY };

    #[inline(always)]
    fn grow(&mut self, lo: Vec4, hi: Vec4) {
        self.lo = self.lo.min(lo);
        self.hi = self.hi.max(hi);
    }
}

/// What the builder needs to know of a range: the box, and the box of the doubled centroids.
#[derive(Clone, Copy)]
struct RangeInfo {
    bounds: Box4,
    centroids: Box4,
    /// False when `centroids` may be larger than it has to be.
    exact: bool,
}

impl RangeInfo {
    const EMPTY: Self = Self { bounds: Box4::EMPTY, centroids: Box4::EMPTY, exact: true };

    #[inline(always)]
    fn add(&mut self, r: &PrimRef) {
        self.bounds.grow(r.lo, r.hi);
        let c = r.lo + r.hi;
        self.centroids.grow(c, c);
    }

    fn merge(mut self, o: Self) -> Self {
        self.bounds.grow(o.bounds.lo, o.bounds.hi);
        self.centroids.grow(o.centroids.lo, o.centroids.hi);
        self
    }

    /// The range in a known box; long ranges are not read.
    fn within(refs: &[PrimRef], bounds: Box4) -> Self {
        if refs.len() <= LOOSE {
            return Self::of(refs);
        }
        let centroids = Box4 { lo: bounds.lo + bounds.lo, hi: bounds.hi + bounds.hi };
        Self { bounds, centroids, exact: false }
    }

    fn of(refs: &[PrimRef]) -> Self {
        let sweep = |refs: &[PrimRef]| {
            let mut info = Self::EMPTY;
            refs.iter().for_each(|r| info.add(r));
            info
        };
        if refs.len() <= PARALLEL_SWEEP {
            sweep(refs)
        } else {
            refs.par_chunks(PARALLEL_SWEEP / 4).map(sweep).reduce(|| Self::EMPTY, Self::merge)
        }
    }
}

/// The cost model of the surface area heuristic, in units of one wide-node step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cost {
    /// Cost of one leaf block.
    pub block: f32,
    /// Cost of one binary step.
    pub step: f32,
    /// Largest leaf.
    pub max_leaf: usize,
}

impl Cost {
    #[inline]
    fn leaf(&self, n: usize) -> f32 {
        n.div_ceil(LANES) as f32 * self.block
    }
}

/// Maps centroids to bins on all three axes at once.
#[derive(Clone, Copy)]
struct Binning {
    origin: Vec4,
    scale: Vec4,
    /// Bins in use: few for short ranges, where sweeping over bins would cost more than filling them.
    bins: usize,
}

impl Binning {
    fn new(c: &Box4, refs: usize) -> Self {
        let bins = (6 + refs / 16).min(BINS);
        let extent = c.hi - c.lo;
        // A flat axis gets scale 0 and all its centroids fall into bin 0.
        let scale = |e: f32| if e > 0.0 && (bins as f32 / e).is_finite() { bins as f32 * 0.9999 / e } else { 0.0 };
        Self { origin: c.lo, scale: Vec4::new(scale(extent.x), scale(extent.y), scale(extent.z), 0.0), bins }
    }

    #[inline(always)]
    fn bins(&self, r: &PrimRef) -> [usize; 3] {
        // Adding 2²³ leaves the integer part in the low bits of the mantissa.
        let x = ((r.lo + r.hi) - self.origin) * self.scale - Vec4::splat(0.5);
        let x = x.max(Vec4::ZERO) + Vec4::splat(8_388_608.0);
        let bin = |x: f32| (x.to_bits() & (BINS as u32 - 1)) as usize;
        [bin(x.x), bin(x.y), bin(x.z)]
    }
}

/// Boxes and counts of all bins; only the first `used` of each axis are valid.
struct Bins {
    boxes: [[Box4; BINS]; 3],
    counts: [[u32; BINS]; 3],
    used: usize,
}

impl Bins {
    const EMPTY: Self = Self { boxes: [[Box4::EMPTY; BINS]; 3], counts: [[0; BINS]; 3], used: 0 };

    fn fill(&mut self, refs: &[PrimRef], map: &Binning) {
        if refs.len() > PARALLEL_SWEEP {
            let part = |c: &[PrimRef]| {
                let mut b = Self::EMPTY;
                b.fill(c, map);
                b
            };
            let chunks = refs.par_chunks(PARALLEL_SWEEP / 4).map(part);
            *self = chunks.reduce_with(Self::merge).expect("the range is not empty");
            return;
        }
        self.used = map.bins;
        for axis in 0..3 {
            self.boxes[axis][..map.bins].fill(Box4::EMPTY);
            self.counts[axis][..map.bins].fill(0);
        }
        for r in refs {
            let [x, y, z] = map.bins(r);
            self.boxes[0][x].grow(r.lo, r.hi);
            self.boxes[1][y].grow(r.lo, r.hi);
            self.boxes[2][z].grow(r.lo, r.hi);
            self.counts[0][x] += 1;
            self.counts[1][y] += 1;
            self.counts[2][z] += 1;
        }
    }

    fn merge(mut self, o: Self) -> Self {
        for axis in 0..3 {
            for i in 0..self.used {
                self.boxes[axis][i].grow(o.boxes[axis][i].lo, o.boxes[axis][i].hi);
                self.counts[axis][i] += o.counts[axis][i];
            }
        }
        self
    }

    /// The boxes on both sides of a plane.
    fn sides(&self, axis: usize, bin: usize) -> [Box4; 2] {
        let union = |boxes: &[Box4]| {
            let mut b = Box4::EMPTY;
            boxes.iter().for_each(|x| b.grow(x.lo, x.hi));
            b
        };
        let (left, right) = self.boxes[axis][..self.used].split_at(bin);
        [union(left), union(right)]
    }

    /// The cheapest plane: `(cost × area, axis, first bin on the right)`.
    fn best(&self, cost: &Cost) -> Option<(f32, usize, usize)> {
        let mut best: Option<(f32, usize, usize)> = None;
        for axis in 0..3 {
            // Sweep from the right, then from the left.
            let mut right = [0f32; BINS];
            let (mut b, mut n) = (Box4::EMPTY, 0);
            for i in (1..self.used).rev() {
                b.grow(self.boxes[axis][i].lo, self.boxes[axis][i].hi);
                n += self.counts[axis][i] as usize;
                right[i] = if n == 0 { f32::NAN } else { half_area(b.lo, b.hi) * cost.leaf(n) };
            }
            let (mut b, mut n) = (Box4::EMPTY, 0);
            for (i, &right) in right.iter().enumerate().take(self.used).skip(1) {
                b.grow(self.boxes[axis][i - 1].lo, self.boxes[axis][i - 1].hi);
                n += self.counts[axis][i - 1] as usize;
                if n == 0 {
                    continue;
                }
                // An empty right side is NaN and never smaller.
                let c = half_area(b.lo, b.hi) * cost.leaf(n) + right;
                if c < best.map_or(f32::INFINITY, |b| b.0) {
                    best = Some((c, axis, i));
                }
            }
        }
        best
    }
}

/// Builds the tree and reorders `refs` so that every leaf is a range of one kind.
pub(super) fn build(refs: &mut [PrimRef], cost: &Cost) -> Pages<Node2> {
    if refs.is_empty() {
        return Pages::zeroed(0);
    }
    let mut nodes = Pages::<Node2>::zeroed(2 * refs.len() - 1);
    let info = RangeInfo::of(refs);
    let mut scratch = Pages::<PrimRef>::zeroed(refs.len());
    let mut bins = Bins::EMPTY;
    split(refs, &mut scratch, &mut nodes, 0, info, 0, cost, &mut bins);
    nodes
}

#[allow(clippy::too_many_arguments)]
fn split(
    refs: &mut [PrimRef],
    scratch: &mut [PrimRef],
    nodes: &mut [Node2],
    first: usize,
    info: RangeInfo,
    depth: u32,
    cost: &Cost,
    bins: &mut Bins,
) {
    let n = refs.len();
    let same_kind = n <= cost.max_leaf && refs.iter().all(|r| r.kind() == refs[0].kind());
    let fits = same_kind && (refs[0].kind() == 0 || n == 1);
    let area = half_area(info.bounds.lo, info.bounds.hi);
    // Where a step costs as much as a block, a single block is never worth splitting.
    if n == 1 || fits && n <= LANES && cost.step >= cost.block {
        nodes[0] = Node2::new(&info.bounds, first as u32, n as u32);
        return;
    }
    // Find the cheapest plane and compare it with a leaf.
    let mut map = Binning::new(&info.centroids, n);
    bins.fill(refs, &map);
    let mut plane = if depth < MAX_SAH_DEPTH { bins.best(cost) } else { None };
    if plane.is_none() && !info.exact && depth < MAX_SAH_DEPTH {
        // All centroids may have fallen into one bin.
        map = Binning::new(&RangeInfo::of(refs).centroids, n);
        bins.fill(refs, &map);
        plane = bins.best(cost);
    }
    let split_cost = plane.map_or(f32::INFINITY, |p| p.0) + cost.step * area;
    if fits && cost.leaf(n) * area <= split_cost {
        nodes[0] = Node2::new(&info.bounds, first as u32, n as u32);
        return;
    }
    // Part the range: by the plane, by kind where no leaf may be made, or in the middle.
    let (mid, left, right) = match plane {
        Some((_, axis, bin)) => {
            let [left, right] = bins.sides(axis, bin);
            let mid = partition(refs, scratch, |r| map.bins(r)[axis] < bin);
            (mid, RangeInfo::within(&refs[..mid], left), RangeInfo::within(&refs[mid..], right))
        }
        None => {
            refs.sort_unstable_by_key(|r| (r.kind(), r.id()));
            let change = refs.iter().position(|r| r.kind() != refs[0].kind());
            let mid = change.unwrap_or(n / 2);
            (mid, RangeInfo::of(&refs[..mid]), RangeInfo::of(&refs[mid..]))
        }
    };
    nodes[0] = Node2::new(&info.bounds, 2 * mid as u32, 0);
    let (rl, rr) = refs.split_at_mut(mid);
    let (nl, nr) = nodes[1..].split_at_mut(2 * mid - 1);
    let (sl, sr) = scratch.split_at_mut(mid);
    if n > PARALLEL_SPLIT {
        rayon::join(
            || split(rl, sl, nl, first, left, depth + 1, cost, bins),
            || {
                let mut bins = Bins::EMPTY;
                split(rr, sr, nr, first + mid, right, depth + 1, cost, &mut bins);
            },
        );
    } else {
        split(rl, sl, nl, first, left, depth + 1, cost, bins);
        split(rr, sr, nr, first + mid, right, depth + 1, cost, bins);
    }
}

/// Moves the references for which `is_left` holds to the front.
fn partition(refs: &mut [PrimRef], scratch: &mut [PrimRef], is_left: impl Fn(&PrimRef) -> bool + Sync) -> usize {
    if refs.len() > PARALLEL_SWEEP {
        return partition_parallel(refs, scratch, is_left);
    }
    // Write every reference to both places and keep one of them: the branch could not be predicted.
    let (mut i, mut j) = (0, 0);
    for k in 0..refs.len() {
        let r = refs[k];
        let left = usize::from(is_left(&r));
        refs[i] = r;
        scratch[j] = r;
        i += left;
        j += 1 - left;
    }
    refs[i..].copy_from_slice(&scratch[..j]);
    i
}

/// The same for long ranges: count per chunk, then copy each chunk to its two places.
fn partition_parallel(
    refs: &mut [PrimRef],
    scratch: &mut [PrimRef],
    is_left: impl Fn(&PrimRef) -> bool + Sync,
) -> usize {
    const CHUNK: usize = PARALLEL_SWEEP / 4;
    let counts: Vec<usize> = refs.par_chunks(CHUNK).map(|c| c.iter().filter(|r| is_left(r)).count()).collect();
    let mid: usize = counts.iter().sum();
    // Hand every chunk its own piece of both sides.
    let (mut l, mut r) = scratch[..refs.len()].split_at_mut(mid);
    let mut jobs = Vec::with_capacity(counts.len());
    for (chunk, &n) in refs.chunks(CHUNK).zip(&counts) {
        let (a, rest_l) = l.split_at_mut(n);
        let (b, rest_r) = r.split_at_mut(chunk.len() - n);
        (l, r) = (rest_l, rest_r);
        jobs.push((chunk, a, b));
    }
    jobs.into_par_iter().for_each(|(chunk, a, b)| {
        let (mut i, mut j) = (0, 0);
        for p in chunk {
            if is_left(p) {
                a[i] = *p;
                i += 1;
            } else {
                b[j] = *p;
                j += 1;
            }
        }
    });
    let copy = refs.par_chunks_mut(CHUNK).zip(scratch.par_chunks(CHUNK));
    copy.for_each(|(to, from)| to.copy_from_slice(&from[..to.len()]));
    mid
}
