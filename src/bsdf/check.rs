use super::{LobeMask, MAX_LOBES, Material, MaterialId};
use crate::texture::FloatParam;

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

impl MaterialError {
    /// The material that is at fault.
    pub fn material(&self) -> MaterialId {
        match *self {
            Self::Missing(id) | Self::Cycle(id) | Self::TooManyLobes { id, .. } | Self::TransmissiveTwoSided(id) => id,
        }
    }
}

/// Checks everything about `materials` that [`evaluate`](super::evaluate) relies on.
pub fn check(materials: &[Material]) -> Result<(), MaterialError> {
    // 0: not seen, then the number of lobes + 1; cycles are found by a path longer than there are materials.
    let mut counts = vec![0; materials.len()];
    for i in 0..materials.len() {
        let id = MaterialId(i as u32);
        count_lobes(materials, id, 0, &mut counts)?;
        if let Material::TwoSided { front, back } = &materials[i]
            && (transmits(materials, *front) || transmits(materials, *back))
        {
            return Err(MaterialError::TransmissiveTwoSided(id));
        }
    }
    Ok(())
}

/// Lobes of `id` with its children.
fn count_lobes(
    materials: &[Material],
    id: MaterialId,
    depth: usize,
    counts: &mut [usize],
) -> Result<usize, MaterialError> {
    let m = materials.get(id.0 as usize).ok_or(MaterialError::Missing(id))?;
    if counts[id.0 as usize] > 0 {
        return Ok(counts[id.0 as usize] - 1);
    }
    if depth >= materials.len() {
        return Err(MaterialError::Cycle(id));
    }
    let mut nested = 0;
    for child in m.children().into_iter() {
        let n = count_lobes(materials, child, depth + 1, counts)?;
        // A two-sided material shows one of its sides at a time.
        nested = if matches!(m, Material::TwoSided { .. }) { n.max(nested) } else { n + nested };
    }
    let count = own_lobes(m) + nested;
    if count > MAX_LOBES {
        return Err(MaterialError::TooManyLobes { id, count });
    }
    counts[id.0 as usize] = count + 1;
    Ok(count)
}

/// The most lobes that the material itself may become, children not counted.
fn own_lobes(m: &Material) -> usize {
    match m {
        Material::TwoSided { .. } | Material::Blend { .. } => 0,
        Material::BumpMap { .. } | Material::NormalMap { .. } => 0,
        Material::Plastic(_) | Material::RoughPlastic(_) | Material::Phong { .. } => 2,
        Material::ThinDielectric { .. } => 2,
        Material::Principled(_) => 3,
        Material::PrincipledThin(_) => 4,
        _ => 1,
    }
}

/// True when light can get through the surface other than straight on past a mask. References must have been checked.
fn transmits(materials: &[Material], id: MaterialId) -> bool {
    let m = &materials[id.0 as usize];
    let own = match m {
        Material::Dielectric { .. } | Material::ThinDielectric { .. } | Material::RoughDielectric { .. } => true,
        Material::Principled(p) => p.spec_trans != FloatParam::Const(0.0),
        Material::PrincipledThin(_) => true,
        _ => false,
    };
    own || m.children().into_iter().any(|c| transmits(materials, c))
}

/// True when `id` may have lobes of a class in `mask` at some point: what a scene needs, before any point is known.
pub fn may_have(materials: &[Material], id: MaterialId, mask: LobeMask) -> bool {
    let Some(m) = materials.get(id.0 as usize) else { return false };
    let rough = LobeMask::GLOSSY | LobeMask::SHARP | LobeMask::DELTA;
    let own = match m {
        Material::Diffuse { .. } | Material::TexturedDiffuse { .. } => LobeMask::DIFFUSE,
        Material::Dielectric { .. } | Material::Conductor { .. } => LobeMask::DELTA,
        Material::ThinDielectric { .. } => LobeMask::DELTA | LobeMask::NULL,
        Material::RoughDielectric { filling: Some(_), .. } => rough,
        Material::RoughDielectric { roughness, .. } | Material::RoughConductor { roughness, .. } => {
            match (roughness.alpha_u, roughness.alpha_v) {
                (FloatParam::Const(u), FloatParam::Const(v)) => LobeMask::of_roughness(u.min(v)),
                _ => rough,
            }
        }
        Material::Plastic(_) => LobeMask::DIFFUSE | LobeMask::DELTA,
        Material::RoughPlastic(p) => LobeMask::DIFFUSE | LobeMask::of_roughness(p.facets.ax),
        Material::Phong { exponent: FloatParam::Const(n), .. } => {
            LobeMask::DIFFUSE | LobeMask::of_roughness(super::phong::roughness(*n))
        }
        Material::Phong { .. } => LobeMask::DIFFUSE | LobeMask::GLOSSY | LobeMask::SHARP,
        Material::Principled(_) | Material::PrincipledThin(_) => LobeMask::SMOOTH,
        Material::Mask { .. } | Material::Null => LobeMask::NULL,
        Material::TwoSided { .. } | Material::Blend { .. } => LobeMask::NONE,
        Material::BumpMap { .. } | Material::NormalMap { .. } => LobeMask::NONE,
    };
    own.intersects(mask) || m.children().into_iter().any(|c| may_have(materials, c, mask))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;

    fn diffuse() -> Material {
        Material::Diffuse { reflectance: Rgb::WHITE }
    }

    #[test]
    fn references_are_checked() {
        let two = |a, b| Material::TwoSided { front: MaterialId(a), back: MaterialId(b) };
        let blend = |a, b| Material::Blend { weight: 0.5.into(), first: MaterialId(a), second: MaterialId(b) };
        assert_eq!(check(&[diffuse(), two(0, 0), blend(0, 1)]), Ok(()));
        assert_eq!(check(&[diffuse(), blend(0, 7)]), Err(MaterialError::Missing(MaterialId(7))));
        assert!(matches!(check(&[blend(1, 1), blend(0, 0)]), Err(MaterialError::Cycle(_))));
        let glass = Material::Dielectric {
            ior: super::super::Ior::new(1.5, 1.0),
            filling: None,
            reflectance: Rgb::WHITE.into(),
            transmittance: Rgb::WHITE.into(),
        };
        assert_eq!(check(&[glass, two(0, 0)]), Err(MaterialError::TransmissiveTwoSided(MaterialId(1))));
        // Blends of blends double the lobes: 1, 2, 4, 8, 16; the reference chain itself is not a problem.
        let chain = [diffuse(), blend(0, 0), blend(1, 1), blend(2, 2)];
        assert_eq!(check(&chain), Ok(()));
        let chain = [diffuse(), blend(0, 0), blend(1, 1), blend(2, 2), blend(3, 3)];
        assert_eq!(check(&chain), Err(MaterialError::TooManyLobes { id: MaterialId(4), count: 16 }));
    }

    #[test]
    fn classes_are_found_through_nesting() {
        let m = [diffuse(), Material::Mask { opacity: 0.5.into(), nested: MaterialId(0) }];
        assert!(may_have(&m, MaterialId(1), LobeMask::DIFFUSE));
        assert!(may_have(&m, MaterialId(1), LobeMask::NULL));
        assert!(!may_have(&m, MaterialId(1), LobeMask::DELTA | LobeMask::GLOSSY));
    }
}
