//! Splits ranges of references by binned SAH [Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies"].
//!
//! The splits are the same for any number of threads: work is cut by size, and merging boxes and counts is exact.

use arrayvec::ArrayVec;
use glam::{Vec3Swizzles, Vec4, Vec4Swizzles};
use rayon::prelude::*;

use super::simd;
use super::wide::{LANES, WIDTH};
use crate::math::Bounds3;

/// Bins per axis.
const BINS: usize = 32;
/// The bits of a bin.
const MASK: u32 = BINS as u32 - 1;
/// Deeper than any sensible tree: from here on ranges are halved, so that recursion stays bounded.
const MAX_SAH_DEPTH: u32 = 96;
/// Ranges longer than this take the box of their centroids from their own box, which saves a pass.
const LOOSE: usize = 256;
/// Ranges longer than this are binned and partitioned in parallel.
const PARALLEL_SWEEP: usize = 1 << 15;
/// References that one task of a parallel sweep takes.
const CHUNK: usize = PARALLEL_SWEEP / 4;

/// Eight floats: lower corner, a free lane, negated upper corner, a free lane. Uniting two boxes is one minimum, and the
/// free lanes may hold anything.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(32))]
pub(super) struct Box8(pub [f32; 8]);

impl Box8 {
    pub const EMPTY: Self = Self([f32::INFINITY; 8]);

    #[inline(always)]
    pub fn grow(&mut self, o: &Self) {
        let (lower, upper) = (self.lower().min(o.lower()), self.negated_upper().min(o.negated_upper()));
        lower.write_to_slice(&mut self.0[..4]);
        upper.write_to_slice(&mut self.0[4..]);
    }

    #[inline(always)]
    fn lower(&self) -> Vec4 {
        Vec4::from_slice(&self.0)
    }

    #[inline(always)]
    fn negated_upper(&self) -> Vec4 {
        Vec4::from_slice(&self.0[4..])
    }

    #[inline(always)]
    pub fn half_area(&self) -> f32 {
        let e = -(self.lower() + self.negated_upper()).xyz();
        e.dot(e.yzx())
    }

    pub fn bounds(&self) -> Bounds3 {
        Bounds3::new(self.lower().xyz(), -self.negated_upper().xyz())
    }
}

/// How to unite boxes, for code that is compiled for several instruction sets.
pub(super) trait Union {
    fn grow(a: &mut Box8, b: &Box8);
}

/// For every processor.
pub(super) struct Portable;

impl Union for Portable {
    #[inline(always)]
    fn grow(a: &mut Box8, b: &Box8) {
        a.grow(b);
    }
}

/// A box with the identity of what is inside.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(super) struct PrimRef(Box8);

impl PrimRef {
    #[inline(always)]
    pub fn new(b: Bounds3, id: u32, kind: u32) -> Self {
        let (lo, hi) = (b.min, -b.max);
        Self(Box8([lo.x, lo.y, lo.z, f32::from_bits(id), hi.x, hi.y, hi.z, f32::from_bits(kind)]))
    }

    #[inline(always)]
    pub fn id(&self) -> u32 {
        self.0.0[3].to_bits()
    }

    #[inline(always)]
    pub fn kind(&self) -> u32 {
        self.0.0[7].to_bits()
    }

    #[inline(always)]
    pub fn bounds(&self) -> &Box8 {
        &self.0
    }

    /// Twice the centre of the box; the last lane is undefined.
    #[inline(always)]
    fn centroid(&self) -> Vec4 {
        self.0.lower() - self.0.negated_upper()
    }
}

/// How carefully ranges are parted, and the cost model of the surface area heuristic, in units of one wide-node step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recipe {
    /// Cost of one leaf block.
    pub block: f32,
    /// Cost of one binary step.
    pub step: f32,
    /// Largest leaf.
    pub max_leaf: usize,
    /// Bins of the shortest ranges.
    pub least_bins: usize,
    /// References for which there is one bin more.
    pub refs_per_bin: usize,
    /// Looks for planes on the longest axis only.
    pub one_axis: bool,
}

impl Recipe {
    #[inline(always)]
    fn leaf(&self, n: usize) -> f32 {
        n.div_ceil(LANES) as f32 * self.block
    }
}

/// Maps centroids to bins on all three axes at once.
#[derive(Clone, Copy)]
pub(super) struct Binning {
    origin: Vec4,
    scale: Vec4,
    /// Bins in use: few for short ranges, where sweeping over bins would cost more than filling them.
    bins: usize,
    /// First axis that is looked at, and the one behind the last.
    axes: (usize, usize),
}

