//! Materials: Mitsuba's BSDF plugins and their defaults.

use super::super::SceneError;
use super::super::xml::{Child, ColorUse, NodeId, Query, Tag};
use super::Loader;
use crate::bsdf::{
    Distribution, Filling, IOR_NAMES, Ior, METAL_NAMES, Material, MaterialId, Principled, PrincipledThin, Roughness,
    ior_by_name, metal_by_name,
};
use crate::color::Rgb;
use crate::texture::{ColorParam, FloatParam, TextureId};

/// Materials that one may hold, nested ones included.
const MAX_LEAVES: u32 = 64;

const BSDFS: [&str; 17] = [
    "diffuse",
    "dielectric",
    "thindielectric",
    "roughdielectric",
    "conductor",
    "roughconductor",
    "plastic",
    "roughplastic",
    "phong",
    "principled",
    "principledthin",
    "twosided",
    "mask",
    "blendbsdf",
    "bumpmap",
    "normalmap",
    "null",
];
const PLANNED: [&str; 19] = [
    "roughdiffuse",
    "coating",
    "roughcoating",
    "ward",
    "hk",
    "irawan",
    "mixturebsdf",
    "difftrans",
    "sssbrdf",
    "hair",
    "measured",
    "measured_polarized",
    "circular",
    "polarizer",
    "retarder",
    "pplastic",
    "dipole",
    "rmbrdf",
    "bump",
];

impl<'d> Loader<'d> {
    /// The material of a node; the same node always gives the same material.
    pub(super) fn material(&mut self, node: NodeId) -> Result<MaterialId, SceneError> {
        if let Some(id) = self.material_ids.get(&node) {
            return Ok(*id);
        }
        let material = self.build_material(Query::new(self.doc, node))?;
        self.refuse_lobe_bomb(&material, node)?;
        let id = self.add_material(material, Some(node));
        self.material_ids.insert(node, id);
        Ok(id)
    }

    /// Mitsuba's default: diffuse, 0.5.
    pub(super) fn default_material(&mut self) -> MaterialId {
        if let Some(id) = self.default_material {
            return id;
        }
        let id = self.add_material(Material::Diffuse { reflectance: Rgb::splat(0.5) }, None);
        self.default_material = Some(id);
        id
    }

    fn add_material(&mut self, material: Material, node: Option<NodeId>) -> MaterialId {
        self.materials.push(material);
        self.material_nodes.push(node);
        MaterialId(self.materials.len() as u32 - 1)
    }

    /// Shared materials may nest to a tree of astronomical size: refuses it before anybody walks the tree.
    fn refuse_lobe_bomb(&mut self, material: &Material, node: NodeId) -> Result<(), SceneError> {
        let leaves = |id: &MaterialId| self.material_leaves.get(id.0 as usize).copied().unwrap_or(1);
        let count: u32 = material.children().iter().map(leaves).sum::<u32>().max(1);
        if count > MAX_LEAVES {
            return Err(SceneError::at(
                &self.doc.node(node).pos,
                format!("more than {MAX_LEAVES} materials are nested here"),
            )
            .help("nest fewer blends"));
        }
        self.material_leaves.resize(self.materials.len(), 1);
        self.material_leaves.push(count);
        Ok(())
    }

