use glam::Vec3;

use super::Interior;

/// A half-open segment `o + t·d`, `0 < t < tmax`. `d` need not be a unit vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    pub o: Vec3,
    pub d: Vec3,
    pub tmax: f32,
    /// What was travelled before `o`, through interfaces that are none, in units of `t`.
    pub passed: f32,
    /// The media that `o` lies in, those with priorities.
    pub inside: Interior,
}

impl Ray {
    #[inline]
    pub fn new(o: Vec3, d: Vec3) -> Self {
        Self::segment(o, d, f32::INFINITY)
    }

    #[inline]
    pub fn segment(o: Vec3, d: Vec3, tmax: f32) -> Self {
        Self { o, d, tmax, passed: 0.0, inside: Interior::NONE }
    }

    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.o + t * self.d
    }
}

/// [`Hit::instance`] of geometry that is not instanced.
pub const NO_INSTANCE: u32 = u32::MAX;

/// What a ray query returns: ids and parameters, nothing that needs memory to find.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter.
    pub t: f32,
    /// Barycentric weights of the triangle's second and third vertex; unused for analytic shapes.
    pub u: f32,
    pub v: f32,
    /// Index into [`GeometrySet::shapes`](super::GeometrySet::shapes).
    pub shape: u32,
    /// Triangle of the mesh; 0 for analytic shapes.
    pub prim: u32,
    /// Index into [`GeometrySet::instances`](super::GeometrySet::instances), or [`NO_INSTANCE`].
    pub instance: u32,
}
