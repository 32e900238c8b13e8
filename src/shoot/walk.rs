//! One photon path: emission, scattering with Russian roulette, deposits.

use std::ops::Range;

use arrayvec::ArrayVec;

use super::{EnergyBalance, Guide};
use crate::bsdf::{LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::{Hit, Ray, SurfaceInteraction};
use crate::math::Vec2;
use crate::photon::{Photon, PhotonClass, PhotonRecord};
use crate::sample::{Key, Purpose, Sampler, Sequence, hash_u64};
use crate::scene::Scene;
use crate::tally::Counters;

/// Which photons are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// L S⁺ D: light that reached its first diffuse surface through specular ones only.
    Caustic,
    /// Every photon at a diffuse or glossy surface.
    Global,
    /// As `Global`, without those that have not met a diffuse or glossy surface before (direct light and caustics).
    Indirect,
}

impl Target {
    /// Its name in files and reports.
    pub fn name(self) -> &'static str {
        match self {
            Target::Caustic => "caustic",
            Target::Global => "global",
            Target::Indirect => "indirect",
        }
    }

    /// The random stream of this kind of photon path.
    pub fn purpose(self) -> Purpose {
        match self {
            Target::Caustic => Purpose::CausticPhoton,
            Target::Global | Target::Indirect => Purpose::Photon,
        }
    }
}

/// Limits of a photon path.
#[derive(Clone, Copy, Debug)]
pub struct WalkSettings {
    /// Longest path in edges from the light; `None` is unlimited.
    pub max_depth: Option<u32>,
    /// Edges after which Russian roulette may end a path.
    pub rr_depth: u32,
    pub sequence: Sequence,
}

/// Edges after which roulette also ends paths that lose nothing, so that light trapped for ever ends too.
pub const MANY_EDGES: u32 = 4096;

/// Probability of survival of such paths at each edge.
const CERTAIN_SURVIVAL: f32 = 1.0 - 1.0 / 65536.0;

/// What rounding leaves of 1. Above it nothing is lost.
const LOSSLESS: f32 = 1.0 - 4.0 * f32::EPSILON;

/// Probability with which Russian roulette lets a path go on that keeps the share `kept` of its power, after `depth` edges.
///
/// Equal to `kept`, so that weights stay as they are. A path that is trapped without loss would never end: it is let go at
/// most 65 536 edges on average after its first 4096. That must not happen to one that loses a little: ended more often than
/// it loses, its weight would grow without bound, and with it the variance where albedos exceed 1 − 2⁻¹⁷.
#[inline]
pub fn survival(kept: f32, depth: u32, rr_depth: u32) -> f32 {
    if depth >= MANY_EDGES && kept >= LOSSLESS {
        CERTAIN_SURVIVAL
    } else if depth >= rr_depth {
        kept.min(1.0)
    } else {
        1.0
    }
}

/// Where a path starts: a light, the numbers it is given, and their density relative to uniform ones, with the
/// probability of the light.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    pub light: usize,
    pub u_pos: Vec2,
    pub u_dir: Vec2,
    pub pdf: f32,
}

/// Photons under way at a time in [`Deposit::trace_all`].
const WAVE: usize = 32;

/// A photon under way.
#[derive(Clone, Debug)]
struct Flight {
    ray: Ray,
    flux: Rgb,
    sampler: Sampler,
    /// Its path: the number, and the key of its random bits.
    index: u64,
    path: Key,
    /// Surfaces met.
    depth: u32,
    /// Whether all of them were specular.
    specular_chain: bool,
    /// Whether one was diffuse or glossy.
    scattered: bool,
}

/// The photons and tallies of one batch of paths.
#[derive(Debug)]
pub struct Deposit {
    pub photons: Vec<Photon>,
    pub balance: EnergyBalance,
    pub rejected: u64,
    pub counters: Counters,
    /// Sum of the largest channels of the photons stored since it was last set to 0, W.
    pub(super) stored_power: f64,
    target: Target,
    walk: WalkSettings,
    inv_emitted: f32,
}

