use glam::{Vec2, Vec3};

use super::conductor::mirror;
use super::lobe::LobeSample;
use crate::color::Rgb;
use crate::math::{Frame, INV_PI, safe_sqrt};

/// The modified Phong lobe `(n+2)/(2π) cosⁿα` [Lafortune and Willems 1994]: reciprocal, albedo at most the tint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Phong {
    pub exponent: f32,
    pub tint: Rgb,
}

/// Roughness of a microfacet lobe about as wide as one of this exponent; never that of a mirror.
pub(super) fn roughness(exponent: f32) -> f32 {
    (2.0 / (exponent.max(0.0) + 2.0)).sqrt().max(super::DELTA_ALPHA)
}

impl Phong {
    /// `cosⁿα` between `wi` and the mirror direction of `wo`.
    #[inline]
    fn lobe(&self, wo: Vec3, wi: Vec3) -> f32 {
        let c = mirror(wo).dot(wi).min(1.0);
        if wo.z > 0.0 && wi.z > 0.0 && c > 0.0 { c.powf(self.exponent) } else { 0.0 }
    }

    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.tint * (0.5 * INV_PI * (self.exponent + 2.0) * self.lobe(wo, wi) * wi.z)
    }

    /// [`eval`](Self::eval) where the density is `pdf`.
    #[inline]
    pub fn eval_where(&self, pdf: f32, wi: Vec3) -> Rgb {
        self.tint * ((self.exponent + 2.0) / (self.exponent + 1.0) * pdf * wi.z)
    }

    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        0.5 * INV_PI * (self.exponent + 1.0) * self.lobe(wo, wi)
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let c = (1.0 - u.y).powf(1.0 / (self.exponent + 1.0));
        let local = (safe_sqrt((1.0 - c) * (1.0 + c)) * Vec2::from_angle(std::f32::consts::TAU * u.x)).extend(c);
        let wi = Frame::from_normal(mirror(wo)).to_world(local);
        let weight = self.tint * ((self.exponent + 2.0) / (self.exponent + 1.0) * wi.z);
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| LobeSample::reflection(wi, weight, pdf))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.tint } else { Rgb::BLACK }
    }
}
