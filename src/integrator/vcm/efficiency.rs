//! Which techniques are worth their cost: what is left out where a pilot shows that the others find the same light for less.

use serde::Serialize;

use super::pilot::{self, CONNECTIONS, Cell, Counts, Findings, LIGHT_IMAGE, MERGING, PASSES, Variant};
use super::{Merging, Recipe, VcmSettings};
use crate::bsdf::{LobeMask, may_have};
use crate::image::metrics::RELMSE_EPSILON;
use crate::scene::Scene;

/// Error times cost must fall below this share of that of all techniques.
const LEAST_GAIN: f64 = 0.9;

/// Merges that a pilot has to see before it may say that they are of no use.
const LEAST_MERGES: u64 = 256;

/// The noisiest cells of the full recipe count as the next one does: a bright path there would hide what the others add.
const TRIMMED: f64 = 0.01;

/// Standard errors that estimates of added noise are increased by, in the worse half of the pilot.
const DOUBT: f64 = 1.0;

/// A technique that can be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Technique {
    Merging,
    /// Of light vertices with camera vertices.
    Connections,
    LightImage,
}

impl Technique {
    pub const ALL: [Self; 3] = [Self::Merging, Self::Connections, Self::LightImage];

    pub fn name(self) -> &'static str {
        match self {
            Self::Merging => "merging",
            Self::Connections => "connections",
            Self::LightImage => "light image",
        }
    }

    fn bit(self) -> u8 {
        match self {
            Self::Merging => MERGING,
            Self::Connections => CONNECTIONS,
            Self::LightImage => LIGHT_IMAGE,
        }
    }
}

/// What is to become of a technique, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TechniqueChoice {
    pub technique: Technique,
    pub used: bool,
    /// A sentence without its full stop.
    pub reason: String,
}

/// Decides which of the techniques that `settings` switch on are used, and switches off the others.
///
/// Where surfaces and lights alone do not decide, a pilot of a few thousand samples estimates noise and cost without each
/// set of techniques. A set is left out if error × cost falls by a tenth at least, in both halves of the pilot and with a
/// standard error of the added noise against it. Nothing is left out that may be alone in finding some light. Cost is
/// counted in rays and look-ups, so that the choice depends on the scene, the settings and the seed alone.
pub fn choose_techniques(scene: &Scene, settings: &mut VcmSettings, seed: u64) -> Vec<TechniqueChoice> {
    let full = Recipe::new(scene, settings);
    if !settings.connect || !settings.camera_paths || !full.traces_light() {
        return Vec::new();
    }
    let switched_on: Vec<Technique> = Technique::ALL.into_iter().filter(|t| has(&full.settings, *t)).collect();
    let needed = Needed::of(&full);
    let sets: Vec<u8> = (0..8).filter(|&set| set & !bits(&switched_on) == 0 && !needed.forbids(set)).collect();
    let variant = |&without: &u8| Variant { recipe: full.with(less(full.settings, without)), without };
    let variants: Vec<Variant> = sets.iter().map(variant).collect();
    let judged = if sets.len() > 1 { judge(&variants, &pilot::run(&variants, seed)) } else { vec![1.0] };
    let best = (0..judged.len()).min_by(|&a, &b| judged[a].total_cmp(&judged[b])).expect("one has all techniques");
    let left_out = if judged[best] <= LEAST_GAIN { sets[best] } else { 0 };
    let choices = switched_on.iter().map(|&technique| {
        let used = left_out & technique.bit() == 0;
        // How it is with this set and the technique the other way round.
        let other = sets.iter().position(|&s| s == left_out ^ technique.bit()).map(|i| judged[i]);
        let reason = match (used, other) {
            (false, _) => format!("the other techniques find the same light at {:.2} of error x cost", judged[best]),
            (true, None) => "it may be alone in finding some light".to_owned(),
            (true, Some(e)) if e.is_infinite() => {
                "it is alone in finding some light, or hardly seen in the pilot".to_owned()
            }
            (true, Some(e)) => {
                let now = if left_out == 0 { 1.0 } else { judged[best] };
                format!("error x cost is expected to be {:.2} times as high without", e / now)
            }
        };
        TechniqueChoice { technique, used, reason }
    });
    let choices = choices.collect();
    *settings = less(*settings, left_out);
    choices
}

fn bits(techniques: &[Technique]) -> u8 {
    techniques.iter().map(|t| t.bit()).sum()
}

fn has(s: &VcmSettings, t: Technique) -> bool {
    match t {
        Technique::Merging => s.merging != Merging::Off,
        Technique::Connections => s.connect_vertices,
        Technique::LightImage => s.light_image,
    }
}

/// The settings without some techniques.
fn less(mut s: VcmSettings, without: u8) -> VcmSettings {
    if without & MERGING != 0 {
        s.merging = Merging::Off;
    }
    s.connect_vertices &= without & CONNECTIONS == 0;
    s.light_image &= without & LIGHT_IMAGE == 0;
    s
}

/// What must stay, whatever a pilot sees.
///
/// Camera paths and light samples find all light of lamps that camera paths can meet. The light of others (points, the sun)
/// they find where it falls on the surface next to the lamp at other than one angle, but not behind mirrors, glass and the
/// like: that takes merging, if all surfaces can be merged at, or else all techniques together.
struct Needed {
    focused: bool,
    merging_suffices: bool,
}

