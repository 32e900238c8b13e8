//! Frames, transforms, bounds and rounding-error bounds, on top of glam.

mod bounds;
mod error;
mod frame;
mod transform;
mod trig;

pub use bounds::Bounds3;
pub use error::{gamma, offset_ray_origin};
pub use frame::Frame;
pub use glam::{DMat4, DVec2, DVec3, Vec2, Vec3};
pub use transform::Transform;
pub use trig::{atan2, floor, sin_cos_turns};

/// π⁻¹ as `f32`.
pub const INV_PI: f32 = std::f32::consts::FRAC_1_PI;

/// `1 − cos θ` from `sin θ` or `θ` without cancellation: `2 sin²(θ/2)`, θ in radians.
#[inline]
pub fn one_minus_cos(theta: f64) -> f64 {
    let s = (0.5 * theta).sin();
    2.0 * s * s
}

/// `a` where `mask` has all its bits set, `b` where it has none. Of `if` the compiler may make a choice of addresses, and no
/// vectors.
#[inline(always)]
pub fn choose(mask: u32, a: f32, b: f32) -> f32 {
    f32::from_bits(a.to_bits() & mask | b.to_bits() & !mask)
}

/// Square.
#[inline]
pub fn sqr(x: f32) -> f32 {
    x * x
}

/// `sqrt(max(x, 0))`: the root of a number that rounding may have made slightly negative.
#[inline(always)]
pub fn safe_sqrt(x: f32) -> f32 {
    x.max(0.0).sqrt()
}
