//! Materials: Mitsuba's BSDF plugins and their defaults.

use super::super::SceneError;
use super::super::xml::{Child, ColorUse, NodeId, Query, Tag};
use super::Loader;
use crate::bsdf::{IOR_NAMES, Ior, Material, MaterialId, ior_by_name};
use crate::color::Rgb;
use crate::texture::ColorParam;

/// Materials that one may hold, nested ones included.
const MAX_LEAVES: u32 = 64;

const BSDFS: [&str; 9] =
    ["diffuse", "dielectric", "thindielectric", "conductor", "plastic", "twosided", "mask", "blendbsdf", "null"];
const PLANNED: [&str; 28] = [
    "roughdielectric",
    "roughconductor",
    "roughplastic",
    "phong",
    "bumpmap",
    "normalmap",
    "principled",
    "principledthin",
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
    "bump",
    "dipole",
    "rmbrdf",
    "thinrough",
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
        let id = self.add_material(Material::Diffuse { reflectance: Rgb::splat(0.5).into() }, None);
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
            "diffuse" => Material::Diffuse { reflectance: self.reflectance(&q, "reflectance", 0.5)? },
            "dielectric" => {
                let (reflectance, transmittance) = self.tints(&q)?;
                Material::Dielectric { ior: ior(&q, "bk7")?, reflectance, transmittance }
            }
            "thindielectric" => {
                let (reflectance, transmittance) = self.tints(&q)?;
                Material::ThinDielectric { ior: ior(&q, "bk7")?, reflectance, transmittance }
            }
            "conductor" => {
                let (eta, k) = self.conductor(&q)?;
                Material::Conductor { eta, k, specular: self.reflectance(&q, "specular_reflectance", 1.0)? }
            }
            "plastic" => {
                let (int_ior, ext_ior) = indices(&q, "polypropylene")?;
                let diffuse = self.reflectance(&q, "diffuse_reflectance", 0.5)?;
                let specular = self.reflectance(&q, "specular_reflectance", 1.0)?;
                Material::plastic(int_ior, ext_ior, diffuse, specular, q.bool("nonlinear", false)?)
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
                match self.nested(&q, 1..=1)?[..] {
                    [nested, ..] => Material::Mask { opacity, nested },
                    [] => return Err(missing_nested(&q, 1)),
                }
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
        q.ignore(&["sample_visible"]);
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
        if let Some(name) = named {
            return Err(q.error_at("material", format!("unknown metal \"{name}\"")).help("give eta and k"));
        }
        let legacy_copper = q.node().legacy && !q.has("eta") && !q.has("material");
        let (eta, k) = if legacy_copper {
            (Rgb::new(0.2, 0.92, 1.1), Rgb::new(3.9, 2.45, 2.14))
        } else {
            (Rgb::BLACK, Rgb::WHITE)
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

fn ior(q: &Query, default: &str) -> Result<Ior, SceneError> {
    indices(q, default).map(|(int, ext)| Ior::new(int, ext))
}
