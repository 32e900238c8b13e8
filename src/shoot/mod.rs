//! Photon tracing: emit, walk, deposit, in ordered batches of a fixed number of paths.

mod aimed;
mod balance;
mod chain;
mod flight;
mod guide;
mod join;
mod lanes;
mod launch;
#[cfg(test)]
mod tests;
mod visible;
mod walk;

pub use aimed::AimCounts;
pub use balance::EnergyBalance;
pub use guide::Guide;
pub use visible::{Chains, shoot_visible, tune};
pub use walk::{Deposit, MANY_EDGES, Start, Target, WalkSettings, survival};

use std::ops::AddAssign;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use self::join::{Batch, Join};
use crate::bsdf::LobeMask;
use crate::photon::Photon;
use crate::sample::{Key, Purpose};
use crate::scene::Scene;
use crate::tally::Counters;

/// Photon paths that one task traces; part of the result's definition, so that it does not depend on threads.
pub const PATHS_PER_BATCH: u64 = 4096;

/// What one call of [`shoot`] is to do.
#[derive(Clone, Copy, Debug)]
pub struct ShootSettings {
    pub seed: u64,
    pub pass: u64,
    pub target: Target,
    pub walk: WalkSettings,
    /// Photons wanted in the map. The number of emitted paths follows from a pilot and is fixed before shooting.
    pub photons: u64,
    /// Never emit more paths than this.
    pub max_paths: u64,
    /// Aim the emission of caustic photons at what focuses light.
    pub guided: bool,
}

/// What a pilot found out about emission; the same for every pass.
#[derive(Clone, Debug, Default)]
pub struct Emission {
    /// Paths to emit.
    pub paths: u64,
    guide: Option<Arc<Guide>>,
}

impl Emission {
    /// So many paths from lights chosen by their power.
    pub fn unaimed(paths: u64) -> Self {
        Self { paths, guide: None }
    }
}

/// The photons of one kind, in emission order, with what is known about how they came to be.
#[derive(Debug, Default)]
pub struct Shot {
    pub photons: Vec<Photon>,
    /// Photon paths emitted; every stored power is already divided by it. With chains, the mutated ones among them.
    pub emitted: u64,
    pub balance: EnergyBalance,
    /// Photons that could not be stored because a value was not finite or out of range.
    pub rejected: u64,
    pub counters: Counters,
    pub aimed: AimCounts,
}

impl AddAssign for Shot {
    /// Joins what comes behind.
    fn add_assign(&mut self, other: Self) {
        self.photons.extend_from_slice(&other.photons);
        self.emitted += other.emitted;
        self.balance += other.balance;
        self.rejected += other.rejected;
        self.counters += other.counters;
        self.aimed += &other.aimed;
    }
}

/// Traces photons from all lights of `scene`.
///
/// The number of emitted paths is chosen from a pilot so that about `settings.photons` are stored; it does not depend on
/// what the real paths do, so stored powers are unbiased. The result is the same for any number of threads.
pub fn shoot(scene: &Scene, settings: &ShootSettings) -> Shot {
    shoot_paths(scene, settings, &plan_emission(scene, settings))
}

/// As [`shoot`] with what a pilot found out before: many passes over one scene share one pilot.
pub fn shoot_paths(scene: &Scene, settings: &ShootSettings, emission: &Emission) -> Shot {
    let (emitted, guide) = (emission.paths, emission.guide.as_deref());
    if emitted == 0 || scene.photon_selector.is_dark() {
        return Shot::default();
    }
    let key = Key::new(settings.seed, settings.target.purpose(), settings.pass);
    let batches = emitted.div_ceil(PATHS_PER_BATCH);
    let join = Mutex::new(Join::new(batches));
    let joining = || join.lock().unwrap_or_else(PoisonError::into_inner);
    // Handed out in order, so that few wait for those before them.
    (0..batches).par_bridge().for_each(|number| {
        let spare = joining().spare();
        let new = || Batch { deposit: Deposit::new(settings.target, settings.walk, emitted), order: Vec::new() };
        let mut batch = spare.unwrap_or_else(new);
        let first = number * PATHS_PER_BATCH;
        let last = (first + PATHS_PER_BATCH).min(emitted);
        batch.deposit.photons.clear();
        batch.deposit.trace_unordered(scene, guide, key, first..last);
        (batch.order, _) = batch.deposit.order((last - first) as usize);
        joining().put(number, batch);
    });
    let join = join.into_inner().unwrap_or_else(PoisonError::into_inner);
    Shot { emitted, ..join.finish() }
}

/// Learns where to aim, if `settings` say so, and how many paths are expected to store `settings.photons` photons.
pub fn plan_emission(scene: &Scene, settings: &ShootSettings) -> Emission {
    if settings.photons == 0 || scene.photon_selector.is_dark() {
        return Emission::default();
    }
    let aims = settings.guided && settings.target == Target::Caustic;
    let guide = if aims { Guide::learn(scene, settings) } else { None };
    Emission { paths: paths_for(scene, settings, guide.as_ref()), guide: guide.map(Arc::new) }
}

/// The number of paths that is expected to store `settings.photons` photons. The pilot ends early when its paths are very
/// long: a furnace of albedo 0.999999 stores a million photons for each.
fn paths_for(scene: &Scene, settings: &ShootSettings, guide: Option<&Guide>) -> u64 {
    const PILOT: u64 = 4 * PATHS_PER_BATCH;
    const ENOUGH: u64 = 1 << 20;
    const CHUNK: u64 = 256;
    let key = Key::new(settings.seed, Purpose::Pilot, settings.target.purpose() as u64);
    let stored_by = |paths: std::ops::Range<u64>| -> u64 {
        let chunk = |first: u64| {
            let mut deposit = Deposit::new(settings.target, settings.walk, PILOT);
            deposit.trace_unordered(scene, guide, key, first..(first + CHUNK).min(paths.end));
            deposit.photons.len() as u64
        };
        let chunks = (paths.end - paths.start).div_ceil(CHUNK);
        (0..chunks).into_par_iter().map(|i| chunk(paths.start + i * CHUNK)).sum()
    };
    // As many paths again in each round as in all before.
    let (mut traced, mut stored) = (0, 0);
    while traced < PILOT && stored < ENOUGH {
        let next = (2 * traced).max(1);
        stored += stored_by(traced..next);
        traced = next;
    }
    if stored == 0 {
        // Rare at best: spend what may be spent only if something of this kind can exist at all.
        return if settings.target == Target::Caustic && !scene.may_have(LobeMask::SPECULAR) {
            0
        } else {
            settings.max_paths
        };
    }
    let wanted = (settings.photons as f64 * traced as f64 / stored as f64).ceil() as u64;
    wanted.clamp(1, settings.max_paths)
}
