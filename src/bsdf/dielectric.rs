use glam::Vec3;

use super::conductor::mirror;
use super::lobe::LobeSample;
use super::{Ior, Mode};
use crate::color::Rgb;

/// A smooth interface between two dielectrics, the inside on −z.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dielectric {
    pub ior: Ior,
    pub reflectance: Rgb,
    pub transmittance: Rgb,
}

/// Refraction of `wo` about +z (on either side of it), given `g` from [`Ior::fresnel`] on the side of `wo`.
///
/// `wi = (−wo + (c − g) n)/η` with `c − g = −(η²−1)/(c+g)`: straight on, bit for bit, between equal media.
#[inline]
pub(super) fn refract(wo: Vec3, ior: Ior, g: f32) -> Vec3 {
    let bend = -ior.m / (wo.z + g.copysign(wo.z));
    (Vec3::new(0.0, 0.0, bend) - wo) / ior.eta
}

/// The factor of a refracted path: radiance is compressed by `1/η²`, power is not [Veach 1997, §5.2].
#[inline]
pub(super) fn refraction_scale(eta: f32, mode: Mode) -> f32 {
    match mode {
        Mode::Radiance => 1.0 / (eta * eta),
        Mode::Importance => 1.0,
    }
}

/// Share of samples that reflect, from Fresnel reflectance and the two tints.
#[inline]
pub(super) fn reflect_probability(r: f32, reflectance: Rgb, transmittance: Rgb) -> f32 {
    let (a, b) = (r * reflectance.max_channel(), (1.0 - r) * transmittance.max_channel());
    if a + b > 0.0 { a / (a + b) } else { 0.0 }
}

impl Dielectric {
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, mode: Mode) -> Option<LobeSample> {
        if wo.z == 0.0 {
            return None;
        }
        let ior = self.ior.seen_from(wo.z);
        let fresnel = ior.fresnel(wo.z.abs());
        let p = reflect_probability(fresnel.r, self.reflectance, self.transmittance);
        if u_lobe < p {
            return Some(LobeSample::reflection(mirror(wo), self.reflectance * (fresnel.r / p), p));
        }
        let (t, q) = (1.0 - fresnel.r, 1.0 - p);
        if t <= 0.0 || q <= 0.0 {
            return None;
        }
        let weight = self.transmittance * (t / q * refraction_scale(ior.eta, mode));
        Some(LobeSample { wi: refract(wo, ior, fresnel.g), weight, pdf: q, eta: ior.eta, transmit: true })
    }

    /// Probability with which [`sample`](Self::sample) reflects or transmits.
    pub fn discrete_pdf(&self, wo: Vec3, transmit: bool) -> f32 {
        let fresnel = self.ior.seen_from(wo.z).fresnel(wo.z.abs());
        let p = reflect_probability(fresnel.r, self.reflectance, self.transmittance);
        if transmit { 1.0 - p } else { p }
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        let r = self.ior.seen_from(wo.z).fresnel(wo.z.abs()).r;
        self.reflectance * r + self.transmittance * (1.0 - r)
    }
}

/// Reflectance of a thin plate, all internal bounces summed: `2R/(1+R)`.
#[inline]
fn thin_reflectance(ior: Ior, c: f32) -> f32 {
    let r = ior.fresnel(c).r;
    2.0 * r / (1.0 + r)
}

/// What a thin plate reflects.
#[derive(Clone, Copy, Debug)]
pub(super) struct ThinReflection {
    pub ior: Ior,
    pub tint: Rgb,
}

impl ThinReflection {
    #[inline]
    pub fn sample(&self, wo: Vec3) -> Option<LobeSample> {
        (wo.z != 0.0).then(|| LobeSample::reflection(mirror(wo), self.albedo(wo), 1.0))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        self.tint * thin_reflectance(self.ior, wo.z.abs())
    }
}

/// What a thin plate lets straight through.
#[derive(Clone, Copy, Debug)]
pub(super) struct ThinTransmission {
    pub ior: Ior,
    pub tint: Rgb,
}

impl ThinTransmission {
    #[inline]
    pub fn sample(&self, wo: Vec3) -> Option<LobeSample> {
        Some(LobeSample { wi: -wo, weight: self.albedo(wo), pdf: 1.0, eta: 1.0, transmit: true })
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        self.tint * (1.0 - thin_reflectance(self.ior, wo.z.abs()))
    }
}
