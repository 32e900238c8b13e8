//! What a render has found so far, in a file: to go on after an interruption with the same bits, or to add up passes that
//! were made in many places.
//!
//! The file is the magic number, the format's version (u32), the BLAKE3 hash of what follows, and the body: all numbers
//! little-endian, in the order of [`Checkpoint::visit`].

mod codec;
mod error;
mod file;
mod merge;
#[cfg(test)]
mod tests;

use std::ops::Range;

use codec::{Codec, Malformed};
pub use error::CheckpointError;

use super::doubt::{Bias, Doubt};
use super::layers::LayerFilms;
use super::spread::Spread;
use super::{ClampSummary, MapSummary, Plan, Session};
use crate::film::{Clamp, Film, FilmState, ReconstructionFilter};
use crate::image::{FilmWindow, Image};
use crate::integrator::Layer;
use crate::integrator::sppm::{EVENNESS_NUMBERS, Evenness, SharedRadius, SharedStatistics};
use crate::scene::Scene;
use crate::tally::Counters;

/// The sums over some passes of a render, with what is needed to tell which.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// [`Scene::hash`].
    pub scene_hash: String,
    /// Everything that decides what a pass adds, as text.
    pub plan: String,
    /// The ray-query back end: another one gives other bits.
    pub accel: String,
    pub integrator: String,
    pub seed: u64,
    pub window: FilmWindow,
    pub filter: ReconstructionFilter,
    /// The passes that are in, in order and apart from each other.
    pub ranges: Vec<Range<u64>>,
    /// Camera samples per pixel that are in.
    pub spp: u64,
    /// The program's version that made the first of them.
    pub version: String,
    /// Whether every pass stands alone.
    pub independent: bool,
    film: FilmState,
    layers: Vec<(Layer, FilmState)>,
    doubt: Option<Doubt>,
    counters: Counters,
    maps: Vec<MapSummary>,
    photon_memory: usize,
    shared: Vec<[f64; 4]>,
    evenness: Vec<[f64; 2 * EVENNESS_NUMBERS]>,
}

/// Everything that decides what a pass adds to the picture, but for the scene's files.
fn describe(scene: &Scene, plan: &Plan) -> String {
    format!(
        "{:?}, seed {}, {} spp a pass, {:?}, {:?}, {:?}, error {} bias {:?}, clamp {:?}, stored photon maps {:?}",
        plan.method,
        plan.seed,
        plan.spp_per_pass,
        scene.sampler.sequence,
        scene.camera.window(),
        scene.film.filter,
        plan.track_error,
        plan.bias_every,
        plan.clamp,
        plan.stored_maps.as_ref().map(|file| &file.parameters)
    )
}

impl Checkpoint {
    /// What a session holds between two passes.
    pub fn of(session: &Session) -> Self {
        let (scene, plan) = (session.scene, &session.plan);
        let shared = session.progressive.as_ref().and_then(|p| p.shared.as_ref());
        let numbers =
            |p: &[SharedRadius; 2]| [p[0].radius_sq, p[0].photons, p[1].radius_sq, p[1].photons].map(f64::from);
        Self {
            scene_hash: scene.hash.clone(),
            plan: describe(scene, plan),
            accel: scene.accel.description(),
            integrator: plan.method.name().to_owned(),
            seed: plan.seed,
            window: session.film.window(),
            filter: session.film.filter(),
            ranges: Vec::from_iter((session.passes() > 0).then_some(plan.passes.start..session.next)),
            spp: session.summary.spp,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            independent: plan.independent(),
            film: session.film.state(),
            layers: session.layers.as_ref().map_or_else(Vec::new, LayerFilms::states),
            doubt: session.doubt.clone(),
            counters: session.summary.counters,
            maps: session.summary.maps.clone(),
            photon_memory: session.summary.photon_memory,
            shared: shared.map_or_else(Vec::new, |s| s.pixels.iter().map(numbers).collect()),
            evenness: shared.map_or_else(Vec::new, |s| s.evenness.iter().map(evenness_numbers).collect()),
        }
    }

    /// The picture of the passes that are in, with its layers.
    pub fn image(&self) -> Image {
        let mut image = self.film().develop(1.0 / self.spp.max(1) as f64);
        self.layer_films().add_to(&mut image);
        image
    }

