//! The lobes of the "principled" material [Burley 2012; Burley 2015], with the weights that Mitsuba gives them.

use glam::{Vec2, Vec3};

use super::dielectric::refraction_scale;
use super::diffuse::Lambert;
use super::lobe::LobeSample;
use super::microfacet::Microfacet;
use super::rough::{Facet, coat_half_vector, reflect, reflection_pdf, refract_at, sample_facet};
use super::{Ior, Mode};
use crate::color::Rgb;
use crate::math::{INV_PI, safe_sqrt, sqr};
use crate::sample::warp;

/// Schlick's `(1 − cos θ)⁵`.
#[inline]
fn schlick(cos: f32) -> f32 {
    let x = (1.0 - cos).clamp(0.0, 1.0);
    sqr(sqr(x)) * x
}

/// Schlick's reflectance at cosine `c` on the side of `ior`; the transmitted angle decides when it is the larger one.
#[inline]
fn schlick_fresnel(r0: Rgb, c: f32, ior: Ior) -> Rgb {
    let w = if ior.m > 0.0 { schlick(c) } else { schlick(safe_sqrt(c * c + ior.m) / ior.eta) };
    r0.lerp(Rgb::WHITE, w)
}

/// Base colour with its brightness taken out.
#[inline]
pub(super) fn tint_of(base: Rgb) -> Rgb {
    let y = base.luminance();
    if y > 0.0 { base / y } else { Rgb::WHITE }
}

/// Diffuse, retro-reflection, "flat" subsurface and sheen.
#[derive(Clone, Copy, Debug)]
pub(super) struct PrincipledDiffuse {
    /// Base colour times the share of the diffuse lobe.
    pub base: Rgb,
    pub roughness: f32,
    pub flatness: f32,
    /// Sheen tint times its strength.
    pub sheen: Rgb,
    /// Works on both sides (the thin material).
    pub both_sides: bool,
}

impl PrincipledDiffuse {
    /// Turns both directions to the front, if the lobe has a back.
    #[inline]
    fn turn(&self, wo: Vec3, wi: Vec3) -> (Vec3, Vec3) {
        if self.both_sides && wo.z < 0.0 { (-wo, -wi) } else { (wo, wi) }
    }

    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let (wo, wi) = self.turn(wo, wi);
        let Some(h) = coat_half_vector(wo, wi) else { return Rgb::BLACK };
        let (fo, fi) = (schlick(wo.z), schlick(wi.z));
        let cos_d = h.dot(wi);
        let diffuse = (1.0 - 0.5 * fo) * (1.0 - 0.5 * fi);
        let rr = 2.0 * self.roughness * cos_d * cos_d;
        let retro = rr * (fo + fi + fo * fi * (rr - 1.0));
        let mut f = diffuse + retro;
        if self.flatness > 0.0 {
            let toward = |w: f32| 1.0 + (0.5 * rr - 1.0) * w;
            let fss = toward(fo) * toward(fi);
            let flat = 1.25 * (fss * (1.0 / (wo.z + wi.z) - 0.5) + 0.5);
            f += (flat - f) * self.flatness;
        }
        self.base * (f * INV_PI * wi.z) + self.sheen * (schlick(cos_d) * wi.z)
    }

    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (wo, wi) = self.turn(wo, wi);
        Lambert::pdf(wo, wi)
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        let wi = warp::cosine_hemisphere(u);
        let wi = if self.both_sides && wo.z < 0.0 { -wi } else { wi };
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| LobeSample::reflection(wi, self.eval(wo, wi) / pdf, pdf))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        let cos = if self.both_sides { wo.z.abs() } else { wo.z };
        // The sheen's mean over the hemisphere grows from 0.02 at normal to 0.3 at grazing incidence.
        if cos > 0.0 { self.base + self.sheen * (0.1 + 0.5 * schlick(cos)) } else { Rgb::BLACK }
    }
}

/// Metallic and dielectric reflection, and refraction, at one set of GGX facets.
#[derive(Clone, Copy, Debug)]
pub(super) struct PrincipledSpecular {
    pub facets: Microfacet,
    pub ior: Ior,
    pub base: Rgb,
    pub metallic: f32,
    pub spec_tint: f32,
    /// Share that refracts: `(1 − metallic)·spec_trans`.
    pub bsdf: f32,
}

impl PrincipledSpecular {
    /// What a facet reflects; the inside knows no tint and no metal.
    #[inline]
    fn reflectance(&self, front: bool, r: f32, c: f32, ior: Ior) -> Rgb {
        if !front {
            return Rgb::splat(self.bsdf * r);
        }
        let mut f = Rgb::splat((1.0 - self.metallic) * (1.0 - self.spec_tint) * r);
        if self.metallic > 0.0 {
            f += self.metallic * schlick_fresnel(self.base, c, ior);
        }
        if self.spec_tint > 0.0 {
            let r0 = tint_of(self.base) * sqr((ior.eta - 1.0) / (ior.eta + 1.0));
            f += (1.0 - self.metallic) * self.spec_tint * schlick_fresnel(r0, c, ior);
        }
        f
    }

