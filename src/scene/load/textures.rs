//! Colour and number parameters, constant or textured.

use std::collections::HashSet;
use std::ops::RangeInclusive;

use super::super::xml::{Child, ColorArg, ColorUse, NodeId, Query, Tag};
use super::super::{PicturePrediction, SceneError};
use super::{AttributeUse, Loader};
use crate::color::Rgb;
use crate::texture::{
    Bitmap, BitmapSettings, Checkerboard, ColorParam, Filter, FloatParam, MeshAttribute, Texture, TextureId, Wrap,
    uv_transform,
};

const TEXTURES: [&str; 4] = ["bitmap", "checkerboard", "mesh_attribute", "uniform"];
const PLANNED: [&str; 6] = ["volume", "gridtexture", "scale", "wireframe", "curvature", "sunsky"];

impl<'d> Loader<'d> {
    /// A colour or a texture of colours.
    pub(super) fn color_param(
        &mut self,
        q: &Query<'d>,
        name: &str,
        default: Rgb,
        usage: ColorUse,
    ) -> Result<ColorParam, SceneError> {
        match q.color_arg(name, usage)? {
            None => Ok(default.into()),
            Some(ColorArg::Value(rgb)) => Ok(rgb.into()),
            Some(ColorArg::Texture(child)) => self.texture(child, usage).map(ColorParam::Texture),
        }
    }

    /// A number within `range`, or a texture of numbers.
    pub(super) fn float_param(
        &mut self,
        q: &Query<'d>,
        name: &str,
        default: f32,
        range: RangeInclusive<f32>,
    ) -> Result<FloatParam, SceneError> {
        let value = match q.color_arg(name, ColorUse::Unbounded)? {
            None => default,
            Some(ColorArg::Value(rgb)) if rgb.r == rgb.g && rgb.g == rgb.b => rgb.r,
            Some(ColorArg::Value(rgb)) => rgb.luminance(),
            Some(ColorArg::Texture(child)) => {
                return self.texture(child, ColorUse::Unbounded).map(FloatParam::Texture);
            }
        };
        if !range.contains(&value) {
            return Err(q.error_at(name, format!("\"{name}\" is {value}")).help(format!(
                "it must be between {} and {}",
                range.start(),
                range.end()
            )));
        }
        Ok(value.into())
    }

    /// The texture of a node; the same node always gives the same texture.
    pub(super) fn texture(&mut self, child: &'d Child, usage: ColorUse) -> Result<TextureId, SceneError> {
        let node = self.doc.node(child.node);
        if node.tag != Tag::Texture {
            return Err(SceneError::at(&child.pos, format!("a <{}> where a texture is needed", node.tag.name()))
                .help("use <texture>, <rgb> or <spectrum>"));
        }
        if let Some(id) = self.texture_ids.get(&child.node) {
            return Ok(*id);
        }
        // What is declared on its own may be used in any way.
        let usage = if self.declared.contains(&child.node) { ColorUse::Unbounded } else { usage };
        let q = Query::new(self.doc, child.node);
        let texture = match q.plugin() {
            "bitmap" => self.bitmap(&q, usage)?,
            "checkerboard" => Texture::Checkerboard(Checkerboard {
                color0: self.color_param(&q, "color0", Rgb::splat(0.4), usage)?,
                color1: self.color_param(&q, "color1", Rgb::splat(0.2), usage)?,
                to_uv: uv_transform(&q.transform("to_uv")?),
            }),
            "mesh_attribute" => {
                let name = match q.string("name")? {
                    Some(name) => name.to_owned(),
                    // Mitsuba 0.6's vertexcolors.
                    None if q.node().legacy => "vertex_color".to_owned(),
                    None => {
                        return Err(q
                            .error("the mesh_attribute has no \"name\"")
                            .help("add <string name=\"name\" value=\"vertex_color\"/>"));
                    }
                };
                Texture::MeshAttribute(MeshAttribute { name, scale: q.float_or("scale", 1.0)? as f32 })
            }
            _ => return Err(q.unknown_plugin(&TEXTURES, &PLANNED)),
        };
        q.finish()?;
        let id = self.textures.add(texture);
        self.texture_ids.insert(child.node, id);
        Ok(id)
    }

