//! Photon paths where the picture needs them: Markov chains among the paths that have a photon in sight
//! [Hachisuka and Jensen 2011, "Robust adaptive photon tracing using photon path visibility"].
//!
//! The target is V(u) = 1 where a path of random numbers u stores a photon that adds to the picture of the pass, and 0
//! elsewhere. With b = ∫V and f what a path adds, the picture is ∫f = b·E[f | V = 1]. A pass does this:
//!
//! 1. It traces N uniform paths. K of them are seen; K/N estimates b.
//! 2. C chains start from paths among those K, every one taken C/K times on average, and make the same number of mutations.
//! 3. Photons of uniform paths count w/N, those of each state of a chain (1 − w)·(K/N) over the number of all states, and
//!    photons that nobody sees are not stored.
//!
//! **Replica exchange.** Hachisuka and Jensen run one chain beside a chain of uniform paths, and let the two exchange their
//! states whenever the uniform path is seen: the ratio of targets is then 1. What the chain had before is forgotten by the
//! uniform one. Between two exchanges the chain depends on nothing but the path it was given. So the chain is cut there:
//! each piece starts from a uniform path that is seen, pieces are independent given their starts, and their mean length, 1/b
//! in the paper, is fixed in place of random. They run in parallel, in any order, and no pass needs those before it.
//!
//! **Bias.** There is none, for any number of photons. The start of a chain is chosen evenly among the K, so for any set of
//! uniform paths `K/N·E[g(X₀)] = (1/N) Σ V(uᵢ) g(uᵢ)`, whose mean is ∫V·g as long as each path is uniform, stratified or
//! not. With g = Pᵗf, P being a mutation with its acceptance, which leaves the uniform density on V = 1 as it is, the same
//! holds after t steps: the mean of `K/N·f(X_t)` is ∫f. No burn-in is needed, and the product of the two estimates is not
//! biased although both come from the same paths. A pass with K = 0 has no photons, rightly: it estimates b = 0. This needs
//! N, C, the number of mutations, their size and w to be fixed before the pass. A pilot chooses them, once for all passes,
//! and no photon of the pilot gets into the picture. (Adapting the size while a chain runs, as in the paper, is right in the
//! limit only.) What is left is the bias of the estimates by density, which photons of all origins share.
//!
//! **Noise.** It is that of chains: neighbouring pixels err together, and K/N, which multiplies all of a pass, has the
//! relative deviation 1/√K.

use rayon::prelude::*;

use super::chain::{Chain, Found, scaled};
use super::walk::Deposit;
use super::{Emission, PATHS_PER_BATCH, ShootSettings, Shot};
use crate::photon::Photon;
use crate::sample::{Key, Purpose, hash_u64};
use crate::scene::Scene;
use crate::tally::Counters;

/// The share of mutations to be accepted [Hachisuka and Jensen 2011, §4.3, after Roberts et al. 1997].
const ACCEPTANCE: f64 = 0.234;

/// Rounds in which the pilot adapts the size of mutations; the second half of them is averaged.
const ROUNDS: u32 = 32;

/// Chains of the pilot, and mutations of each in a round.
const PILOT_CHAINS: u64 = 64;
const PILOT_MUTATIONS: u64 = 16;

/// The pilot looks for so many paths that are seen, among this many times the paths of a pass at most.
const ENOUGH: usize = 64;
const MOST_TIMES: u64 = 8;

/// Chains of a pass at least, so that all threads have some.
const LEAST_CHAINS: u64 = 64;

/// The largest `s`: steps of nearly any length are then equally probable.
const LARGEST: f64 = 32.0;
const SMALLEST: f64 = 1.0 / 64.0;

/// How a pass divides its photon paths; found by [`tune`] and the same for every pass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chains {
    /// Uniform paths of a pass, `N`.
    pub uniform: u64,
    /// Chains of a pass, `C`.
    pub chains: u64,
    /// Mutations of each chain.
    pub mutations: u64,
    /// The size of mutations, `s` in `u' = u ± ξ^(1/s + 1)`.
    pub size: f64,
    /// What uniform paths count of the picture, `w`.
    pub share: f64,
    /// Fraction of the uniform paths of the pilot that were seen: about `b`.
    pub visible: f64,
    /// Share of the pilot's mutations that were accepted at this size.
    pub acceptance: f64,
}

/// The photons of uniform paths that are seen.
#[derive(Default)]
struct Uniform {
    shot: Shot,
    /// Paths that stored them.
    seen: Vec<u64>,
}

