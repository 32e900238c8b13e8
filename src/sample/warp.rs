//! Maps from the unit square to other domains, each with its density.
//!
//! Directions are in a local frame whose pole is +z; densities are per steradian (`pdf_w`) or per unit area.

use std::f32::consts::{FRAC_PI_4, PI};

use glam::{Vec2, Vec3};

use crate::math::{INV_PI, atan2, safe_sqrt, sin_cos_turns};

/// Unit disc, concentric map [Shirley and Chiu 1997]; density 1/π.
#[inline(always)]
pub fn concentric_disk(u: Vec2) -> Vec2 {
    let o = 2.0 * u - Vec2::ONE;
    let wide = o.x.abs() > o.y.abs();
    let (r, other) = if wide { (o.x, o.y) } else { (o.y, o.x) };
    if r == 0.0 {
        return Vec2::ZERO;
    }
    let (sin, cos) = sin_cos_eighth(FRAC_PI_4 * (other / r));
    if wide { r * Vec2::new(cos, sin) } else { r * Vec2::new(sin, cos) }
}

/// The point that [`concentric_disk`] takes to `p`.
#[inline]
pub fn concentric_disk_inverse(p: Vec2) -> Vec2 {
    let wide = p.x.abs() > p.y.abs();
    let (long, short) = if wide { (p.x, p.y) } else { (p.y, p.x) };
    if long == 0.0 {
        return Vec2::splat(0.5);
    }
    let r = p.length().copysign(long);
    let other = r * (atan2(short * long.signum(), long.abs()) / FRAC_PI_4);
    let o = if wide { Vec2::new(r, other) } else { Vec2::new(other, r) };
    (0.5 * (o + Vec2::ONE)).clamp(Vec2::ZERO, Vec2::ONE)
}

/// Sine and cosine for |x| ≤ π/4 by their Taylor series, to 3·10⁻⁷ and 3·10⁻⁸.
#[inline(always)]
fn sin_cos_eighth(x: f32) -> (f32, f32) {
    let s = x * x;
    let sin = x * (1.0 + s * (-1.0 / 6.0 + s * (1.0 / 120.0 + s * (-1.0 / 5040.0))));
    let cos = 1.0 + s * (-0.5 + s * (1.0 / 24.0 + s * (-1.0 / 720.0 + s * (1.0 / 40320.0))));
    (sin, cos)
}

/// Cosine-weighted hemisphere.
#[inline(always)]
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = concentric_disk(u);
    d.extend(safe_sqrt(1.0 - d.length_squared()))
}

/// Density of [`cosine_hemisphere`], `cos θ / π`; 0 below the horizon.
#[inline(always)]
pub fn cosine_hemisphere_pdf(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * INV_PI
}

/// Uniform hemisphere; density 1/2π.
#[inline(always)]
pub fn uniform_hemisphere(u: Vec2) -> Vec3 {
    let z = u.x;
    let r = safe_sqrt(1.0 - z * z);
    (r * Vec2::from_angle(2.0 * PI * u.y)).extend(z)
}

/// Uniform sphere; density 1/4π.
#[inline(always)]
pub fn uniform_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let r = 2.0 * safe_sqrt(u.x * (1.0 - u.x));
    let (sin, cos) = sin_cos_turns(u.y);
    (r * Vec2::new(cos, sin)).extend(z)
}

/// The point that [`uniform_sphere`] takes to the unit vector `d`.
#[inline]
pub fn uniform_sphere_inverse(d: Vec3) -> Vec2 {
    let turns = atan2(d.y, d.x) * (0.5 / PI);
    Vec2::new(0.5 - 0.5 * d.z, if turns < 0.0 { turns + 1.0 } else { turns }).clamp(Vec2::ZERO, Vec2::ONE)
}

/// Uniform in a cone around +z given as `1 − cos θ_max`, stable for cones of any width.
#[inline(always)]
pub fn uniform_cone(u: Vec2, one_minus_cos_max: f32) -> Vec3 {
    let h = u.x * one_minus_cos_max; // 1 − cos θ
    let r = safe_sqrt(h * (2.0 - h));
    (r * Vec2::from_angle(2.0 * PI * u.y)).extend(1.0 - h)
}

/// Density of [`uniform_cone`].
#[inline(always)]
pub fn uniform_cone_pdf(one_minus_cos_max: f32) -> f32 {
    1.0 / (2.0 * PI * one_minus_cos_max)
}

/// Barycentric weights `(b1, b2)` of a uniform point in a triangle.
#[inline(always)]
pub fn uniform_triangle(u: Vec2) -> Vec2 {
    let s = (1.0 - u.x).sqrt();
    Vec2::new(1.0 - s, u.y * s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_series_are_good_to_rounding() {
        for i in -1000..=1000 {
            let x = i as f32 * (FRAC_PI_4 / 1000.0);
            let (sin, cos) = sin_cos_eighth(x);
            assert!(
                (sin as f64 - (x as f64).sin()).abs() < 4e-7 && (cos as f64 - (x as f64).cos()).abs() < 1.5e-7,
                "{x}"
            );
        }
    }

    #[test]
    fn inverse_maps_lead_back() {
        let n = 64;
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.3, (i / n) as f32 + 0.6) / n as f32;
            for back in [concentric_disk_inverse(concentric_disk(u)), uniform_sphere_inverse(uniform_sphere(u))] {
                assert!((back - u).abs().max_element() < 2e-6, "{u}: {back}");
            }
        }
        assert_eq!(concentric_disk_inverse(Vec2::ZERO), Vec2::splat(0.5));
        assert!(uniform_sphere_inverse(Vec3::Z).is_finite());
    }

    #[test]
    fn the_disc_map_keeps_areas() {
        // The share of a fine grid that lands in each quarter turn and inside r² < ½ is that of the disc.
        let n = 512;
        let (mut inside, mut quarter) = (0, 0);
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            let p = concentric_disk(u);
            assert!(p.length_squared() <= 1.0 + 1e-6);
            inside += i32::from(p.length_squared() < 0.5);
            quarter += i32::from(p.x > 0.0 && p.y > 0.0);
        }
        let total = (n * n) as f32;
        assert!((inside as f32 / total - 0.5).abs() < 2e-3 && (quarter as f32 / total - 0.25).abs() < 2e-3);
    }
}
