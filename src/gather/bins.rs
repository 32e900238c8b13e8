//! Whether photons lie evenly over the disc of an estimate: counts in parts of it, and their χ² test.

/// Sectors of each of two rings. All parts have the same area.
const SECTORS: usize = 4;

/// Parts of a disc: two rings times four sectors.
pub const BINS: usize = 2 * SECTORS;

/// Photons that a test needs: five expected in each part, so that the statistic is distributed as χ².
pub const LEAST_PHOTONS: u64 = 5 * BINS as u64;

/// 99 % quantile of χ² with 7 degrees of freedom.
const CHI_SQUARE: f64 = 18.475;

/// How many photons lie in each of [`BINS`] parts of a disc.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bins(pub [u32; BINS]);

impl Bins {
    /// Counts a photon at the squared distance `d_sq` from the middle of a disc, whose two coordinates in the tangent plane
    /// are negative or not.
    #[inline]
    pub fn count(&mut self, negative: (bool, bool), d_sq: f32, radius_sq: f32) {
        let sector = usize::from(negative.0) | usize::from(negative.1) << 1;
        self.0[sector + if 2.0 * d_sq > radius_sq { SECTORS } else { 0 }] += 1;
    }

    /// Photons in all parts.
    pub fn total(&self) -> u64 {
        self.0.iter().map(|&c| u64::from(c)).sum()
    }

    /// Pearson's statistic against photons that are uniform over the disc: `X² = Σ (n_b − n/B)² / (n/B)`, of mean B − 1 if
    /// they are.
    pub fn statistic(&self) -> f64 {
        let expected = self.total() as f64 / BINS as f64;
        self.0.iter().map(|&c| (f64::from(c) - expected).powi(2) / expected).sum()
    }

    /// Whether a χ² test at the level of 1 % finds the photons uneven [Lin et al. 2020, CPPM]; too few never are.
    pub fn uneven(&self) -> bool {
        self.total() >= LEAST_PHOTONS && self.statistic() > CHI_SQUARE
    }
}
