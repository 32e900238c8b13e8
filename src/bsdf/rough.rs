use glam::{Vec2, Vec3};

use super::Mode;
use super::conductor::Metal;
use super::dielectric::{reflect_probability, refraction_scale};
use super::fresnel::{Ior, fresnel_conductor};
use super::lobe::LobeSample;
use super::microfacet::{Distribution, Microfacet};
use crate::color::Rgb;
use crate::math::sqr;

/// The unit vector halfway between two directions above the surface.
#[inline]
pub(super) fn half_vector(wo: Vec3, wi: Vec3) -> Option<Vec3> {
    let h = wo + wi;
    let len_sq = h.length_squared();
    (len_sq > 0.0).then(|| h / len_sq.sqrt())
}

/// Density per steradian of reflecting `wo` at a visible normal `m`: `G₁(wo) D(m) / (4 cos θo)`.
#[inline(always)]
pub(super) fn reflection_pdf(facets: &Microfacet, wo: Vec3, m: Vec3) -> f32 {
    0.25 * facets.d(m) * facets.g1_over_cos(wo)
}

/// Reflection of `w` at a normal `m`.
#[inline(always)]
pub(super) fn reflect(w: Vec3, m: Vec3) -> Vec3 {
    2.0 * w.dot(m) * m - w
}

/// A rough conductor [Walter et al. 2007, eq. 20].
#[derive(Clone, Copy, Debug)]
pub(super) struct RoughConductor {
    pub facets: Microfacet,
    pub eta: Rgb,
    pub k: Rgb,
    pub specular: Rgb,
}

impl RoughConductor {
    #[inline]
    fn reflectance(&self, cos: f32) -> Rgb {
        self.specular * fresnel_conductor(cos, self.eta, self.k)
    }

    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        match coat_half_vector(wo, wi) {
            Some(m) => self.reflectance(wo.dot(m)) * (reflection_pdf(&self.facets, wo, m) * self.facets.g1(wi, m)),
            None => Rgb::BLACK,
        }
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        let (wi, m) = sample_coat(&self.facets, wo, u)?;
        let weight = self.reflectance(wo.dot(m)) * self.facets.g1(wi, m);
        Some(LobeSample::reflection(wi, weight, reflection_pdf(&self.facets, wo, m)))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.reflectance(wo.z) } else { Rgb::BLACK }
    }

    /// The same as [`Metal`], where it is one.
    #[inline]
    pub fn metal(&self) -> Option<Metal> {
        let Self { facets: Microfacet { distribution, ax, ay }, eta, k, specular } = *self;
        (distribution == Distribution::Ggx && ax == ay).then_some(Metal { alpha: ax, eta, k, specular })
    }
}

/// The half vector of two directions that are both on the front, if both see that facet.
#[inline]
pub(super) fn coat_half_vector(wo: Vec3, wi: Vec3) -> Option<Vec3> {
    if wo.z > 0.0 && wi.z > 0.0 { half_vector(wo, wi) } else { None }
}

/// Density of [`sample_coat`].
#[inline]
pub(super) fn coat_pdf(facets: &Microfacet, wo: Vec3, wi: Vec3) -> f32 {
    coat_half_vector(wo, wi).map_or(0.0, |m| reflection_pdf(facets, wo, m))
}

/// Reflects `wo` at a visible normal; `None` below the horizon.
#[inline]
pub(super) fn sample_coat(facets: &Microfacet, wo: Vec3, u: Vec2) -> Option<(Vec3, Vec3)> {
    if wo.z <= 0.0 {
        return None;
    }
    let m = facets.sample_visible(wo, u);
    let wi = reflect(wo, m);
    (wi.z > 0.0).then_some((wi, m))
}

/// A rough interface between two dielectrics, the inside on −z [Walter et al. 2007, eqs. 20–21].
#[derive(Clone, Copy, Debug)]
pub(super) struct RoughDielectric {
    pub facets: Microfacet,
    pub ior: Ior,
    pub reflectance: Rgb,
    pub transmittance: Rgb,
}

/// A pair of directions at a rough interface, turned so that `wo` is above, with the facet that connects them.
#[derive(Clone, Copy)]
pub(super) struct Facet {
    pub wo: Vec3,
    pub wi: Vec3,
    pub m: Vec3,
    /// As seen from the side of `wo`.
    pub ior: Ior,
    /// `wo·m`.
    pub c: f32,
    /// Fresnel reflectance.
    pub r: f32,
    /// See [`Fresnel::g`](super::Fresnel::g).
    pub g: f32,
}