impl Deposit {
    /// A batch of a shoot that emits `emitted` paths in all.
    pub fn new(target: Target, walk: WalkSettings, emitted: u64) -> Self {
        Self {
            photons: Vec::new(),
            balance: EnergyBalance::default(),
            rejected: 0,
            counters: Counters::default(),
            stored_power: 0.0,
            target,
            walk,
            inv_emitted: (1.0 / emitted as f64) as f32,
        }
    }

    /// Follows photon path `index` from its light to its end. Returns where it started, if it did.
    pub fn trace(&mut self, scene: &Scene, guide: Option<&Guide>, key: Key, index: u64) -> Option<Start> {
        let (start, mut flight) = self.emit(scene, guide, key, index)?;
        while let Some(f) = &mut flight {
            let hit = scene.hit(&mut f.ray);
            if !self.land(scene, f, hit) {
                break;
            }
        }
        Some(start)
    }

    /// Follows the photon paths `indices`, many at a time, with the photons that [`Deposit::trace`] of one after the other
    /// stores, in the same order.
    ///
    /// A photon's way from hit to hit is one long chain of steps that depend on each other, and on a large mesh half of their
    /// time is waiting for the triangle that was hit. Many under way at a time wait together.
    pub fn trace_all(&mut self, scene: &Scene, guide: Option<&Guide>, key: Key, indices: Range<u64>) {
        let first = indices.start;
        let mut waiting = indices.clone();
        let mut wave: ArrayVec<Flight, WAVE> = ArrayVec::new();
        // By photon: which path stored it.
        let (before, mut owners) = (self.photons.len(), Vec::new());
        loop {
            while !wave.is_full() {
                let Some(index) = waiting.next() else { break };
                if let Some((_, Some(flight))) = self.emit(scene, guide, key, index) {
                    wave.push(flight);
                }
            }
            if wave.is_empty() {
                break;
            }
            let mut hits = [None; WAVE];
            for (flight, hit) in wave.iter_mut().zip(&mut hits) {
                *hit = scene.hit(&mut flight.ray);
            }
            scene.geometry.touch(&hits[..wave.len()]);
            let mut kept = 0;
            for i in 0..wave.len() {
                let flight = &mut wave[i];
                let goes_on = self.land(scene, flight, hits[i]);
                owners.resize(self.photons.len() - before, (flight.index - first) as u32);
                if goes_on {
                    if kept != i {
                        wave.swap(kept, i);
                    }
                    kept += 1;
                }
            }
            wave.truncate(kept);
        }
        sort_by_owner(&mut self.photons[before..], &owners, (indices.end - first) as usize);
    }

    /// Starts photon path `index`: where, and its photon on its way unless it carries nothing.
    #[inline]
    fn emit(&mut self, scene: &Scene, guide: Option<&Guide>, key: Key, index: u64) -> Option<(Start, Option<Flight>)> {
        let mut sampler = Sampler::new(self.walk.sequence, key, index);
        // Emit from a light chosen at random.
        let (u_light, u_pos, u_dir) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
        let start = match guide {
            Some(guide) => guide.start(u_light, u_pos, u_dir)?,
            None => {
                let (light, pdf) = scene.selector.sample(u_light)?;
                Start { light, u_pos, u_dir, pdf }
            }
        };
        let le = scene.lights[start.light].sample_le(&scene.light_context(), start.u_pos, start.u_dir)?;
        let flux = le.weight * (self.inv_emitted / start.pdf);
        if !flux.is_finite() {
            self.rejected += 1;
            return None;
        }
        if flux.is_black() {
            return Some((start, None));
        }
        EnergyBalance::add(&mut self.balance.emitted, flux);
        let ray = scene.from_light(le.ray);
        let flight = Flight {
            ray,
            flux,
            sampler,
            index,
            path: key.with(index),
            depth: 0,
            specular_chain: true,
            scattered: false,
        };
        Some((start, Some(flight)))
    }

