//! Radii that are kept as long as photons lie evenly within them [Lin et al. 2020, "CPPM: Chi-squared Progressive Photon
//! Mapping"].
//!
//! A density estimate in even light has no bias whatever its radius. So each pixel counts its photons in parts of the disc,
//! over as many passes as it takes, and narrows only when a χ² test finds them uneven. What the test sees is numbers of
//! photons: light of even density and uneven colour keeps its radius.
//!
//! It converges: while photons are uneven, however little, the tests at one radius have ever more of them, until one fails;
//! then the squared radius is multiplied by [`KEPT`] = k and the least number for a test by `β = k^(−α/(1 − α))`. If all tests
//! fail at once, the passes at one radius grow by `β/k = k^(−1/(1 − α))` each, so that the squared radius falls as the power
//! α − 1 of the passes, as it does without tests; it never falls faster, and noise vanishes as it would.

use super::SharedRadius;
use crate::gather::{BINS, Bins, LEAST_PHOTONS};

/// What uneven photons leave of the squared radius, `k`.
const KEPT: f64 = 0.8;

/// How many times as many photons the next test has after one that found them even. Tests at every pass would find
/// something in the end wherever they look.
const PATIENCE: f64 = 2.0;

/// The photons that one pixel has found within its present radius, of one kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evenness {
    /// Since the radius changed last.
    pub bins: Bins,
    /// Least number of photons for a test at this radius.
    pub least: f64,
    /// The next test waits for so many.
    pub next: f64,
}

/// [`Evenness`] as numbers.
pub const NUMBERS: usize = BINS + 2;

impl Default for Evenness {
    /// Before the first pass.
    fn default() -> Self {
        Self { bins: Bins::default(), least: LEAST_PHOTONS as f64, next: LEAST_PHOTONS as f64 }
    }
}

impl Evenness {
    /// Takes in the photons of a pass, and narrows `radius` if all those so far are uneven. `alpha` bounds how fast.
    pub fn update(&mut self, found: &Bins, radius: &mut SharedRadius, alpha: f64) {
        for (sum, &count) in self.bins.0.iter_mut().zip(&found.0) {
            *sum = sum.saturating_add(count);
        }
        let photons = self.bins.total() as f64;
        if photons < self.next || alpha >= 1.0 {
            return;
        }
        if self.bins.uneven() {
            radius.radius_sq = (f64::from(radius.radius_sq) * KEPT) as f32;
            let least = self.least * KEPT.powf(-alpha / (1.0 - alpha));
            *self = Self { bins: Bins::default(), least, next: least };
        } else {
            self.next = PATIENCE * photons;
        }
    }

    /// For a checkpoint.
    pub(crate) fn numbers(&self) -> [f64; NUMBERS] {
        std::array::from_fn(|i| match i {
            0 => self.least,
            1 => self.next,
            _ => f64::from(self.bins.0[i - 2]),
        })
    }

