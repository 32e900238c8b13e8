use std::sync::Arc;

use glam::Vec3;

use super::TriangleMesh;
use crate::math::Transform;

/// An exact sphere. Its outside is where normals point unless `flip_normals`.
#[derive(Clone, Copy, Debug)]
pub struct Sphere {
    pub center: Vec3,
    pub radius: f32,
    pub flip_normals: bool,
    /// Orientation of the (θ, φ) parametrisation: local unit sphere to scene space.
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
