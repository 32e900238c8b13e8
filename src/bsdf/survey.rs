//! What a material can do anywhere on a surface, found before any point is known: proofs, not samples.

use super::{DELTA_ALPHA, LobeMask, Material, MaterialId, Roughness};
use crate::texture::{ColorParam, FloatParam, TextureId, Textures};

/// Roughnesses this close to a threshold count for both sides of it.
const MARGIN: f32 = 1e-4;

/// What a material can do at some point with some textures; what it says no to it does nowhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Abilities {
    /// Classes of lobes that have any weight somewhere.
    pub classes: LobeMask,
    /// Light may scatter on the back, where the geometric normal does not point.
    pub both_sides: bool,
    /// Some point may be Lambertian and nothing else.
    pub lambertian: bool,
    /// Some point may be something else.
    pub other: bool,
    /// Texture coordinates or the tangents that follow them decide something.
    pub uv: bool,
}

/// What `id` can do, nested materials included. References must have been checked.
pub fn survey(materials: &[Material], textures: &Textures, id: MaterialId) -> Abilities {
    let material = &materials[id.0 as usize];
    let mut found = Abilities {
        classes: own_classes(material, textures),
        both_sides: has_two_sides(material),
        lambertian: is_diffuse(material),
        other: !is_diffuse(material) && !matches!(material, Material::TwoSided { .. }),
        uv: texture_ids(material).into_iter().any(|id| reaches_uv(textures, id)) || has_tangent(material),
    };
    for child in parts(material, textures) {
        let part = survey(materials, textures, child);
        found.classes |= part.classes;
        found.both_sides |= part.both_sides;
        found.lambertian |= part.lambertian;
        found.other |= part.other;
        found.uv |= part.uv;
    }
    found
}

fn is_diffuse(material: &Material) -> bool {
    matches!(material, Material::Diffuse { .. } | Material::TexturedDiffuse { .. })
}

/// Nested materials that have any weight somewhere.
fn parts(material: &Material, textures: &Textures) -> Vec<MaterialId> {
    match *material {
        Material::Blend { weight, first, second } => {
            let (low, high) = textures.float_range(weight);
            let shares = [(low < 1.0, first), (high > 0.0, second)];
            shares.into_iter().filter(|(some, _)| *some).map(|(_, id)| id).collect()
        }
        Material::Mask { opacity, .. } if textures.float_range(opacity).1 <= 0.0 => Vec::new(),
        _ => material.children(),
    }
}

fn has_two_sides(material: &Material) -> bool {
    match material {
        Material::Diffuse { .. }
        | Material::TexturedDiffuse { .. }
        | Material::Conductor { .. }
        | Material::RoughConductor { .. }
        | Material::Plastic(_)
        | Material::RoughPlastic(_)
        | Material::Phong { .. } => false,
        Material::Principled(p) => p.spec_trans != FloatParam::Const(0.0),
        Material::Blend { .. } | Material::BumpMap { .. } | Material::NormalMap { .. } => false,
        Material::Dielectric { .. }
        | Material::ThinDielectric { .. }
        | Material::RoughDielectric { .. }
        | Material::PrincipledThin(_)
        | Material::TwoSided { .. }
        | Material::Mask { .. }
        | Material::Null => true,
    }
}

/// The classes between two roughnesses.
fn classes_between(low: f32, high: f32) -> LobeMask {
    let mut set = LobeMask::of_roughness(low * (1.0 - MARGIN)) | LobeMask::of_roughness(high * (1.0 + MARGIN));
    // Narrow ones are not told apart: nothing is decided by them for a whole scene.
    if set.intersects(LobeMask::GLOSSY) {
        set |= LobeMask::GLOSSY;
    }
    if set.intersects(LobeMask::DELTA) && set.intersects(LobeMask::GLOSSY) {
        set |= LobeMask::SHARP;
    }
    set
}

fn classes_of(roughness: &Roughness, textures: &Textures) -> LobeMask {
    let (u, v) = (textures.float_range(roughness.alpha_u), textures.float_range(roughness.alpha_v));
    classes_between(u.0.min(v.0), u.1.min(v.1))
}

