//! Ray queries on a [`GeometrySet`]: one enum over the back ends, chosen when a scene is loaded.
//!
//! All back ends answer the same question the same way: the nearest hit with `0 < t < tmax`, ids as in
//! [`Hit`], no culling of back faces. The Rust BVH is watertight along shared edges; through Embree a ray aimed exactly
//! at a vertex slips through with a probability of 10⁻³. Only this room knows whether Embree is there.

mod bvh;
#[cfg(embree)]
mod embree;

use std::sync::Arc;

pub use bvh::{Bvh, Isa, Task, run};
#[cfg(embree)]
pub use embree::EmbreeAccel;

use crate::geometry::{GeometrySet, Hit, Ray, Shape};

/// True when this build can use Embree.
pub fn embree_available() -> bool {
    cfg!(embree)
}

/// Which back end to build.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AccelKind {
    /// Embree when it is built in and works on this machine, else the Rust BVH; that one also where a scene is so small that it
    /// [has no tree to walk](Bvh::suits).
    #[default]
    Auto,
    Embree,
    Bvh,
}

/// How much time a build may take for the sake of the queries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// Embree: LOW. Rust BVH: planes on one axis only.
    Fast,
    /// Embree: MEDIUM. Rust BVH: binned SAH.
    #[default]
    Default,
    /// Embree: HIGH, whose trees may differ from run to run, and with them which of two hits at the same distance is found.
    /// Rust BVH: more bins, and boxes of large triangles are cut.
    High,
}

/// How triangles are tested.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Watertight along shared edges.
    #[default]
    Robust,
    /// In f32 throughout; rays at edges may slip through, and distances are less exact. The Rust BVH tests groups of up to 48
    /// triangles, which have no tree, as in the other mode.
    Fast,
}

impl AccelOptions {
    /// What is not as usual, for people; begins with a comma where there is anything.
    fn description(&self) -> String {
        let quality = match self.quality {
            Quality::Fast => ", built fast",
            Quality::Default => "",
            Quality::High => ", built with care",
        };
        let mode = if self.mode == Mode::Fast { ", fast mode" } else { "" };
        format!("{quality}{mode}")
    }
}

/// How a back end builds its tree and searches it. Neither changes what a picture converges to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AccelOptions {
    pub quality: Quality,
    pub mode: Mode,
}

/// Why a back end could not be built.
#[derive(Debug, thiserror::Error)]
pub enum AccelError {
    #[error(
        "this build has no Embree: install the packages libembree-dev and libclang-dev and build again, or use --accel bvh"
    )]
    NotBuiltIn,
    #[error("Embree: {0}")]
    Embree(String),
    #[error("the scene has more primitives than the Rust BVH can number (2^29); place copies as instances")]
    TooLarge,
}

/// A built acceleration structure; immutable, shared by all threads.
pub enum Accel {
    #[cfg(embree)]
    Embree(EmbreeAccel),
    Bvh(Bvh),
}

impl Accel {
    /// Builds the back end `kind` over `set`.
    pub fn build(kind: AccelKind, set: Arc<GeometrySet>) -> Result<Accel, AccelError> {
        Self::build_with(kind, AccelOptions::default(), set)
    }

    /// Builds the back end `kind` over `set` as `options` ask.
    pub fn build_with(kind: AccelKind, options: AccelOptions, set: Arc<GeometrySet>) -> Result<Accel, AccelError> {
        match kind {
            AccelKind::Auto if Self::auto_is_bvh(&set) => Self::bvh(options, set),
            AccelKind::Auto => Self::embree(options, &set).or_else(|_| Self::bvh(options, set)),
            AccelKind::Embree => Self::embree(options, &set),
            AccelKind::Bvh => Self::bvh(options, set),
        }
    }

    fn auto_is_bvh(set: &GeometrySet) -> bool {
        let shapes = set.top.iter().map(|&i| &set.shapes[i as usize]);
        let (triangles, others) = shapes.fold((0, 0), |(triangles, others), shape| match shape {
            Shape::Mesh(_) => (triangles + shape.primitives() as u64, others),
            _ => (triangles, others + 1),
        });
        Bvh::suits(triangles, others, set.instances.len() as u64)
    }

    fn bvh(options: AccelOptions, set: Arc<GeometrySet>) -> Result<Accel, AccelError> {
        Bvh::build_with(set, options).map(Accel::Bvh).ok_or(AccelError::TooLarge)
    }

    #[cfg(embree)]
    fn embree(options: AccelOptions, set: &Arc<GeometrySet>) -> Result<Accel, AccelError> {
        EmbreeAccel::build(set.clone(), options).map(Accel::Embree)
    }