    /// What is kept beside the picture.
    pub fn layers(&self) -> Vec<Layer> {
        self.layers.iter().map(|(layer, _)| *layer).collect()
    }

    /// Passes that are in.
    pub fn passes(&self) -> u64 {
        self.ranges.iter().map(|r| r.end - r.start).fold(0, u64::saturating_add)
    }

    /// What the firefly clamp has taken from these passes; `None` without one.
    pub fn clamp(&self) -> Option<ClampSummary> {
        ClampSummary::of(&self.film(), self.spp)
    }

    fn film(&self) -> Film {
        let mut film = Film::new(self.window, self.filter);
        assert!(film.set_state(&self.film), "checked when it was read");
        film
    }

    fn layer_films(&self) -> LayerFilms {
        LayerFilms::from_states(self.window, self.filter, &self.layers)
    }

    /// All values in the order of the file.
    fn visit<C: Codec>(&mut self, c: &mut C) -> Result<(), Malformed> {
        for text in [&mut self.scene_hash, &mut self.plan, &mut self.accel, &mut self.integrator, &mut self.version] {
            c.text(text)?;
        }
        c.word(&mut self.seed)?;
        visit_window(&mut self.window, c)?;
        visit_filter(&mut self.filter, c)?;
        c.list(&mut self.ranges, 16, 0..0, |c, r| {
            c.word(&mut r.start)?;
            c.word(&mut r.end)
        })?;
        c.word(&mut self.spp)?;
        let mut independent = self.independent as u64;
        c.word(&mut independent)?;
        self.independent = independent != 0;
        visit_film(&mut self.film, c)?;
        c.list(&mut self.layers, LEAST_LAYER, (Layer::Photons, FilmState::default()), |c, (layer, film)| {
            let mut index = Layer::ALL.iter().position(|l| l == layer).unwrap_or(0);
            c.size(&mut index)?;
            *layer = *Layer::ALL.get(index).ok_or(Malformed)?;
            visit_film(film, c)
        })?;
        visit_doubt(&mut self.doubt, c)?;
        visit_counters(&mut self.counters, c)?;
        c.list(&mut self.maps, 8 * 4, MapSummary::default(), |c, m| visit_map(m, c))?;
        c.size(&mut self.photon_memory)?;
        c.floats(&mut self.shared)?;
        c.floats(&mut self.evenness)
    }

    /// Whether all parts fit each other.
    fn is_consistent(&self) -> bool {
        let (w, h) = self.window.crop_size;
        let pixels = w as u64 * h as u64;
        let fits = |len: usize| len as u64 == pixels;
        let whole = |f: &FilmState| fits(f.samples.len()) && (f.splats.is_empty() || fits(f.splats.len()));
        let mut last = 0;
        let ordered = self.ranges.iter().enumerate().all(|(i, r)| {
            let good = r.start < r.end && (i == 0 || r.start > last);
            last = r.end;
            good
        });
        let spreads = self.doubt.as_ref().is_none_or(|d| d.pixels.sum.len() as u64 == pixels);
        whole(&self.film)
            && self.layers.iter().all(|(_, film)| whole(film))
            && (self.shared.is_empty() || fits(self.shared.len()))
            && (self.evenness.is_empty() || self.evenness.len() == self.shared.len())
            && spreads
            && ordered
    }
}