    fn build_material(&mut self, q: Query<'d>) -> Result<Material, SceneError> {
        let material = match q.plugin() {
            "diffuse" => Material::diffuse(self.reflectance(&q, "reflectance", 0.5)?),
            "dielectric" => {
                let (reflectance, transmittance) = self.tints(&q)?;
                Material::Dielectric { ior: ior(&q, "bk7")?, filling: filling(&q)?, reflectance, transmittance }
            }
            "roughdielectric" => {
                let (reflectance, transmittance) = self.tints(&q)?;
                Material::RoughDielectric {
                    roughness: self.roughness(&q)?,
                    ior: ior(&q, "bk7")?,
                    filling: filling(&q)?,
                    reflectance,
                    transmittance,
                }
            }
            "thindielectric" => {
                let (reflectance, transmittance) = self.tints(&q)?;
                Material::ThinDielectric { ior: ior(&q, "bk7")?, reflectance, transmittance }
            }
            "conductor" => {
                let (eta, k) = self.conductor(&q)?;
                Material::Conductor { eta, k, specular: self.reflectance(&q, "specular_reflectance", 1.0)? }
            }
            "roughconductor" => {
                let (eta, k) = self.conductor(&q)?;
                let specular = self.reflectance(&q, "specular_reflectance", 1.0)?;
                Material::RoughConductor { roughness: self.roughness(&q)?, eta, k, specular }
            }
            "plastic" | "roughplastic" => {
                let (int_ior, ext_ior) = indices(&q, "polypropylene")?;
                let diffuse = self.reflectance(&q, "diffuse_reflectance", 0.5)?;
                let specular = self.reflectance(&q, "specular_reflectance", 1.0)?;
                let nonlinear = q.bool("nonlinear", false)?;
                if q.plugin() == "plastic" {
                    Material::plastic(int_ior, ext_ior, diffuse, specular, nonlinear)
                } else {
                    let coat = self.plastic_coat(&q)?;
                    Material::rough_plastic(coat, (int_ior, ext_ior), diffuse, specular, nonlinear)
                }
            }
            "phong" => Material::Phong {
                diffuse: self.reflectance(&q, "diffuse_reflectance", 0.5)?,
                specular: self.reflectance(&q, "specular_reflectance", 0.2)?,
                exponent: self.float_param(&q, "exponent", 30.0, 0.0..=1e9)?,
            },
            "principled" => self.principled(&q)?,
            "principledthin" => self.principled_thin(&q)?,
            "bumpmap" => {
                let height = self.only_texture(&q)?;
                // The scene's scale is multiplied in when it is known.
                let scale = q.float_or("scale", 1.0)? as f32;
                q.ignore(&["flip_invalid_normals", "use_shadowing_function"]);
                Material::BumpMap { height: FloatParam::Texture(height), scale, nested: self.one_nested(&q)? }
            }
            "normalmap" => {
                let normals = match q.has("normalmap") || !q.node().legacy {
                    true if !q.has("normalmap") => {
                        return Err(q.error("the normalmap has no \"normalmap\"").help("add a texture of that name"));
                    }
                    true => self.color_param(&q, "normalmap", Rgb::splat(0.5), ColorUse::Unbounded)?,
                    false => ColorParam::Texture(self.only_texture(&q)?),
                };
                q.ignore(&["flip_invalid_normals", "use_shadowing_function"]);
                Material::NormalMap { normals, nested: self.one_nested(&q)? }
            }
            "twosided" => {
                q.ignore(&["allow_transmission"]);
                match self.nested(&q, 1..=2)?[..] {
                    [front, back] => Material::TwoSided { front, back },
                    [both, ..] => Material::TwoSided { front: both, back: both },
                    [] => return Err(missing_nested(&q, 1)),
                }
            }
            "mask" => {
                let opacity = self.float_param(&q, "opacity", 0.5, 0.0..=1.0)?;
                Material::Mask { opacity, nested: self.one_nested(&q)? }
            }
            "blendbsdf" => {
                if !q.has("weight") {
                    return Err(q
                        .error("the blendbsdf has no \"weight\"")
                        .help("add a float or a texture of that name"));
                }
                let weight = self.float_param(&q, "weight", 0.5, 0.0..=1.0)?;
                match self.nested(&q, 2..=2)?[..] {
                    [first, second, ..] => Material::Blend { weight, first, second },
                    _ => return Err(missing_nested(&q, 2)),
                }
            }
            "null" => Material::Null,
            _ => return Err(q.unknown_plugin(&BSDFS, &PLANNED)),
        };
        q.ignore(&["sample_visible", "specular_sampling_weight"]);
        q.finish()?;
        Ok(material)
    }

    /// Materials nested in one, in the order of the file.
    fn nested(&mut self, q: &Query<'d>, count: std::ops::RangeInclusive<usize>) -> Result<Vec<MaterialId>, SceneError> {
        let children: Vec<&'d Child> = q.children(Tag::Bsdf);
        if children.len() < *count.start() {
            return Err(missing_nested(q, *count.start()));
        }
        if let Some(extra) = children.get(*count.end()) {
            let message = format!("one <bsdf> too many in the {} plugin \"{}\"", q.kind(), q.plugin());
            return Err(SceneError::at(&extra.pos, message).help(format!("at most {} are possible", count.end())));
        }
        children.into_iter().map(|c| self.material(c.node)).collect()
    }

    fn one_nested(&mut self, q: &Query<'d>) -> Result<MaterialId, SceneError> {
        self.nested(q, 1..=1)?.first().copied().ok_or_else(|| missing_nested(q, 1))
    }

    /// The texture of a plugin that has exactly one, under any name or none.
    fn only_texture(&mut self, q: &Query<'d>) -> Result<TextureId, SceneError> {
        match q.child(Tag::Texture)? {
            Some(child) => self.texture(child, ColorUse::Unbounded),
            None => Err(q.error(format!("the {} has no texture", q.plugin())).help("put a <texture> into it")),
        }
    }

    /// A number between 0 and 1, or a texture.
    fn unit(&mut self, q: &Query<'d>, name: &str, default: f32) -> Result<FloatParam, SceneError> {
        self.float_param(q, name, default, 0.0..=1.0)
    }

