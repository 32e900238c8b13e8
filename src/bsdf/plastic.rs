use glam::{Vec2, Vec3};

use super::Ior;
use super::conductor::mirror;
use super::diffuse::Lambert;
use super::lobe::LobeSample;
use crate::color::Rgb;
use crate::sample::warp;

/// The smooth coat of a plastic: what the interface reflects.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlasticCoat {
    pub ior: Ior,
    pub tint: Rgb,
}

impl PlasticCoat {
    #[inline]
    pub fn sample(&self, wo: Vec3) -> Option<LobeSample> {
        (wo.z > 0.0).then(|| LobeSample::reflection(mirror(wo), self.albedo(wo), 1.0))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.tint * self.ior.fresnel(wo.z).r } else { Rgb::BLACK }
    }
}

/// The diffuse base under the coat: light that enters, is scattered (and reflected back inside) any number of times and
/// leaves: `ρ (1−R(θo)) (1−R(θi)) / (π η² (1 − ρ' R_int))`, where `ρ'` is `ρ` when colours saturate ("nonlinear"), else 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlasticBase {
    pub ior: Ior,
    /// `ρ / (η² (1 − ρ' R_int))`.
    pub strength: Rgb,
    /// `1 − R_ext`, the hemispherical transmittance from outside.
    pub t_ext: f32,
}

impl PlasticBase {
    /// `ρ / (η² (1 − ρ' R_int))` for each channel.
    pub fn strength(reflectance: Rgb, ior: Ior, r_int: f32, nonlinear: bool) -> Rgb {
        let scale = 1.0 / (ior.eta * ior.eta);
        reflectance.map(|rho| scale * rho / (1.0 - r_int * if nonlinear { rho } else { 1.0 }))
    }

    #[inline]
    fn transmittance(&self, w: Vec3) -> f32 {
        1.0 - self.ior.fresnel(w.z).r
    }

    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let pdf = Lambert::pdf(wo, wi);
        if pdf > 0.0 { self.strength * (self.transmittance(wo) * self.transmittance(wi) * pdf) } else { Rgb::BLACK }
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        let wi = warp::cosine_hemisphere(u);
        let pdf = Lambert::pdf(wo, wi);
        (pdf > 0.0).then(|| {
            let weight = self.strength * (self.transmittance(wo) * self.transmittance(wi));
            LobeSample::reflection(wi, weight, pdf)
        })
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.strength * (self.transmittance(wo) * self.t_ext) } else { Rgb::BLACK }
    }
}
