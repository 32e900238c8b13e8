use glam::{Vec2, Vec3};

use super::lobe::LobeSample;
use super::{BsdfSample, LobeMask, Mode};
use crate::color::Rgb;
use crate::math::{Frame, INV_PI};
use crate::sample::warp;

/// The Lambertian lobe, in the frame of a blend.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lambert {
    pub reflectance: Rgb,
}

impl Lambert {
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.reflectance * Self::pdf(wo, wi)
    }

    #[inline]
    pub fn pdf(wo: Vec3, wi: Vec3) -> f32 {
        if wo.z > 0.0 { warp::cosine_hemisphere_pdf(wi.z) } else { 0.0 }
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        let wi = warp::cosine_hemisphere(u);
        let pdf = Self::pdf(wo, wi);
        (pdf > 0.0).then(|| LobeSample::reflection(wi, self.reflectance, pdf))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.reflectance } else { Rgb::BLACK }
    }
}

/// A surface that is Lambertian and nothing else, in world space: the case that most hits are, kept short.
///
/// Both normals are turned to the side that reflects.
#[derive(Clone, Copy, Debug)]
pub struct DiffuseBsdf {
    pub(super) ns: Vec3,
    pub(super) ng: Vec3,
    pub(super) reflectance: Rgb,
}

impl DiffuseBsdf {
    /// Both normals are on the side that reflects.
    #[inline(always)]
    pub fn new(ns: Vec3, ng: Vec3, reflectance: Rgb) -> Self {
        Self { ns, ng, reflectance }
    }

    /// The shading normal on the side that reflects.
    #[inline(always)]
    pub fn ns(&self) -> Vec3 {
        self.ns
    }

    /// The geometric normal on the side that reflects.
    #[inline(always)]
    pub fn ng(&self) -> Vec3 {
        self.ng
    }

    /// Share of the light that is reflected, by channel.
    #[inline(always)]
    pub fn reflectance(&self) -> Rgb {
        self.reflectance
    }

    /// Cosine of `wi` if both directions are above both normals, else 0.
    #[inline(always)]
    fn cosine(&self, wo: Vec3, wi: Vec3) -> f32 {
        let above = self.ns.dot(wo) > 0.0 && self.ng.dot(wo) > 0.0 && self.ng.dot(wi) > 0.0;
        if above { self.ns.dot(wi).max(0.0) } else { 0.0 }
    }

    /// Veach's factor for walks that start at a light [Veach 1997, eq. 5.19], 1 otherwise.
    #[inline(always)]
    fn adjoint(&self, wo: Vec3, wi: Vec3, cos_i: f32, mode: Mode) -> f32 {
        match mode {
            Mode::Radiance => 1.0,
            Mode::Importance => self.ns.dot(wo) * self.ng.dot(wi) / (self.ng.dot(wo) * cos_i),
        }
    }

    #[inline(always)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode) -> Rgb {
        let cos = self.cosine(wo, wi);
        if cos > 0.0 { self.reflectance * (cos * INV_PI * self.adjoint(wo, wi, cos, mode)) } else { Rgb::BLACK }
    }

    #[inline(always)]
    pub(super) fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.cosine(wo, wi) * INV_PI
    }

    /// As [`Bsdf::sample`](super::Bsdf::sample).
    #[inline(always)]
    pub fn sample(&self, wo: Vec3, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        let wi = Frame::from_normal(self.ns).to_world(warp::cosine_hemisphere(u));
        let cos = self.cosine(wo, wi);
        (cos > 0.0).then(|| BsdfSample {
            wi,
            weight: self.reflectance * self.adjoint(wo, wi, cos, mode),
            pdf: cos * INV_PI,
            lobe: LobeMask::DIFFUSE,
            eta: 1.0,
            transmit: false,
        })
    }

    /// The albedo where shading and geometric normal are one.
    #[inline(always)]
    pub(super) fn flat_albedo(&self) -> Option<Rgb> {
        (self.ns == self.ng).then_some(self.reflectance)
    }

    /// The albedo and the normal of the side that reflects, where `wo` is above both normals.
    #[inline(always)]
    pub(super) fn seen_from(&self, wo: Vec3) -> Option<(Rgb, Vec3)> {
        (self.ns.dot(wo) > 0.0 && self.ng.dot(wo) > 0.0).then_some((self.reflectance, self.ns))
    }

    #[inline(always)]
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        if self.ns.dot(wo) > 0.0 && self.ng.dot(wo) > 0.0 { self.reflectance } else { Rgb::BLACK }
    }
}