    #[cfg(not(embree))]
    fn embree(_: AccelOptions, _: &Arc<GeometrySet>) -> Result<Accel, AccelError> {
        Err(AccelError::NotBuiltIn)
    }

    /// The nearest hit along `ray`.
    #[inline(always)]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        match self {
            #[cfg(embree)]
            Accel::Embree(a) => a.intersect(ray),
            Accel::Bvh(a) => a.intersect(ray),
        }
    }

    /// The nearest hits of `rays`, as many as there is room for in `hits`: those of [`Accel::intersect`], found together.
    /// What is in `hits` beyond the last ray stays.
    #[inline(always)]
    pub fn intersect_all<'a>(&self, rays: impl Iterator<Item = &'a Ray>, hits: &mut [Option<Hit>]) {
        match self {
            #[cfg(embree)]
            Accel::Embree(a) => a.intersect_all(rays, hits),
            Accel::Bvh(a) => a.intersect_all(rays, hits),
        }
    }

    /// True when anything lies on `ray`.
    #[inline(always)]
    pub fn occluded(&self, ray: &Ray) -> bool {
        match self {
            #[cfg(embree)]
            Accel::Embree(a) => a.occluded(ray),
            Accel::Bvh(a) => a.occluded(ray),
        }
    }

    /// Bytes held by the acceleration structure, without the geometry itself.
    pub fn memory(&self) -> usize {
        match self {
            #[cfg(embree)]
            Accel::Embree(a) => a.memory(),
            Accel::Bvh(a) => a.memory(),
        }
    }

    /// `embree` or `bvh`.
    pub fn name(&self) -> &'static str {
        match self {
            #[cfg(embree)]
            Accel::Embree(_) => "embree",
            Accel::Bvh(_) => "bvh",
        }
    }

    /// Name, version and instruction set for people, for example `Embree 3.13.5, AVX-512`.
    pub fn description(&self) -> String {
        match self {
            #[cfg(embree)]
            Accel::Embree(a) => a.description(),
            Accel::Bvh(a) => a.description(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Instance, Sphere, TriangleMesh};
    use crate::math::{Transform, Vec3};

    /// So many triangles and spheres, and a placed copy of them all if there is to be one.
    fn scene(triangles: u32, spheres: u32, placed: bool) -> Arc<GeometrySet> {
        let corner = |i: u32| Vec3::new((i / 3) as f32, (i % 3) as f32, (i % 2) as f32);
        let positions: Vec<Vec3> = (0..3 * triangles).map(corner).collect();
        let indices = (0..triangles).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mut shapes =
            vec![Shape::Mesh(Arc::new(TriangleMesh { positions: positions.into(), indices, ..Default::default() }))];
        let sphere = |i: u32| Sphere {
            center: Vec3::splat(3.0 + i as f32),
            radius: 1.0,
            flip_normals: false,
            uv: false,
            to_world: Transform::IDENTITY,
        };
        shapes.extend((0..spheres).map(|i| Shape::Sphere(sphere(i))));
        let top: Vec<u32> = (0..shapes.len() as u32).collect();
        let groups = if placed { vec![top.clone()] } else { Vec::new() };
        let instances = groups.iter().map(|_| Instance { group: 0, to_world: Transform::IDENTITY }).collect();
        Arc::new(GeometrySet { shapes, top, groups, instances })
    }

    /// The Rust BVH takes scenes without a tree where it has vectors, Embree all others; whoever names one gets it.
    #[test]
    fn small_scenes_take_the_rust_bvh() {
        let name = |kind, set: &Arc<GeometrySet>| Accel::build(kind, set.clone()).expect("a small scene").name();
        let wide = matches!(Isa::detect(), Isa::Avx512 | Isa::Avx2);
        let large = if embree_available() { "embree" } else { "bvh" };
        let small = if wide { "bvh" } else { large };
        for (triangles, spheres, placed, expected) in [
            (2, 0, false, small),
            (48, 2, false, small),
            (0, 1, false, small),
            (49, 0, false, large),
            (2, 3, false, large),
            (2, 0, true, large),
            (0, 0, false, large),
        ] {
            let set = scene(triangles, spheres, placed);
            assert_eq!(name(AccelKind::Auto, &set), expected, "{triangles} {spheres} {placed}");
            assert_eq!(name(AccelKind::Bvh, &set), "bvh");
            if embree_available() {
                assert_eq!(name(AccelKind::Embree, &set), "embree");
            }
        }
    }
}
