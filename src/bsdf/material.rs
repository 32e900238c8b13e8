use super::{Ior, LobeMask, MAX_LOBES, diffuse_reflectance};
use crate::texture::{ColorParam, FloatParam};

/// Index into the materials of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MaterialId(pub u32);

/// A material as a scene file describes it. The constructors take Mitsuba's parameters; `DEFAULT_…` constants hold
/// Mitsuba's defaults where a number needs a name.
#[derive(Clone, Debug)]
pub enum Material {
    /// Lambertian, one-sided.
    Diffuse { reflectance: ColorParam },
    /// Smooth interface between two dielectrics.
    Dielectric { ior: Ior, reflectance: ColorParam, transmittance: ColorParam },
    /// Thin plate: reflects, or lets straight through.
    ThinDielectric { ior: Ior, reflectance: ColorParam, transmittance: ColorParam },
    /// Smooth conductor of index `eta + i·k`, one-sided.
    Conductor { eta: ColorParam, k: ColorParam, specular: ColorParam },
    /// Diffuse base under a smooth dielectric coat, one-sided; see [`Material::plastic`].
    Plastic(Plastic),
    /// Gives one-sided materials to both sides.
    TwoSided { front: MaterialId, back: MaterialId },
    /// `nested` where `opacity` is 1, nothing where it is 0.
    Mask { opacity: FloatParam, nested: MaterialId },
    /// `(1 − weight)·first + weight·second`.
    Blend { weight: FloatParam, first: MaterialId, second: MaterialId },
    /// Not there: an interface between media.
    Null,
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

impl Material {
    /// A diffuse base under a smooth coat of index `int_ior` in a medium of index `ext_ior`.
    pub fn plastic(int_ior: f64, ext_ior: f64, diffuse: ColorParam, specular: ColorParam, nonlinear: bool) -> Self {
        let eta = int_ior / ext_ior;
        Self::Plastic(Plastic {
            ior: Ior::new(int_ior, ext_ior),
            r_int: diffuse_reflectance(1.0 / eta) as f32,
            t_ext: (1.0 - diffuse_reflectance(eta)) as f32,
            diffuse,
            specular,
            nonlinear,
        })
    }

    /// Materials that this one refers to.
    pub fn children(&self) -> Vec<MaterialId> {
        match self {
            Self::TwoSided { front, back } => vec![*front, *back],
            Self::Mask { nested, .. } => vec![*nested],
            Self::Blend { first, second, .. } => vec![*first, *second],
            _ => Vec::new(),
        }
    }

    /// Lobes of the material itself, children not counted.
    fn own_lobes(&self) -> usize {
        match self {
            Self::TwoSided { .. } | Self::Blend { .. } => 0,
            Self::Plastic(_) | Self::ThinDielectric { .. } => 2,
            _ => 1,
        }
    }

    fn transmits(&self) -> bool {
        matches!(self, Self::Dielectric { .. } | Self::ThinDielectric { .. })
    }
}

/// What is wrong with the way materials refer to each other.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MaterialError {
    #[error("the material refers to a material that does not exist")]
    Missing(MaterialId),
    #[error("the material contains itself")]
    Cycle(MaterialId),
    #[error("the material flattens to {count} lobes, at most {MAX_LOBES} are supported: nest fewer blends")]
    TooManyLobes { id: MaterialId, count: usize },
    #[error("only materials without transmission can be nested in a two-sided one")]
    TransmissiveTwoSided(MaterialId),
}

/// Checks everything about `materials` that [`evaluate`](super::evaluate) relies on.
pub fn check(materials: &[Material]) -> Result<(), MaterialError> {
    for i in 0..materials.len() {
        let id = MaterialId(i as u32);
        let count = count_lobes(materials, id, 0, false)?;
        if count > MAX_LOBES {
            return Err(MaterialError::TooManyLobes { id, count });
        }
    }
    Ok(())
}

/// Lobes of `id` with its children, following references no deeper than there are materials.
fn count_lobes(materials: &[Material], id: MaterialId, depth: usize, two_sided: bool) -> Result<usize, MaterialError> {
    if depth > materials.len() {
        return Err(MaterialError::Cycle(id));
    }
    let m = materials.get(id.0 as usize).ok_or(MaterialError::Missing(id))?;
    if two_sided && m.transmits() {
        return Err(MaterialError::TransmissiveTwoSided(id));
    }
    let below = matches!(m, Material::TwoSided { .. });
    let mut counts = m.children().into_iter().map(|c| count_lobes(materials, c, depth + 1, two_sided || below));
    let nested = match m {
        // One of the sides at a time.
        Material::TwoSided { .. } => counts.try_fold(0, |a, c| c.map(|c| c.max(a)))?,
        _ => counts.try_fold(0, |a, c| c.map(|c| a + c))?,
    };
    Ok(m.own_lobes() + nested)
}

/// True when any lobe class of `mask` could come from `id`: what a scene needs, before any point is known.
pub fn may_have(materials: &[Material], id: MaterialId, mask: LobeMask) -> bool {
    let Some(m) = materials.get(id.0 as usize) else { return false };
    let own = match m {
        Material::Diffuse { .. } => LobeMask::DIFFUSE,
        Material::Dielectric { .. } | Material::Conductor { .. } => LobeMask::DELTA,
        Material::ThinDielectric { .. } => LobeMask::DELTA | LobeMask::NULL,
        Material::Plastic(_) => LobeMask::DIFFUSE | LobeMask::DELTA,
        Material::Mask { .. } | Material::Null => LobeMask::NULL,
        Material::TwoSided { .. } | Material::Blend { .. } => LobeMask::NONE,
    };
    own.intersects(mask) || m.children().into_iter().any(|c| may_have(materials, c, mask))
}
