//! Values that vary over a surface: bitmaps, checkerboards, mesh attributes.
//!
//! A material or light holds [`ColorParam`]s and [`FloatParam`]s; [`Textures`] evaluates them at a point. Texture space
//! is Mitsuba's: (0, 0) is the top left corner of a bitmap, u runs right, v runs down.

mod bitmap;
mod procedural;
mod range;

use glam::{Affine2, DMat4, Mat2, Vec2};

pub use bitmap::{Bitmap, BitmapSettings, Filter, Wrap};
pub use procedural::{Checkerboard, MeshAttribute};

use crate::color::Rgb;
use crate::geometry::{GeometrySet, SurfaceInteraction};

/// Index into the [`Textures`] of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TextureId(pub u32);

/// A colour that is the same everywhere, or a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColorParam {
    Const(Rgb),
    Texture(TextureId),
}

/// A number that is the same everywhere, or a texture (of a coloured one, the luminance).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FloatParam {
    Const(f32),
    Texture(TextureId),
}

impl From<Rgb> for ColorParam {
    fn from(c: Rgb) -> Self {
        Self::Const(c)
    }
}

impl From<f32> for FloatParam {
    fn from(v: f32) -> Self {
        Self::Const(v)
    }
}

/// The closed set of textures.
#[derive(Clone, Debug)]
pub enum Texture {
    Bitmap(Bitmap),
    Checkerboard(Checkerboard),
    MeshAttribute(MeshAttribute),
}

/// Luminances over the unit uv square, to choose positions on a textured light from. Positive wherever the texture is.
#[derive(Clone, Debug, PartialEq)]
pub struct TexelGrid {
    pub width: usize,
    pub height: usize,
    /// Mean luminance of each cell, `height` rows of `width`; row 0 is at v = 0.
    pub luminance: Vec<f32>,
}

/// The part of a 4×4 Mitsuba `to_uv` matrix that acts on (u, v): its x and y rows and columns with the translation.
pub fn uv_transform(m: &DMat4) -> Affine2 {
    let (x, y, t) = (m.x_axis.as_vec4(), m.y_axis.as_vec4(), m.w_axis.as_vec4());
    Affine2::from_mat2_translation(Mat2::from_cols(Vec2::new(x.x, x.y), Vec2::new(y.x, y.y)), Vec2::new(t.x, t.y))
}

/// All textures of a scene. A texture refers only to those added before it.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    list: Vec<Texture>,
}

impl Textures {
    /// Adds a texture and says where it is.
    ///
    /// # Panics
    /// If it refers to a texture that has not been added yet, or if there are 2³² of them.
    pub fn add(&mut self, texture: Texture) -> TextureId {
        if let Texture::Checkerboard(c) = &texture {
            for param in [c.color0, c.color1] {
                if let ColorParam::Texture(id) = param {
                    assert!((id.0 as usize) < self.list.len(), "a texture may only refer to earlier ones");
                }
            }
        }
        let id = u32::try_from(self.list.len()).expect("a scene has fewer than 2³² textures");
        self.list.push(texture);
        TextureId(id)
    }

    /// Forgets the textures from `len` on.
    pub fn truncate(&mut self, len: usize) {
        self.list.truncate(len);
    }

    /// The texture behind an id.
    #[inline]
    pub fn get(&self, id: TextureId) -> &Texture {
        &self.list[id.0 as usize]
    }

    /// Number of textures.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Heap bytes of all texels.
    pub fn memory(&self) -> usize {
        let bytes = |t: &Texture| if let Texture::Bitmap(b) = t { b.memory() } else { 0 };
        self.list.iter().map(bytes).sum()
    }

    /// The value of a colour parameter at a point.
    #[inline]
    pub fn color(&self, param: ColorParam, si: &SurfaceInteraction, geometry: &GeometrySet) -> Rgb {
        match param {
            ColorParam::Const(c) => c,
            ColorParam::Texture(id) => self.eval(id, si, geometry),
        }
    }

    /// The value of a scalar parameter at a point.
    #[inline]
    pub fn float(&self, param: FloatParam, si: &SurfaceInteraction, geometry: &GeometrySet) -> f32 {
        match param {
            FloatParam::Const(v) => v,
            FloatParam::Texture(id) => self.eval_scalar(id, si, geometry),
        }
    }