impl Binning {
    /// For centroids, doubled, that lie between two corners.
    fn new(lower: Vec4, upper: Vec4, refs: usize, recipe: &Recipe) -> Self {
        let bins = (recipe.least_bins + refs / recipe.refs_per_bin).min(BINS);
        let extent = upper - lower;
        let axes = if recipe.one_axis {
            let longest = extent.xyz().max_position();
            (longest, longest + 1)
        } else {
            (0, 3)
        };
        // A flat axis gets scale 0 and all its centroids fall into bin 0.
        let scale = |e: f32| if e > 0.0 && (bins as f32 / e).is_finite() { bins as f32 * 0.9999 / e } else { 0.0 };
        Self { origin: lower, scale: Vec4::new(scale(extent.x), scale(extent.y), scale(extent.z), 0.0), bins, axes }
    }

    /// Reads the centroids.
    fn exact(refs: &[PrimRef], recipe: &Recipe) -> Self {
        let (mut lower, mut upper) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        for r in refs {
            let c = r.centroid();
            (lower, upper) = (lower.min(c), upper.max(c));
        }
        Self::new(lower, upper, refs.len(), recipe)
    }

    /// Takes the box of the centroids to be as large as the box of the references.
    fn loose(bounds: &Box8, refs: usize, recipe: &Recipe) -> Self {
        let (lower, upper) = (bounds.lower(), -bounds.negated_upper());
        Self::new(lower + lower, upper + upper, refs, recipe)
    }

    #[inline(always)]
    fn bins(&self, r: &PrimRef) -> [usize; 3] {
        // Adding 2²³ leaves the integer part in the low bits of the mantissa.
        let x = (r.centroid() - self.origin) * self.scale - Vec4::splat(0.5);
        let x = x.max(Vec4::ZERO) + Vec4::splat(8_388_608.0);
        [(x.x.to_bits() & MASK) as usize, (x.y.to_bits() & MASK) as usize, (x.z.to_bits() & MASK) as usize]
    }

    /// The bin on one axis, by the same operations.
    #[inline(always)]
    fn bin(&self, r: &PrimRef, axis: usize) -> usize {
        let x = (r.0.0[axis] - r.0.0[axis + 4] - self.origin[axis]) * self.scale[axis] - 0.5;
        let x = x.max(0.0) + 8_388_608.0;
        (x.to_bits() & MASK) as usize
    }
}

/// References in each bin of each axis.
type Counts = [[u32; BINS]; 3];

/// Boxes and counts of all bins; only the first `used` of each axis are valid.
pub(super) struct Bins {
    boxes: [[Box8; BINS]; 3],
    counts: Counts,
    used: usize,
    axes: (usize, usize),
}

/// Where a range is parted, and what lies on either side.
struct Plane {
    /// Cost times area.
    cost: f32,
    axis: usize,
    /// First bin on the right.
    bin: usize,
    /// References on the left.
    left: usize,
    sides: [Box8; 2],
}

impl Bins {
    pub const EMPTY: Self = Self { boxes: [[Box8::EMPTY; BINS]; 3], counts: [[0; BINS]; 3], used: 0, axes: (0, 0) };

    /// Replaces the contents; inlined into one function for each instruction set.
    #[inline(always)]
    pub fn fill<U: Union>(&mut self, refs: &[PrimRef], map: &Binning) {
        (self.used, self.axes) = (map.bins, map.axes);
        for axis in map.axes.0..map.axes.1 {
            self.boxes[axis][..map.bins].fill(Box8::EMPTY);
            self.counts[axis][..map.bins].fill(0);
        }
        if map.axes != (0, 3) {
            let axis = map.axes.0;
            for r in refs {
                let bin = map.bin(r, axis);
                U::grow(&mut self.boxes[axis][bin], &r.0);
                self.counts[axis][bin] += 1;
            }
            return;
        }
        for r in refs {
            let [x, y, z] = map.bins(r);
            U::grow(&mut self.boxes[0][x], &r.0);
            U::grow(&mut self.boxes[1][y], &r.0);
            U::grow(&mut self.boxes[2][z], &r.0);
            self.counts[0][x] += 1;
            self.counts[1][y] += 1;
            self.counts[2][z] += 1;
        }
    }

