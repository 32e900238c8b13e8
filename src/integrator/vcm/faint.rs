//! Shadow rays that are worth their time: Russian roulette by what an unoccluded connection would add.

use crate::color::Rgb;
use crate::sample::{Purpose, Sampler, mix64};

/// A contribution is faint below this share of what it is compared with.
const SHARE: f32 = 0.1;

/// Decides about the shadow rays of one path.
///
/// A contribution below a reference gets its ray with a probability of their ratio, and counts that much more: its
/// expectation stays, and its variance grows by less than contribution times reference. The numbers are hashes of their own,
/// so that those of the path stay well distributed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Faint {
    bits: u64,
    reference: f32,
}

impl Faint {
    /// Takes every ray until it is told what to compare with.
    #[inline(always)]
    pub fn new(sampler: &Sampler) -> Self {
        Self { bits: sampler.bits_aside(Purpose::Connection), reference: 0.0 }
    }

    /// What was found so far, or is expected: contributions count in proportion to it.
    #[inline(always)]
    pub fn compare_with(&mut self, value: Rgb) {
        self.reference = SHARE * value.mean();
    }

    /// The contribution, or black where `visible` says no; unbiased where it is not asked.
    #[inline(always)]
    pub fn unless_occluded(&mut self, value: Rgb, visible: impl FnOnce() -> bool) -> Rgb {
        let size = value.mean();
        let mut scale = 1.0;
        // Infinities and what is not a number are left to the caller.
        if size < self.reference {
            self.bits = mix64(self.bits.wrapping_add(0x9e37_79b9_7f4a_7c15));
            let u = (self.bits >> 40) as f32 * (1.0 / 16_777_216.0);
            let probability = size / self.reference;
            if u >= probability {
                return Rgb::BLACK;
            }
            scale = 1.0 / probability;
        }
        if visible() { value * scale } else { Rgb::BLACK }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Key, Sequence};

    /// 10⁵ trials of each size; five standard errors of a mean, which all hold with a confidence of 1 − 3·10⁻⁶.
    #[test]
    fn what_is_left_out_is_made_up_for() {
        const TRIALS: u64 = 100_000;
        for part in [0.01f32, 0.2, 0.7, 0.99, 1.0, 3.0] {
            let value = Rgb::new(part, 0.0, 2.0 * part) * SHARE;
            let (mut sum, mut rays) = (0.0f64, 0u64);
            for i in 0..TRIALS {
                let sampler = Sampler::new(Sequence::Sobol, Key::new(3, Purpose::Test, 0), i);
                let mut faint = Faint::new(&sampler);
                faint.compare_with(Rgb::WHITE);
                let found = faint.unless_occluded(value, || {
                    rays += 1;
                    true
                });
                assert!(found.is_black() || found.mean() >= value.mean());
                sum += (found.mean() / value.mean()) as f64;
            }
            let p = part.min(1.0) as f64;
            let error = ((1.0 - p) / p / TRIALS as f64).sqrt();
            let (mean, share) = (sum / TRIALS as f64, rays as f64 / TRIALS as f64);
            assert!((mean - 1.0).abs() <= 5.0 * error + 1e-6, "{part}: {mean}");
            assert!((share - p).abs() <= 5.0 * error * p + 1e-6, "{part}: {share} rays");
        }
    }

    #[test]
    fn nothing_is_left_out_without_a_reference() {
        let mut faint = Faint::new(&Sampler::new(Sequence::Sobol, Key::new(3, Purpose::Test, 0), 0));
        assert_eq!(faint.unless_occluded(Rgb::splat(1e-20), || true), Rgb::splat(1e-20));
        assert_eq!(faint.unless_occluded(Rgb::WHITE, || false), Rgb::BLACK);
    }
}