    /// (∂/∂u, ∂/∂v) of a scalar parameter at a point, for bump maps. Only a bilinear bitmap has one; it is 0 inside the
    /// squares of a checkerboard and for mesh attributes, which Mitsuba does not differentiate either.
    #[inline]
    pub fn gradient(&self, param: FloatParam, si: &SurfaceInteraction, _geometry: &GeometrySet) -> Vec2 {
        match param {
            FloatParam::Const(_) => Vec2::ZERO,
            FloatParam::Texture(id) => match self.get(id) {
                Texture::Bitmap(b) => b.gradient(si.uv),
                Texture::Checkerboard(_) | Texture::MeshAttribute(_) => Vec2::ZERO,
            },
        }
    }

    /// The colour of a texture at a point.
    pub fn eval(&self, id: TextureId, si: &SurfaceInteraction, geometry: &GeometrySet) -> Rgb {
        match self.get(id) {
            Texture::Bitmap(b) => b.eval(si.uv),
            Texture::Checkerboard(c) => self.color(c.pick(si.uv), si, geometry),
            Texture::MeshAttribute(m) => m.eval(si, geometry),
        }
    }

    /// The luminance of a texture at a point; the value itself where it is grey.
    pub fn eval_scalar(&self, id: TextureId, si: &SurfaceInteraction, geometry: &GeometrySet) -> f32 {
        match self.get(id) {
            Texture::Bitmap(b) => b.eval_scalar(si.uv),
            _ => scalar(self.eval(id, si, geometry)),
        }
    }

    /// The mean of a colour parameter over texture space (over all meshes that have it, for a mesh attribute).
    pub fn mean_color(&self, param: ColorParam, geometry: &GeometrySet) -> Rgb {
        match param {
            ColorParam::Const(c) => c,
            ColorParam::Texture(id) => match self.get(id) {
                Texture::Bitmap(b) => b.mean(),
                Texture::Checkerboard(c) => {
                    0.5 * (self.mean_color(c.color0, geometry) + self.mean_color(c.color1, geometry))
                }
                Texture::MeshAttribute(m) => m.mean(geometry),
            },
        }
    }

    /// The mean of a scalar parameter, as [`Textures::mean_color`].
    pub fn mean_float(&self, param: FloatParam, geometry: &GeometrySet) -> f32 {
        match param {
            FloatParam::Const(v) => v,
            FloatParam::Texture(id) => scalar(self.mean_color(ColorParam::Texture(id), geometry)),
        }
    }

    /// Where over uv a colour parameter is bright. `None` when uv does not decide: a constant or a mesh attribute.
    pub fn texel_grid(&self, param: ColorParam) -> Option<TexelGrid> {
        let ColorParam::Texture(id) = param else { return None };
        match self.get(id) {
            Texture::Bitmap(b) => Some(b.texel_grid()),
            Texture::Checkerboard(c) => match [self.texel_grid(c.color0), self.texel_grid(c.color1)] {
                [None, None] => self.sampled_grid(c),
                _ => None, // nested bitmaps: uniform sampling is right, only noisier
            },
            Texture::MeshAttribute(_) => None,
        }
    }

    /// A checkerboard of two constants over 64 × 64 cells, each the mean of 8 × 8 points with a floor of 1 % of the
    /// brighter colour, so that no lit sliver is missed.
    fn sampled_grid(&self, c: &Checkerboard) -> Option<TexelGrid> {
        const SIDE: usize = 64;
        const POINTS: usize = 8;
        let luminance = |param| match param {
            ColorParam::Const(c) => Some(c.luminance()),
            ColorParam::Texture(_) => None,
        };
        let (l0, l1) = (luminance(c.color0)?, luminance(c.color1)?);
        let floor = 0.01 * l0.max(l1);
        let cell = |i: usize| {
            let (x, y) = ((i % SIDE) * POINTS, (i / SIDE) * POINTS);
            let point = |k: usize| {
                let p = Vec2::new((x + k % POINTS) as f32 + 0.5, (y + k / POINTS) as f32 + 0.5);
                if c.is_first(p / (SIDE * POINTS) as f32) { l0 } else { l1 }
            };
            ((0..POINTS * POINTS).map(point).sum::<f32>() / (POINTS * POINTS) as f32).max(floor)
        };
        Some(TexelGrid { width: SIDE, height: SIDE, luminance: (0..SIDE * SIDE).map(cell).collect() })
    }
}

/// Luminance, exact for greys.
#[inline]
fn scalar(c: Rgb) -> f32 {
    if c.r == c.g && c.g == c.b { c.r } else { c.luminance() }
}

#[cfg(test)]
mod tests;
