//! The Rust back end: an 8-wide tree over triangles, analytic shapes and instances.
//!
//! Every query is watertight along shared edges. A ray with a coordinate that is not finite, a zero direction or a
//! `tmax` that is not positive hits nothing. Of several hits at the same `t` the lowest (shape, prim) wins, and geometry
//! that stands in the scene itself wins over instances.

mod binned;
mod flat;
mod kernel;
mod parts;
mod presplit;
mod simd;
#[cfg(test)]
mod tests;
mod traverse;
mod validate;
#[cfg(target_arch = "x86_64")]
mod wave;
mod wide;

use std::sync::Arc;

use super::{AccelOptions, Quality};
use crate::geometry::{GeometrySet, Hit, Ray};
use crate::math::Bounds3;
use parts::Parts;
pub use simd::{Task, run};
use wide::Tree;

/// Most analytic shapes beside few triangles for [`Bvh::suits`].
const FEW_SHAPES: u64 = 2;

/// The Rust tree over all geometry of a scene; two levels deep where there are instances.
#[derive(Debug)]
pub struct Bvh {
    set: Arc<GeometrySet>,
    top: Tree,
    groups: Vec<Tree>,
    isa: Isa,
    options: AccelOptions,
}

/// The instruction set of the traversal kernels. All give the same hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    Avx512,
    Avx2,
    /// What every AArch64 has.
    Neon,
    /// Plain arrays, which the compiler turns into SSE2 on x86-64.
    Portable,
}

impl Isa {
    /// All of them, the fastest first.
    pub const ALL: [Self; 4] = [Self::Avx512, Self::Avx2, Self::Neon, Self::Portable];

    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "AVX-512",
            Self::Avx2 => "AVX2",
            Self::Neon => "NEON",
            Self::Portable => "portable",
        }
    }
}

impl Bvh {
    /// Builds the tree in parallel; the result does not depend on the number of threads. `None` when the geometry has more
    /// primitives than the tree can number (2²⁹, or 2²⁶ leaf blocks).
    pub fn build(set: Arc<GeometrySet>) -> Option<Self> {
        Self::build_with(set, AccelOptions::default())
    }

    /// The same as `options` ask.
    pub fn build_with(set: Arc<GeometrySet>, options: AccelOptions) -> Option<Self> {
        let tree = |shapes: &[u32], placed: &[Bounds3]| build_tree(&set, shapes, placed, options.quality);
        let groups: Option<Vec<Tree>> = set.groups.iter().map(|g| tree(g, &[])).collect();
        let groups = groups?;
        let placed: Vec<Bounds3> = set.instances.iter().map(|i| i.bounds(&groups[i.group as usize].bounds)).collect();
        let top = tree(&set.top, &placed)?;
        let bvh = Self { set, top, groups, isa: Isa::detect(), options };
        debug_assert_eq!(bvh.validate(), Ok(()));
        Some(bvh)
    }

    /// Whether a scene of so many primitives is searched faster than by Embree: everything is tested in place of walking a tree,
    /// by wide enough vectors and with few shapes that need a test of their own (measured in `benches/RESULTS.md`).
    pub fn suits(triangles: u64, other_shapes: u64, instances: u64) -> bool {
        let wide = matches!(Isa::detect(), Isa::Avx512 | Isa::Avx2);
        wide && instances == 0 && other_shapes <= FEW_SHAPES && flat::fits(triangles, other_shapes)
    }

    /// The same tree searched with another instruction set; `None` when this processor does not have it.
    pub fn with_isa(self, isa: Isa) -> Option<Self> {
        isa.is_available().then_some(Self { isa, ..self })
    }

    fn group_of(&self, instance: u32) -> &Tree {
        &self.groups[self.set.instances[instance as usize].group as usize]
    }

    /// The nearest hit along `ray`.
    #[inline(always)]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        traverse::intersect(self, ray)
    }

    /// The nearest hits of `rays`, as many as there is room for in `hits`, bit for bit those of [`Bvh::intersect`].
    #[inline(always)]
    pub fn intersect_all<'a>(&self, rays: impl Iterator<Item = &'a Ray>, hits: &mut [Option<Hit>]) {
        #[cfg(target_arch = "x86_64")]
        if let (Some(flat), Isa::Avx512) = (&self.top.flat, self.isa) {
            return wave::intersect_all(self, flat, rays, hits);
        }
        for (ray, hit) in rays.zip(hits) {
            *hit = self.intersect(ray);
        }
    }

    /// True when anything lies on `ray`.
    #[inline(always)]
    pub fn occluded(&self, ray: &Ray) -> bool {
        traverse::occluded(self, ray)
    }

    /// Bytes held by the tree, without the geometry itself.
    pub fn memory(&self) -> usize {
        let tree = |t: &Tree| size_of_val(&t.nodes[..]) + size_of_val(&t.blocks[..]) + t.parts.memory();
        size_of::<Self>() + tree(&self.top) + self.groups.iter().map(tree).sum::<usize>()
    }

    /// Name and instruction set, for people.
    pub fn description(&self) -> String {
        format!("Rust BVH8, {}{}", self.isa.name(), self.options.description())
    }
}

fn build_tree(set: &GeometrySet, shapes: &[u32], instances: &[Bounds3], quality: Quality) -> Option<Tree> {
    let parts = Parts::new(set, shapes, instances.len());
    let (refs, bounds) = parts.refs(set, instances);
    wide::build(refs, bounds, parts, quality)
}
