//! Rays, triangle meshes, analytic shapes, hits and what is known about the point that was hit.

pub mod generate;
mod interior;
pub mod lathe;
mod mesh;
mod outlook;
mod quadric;
mod ray;
mod set;
mod shape;
#[cfg(test)]
mod tests;
mod triangle;

pub use interior::Interior;
pub use mesh::{PaddedVec3s, TriangleMesh, VertexAttribute};
pub use outlook::{Outlook, corners};
pub use ray::{Hit, NO_INSTANCE, Ray};
pub use set::{GeometrySet, Instance, SurfaceInteraction};
pub use shape::{Cylinder, Disk, Shape, Sphere};
pub use triangle::{
    PreciseRay, RETEST, ShearedRay, intersect_triangle, is_traceable, quick_normal, triangle_normal,
    triangle_point_error, unit_or,
};
