//! Maps from the unit square to other domains, each with its density.
//!
//! Directions are in a local frame whose pole is +z; densities are per steradian (`pdf_w`) or per unit area.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use glam::{Vec2, Vec3};

use crate::math::{INV_PI, safe_sqrt};

/// Unit disc, concentric map [Shirley and Chiu 1997]; density 1/π.
#[inline]
pub fn concentric_disk(u: Vec2) -> Vec2 {
    let o = 2.0 * u - Vec2::ONE;
    if o == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let (r, theta) =
        if o.x.abs() > o.y.abs() { (o.x, FRAC_PI_4 * (o.y / o.x)) } else { (o.y, FRAC_PI_2 - FRAC_PI_4 * (o.x / o.y)) };
    r * Vec2::from_angle(theta)
}

/// Cosine-weighted hemisphere.
#[inline]
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = concentric_disk(u);
    d.extend(safe_sqrt(1.0 - d.length_squared()))
}

/// Density of [`cosine_hemisphere`], `cos θ / π`; 0 below the horizon.
#[inline]
pub fn cosine_hemisphere_pdf(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * INV_PI
}

/// Uniform hemisphere; density 1/2π.
#[inline]
pub fn uniform_hemisphere(u: Vec2) -> Vec3 {
    let z = u.x;
    let r = safe_sqrt(1.0 - z * z);
    (r * Vec2::from_angle(2.0 * PI * u.y)).extend(z)
}

/// Uniform sphere; density 1/4π.
#[inline]
pub fn uniform_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let r = 2.0 * safe_sqrt(u.x * (1.0 - u.x));
    (r * Vec2::from_angle(2.0 * PI * u.y)).extend(z)
}

/// Uniform in a cone around +z given as `1 − cos θ_max`, stable for cones of any width.
#[inline]
pub fn uniform_cone(u: Vec2, one_minus_cos_max: f32) -> Vec3 {
    let h = u.x * one_minus_cos_max; // 1 − cos θ
    let r = safe_sqrt(h * (2.0 - h));
    (r * Vec2::from_angle(2.0 * PI * u.y)).extend(1.0 - h)
}

/// Density of [`uniform_cone`].
#[inline]
pub fn uniform_cone_pdf(one_minus_cos_max: f32) -> f32 {
    1.0 / (2.0 * PI * one_minus_cos_max)
}

/// Barycentric weights `(b1, b2)` of a uniform point in a triangle.
#[inline]
pub fn uniform_triangle(u: Vec2) -> Vec2 {
    let s = (1.0 - u.x).sqrt();
    Vec2::new(1.0 - s, u.y * s)
}
