//! The firefly clamp: off unless asked for, and what it takes away is counted.

use std::ops::AddAssign;

use crate::color::Rgb;

/// A bound on the largest channel of samples, and what it has taken from them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clamp {
    /// W·m⁻²·sr⁻¹; none leaves everything as it is.
    pub limit: Option<f32>,
    /// Samples and splats that were dimmed.
    pub count: u64,
    /// What was taken from them, each channel in W·m⁻²·sr⁻¹, summed over samples.
    pub removed: [f64; 3],
}

impl Clamp {
    pub(super) fn new(limit: Option<f32>) -> Self {
        Self { limit, ..Self::default() }
    }

    /// The colour, dimmed to the limit with its hue kept.
    #[inline]
    pub(super) fn apply(&mut self, value: Rgb) -> Rgb {
        match self.limit {
            Some(limit) if value.max_channel() > limit => {
                let dimmed = value * (limit / value.max_channel());
                self.count += 1;
                for (sum, v) in self.removed.iter_mut().zip((value - dimmed).to_array()) {
                    *sum += v as f64;
                }
                dimmed
            }
            _ => value,
        }
    }
}

impl AddAssign for Clamp {
    /// Adds the counts; the limit stays.
    fn add_assign(&mut self, o: Self) {
        self.count += o.count;
        for (a, b) in self.removed.iter_mut().zip(o.removed) {
            *a += b;
        }
    }
}