/// Traces the uniform paths `paths` of a shoot of `emitted`.
fn uniform_paths<S: Fn(&Photon) -> bool + Sync>(
    scene: &Scene,
    settings: &ShootSettings,
    emission: &Emission,
    (key, emitted): (Key, u64),
    paths: std::ops::Range<u64>,
    sees: &S,
) -> Uniform {
    let batches = (paths.end - paths.start).div_ceil(PATHS_PER_BATCH);
    let batch = |batch: u64| {
        let first = paths.start + batch * PATHS_PER_BATCH;
        let last = (first + PATHS_PER_BATCH).min(paths.end);
        let mut deposit = Deposit::new(settings.target, settings.walk, emitted);
        let ends = deposit.trace_all(scene, emission.guide.as_deref(), key, first..last);
        let (mut photons, mut seen) = (Vec::new(), Vec::new());
        let mut begin = 0;
        for (path, end) in (first..).zip(ends) {
            let before = photons.len();
            photons.extend(deposit.photons[begin..end as usize].iter().filter(|photon| sees(photon)));
            if photons.len() > before {
                seen.push(path);
            }
            begin = end as usize;
        }
        Uniform { shot: Shot { photons, ..deposit.take() }, seen }
    };
    // Join the batches in the order of their paths.
    let all: Vec<Uniform> = (0..batches).into_par_iter().map(batch).collect();
    let mut sum = Uniform::default();
    for uniform in all {
        sum.shot += uniform.shot;
        sum.seen.extend_from_slice(&uniform.seen);
    }
    sum
}

/// Finds out how a pass had better divide its paths, from the photons that a pilot's camera paths see.
///
/// Of E paths, N = E/(2 − b) are uniform and the others mutations: one for each uniform path that is not seen, as in the
/// paper. There are as many chains as uniform paths are seen, but some at least.
pub fn tune<S: Fn(&Photon) -> bool + Sync>(
    scene: &Scene,
    settings: &ShootSettings,
    emission: &Emission,
    sees: &S,
) -> (Chains, Counters) {
    let paths = emission.paths;
    if paths == 0 || scene.photon_selector.is_dark() {
        return (Chains::default(), Counters::default());
    }
    // Trace uniform paths, as many again in each round as in all before, until enough are seen.
    let key = Key::new(settings.seed, Purpose::Pilot, hash_u64(settings.target.purpose() as u64, 2));
    let (mut traced, mut seen, mut counters) = (0, Vec::new(), Counters::default());
    while seen.len() < ENOUGH && traced < MOST_TIMES.saturating_mul(paths) {
        let next = (2 * traced).max(paths);
        let uniform = uniform_paths(scene, settings, emission, (key, 1), traced..next, sees);
        seen.extend(uniform.seen);
        counters += uniform.shot.counters;
        traced = next;
    }
    // No number of paths proves that none or all are seen.
    let visible = (seen.len() as f64 + 0.5) / (traced as f64 + 1.0);
    let uniform = ((paths as f64 / (2.0 - visible)).ceil() as u64).clamp(1, paths);
    let expected = (uniform as f64 * visible) as u64;
    let mutated = paths - uniform;
    let chains = expected.max(LEAST_CHAINS).min(mutated);
    let mutations = mutated.checked_div(chains).unwrap_or(0);
    let mut plan = Chains { uniform, chains, mutations, size: 1.0, share: 1.0, visible, acceptance: 0.0 };
    if mutations == 0 {
        return (Chains { chains: 0, ..plan }, counters);
    }
    if !seen.is_empty() {
        counters += adapt(scene, settings, emission, key, &seen, sees, &mut plan);
    }
    // States of a chain that it stays in tell no more than one: weigh them as their acceptance says.
    let (of_uniform, of_chains) = (visible * uniform as f64, plan.acceptance * (chains * mutations) as f64);
    plan.share = if of_chains > 0.0 { of_uniform / (of_uniform + of_chains) } else { 0.5 };
    (plan, counters)
}