impl Facet {
    /// The facet that scatters `wo` to `wi`; `None` if no visible one does.
    #[inline]
    pub fn between(ior: Ior, wo: Vec3, wi: Vec3) -> Option<Self> {
        if wo.z == 0.0 || wi.z == 0.0 {
            return None;
        }
        let side = 1.0f32.copysign(wo.z);
        let (wo, wi) = (wo * side, wi * side);
        let ior = ior.seen_from(side);
        let h = if wi.z > 0.0 { wo + wi } else { wo + ior.eta * wi };
        let len_sq = h.length_squared();
        if len_sq <= 0.0 {
            return None;
        }
        let m = h / len_sq.sqrt().copysign(h.z);
        let (c, ci) = (wo.dot(m), wi.dot(m));
        // Both directions must see the same facet, from the sides they are on.
        if c <= 0.0 || ci * wi.z <= 0.0 {
            return None;
        }
        let (r, g) = if wi.z > 0.0 {
            let fresnel = ior.fresnel(c);
            (fresnel.r, fresnel.g)
        } else {
            // Near total reflection the angle of the refracted ray has more digits than its root has.
            let g = -ior.eta * ci;
            (ior.reflectance(c, g), g)
        };
        Some(Self { wo, wi, m, ior, c, r, g })
    }

    #[inline]
    pub fn reflects(&self) -> bool {
        self.wi.z > 0.0
    }

    /// Density per steradian of `wi` given that the facet refracts: visible normals times `∂m/∂wi` [Walter et al. 2007,
    /// eq. 17], with the denominator `wo·m + η wi·m = c − g` in the form `(1−η²)/(c+g)`.
    #[inline]
    pub fn refraction_pdf(&self, facets: &Microfacet) -> f32 {
        let denominator = self.ior.m / (self.c + self.g);
        let jacobian = self.ior.eta * self.ior.eta * self.wi.dot(self.m).abs() / sqr(denominator);
        facets.d(self.m) * facets.g1_over_cos(self.wo) * self.c * jacobian
    }
}

/// Refracts `wo` at the normal `m` that it sees.
#[inline]
pub(super) fn refract_at(wo: Vec3, m: Vec3, ior: Ior, c: f32, g: f32) -> Vec3 {
    ((-ior.m / (c + g)) * m - wo) / ior.eta
}

impl RoughDielectric {
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode) -> Rgb {
        let Some(f) = Facet::between(self.ior, wo, wi) else { return Rgb::BLACK };
        let g1 = self.facets.g1(f.wi, f.m);
        if f.reflects() {
            self.reflectance * (f.r * reflection_pdf(&self.facets, f.wo, f.m) * g1)
        } else if f.g > 0.0 {
            let scale = refraction_scale(f.ior.eta, mode);
            self.transmittance * ((1.0 - f.r) * f.refraction_pdf(&self.facets) * g1 * scale)
        } else {
            Rgb::BLACK
        }
    }

    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some(f) = Facet::between(self.ior, wo, wi) else { return 0.0 };
        let p = reflect_probability(f.r, self.reflectance, self.transmittance);
        if f.reflects() {
            p * reflection_pdf(&self.facets, f.wo, f.m)
        } else if f.g > 0.0 {
            (1.0 - p) * f.refraction_pdf(&self.facets)
        } else {
            0.0
        }
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<LobeSample> {
        let mut f = sample_facet(&self.facets, self.ior, wo, u)?;
        let side = 1.0f32.copysign(wo.z);
        let p = reflect_probability(f.r, self.reflectance, self.transmittance);
        if u_lobe < p {
            f.wi = reflect(f.wo, f.m);
            let weight = self.reflectance * (f.r / p * self.facets.g1(f.wi, f.m));
            let pdf = p * reflection_pdf(&self.facets, f.wo, f.m);
            return (f.wi.z > 0.0).then(|| LobeSample::reflection(f.wi * side, weight, pdf));
        }
        if f.g <= 0.0 {
            return None;
        }
        f.wi = refract_at(f.wo, f.m, f.ior, f.c, f.g);
        let (t, q) = (1.0 - f.r, 1.0 - p);
        let weight = self.transmittance * (t / q * self.facets.g1(f.wi, f.m) * refraction_scale(f.ior.eta, mode));
        let pdf = q * f.refraction_pdf(&self.facets);
        (f.wi.z < 0.0).then_some(LobeSample { wi: f.wi * side, weight, pdf, eta: f.ior.eta, transmit: true })
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        let r = self.ior.seen_from(wo.z).fresnel(wo.z.abs()).r;
        self.reflectance * r + self.transmittance * (1.0 - r)
    }
}

/// A facet that `wo` sees, its `wi` still to be chosen.
#[inline]
pub(super) fn sample_facet(facets: &Microfacet, ior: Ior, wo: Vec3, u: Vec2) -> Option<Facet> {
    if wo.z == 0.0 {
        return None;
    }
    let side = 1.0f32.copysign(wo.z);
    let wo = wo * side;
    let ior = ior.seen_from(side);
    let m = facets.sample_visible(wo, u);
    let c = wo.dot(m);
    if c <= 0.0 {
        return None;
    }
    let fresnel = ior.fresnel(c);
    Some(Facet { wo, wi: Vec3::ZERO, m, ior, c, r: fresnel.r, g: fresnel.g })
}
