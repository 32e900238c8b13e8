use glam::Vec3;

use super::conductor::mirror;
use super::lobe::LobeSample;
use super::{BsdfSample, Fresnel, Ior, LobeMask, Mode};
use crate::color::Rgb;

/// A smooth interface between two dielectrics, the inside on −z.
#[derive(Clone, Copy, Debug)]
pub struct Dielectric {
    pub ior: Ior,
    pub reflectance: Rgb,
    pub transmittance: Rgb,
}

/// The factor of a refracted path: radiance is compressed by `1/η²`, power is not [Veach 1997, §5.2].
#[inline(always)]
pub(super) fn refraction_scale(eta: f32, mode: Mode) -> f32 {
    match mode {
        Mode::Radiance => 1.0 / (eta * eta),
        Mode::Importance => 1.0,
    }
}

/// Veach's factor for walks that start at a light [Veach 1997, eq. 5.19], 1 otherwise, by the cosines of each direction with
/// the shading and the geometric normal.
#[inline(always)]
pub(super) fn adjoint((wo_ns, wo_ng): (f32, f32), (wi_ns, wi_ng): (f32, f32), mode: Mode) -> f32 {
    match mode {
        Mode::Radiance => 1.0,
        Mode::Importance => (wo_ns * wi_ng / (wo_ng * wi_ns)).abs(),
    }
}

/// Share of samples that reflect, from Fresnel reflectance and the two tints.
#[inline(always)]
pub(super) fn reflect_probability(r: f32, reflectance: Rgb, transmittance: Rgb) -> f32 {
    let (a, b) = (r * reflectance.max_channel(), (1.0 - r) * transmittance.max_channel());
    if a + b > 0.0 { a / (a + b) } else { 0.0 }
}

impl Dielectric {
    /// Reflects or refracts at the shading normal `ns`, of either side, where the surface's own is `ng`. `None` where the two
    /// disagree about the side of a direction.
    ///
    /// Without branches, for loops that are to become vectors.
    #[inline(always)]
    pub fn sample(&self, ns: Vec3, ng: Vec3, wo: Vec3, u_lobe: f32, mode: Mode) -> Option<BsdfSample> {
        let cos = ns.dot(wo);
        let ior = self.ior.seen_from(cos);
        let Fresnel { r, g } = ior.fresnel(cos.abs());
        let p = reflect_probability(r, self.reflectance, self.transmittance);
        let reflects = u_lobe < p;
        let (tint, eta) = if reflects { (self.reflectance, 1.0) } else { (self.transmittance, ior.eta) };
        let (share, pdf) = if reflects { (r, p) } else { (1.0 - r, 1.0 - p) };
        // Refracted, `wi = (−wo + (c − g) n)/η` with `c − g = −(η²−1)/(c+g)`: straight on, bit for bit, between equal media.
        let bend = -ior.m / (cos + g.copysign(cos));
        let wi = if reflects { ns * (2.0 * cos) - wo } else { (ns * bend - wo) / ior.eta };
        let wi = wi.normalize();
        let scale = if reflects { 1.0 } else { refraction_scale(ior.eta, mode) };
        // Both normals must put each direction on the same side.
        let ng = if ns.dot(ng) < 0.0 { -ng } else { ng };
        let (cos_i, wo_ng, wi_ng) = (ns.dot(wi), ng.dot(wo), ng.dot(wi));
        let good = (cos * wo_ng > 0.0) & (cos_i * wi_ng > 0.0) & (share > 0.0) & (pdf > 0.0);
        let weight = tint * (share / pdf * scale) * adjoint((cos, wo_ng), (cos_i, wi_ng), mode);
        good.then_some(BsdfSample { wi, weight, pdf, lobe: LobeMask::DELTA, eta, transmit: !reflects })
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