impl<'s> Session<'s> {
    /// A render that goes on where `checkpoint` was made: the same scene, plan and back end, and the first passes of the
    /// plan.
    pub fn resume(scene: &'s Scene, plan: &Plan, checkpoint: &Checkpoint) -> Result<Self, CheckpointError> {
        if checkpoint.scene_hash != scene.hash {
            let (found, expected) = (checkpoint.scene_hash.clone(), scene.hash.clone());
            return Err(CheckpointError::Scene { found, expected });
        }
        let expected = describe(scene, plan);
        if checkpoint.plan != expected {
            return Err(CheckpointError::Plan { found: checkpoint.plan.clone(), expected });
        }
        if checkpoint.layers() != plan.layers {
            return Err(CheckpointError::Layers { found: checkpoint.layers(), expected: plan.layers.clone() });
        }
        if checkpoint.accel != scene.accel.description() {
            let (found, expected) = (checkpoint.accel.clone(), scene.accel.description());
            return Err(CheckpointError::Accel { found, expected });
        }
        let mut session = Self::new(scene, plan);
        let next = match &checkpoint.ranges[..] {
            [] => plan.passes.start,
            // A last pass that was cut short by the number of samples cannot be made up for.
            [only]
                if only.start == plan.passes.start
                    && only.end <= plan.passes.end
                    && (only.start..only.end).map(|p| plan.samples_of(p)).map(|s| s.end - s.start).sum::<u64>()
                        == checkpoint.spp =>
            {
                only.end
            }
            found => return Err(CheckpointError::Passes { found: found.to_vec(), expected: plan.passes.clone() }),
        };
        session.film = checkpoint.film();
        if !plan.layers.is_empty() {
            session.layers = Some(checkpoint.layer_films());
        }
        session.doubt = checkpoint.doubt.clone();
        session.next = next;
        session.summary.spp = checkpoint.spp;
        session.summary.passes = session.passes();
        session.summary.counters = checkpoint.counters;
        session.summary.maps = checkpoint.maps.clone();
        session.summary.photon_memory = checkpoint.photon_memory;
        session.summary.clamp = checkpoint.clamp();
        session.resumed_shared = (!checkpoint.shared.is_empty()).then(|| statistics_from(checkpoint));
        Ok(session)
    }
}

fn visit_window<C: Codec>(w: &mut FilmWindow, c: &mut C) -> Result<(), Malformed> {
    for side in [
        &mut w.size.0,
        &mut w.size.1,
        &mut w.crop_offset.0,
        &mut w.crop_offset.1,
        &mut w.crop_size.0,
        &mut w.crop_size.1,
    ] {
        let mut word = u64::from(*side);
        c.word(&mut word)?;
        *side = u32::try_from(word).map_err(|_| Malformed)?;
    }
    Ok(())
}

/// Bytes that a layer takes at least: its name, two lengths, a count and the clamp.
const LEAST_LAYER: usize = 8 * 9;

fn visit_film<C: Codec>(film: &mut FilmState, c: &mut C) -> Result<(), Malformed> {
    c.floats(&mut film.samples)?;
    c.floats(&mut film.splats)?;
    c.word(&mut film.non_finite)?;
    visit_clamp(&mut film.clamp, c)
}

fn visit_clamp<C: Codec>(clamp: &mut Clamp, c: &mut C) -> Result<(), Malformed> {
    // A limit is positive: 0 stands for none.
    let mut limit = clamp.limit.map_or(0.0, f64::from);
    c.float(&mut limit)?;
    clamp.limit = (limit != 0.0).then_some(limit as f32);
    c.word(&mut clamp.count)?;
    clamp.removed.iter_mut().try_for_each(|v| c.float(v))
}

fn visit_filter<C: Codec>(filter: &mut ReconstructionFilter, c: &mut C) -> Result<(), Malformed> {
    use ReconstructionFilter::{Box, CatmullRom, Gaussian, Lanczos, Mitchell, Tent};
    let (mut kind, mut a, mut b) = match *filter {
        Box => (0, 0.0, 0.0),
        Tent { radius } => (1, f64::from(radius), 0.0),
        Gaussian { stddev } => (2, f64::from(stddev), 0.0),
        Mitchell { b, c } => (3, f64::from(b), f64::from(c)),
        CatmullRom => (4, 0.0, 0.0),
        Lanczos { lobes } => (5, f64::from(lobes), 0.0),
    };
    c.word(&mut kind)?;
    c.float(&mut a)?;
    c.float(&mut b)?;
    *filter = match kind {
        0 => Box,
        1 => Tent { radius: a as f32 },
        2 => Gaussian { stddev: a as f32 },
        3 => Mitchell { b: a as f32, c: b as f32 },
        4 => CatmullRom,
        5 => Lanczos { lobes: a as u32 },
        _ => return Err(Malformed),
    };
    Ok(())
}