/// `class` if a colour is anywhere above zero.
fn if_lit(textures: &Textures, color: ColorParam, class: LobeMask) -> LobeMask {
    if textures.color_range(color).1.max_channel() > 0.0 { class } else { LobeMask::NONE }
}

/// Classes of the material's own lobes that have any weight somewhere.
fn own_classes(material: &Material, textures: &Textures) -> LobeMask {
    let lit = |color: ColorParam, class| if_lit(textures, color, class);
    let (least, most) = (|p| textures.float_range(p).0, |p| textures.float_range(p).1);
    match material {
        Material::Diffuse { reflectance } => lit((*reflectance).into(), LobeMask::DIFFUSE),
        Material::TexturedDiffuse { reflectance } => lit(ColorParam::Texture(*reflectance), LobeMask::DIFFUSE),
        Material::Dielectric { reflectance, transmittance, .. } => {
            lit(*reflectance, LobeMask::DELTA) | lit(*transmittance, LobeMask::DELTA)
        }
        Material::ThinDielectric { reflectance, transmittance, .. } => {
            lit(*reflectance, LobeMask::DELTA) | lit(*transmittance, LobeMask::NULL)
        }
        Material::RoughDielectric { roughness, ior, filling, reflectance, transmittance } => {
            // Between nearly equal media the lobe becomes delta whatever its roughness; overlaps may bring any two together.
            let sharpest = least(roughness.alpha_u).min(least(roughness.alpha_v)).clamp(DELTA_ALPHA, 1.0);
            let nearly_equal = filling.is_some() || ior.m.abs() <= (1.0 + MARGIN) * 2.0 * DELTA_ALPHA / sharpest;
            let class = classes_of(roughness, textures) | if nearly_equal { LobeMask::DELTA } else { LobeMask::NONE };
            lit(*reflectance, class) | lit(*transmittance, class)
        }
        Material::Conductor { specular, .. } => lit(*specular, LobeMask::DELTA),
        Material::RoughConductor { roughness, specular, .. } => lit(*specular, classes_of(roughness, textures)),
        Material::Plastic(p) => lit(p.specular, LobeMask::DELTA) | lit(p.diffuse, LobeMask::DIFFUSE),
        Material::RoughPlastic(p) => {
            let coat = classes_between(p.facets.ax, p.facets.ax);
            lit(p.plastic.specular, coat) | lit(p.plastic.diffuse, LobeMask::DIFFUSE)
        }
        Material::Phong { diffuse, specular, exponent } => {
            let alpha = |e: f32| (2.0 / (e.max(0.0) + 2.0)).sqrt().max(DELTA_ALPHA);
            let class = classes_between(alpha(most(*exponent)), alpha(least(*exponent)));
            lit(*specular, class) | lit(*diffuse, LobeMask::DIFFUSE)
        }
        Material::Principled(p) => {
            let aspect = (1.0 - 0.9 * most(p.anisotropic).clamp(0.0, 1.0)).sqrt();
            let unit = |v: f32| v.clamp(0.0, 1.0) * v.clamp(0.0, 1.0);
            let (low, high) = (unit(least(p.roughness)) * aspect, unit(most(p.roughness)));
            let mut set = classes_between(low.max(0.001), high.max(0.001));
            if least(p.metallic) < 1.0 && least(p.spec_trans) < 1.0 {
                set |= LobeMask::DIFFUSE;
            }
            if most(p.clearcoat) > 0.0 {
                let alpha = |gloss: f32| 0.1 + (0.001 - 0.1) * gloss.clamp(0.0, 1.0);
                set |= classes_between(alpha(most(p.clearcoat_gloss)), alpha(least(p.clearcoat_gloss)));
            }
            set
        }
        Material::PrincipledThin(p) => {
            let specular = if most(p.spec_trans) > 0.0 { LobeMask::SHARP | LobeMask::GLOSSY } else { LobeMask::NONE };
            specular | if least(p.spec_trans) < 1.0 { LobeMask::DIFFUSE } else { LobeMask::NONE }
        }
        Material::Mask { opacity, .. } if least(*opacity) >= 1.0 => LobeMask::NONE,
        Material::Mask { .. } | Material::Null => LobeMask::NULL,
        Material::TwoSided { .. } | Material::Blend { .. } => LobeMask::NONE,
        Material::BumpMap { .. } | Material::NormalMap { .. } => LobeMask::NONE,
    }
}

