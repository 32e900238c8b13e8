//! `--integrator auto`: a short pilot of the methods that converge to the truth, and the one that promises most.

mod pilot;
mod verdict;

use serde::Serialize;

use super::{Method, Plan, PlanError, PlanOverrides};
use crate::image::Image;
use crate::integrator::VcmSettings;
use crate::integrator::vcm::{Merging, Recipe};
use crate::scene::{Needs, Scene};
use pilot::{Pilot, lights_met};
use verdict::{Guide, noise_with_rare};

/// The name that asks for a choice.
pub const AUTO: &str = "auto";

/// Passes of one camera sample per pixel in a pilot at least: two are the fewest that tell noise.
const PASSES: u64 = 2;

/// Pixels of a pilot at most; a larger film is tried at a lower resolution.
const MOST_PIXELS: u64 = 128 * 128;

/// Camera samples of a pilot at least, so that rare paths are met: a small film gets more passes.
const SAMPLES: u64 = PASSES * MOST_PIXELS;

/// Times as many passes of `path` before it is believed to find light that something focuses, which its paths meet by chance; and
/// where it is far behind, for what its picture tells of all methods, if that takes no more than this share of the rays promised.
const MORE_PATHS: u64 = 4;
const PATHS_LOOK: f64 = 0.01;

/// The error (relMSE) that the methods race to.
const GOAL: f64 = 1e-2;

/// Rays per pixel that the pilots of the other methods take together: where `path` has all light and is done for no more,
/// asking them costs as much as they could save.
const OTHER_PILOTS: f64 = 64.0;

/// `photonmapper` is tried too where the best of the others promises more rays than this, all pixels together: trying it takes up
/// to a third of that, as it needs many photons however small the film.
const RAYS_WORTH_MAPS: f64 = 2e7;

/// `photonmapper` is taken where the others promise at least so many times its work: its error does not fall forever, and as it
/// takes few samples a pixel, rare bright ones, which pilots hardly meet, weigh more in it.
const MAPS_AHEAD: f64 = 1.5;

/// `photonmapper` is not tried where it gathers more rays than this for a camera sample: there will be few samples, and a pilot
/// would take longer than the render.
const MOST_GATHERED: u32 = 8;

/// The method that promises most, and those that promise at most so many times its work, are looked at so many times longer,
/// again and again, while that takes no more than this share of the rays that it promises: two passes tell little of what is
/// rare.
const NEAR: f64 = 1.5;
const LONGER: u64 = 4;
const LONGER_LOOK: f64 = 0.02;

/// Rare bright light that the camera's paths meet is looked for with this share of the rays that are promised, in so many passes:
/// first in a few, and in more where two standard errors of what they find are more than this share of the noise that is known.
const RARE_LOOK: f64 = 0.05;
const RARE_PASSES: (u64, u64) = (4, 16);
const RARE_DOUBT: f64 = 0.1;

/// The power of the radius that blur goes with: 1 along edges, 2 where light is curved.
const BLUR: f64 = 1.5;

/// What the pilot of one method found.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    pub method: &'static str,
    /// Camera samples of a pixel in one pass.
    pub samples: u64,
    /// relMSE of one pass as the passes differ.
    pub noise: f64,
    /// The part of it that grows as radii shrink: within half the area there is as much more noise.
    pub photon_noise: f64,
    /// relMSE of what the first radii blur, as far as it stands out from noise.
    pub blur: f64,
    /// relMSE over blocks against the widest method, as far as it stands out from noise: blur, or light not found.
    pub off: f64,
    /// Share of the picture's light that the widest method finds in blocks where this one surely has less.
    pub missing: f64,
    /// Cost of a pass per pixel, in closest-hit rays, and that of what precedes the first.
    pub work: f64,
    pub preparation: f64,
    /// Passes to a relMSE of 10⁻²; infinite where `off` or `missing` forbids it, or blur that stays.
    pub passes: f64,
}

impl Trial {
    /// Work to the goal, rays per pixel.
    pub fn work_to_goal(&self) -> f64 {
        self.preparation + self.work * self.passes
    }
}

/// The method chosen, and why.
#[derive(Clone, Debug, Serialize)]
pub struct Choice {
    pub method: &'static str,
    /// Camera samples of a pixel in each pass of `sppm`, for [`PlanOverrides::samples_per_pass`]; `None` for other methods.
    pub samples_per_pass: Option<u64>,
    pub reason: String,
    pub trials: Vec<Trial>,
}