fn visit_spread<C: Codec>(s: &mut Spread, c: &mut C) -> Result<(), Malformed> {
    c.float(&mut s.weight)?;
    c.float(&mut s.square_weight)?;
    c.word(&mut s.passes)?;
    c.floats(&mut s.sum)?;
    c.floats(&mut s.square)?;
    if s.sum.len() == s.square.len() { Ok(()) } else { Err(Malformed) }
}

fn visit_doubt<C: Codec>(doubt: &mut Option<Doubt>, c: &mut C) -> Result<(), Malformed> {
    // 0: nothing is tracked, 1: noise, 2: noise and bias.
    let mut kind = doubt.as_ref().map_or(0, |d| if d.bias.is_some() { 2 } else { 1 });
    c.word(&mut kind)?;
    if kind > 2 {
        return Err(Malformed);
    }
    if kind == 0 {
        return Ok(());
    }
    let d = doubt.get_or_insert_with(|| Doubt { pixels: Spread::new(0), blocks: Spread::new(0), bias: None });
    visit_spread(&mut d.pixels, c)?;
    visit_spread(&mut d.blocks, c)?;
    if kind == 2 {
        let bias = d.bias.get_or_insert_with(|| Bias { pixels: Spread::new(0), corrected_blocks: Spread::new(0) });
        visit_spread(&mut bias.pixels, c)?;
        visit_spread(&mut bias.corrected_blocks, c)?;
        if bias.pixels.sum.len() != d.pixels.sum.len() || bias.corrected_blocks.sum.len() != d.blocks.sum.len() {
            return Err(Malformed);
        }
    }
    Ok(())
}

fn visit_counters<C: Codec>(n: &mut Counters, c: &mut C) -> Result<(), Malformed> {
    for count in [
        &mut n.camera_rays,
        &mut n.shadow_rays,
        &mut n.photon_rays,
        &mut n.photon_queries,
        &mut n.samples,
        &mut n.nan_samples,
        &mut n.infinite_samples,
    ] {
        c.word(count)?;
    }
    Ok(())
}

fn visit_map<C: Codec>(m: &mut MapSummary, c: &mut C) -> Result<(), Malformed> {
    const NAMES: [&str; 3] = ["caustic", "global", "indirect"];
    let mut name = NAMES.iter().position(|n| *n == m.name).unwrap_or(0) as u64;
    c.word(&mut name)?;
    m.name = NAMES.get(name as usize).ok_or(Malformed)?;
    c.word(&mut m.emitted)?;
    c.word(&mut m.stored)?;
    c.word(&mut m.rejected)?;
    let e = &mut m.energy;
    for part in [&mut e.emitted, &mut e.absorbed, &mut e.escaped, &mut e.roulette, &mut e.cut] {
        part.iter_mut().try_for_each(|v| c.float(v))?;
    }
    m.energy_error = m.energy.relative_error();
    c.list(&mut m.aimed.paths, 8, 0, |c, n| c.word(n))?;
    c.list(&mut m.aimed.photons, 8, 0, |c, n| c.word(n))
}

/// The tests of both kinds of photons as the numbers of a checkpoint.
fn evenness_numbers(tests: &[Evenness; 2]) -> [f64; 2 * EVENNESS_NUMBERS] {
    let [a, b] = tests.each_ref().map(Evenness::numbers);
    std::array::from_fn(|i| if i < EVENNESS_NUMBERS { a[i] } else { b[i - EVENNESS_NUMBERS] })
}

/// Statistics of every pixel from the numbers of a checkpoint.
fn statistics_from(c: &Checkpoint) -> SharedStatistics {
    let pair = |n: &[f64; 4]| {
        let of = |i: usize| SharedRadius { radius_sq: n[i] as f32, photons: n[i + 1] as f32 };
        [of(0), of(2)]
    };
    let tests = |n: &[f64; 2 * EVENNESS_NUMBERS]| {
        let of = |first: usize| Evenness::from_numbers(&std::array::from_fn(|i| n[first + i]));
        [of(0), of(EVENNESS_NUMBERS)]
    };
    SharedStatistics { pixels: c.shared.iter().map(pair).collect(), evenness: c.evenness.iter().map(tests).collect() }
}
