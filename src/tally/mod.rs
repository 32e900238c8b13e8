//! Counts of rays, samples and look-ups.

use std::ops::AddAssign;

/// What was counted while an image was rendered. Sums commute, so threads may add them in any order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counters {
    /// Closest-hit queries of camera paths, gather rays and probes for where surfaces end.
    pub camera_rays: u64,
    /// Any-hit queries.
    pub shadow_rays: u64,
    /// Closest-hit queries of photon paths.
    pub photon_rays: u64,
    /// Density estimates made from a photon map.
    pub photon_queries: u64,
    /// Points where the irradiance cache had an answer.
    pub cache_hits: u64,
    /// Points where it had none and gather rays were traced.
    pub cache_misses: u64,
    /// Camera samples taken.
    pub samples: u64,
    /// Camera samples dropped because a channel was NaN.
    pub nan_samples: u64,
    /// Camera samples dropped because a channel was infinite.
    pub infinite_samples: u64,
}

impl Counters {
    /// All ray queries.
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.shadow_rays + self.photon_rays
    }

    /// Camera samples that were dropped.
    pub fn non_finite(&self) -> u64 {
        self.nan_samples + self.infinite_samples
    }
}

impl AddAssign for Counters {
    fn add_assign(&mut self, o: Self) {
        self.camera_rays += o.camera_rays;
        self.shadow_rays += o.shadow_rays;
        self.photon_rays += o.photon_rays;
        self.photon_queries += o.photon_queries;
        self.cache_hits += o.cache_hits;
        self.cache_misses += o.cache_misses;
        self.samples += o.samples;
        self.nan_samples += o.nan_samples;
        self.infinite_samples += o.infinite_samples;
    }
}