/// Picks a method where `auto` is asked for, by the scene or by `o`; `None` where a method is named.
///
/// Candidates are the methods whose error vanishes: `path`, `sppm`, and `vcm` or, where nothing focuses light and it would
/// be the same, `bdpt`. Each makes two passes or, on a small film, more. Their differences tell its noise, and its difference
/// from the last, which can sample what the others can, tells light that it has not found. Where densities are estimated, the
/// same samples see narrower discs once more: noise that this adds grows as radii shrink, and what it sharpens is blur. Where
/// nothing focuses light and `path` promises to be done before the others have been tried, it is taken without them; where all
/// promise much work, `photonmapper` is tried as well, and taken if what it blurs stays below half of the goal and it promises
/// much less work. Where something focuses light, rare bright light that camera paths meet is looked for by itself. The one that
/// promises most and those near it are looked at longer where that takes little of what it promises. Cost is counted in rays and
/// look-ups rather than in seconds, so that the choice depends on the scene and the seed alone.
///
/// # Errors
/// As [`Plan::new`].
pub fn choose(scene: &mut Scene, o: &PlanOverrides) -> Result<Option<Choice>, PlanError> {
    if o.integrator.as_deref().unwrap_or(&scene.integrator.name) != AUTO {
        return Ok(None);
    }
    let max_depth = scene.integrator.integer("max_depth").and_then(|d| u32::try_from(d).ok());
    if let Some(edges @ 0..=2) = Needs::of(scene, max_depth, &o.needs).longest_path() {
        let reason = format!("paths have at most {edges} edges: light samples find all there is");
        return Ok(Some(Choice { method: "path", samples_per_pass: None, reason, trials: Vec::new() }));
    }
    let merges = Recipe::new(scene, &VcmSettings::default()).settings.merging != Merging::Off;
    let widest = if merges { "vcm" } else { "bdpt" };
    let integrator = Some("photonmapper".to_owned());
    let mapper = Plan::new(scene, &PlanOverrides { integrator, fresh_maps: true, pass_range: None, ..o.clone() })?;
    // Look at a smaller film for so long.
    let (camera, film) = (scene.camera, scene.film);
    let window = film.window.shrunk(MOST_PIXELS);
    let o = &PlanOverrides { photons: photons(scene, window.pixels(), o)?, ..o.clone() };
    scene.camera = camera.with_film(window);
    (scene.film.window, scene.film.width, scene.film.height) = (window, window.crop_size.0, window.crop_size.1);
    let pixels = film.window.pixels().max(1) as f64;
    let race = Race { scene, o, mapper: &mapper, pixels };
    let trials = race.pilots(widest).and_then(|pilots| race.run(pilots));
    (scene.camera, scene.film) = (camera, film);
    Ok(Some(judge(trials?)))
}

/// Photons of a pass of `sppm` on a film of so many pixels: as many for each as on the film of `scene`.
fn photons(scene: &Scene, pixels: u64, o: &PlanOverrides) -> Result<Option<u64>, PlanError> {
    let plan = Plan::new(scene, &PlanOverrides { integrator: Some("sppm".to_owned()), pass_range: None, ..o.clone() })?;
    let share = pixels as f64 / scene.film.window.pixels().max(1) as f64;
    Ok(match plan.method {
        Method::Sppm(s) => Some(((s.photon_count as f64 * share) as u64).max(1)),
        _ => o.photons,
    })
}

/// What a choice is made for.
struct Race<'a> {
    /// On a small film.
    scene: &'a Scene,
    o: &'a PlanOverrides,
    /// The plan of `photonmapper` on the whole film, and the pixels of that.
    mapper: &'a Plan,
    pixels: f64,
}

