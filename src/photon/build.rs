//! Balancing: photons in emission order become a left-balanced heap.
//!
//! The median is found by rank, recursively, along the widest extent of the node's own points. Ranks compare
//! `(coordinate, emission index)`, so that the tree does not depend on the number of threads, and a million photons at the
//! same place are as good as any others.

use super::bottom::Bottom;
use super::heap;
use super::map::{Block, Split};
use super::packed::{Flags, Photon, storable};
use super::select::{Scratch, select};
use super::simd::{Level, Simd, Task};
use crate::math::{Bounds3, Vec3};
use crate::pages::Pages;
use rayon::prelude::*;

/// Subtrees of at least this many photons are balanced as two parallel halves.
const PARALLEL_FROM: usize = 1 << 16;

/// Photons are taken in by so many at a time.
const CHUNK: usize = 1 << 14;

/// What the balancing moves: a position, its coordinates as numbers in the total order of floats, and the photon's place in
/// emission order.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(16))]
pub(crate) struct Key {
    pub p: [i32; 3],
    pub id: u32,
}

impl Key {
    /// Total order along an axis, ties by emission index.
    #[inline(always)]
    pub fn order(&self, axis: usize) -> (i32, u32) {
        (self.p[axis], self.id)
    }
}

/// A float's place in the total order of floats.
#[inline(always)]
pub(super) fn ordered(v: f32) -> i32 {
    // Negative floats count backwards.
    let bits = v.to_bits() as i32;
    bits ^ (bits >> 31 & i32::MAX)
}

/// The float of that place.
#[inline(always)]
pub(super) fn unordered(v: i32) -> f32 {
    f32::from_bits((v ^ (v >> 31 & i32::MAX)) as u32)
}

/// The axis of the widest extent; the first of equal ones.
#[inline(always)]
pub(super) fn widest(extent: [f32; 3]) -> usize {
    let xy = usize::from(extent[1] > extent[0]);
    if extent[2] > extent[xy] { 2 } else { xy }
}

/// What the balancing does not move.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(8))]
pub(crate) struct Cold {
    pub power: [u8; 4],
    pub direction: [u8; 2],
    pub flags: Flags,
}

/// Photons taken apart, in emission order.
pub(super) struct Emitted {
    keys: Pages<Key>,
    cold: Vec<Cold>,
    pub bounds: Bounds3,
    /// How many were left out because of their position.
    pub rejected: u64,
}

impl Emitted {
    /// Takes photons apart and gives back their memory.
    pub fn new(mut photons: Vec<Photon>) -> Self {
        let n = photons.len();
        let (mut keys, mut cold) = (Pages::<Key>::zeroed(n), bytemuck::zeroed_vec::<Cold>(n));
        let chunks = keys.par_chunks_mut(CHUNK).zip(cold.par_chunks_mut(CHUNK)).zip(photons.par_chunks(CHUNK));
        let (rejected, bounds) = chunks
            .enumerate()
            .map(|(chunk, ((keys, cold), photons))| take_apart(keys, cold, photons, (chunk * CHUNK) as u32))
            .reduce(|| (0, Bounds3::EMPTY), |a, b| (a.0 + b.0, a.1.union(b.1)));
        if rejected > 0 {
            // Rare: once more without them.
            drop((keys, cold));
            photons.retain(|p| storable(Vec3::from_array(p.position)));
            return Self { rejected, ..Self::new(photons) };
        }
        Self { keys, cold, bounds, rejected }
    }

    pub fn len(&self) -> usize {
        self.cold.len()
    }

    /// Balances the photons into the blocks, which are in the order of their buckets; the upper nodes are returned from
    /// left to right.
    pub fn balance(&mut self, level: Level, blocks: &mut [Block]) -> Vec<Upper> {
        let mut upper = vec![Upper::default(); blocks.len() - 1];
        let balancing = Balancing { level, cold: &self.cold };
        balancing.node(&mut self.keys, &mut upper, blocks, &mut Scratch::default());
        upper
    }

    /// Puts an upper node into lane 0 of a block.
    pub fn place(&self, upper: &Upper, block: &mut Block) -> Split {
        let Upper { key, axis } = *upper;
        let p = key.p.map(unordered);
        let Cold { power, direction, flags } = self.cold[key.id as usize];
        block.set(0, &Photon { position: p, power, direction, flags: flags.with_axis(axis as u16) });
        Split { at: p[axis as usize], axis }
    }
}

/// Keys and cold parts of a chunk whose first photon is number `first`; how many cannot be stored, and the box of all.
fn take_apart(keys: &mut [Key], cold: &mut [Cold], photons: &[Photon], first: u32) -> (u64, Bounds3) {
    let (mut rejected, mut bounds) = (0, Bounds3::EMPTY);
    for (i, ((key, cold), photon)) in keys.iter_mut().zip(cold).zip(photons).enumerate() {
        let p = Vec3::from_array(photon.position);
        rejected += u64::from(!storable(p));
        bounds = bounds.extend(p);
        *key = Key { p: photon.position.map(ordered), id: first + i as u32 };
        *cold = Cold { power: photon.power, direction: photon.direction, flags: photon.flags };
    }
    (rejected, bounds)
}

/// A node above the buckets, and the axis that it splits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Upper {
    key: Key,
    axis: u32,
}

struct Balancing<'a> {
    level: Level,
    cold: &'a [Cold],
}

impl Balancing<'_> {
    /// Balances the photons of a subtree that has some buckets and the upper nodes between them.
    fn node(&self, keys: &mut [Key], upper: &mut [Upper], blocks: &mut [Block], scratch: &mut Scratch) {
        if let [block] = blocks {
            self.level.run(Bottom { keys, cold: self.cold, block });
            return;
        }
        // Put the photon of the root's rank in its place, smaller ones to its left.
        let n = keys.len();
        let middle = heap::left_size(n);
        let axis = self.level.run(Halve { keys, middle, scratch });
        let (left, right) = keys.split_at_mut(middle);
        let (above, right) = right.split_first_mut().expect("a median");
        let (left_upper, right_upper) = upper.split_at_mut(upper.len() / 2);
        let (root, right_upper) = right_upper.split_first_mut().expect("an upper node");
        *root = Upper { key: *above, axis: axis as u32 };

        // Balance both sides.
        let (left_blocks, right_blocks) = blocks.split_at_mut(blocks.len() / 2);
        if n >= PARALLEL_FROM {
            rayon::join(
                || self.node(left, left_upper, left_blocks, &mut Scratch::default()),
                || self.node(right, right_upper, right_blocks, scratch),
            );
        } else {
            self.node(left, left_upper, left_blocks, scratch);
            self.node(right, right_upper, right_blocks, scratch);
        }
    }
}

/// Moves the key of rank `middle` along the widest extent to its place, smaller ones to its left; which axis that is.
struct Halve<'a> {
    keys: &'a mut [Key],
    middle: usize,
    scratch: &'a mut Scratch,
}

impl Task for Halve<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> usize {
        let (lo, hi) = simd.extents(self.keys);
        let axis = widest(std::array::from_fn(|a| unordered(hi[a]) - unordered(lo[a])));
        select(simd, self.keys, axis, self.middle, self.scratch);
        axis
    }
}
