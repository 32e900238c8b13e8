use crate::color::Rgb;
use crate::image::Image;

/// How far the passes of a render lie apart, pixel by pixel: sums of pass means and of their squares, each weighted by
/// the pass's samples.
///
/// Passes share no random numbers, so this holds for every method, also those whose samples are correlated within a pass
/// by a photon map; and since pass images are compared after the reconstruction filter, it covers that too.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spread {
    pub(super) weight: f64,
    pub(super) square_weight: f64,
    pub(super) passes: u64,
    pub(super) sum: Vec<[f64; 3]>,
    pub(super) square: Vec<[f64; 3]>,
}

impl Spread {
    /// Of a picture with this many pixels, without a pass.
    pub fn new(pixels: usize) -> Self {
        let zero = vec![[0.0; 3]; pixels];
        Self { weight: 0.0, square_weight: 0.0, passes: 0, sum: zero.clone(), square: zero }
    }

    /// Adds the picture of a pass with `spp` samples a pixel.
    pub fn add(&mut self, pass: &Image, spp: u64) {
        let w = spp as f64;
        for ((sum, square), pixel) in self.sum.iter_mut().zip(&mut self.square).zip(pass.pixels()) {
            for (c, v) in pixel.to_array().into_iter().enumerate() {
                sum[c] += w * v as f64;
                square[c] += w * v as f64 * v as f64;
            }
        }
        self.weight += w;
        self.square_weight += w * w;
        self.passes += 1;
    }

    /// The weighted mean of the passes; black before the first.
    pub fn mean(&self) -> Vec<Rgb> {
        let weight = self.weight.max(f64::MIN_POSITIVE);
        self.sum.iter().map(|s| Rgb::from(s.map(|v| (v / weight) as f32))).collect()
    }

    /// Squares of what the passes of equal weight have in common: products of two of them, which noise does not change on the
    /// average; `None` with fewer than two.
    pub fn squares_of_means(&self) -> Option<Vec<[f64; 3]>> {
        let pairs = self.weight * self.weight - self.square_weight;
        let pixel = |sum: &[f64; 3], square: &[f64; 3]| {
            let scale = self.square_weight / self.weight;
            [0, 1, 2].map(|c| (sum[c] * sum[c] - square[c] * scale) / pairs)
        };
        (self.passes > 1).then(|| self.sum.iter().zip(&self.square).map(|(sum, square)| pixel(sum, square)).collect())
    }

    /// Variance of the weighted mean of the passes; `None` with fewer than two.
    pub fn variance_of_mean(&self) -> Option<Vec<Rgb>> {
        if self.passes < 2 {
            return None;
        }
        // Share of the variance of one pass of weight 1 that the mean keeps, over what the sample variance misses.
        let keep = self.square_weight / (self.weight * self.weight);
        let scale = keep / (1.0 - keep);
        let pixel = |(sum, square): (&[f64; 3], &[f64; 3])| {
            let channel = |c: usize| {
                let mean = sum[c] / self.weight;
                ((square[c] / self.weight - mean * mean).max(0.0) * scale) as f32
            };
            Rgb::new(channel(0), channel(1), channel(2))
        };
        Some(self.sum.iter().zip(&self.square).map(pixel).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variance_of_the_mean_of_equal_passes() {
        let mut s = Spread::new(1);
        let values = [1.0f32, 4.0, 2.0, 5.0];
        for v in values {
            s.add(&Image::constant(1, 1, Rgb::splat(v)), 3);
        }
        // Sample variance 10/3 over four passes.
        let expected = 10.0 / 3.0 / 4.0;
        let found = s.variance_of_mean().expect("four passes").pop().expect("one pixel");
        assert!((found.g as f64 - expected).abs() < 1e-6, "{found:?}");
    }

    /// Of two passes the product; of more the mean over all pairs.
    #[test]
    fn squares_of_means_are_products_of_pairs() {
        let mut s = Spread::new(1);
        for (passes, (value, expected)) in
            [(0.5f32, None), (-1.5, Some(-0.75)), (2.0, Some(-2.75 / 3.0))].iter().enumerate()
        {
            s.add(&Image::constant(1, 1, Rgb::splat(*value)), 1);
            let found = s.squares_of_means().map(|m| m[0][1]);
            let near = found.zip(*expected).is_none_or(|(f, e): (f64, f64)| (f - e).abs() < 1e-9);
            assert!(found.is_some() == expected.is_some() && near, "{} passes: {found:?}", passes + 1);
        }
    }

    #[test]
    fn one_pass_says_nothing() {
        let mut s = Spread::new(1);
        s.add(&Image::constant(1, 1, Rgb::splat(1.0)), 1);
        assert!(s.variance_of_mean().is_none());
    }
}
