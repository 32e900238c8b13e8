//! Values that may vary over a surface.

use glam::Vec2;

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

/// A number that is the same everywhere, or a texture.
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

/// All textures of a scene.
#[derive(Clone, Debug, Default)]
pub struct Textures {}

impl Textures {
    /// The value of a colour parameter at a point.
    #[inline]
    pub fn color(&self, param: ColorParam, _si: &SurfaceInteraction, _geometry: &GeometrySet) -> Rgb {
        match param {
            ColorParam::Const(c) => c,
            ColorParam::Texture(_) => Rgb::BLACK,
        }
    }

    /// The value of a scalar parameter at a point.
    #[inline]
    pub fn float(&self, param: FloatParam, _si: &SurfaceInteraction, _geometry: &GeometrySet) -> f32 {
        match param {
            FloatParam::Const(v) => v,
            FloatParam::Texture(_) => 0.0,
        }
    }

    /// (∂/∂u, ∂/∂v) of a scalar parameter at a point.
    #[inline]
    pub fn gradient(&self, _param: FloatParam, _si: &SurfaceInteraction, _geometry: &GeometrySet) -> Vec2 {
        Vec2::ZERO
    }
}