    fn roughness(&mut self, q: &Query<'d>) -> Result<Roughness, SceneError> {
        let distribution = distribution(q)?;
        let mut alpha = |name, default| self.float_param(q, name, default, 0.0..=MAX_ALPHA);
        if q.has("alpha_u") || q.has("alpha_v") {
            if let Some(name) = ["alpha_u", "alpha_v"].into_iter().find(|n| !q.has(n)) {
                return Err(q
                    .error(format!("one roughness is given without \"{name}\""))
                    .help("give alpha_u and alpha_v"));
            }
            if q.has("alpha") {
                return Err(q.error_at("alpha", "both \"alpha\" and \"alpha_u\"").help("give one of them"));
            }
            return Ok(Roughness { distribution, alpha_u: alpha("alpha_u", 0.1)?, alpha_v: alpha("alpha_v", 0.1)? });
        }
        Ok(Roughness::isotropic(distribution, alpha("alpha", 0.1)?))
    }

    /// The rough plastic's coat has the same roughness everywhere.
    fn plastic_coat(&mut self, q: &Query<'d>) -> Result<(Distribution, f32), SceneError> {
        match self.float_param(q, "alpha", 0.1, 0.0..=MAX_ALPHA)? {
            FloatParam::Const(alpha) => Ok((distribution(q)?, alpha)),
            FloatParam::Texture(_) => {
                Err(q.error_at("alpha", "a textured \"alpha\" of roughplastic").help("give a number"))
            }
        }
    }

    fn principled(&mut self, q: &Query<'d>) -> Result<Material, SceneError> {
        let eta = match (q.float("eta")?, q.float("specular")?) {
            (Some(_), Some(_)) => {
                return Err(q.error_at("eta", "both \"eta\" and \"specular\"").help("give one of them"));
            }
            (Some(eta), None) if eta > 0.0 => eta as f32,
            (Some(eta), None) => {
                return Err(q.error_at("eta", format!("\"eta\" is {eta}")).help("it must be above zero"));
            }
            (None, specular) => {
                let specular = specular.unwrap_or(0.5);
                if !(0.0..=1.0).contains(&specular) {
                    return Err(q
                        .error_at("specular", format!("\"specular\" is {specular}"))
                        .help("it must be between 0 and 1"));
                }
                Principled::eta_of_specular(specular as f32)
            }
        };
        q.ignore(&["main_specular_sampling_rate", "clearcoat_sampling_rate", "diffuse_reflectance_sampling_rate"]);
        Ok(Material::Principled(Box::new(Principled {
            base_color: self.reflectance(q, "base_color", 0.5)?,
            roughness: self.unit(q, "roughness", 0.5)?,
            anisotropic: self.unit(q, "anisotropic", 0.0)?,
            metallic: self.unit(q, "metallic", 0.0)?,
            spec_trans: self.unit(q, "spec_trans", 0.0)?,
            eta,
            spec_tint: self.unit(q, "spec_tint", 0.0)?,
            sheen: self.unit(q, "sheen", 0.0)?,
            sheen_tint: self.unit(q, "sheen_tint", 0.0)?,
            flatness: self.unit(q, "flatness", 0.0)?,
            clearcoat: self.unit(q, "clearcoat", 0.0)?,
            clearcoat_gloss: self.unit(q, "clearcoat_gloss", 0.0)?,
        })))
    }

    fn principled_thin(&mut self, q: &Query<'d>) -> Result<Material, SceneError> {
        q.ignore(&[
            "specular_reflectance_sampling_rate",
            "specular_transmittance_sampling_rate",
            "diffuse_reflectance_sampling_rate",
            "diffuse_transmittance_sampling_rate",
        ]);
        Ok(Material::PrincipledThin(Box::new(PrincipledThin {
            base_color: self.reflectance(q, "base_color", 0.5)?,
            roughness: self.unit(q, "roughness", 0.5)?,
            anisotropic: self.unit(q, "anisotropic", 0.0)?,
            spec_trans: self.unit(q, "spec_trans", 0.0)?,
            eta: self.float_param(q, "eta", 1.5, 1e-3..=1e3)?,
            spec_tint: self.unit(q, "spec_tint", 0.0)?,
            sheen: self.unit(q, "sheen", 0.0)?,
            sheen_tint: self.unit(q, "sheen_tint", 0.0)?,
            flatness: self.unit(q, "flatness", 0.0)?,
            diff_trans: self.float_param(q, "diff_trans", 0.0, 0.0..=2.0)?,
        })))
    }

