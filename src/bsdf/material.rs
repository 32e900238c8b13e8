use super::microfacet::{Distribution, Microfacet};
use super::plastic::PlasticBase;
use super::rough_plastic::{TransmittanceFit, diffuse_rough_reflectance};
use super::{DELTA_ALPHA, Ior, diffuse_reflectance};
use crate::color::Rgb;
use crate::texture::{ColorParam, FloatParam, TextureId};

/// Index into the materials of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MaterialId(pub u32);

/// A material as a scene file describes it, with Mitsuba's parameters.
#[derive(Clone, Debug)]
pub enum Material {
    /// Lambertian, one-sided. Default reflectance 0.5. See [`Material::diffuse`].
    Diffuse { reflectance: Rgb },
    /// The same with a texture, apart so that plain scenes need not ask.
    TexturedDiffuse { reflectance: TextureId },
    /// Smooth interface between two dielectrics. Defaults bk7 in air, tints 1.
    Dielectric { ior: Ior, filling: Option<Filling>, reflectance: ColorParam, transmittance: ColorParam },
    /// Thin plate: reflects, or lets straight through. Defaults as for the dielectric.
    ThinDielectric { ior: Ior, reflectance: ColorParam, transmittance: ColorParam },
    /// Rough interface between two dielectrics. Defaults as for the dielectric.
    RoughDielectric {
        roughness: Roughness,
        ior: Ior,
        filling: Option<Filling>,
        reflectance: ColorParam,
        transmittance: ColorParam,
    },
    /// Smooth conductor of index `eta + i·k`, one-sided. Default `Cu`, tint 1.
    Conductor { eta: ColorParam, k: ColorParam, specular: ColorParam },
    /// Rough conductor, one-sided. Defaults as for the conductor.
    RoughConductor { roughness: Roughness, eta: ColorParam, k: ColorParam, specular: ColorParam },
    /// Diffuse base under a smooth dielectric coat, one-sided; see [`Material::plastic`].
    Plastic(Plastic),
    /// Diffuse base under a rough dielectric coat, one-sided; see [`Material::rough_plastic`].
    RoughPlastic(RoughPlastic),
    /// Modified Phong, one-sided. Defaults diffuse 0.5, specular 0.2, exponent 30.
    Phong { diffuse: ColorParam, specular: ColorParam, exponent: FloatParam },
    /// The many-parameter material of Burley; see [`Principled`].
    Principled(Box<Principled>),
    /// Its variant for thin sheets; see [`PrincipledThin`].
    PrincipledThin(Box<PrincipledThin>),
    /// Gives one-sided materials to both sides; `back` equals `front` when the file names one.
    TwoSided { front: MaterialId, back: MaterialId },
    /// `nested` where `opacity` is 1, nothing where it is 0. Default opacity 0.5.
    Mask { opacity: FloatParam, nested: MaterialId },
    /// `(1 − weight)·first + weight·second`.
    Blend { weight: FloatParam, first: MaterialId, second: MaterialId },
    /// `nested` with normals bent by a height field of `scale·height`, a length in scene space. Default scale 1.
    BumpMap { height: FloatParam, scale: f32, nested: MaterialId },
    /// `nested` with normals `2c − 1` in the frame (∂p/∂u, ·, ns).
    NormalMap { normals: ColorParam, nested: MaterialId },
    /// Not there: an interface between media.
    Null,
}

/// What fills a closed shape, where shapes may overlap: the filling with the highest priority is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filling {
    pub priority: i32,
    /// Its index, and that of what is around it where no filling is.
    pub int_ior: f64,
    pub ext_ior: f64,
}

/// Roughness of a microfacet material: `alpha` along the tangent and the bitangent. Defaults Beckmann, 0.1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    pub distribution: Distribution,
    pub alpha_u: FloatParam,
    pub alpha_v: FloatParam,
}

impl Default for Roughness {
    fn default() -> Self {
        Self::isotropic(Distribution::Beckmann, 0.1.into())
    }
}

impl Roughness {
    /// The same roughness in all directions.
    pub fn isotropic(distribution: Distribution, alpha: FloatParam) -> Self {
        Self { distribution, alpha_u: alpha, alpha_v: alpha }
    }

    /// The roughness of facets by GGX that is the same everywhere and in all directions; 0 where it counts as smooth.
    pub(super) fn plain_ggx(&self) -> Option<f32> {
        match *self {
            Self { distribution: Distribution::Ggx, alpha_u: FloatParam::Const(u), alpha_v: FloatParam::Const(v) }
                if u == v =>
            {
                Some(if u >= DELTA_ALPHA { u } else { 0.0 })
            }
            _ => None,
        }
    }
}

/// Parameters of the smooth plastic, with what can be computed once.
#[derive(Clone, Debug)]
pub struct Plastic {
    pub(super) ior: Ior,
    pub(super) r_int: f32,
    pub(super) t_ext: f32,
    pub(super) diffuse: ColorParam,
    pub(super) specular: ColorParam,
    pub(super) nonlinear: bool,
}

/// Parameters of the rough plastic, with what can be computed once.
#[derive(Clone, Debug)]
pub struct RoughPlastic {
    pub(super) plastic: Plastic,
    pub(super) facets: Microfacet,
    pub(super) transmittance: TransmittanceFit,
}

impl Plastic {
    pub(super) fn strength(&self, diffuse: Rgb) -> Rgb {
        PlasticBase::strength(diffuse, self.ior, self.r_int, self.nonlinear)
    }
}