impl Race<'_> {
    /// Tries the candidates, the one that can sample what all others can last.
    fn pilots(&self, widest: &'static str) -> Result<Vec<Pilot>, PlanError> {
        let mut pilots = vec![Pilot::run(self.scene, "path", first_passes(self.scene, "path"), self.o)?];
        // Path tracing meets all light that nothing focuses.
        if widest == "bdpt" && pilots[0].against(&pilots, &Guide::new(&pilots), 0.0).work_to_goal() <= OTHER_PILOTS {
            return Ok(pilots);
        }
        for method in ["sppm", widest] {
            pilots.push(Pilot::run(self.scene, method, first_passes(self.scene, method), self.o)?);
        }
        Ok(pilots)
    }

    /// Compares all with the last. Tries `photonmapper` where that could save much work, looks for rare light, and looks longer
    /// at those that promise most, while that takes a small share of what they promise.
    fn run(&self, mut pilots: Vec<Pilot>) -> Result<Vec<Trial>, PlanError> {
        let fine = self.o.target_error.is_some_and(|error| error < GOAL);
        let cheap = matches!(self.mapper.method, Method::PhotonMapper(s) if s.final_gather_samples <= MOST_GATHERED);
        let focuses = pilots.last().is_some_and(|p| p.method == "vcm");
        // Whether the camera's paths may meet lights by chance in what focuses them.
        let seen_in_glass = focuses && self.scene.lights.iter().any(|l| !l.is_delta());
        let mut maps: Option<Pilot> = None;
        let mut rare = Rare::default();
        loop {
            let guide = Guide::new(&pilots);
            let trials: Vec<Trial> =
                pilots.iter().chain(&maps).map(|p| p.against(&pilots, &guide, rare.noise)).collect();
            let ahead = best(&trials);
            let promised = trials[ahead].work_to_goal() * self.pixels;
            let near = |i: usize| handicapped(&trials[i]) <= NEAR * handicapped(&trials[ahead]);
            let paths = MORE_PATHS * first_passes(self.scene, "path");
            let little = pilots[0].rays * MORE_PATHS as f64 <= PATHS_LOOK * promised;
            if focuses && pilots[0].passes < paths && (near(0) || little) {
                pilots[0] = Pilot::run(self.scene, "path", paths, self.o)?;
                continue;
            }
            if cheap && !fine && maps.is_none() && promised > RAYS_WORTH_MAPS {
                maps = Some(Pilot::of_maps(self.scene, self.mapper, PASSES, self.pixels));
                continue;
            }
            if let Some((sppm, trial)) = pilots.iter().zip(&trials).find(|(p, _)| p.method == "sppm")
                && seen_in_glass
            {
                // Of the work of a camera sample, a quarter is assumed for what its path meets.
                let work = 0.25 * (sppm.work - sppm.photon_work) * sppm.noise.len() as f64;
                let passes = ((RARE_LOOK * promised / work) as u64).min(RARE_PASSES.1);
                let told = trial.samples as f64 * (trial.noise - trial.photon_noise) - rare.noise;
                let (least, wanted) = match rare.passes() {
                    0 => (RARE_PASSES.0, RARE_PASSES.0),
                    n if 2.0 * rare.doubt > RARE_DOUBT * told => (2 * n, RARE_PASSES.1),
                    _ => (u64::MAX, 0),
                };
                if passes >= least {
                    rare.look(sppm, self.scene, passes.min(wanted), told, self.o)?;
                    continue;
                }
            }
            // The one of those near the best that has been looked at least.
            let looks = pilots.iter().chain(&maps).map(|p| (LONGER * p.passes, p.rays * LONGER as f64)).enumerate();
            let looks =
                looks.filter(|&(i, (_, rays))| near(i) && rays <= LONGER_LOOK * promised && promised.is_finite());
            let next = looks.min_by(|a, b| a.1.1.total_cmp(&b.1.1));
            let Some((i, (passes, _))) = next else { return Ok(trials) };
            match pilots.get_mut(i) {
                Some(pilot) => *pilot = Pilot::run(self.scene, pilot.method, passes, self.o)?,
                None => maps = Some(Pilot::of_maps(self.scene, self.mapper, passes, self.pixels)),
            }
        }
    }
}

/// Rare bright light that camera paths meet.
#[derive(Default)]
struct Rare {
    /// What they meet, by pass.
    pictures: Vec<Image>,
    /// Noise that it adds to every camera sample, as the passes tell it, and the standard error of what they tell.
    noise: f64,
    doubt: f64,
}

impl Rare {
    fn passes(&self) -> u64 {
        self.pictures.len() as u64
    }

    /// Looks at so many passes in all; `told` is the noise of a camera sample that the pilot of `sppm` knows.
    fn look(
        &mut self,
        sppm: &Pilot,
        scene: &Scene,
        passes: u64,
        told: f64,
        o: &PlanOverrides,
    ) -> Result<(), PlanError> {
        self.pictures.extend(lights_met(scene, self.passes()..passes, o)?);
        let (noise, doubt) = noise_with_rare(&self.pictures, &sppm.image);
        // A single bright sample tells nothing.
        (self.noise, self.doubt) = ((noise - doubt - told).max(0.0), doubt);
        Ok(())
    }
}

/// Passes that the pilot of a method makes at first.
fn first_passes(scene: &Scene, method: &str) -> u64 {
    // In a pass of `sppm` photons are many, however few the pixels.
    if method == "sppm" { PASSES } else { PASSES.max(SAMPLES / scene.film.window.pixels().max(1)) }
}

/// The trial that promises the least work.
fn best(trials: &[Trial]) -> usize {
    let work = |&i: &usize| handicapped(&trials[i]);
    (0..trials.len()).min_by(|a, b| work(a).total_cmp(&work(b))).expect("there are candidates")
}

/// The work that a trial promises, as the race counts it.
fn handicapped(trial: &Trial) -> f64 {
    trial.work_to_goal() * if trial.method == "photonmapper" { MAPS_AHEAD } else { 1.0 }
}

/// Takes the one that promises most.
fn judge(trials: Vec<Trial>) -> Choice {
    let tell = |t: &Trial| match t.passes.is_finite() {
        true => format!("{} {:.3e}", t.method, t.work_to_goal()),
        false if t.method == "photonmapper" => format!("{} blurs too much", t.method),
        false => format!("{} does not find all light", t.method),
    };
    let told: Vec<String> = trials.iter().map(tell).collect();
    let reason = format!("rays per pixel to relmse {GOAL}: {}", told.join(", "));
    let Trial { method, samples, .. } = trials[best(&trials)];
    Choice { method, samples_per_pass: (method == "sppm").then_some(samples), reason, trials }
}
