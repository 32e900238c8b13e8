use crate::color::Rgb;
use crate::sample::Cdf;

/// Picks lights with probability proportional to their power, but none that emits with less than a tenth of an equal share.
///
/// The floor `1/(10 n)` keeps a dim light alive beside a bright one that may be behind a wall.
#[derive(Clone, Debug, Default)]
pub struct LightSelector {
    cdf: Cdf,
}

impl LightSelector {
    /// `powers` in W, one for each light, in their order. Lights without power are never picked.
    pub fn new(powers: impl IntoIterator<Item = Rgb>) -> Self {
        // Let the mean channel measure a light, so that a purely blue one is not undervalued.
        let clean = |p: Rgb| {
            let mean = (p.r as f64 + p.g as f64 + p.b as f64) / 3.0;
            if mean > 0.0 && mean.is_finite() { mean } else { 0.0 }
        };
        let powers: Vec<f64> = powers.into_iter().map(clean).collect();
        let total: f64 = powers.iter().sum();
        let lit = powers.iter().filter(|&&p| p > 0.0).count();
        let floor = 0.1 / lit.max(1) as f64;
        let share = |p: f64| if p > 0.0 { (p / total).max(floor) } else { 0.0 };
        Self { cdf: Cdf::new(powers.into_iter().map(share)) }
    }

    /// Lights with the probabilities `weights`, which need not add up to 1.
    pub fn of(weights: impl IntoIterator<Item = f64>) -> Self {
        Self { cdf: Cdf::new(weights) }
    }

    /// True when no light is ever picked.
    pub fn is_dark(&self) -> bool {
        self.cdf.total() <= 0.0
    }

    /// Number of lights, dark ones included.
    pub fn len(&self) -> usize {
        self.cdf.len()
    }

    /// True when there are no lights.
    pub fn is_empty(&self) -> bool {
        self.cdf.is_empty()
    }

    /// Probability of light `i`.
    #[inline]
    pub fn pmf(&self, i: usize) -> f32 {
        self.cdf.pmf(i)
    }

    /// A light and its probability. `None` when no light emits.
    #[inline(always)]
    pub fn sample(&self, u: f32) -> Option<(usize, f32)> {
        if self.len() == 1 {
            let p = self.pmf(0);
            return (p > 0.0).then_some((0, p));
        }
        self.cdf.sample(u).map(|(i, p, _)| (i, p))
    }

    /// The lights of [`LightSelector::sample`] for all of `u`, [`u32::MAX`] for none, and their probabilities.
    #[inline(always)]
    pub fn sample_all<const N: usize>(&self, u: &[f32; N], lights: &mut [u32; N], pmf: &mut [f32; N]) {
        self.cdf.sample_all(u, lights, pmf);
    }

    /// [`LightSelector::sample`] with what is left of `u`, uniform in [0, 1).
    #[inline]
    pub fn sample_remainder(&self, u: f32) -> Option<(usize, f32, f32)> {
        self.cdf.sample(u)
    }
}
