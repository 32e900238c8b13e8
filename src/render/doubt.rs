use super::spread::Spread;
use crate::color::Rgb;
use crate::film::Film;
use crate::image::metrics::RELMSE_EPSILON;
use crate::image::{Image, block_means, spread_blocks};

/// Passes from which on their differences are taken for an estimate of the error.
pub const MIN_PASSES: u64 = 4;

/// What the passes of a render tell about its error: noise from how far they lie apart, and bias from how far the
/// picture moves when photon maps are read more narrowly.
///
/// A density estimate is off in proportion to the radius of its disc where the disc reaches over the edge of a surface or of
/// light, and in proportion to its square where the light is only curved [Silverman 1986, §4.3.1]. Edges are what blocks of
/// pixels see most, so bias is taken to go with the radius: estimates from half the photons in half the area then have √½ of
/// it, and 1/(1 − √½) times the difference of the two pictures is all of it (Richardson's extrapolation). What precomputed
/// irradiance adds to that is told by a picture without. It is an estimate of the leading term: where there are no edges it
/// says up to 1.7 times too much, and interpolation in an irradiance cache is no part of it. Methods without a map have none.
#[derive(Clone, Debug)]
pub struct Doubt {
    /// Of the pixels, and of the means over blocks, which notice noise that neighbours share.
    pub(super) pixels: Spread,
    pub(super) blocks: Spread,
    pub(super) bias: Option<Bias>,
}

/// The estimate of the bias, and the spread of blocks of the pictures without it.
#[derive(Clone, Debug)]
pub(super) struct Bias {
    pub(super) pixels: Spread,
    pub(super) corrected_blocks: Spread,
}

impl Doubt {
    pub(super) fn new(film: &Film, bias: bool) -> Self {
        let (w, h) = film.crop_size();
        let blocks = block_means(&Image::constant(w, h, Rgb::BLACK)).pixels().len();
        let pixels = w as usize * h as usize;
        Self {
            pixels: Spread::new(pixels),
            blocks: Spread::new(blocks),
            bias: bias.then(|| Bias { pixels: Spread::new(pixels), corrected_blocks: Spread::new(blocks) }),
        }
    }

    /// Adds a pass with `spp` samples a pixel and its bias, where it has any.
    pub(super) fn add(&mut self, pass: &Image, of_pass: Option<PassBias>, spp: u64) {
        self.pixels.add(pass, spp);
        self.blocks.add(&block_means(pass), spp);
        if let Some(bias) = &mut self.bias {
            let none = || PassBias(Image::constant(pass.width(), pass.height(), Rgb::BLACK));
            let PassBias(off) = of_pass.unwrap_or_else(none);
            let mut corrected = pass.clone();
            for (c, b) in corrected.pixels_mut().iter_mut().zip(off.pixels()) {
                *c = c.zip(*b, |c, b| c - b);
            }
            bias.pixels.add(&off, spp);
            bias.corrected_blocks.add(&block_means(&corrected), spp);
        }
    }

    /// Variance of each pixel of the mean of all passes; `None` before the second.
    pub fn variance(&self) -> Option<Vec<Rgb>> {
        self.pixels.variance_of_mean()
    }

    /// Variance of the mean over each block of pixels, as in [`block_means`]; `None` before the second pass.
    pub fn block_variance(&self) -> Option<Vec<Rgb>> {
        self.blocks.variance_of_mean()
    }

    /// The bias of each pixel; `None` unless the plan tracks it.
    pub fn bias(&self) -> Option<Vec<Rgb>> {
        Some(self.bias.as_ref()?.pixels.mean())
    }

    /// Mean over each block of the picture less its bias, and the variance of that mean; `None` unless the plan tracks
    /// bias and two passes are in.
    pub fn corrected_blocks(&self) -> Option<(Vec<Rgb>, Vec<Rgb>)> {
        let corrected = &self.bias.as_ref()?.corrected_blocks;
        Some((corrected.mean(), corrected.variance_of_mean()?))
    }

    /// Passes that are in.
    pub fn passes(&self) -> u64 {
        self.pixels.passes
    }

    /// Mean of (variance + bias²) / (I² + ε²) over pixels and channels, an estimate of relMSE that needs no reference.
    pub(super) fn relmse(&self, image: &Image) -> Option<f64> {
        if self.pixels.passes < MIN_PASSES {
            return None;
        }
        let variance = self.variance()?;
        let bias = self.bias();
        let term = |(i, (p, v)): (usize, (&Rgb, &Rgb))| {
            let b = bias.as_ref().map_or(Rgb::BLACK, |b| b[i]);
            let channel = |c: usize| {
                let (p, v, b) = (f64::from(p[c]), f64::from(v[c]), f64::from(b[c]));
                (v + b * b) / (p * p + RELMSE_EPSILON * RELMSE_EPSILON)
            };
            (channel(0) + channel(1) + channel(2)) / 3.0
        };
        let sum: f64 = image.pixels().iter().zip(&variance).enumerate().map(term).sum();
        Some(sum / image.pixels().len().max(1) as f64)
    }

    /// Adds what is known to the picture as layers: `variance` of each pixel, `blockvariance` of the mean over the
    /// block that the pixel is in, `bias` of each pixel.
    pub fn add_layers(&self, image: &mut Image) {
        if let (Some(pixels), Some(blocks)) = (self.variance(), self.block_variance()) {
            image.set_layer("variance", &pixels);
            let (w, h) = (image.width(), image.height());
            let small = block_means(&Image::constant(w, h, Rgb::BLACK));
            let blocks = Image::rgb(small.width(), small.height(), blocks);
            image.set_layer("blockvariance", spread_blocks(&blocks, w, h).pixels());
        }
        if let Some(bias) = self.bias() {
            image.set_layer("bias", &bias);
        }
    }
}

/// The estimated bias of the picture of one pass.
pub(super) struct PassBias(Image);

impl PassBias {
    /// From a picture, the same without precomputed irradiance, and that with narrower estimates.
    pub fn of(picture: &Image, exact: &Image, narrow: &Image) -> Self {
        let extrapolate = 1.0 / (1.0 - std::f32::consts::FRAC_1_SQRT_2);
        let mut bias = picture.clone();
        for ((b, e), n) in bias.pixels_mut().iter_mut().zip(exact.pixels()).zip(narrow.pixels()) {
            *b = b.zip(*e, |b, e| b - e).zip(e.zip(*n, |e, n| e - n), |known, step| known + extrapolate * step);
        }
        Self(bias)
    }
}