/// Parameters of the principled material, with Mitsuba's names and defaults.
#[derive(Clone, Debug)]
pub struct Principled {
    pub base_color: ColorParam,
    pub roughness: FloatParam,
    pub anisotropic: FloatParam,
    pub metallic: FloatParam,
    pub spec_trans: FloatParam,
    /// Interior over exterior index.
    pub eta: f32,
    pub spec_tint: FloatParam,
    pub sheen: FloatParam,
    pub sheen_tint: FloatParam,
    pub flatness: FloatParam,
    pub clearcoat: FloatParam,
    pub clearcoat_gloss: FloatParam,
}

impl Default for Principled {
    fn default() -> Self {
        let zero = FloatParam::Const(0.0);
        Self {
            base_color: Rgb::splat(0.5).into(),
            roughness: 0.5.into(),
            anisotropic: zero,
            metallic: zero,
            spec_trans: zero,
            eta: Self::eta_of_specular(0.5),
            spec_tint: zero,
            sheen: zero,
            sheen_tint: zero,
            flatness: zero,
            clearcoat: zero,
            clearcoat_gloss: zero,
        }
    }
}

impl Principled {
    /// The index whose reflectance at normal incidence is `0.08·specular` [Burley 2012, §5.4].
    pub fn eta_of_specular(specular: f32) -> f32 {
        2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0
    }
}

/// Parameters of the thin principled material, with Mitsuba's names and defaults.
#[derive(Clone, Debug)]
pub struct PrincipledThin {
    pub base_color: ColorParam,
    pub roughness: FloatParam,
    pub anisotropic: FloatParam,
    pub spec_trans: FloatParam,
    /// Index of the sheet.
    pub eta: FloatParam,
    pub spec_tint: FloatParam,
    pub sheen: FloatParam,
    pub sheen_tint: FloatParam,
    pub flatness: FloatParam,
    /// Diffuse transmission: 0 reflects all, 2 transmits all.
    pub diff_trans: FloatParam,
}

impl Default for PrincipledThin {
    fn default() -> Self {
        let zero = FloatParam::Const(0.0);
        Self {
            base_color: Rgb::splat(0.5).into(),
            roughness: 0.5.into(),
            anisotropic: zero,
            spec_trans: zero,
            eta: 1.5.into(),
            spec_tint: zero,
            sheen: zero,
            sheen_tint: zero,
            flatness: zero,
            diff_trans: zero,
        }
    }
}

impl Material {
    /// A Lambertian surface.
    pub fn diffuse(reflectance: ColorParam) -> Self {
        match reflectance {
            ColorParam::Const(reflectance) => Self::Diffuse { reflectance },
            ColorParam::Texture(reflectance) => Self::TexturedDiffuse { reflectance },
        }
    }

    /// A diffuse base under a smooth coat of index `int_ior` in a medium of index `ext_ior`. Mitsuba's defaults are
    /// polypropylene in air, diffuse 0.5, specular 1, linear.
    pub fn plastic(int_ior: f64, ext_ior: f64, diffuse: ColorParam, specular: ColorParam, nonlinear: bool) -> Self {
        Self::Plastic(smooth_plastic(int_ior, ext_ior, diffuse, specular, nonlinear))
    }

    /// The same under a coat of roughness `alpha` (defaults Beckmann, 0.1); measures the coat's transmittance.
    pub fn rough_plastic(
        (distribution, alpha): (Distribution, f32),
        (int_ior, ext_ior): (f64, f64),
        diffuse: ColorParam,
        specular: ColorParam,
        nonlinear: bool,
    ) -> Self {
        let mut plastic = smooth_plastic(int_ior, ext_ior, diffuse, specular, nonlinear);
        if alpha < DELTA_ALPHA {
            return Self::Plastic(plastic);
        }
        let facets = Microfacet { distribution, ax: alpha, ay: alpha };
        let transmittance = TransmittanceFit::measure(&facets, plastic.ior);
        plastic.r_int = diffuse_rough_reflectance(&facets, plastic.ior.flipped());
        plastic.t_ext = transmittance.mean();
        Self::RoughPlastic(RoughPlastic { plastic, facets, transmittance })
    }

    /// True when the lobes may differ with the side from which the surface is looked at.
    pub fn is_composite(&self) -> bool {
        matches!(self, Self::Principled(_) | Self::PrincipledThin(_)) || !self.children().is_empty()
    }

    /// What the material says about the inside of closed shapes, itself or under a bent normal.
    pub fn filling(materials: &[Material], id: MaterialId) -> Option<Filling> {
        match &materials[id.0 as usize] {
            Self::Dielectric { filling, .. } | Self::RoughDielectric { filling, .. } => *filling,
            Self::BumpMap { nested, .. } | Self::NormalMap { nested, .. } => Self::filling(materials, *nested),
            _ => None,
        }
    }

    /// True when `id` or a material nested in it has a filling.
    pub fn names_filling(materials: &[Material], id: MaterialId) -> bool {
        Self::filling(materials, id).is_some()
            || materials[id.0 as usize].children().into_iter().any(|c| Self::names_filling(materials, c))
    }

    /// Materials that this one refers to.
    pub fn children(&self) -> Vec<MaterialId> {
        match *self {
            Self::TwoSided { front, back } => vec![front, back],
            Self::Blend { first, second, .. } => vec![first, second],
            Self::Mask { nested, .. } | Self::BumpMap { nested, .. } | Self::NormalMap { nested, .. } => vec![nested],
            _ => Vec::new(),
        }
    }
}

fn smooth_plastic(int_ior: f64, ext_ior: f64, diffuse: ColorParam, specular: ColorParam, nonlinear: bool) -> Plastic {
    let eta = int_ior / ext_ior;
    Plastic {
        ior: Ior::new(int_ior, ext_ior),
        r_int: diffuse_reflectance(1.0 / eta) as f32,
        t_ext: (1.0 - diffuse_reflectance(eta)) as f32,
        diffuse,
        specular,
        nonlinear,
    }
}