/// Adapts the size of mutations until their acceptance is what it should be [Robbins and Monro 1951, on ln s].
fn adapt<S: Fn(&Photon) -> bool + Sync>(
    scene: &Scene,
    settings: &ShootSettings,
    emission: &Emission,
    uniform: Key,
    seen: &[u64],
    sees: &S,
    plan: &mut Chains,
) -> Counters {
    let mut counters = Counters::default();
    let (mut ln_size, mut late, mut accepted) = (0.0f64, 0.0, 0);
    let half = ROUNDS / 2;
    for round in 0..ROUNDS {
        let key = Key::new(settings.seed, Purpose::Chain, hash_u64(settings.target.purpose() as u64, round as u64 + 1));
        let mutations = PILOT_MUTATIONS;
        let size = ln_size.exp();
        let guide = emission.guide.as_deref();
        let sequence = settings.walk.sequence;
        let chain = Chain { scene, guide, sees, uniform, sequence, key, size, mutations, scale: 1.0 };
        let found: Vec<Found> = (0..PILOT_CHAINS)
            .into_par_iter()
            .map(|c| {
                let start = seen[((c + round as u64 * PILOT_CHAINS) % seen.len() as u64) as usize];
                chain.run(c, start, settings.walk, 1, settings.target)
            })
            .collect();
        let taken: u64 = found.iter().map(|f| f.accepted).sum();
        found.iter().for_each(|f| counters += f.deposit.counters);
        let rate = taken as f64 / (PILOT_CHAINS * mutations) as f64;
        if round >= half {
            late += ln_size / (ROUNDS - half) as f64;
            accepted += taken;
        }
        ln_size += 12.0 / (round as f64 + 2.0).powf(0.7) * (rate - ACCEPTANCE);
        ln_size = ln_size.clamp(SMALLEST.ln(), LARGEST.ln());
    }
    plan.size = late.exp();
    plan.acceptance = accepted as f64 / ((ROUNDS - half) as u64 * PILOT_CHAINS * PILOT_MUTATIONS) as f64;
    counters
}

/// As [`shoot_paths`](super::shoot_paths), with photon paths where `sees` says that a photon adds to the picture of the pass.
/// Others are not stored.
///
/// `sees` must be true of every photon that adds anything; that it may be true of others costs time and nothing else. Energy
/// is that of the uniform paths. The result is the same for any number of threads.
pub fn shoot_visible<S: Fn(&Photon) -> bool + Sync>(
    scene: &Scene,
    settings: &ShootSettings,
    emission: &Emission,
    plan: &Chains,
    sees: &S,
) -> Shot {
    if plan.uniform == 0 || scene.photon_selector.is_dark() {
        return Shot::default();
    }
    let key = Key::new(settings.seed, settings.target.purpose(), settings.pass);
    let mut uniform = uniform_paths(scene, settings, emission, (key, plan.uniform), 0..plan.uniform, sees);
    let photons = weigh(std::mem::take(&mut uniform.shot.photons), plan.share as f32, key);
    let mut shot = Shot { photons, emitted: plan.uniform + plan.chains * plan.mutations, ..uniform.shot };
    if plan.chains == 0 || uniform.seen.is_empty() {
        return shot;
    }
    // Take over the paths that are seen, each as often as any other: systematic resampling.
    let chain_key = Key::new(settings.seed, Purpose::Chain, settings.pass).with(settings.target.purpose() as u64);
    let offset = (hash_u64(chain_key.0, 0) >> 11) as f64 / (1u64 << 53) as f64;
    let seen = uniform.seen.len() as f64;
    let start = |chain: u64| {
        let at = (chain as f64 + offset) * seen / plan.chains as f64;
        uniform.seen[(at as usize).min(uniform.seen.len() - 1)]
    };
    // Uniform paths carry 1/N of the light: K/N of it is K times that.
    let states = (plan.chains * plan.mutations) as f64;
    let chain = Chain {
        scene,
        guide: emission.guide.as_deref(),
        sees,
        uniform: key,
        sequence: settings.walk.sequence,
        key: chain_key,
        size: plan.size,
        mutations: plan.mutations,
        scale: ((1.0 - plan.share) * seen / states) as f32,
    };
    let found: Vec<Found> = (0..plan.chains)
        .into_par_iter()
        .map(|c| chain.run(c, start(c), settings.walk, plan.uniform, settings.target))
        .collect();
    for found in found {
        shot.photons.extend_from_slice(&found.photons);
        shot.rejected += found.deposit.rejected;
        shot.counters += found.deposit.counters;
        shot.aimed += &found.deposit.aimed;
    }
    shot
}

/// Photons of `share` times the power.
fn weigh(mut photons: Vec<Photon>, share: f32, key: Key) -> Vec<Photon> {
    if share < 1.0 {
        photons.par_iter_mut().enumerate().for_each(|(i, photon)| {
            let key = key.with(!(i as u64));
            // Less than what could be stored can be stored.
            *photon = scaled(photon, share, key).expect("a smaller power");
        });
    }
    photons
}

#[cfg(test)]
mod tests;
