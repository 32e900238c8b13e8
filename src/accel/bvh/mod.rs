//! The Rust back end: an 8-wide tree over triangles, analytic shapes and instances.
//!
//! Every query is watertight along shared edges. A ray with a coordinate that is not finite, a zero direction or a
//! `tmax` that is not positive hits nothing. Of several hits at the same `t` the lowest (shape, prim) wins, and geometry
//! that stands in the scene itself wins over instances.

mod binned;
mod parts;
#[cfg(test)]
mod tests;
mod traverse;
mod validate;
mod wide;

use std::sync::Arc;

use crate::geometry::{GeometrySet, Hit, Ray};
use crate::math::Bounds3;
use parts::Parts;
use wide::Tree;

/// The Rust tree over all geometry of a scene; two levels deep where there are instances.
#[derive(Debug)]
pub struct Bvh {
    set: Arc<GeometrySet>,
    top: Tree,
    groups: Vec<Tree>,
}

impl Bvh {
    /// Builds the tree in parallel; the result does not depend on the number of threads. `None` when the geometry has more
    /// primitives than the tree can number (2²⁹, or 2²⁶ leaf blocks).
    pub fn build(set: Arc<GeometrySet>) -> Option<Self> {
        let groups: Option<Vec<Tree>> = set.groups.iter().map(|g| build_tree(&set, g, &[])).collect();
        let groups = groups?;
        let placed: Vec<Bounds3> = set.instances.iter().map(|i| i.bounds(&groups[i.group as usize].bounds)).collect();
        let top = build_tree(&set, &set.top, &placed)?;
        let bvh = Self { set, top, groups };
        debug_assert_eq!(bvh.validate(), Ok(()));
        Some(bvh)
    }

    /// The nearest hit along `ray`.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        traverse::intersect(self, ray)
    }

    /// True when anything lies on `ray`.
    #[inline]
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
        "Rust BVH8".to_owned()
    }
}

fn build_tree(set: &GeometrySet, shapes: &[u32], instances: &[Bounds3]) -> Option<Tree> {
    let parts = Parts::new(set, shapes, instances.len());
    let mut refs = parts.refs(set, instances);
    let cost = binned::Cost { block: 1.0, width: wide::LANES, step: 0.5, max_leaf: wide::LANES * wide::MAX_BLOCKS };
    let nodes2 = binned::build(&mut refs, &cost);
    wide::collapse(&nodes2, &refs, parts)
}
