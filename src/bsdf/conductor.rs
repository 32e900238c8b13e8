use glam::{Vec2, Vec3};

use super::dielectric::adjoint;
use super::fresnel::fresnel_conductor;
use super::microfacet::{Distribution, Microfacet};
use super::rough::{reflect, reflection_pdf};
use super::{BsdfSample, LobeMask, Mode};
use crate::color::Rgb;
use crate::math::Frame;

/// Mirror reflection about +z.
#[inline]
pub(super) fn mirror(w: Vec3) -> Vec3 {
    Vec3::new(-w.x, -w.y, w.z)
}

/// A smooth conductor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mirror {
    pub eta: Rgb,
    pub k: Rgb,
    pub specular: Rgb,
}

impl Mirror {
    #[inline(always)]
    pub fn metal(&self) -> Metal {
        Metal { alpha: 0.0, eta: self.eta, k: self.k, specular: self.specular }
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.specular * fresnel_conductor(wo.z, self.eta, self.k) } else { Rgb::BLACK }
    }
}

/// A conductor that is the same everywhere and in all directions: smooth, or rough with facets by GGX.
#[derive(Clone, Copy, Debug)]
pub struct Metal {
    /// Roughness; 0 if smooth.
    pub alpha: f32,
    pub eta: Rgb,
    pub k: Rgb,
    pub specular: Rgb,
}

impl Metal {
    /// The class of its lobe.
    #[inline(always)]
    pub fn class(&self) -> LobeMask {
        LobeMask::of_roughness(self.alpha)
    }

    /// Reflects at the shading normal `ns` on the side that reflects, where the surface's own is `ng`, of either side. `None`
    /// below the surface, and where the two disagree about the side of a direction.
    ///
    /// Without branches, for loops that are to become vectors.
    #[inline(always)]
    pub fn sample(&self, ns: Vec3, ng: Vec3, wo: Vec3, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        let frame = Frame::from_normal(ns);
        let local = frame.to_local(wo);
        // Facets of roughness 1 in place of those that smooth ones do not have.
        let rough = self.alpha > 0.0;
        let alpha = if rough { self.alpha } else { 1.0 };
        let facets = Microfacet { distribution: Distribution::Ggx, ax: alpha, ay: alpha };
        let m = facets.sample_visible_ggx(local, u);
        let (m, reflected) = if rough { (m, reflect(local, m)) } else { (Vec3::Z, mirror(local)) };
        let (shadow, pdf) = (facets.g1(reflected, m), reflection_pdf(&facets, local, m));
        let (shadow, pdf) = if rough { (shadow, pdf) } else { (1.0, 1.0) };
        let weight = self.specular * fresnel_conductor(local.dot(m), self.eta, self.k) * shadow;
        let wi = frame.to_world(reflected).normalize();
        // Both normals must put each direction on the same side.
        let ng = if ns.dot(ng) < 0.0 { -ng } else { ng };
        let (cos_i, wo_ng, wi_ng) = (ns.dot(wi), ng.dot(wo), ng.dot(wi));
        let above = (local.z > 0.0) & (reflected.z > 0.0);
        let good = above & (wo_ng > 0.0) & (cos_i * wi_ng > 0.0) & (pdf > 0.0);
        let weight = weight * adjoint((local.z, wo_ng), (cos_i, wi_ng), mode);
        good.then_some(BsdfSample { wi, weight, pdf, lobe: self.class(), eta: 1.0, transmit: false })
    }
}