    #[inline]
    fn transmittance(&self, r: f32) -> Rgb {
        self.base.map(safe_sqrt) * (self.bsdf * (1.0 - r))
    }

    /// Share of samples that reflect at a facet of Fresnel reflectance `r`.
    #[inline]
    fn reflect_share(&self, front: bool, r: f32) -> f32 {
        if front { 1.0 - self.bsdf * (1.0 - r) } else { r }
    }

    /// The lobe is black inside a material that lets nothing in.
    #[inline]
    fn works(&self, wo: Vec3) -> bool {
        wo.z > 0.0 || self.bsdf > 0.0
    }

    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode) -> Rgb {
        let Some(f) = Facet::between(self.ior, wo, wi).filter(|_| self.works(wo)) else { return Rgb::BLACK };
        let g1 = self.facets.g1(f.wi, f.m);
        if f.reflects() {
            self.reflectance(wo.z > 0.0, f.r, f.c, f.ior) * (reflection_pdf(&self.facets, f.wo, f.m) * g1)
        } else if f.g > 0.0 && self.bsdf > 0.0 {
            self.transmittance(f.r) * (f.refraction_pdf(&self.facets) * g1 * refraction_scale(f.ior.eta, mode))
        } else {
            Rgb::BLACK
        }
    }

    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some(f) = Facet::between(self.ior, wo, wi).filter(|_| self.works(wo)) else { return 0.0 };
        let p = self.reflect_share(wo.z > 0.0, f.r);
        if f.reflects() {
            p * reflection_pdf(&self.facets, f.wo, f.m)
        } else if f.g > 0.0 && self.bsdf > 0.0 {
            (1.0 - p) * f.refraction_pdf(&self.facets)
        } else {
            0.0
        }
    }

    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<LobeSample> {
        let mut f = sample_facet(&self.facets, self.ior, wo, u).filter(|_| self.works(wo))?;
        let front = wo.z > 0.0;
        let side = 1.0f32.copysign(wo.z);
        let p = self.reflect_share(front, f.r);
        if u_lobe < p {
            f.wi = reflect(f.wo, f.m);
            let weight = self.reflectance(front, f.r, f.c, f.ior) * (self.facets.g1(f.wi, f.m) / p);
            let pdf = p * reflection_pdf(&self.facets, f.wo, f.m);
            return (f.wi.z > 0.0).then(|| LobeSample::reflection(f.wi * side, weight, pdf));
        }
        if f.g <= 0.0 || p >= 1.0 {
            return None;
        }
        f.wi = refract_at(f.wo, f.m, f.ior, f.c, f.g);
        let scale = self.facets.g1(f.wi, f.m) * refraction_scale(f.ior.eta, mode) / (1.0 - p);
        let pdf = (1.0 - p) * f.refraction_pdf(&self.facets);
        let weight = self.transmittance(f.r) * scale;
        (f.wi.z < 0.0).then_some(LobeSample { wi: f.wi * side, weight, pdf, eta: f.ior.eta, transmit: true })
    }

    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if !self.works(wo) {
            return Rgb::BLACK;
        }
        let ior = self.ior.seen_from(wo.z);
        let c = wo.z.abs();
        let r = ior.fresnel(c).r;
        let t = self.transmittance(r);
        // A floor: rough facets reflect more than the smooth surface where that reflects least.
        self.reflectance(wo.z > 0.0, r, c, ior) + t + Rgb::splat(1e-3)
    }
}

/// The clear coat: a fixed dielectric over GTR1 facets [Burley 2012, appendix B.2].
#[derive(Clone, Copy, Debug)]
pub(super) struct ClearCoat {
    /// A quarter of the parameter.
    pub strength: f32,
    pub alpha: f32,
    pub ior: Ior,
}

impl ClearCoat {
    /// `D(m)` of GTR1; `1 + (α²−1)cos²θ` is written `sin²θ + α² cos²θ`.
    #[inline]
    fn d(&self, m: Vec3) -> f32 {
        let a = self.alpha * self.alpha;
        (1.0 - a) * INV_PI / (-a.ln() * (m.x * m.x + m.y * m.y + a * m.z * m.z))
    }