    /// Stores and scatters a photon where its ray has ended. False when its path ends there.
    #[inline]
    fn land(&mut self, scene: &Scene, flight: &mut Flight, hit: Option<Hit>) -> bool {
        self.counters.photon_rays += 1;
        let before = flight.flux;
        let Some(hit) = hit else {
            EnergyBalance::add(&mut self.balance.escaped, before);
            return false;
        };
        let si = scene.interaction(&flight.ray, &hit);
        flight.depth += 1;
        // Store it where the surface has lobes that photons estimate.
        let bsdf = scene.bsdf(&si);
        let lobes = bsdf.lobes();
        if lobes.intersects(LobeMask::SMOOTH_WIDE) && self.wants(flight) {
            self.store(&si, flight);
        }
        if self.target == Target::Caustic && !lobes.intersects(LobeMask::SPECULAR) {
            EnergyBalance::add(&mut self.balance.absorbed, before);
            return false;
        }
        if self.walk.max_depth.is_some_and(|d| flight.depth >= d) {
            EnergyBalance::add(&mut self.balance.cut, before);
            return false;
        }
        // Scatter; what a caustic photon loses to diffuse lobes ends there.
        let mask = if self.target == Target::Caustic { LobeMask::SPECULAR } else { LobeMask::ALL };
        let (u_lobe, u) = (flight.sampler.next_1d(), flight.sampler.next_2d());
        let Some(s) = bsdf.sample(si.wo, u_lobe, u, Mode::Importance, mask) else {
            EnergyBalance::add(&mut self.balance.absorbed, before);
            return false;
        };
        let mut flux = before * s.weight;
        if !flux.is_finite() {
            self.rejected += 1;
            EnergyBalance::add(&mut self.balance.absorbed, before);
            return false;
        }
        EnergyBalance::add_loss(&mut self.balance.absorbed, before, flux);
        if flux.is_black() {
            return false;
        }
        if s.lobe.intersects(LobeMask::SMOOTH_WIDE) {
            (flight.specular_chain, flight.scattered) = (false, true);
        }
        // Russian roulette on the largest channel keeps the powers of stored photons alike [Jensen 2001, §5.2].
        let survive = survival(flux.max_channel() / before.max_channel(), flight.depth, self.walk.rr_depth);
        if survive < 1.0 {
            let unlucky = flight.sampler.next_1d() >= survive;
            let after = if unlucky { Rgb::BLACK } else { flux / survive };
            EnergyBalance::add_loss(&mut self.balance.roulette, flux, after);
            if unlucky {
                return false;
            }
            flux = after;
        }
        flight.flux = flux;
        flight.ray = si.spawn_ray(s.wi);
        true
    }

    /// Whether the kind of map being made wants a photon with this history.
    #[inline]
    fn wants(&self, flight: &Flight) -> bool {
        match self.target {
            Target::Caustic => flight.specular_chain && flight.depth > 1,
            Target::Global => true,
            Target::Indirect => flight.scattered,
        }
    }

    #[inline]
    fn store(&mut self, si: &SurfaceInteraction, flight: &Flight) {
        let Flight { flux: power, depth, specular_chain, scattered, path, .. } = *flight;
        let record = PhotonRecord {
            p: si.p,
            power,
            wi: si.wo,
            side: si.wo.dot(si.ng) > 0.0,
            normal: si.ng,
            class: if specular_chain && depth > 1 { PhotonClass::Caustic } else { PhotonClass::Global },
            mark: !scattered,
        };
        let bits = hash_u64(path.0, depth as u64);
        match Photon::pack(&record, hash_u64(bits, Purpose::Quantize as u64)) {
            Ok(photon) => {
                self.stored_power += power.max_channel() as f64;
                self.photons.push(photon);
            }
            Err(_) => self.rejected += 1,
        }
    }
}

/// Puts photons into the order of the paths that stored them, those of one path as they are.
fn sort_by_owner(photons: &mut [Photon], owners: &[u32], paths: usize) {
    let mut next = vec![0u32; paths + 1];
    for &o in owners {
        next[o as usize + 1] += 1;
    }
    for i in 1..next.len() {
        next[i] += next[i - 1];
    }
    let unsorted = photons.to_vec();
    for (photon, &o) in unsorted.iter().zip(owners) {
        photons[next[o as usize] as usize] = *photon;
        next[o as usize] += 1;
    }
}
