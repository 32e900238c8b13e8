//! Numbers everything a tree holds with one 32-bit id, and finds what an id stands for.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::binned::{Box8, PrimRef};
use crate::geometry::{GeometrySet, Shape, TriangleMesh};
use crate::math::Bounds3;
use crate::pages::Pages;

pub(super) const KIND_TRIANGLE: u32 = 0;
pub(super) const KIND_QUADRIC: u32 = 1;
pub(super) const KIND_INSTANCE: u32 = 2;

/// A run of ids: the triangles of a mesh, one analytic shape, or one instance.
#[derive(Clone, Debug)]
pub(super) struct Part {
    first: u32,
    /// Index of the shape or of the instance.
    pub index: u32,
    mesh: Option<Arc<TriangleMesh>>,
}

/// All runs, by increasing first id; ids increase with (shape, primitive), instances come last.
#[derive(Clone, Debug, Default)]
pub(super) struct Parts {
    parts: Vec<Part>,
    len: usize,
}

impl Parts {
    /// Numbers the shapes of one group and, at the top, the instances.
    pub fn new(set: &GeometrySet, shapes: &[u32], instances: usize) -> Self {
        let mut shapes = shapes.to_vec();
        shapes.sort_unstable();
        let mut p = Self::default();
        for index in shapes {
            let shape = &set.shapes[index as usize];
            let mesh = if let Shape::Mesh(m) = shape { Some(m.clone()) } else { None };
            p.parts.push(Part { first: p.len as u32, index, mesh });
            p.len += shape.primitives();
        }
        for index in 0..instances as u32 {
            p.parts.push(Part { first: p.len as u32, index, mesh: None });
            p.len += 1;
        }
        p
    }

    pub fn len(&self) -> usize {
        self.len
    }

    /// The part that an id belongs to, and the number within it.
    #[inline]
    pub fn find(&self, id: u32) -> (&Part, u32) {
        // Empty meshes share their first id with the next part; the last one with it is the owner.
        let part = match &self.parts[..] {
            [only] => only,
            parts => &parts[parts.partition_point(|p| p.first <= id) - 1],
        };
        (part, id - part.first)
    }

    /// The corners of a triangle.
    #[inline]
    pub fn triangle(&self, id: u32) -> [Vec3; 3] {
        let (part, prim) = self.find(id);
        part.mesh.as_ref().expect("triangle leaves hold ids of meshes").triangle(prim)
    }

    pub fn memory(&self) -> usize {
        size_of_val(&self.parts[..])
    }

    /// A box for every id and the box of all: boxes that are not finite are left out, as nothing in them can be hit.
    pub fn refs(&self, set: &GeometrySet, instance_bounds: &[Bounds3]) -> (Pages<PrimRef>, Box8) {
        const CHUNK: usize = 1 << 14;
        let shapes = self.parts.len() - instance_bounds.len();
        let mut refs = Pages::<PrimRef>::zeroed(self.len);
        let mut rest = &mut refs[..];
        let (mut union, mut all_finite) = (Box8::EMPTY, true);
        for (i, part) in self.parts.iter().enumerate() {
            let n = self.parts.get(i + 1).map_or(self.len, |p| p.first as usize) - part.first as usize;
            let (mine, tail) = rest.split_at_mut(n);
            rest = tail;
            if let Some(mesh) = &part.mesh {
                let boxes = |(chunk, refs): (usize, &mut [PrimRef])| {
                    let (mut union, mut all_finite) = (Box8::EMPTY, true);
                    for (i, r) in refs.iter_mut().enumerate() {
                        let prim = (chunk * CHUNK + i) as u32;
                        let [a, b, c] = mesh.triangle(prim);
                        // The minimum may hide a NaN, so ask the corners.
                        let good = a.is_finite() && b.is_finite() && c.is_finite();
                        let bounds = if good { Bounds3::new(a.min(b).min(c), a.max(b).max(c)) } else { Bounds3::EMPTY };
                        *r = PrimRef::new(bounds, part.first + prim, KIND_TRIANGLE);
                        union.grow(r.bounds());
                        all_finite &= good;
                    }
                    (union, all_finite)
                };
                let merge = |mut a: (Box8, bool), b: (Box8, bool)| {
                    a.0.grow(&b.0);
                    (a.0, a.1 & b.1)
                };
                let mesh = mine.par_chunks_mut(CHUNK).enumerate().map(boxes).reduce(|| (Box8::EMPTY, true), merge);
                (union, all_finite) = merge((union, all_finite), mesh);
            } else {
                let (bounds, kind) = match i.checked_sub(shapes) {
                    Some(instance) => (instance_bounds[instance], KIND_INSTANCE),
                    None => (set.shape_bounds(part.index), KIND_QUADRIC),
                };
                let good = bounds.min.is_finite() && bounds.max.is_finite();
                mine[0] = PrimRef::new(if good { bounds } else { Bounds3::EMPTY }, part.first, kind);
                union.grow(mine[0].bounds());
                all_finite &= good;
            }
        }
        // Close the gaps that undefined boxes leave.
        if !all_finite {
            let mut kept = 0;
            for i in 0..refs.len() {
                if refs[i].bounds().bounds().min.is_finite() {
                    refs[kept] = refs[i];
                    kept += 1;
                }
            }
            refs.truncate(kept);
        }
        (refs, union)
    }
}