    /// A colour between 0 and 1, or a texture.
    fn reflectance(&mut self, q: &Query<'d>, name: &str, default: f32) -> Result<ColorParam, SceneError> {
        self.color_param(q, name, Rgb::splat(default), ColorUse::Reflectance)
    }

    fn tints(&mut self, q: &Query<'d>) -> Result<(ColorParam, ColorParam), SceneError> {
        Ok((self.reflectance(q, "specular_reflectance", 1.0)?, self.reflectance(q, "specular_transmittance", 1.0)?))
    }

    /// (eta, k) of a named metal or as given; without either a perfect mirror.
    fn conductor(&mut self, q: &Query<'d>) -> Result<(ColorParam, ColorParam), SceneError> {
        let named = q.string("material")?.filter(|m| !m.eq_ignore_ascii_case("none"));
        if let (Some(_), true) = (named, q.has("eta") || q.has("k")) {
            return Err(q.error_at("material", "both \"material\" and \"eta\" or \"k\"").help("give one of them"));
        }
        // Without anything: a mirror in Mitsuba 3, copper in Mitsuba 0.6.
        let legacy_copper = q.node().legacy && !q.has("eta") && !q.has("k") && !q.has("material");
        let name = named.unwrap_or(if legacy_copper { "Cu" } else { "none" });
        let Some((eta, k)) = metal_by_name(name) else {
            let names: Vec<&str> = METAL_NAMES.iter().map(|m| m.0).collect();
            return Err(q.error_at("material", format!("unknown metal \"{name}\"")).suggest(name, &names));
        };
        let eta = self.color_param(q, "eta", eta, ColorUse::Unbounded)?;
        let k = self.color_param(q, "k", k, ColorUse::Unbounded)?;
        if let Some(v) = ior_value(q, "ext_eta")? {
            return self.relative(q, eta, k, v);
        }
        Ok((eta, k))
    }

    /// Mitsuba 0.6: eta and k relative to the medium outside.
    fn relative(
        &self,
        q: &Query,
        eta: ColorParam,
        k: ColorParam,
        outside: f64,
    ) -> Result<(ColorParam, ColorParam), SceneError> {
        match (eta, k) {
            (ColorParam::Const(eta), ColorParam::Const(k)) => {
                Ok(((eta / outside as f32).into(), (k / outside as f32).into()))
            }
            _ if outside == 1.0 => Ok((eta, k)),
            _ => Err(q.error_at("ext_eta", "\"ext_eta\" with a textured eta or k").help("leave it out")),
        }
    }
}

/// Microfacet slopes beyond this are of no use.
const MAX_ALPHA: f32 = 10.0;

fn distribution(q: &Query) -> Result<Distribution, SceneError> {
    let known = [("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)];
    q.choice("distribution", Distribution::Beckmann, &known)
}

fn missing_nested(q: &Query, count: usize) -> SceneError {
    q.error(format!("the {} plugin \"{}\" holds too few materials", q.kind(), q.plugin()))
        .help(format!("put {count} <bsdf> or <ref> into it"))
}

/// An index of refraction, by number or name.
fn ior_value(q: &Query, name: &str) -> Result<Option<f64>, SceneError> {
    use super::super::xml::Value;
    let value = match q.prop(name).map(|p| &p.value) {
        None => return Ok(None),
        Some(Value::String(text)) => ior_by_name(text).ok_or_else(|| {
            let names: Vec<&str> = IOR_NAMES.iter().map(|n| n.0).collect();
            q.error_at(name, format!("unknown medium \"{text}\" for \"{name}\"")).suggest(text, &names)
        })?,
        Some(_) => q.float_or(name, 1.0)?,
    };
    if !(1e-3..=1e3).contains(&value) {
        return Err(q
            .error_at(name, format!("\"{name}\" is {value}"))
            .help("an index of refraction is a number such as 1.5, or a name such as \"bk7\""));
    }
    Ok(Some(value))
}

fn indices(q: &Query, default: &str) -> Result<(f64, f64), SceneError> {
    let named = |name| ior_by_name(name).expect("the default media are in the table");
    Ok((ior_value(q, "int_ior")?.unwrap_or(named(default)), ior_value(q, "ext_ior")?.unwrap_or(named("air"))))
}

/// What a dielectric with a priority fills its shape with.
fn filling(q: &Query) -> Result<Option<Filling>, SceneError> {
    let Some(priority) = q.int_in("priority", -1_000_000..=1_000_000)? else { return Ok(None) };
    let (int_ior, ext_ior) = indices(q, "bk7")?;
    Ok(Some(Filling { priority: priority as i32, int_ior, ext_ior }))
}

fn ior(q: &Query, default: &str) -> Result<Ior, SceneError> {
    indices(q, default).map(|(int, ext)| Ior::new(int, ext))
}