    /// A texture that is declared on its own, to be referred to.
    pub(super) fn declared_texture(&mut self, child: &'d Child) -> Result<(), SceneError> {
        let q = Query::new(self.doc, child.node);
        if q.constant_spectrum(child, ColorUse::Unbounded)?.is_some() {
            return Ok(());
        }
        self.texture(child, ColorUse::Unbounded).map(|_| ())
    }

    fn bitmap(&mut self, q: &Query, usage: ColorUse) -> Result<Texture, SceneError> {
        let Some(path) = q.file("filename")? else {
            return Err(q.error("the bitmap has no \"filename\"").help("add <string name=\"filename\" value=\"…\"/>"));
        };
        let raw = q.bool("raw", false)? || (q.node().legacy && q.float("gamma")? == Some(1.0));
        q.ignore(&["format", "accel", "cache", "max_anisotropy", "channel"]);
        if q.node().legacy {
            q.ignore(&["gamma"]);
        }
        let filters = [
            ("bilinear", Filter::Bilinear),
            ("nearest", Filter::Nearest),
            ("trilinear", Filter::Bilinear),
            ("ewa", Filter::Bilinear),
        ];
        let filter = q.choice("filter_type", Filter::Bilinear, &filters[..if q.node().legacy { 4 } else { 2 }])?;
        let wraps = [("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)];
        let wrap = q.choice("wrap_mode", Wrap::Repeat, &wraps)?;
        let settings = BitmapSettings { wrap, filter, to_uv: uv_transform(&q.transform("to_uv")?) };

        if self.unused {
            crate::image::check_header(&path).map_err(|e| SceneError::at(q.pos("filename"), e.to_string()))?;
            return Ok(Texture::Bitmap(Bitmap::new(&crate::image::Image::constant(1, 1, Rgb::BLACK), settings)));
        }
        if let Some(pictures) = &mut self.pictures {
            let size = crate::image::size(&path).map_err(|e| SceneError::at(q.pos("filename"), e.to_string()))?;
            pictures.push(PicturePrediction::texture(path, size));
            return Ok(Texture::Bitmap(Bitmap::new(&crate::image::Image::constant(1, 1, Rgb::WHITE), settings)));
        }
        let options = crate::image::ReadOptions { raw, ..Default::default() };
        let image =
            crate::image::read_with(&path, &options).map_err(|e| SceneError::at(q.pos("filename"), e.to_string()))?;
        self.hash_file(&path, q.pos("filename"))?;
        if let Some((x, y)) = image.first_non_finite() {
            let message = format!("\"{}\": the pixel at column {x}, row {y} is not finite", path.display());
            return Err(SceneError::at(q.pos("filename"), message).help("repair the image"));
        }
        if usage == ColorUse::Emission && image.pixels().iter().any(|p| p.min_channel() < 0.0) {
            let message = format!("\"{}\" has negative pixels", path.display());
            return Err(SceneError::at(q.pos("filename"), message).help("light is 0 or more"));
        }
        Ok(Texture::Bitmap(Bitmap::new(&image, settings)))
    }

    /// The mesh attributes that a node asks for, with all that it contains.
    pub(super) fn attributes_below(&self, node: NodeId) -> Vec<AttributeUse> {
        let (mut seen, mut stack, mut found) = (HashSet::from([node]), vec![node], Vec::new());
        while let Some(node) = stack.pop() {
            let n = self.doc.node(node);
            if let Some(Texture::MeshAttribute(a)) = self.texture_ids.get(&node).map(|id| self.textures.get(*id)) {
                found.push(AttributeUse { name: a.name.clone(), pos: n.pos.clone() });
            }
            stack.extend(n.children.iter().map(|c| c.node).filter(|c| seen.insert(*c)));
        }
        found
    }
}
