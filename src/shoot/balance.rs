use std::ops::AddAssign;

use crate::color::Rgb;

/// Where the emitted power went, in watts (scene units), per channel, in f64.
///
/// `emitted = absorbed + escaped + roulette + cut` holds to rounding. `absorbed` and `roulette` are estimates that can be
/// negative for one path: importance sampling and Russian roulette conserve power on average, not path by path.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct EnergyBalance {
    pub emitted: [f64; 3],
    /// Lost at surfaces.
    pub absorbed: [f64; 3],
    /// Left the scene.
    pub escaped: [f64; 3],
    /// Ended by Russian roulette, less what the survivors gained.
    pub roulette: [f64; 3],
    /// Still under way when the depth limit cut the path; 0 without a limit.
    pub cut: [f64; 3],
}

impl EnergyBalance {
    #[inline(always)]
    pub(super) fn add(sum: &mut [f64; 3], power: Rgb) {
        for (s, p) in sum.iter_mut().zip(power.to_array()) {
            *s += p as f64;
        }
    }

    /// Adds `before − after`, subtracted in f64 so that the terms of a path cancel exactly.
    pub(super) fn add_loss(sum: &mut [f64; 3], before: Rgb, after: Rgb) {
        for ((s, b), a) in sum.iter_mut().zip(before.to_array()).zip(after.to_array()) {
            *s += b as f64 - a as f64;
        }
    }

    /// |emitted − everything else| relative to emitted, the largest over the channels; 0 when nothing was emitted.
    pub fn relative_error(&self) -> f64 {
        (0..3)
            .filter(|&c| self.emitted[c] != 0.0)
            .map(|c| {
                let rest = self.absorbed[c] + self.escaped[c] + self.roulette[c] + self.cut[c];
                ((self.emitted[c] - rest) / self.emitted[c]).abs()
            })
            .fold(0.0, f64::max)
    }

    fn parts_mut(&mut self) -> [&mut [f64; 3]; 5] {
        [&mut self.emitted, &mut self.absorbed, &mut self.escaped, &mut self.roulette, &mut self.cut]
    }
}

impl AddAssign for EnergyBalance {
    fn add_assign(&mut self, mut o: Self) {
        for (a, b) in self.parts_mut().into_iter().zip(o.parts_mut()) {
            for c in 0..3 {
                a[c] += b[c];
            }
        }
    }
}