    /// The same for long ranges; also returns the counts of each chunk.
    fn fill_parallel(&mut self, refs: &[PrimRef], map: &Binning) -> Vec<Counts> {
        let part = |chunk: &[PrimRef]| {
            let mut bins = Self::EMPTY;
            simd::fill_bins(&mut bins, chunk, map);
            bins
        };
        *self = Self { used: map.bins, axes: map.axes, ..Self::EMPTY };
        let mut counts = Vec::with_capacity(refs.len().div_ceil(CHUNK));
        // In groups, as the bins of a chunk take more room than its share of the references.
        for group in refs.chunks(64 * CHUNK) {
            let parts: Vec<Self> = group.par_chunks(CHUNK).map(part).collect();
            parts.iter().for_each(|p| self.merge(p));
            counts.extend(parts.iter().map(|p| p.counts));
        }
        counts
    }

    fn merge(&mut self, o: &Self) {
        for axis in self.axes.0..self.axes.1 {
            for i in 0..self.used {
                self.boxes[axis][i].grow(&o.boxes[axis][i]);
                self.counts[axis][i] += o.counts[axis][i];
            }
        }
    }

    /// The cheapest plane; inlined into one function for each instruction set.
    #[inline(always)]
    pub fn best<U: Union>(&self, recipe: &Recipe) -> Option<(f32, usize, usize)> {
        let mut best = (f32::INFINITY, 3, 0);
        for axis in self.axes.0..self.axes.1 {
            let (boxes, counts) = (&self.boxes[axis][..self.used], &self.counts[axis][..self.used]);
            // Sweep from the right, then from the left.
            let mut right = [0f32; BINS];
            let (mut b, mut n) = (Box8::EMPTY, 0);
            for i in (1..self.used).rev() {
                U::grow(&mut b, &boxes[i]);
                n += counts[i] as usize;
                right[i] = if n == 0 { f32::NAN } else { b.half_area() * recipe.leaf(n) };
            }
            let (mut b, mut n) = (Box8::EMPTY, 0);
            for i in 1..self.used {
                U::grow(&mut b, &boxes[i - 1]);
                n += counts[i - 1] as usize;
                if n == 0 {
                    continue;
                }
                // An empty right side is NaN and never smaller.
                let c = b.half_area() * recipe.leaf(n) + right[i];
                if c < best.0 {
                    best = (c, axis, i);
                }
            }
        }
        (best.1 < 3).then_some(best)
    }

    fn plane(&self, recipe: &Recipe) -> Option<Plane> {
        let (cost, axis, bin) = simd::best_plane(self, recipe)?;
        let mut sides = [Box8::EMPTY; 2];
        for i in 0..self.used {
            sides[usize::from(i >= bin)].grow(&self.boxes[axis][i]);
        }
        let left = self.counts[axis][..bin].iter().sum::<u32>() as usize;
        Some(Plane { cost, axis, bin, left, sides })
    }
}

/// A range of references on its way to become a leaf or a node.
#[derive(Debug)]
pub(super) struct Piece<'a> {
    /// The references, and room for as many: parting a range moves it from one to the other.
    pub refs: &'a mut [PrimRef],
    pub spare: &'a mut [PrimRef],
    /// True when `refs` lies where `spare` lay at first.
    pub moved: bool,
    /// True when it is not worth splitting.
    pub leaf: bool,
    /// How many times its references have been parted.
    pub depth: u32,
    /// Half the area of `bounds`.
    pub area: f32,
    pub bounds: Box8,
}

impl<'a> Piece<'a> {
    /// A range that nobody has looked at; `spare` is as long as `refs`.
    pub fn new(refs: &'a mut [PrimRef], spare: &'a mut [PrimRef], bounds: Box8, depth: u32) -> Self {
        debug_assert_eq!(refs.len(), spare.len());
        Self { leaf: refs.len() == 1, area: bounds.half_area(), refs, spare, moved: false, depth, bounds }
    }

