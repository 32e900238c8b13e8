use glam::{Vec2, Vec3};

use super::Shape;
use crate::math::Transform;

/// A placed copy of a group of shapes.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Index into [`GeometrySet::groups`].
    pub group: u32,
    pub to_world: Transform,
}

/// All geometry of a scene. Indices are stable and are what [`Hit`](super::Hit) refers to.
#[derive(Clone, Debug, Default)]
pub struct GeometrySet {
    pub shapes: Vec<Shape>,
    /// Shapes that stand in the scene as they are.
    pub top: Vec<u32>,
    /// Shapes that exist only through instances.
    pub groups: Vec<Vec<u32>>,
    pub instances: Vec<Instance>,
}

/// The point that a ray hit.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    pub p: Vec3,
    /// Bound on the absolute rounding error of each coordinate of `p`.
    pub p_err: Vec3,
    /// Geometric unit normal, on the side that the shape calls outside.
    pub ng: Vec3,
    /// Shading unit normal, in the hemisphere of `ng`.
    pub ns: Vec3,
    pub uv: Vec2,
    /// ∂p/∂u and ∂p/∂v; perpendicular fallbacks where the parametrisation degenerates.
    pub dpdu: Vec3,
    pub dpdv: Vec3,
    /// Back along the ray, a unit vector.
    pub wo: Vec3,
    /// Ray parameter.
    pub t: f32,
    pub shape: u32,
    pub prim: u32,
    pub instance: u32,
    /// Barycentric weights of the second and third vertex, for mesh attributes.
    pub barycentric: Vec2,
}

impl SurfaceInteraction {
    /// An origin for a ray that leaves along `w`, safely on that side of the surface.
    #[inline]
    pub fn spawn_origin(&self, w: Vec3) -> Vec3 {
        crate::math::offset_ray_origin(self.p, self.p_err, self.ng, w)
    }
}