    #[inline]
    fn g1(v: Vec3, m: Vec3) -> f32 {
        Microfacet { distribution: super::Distribution::Ggx, ax: 0.25, ay: 0.25 }.g1(v, m)
    }

    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let Some(m) = coat_half_vector(wo, wi) else { return Rgb::BLACK };
        let f = schlick_fresnel(Rgb::splat(0.04), wo.dot(m), self.ior);
        f * (self.strength * self.d(m) * Self::g1(wo, m) * Self::g1(wi, m) * wi.z)
    }

    /// Density of normals `D cos θm`, per steradian of `wi`.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        coat_half_vector(wo, wi).map_or(0.0, |m| self.d(m) * m.z / (4.0 * wo.dot(m)))
    }

    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let a = self.alpha * self.alpha;
        let sin_sq = ((a.powf(1.0 - u.y) - a) / (1.0 - a)).clamp(0.0, 1.0);
        let m = (sin_sq.sqrt() * Vec2::from_angle(std::f32::consts::TAU * u.x)).extend(safe_sqrt(1.0 - sin_sq));
        let wi = reflect(wo, m);
        if wi.z <= 0.0 || wo.dot(m) <= 0.0 {
            return None;
        }
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| LobeSample::reflection(wi, self.eval(wo, wi) / pdf, pdf))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 {
            schlick_fresnel(Rgb::splat(0.04), wo.z, self.ior) * (4.0 * self.strength * wo.z.max(0.1) * Self::g1(wo, wo))
        } else {
            Rgb::BLACK
        }
    }
}

/// Reflection and straight-through scattering of a thin sheet, both as GGX reflection, the latter mirrored to the other
/// side with a roughness of its own [Burley 2015, §5.3].
#[derive(Clone, Copy, Debug)]
pub(super) struct ThinSpecular {
    pub facets: Microfacet,
    pub ior: Ior,
    /// Share of the specular lobes.
    pub strength: f32,
    /// Base colour for transmission, tint for reflection.
    pub base: Rgb,
    pub spec_tint: f32,
    /// This lobe transmits.
    pub transmit: bool,
}

impl ThinSpecular {
    /// Both directions turned so that the lobe is an ordinary reflection on the front.
    #[inline]
    fn turn(&self, wo: Vec3, wi: Vec3) -> (Vec3, Vec3) {
        let side = 1.0f32.copysign(wo.z);
        let (wo, mut wi) = (wo * side, wi * side);
        if self.transmit {
            wi.z = -wi.z;
        }
        (wo, wi)
    }

    #[inline]
    fn color(&self, c: f32) -> Rgb {
        let r = self.ior.fresnel(c).r;
        if self.transmit {
            return self.base * (self.strength * (1.0 - r));
        }
        let r0 = tint_of(self.base) * sqr((self.ior.eta - 1.0) / (self.ior.eta + 1.0));
        Rgb::splat(r).lerp(schlick_fresnel(r0, c, self.ior), self.spec_tint) * self.strength
    }

    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let (wo, wi) = self.turn(wo, wi);
        match coat_half_vector(wo, wi) {
            Some(m) => self.color(wo.dot(m)) * (reflection_pdf(&self.facets, wo, m) * self.facets.g1(wi, m)),
            None => Rgb::BLACK,
        }
    }

    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (wo, wi) = self.turn(wo, wi);
        coat_half_vector(wo, wi).map_or(0.0, |m| reflection_pdf(&self.facets, wo, m))
    }

    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        let (front, _) = self.turn(wo, wo);
        let (wi, m) = super::rough::sample_coat(&self.facets, front, u)?;
        let weight = self.color(front.dot(m)) * self.facets.g1(wi, m);
        let pdf = reflection_pdf(&self.facets, front, m);
        let mirrored = if self.transmit { Vec3::new(wi.x, wi.y, -wi.z) } else { wi };
        let wi = mirrored * 1.0f32.copysign(wo.z);
        Some(LobeSample { wi, weight, pdf, eta: 1.0, transmit: self.transmit })
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        self.color(wo.z.abs()) + Rgb::splat(1e-3 * self.strength)
    }
}

/// Lambertian transmission.
#[derive(Clone, Copy, Debug)]
pub(super) struct DiffuseTransmission {
    pub transmittance: Rgb,
}

impl DiffuseTransmission {
    #[inline]
    pub fn pdf(wo: Vec3, wi: Vec3) -> f32 {
        if wo.z * wi.z < 0.0 { wi.z.abs() * INV_PI } else { 0.0 }
    }

    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.transmittance * Self::pdf(wo, wi)
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        let wi = warp::cosine_hemisphere(u) * -1.0f32.copysign(wo.z);
        let pdf = Self::pdf(wo, wi);
        (pdf > 0.0).then_some(LobeSample { wi, weight: self.transmittance, pdf, eta: 1.0, transmit: true })
    }
}
