use super::{ColorParam, FloatParam, Texture, TextureId, Textures};
use crate::color::Rgb;

impl Textures {
    /// The least and the greatest value that a colour parameter has anywhere, channel by channel; interpolation stays
    /// within them. Infinite for mesh attributes, which only a point on a mesh decides.
    pub fn color_range(&self, param: ColorParam) -> (Rgb, Rgb) {
        match param {
            ColorParam::Const(c) => (c, c),
            ColorParam::Texture(id) => match self.get(id) {
                Texture::Bitmap(b) => b.color_range(),
                Texture::Checkerboard(c) => {
                    let ((a0, b0), (a1, b1)) = (self.color_range(c.color0), self.color_range(c.color1));
                    (a0.zip(a1, f32::min), b0.zip(b1, f32::max))
                }
                Texture::MeshAttribute(_) => (Rgb::splat(f32::NEG_INFINITY), Rgb::splat(f32::INFINITY)),
            },
        }
    }

    /// The least and the greatest value that a scalar parameter has anywhere.
    pub fn float_range(&self, param: FloatParam) -> (f32, f32) {
        match param {
            FloatParam::Const(v) => (v, v),
            FloatParam::Texture(id) => {
                // Luminance is a weighted mean of the channels.
                let (low, high) = self.color_range(ColorParam::Texture(id));
                (low.min_channel(), high.max_channel())
            }
        }
    }

    /// True when a texture needs texture coordinates: everything but mesh attributes.
    pub fn uses_uv(&self, id: TextureId) -> bool {
        !matches!(self.get(id), Texture::MeshAttribute(_))
    }

    /// The textures that a texture refers to itself.
    pub fn inner(&self, id: TextureId) -> impl Iterator<Item = TextureId> {
        let params = match self.get(id) {
            Texture::Checkerboard(c) => [Some(c.color0), Some(c.color1)],
            Texture::Bitmap(_) | Texture::MeshAttribute(_) => [None, None],
        };
        params.into_iter().flatten().filter_map(|p| match p {
            ColorParam::Texture(id) => Some(id),
            ColorParam::Const(_) => None,
        })
    }
}
