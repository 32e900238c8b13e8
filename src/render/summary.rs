use std::time::Instant;

use serde::Serialize;

use super::Plan;
use crate::film::Film;
use crate::integrator::vcm::Guidance;
use crate::shoot::{AimCounts, Chains, EnergyBalance, Shot, Target};
use crate::tally::Counters;

/// Seconds spent in one phase, all passes together.
#[derive(Clone, Debug, Serialize)]
pub struct Phase {
    pub name: &'static str,
    pub seconds: f64,
}

/// What went into one kind of photon map, all passes together.
#[derive(Clone, Debug, Default, Serialize)]
pub struct MapSummary {
    pub name: &'static str,
    pub emitted: u64,
    pub stored: u64,
    /// Photons that were not finite or out of range.
    pub rejected: u64,
    pub energy: EnergyBalance,
    pub energy_error: f64,
    /// What the scene file asks to aim at, counted.
    pub aimed: AimCounts,
}

/// How photon paths are sampled by what is seen of them; found by a pilot and the same for every pass.
#[derive(Clone, Debug, Serialize)]
pub struct ChainSummary {
    pub name: &'static str,
    /// Fraction of the uniform photon paths that bring light to a point that is seen.
    pub visible: f64,
    /// Uniform paths of a pass, its chains, and the mutations of each.
    pub uniform: u64,
    pub chains: u64,
    pub mutations: u64,
    /// Size of mutations (`s` in `u ± ξ^(1/s + 1)`) and the share of them that is accepted.
    pub size: f64,
    pub acceptance: f64,
}

impl ChainSummary {
    pub(super) fn new(target: Target, c: &Chains) -> Self {
        let Chains { visible, uniform, chains, mutations, size, acceptance, .. } = *c;
        Self { name: target.name(), visible, uniform, chains, mutations, size, acceptance }
    }
}

/// What the firefly clamp did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClampSummary {
    pub limit: f32,
    /// Samples and splats that were dimmed.
    pub samples: u64,
    /// Mean radiance that the picture has lost, W·m⁻²·sr⁻¹: its bias, as far as the samples show it.
    pub bias: [f64; 3],
}

impl ClampSummary {
    /// Of a film with `spp` samples a pixel; `None` without a clamp.
    pub(super) fn of(film: &Film, spp: u64) -> Option<Self> {
        let clamp = film.clamp();
        let (w, h) = film.crop_size();
        let samples = (spp * w as u64 * h as u64).max(1) as f64;
        clamp.limit.map(|limit| Self { limit, samples: clamp.count, bias: clamp.removed.map(|v| -v / samples) })
    }
}

/// What is known about a render after it.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    pub integrator: &'static str,
    pub seed: u64,
    pub spp: u64,
    pub passes: u64,
    pub phases: Vec<Phase>,
    pub maps: Vec<MapSummary>,
    /// Empty where photon paths know nothing of each other.
    pub chains: Vec<ChainSummary>,
    pub counters: Counters,
    /// Bytes of the largest set of photon maps held at once.
    pub photon_memory: usize,
    /// Records of the irradiance caches.
    pub cache_records: u64,
    pub interrupted: bool,
    /// Only with a firefly clamp.
    pub clamp: Option<ClampSummary>,
    /// Only of the bidirectional methods, where a light can be guided.
    pub light_paths: Option<Guidance>,
    /// Light paths for each camera path, only of the bidirectional methods.
    pub light_paths_per_sample: Option<u32>,
    /// The render's own estimate of its relMSE, where the plan tracks the error.
    pub estimated_relmse: Option<f64>,
}

impl Summary {
    pub(super) fn new(plan: &Plan) -> Self {
        Self { integrator: plan.method.name(), seed: plan.seed, ..Self::default() }
    }

    /// Runs `work` and adds its time to the phase `name`.
    pub fn time<R>(&mut self, name: &'static str, work: impl FnOnce() -> R) -> R {
        let started = Instant::now();
        let result = work();
        self.add_phase(name, started.elapsed().as_secs_f64());
        result
    }

    /// Adds seconds to a phase.
    pub fn add_phase(&mut self, name: &'static str, seconds: f64) {
        match self.phases.iter_mut().find(|p| p.name == name) {
            Some(p) => p.seconds += seconds,
            None => self.phases.push(Phase { name, seconds }),
        }
    }

    /// Seconds of all phases whose name is `name`.
    pub fn seconds(&self, name: &str) -> f64 {
        self.phases.iter().filter(|p| p.name == name).map(|p| p.seconds).sum()
    }

    pub(super) fn add_shot(&mut self, target: Target, shot: &Shot) {
        self.counters += shot.counters;
        let name = target.name();
        let index = self.maps.iter().position(|m| m.name == name).unwrap_or_else(|| {
            self.maps.push(MapSummary { name, ..MapSummary::default() });
            self.maps.len() - 1
        });
        let map = &mut self.maps[index];
        map.emitted += shot.emitted;
        map.stored += shot.photons.len() as u64;
        map.rejected += shot.rejected;
        map.energy += shot.balance;
        map.aimed += &shot.aimed;
        map.energy_error = map.energy.relative_error();
    }
}
