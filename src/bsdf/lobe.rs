use std::ops::{BitAnd, BitOr, BitOrAssign, Not};

use glam::{Vec2, Vec3};

use super::Mode;
use super::conductor::Mirror;
use super::dielectric::{Dielectric, ThinReflection, ThinTransmission};
use super::diffuse::Lambert;
use super::phong::Phong;
use super::plastic::{PlasticBase, PlasticCoat};
use super::principled::{ClearCoat, DiffuseTransmission, PrincipledDiffuse, PrincipledSpecular, ThinSpecular};
use super::rough::{RoughConductor, RoughDielectric, coat_pdf};
use super::rough_plastic::{RoughBase, RoughCoat};
use crate::color::Rgb;
use crate::math::Frame;

/// A set of lobe classes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LobeMask(pub u8);

impl LobeMask {
    pub const NONE: Self = Self(0);
    /// Lambertian or nearly so.
    pub const DIFFUSE: Self = Self(1);
    /// Rough: photons may be stored here and the density estimate sees the lobe.
    pub const GLOSSY: Self = Self(2 | Self::NARROW.0);
    /// The narrow ones of those, roughness below [`NARROW_ALPHA`](super::NARROW_ALPHA): what they mirror is found with less
    /// noise by a ray than by photons.
    pub const NARROW: Self = Self(32);
    /// Rough but narrow, roughness below [`SHARP_ALPHA`](super::SHARP_ALPHA): photon methods trace it like a mirror.
    pub const SHARP: Self = Self(4);
    /// Mirror reflection and refraction.
    pub const DELTA: Self = Self(8);
    /// Straight through.
    pub const NULL: Self = Self(16);
    /// Everything.
    pub const ALL: Self = Self(63);
    /// The lobes with a density: everything but delta and null.
    pub const SMOOTH: Self = Self(Self::SMOOTH_WIDE.0 | Self::SHARP.0);
    /// The lobes that photon methods store photons for and estimate from them.
    pub const SMOOTH_WIDE: Self = Self(Self::DIFFUSE.0 | Self::GLOSSY.0);
    /// The lobes that photon methods follow ray by ray.
    pub const SPECULAR: Self = Self(28);

    /// The class of a lobe of roughness `alpha`.
    #[inline]
    pub fn of_roughness(alpha: f32) -> Self {
        if alpha < super::DELTA_ALPHA {
            Self::DELTA
        } else if alpha < super::SHARP_ALPHA {
            Self::SHARP
        } else if alpha < super::NARROW_ALPHA {
            Self::NARROW
        } else {
            Self(Self::GLOSSY.0 & !Self::NARROW.0)
        }
    }

    /// True when the sets have a class in common.
    #[inline]
    pub const fn intersects(self, o: Self) -> bool {
        self.0 & o.0 != 0
    }

    #[inline]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl BitOr for LobeMask {
    type Output = Self;
    #[inline]
    fn bitor(self, o: Self) -> Self {
        Self(self.0 | o.0)
    }
}
impl BitAnd for LobeMask {
    type Output = Self;
    #[inline]
    fn bitand(self, o: Self) -> Self {
        Self(self.0 & o.0)
    }
}
impl BitOrAssign for LobeMask {
    #[inline]
    fn bitor_assign(&mut self, o: Self) {
        self.0 |= o.0;
    }
}
impl Not for LobeMask {
    type Output = Self;
    #[inline]
    fn not(self) -> Self {
        Self(!self.0 & Self::ALL.0)
    }
}

/// A direction that one lobe chose, in the lobe's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct LobeSample {
    pub wi: Vec3,
    /// `f·|cos| / pdf` of this lobe alone.
    pub weight: Rgb,
    /// Per steradian; for delta lobes the discrete probability of this choice.
    pub pdf: f32,
    /// Relative index crossed; 1 for reflection.
    pub eta: f32,
    pub transmit: bool,
}

impl LobeSample {
    #[inline]
    pub fn reflection(wi: Vec3, weight: Rgb, pdf: f32) -> Self {
        Self { wi, weight, pdf, eta: 1.0, transmit: false }
    }
}

