//! Whether two pictures may show the same light: a test of every block of pixels.

use serde::Serialize;

use super::stats::{student_quantile, student_two_sided};
use crate::color::Rgb;
use crate::image::{BLOCK_SIZE, Image, block_means};

/// The chance that pictures of the same light are told apart by mistake, over all blocks together.
pub const SIGNIFICANCE: f64 = 0.01;

/// Relative rounding of pixels that are stored as f32, below which differences mean nothing.
const ROUNDING: f64 = 1e-6;

/// Means over blocks and the variances of those means.
#[derive(Clone, Debug)]
pub struct Blocks {
    means: Image,
    variance: Vec<Rgb>,
    /// Degrees of freedom of the variances.
    dof: f64,
}

impl Blocks {
    /// From variances over each block, as [`Doubt::block_variance`](crate::render::Doubt::block_variance) has them.
    pub fn new(image: &Image, variance: Vec<Rgb>, passes: u64) -> Self {
        Self { means: block_means(image), variance, dof: passes.saturating_sub(1).max(1) as f64 }
    }

    /// Of a picture that counts as exact.
    pub fn exact(image: &Image) -> Self {
        let means = block_means(image);
        Self { variance: vec![Rgb::BLACK; means.pixels().len()], means, dof: 1e9 }
    }

    /// From the layers of a picture: `blockvariance`, or else `variance`, as if pixels were independent. `None` of a
    /// picture without them.
    pub fn from_layers(image: &Image, passes: Option<u64>) -> Option<Self> {
        let (w, h) = (image.width(), image.height());
        let averaged = |layer: Vec<Rgb>| block_means(&Image::rgb(w, h, layer));
        let variance = if let Some(layer) = image.layer("blockvariance") {
            averaged(layer).pixels().to_vec()
        } else {
            let mean = averaged(image.layer("variance")?);
            let size = |at: u32, of: u32| (of - at * BLOCK_SIZE).min(BLOCK_SIZE);
            let mut variance = mean.pixels().to_vec();
            for (i, v) in variance.iter_mut().enumerate() {
                let (bx, by) = (i as u32 % mean.width(), i as u32 / mean.width());
                *v = *v / (size(bx, w) * size(by, h)) as f32;
            }
            variance
        };
        let dof = passes.map_or(1e9, |p| p.saturating_sub(1).max(1) as f64);
        Some(Self { means: block_means(image), variance, dof })
    }
}

/// The outcome of [`test()`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BlockTest {
    /// Block means compared, each channel for itself.
    pub tests: usize,
    /// The most surprising difference in standard errors, and the pixel at the corner of its block.
    pub largest_z: f64,
    pub at: (u32, u32),
    /// The difference that would have been too large there.
    pub limit: f64,
    /// The chance of a difference as surprising somewhere, if both pictures show the same light.
    pub p_value: f64,
    /// The pictures differ by more than noise.
    pub rejected: bool,
}

/// Welch's t-test of every block and channel, the level of each set after Šidák so that all together reject pictures of
/// the same light with probability [`SIGNIFICANCE`].
///
/// # Panics
/// If the pictures differ in size.
pub fn test(a: &Blocks, b: &Blocks) -> BlockTest {
    assert_eq!(a.variance.len(), b.variance.len(), "pictures of one size");
    let tests = 3 * a.variance.len();
    let each = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / tests.max(1) as f64);
    let (mut smallest, mut result) = (f64::INFINITY, (0.0, 0usize, 1.0));
    for i in 0..a.variance.len() {
        for c in 0..3 {
            let (ma, mb) = (f64::from(a.means.pixels()[i][c]), f64::from(b.means.pixels()[i][c]));
            let (va, vb) = (f64::from(a.variance[i][c]), f64::from(b.variance[i][c]));
            let rounding = (ROUNDING * ma.abs().max(mb.abs())).powi(2);
            let variance = va + vb + rounding;
            if variance <= 0.0 {
                continue;
            }
            let z = (ma - mb) / variance.sqrt();
            // Welch and Satterthwaite's degrees of freedom.
            let dof = ((va + vb).powi(2) / (va * va / a.dof + vb * vb / b.dof)).min(1e9);
            let dof = if dof.is_finite() { dof } else { 1e9 };
            let p = student_two_sided(z.abs(), dof);
            if p < smallest {
                (smallest, result) = (p, (z, i, dof));
            }
        }
    }
    let (largest_z, index, dof) = result;
    let columns = a.means.width().max(1);
    BlockTest {
        tests,
        largest_z,
        at: (index as u32 % columns * BLOCK_SIZE, index as u32 / columns * BLOCK_SIZE),
        limit: student_quantile(each, dof),
        p_value: if smallest <= 1.0 { -(tests as f64 * (-smallest).ln_1p()).exp_m1() } else { 1.0 },
        rejected: smallest < each,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::hash_u64;

    /// A normal number from the sum of twelve uniform ones.
    fn normal(seed: u64, index: u64) -> f64 {
        (0..12).map(|k| hash_u64(seed, 12 * index + k) as f64 / u64::MAX as f64).sum::<f64>() - 6.0
    }

    /// Block means with normal noise of standard deviation 0.01 around 1, the variance of which is known.
    fn noisy(seed: u64, shift: f64) -> Blocks {
        let means = Image::from_fn(16, 16, |x, y| {
            let i = u64::from(16 * y + x);
            let off = if i == 77 { shift } else { 0.0 };
            Rgb::from([0, 1, 2].map(|c| (1.0 + off + 0.01 * normal(seed, 3 * i + c)) as f32))
        });
        Blocks { variance: vec![Rgb::splat(1e-4); 256], means, dof: 1e6 }
    }

    /// Of 300 pairs of the same light 1 % are rejected: 3 expected, more than 10 with probability 3e-4. One block that is
    /// off by eight standard errors of the difference is found each time.
    #[test]
    fn the_test_rejects_as_often_as_it_says() {
        let rejected = (0..300).filter(|&s| test(&noisy(2 * s, 0.0), &noisy(2 * s + 1, 0.0)).rejected).count();
        assert!(rejected <= 10, "{rejected} of 300");
        for s in 0..20 {
            let t = test(&noisy(2 * s, 0.113), &noisy(2 * s + 1, 0.0));
            assert!(t.rejected && t.at == (13 * 16, 4 * 16) && t.p_value < 0.01, "{t:?}");
        }
    }

    #[test]
    fn equal_and_black_pictures_agree() {
        for value in [0.0, 1.0] {
            let exact = Blocks::exact(&Image::constant(40, 20, Rgb::splat(value)));
            let t = test(&exact, &exact);
            assert!(!t.rejected && t.largest_z == 0.0, "{t:?}");
        }
        let (one, two) = [1.0, 1.001].map(|v| Blocks::exact(&Image::constant(1, 1, Rgb::splat(v)))).into();
        assert!(test(&one, &two).rejected);
    }

    #[test]
    fn layers_give_block_variances() {
        let mut image = Image::constant(20, 16, Rgb::splat(1.0));
        assert!(Blocks::from_layers(&image, None).is_none());
        image.set_layer("variance", &[Rgb::splat(2.56); 320]);
        let b = Blocks::from_layers(&image, Some(9)).expect("a layer");
        assert!((b.variance[0].r - 0.01).abs() < 1e-6 && (b.variance[1].r - 0.04).abs() < 1e-6 && b.dof == 8.0);
        image.set_layer("blockvariance", &[Rgb::splat(0.5); 320]);
        assert_eq!(Blocks::from_layers(&image, None).expect("a layer").variance, vec![Rgb::splat(0.5); 2]);
    }
}