/// Roughness along two tangents, or bent normals: the directions of the tangents matter.
fn has_tangent(material: &Material) -> bool {
    match material {
        Material::BumpMap { .. } | Material::NormalMap { .. } => true,
        Material::RoughConductor { roughness: r, .. } | Material::RoughDielectric { roughness: r, .. } => {
            r.alpha_u != r.alpha_v
        }
        Material::Principled(p) => p.anisotropic != FloatParam::Const(0.0),
        Material::PrincipledThin(p) => p.anisotropic != FloatParam::Const(0.0),
        _ => false,
    }
}

fn reaches_uv(textures: &Textures, id: TextureId) -> bool {
    textures.uses_uv(id) || textures.inner(id).any(|inner| reaches_uv(textures, inner))
}

/// The textures that the material itself looks up.
fn texture_ids(material: &Material) -> Vec<TextureId> {
    let (mut colors, mut floats): (Vec<ColorParam>, Vec<FloatParam>) = (Vec::new(), Vec::new());
    match material {
        Material::TexturedDiffuse { reflectance } => colors.push(ColorParam::Texture(*reflectance)),
        Material::Diffuse { .. } => {}
        Material::Dielectric { reflectance, transmittance, .. }
        | Material::ThinDielectric { reflectance, transmittance, .. } => colors.extend([*reflectance, *transmittance]),
        Material::RoughDielectric { roughness, reflectance, transmittance, .. } => {
            colors.extend([*reflectance, *transmittance]);
            floats.extend([roughness.alpha_u, roughness.alpha_v]);
        }
        Material::Conductor { eta, k, specular } => colors.extend([*eta, *k, *specular]),
        Material::RoughConductor { roughness, eta, k, specular } => {
            colors.extend([*eta, *k, *specular]);
            floats.extend([roughness.alpha_u, roughness.alpha_v]);
        }
        Material::Plastic(p) => colors.extend([p.diffuse, p.specular]),
        Material::RoughPlastic(p) => colors.extend([p.plastic.diffuse, p.plastic.specular]),
        Material::Phong { diffuse, specular, exponent } => {
            colors.extend([*diffuse, *specular]);
            floats.push(*exponent);
        }
        Material::Principled(p) => {
            colors.push(p.base_color);
            floats.extend([p.roughness, p.anisotropic, p.metallic, p.spec_trans, p.spec_tint, p.sheen]);
            floats.extend([p.sheen_tint, p.flatness, p.clearcoat, p.clearcoat_gloss]);
        }
        Material::PrincipledThin(p) => {
            colors.push(p.base_color);
            floats.extend([p.roughness, p.anisotropic, p.spec_trans, p.eta, p.spec_tint, p.sheen]);
            floats.extend([p.sheen_tint, p.flatness, p.diff_trans]);
        }
        Material::Mask { opacity, .. } => floats.push(*opacity),
        Material::Blend { weight, .. } => floats.push(*weight),
        Material::BumpMap { height, .. } => floats.push(*height),
        Material::NormalMap { normals, .. } => colors.push(*normals),
        Material::TwoSided { .. } | Material::Null => {}
    }
    let colors = colors.into_iter().filter_map(|p| if let ColorParam::Texture(id) = p { Some(id) } else { None });
    let floats = floats.into_iter().filter_map(|p| if let FloatParam::Texture(id) = p { Some(id) } else { None });
    colors.chain(floats).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::image::Image;
    use crate::texture::{Bitmap, BitmapSettings, Texture};

    fn diffuse(v: f32) -> Material {
        Material::Diffuse { reflectance: Rgb::splat(v) }
    }

    fn mirror() -> Material {
        Material::Conductor { eta: Rgb::BLACK.into(), k: Rgb::WHITE.into(), specular: Rgb::WHITE.into() }
    }

    fn classes(materials: &[Material], textures: &Textures) -> LobeMask {
        survey(materials, textures, MaterialId(materials.len() as u32 - 1)).classes
    }

    /// A texture of 8 × 8 zeros with one texel of `v`.
    fn speck(textures: &mut Textures, v: f32) -> FloatParam {
        let mut pixels = vec![Rgb::BLACK; 64];
        pixels[19] = Rgb::splat(v);
        let bitmap = Bitmap::new(&Image::rgb(8, 8, pixels), BitmapSettings::default());
        FloatParam::Texture(textures.add(Texture::Bitmap(bitmap)))
    }

    #[test]
    fn one_texel_of_mirror_counts_and_none_does_not() {
        let mut textures = Textures::default();
        let (some, none) = (speck(&mut textures, 0.01), speck(&mut textures, 0.0));
        for (weight, expected) in
            [(some, LobeMask::DIFFUSE | LobeMask::DELTA), (none, LobeMask::DIFFUSE), (1.0.into(), LobeMask::DELTA)]
        {
            let blend = Material::Blend { weight, first: MaterialId(0), second: MaterialId(1) };
            assert_eq!(classes(&[diffuse(0.5), mirror(), blend], &textures), expected);
        }
        let mask = |opacity| Material::Mask { opacity, nested: MaterialId(0) };
        assert_eq!(classes(&[mirror(), mask(some)], &textures), LobeMask::NULL | LobeMask::DELTA);
        assert_eq!(classes(&[mirror(), mask(1.0.into())], &textures), LobeMask::DELTA);
        assert_eq!(classes(&[mirror(), mask(none)], &textures), LobeMask::NULL);
    }

    #[test]
    fn roughness_textures_span_all_classes_between() {
        let mut textures = Textures::default();
        let alpha = speck(&mut textures, 0.5);
        let rough = |alpha: FloatParam| Material::RoughConductor {
            roughness: Roughness::isotropic(super::super::Distribution::Ggx, alpha),
            eta: Rgb::BLACK.into(),
            k: Rgb::WHITE.into(),
            specular: Rgb::WHITE.into(),
        };
        assert_eq!(classes(&[rough(alpha)], &textures), LobeMask::DELTA | LobeMask::SHARP | LobeMask::GLOSSY);
        assert_eq!(classes(&[rough(0.0601.into())], &textures), LobeMask::GLOSSY);
        // At the threshold itself both.
        assert_eq!(classes(&[rough(super::super::SHARP_ALPHA.into())], &textures), LobeMask::GLOSSY | LobeMask::SHARP);
        assert_eq!(classes(&[rough(0.0.into())], &textures), LobeMask::DELTA);
    }

    #[test]
    fn black_surfaces_can_nothing() {
        let textures = Textures::default();
        assert_eq!(classes(&[diffuse(0.0)], &textures), LobeMask::NONE);
        let coat = |s| Material::plastic(1.5, 1.0, Rgb::splat(0.5).into(), Rgb::splat(s).into(), false);
        assert_eq!(classes(&[coat(0.0)], &textures), LobeMask::DIFFUSE);
        assert_eq!(classes(&[coat(1e-6)], &textures), LobeMask::DIFFUSE | LobeMask::DELTA);
    }

    #[test]
    fn sides_and_lambertian_parts() {
        let textures = Textures::default();
        let two = Material::TwoSided { front: MaterialId(0), back: MaterialId(0) };
        let all = survey(&[diffuse(0.5), two], &textures, MaterialId(1));
        assert!(all.both_sides && all.lambertian && !all.other && !all.uv);
        let one = survey(&[diffuse(0.5)], &textures, MaterialId(0));
        assert!(!one.both_sides && one.lambertian);
        let metal = survey(&[mirror()], &textures, MaterialId(0));
        assert!(!metal.both_sides && !metal.lambertian && metal.other);
    }
}