/// One way to scatter, in its own frame, with its share of a blend.
#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    pub(super) frame: Frame,
    pub(super) weight: f32,
    /// Squared roughness of the shadowing that a bump or normal map casts; 0 without one.
    pub(super) shadow: f32,
    pub(super) class: LobeMask,
    pub(super) kind: Kind,
}

/// The closed set of lobes. Reflective ones live on the side of +z only.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Lambert(Lambert),
    Mirror(Mirror),
    Dielectric(Dielectric),
    ThinReflection(ThinReflection),
    ThinTransmission(ThinTransmission),
    PlasticCoat(PlasticCoat),
    PlasticBase(PlasticBase),
    RoughConductor(RoughConductor),
    RoughDielectric(RoughDielectric),
    RoughCoat(RoughCoat),
    RoughBase(RoughBase),
    Phong(Phong),
    PrincipledDiffuse(PrincipledDiffuse),
    PrincipledSpecular(PrincipledSpecular),
    ClearCoat(ClearCoat),
    ThinSpecular(ThinSpecular),
    DiffuseTransmission(DiffuseTransmission),
    Null,
}

impl Kind {
    /// `f·|cos θi|` of local directions, with the factor for `mode`; 0 for delta lobes.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode) -> Rgb {
        match self {
            Self::Lambert(l) => l.eval(wo, wi),
            Self::PlasticBase(l) => l.eval(wo, wi),
            Self::RoughConductor(l) => l.eval(wo, wi),
            Self::RoughDielectric(l) => l.eval(wo, wi, mode),
            Self::RoughCoat(l) => l.eval(wo, wi),
            Self::RoughBase(l) => l.eval(wo, wi),
            Self::Phong(l) => l.eval(wo, wi),
            Self::PrincipledDiffuse(l) => l.eval(wo, wi),
            Self::PrincipledSpecular(l) => l.eval(wo, wi, mode),
            Self::ClearCoat(l) => l.eval(wo, wi),
            Self::ThinSpecular(l) => l.eval(wo, wi),
            Self::DiffuseTransmission(l) => l.eval(wo, wi),
            Self::Mirror(_)
            | Self::Dielectric(_)
            | Self::ThinReflection(_)
            | Self::ThinTransmission(_)
            | Self::PlasticCoat(_)
            | Self::Null => Rgb::BLACK,
        }
    }

    /// Density per steradian with which [`sample`](Self::sample) picks `wi`; 0 for delta lobes.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        match self {
            Self::Lambert(_) | Self::PlasticBase(_) | Self::RoughBase(_) => Lambert::pdf(wo, wi),
            Self::RoughConductor(l) => coat_pdf(&l.facets, wo, wi),
            Self::RoughCoat(l) => coat_pdf(&l.facets, wo, wi),
            Self::RoughDielectric(l) => l.pdf(wo, wi),
            Self::Phong(l) => l.pdf(wo, wi),
            Self::PrincipledDiffuse(l) => l.pdf(wo, wi),
            Self::PrincipledSpecular(l) => l.pdf(wo, wi),
            Self::ClearCoat(l) => l.pdf(wo, wi),
            Self::ThinSpecular(l) => l.pdf(wo, wi),
            Self::DiffuseTransmission(_) => DiffuseTransmission::pdf(wo, wi),
            Self::Mirror(_)
            | Self::Dielectric(_)
            | Self::ThinReflection(_)
            | Self::ThinTransmission(_)
            | Self::PlasticCoat(_)
            | Self::Null => 0.0,
        }
    }

    /// [`eval`](Self::eval) with the densities of `wi` from `wo` and of `wo` from `wi`.
    #[inline]
    pub fn eval_with_pdfs(&self, wo: Vec3, wi: Vec3, mode: Mode) -> (Rgb, f32, f32) {
        match self {
            Self::Lambert(l) => (l.eval(wo, wi), Lambert::pdf(wo, wi), Lambert::pdf(wi, wo)),
            Self::Phong(l) => {
                // The lobe is the same both ways.
                let pdf = l.pdf(wo, wi);
                (l.eval_where(pdf, wi), pdf, pdf)
            }
            _ => (self.eval(wo, wi, mode), self.pdf(wo, wi), self.pdf(wi, wo)),
        }
    }

    /// Probability of the discrete reflection or transmission; 0 for lobes with a density.
    pub fn discrete_pdf(&self, wo: Vec3, transmit: bool) -> f32 {
        match self {
            Self::Mirror(_) | Self::ThinReflection(_) | Self::PlasticCoat(_) => !transmit as u8 as f32,
            Self::ThinTransmission(_) | Self::Null => transmit as u8 as f32,
            Self::Dielectric(l) => l.discrete_pdf(wo, transmit),
            _ => 0.0,
        }
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<LobeSample> {
        match self {
            Self::Lambert(l) => l.sample(wo, u),
            // By `Lobe::sample`, which needs no frame for them.
            Self::Mirror(_) | Self::Dielectric(_) => None,
            Self::ThinReflection(l) => l.sample(wo),
            Self::ThinTransmission(l) => l.sample(wo),
            Self::PlasticCoat(l) => l.sample(wo),
            Self::PlasticBase(l) => l.sample(wo, u),
            Self::RoughConductor(l) => l.sample(wo, u),
            Self::RoughDielectric(l) => l.sample(wo, u_lobe, u, mode),
            Self::RoughCoat(l) => l.sample(wo, u),
            Self::RoughBase(l) => l.sample(wo, u),
            Self::Phong(l) => l.sample(wo, u),
            Self::PrincipledDiffuse(l) => l.sample(wo, u),
            Self::PrincipledSpecular(l) => l.sample(wo, u_lobe, u, mode),
            Self::ClearCoat(l) => l.sample(wo, u),
            Self::ThinSpecular(l) => l.sample(wo, u),
            Self::DiffuseTransmission(l) => l.sample(wo, u),
            Self::Null => Some(LobeSample { wi: -wo, weight: Rgb::WHITE, pdf: 1.0, eta: 1.0, transmit: true }),
        }
    }

    /// True when there are at most two directions to choose from.
    #[inline]
    pub fn is_discrete(&self) -> bool {
        matches!(
            self,
            Self::Mirror(_)
                | Self::Dielectric(_)
                | Self::ThinReflection(_)
                | Self::ThinTransmission(_)
                | Self::PlasticCoat(_)
                | Self::Null
        )
    }

    /// True when the lobe can send light to the other side of the surface.
    #[inline]
    pub fn transmits(&self) -> bool {
        match self {
            Self::Dielectric(_) | Self::RoughDielectric(_) | Self::ThinTransmission(_) => true,
            Self::DiffuseTransmission(_) | Self::Null => true,
            Self::PrincipledSpecular(l) => l.bsdf > 0.0,
            Self::ThinSpecular(l) => l.transmit,
            _ => false,
        }
    }

    /// Estimate of the directional albedo; it also decides how often the lobe is chosen.
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        match self {
            Self::Lambert(l) => l.albedo(wo),
            Self::Mirror(l) => l.albedo(wo),
            Self::Dielectric(l) => l.albedo(wo),
            Self::ThinReflection(l) => l.albedo(wo),
            Self::ThinTransmission(l) => l.albedo(wo),
            Self::PlasticCoat(l) => l.albedo(wo),
            Self::PlasticBase(l) => l.albedo(wo),
            Self::RoughConductor(l) => l.albedo(wo),
            Self::RoughDielectric(l) => l.albedo(wo),
            Self::RoughCoat(l) => l.albedo(wo),
            Self::RoughBase(l) => l.albedo(wo),
            Self::Phong(l) => l.albedo(wo),
            Self::PrincipledDiffuse(l) => l.albedo(wo),
            Self::PrincipledSpecular(l) => l.albedo(wo),
            Self::ClearCoat(l) => l.albedo(wo),
            Self::ThinSpecular(l) => l.albedo(wo),
            Self::DiffuseTransmission(l) => l.transmittance,
            Self::Null => Rgb::WHITE,
        }
    }
}