impl Needed {
    fn of(full: &Recipe) -> Self {
        let scene = full.scene;
        let can = |id, lobes| may_have(&scene.materials, id, lobes);
        let mergeable = |&id: &_| !can(id, LobeMask::SMOOTH) || can(id, LobeMask::SMOOTH_WIDE);
        Self {
            focused: scene.lights.iter().any(|l| l.is_delta()) && full.has_focusing(),
            merging_suffices: has(&full.settings, Technique::Merging) && scene.shape_materials.iter().all(mergeable),
        }
    }

    fn forbids(&self, set: u8) -> bool {
        set != 0 && self.focused && (!self.merging_suffices || set & MERGING != 0)
    }
}

/// Error × cost of each variant over that of the first; infinite where the pilot does not allow it.
fn judge(variants: &[Variant], found: &Findings) -> Vec<f64> {
    let guide = guide(found);
    let cost = |v: &Variant| work(&found.counts, &v.recipe);
    let halves = found.passes.chunks(PASSES as usize / 2);
    let noise: Vec<f64> = halves.clone().map(|half| noise(half, &guide)).collect();
    let judge = |(i, v): (usize, &Variant)| {
        if v.without & MERGING != 0 && found.counts.merges < LEAST_MERGES {
            return f64::INFINITY;
        }
        let worse = |(half, noise): (&[Vec<Cell>], &f64)| {
            if *noise <= 0.0 { f64::INFINITY } else { 1.0 + added(half, &guide, i) / noise }
        };
        let worst = halves.clone().zip(&noise).map(worse).fold(0.0, f64::max);
        worst * cost(v) / cost(&variants[0])
    };
    let mut judged: Vec<f64> = variants.iter().enumerate().map(judge).collect();
    judged[0] = 1.0;
    judged
}

/// Noise of one pass relative to the picture, as two passes differ.
fn noise(passes: &[Vec<Cell>], guide: &[f64]) -> f64 {
    let (a, b) = (&passes[0], &passes[1]);
    let of = |((a, b), g): ((&Cell, &Cell), &f64)| {
        ((a.value[0] - b.value[0]).powi(2) / 2.0 + (a.splats_sq + b.splats_sq) / 2.0) / g
    };
    let mut cells: Vec<f64> = a.iter().zip(b).zip(guide).map(of).collect();
    cells.sort_unstable_by(f64::total_cmp);
    let most = cells[cells.len() - 1 - (TRIMMED * cells.len() as f64) as usize];
    cells.iter().map(|c| c.min(most)).sum::<f64>() / cells.len() as f64
}

/// What variant `i` adds to the noise of one pass, with its doubt.
///
/// Camera samples are compared as both variants weigh them, with what is in common of their contributions. What single
/// contributions add to their second moment comes from the samples of the full recipe, to which nothing is rare.
fn added(passes: &[Vec<Cell>], guide: &[f64], i: usize) -> f64 {
    let apart = |c: usize, i: usize| (passes[0][c].value[i] - passes[1][c].value[i]).powi(2) / 2.0;
    let of = |(c, g): (usize, &f64)| {
        let moments = passes.iter().map(|p| p[c].added[i] - p[c].added_here[i]).sum::<f64>() / 2.0;
        (moments + apart(c, i) - apart(c, 0)) / g
    };
    let cells: Vec<f64> = guide.iter().enumerate().map(of).collect();
    let n = cells.len() as f64;
    let mean = cells.iter().sum::<f64>() / n;
    if !mean.is_finite() {
        return f64::INFINITY;
    }
    let squares: f64 = cells.iter().map(|c| (c - mean).powi(2)).sum();
    mean + DOUBT * (squares / (n * (n - 1.0).max(1.0))).sqrt()
}

/// The picture squared, for errors to be relative to, from all passes and 3 × 3 cells.
fn guide(found: &Findings) -> Vec<f64> {
    let (columns, count) = (found.columns as usize, found.passes[0].len());
    let mean =
        |c: usize| found.passes.iter().map(|p| p[c].value[0] + p[c].splats).sum::<f64>() / found.passes.len() as f64;
    let around = |x: usize, end: usize| x.saturating_sub(1)..(x + 2).min(end);
    let smooth = |c: usize| {
        let (xs, ys) = (around(c % columns, columns), around(c / columns, count / columns));
        let n = xs.len() * ys.len();
        ys.flat_map(|y| xs.clone().map(move |x| mean(y * columns + x))).sum::<f64>() / n as f64
    };
    (0..count).map(|c| smooth(c).powi(2) + RELMSE_EPSILON * RELMSE_EPSILON).collect()
}

/// Closest-hit rays that a recipe's share of what was counted is worth.
fn work(c: &Counts, recipe: &Recipe) -> f64 {
    let s = &recipe.settings;
    let mut work = c.camera_rays as f64 + 0.85 * c.light_samples as f64;
    if recipe.traces_light() {
        work += 1.1 * c.photon_rays as f64;
    }
    if s.connect_vertices {
        work += 0.9 * c.connections as f64;
    }
    if s.light_image {
        work += 0.8 * c.lens as f64;
    }
    if s.merging != Merging::Off {
        work += 0.5 * c.queries as f64 + 0.15 * c.merges as f64;
    }
    work
}
