//! Images in memory, their files (EXR, PNG, Radiance HDR, PFM; JPEG to read) and how far one image is from another.
//!
//! Pixels are linear Rec. 709 `f32` triples. Whatever else a file holds (alpha, variance, depth) is an extra
//! [`Channel`] with the name that EXR gives it: `A`, `variance.R`, `depth.Z`.

mod blocks;
mod compare;
pub mod diff;
mod error;
mod exr;
#[cfg(test)]
#[path = "tests.rs"]
mod file_tests;
pub mod flip;
mod hdr;
mod io;
mod ldr;
pub mod metrics;
mod palette;
mod pfm;
mod window;

use std::collections::BTreeMap;

pub use blocks::{BLOCK_SIZE, block_means, spread_blocks};
pub use compare::{Comparison, compare};
pub use error::{ImageError, ImageErrorKind};
pub use io::{
    Format, ImageSize, Limits, ReadOptions, WriteOptions, check_header, decode, encode, read, read_with, replace_file,
    size, write,
};
pub use palette::scale_color;
pub use window::FilmWindow;

use crate::color::Rgb;

/// One value per pixel beside the colour, under the name it has in an EXR file.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// `layer.component`, or just `component`.
    pub name: String,
    /// Row by row from the top left, as many values as the image has pixels.
    pub data: Vec<f32>,
}

/// A rectangle of linear colours with named extra channels and text about where it came from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<Rgb>,
    extra: Vec<Channel>,
    /// Text that travels in the header of an EXR or HDR file.
    pub metadata: BTreeMap<String, String>,
}

impl Image {
    /// An image from its pixels, row by row from the top left.
    ///
    /// # Panics
    /// If there are not `width · height` pixels.
    pub fn rgb(width: u32, height: u32, pixels: Vec<Rgb>) -> Self {
        assert_eq!(pixels.len(), width as usize * height as usize, "an image needs width × height pixels");
        Self { width, height, pixels, extra: Vec::new(), metadata: BTreeMap::new() }
    }

    /// An image of one colour.
    pub fn constant(width: u32, height: u32, value: Rgb) -> Self {
        Self::rgb(width, height, vec![value; width as usize * height as usize])
    }

    /// An image computed pixel by pixel from `f(x, y)`.
    pub fn from_fn(width: u32, height: u32, mut f: impl FnMut(u32, u32) -> Rgb) -> Self {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect();
        Self::rgb(width, height, pixels)
    }

    /// Pixels in a row.
    #[inline]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    #[inline]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The colour at column `x` of row `y`, counted from the top left.
    #[inline]
    pub fn pixel(&self, x: u32, y: u32) -> Rgb {
        self.pixels[y as usize * self.width as usize + x as usize]
    }

    /// All colours, row by row from the top left.
    #[inline]
    pub fn pixels(&self) -> &[Rgb] {
        &self.pixels
    }

    /// All colours, to be changed in place.
    #[inline]
    pub fn pixels_mut(&mut self) -> &mut [Rgb] {
        &mut self.pixels
    }

    /// Column and row of the first colour with a NaN or an infinity.
    pub fn first_non_finite(&self) -> Option<(u32, u32)> {
        let index = self.pixels.iter().position(|p| !p.is_finite())? as u32;
        Some((index % self.width, index / self.width))
    }

    /// The extra channels in the order in which they were added.
    pub fn channels(&self) -> &[Channel] {
        &self.extra
    }

    /// The values of an extra channel, such as `A` or `variance.R`.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.extra.iter().find(|c| c.name == name).map(|c| &c.data[..])
    }

    /// Adds an extra channel, or replaces the one of that name.
    ///
    /// # Panics
    /// If there are not `width · height` values, or the name is empty or that of a colour channel (`R`, `G`, `B`).
    pub fn set_channel(&mut self, name: impl Into<String>, data: Vec<f32>) {
        let name = name.into();
        assert_eq!(data.len(), self.pixels.len(), "channel {name} needs one value per pixel");
        assert!(!name.is_empty() && !["R", "G", "B"].contains(&&name[..]), "'{name}' cannot name an extra channel");
        match self.extra.iter_mut().find(|c| c.name == name) {
            Some(c) => c.data = data,
            None => self.extra.push(Channel { name, data }),
        }
    }

    /// A named layer of three channels `name.R`, `name.G`, `name.B`.
    pub fn layer(&self, name: &str) -> Option<Vec<Rgb>> {
        let component = |c: &str| self.channel(&format!("{name}.{c}"));
        let (r, g, b) = (component("R")?, component("G")?, component("B")?);
        Some((0..self.pixels.len()).map(|i| Rgb::new(r[i], g[i], b[i])).collect())
    }

    /// Adds a named layer of three channels `name.R`, `name.G`, `name.B`.
    ///
    /// # Panics
    /// As [`Image::set_channel`].
    pub fn set_layer(&mut self, name: &str, data: &[Rgb]) {
        self.set_channel(format!("{name}.R"), data.iter().map(|c| c.r).collect());
        self.set_channel(format!("{name}.G"), data.iter().map(|c| c.g).collect());
        self.set_channel(format!("{name}.B"), data.iter().map(|c| c.b).collect());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_and_channels_are_found_by_name() {
        let mut image = Image::from_fn(2, 2, |x, y| Rgb::new(x as f32, y as f32, 0.5));
        assert_eq!(image.pixel(1, 0), Rgb::new(1.0, 0.0, 0.5));
        image.set_channel("A", vec![1.0; 4]);
        image.set_layer("variance", &[Rgb::splat(2.0); 4]);
        assert_eq!(image.channel("variance.G"), Some(&[2.0f32; 4][..]));
        assert_eq!(image.layer("variance"), Some(vec![Rgb::splat(2.0); 4]));
        assert_eq!(image.layer("albedo"), None);
        image.set_channel("A", vec![0.0; 4]);
        assert_eq!(image.channel("A"), Some(&[0.0f32; 4][..]));
        assert_eq!(image.channels().len(), 4);
    }

    #[test]
    #[should_panic(expected = "width × height")]
    fn a_wrong_pixel_count_is_refused() {
        Image::rgb(2, 2, vec![Rgb::BLACK; 3]);
    }
}
