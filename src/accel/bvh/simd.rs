//! Vector kernels, a file for each architecture, and their dispatch: the only unsafe code of this room.

#[cfg(target_arch = "aarch64")]
mod neon;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::mem::MaybeUninit;

use super::super::Mode;
use super::binned::{self, Binning, Bins, PrimRef, Recipe};
use super::flat::{self, Flat, FlatRay};
use super::kernel::{Kernel, Portable};
use super::traverse::{self, Best};
#[cfg(target_arch = "x86_64")]
use super::wave::{Candidates, Wave};
use super::wide::{Block, Child, Node8, Tree};
use super::{Bvh, Isa};
use crate::geometry::{Ray, is_traceable};

/// Reads a stack entry.
#[inline(always)]
pub(super) fn read<T: Copy, const N: usize>(stack: &[MaybeUninit<T>; N], index: usize) -> T {
    // SAFETY: the traversal loops write entry `size` before they increment `size`, and read only below `size`.
    unsafe { stack[index].assume_init() }
}

/// The node that a child slot of this tree refers to.
#[inline(always)]
pub(super) fn node_of(nodes: &[Node8], child: Child) -> &Node8 {
    debug_assert!((child.0 as usize) < nodes.len());
    // SAFETY: `wide::build` only makes node references below the number of nodes, and a tree is never changed.
    unsafe { nodes.get_unchecked(child.0 as usize) }
}

/// The blocks that a triangle leaf of this tree refers to.
#[inline(always)]
pub(super) fn blocks_of(blocks: &[Block], child: Child) -> &[Block] {
    debug_assert!(child.blocks().end <= blocks.len());
    // SAFETY: `wide::build` only makes leaf references within the blocks, and a tree is never changed.
    unsafe { blocks.get_unchecked(child.blocks()) }
}

impl Isa {
    /// The best one that this processor has.
    pub fn detect() -> Self {
        Self::ALL.into_iter().find(|isa| isa.is_available()).unwrap_or(Self::Portable)
    }

    /// True when this processor can run it.
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "aarch64")]
            Self::Neon => true,
            #[allow(unreachable_patterns)]
            _ => false,
        }
    }
}

/// Searches `tree` with the kernel that was chosen when the tree was built.
#[inline(always)]
pub(super) fn walk<const ANY: bool>(bvh: &Bvh, tree: &Tree, ray: &Ray, placed: u32, best: &mut Best) {
    if let Some(flat) = &tree.flat
        && is_traceable(ray)
        && let Some(flat_ray) = flat.prepare(ray)
    {
        return test_all::<ANY>(bvh, tree, (flat, &flat_ray), ray, placed, best);
    }
    if bvh.options.mode == Mode::Fast {
        walk_with::<ANY, false>(bvh, tree, ray, placed, best)
    } else {
        walk_with::<ANY, true>(bvh, tree, ray, placed, best)
    }
}

#[inline]
fn walk_with<const ANY: bool, const ROBUST: bool>(bvh: &Bvh, tree: &Tree, ray: &Ray, placed: u32, best: &mut Best) {
    match bvh.isa {
        // SAFETY: `Bvh::isa` is only ever set to an available instruction set.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => unsafe { x86::walk_avx512::<ANY, ROBUST>(bvh, tree, ray, placed, best) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { x86::walk_avx2::<ANY, ROBUST>(bvh, tree, ray, placed, best) },
        #[cfg(target_arch = "aarch64")]
        Isa::Neon => neon::walk::<ANY, ROBUST>(bvh, tree, ray, placed, best),
        _ => walk_portable::<ANY, ROBUST>(bvh, tree, ray, placed, best),
    }
}

#[inline(always)]
fn test_all<const ANY: bool>(bvh: &Bvh, tree: &Tree, flat: (&Flat, &FlatRay), ray: &Ray, placed: u32, best: &mut Best) {
    match bvh.isa {
        // SAFETY: `Bvh::isa` is only ever set to an available instruction set.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => unsafe { x86::test_all_avx512::<ANY>(bvh, tree, flat, ray, placed, best) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { x86::test_all_avx2::<ANY>(bvh, tree, flat, ray, placed, best) },
        _ => flat::test_all::<Portable, ANY>(bvh, tree, flat, ray, placed, best),
    }
}

/// Lets all rays of a wave meet all triangles, those of a [`Bvh`] that is searched by AVX-512, and keeps for each ray those
/// that may be the nearest.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) fn meet_triangles(isa: Isa, wave: &Wave, candidates: &mut Candidates, flat: &Flat) {
    assert!(isa == Isa::Avx512, "waves are searched by AVX-512 alone");
    // SAFETY: `Bvh::isa` is only ever set to an available instruction set.
    unsafe { x86::meet_triangles(wave, candidates, flat) }
}

/// Work that is worth compiling for each instruction set. Results do not depend on which: products and sums are fused only
/// where the code asks for it.
pub trait Task {
    type Output;

    /// To be inlined always, and with it what is hot inside; what is not inlined is compiled for every processor.
    fn run(self) -> Self::Output;
}

/// Runs `task` as compiled for the best instruction set of this processor. Ray queries of the Rust BVH become part of it.
#[inline]
pub fn run<T: Task>(task: T) -> T::Output {
    match Isa::detect() {
        // SAFETY: the instruction set is available.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => unsafe { x86::run_avx512(task) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { x86::run_avx2(task) },
        _ => task.run(),
    }
}

/// Sorts references into bins.
#[inline]
pub(super) fn fill_bins(bins: &mut Bins, refs: &[PrimRef], map: &Binning) {
    // Short functions, so the question comes first; the standard library remembers the answer.
    #[cfg(target_arch = "x86_64")]
    if Isa::Avx2.is_available() {
        // SAFETY: AVX2 is available.
        return unsafe { x86::fill_bins(bins, refs, map) };
    }
    bins.fill::<binned::Portable>(refs, map);
}

/// The cheapest plane between bins.
#[inline]
pub(super) fn best_plane(bins: &Bins, recipe: &Recipe) -> Option<(f32, usize, usize)> {
    #[cfg(target_arch = "x86_64")]
    if Isa::Avx2.is_available() {
        // SAFETY: AVX2 is available.
        return unsafe { x86::best_plane(bins, recipe) };
    }
    bins.best::<binned::Portable>(recipe)
}

#[inline(never)]
fn walk_portable<const ANY: bool, const ROBUST: bool>(bvh: &Bvh, tree: &Tree, ray: &Ray, placed: u32, best: &mut Best) {
    traverse::walk::<Portable, ANY, ROBUST>(bvh, tree, ray, placed, best);
}
