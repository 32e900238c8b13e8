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
/// pixels see most, so bias is taken to go with the radius: estimates from half the photons in half the area
/// ([`NARROW`](crate::gather::NARROW)) then have √½ of it, and 1/(1 − √½) times the difference of the two pictures is all of
/// it (Richardson's extrapolation). What precomputed irradiance adds to that is told by a picture without. It is an estimate
/// of the leading term: where there are no edges it says up to 1.7 times too much, and interpolation in an irradiance cache
/// is no part of it. Of `vcm` it is what merging within smaller radii changes. Methods without density estimates have none.
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

    /// Adds a pass with `spp` samples a pixel and its bias, where that was looked at.
    pub(super) fn add(&mut self, pass: &Image, of_pass: Option<PassBias>, spp: u64) {
        self.pixels.add(pass, spp);
        self.blocks.add(&block_means(pass), spp);
        if let (Some(bias), Some(PassBias(off))) = (&mut self.bias, of_pass) {
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

    /// Mean of (variance + bias²) / (I² + ε²) over pixels and channels, an estimate of relMSE that needs no reference. The
    /// square of the estimated bias is larger than that of the bias by its own variance, which is taken off.
    pub(super) fn relmse(&self, image: &Image) -> Option<f64> {
        if self.pixels.passes < MIN_PASSES {
            return None;
        }
        let variance = self.variance()?;
        let relative = |squares: &dyn Fn(usize, usize) -> f64| {
            let term = |(i, p): (usize, &Rgb)| -> f64 {
                let channel = |c: usize| squares(i, c) / (f64::from(p[c]).powi(2) + RELMSE_EPSILON * RELMSE_EPSILON);
                (0..3).map(channel).sum::<f64>() / 3.0
            };
            image.pixels().iter().enumerate().map(term).sum::<f64>() / image.pixels().len().max(1) as f64
        };
        let noise = relative(&|i, c| f64::from(variance[i][c]));
        let Some(bias) = &self.bias else { return Some(noise) };
        let (off, own) = (bias.pixels.mean(), bias.pixels.variance_of_mean()?);
        Some(noise + relative(&|i, c| f64::from(off[i][c]).powi(2) - f64::from(own[i][c])).max(0.0))
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

/// All of the bias over what goes with half the area of the discs.
pub(super) const EXTRAPOLATE: f32 = 1.0 / (1.0 - std::f32::consts::FRAC_1_SQRT_2);

/// The estimated bias of the picture of one pass.
pub(super) struct PassBias(Image);

impl PassBias {
    /// Of a pass without a density estimate.
    pub fn none(pass: &Image) -> Self {
        Self(Image::constant(pass.width(), pass.height(), Rgb::BLACK))
    }

    /// From a picture, the same without precomputed irradiance, and that with narrower estimates.
    pub fn of(picture: &Image, exact: &Image, narrow: &Image) -> Self {
        let mut bias = picture.clone();
        for ((b, e), n) in bias.pixels_mut().iter_mut().zip(exact.pixels()).zip(narrow.pixels()) {
            *b = b.zip(*e, |b, e| b - e).zip(e.zip(*n, |e, n| e - n), |known, step| known + EXTRAPOLATE * step);
        }
        Self(bias)
    }
}