    /// Parts the range in two; a range that had better be a leaf of one kind comes back as such.
    fn split(mut self, recipe: &Recipe, bins: &mut Bins) -> Result<[Self; 2], Self> {
        let n = self.refs.len();
        let kind = self.refs[0].kind();
        let fits = n == 1 || kind == 0 && n <= recipe.max_leaf && self.refs.iter().all(|r| r.kind() == kind);
        // Where a step costs as much as a block, a single block is never worth splitting.
        if n == 1 || fits && n <= LANES && recipe.step >= recipe.block {
            self.leaf = true;
            return Err(self);
        }
        // Find the cheapest plane and compare it with a leaf.
        let loose = n > LOOSE;
        let mut map = if loose { Binning::loose(&self.bounds, n, recipe) } else { Binning::exact(self.refs, recipe) };
        let mut counts = Vec::new();
        let mut search = |refs: &[PrimRef], map: &Binning| {
            if n > PARALLEL_SWEEP {
                counts = bins.fill_parallel(refs, map);
            } else {
                simd::fill_bins(bins, refs, map);
            }
            bins.plane(recipe)
        };
        let mut plane = if self.depth < MAX_SAH_DEPTH { search(self.refs, &map) } else { None };
        if plane.is_none() && loose && self.depth < MAX_SAH_DEPTH {
            // All centroids may have fallen into one bin.
            map = Binning::exact(self.refs, recipe);
            plane = search(self.refs, &map);
        }
        let split_cost = plane.as_ref().map_or(f32::INFINITY, |p| p.cost) + recipe.step * self.area;
        if fits && recipe.leaf(n) * self.area <= split_cost {
            self.leaf = true;
            return Err(self);
        }
        let Some(Plane { axis, bin, left, sides, .. }) = plane else { return Ok(self.halve()) };
        let is_left = |r: &PrimRef| map.bin(r, axis) < bin;
        if counts.is_empty() {
            match axis {
                0 => partition(self.refs, self.spare, left, |r| map.bin(r, 0) < bin),
                1 => partition(self.refs, self.spare, left, |r| map.bin(r, 1) < bin),
                _ => partition(self.refs, self.spare, left, |r| map.bin(r, 2) < bin),
            }
        } else {
            let lefts = counts.iter().map(|c| c[axis][..bin].iter().sum::<u32>() as usize).collect();
            partition_parallel(self.refs, self.spare, left, lefts, is_left);
        }
        self.moved = !self.moved;
        std::mem::swap(&mut self.refs, &mut self.spare);
        Ok(self.cut(left, sides))
    }

    /// Parts by kind where no leaf may be made, or in the middle.
    fn halve(self) -> [Self; 2] {
        self.refs.sort_unstable_by_key(|r| (r.kind(), r.id()));
        let change = self.refs.iter().position(|r| r.kind() != self.refs[0].kind());
        let mid = change.unwrap_or(self.refs.len() / 2);
        let union = |refs: &[PrimRef]| {
            let mut b = Box8::EMPTY;
            refs.iter().for_each(|r| b.grow(&r.0));
            b
        };
        let sides = [union(&self.refs[..mid]), union(&self.refs[mid..])];
        self.cut(mid, sides)
    }

    fn cut(self, mid: usize, [left, right]: [Box8; 2]) -> [Self; 2] {
        let (refs_l, refs_r) = self.refs.split_at_mut(mid);
        let (spare_l, spare_r) = self.spare.split_at_mut(mid);
        let half = |refs, spare, bounds| Self { moved: self.moved, ..Self::new(refs, spare, bounds, self.depth + 1) };
        [half(refs_l, spare_l, left), half(refs_r, spare_r, right)]
    }
}

/// The children of the wide node over a range, in the order of their references: the largest one is parted until there
/// are eight. A single one is a leaf.
pub(super) fn open<'a>(piece: Piece<'a>, recipe: &Recipe, bins: &mut Bins) -> ArrayVec<Piece<'a>, WIDTH> {
    let mut children = ArrayVec::<Piece, WIDTH>::new();
    children.push(piece);
    while children.len() < WIDTH {
        let mut largest: Option<(f32, usize)> = None;
        for (slot, c) in children.iter().enumerate() {
            if !c.leaf && largest.is_none_or(|l| c.area > l.0) {
                largest = Some((c.area, slot));
            }
        }
        let Some((_, slot)) = largest else { break };
        match children.remove(slot).split(recipe, bins) {
            Err(leaf) => children.insert(slot, leaf),
            Ok([left, right]) => {
                children.insert(slot, left);
                children.insert(slot + 1, right);
            }
        }
    }
    children
}

/// Copies the references for which `is_left` holds to the front of `out`, which has room for `left` of them, and the
/// others behind them.
fn partition(refs: &[PrimRef], out: &mut [PrimRef], left: usize, is_left: impl Fn(&PrimRef) -> bool) {
    let mut i = 0;
    for (k, r) in refs.iter().enumerate() {
        let is_left = is_left(r);
        out[if is_left { i } else { left + k - i }] = *r;
        i += usize::from(is_left);
    }
}

/// The same for long ranges, with the number on the left in each chunk.
fn partition_parallel(
    refs: &[PrimRef],
    out: &mut [PrimRef],
    left: usize,
    lefts: Vec<usize>,
    is_left: impl Fn(&PrimRef) -> bool + Sync,
) {
    // Hand every chunk its own piece of both sides.
    let (mut l, mut r) = out.split_at_mut(left);
    let mut jobs = Vec::with_capacity(lefts.len());
    for (chunk, n) in refs.chunks(CHUNK).zip(lefts) {
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
}
