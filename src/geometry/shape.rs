use std::sync::Arc;

use glam::Vec3;

use super::{Ray, TriangleMesh};
use crate::math::{Bounds3, Transform};

/// An exact sphere. Its outside is where normals point unless `flip_normals`.
#[derive(Clone, Copy, Debug)]
pub struct Sphere {
    pub center: Vec3,
    pub radius: f32,
    pub flip_normals: bool,
    /// Whether hits carry the (θ, φ) parametrisation; otherwise their texture coordinates are 0 and their tangents any.
    pub uv: bool,
    /// Orientation of the parametrisation: local unit sphere to scene space.
    pub to_world: Transform,
}

/// The unit disc in the local xy plane, normal +z, under an affine map.
#[derive(Clone, Copy, Debug)]
pub struct Disk {
    pub to_world: Transform,
    pub flip_normals: bool,
}

/// The lateral surface `x² + y² = 1, 0 ≤ z ≤ 1` of the local cylinder under a map that keeps its cross-section a circle.
#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    pub to_world: Transform,
    /// Radius and length in scene space.
    pub radius: f32,
    pub length: f32,
    pub flip_normals: bool,
}

/// The closed set of things a ray can hit.
#[derive(Clone, Debug)]
pub enum Shape {
    Mesh(Arc<TriangleMesh>),
    Sphere(Sphere),
    Disk(Disk),
    Cylinder(Cylinder),
}

impl Shape {
    /// The smallest box around the shape; empty for a mesh without vertices.
    pub fn bounds(&self) -> Bounds3 {
        match self {
            Shape::Mesh(m) => m.bounds(),
            Shape::Sphere(s) => s.bounds(),
            Shape::Disk(s) => s.bounds(),
            Shape::Cylinder(s) => s.bounds(),
        }
    }

    /// Smallest ray parameter in `(0, tmax)` where an analytic shape is hit; `None` for meshes, whose triangles a tree holds.
    #[inline(always)]
    pub fn intersect_quadric(&self, ray: &Ray) -> Option<f32> {
        match self {
            Shape::Mesh(_) => None,
            Shape::Sphere(s) => s.intersect(ray),
            Shape::Disk(s) => s.intersect(ray),
            Shape::Cylinder(s) => s.intersect(ray),
        }
    }

    /// Surface area in the square of the scene's unit.
    pub fn area(&self) -> f64 {
        match self {
            Shape::Mesh(m) => m.area(),
            Shape::Sphere(s) => s.area(),
            Shape::Disk(s) => s.area(),
            Shape::Cylinder(s) => s.area(),
        }
    }

    /// Number of primitives: triangles of a mesh, 1 for an analytic shape.
    pub fn primitives(&self) -> usize {
        match self {
            Shape::Mesh(m) => m.indices.len(),
            _ => 1,
        }
    }
}