    /// From a checkpoint.
    pub(crate) fn from_numbers(n: &[f64; NUMBERS]) -> Self {
        Self { bins: Bins(std::array::from_fn(|i| n[i + 2] as u32)), least: n[0], next: n[1] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::mix64;

    fn uniform(i: u64) -> f64 {
        (mix64(i) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// `count` photons in a disc whose density grows by `slope` from one side to the other, by numbers of the stream `seed`.
    fn photons(seed: u64, count: u64, slope: f64) -> Bins {
        let mut bins = Bins::default();
        let mut n = seed << 32;
        let mut kept = 0;
        while kept < count {
            let (x, y) = (2.0 * uniform(n) - 1.0, 2.0 * uniform(n + 1) - 1.0);
            let d_sq = x * x + y * y;
            if d_sq < 1.0 && 2.0 * uniform(n + 2) < 1.0 + slope * x {
                bins.count((x < 0.0, y < 0.0), d_sq as f32, 1.0);
                kept += 1;
            }
            n += 3;
        }
        bins
    }

    const PIXEL: SharedRadius = SharedRadius { radius_sq: 1.0, photons: 0.0 };
    const ALPHA: f64 = 2.0 / 3.0;

    /// Of 20 000 pixels with 100 even photons 1 % fail, within 4 σ of the binomial (0.28 %) and what χ² is off at 12.5
    /// expected photons a part (0.1 %).
    #[test]
    fn even_photons_fail_as_rarely_as_the_level_says() {
        const PIXELS: u64 = 20_000;
        let narrowed = (0..PIXELS).filter(|&seed| {
            let mut radius = PIXEL;
            Evenness::default().update(&photons(seed, 100, 0.0), &mut radius, ALPHA);
            radius.radius_sq < 1.0
        });
        let rate = narrowed.count() as f64 / PIXELS as f64;
        assert!((rate - 0.01).abs() < 0.0038, "{rate}");
    }

    /// 100 passes of 20 photons have 6 tests at 40, 80, … 1280: 6 % of the pixels narrow at least once. 4 σ of 2000 pixels
    /// are 2.1 %; tests of the same photons are not independent, which makes fewer fail.
    #[test]
    fn even_photons_keep_their_radius_over_many_passes() {
        const PIXELS: u64 = 2_000;
        let narrowed = (0..PIXELS).filter(|&seed| {
            let (mut radius, mut tests) = (PIXEL, Evenness::default());
            for pass in 0..100 {
                tests.update(&photons(100 * seed + pass, 20, 0.0), &mut radius, ALPHA);
            }
            radius.radius_sq < 1.0
        });
        let rate = narrowed.count() as f64 / PIXELS as f64;
        assert!(rate < 0.08, "{rate}");
    }

    /// However small the slope, photons enough show it, and the radius falls for good; density in the disc falls with it.
    #[test]
    fn uneven_photons_narrow_the_radius() {
        for slope in [0.2, 1.0] {
            let (mut radius, mut tests) = (PIXEL, Evenness::default());
            let mut passes = 0;
            while radius.radius_sq > 0.5 && passes < 1000 {
                let r_sq = f64::from(radius.radius_sq);
                tests.update(&photons(passes, (200.0 * r_sq) as u64, slope * r_sq.sqrt()), &mut radius, ALPHA);
                passes += 1;
            }
            assert!(passes < 200, "slope {slope}: {passes} passes");
        }
    }

    /// Where every test fails the squared radius goes with the passes as its schedule does, by the power α − 1.
    #[test]
    fn the_radius_falls_no_faster_than_without_tests() {
        for alpha in [0.5, ALPHA, 0.75] {
            let (mut radius, mut tests) = (PIXEL, Evenness::default());
            let mut passes = [0.0f64; 2];
            let mut photons = 0.0;
            // All photons on one side: the worst there is.
            for pass in 1..200_000 {
                photons += 40.0 * f64::from(radius.radius_sq);
                let count = photons as u32;
                photons -= f64::from(count);
                tests.update(&Bins([count, 0, 0, 0, 0, 0, 0, 0]), &mut radius, alpha);
                for (passes, limit) in passes.iter_mut().zip([0.3, 0.3 * KEPT.powi(6)]) {
                    if *passes == 0.0 && f64::from(radius.radius_sq) < limit {
                        *passes = f64::from(pass);
                    }
                }
            }
            let slope = 6.0 * KEPT.ln() / (passes[1] / passes[0]).ln();
            assert!((slope - (alpha - 1.0)).abs() < 0.03, "α {alpha}: {slope}, {passes:?}");
        }
    }

    #[test]
    fn no_photons_and_no_shrinking_change_nothing() {
        let (mut radius, mut tests) = (PIXEL, Evenness::default());
        tests.update(&Bins::default(), &mut radius, ALPHA);
        assert_eq!(tests, Evenness::default());
        tests.update(&Bins([1000, 0, 0, 0, 0, 0, 0, 0]), &mut radius, 1.0);
        assert_eq!(radius, PIXEL);
        assert_eq!(Evenness::from_numbers(&tests.numbers()), tests);
    }
}
