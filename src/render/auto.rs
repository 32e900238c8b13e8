//! `--integrator auto`: a short pilot of the methods that converge to the truth, and the one that promises most.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use serde::Serialize;

use super::doubt::EXTRAPOLATE;
use super::spread::Spread;
use super::{Control, Doubt, Method, Plan, PlanError, PlanOverrides, Session, Silent};
use crate::color::Rgb;
use crate::gather::NARROW;
use crate::image::metrics::RELMSE_EPSILON;
use crate::image::{BLOCK_SIZE, Image, block_means};
use crate::integrator::VcmSettings;
use crate::integrator::sppm::{PhotonSampling, radius_sq_ratio};
use crate::integrator::vcm::{Merging, Recipe};
use crate::scene::{Needs, Scene};
use crate::tally::Counters;

/// The name that asks for a choice.
pub const AUTO: &str = "auto";

/// Passes of one camera sample per pixel in a pilot at least: two are the fewest that tell noise.
const PASSES: u64 = 2;

/// Pixels of a pilot at most; a larger film is tried at a lower resolution.
const MOST_PIXELS: u64 = 128 * 128;

/// Camera samples of a pilot at least, so that rare paths are met: a small film gets more passes.
const SAMPLES: u64 = PASSES * MOST_PIXELS;

/// Times as many passes of `path` where something focuses light.
const MORE_PATHS: u64 = 4;

/// The error (relMSE) that the methods race to.
const GOAL: f64 = 1e-2;

/// Rays per pixel that the pilots of the other methods take together: where `path` has all light and is done for no more,
/// asking them costs as much as they could save.
const OTHER_PILOTS: f64 = 64.0;

/// Share of the picture's light, where it stands out from noise by so many standard errors, that a method may have missed;
/// light that is rare and bright makes noise that has not been seen yet.
const LEAST_LIGHT: f64 = 0.002;
const SURE: f64 = 5.0;

/// Standard errors where two methods that know nothing of each other have to say so.
const SURE_TWICE: f64 = 3.0;

/// Share of the goal that light which a method has not found may take; beyond, its noise cannot be believed.
const LEAST_MISSING: f64 = 0.25;

/// How far a pilot's picture is smoothed, in pixels, and the relative variance that is left where it is far enough.
const REACHES: [u32; 4] = [1, 3, 5, 8];
const SMOOTH_ENOUGH: f64 = 0.1;

/// Passes that measuring the first radii of `sppm` costs: a map of photons of its own and one wide look-up a pixel.
const SETUP: f64 = 1.5;

/// The power of the radius that blur goes with: 1 along edges, 2 where light is curved.
const BLUR: f64 = 1.5;

/// The power of the area that the square of blur goes with from a share of the photons to all of them: as pixels within a radius
/// of an edge have all of it.
const BLUR_OF_SHARE: f64 = 0.5;

/// Pixels that err together as they see the same photons.
const DISC: f64 = 30.0;

/// `photonmapper` is tried too where the best of the others promises more rays than this, all pixels together: trying it takes up
/// to a tenth of that, as it needs many photons however small the film.
const RAYS_WORTH_MAPS: f64 = 2e7;

/// `photonmapper` is taken where the others promise at least so many times its work: its error does not fall forever, and as it
/// takes few samples a pixel, rare bright ones, which pilots hardly meet, weigh more in it.
const MAPS_AHEAD: f64 = 1.5;

/// `photonmapper` is not tried where it gathers more rays than this for a camera sample: there will be few samples, and a pilot
/// would take longer than the render.
const MOST_GATHERED: u32 = 8;

/// Share of its photons that `photonmapper` shoots in a pilot, where discs are as much larger, so that as many are found.
const MAP_SHARE: f64 = 0.0625;

/// The method that promises most is looked at so many times longer, again and again, while that takes no more than this share
/// of the rays that it promises: two passes tell little of what is rare.
const LONGER: u64 = 4;
const LONGER_LOOK: f64 = 0.02;

/// Share of the goal that the blur of `photonmapper` may take, since passes do not take it away.
const MOST_BLUR: f64 = 0.5;

/// A photon's ray in closest-hit rays of the camera, where nothing is kept of it but the photon.
const PHOTON_RAY: f64 = 0.7;

/// What the pilot of one method found.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    pub method: &'static str,
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
/// much less work. The one that promises most is looked at longer where that takes little of what it promises. Cost is counted
/// in rays and look-ups rather than in seconds, so that the choice depends on the scene and the seed alone.
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
        return Ok(Some(Choice { method: "path", reason, trials: Vec::new() }));
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
        // Where something focuses light, paths meet it by chance: look at more of them, as they cost little, before they are
        // believed to find it.
        let more = if widest == "bdpt" { 1 } else { MORE_PATHS };
        let mut pilots = vec![Pilot::run(self.scene, "path", more * first_passes(self.scene, "path"), self.o)?];
        // Path tracing meets all light that nothing focuses.
        if widest == "bdpt" && pilots[0].against(&pilots, &guide(&pilots)).work_to_goal() <= OTHER_PILOTS {
            return Ok(pilots);
        }
        for method in ["sppm", widest] {
            pilots.push(Pilot::run(self.scene, method, first_passes(self.scene, method), self.o)?);
        }
        Ok(pilots)
    }

    /// Compares all with the last. Tries `photonmapper` where that could save much work, and looks longer at the one that
    /// promises most while that takes a small share of what it promises.
    fn run(&self, mut pilots: Vec<Pilot>) -> Result<Vec<Trial>, PlanError> {
        let fine = self.o.target_error.is_some_and(|error| error < GOAL);
        let cheap = matches!(self.mapper.method, Method::PhotonMapper(s) if s.final_gather_samples <= MOST_GATHERED);
        let mut maps: Option<Pilot> = None;
        loop {
            let guide = guide(&pilots);
            let trials: Vec<Trial> = pilots.iter().chain(&maps).map(|p| p.against(&pilots, &guide)).collect();
            let ahead = best(&trials);
            let promised = trials[ahead].work_to_goal() * self.pixels;
            if cheap && !fine && maps.is_none() && promised > RAYS_WORTH_MAPS {
                maps = Some(Pilot::of_maps(self.scene, self.mapper, PASSES, self.pixels));
                continue;
            }
            let pilot = pilots.iter().chain(&maps).nth(ahead).expect("there is a pilot for every trial");
            let passes = LONGER * pilot.passes;
            if !(pilot.rays * LONGER as f64 <= LONGER_LOOK * promised && promised.is_finite()) {
                return Ok(trials);
            }
            match pilots.get_mut(ahead) {
                Some(pilot) => *pilot = Pilot::run(self.scene, pilot.method, passes, self.o)?,
                None => maps = Some(Pilot::of_maps(self.scene, self.mapper, passes, self.pixels)),
            }
        }
    }
}

/// Passes that the pilot of a method makes at first.
fn first_passes(scene: &Scene, method: &str) -> u64 {
    // In a pass of `sppm` photons are many, however few the pixels.
    if method == "sppm" { PASSES } else { PASSES.max(SAMPLES / scene.film.window.pixels().max(1)) }
}

/// The trial that promises the least work, by such work as `photonmapper` has to be ahead by.
fn best(trials: &[Trial]) -> usize {
    let work = |t: &Trial| t.work_to_goal() * if t.method == "photonmapper" { MAPS_AHEAD } else { 1.0 };
    (0..trials.len()).min_by(|&a, &b| work(&trials[a]).total_cmp(&work(&trials[b]))).expect("there are candidates")
}

/// Takes the one that promises most.
fn judge(trials: Vec<Trial>) -> Choice {
    let tell = |t: &Trial| match t.passes.is_finite() {
        true => format!("{} {:.3e}", t.method, t.work_to_goal()),
        false if t.missing > LEAST_LIGHT || t.blur == 0.0 => format!("{} does not find all light", t.method),
        false => format!("{} blurs too much", t.method),
    };
    let told: Vec<String> = trials.iter().map(tell).collect();
    let reason = format!("rays per pixel to relmse {GOAL}: {}", told.join(", "));
    Choice { method: trials[best(&trials)].method, reason, trials }
}

/// The picture as far as it is known, squared, for errors to be relative to: medians of those methods whose pictures take the
/// least [smoothing](Pilot::smoothed).
fn guide(pilots: &[Pilot]) -> Vec<[f64; 3]> {
    let smoothed: Vec<(u32, Image)> = pilots.iter().map(Pilot::smoothed).collect();
    let least = smoothed.iter().map(|s| s.0).min().expect("there are candidates");
    let images: Vec<Image> = smoothed.into_iter().filter(|s| s.0 == least).map(|s| s.1).collect();
    let median = |i: usize, c: usize| {
        let mut values: Vec<f32> = images.iter().map(|image| image.pixels()[i][c]).collect();
        values.sort_unstable_by(f32::total_cmp);
        values[values.len() / 2]
    };
    (0..images[0].pixels().len()).map(|i| [0, 1, 2].map(|c| square(median(i, c)))).collect()
}

/// What a squared error of a pixel is relative to.
fn square(value: f32) -> f64 {
    f64::from(value).powi(2) + RELMSE_EPSILON * RELMSE_EPSILON
}

/// Variances over squares of the picture, on the average.
fn relative(variance: &[Rgb], squares: impl Iterator<Item = [f64; 3]>) -> f64 {
    let of = |(v, s): (&Rgb, [f64; 3])| (0..3).map(|c| f64::from(v[c]) / s[c]).sum::<f64>() / 3.0;
    variance.iter().zip(squares).map(of).sum::<f64>() / variance.len() as f64
}

/// Means over each pixel and those up to `reach` rows and columns away.
fn smooth(image: &Image, reach: u32) -> Image {
    let around = |x: u32, end: u32| x.saturating_sub(reach)..(x + reach + 1).min(end);
    let rows = Image::from_fn(image.width(), image.height(), |x, y| {
        let columns = around(x, image.width());
        let n = columns.len();
        columns.map(|x| image.pixel(x, y)).sum::<Rgb>() * (1.0 / n as f32)
    });
    Image::from_fn(image.width(), image.height(), |x, y| {
        let lines = around(y, image.height());
        let n = lines.len();
        lines.map(|y| rows.pixel(x, y)).sum::<Rgb>() * (1.0 / n as f32)
    })
}

/// A few passes of a method.
struct Pilot {
    method: &'static str,
    passes: u64,
    /// Camera samples that a pass of the render takes of a pixel; one in the pilot.
    samples: f64,
    work: f64,
    preparation: f64,
    /// What the pilot itself took, in rays.
    rays: f64,
    /// All pixels err by about the same factor, which a few passes do not tell.
    common_factor: bool,
    image: Image,
    /// Variance of one pass.
    noise: Vec<Rgb>,
    /// Means over blocks, and the variances of those.
    means: Image,
    variance: Vec<Rgb>,
    /// Where it estimates densities.
    discs: Option<Discs>,
}

/// What a pilot tells about estimates of density.
struct Discs {
    /// How fast they shrink, as in [`radius_sq_ratio`]: not at all where it is 1.
    alpha: f64,
    /// The area of the first ones in the render over that of all in the pilot, and the blur.
    area: f64,
    blur: f64,
    /// Variance of one pass of the same samples and photons, read within half the area.
    narrow: Vec<Rgb>,
    /// Squares of the share of that which narrow radii blur less, without bias, so that some are below zero; and the variance
    /// of one pass.
    sharper: Vec<[f64; 3]>,
    noise: Vec<Rgb>,
}

impl Discs {
    /// relMSE of what the first radii blur, as far as it stands out from noise after so many passes.
    fn blurred(&self, passes: u64, guide: &[[f64; 3]]) -> f64 {
        let (mut sum, mut doubt) = (0.0, 0.0);
        for ((square, noise), guide) in self.sharper.iter().zip(&self.noise).zip(guide) {
            sum += (0..3).map(|c| square[c] / guide[c]).sum::<f64>() / 3.0;
            doubt += ((0..3).map(|c| f64::from(noise[c]) / guide[c]).sum::<f64>() / 3.0).powi(2);
        }
        // Products of normal deviates, by estimates of their variance that vary themselves.
        let (n, pixels) = (passes as f64, self.noise.len() as f64);
        let doubt = doubt * DISC * 2.0 / (n * (n - 1.0)) / (1.0 + 2.0 / (n - 1.0));
        let more = 1.0 - f64::from(NARROW).powf(0.5 * BLUR);
        (sum - 2.0 * doubt.sqrt()).max(0.0) / pixels / (more * more)
    }
}

impl Pilot {
    fn run(scene: &Scene, method: &'static str, passes: u64, o: &PlanOverrides) -> Result<Self, PlanError> {
        let overrides = PlanOverrides {
            integrator: Some(method.to_owned()),
            spp: Some(passes),
            passes: Some(passes),
            track_error: true,
            track_bias: matches!(method, "sppm" | "vcm"),
            seed: o.seed,
            photons: o.photons,
            needs: o.needs.clone(),
            ..PlanOverrides::default()
        };
        let plan = Plan::new(scene, &overrides)?;
        let alpha = match plan.method {
            Method::Sppm(s) => Some(s.alpha),
            Method::Vcm(v) if v.merging != Merging::Off => Some(v.alpha),
            _ => None,
        };
        let pixels = scene.film.window.pixels().max(1) as f64;
        let mut pilot = Self::of(scene, method, &plan, alpha, |c| work(c, &plan.method) / pixels);
        if let Method::Sppm(s) = plan.method {
            pilot.preparation += SETUP * pilot.work;
            // As many paths as are seen, which scales all photons of a pass.
            pilot.common_factor = s.photon_sampling == PhotonSampling::Visibility;
        }
        Ok(pilot)
    }

    /// Tries a plan of `photonmapper`, made for a film of `pixels`, on that of `scene`.
    fn of_maps(scene: &Scene, plan: &Plan, passes: u64, pixels: f64) -> Self {
        let samples = plan.spp_per_pass as f64;
        let mut small = Plan {
            passes: 0..passes,
            spp_per_pass: 1,
            spp: Some(passes),
            track_error: true,
            bias_every: Some(1),
            bias_of_irradiance: false,
            layers: Vec::new(),
            target_error: None,
            ..plan.clone()
        };
        if let Method::PhotonMapper(s) = &mut small.method {
            for count in [&mut s.global_photons, &mut s.caustic_photons] {
                *count = (*count as f64 * MAP_SHARE).ceil() as u64;
            }
            for radius in [&mut s.lookup.global_radius, &mut s.lookup.caustic_radius] {
                *radius /= MAP_SHARE.sqrt() as f32;
            }
        }
        let pilot_pixels = scene.film.window.pixels().max(1) as f64;
        let mut pilot = Self::of(scene, "photonmapper", &small, Some(1.0), |c| {
            // Samples are seen twice.
            PHOTON_RAY * c.photon_rays as f64 / (MAP_SHARE * pixels) + samples * 0.5 * seen(c) / pilot_pixels
        });
        pilot.samples = samples;
        if let Some(discs) = &mut pilot.discs {
            discs.area *= MAP_SHARE;
            discs.blur *= MAP_SHARE.powf(BLUR_OF_SHARE);
        }
        pilot
    }

    /// Makes the passes of a plan; `cost` is that of what has been counted, per pixel of the render.
    fn of(
        scene: &Scene,
        method: &'static str,
        plan: &Plan,
        alpha: Option<f64>,
        cost: impl Fn(&Counters) -> f64,
    ) -> Self {
        let passes = plan.passes.end - plan.passes.start;
        let stop = AtomicBool::new(false);
        let control = Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent };
        let mut session = Session::new(scene, plan);
        let mut narrow = NarrowSpread::new(session.image().pixels().len());
        let mut works = Vec::new();
        while !session.finished() {
            session.step(&control);
            narrow.add(session.doubt().expect("the plan tracks its error"), &session.image());
            works.push(cost(&session.summary.counters));
        }
        let (image, doubt) = (session.image(), session.doubt().expect("the plan tracks its error"));
        // The first pass also has what comes before it.
        let work = (works[works.len() - 1] - works[0]) / (works.len() - 1) as f64;
        let of_a_pass = |variance: Vec<Rgb>| -> Vec<Rgb> { variance.iter().map(|&v| v * passes as f32).collect() };
        Self {
            method,
            passes,
            samples: 1.0,
            common_factor: false,
            work,
            preparation: (works[0] - work).max(0.0),
            rays: session.summary.counters.photon_rays as f64 + seen(&session.summary.counters),
            noise: of_a_pass(doubt.variance().expect("two passes")),
            means: block_means(&image),
            variance: doubt.block_variance().expect("two passes"),
            discs: alpha.map(|alpha| Discs {
                alpha,
                area: mean_area(PASSES, alpha) / mean_area(passes, alpha),
                blur: (mean_area(PASSES, alpha) / mean_area(passes, alpha)).powf(BLUR),
                narrow: of_a_pass(narrow.narrow.variance_of_mean().expect("two passes")),
                sharper: narrow.sharper.squares_of_means().expect("two passes"),
                noise: of_a_pass(narrow.sharper.variance_of_mean().expect("two passes")),
            }),
            image,
        }
    }

    /// The picture over as few pixels as leave little noise, and how far that reaches.
    ///
    /// Rare bright samples make a pixel's noise and the pixel itself: over too few pixels such noise looks small, and what the
    /// others have there, mostly darkness, makes that of a better method look large.
    fn smoothed(&self) -> (u32, Image) {
        let mut smoothed = None;
        for reach in REACHES {
            let image = smooth(&self.image, reach);
            let noise = relative(&self.noise, image.pixels().iter().map(|p| [0, 1, 2].map(|c| square(p[c]))));
            let samples = (self.passes * u64::from(2 * reach + 1).pow(2)) as f64;
            smoothed = Some((reach, image));
            if noise <= SMOOTH_ENOUGH * samples {
                break;
            }
        }
        smoothed.expect("there are reaches")
    }

    /// What this promises beside all, the widest last, with errors relative to `guide`.
    fn against(&self, all: &[Self], guide: &[[f64; 3]]) -> Trial {
        let widest = all.last().expect("there are candidates");
        let mut noise = relative(&self.noise, guide.iter().copied());
        let factor = if self.common_factor { factor(&self.means, &widest.means) } else { 1.0 };
        let mut offs = vec![0.0; self.variance.len()];
        for (i, off) in offs.iter_mut().enumerate() {
            for c in 0..3 {
                let of = |image: &Image| f64::from(image.pixels()[i][c]);
                let (a, b) = (factor * of(&self.means), of(&widest.means));
                let doubt = factor * factor * f64::from(self.variance[i][c]) + f64::from(widest.variance[i][c]);
                *off += ((a - b).powi(2) - doubt) / (3.0 * square(b as f32));
            }
        }
        let (off, missing) =
            if std::ptr::eq(self, widest) { (0.0, 0.0) } else { (above_noise(&offs), self.missing(all)) };
        let (mut photon_noise, mut blur, mut alpha) = (0.0, 0.0, 1.0);
        if let Some(discs) = &self.discs {
            photon_noise = (relative(&discs.narrow, guide.iter().copied()) - noise).clamp(0.0, noise);
            if discs.alpha < 1.0 {
                // Radii that have shrunk meanwhile add noise.
                noise -= photon_noise * (1.0 - 1.0 / discs.area);
                photon_noise /= discs.area;
            }
            blur = discs.blurred(self.passes, guide) * discs.blur;
            alpha = discs.alpha;
        }
        // Samples of a pass see the same photons.
        let of_samples = (noise - photon_noise) / self.samples;
        noise = of_samples + photon_noise;
        let passes = match self.method {
            "sppm" => passes_to_goal(of_samples, photon_noise, off.max(blur), alpha),
            "photonmapper" if blur > MOST_BLUR * GOAL => f64::INFINITY,
            "photonmapper" => passes_to_goal(of_samples, photon_noise, blur, alpha),
            _ if off > LEAST_MISSING * GOAL || missing > LEAST_LIGHT => f64::INFINITY,
            _ => passes_to_goal(of_samples, photon_noise, blur, alpha),
        };
        let (work, preparation) = (self.work, self.preparation);
        Trial { method: self.method, noise, photon_noise, blur, off, missing, work, preparation, passes }
    }

    /// Share of the picture's light that the widest of `all` finds, and this does not, in blocks where it surely has more
    /// or where another that knows the block better has.
    fn missing(&self, all: &[Self]) -> f64 {
        let widest = all.last().expect("there are candidates");
        let others = all.iter().filter(|p| !std::ptr::eq(*p, self) && !p.common_factor);
        others.map(|other| self.missing_where(other, widest)).fold(0.0, f64::max)
    }

    /// Share of the picture's light that `widest` finds, and this does not, in blocks where `other` surely finds more.
    ///
    /// What photon maps find they also blur, so that they only say where to look.
    fn missing_where(&self, other: &Self, widest: &Self) -> f64 {
        let sum = |p: &Rgb| (0..3).map(|c| f64::from(p[c])).sum::<f64>();
        let sums = |p: &Self| p.means.pixels().iter().map(sum).zip(p.block_doubts()).collect::<Vec<_>>();
        let sure = if std::ptr::eq(other, widest) { SURE } else { SURE_TWICE };
        let (mut missing, mut doubts, mut all) = (0.0, 0.0, 0.0);
        for (((here, doubt), (there, other_doubt)), (wide, wide_doubt)) in
            sums(self).into_iter().zip(sums(other)).zip(sums(widest))
        {
            if there - here > sure * (doubt + other_doubt).sqrt() {
                missing += wide - here;
                doubts += doubt + wide_doubt;
            }
            all += wide;
        }
        if all > 0.0 && missing > SURE_TWICE * doubts.sqrt() { missing / all } else { 0.0 }
    }

    /// Variances of the blocks' means, channels summed up: of a block's pixels, as two passes tell little of a block, times what
    /// pixels that err together add to it in all blocks.
    fn block_doubts(&self) -> Vec<f64> {
        // Channels err together at worst.
        let sum = |v: &Rgb| (0..3).map(|c| f64::from(v[c]).sqrt()).sum::<f64>().powi(2);
        let (width, height) = (self.image.width(), self.image.height());
        let pixels = Image::from_fn(width, height, |x, y| self.noise[(y * width + x) as usize]);
        let samples = self.passes as f64 * f64::from(BLOCK_SIZE * BLOCK_SIZE);
        let apart: Vec<f64> = block_means(&pixels).pixels().iter().map(|v| sum(v) / samples).collect();
        let (together, total) = (self.variance.iter().map(sum).sum::<f64>(), apart.iter().sum::<f64>());
        let factor = if total > 0.0 { (together / total).max(1.0) } else { 1.0 };
        apart.into_iter().map(|v| v * factor).collect()
    }
}

/// The pictures of narrow radii and what they are from the others, which [`Doubt`] keeps as bias.
struct NarrowSpread {
    /// Sums up to the last pass.
    before: [Vec<[f64; 3]>; 2],
    narrow: Spread,
    sharper: Spread,
}

impl NarrowSpread {
    fn new(pixels: usize) -> Self {
        let before = std::array::from_fn(|_| vec![[0.0; 3]; pixels]);
        Self { before, narrow: Spread::new(pixels), sharper: Spread::new(pixels) }
    }

    /// Takes the last pass of what a pilot knows by now, with one sample a pixel.
    fn add(&mut self, doubt: &Doubt, image: &Image) {
        let Some(bias) = &doubt.bias else { return };
        let last = |before: &mut Vec<[f64; 3]>, share: &dyn Fn(usize, usize) -> f64| {
            let now: Vec<[f64; 3]> = (0..before.len()).map(|i| [0, 1, 2].map(|c| share(i, c))).collect();
            let pass = now.iter().zip(&*before).map(|(n, b)| Rgb::from([0, 1, 2].map(|c| (n[c] - b[c]) as f32)));
            let pass = Image::rgb(image.width(), image.height(), pass.collect());
            *before = now;
            pass
        };
        let [narrow, sharper] = &mut self.before;
        let more = |i: usize, c: usize| bias.pixels.sum[i][c] / f64::from(EXTRAPOLATE);
        self.narrow.add(&last(narrow, &|i, c| doubt.pixels.sum[i][c] - more(i, c)), 1);
        self.sharper.add(&last(sharper, &more), 1);
    }
}

/// The factor that brings `image` closest to `other`, by relative squares.
fn factor(image: &Image, other: &Image) -> f64 {
    let mut sums = (0.0, 0.0);
    for (a, b) in image.pixels().iter().zip(other.pixels()) {
        for (a, b) in [0, 1, 2].map(|c| (f64::from(a[c]), f64::from(b[c]))) {
            sums.0 += a * b / square(b as f32);
            sums.1 += a * a / square(b as f32);
        }
    }
    if sums.1 > 0.0 { sums.0 / sums.1 } else { 1.0 }
}

/// The mean of values from blocks, less two of its standard errors; at least 0.
fn above_noise(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean - 2.0 * (squares / (n * (n - 1.0).max(1.0))).sqrt()).max(0.0)
}

/// Passes until noise and blur together are below the goal.
///
/// The noise of camera samples falls with the passes. That of photons grows meanwhile with one over the area that they are
/// sought in, and what discs blur falls with their radius. The radius of the middle pass stands for all.
fn passes_to_goal(noise: f64, photon_noise: f64, blur: f64, alpha: f64) -> f64 {
    let error = |n: f64| {
        let area = radius_sq_ratio((n / 2.0) as u64, alpha);
        (noise + photon_noise / area) / n + blur * area.powf(BLUR)
    };
    let (mut low, mut high) = (1.0f64, 1e12f64);
    while high > 1.001 * low {
        let n = (low * high).sqrt();
        *(if error(n) > GOAL { &mut low } else { &mut high }) = n;
    }
    high
}

/// The mean area of the discs of so many passes, by how noise goes with it, in units of that of the first.
fn mean_area(passes: u64, alpha: f64) -> f64 {
    passes as f64 / (0..passes).map(|i| 1.0 / radius_sq_ratio(i, alpha)).sum::<f64>()
}

/// Closest-hit rays that everything counted is worth, less what was seen a second time to tell the blur.
fn work(c: &Counters, method: &Method) -> f64 {
    // Of eight scenes, 0.8 to 1.3 for a photon's ray and 0.5 to 2.3 for a look-up, shading included.
    let (photons, seen) = (c.photon_rays as f64, seen(c));
    match method {
        Method::Sppm(_) => photons + 0.5 * seen,
        Method::Vcm(v) if v.merging != Merging::Off => 0.5 * (photons + seen),
        _ => photons + seen,
    }
}

/// The part of it that is not of photons.
fn seen(c: &Counters) -> f64 {
    c.camera_rays as f64 + 0.7 * c.shadow_rays as f64 + 1.5 * c.photon_queries as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Key, Purpose, Sampler, Sequence};

    /// A method that finds light of 1 everywhere with one sample in `rarity`, and as much more in it.
    fn sparse(method: &'static str, rarity: f32, key: u64) -> Pilot {
        let (width, height, passes) = (96, 96, 3);
        let mut s = Sampler::new(Sequence::Independent, Key::new(3, Purpose::Test, key), 0);
        let mut noise = Vec::new();
        let image = Image::from_fn(width, height, |_, _| {
            let found = (0..passes).filter(|_| s.next_1d() < 1.0 / rarity).count() as f32;
            let mean = found / passes as f32;
            // The variance of one sample, as three tell it.
            noise.push(Rgb::splat(rarity * rarity * mean * (1.0 - mean) * passes as f32 / (passes as f32 - 1.0)));
            Rgb::splat(rarity * mean)
        });
        let (means, work) = (block_means(&image), 1.0);
        let variance = vec![Rgb::BLACK; means.pixels().len()];
        Pilot {
            method,
            passes,
            samples: 1.0,
            work,
            preparation: 0.0,
            rays: 0.0,
            common_factor: false,
            image,
            noise,
            means,
            variance,
            discs: None,
        }
    }

    /// The variance over the square is rarity − 1. Rare samples also make most of the picture that it is relative to, if that
    /// is taken over few pixels.
    #[test]
    fn rare_light_is_as_noisy_as_it_is() {
        for rarity in [2.0f32, 10.0, 50.0] {
            let pilots = [sparse("path", rarity, 1), sparse("sppm", 1.1, 2), sparse("vcm", rarity, 3)];
            let guide = guide(&pilots);
            for (pilot, truth) in pilots.iter().zip([rarity - 1.0, 0.1, rarity - 1.0]) {
                let told = relative(&pilot.noise, guide.iter().copied()) / f64::from(truth);
                assert!((0.8..1.3).contains(&told), "{} of {rarity}: {told} of the noise", pilot.method);
            }
        }
    }

    /// Camera samples alone need noise over goal; photons alone N^(1 − α) times as many, less what the middle radius stands
    /// for; blur alone what shrinks its radius.
    #[test]
    fn passes_follow_what_the_error_is_of() {
        let goal = |noise, photons, blur| passes_to_goal(noise, photons, blur, 2.0 / 3.0);
        assert!((goal(0.5, 0.0, 0.0) / 50.0 - 1.0).abs() < 0.01);
        // Σ 1/area over N² is 3/4 Γ(5/3) N^(−2/3).
        let photons = (0.5 * 0.75 * 0.9027 / GOAL).powf(1.5);
        assert!((goal(0.0, 0.5, 0.0) / photons - 1.0).abs() < 0.2, "{}", goal(0.0, 0.5, 0.0));
        assert!(goal(0.2, 0.3, 0.0) > goal(0.5, 0.0, 0.0) && goal(0.2, 0.3, 0.0) < goal(0.0, 0.5, 0.0));
        let blurred = goal(1e-6, 0.0, 0.05);
        assert!((radius_sq_ratio((blurred / 2.0) as u64, 2.0 / 3.0).powf(BLUR) * 0.05 / GOAL - 1.0).abs() < 0.05);
        assert_eq!(goal(1e-9, 0.0, 0.0).round(), 1.0);
    }

    /// What is told of radii that have shrunk is brought back to the first ones.
    #[test]
    fn discs_shrink_while_they_are_looked_at() {
        assert_eq!((mean_area(1, 0.5), mean_area(9, 1.0)), (1.0, 1.0));
        let (two, ratio) = (mean_area(2, 0.5), radius_sq_ratio(1, 0.5));
        assert!((two - 2.0 / (1.0 + 1.0 / ratio)).abs() < 1e-12 && mean_area(8, 0.5) < two);
    }

    /// Fewer photons in larger discs are as noisy as all of them in discs as they are, within what a few passes tell; and a pass
    /// has the noise of its samples and of the photons that they share.
    #[test]
    fn a_share_of_the_photons_tells_the_noise_of_all() {
        let text = r#"<scene version="3.0.0"><sensor type="perspective">
            <transform name="to_world"><lookat origin="0, 3, 5" target="0, 0.5, 0" up="0, 1, 0"/></transform>
            <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
            <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/></film></sensor>
            <shape type="rectangle"><transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/></transform></shape>
            <shape type="sphere"><point name="center" x="0" y="1" z="0"/><bsdf type="dielectric"/></shape>
            <shape type="sphere"><point name="center" x="1" y="5" z="0"/><float name="radius" value="0.5"/>
                <emitter type="area"><rgb name="radiance" value="20"/></emitter></shape></scene>"#;
        let scene = Scene::from_text(text, std::path::Path::new("test.xml"), &crate::scene::LoadOptions::default());
        let scene = scene.unwrap_or_else(|e| panic!("{e}"));
        let integrator = Some("photonmapper".to_owned());
        let o =
            PlanOverrides { integrator, fresh_maps: true, photons: Some(20_000), seed: Some(5), ..Default::default() };
        let plan = Plan::new(&scene, &o).expect("a plan");
        assert_eq!((plan.spp_per_pass, plan.passes.clone()), (2, 0..8));
        let pixels = scene.film.window.pixels() as f64;
        let told = Pilot::of_maps(&scene, &plan, 8, pixels);
        let plan = Plan { track_error: true, ..plan };
        let all =
            Pilot::of(&scene, "photonmapper", &plan, None, |c| (PHOTON_RAY * c.photon_rays as f64 + seen(c)) / pixels);
        let pilots = [all];
        let guide = guide(&pilots);
        let (told, all) = (told.against(&pilots, &guide), pilots[0].against(&pilots, &guide));
        assert!((0.6..1.7).contains(&(told.noise / all.noise)), "{told:?} {all:?}");
        assert!((0.8..1.25).contains(&(told.work / all.work)), "{told:?} {all:?}");
    }

    /// The edges of the ring's caustic are blurred by as much as `photonmapper` with all photons ends with, 0.028 at 320 × 240.
    #[test]
    fn blur_that_stays_is_told() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/ring.xml");
        let defines = [("width", "128"), ("height", "96")].map(|(k, v)| (k.to_owned(), v.to_owned()));
        let options = crate::scene::LoadOptions { defines: defines.into_iter().collect(), ..Default::default() };
        let scene = Scene::load(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        let o = PlanOverrides { fresh_maps: true, seed: Some(3), ..Default::default() };
        let [mapper, vcm] = ["photonmapper", "vcm"].map(|name| {
            let o = PlanOverrides { integrator: Some(name.to_owned()), track_error: true, ..o.clone() };
            Plan::new(&scene, &o).expect("a plan")
        });
        let pixels = scene.film.window.pixels() as f64;
        let maps = Pilot::of_maps(&scene, &mapper, PASSES, pixels);
        let widest = [Pilot::of(&scene, "vcm", &Plan { passes: 0..4, ..vcm }, None, |c| seen(c) / pixels)];
        let trial = maps.against(&widest, &guide(&widest));
        assert!((0.01..0.08).contains(&trial.blur) && trial.passes.is_infinite(), "{trial:?}");
    }

    /// A picture that is too bright everywhere has no light missing; one that is dark in places has.
    #[test]
    fn a_common_factor_is_found() {
        let shades = |f: fn(u32) -> f32| Image::from_fn(8, 8, |x, y| Rgb::splat(f(x) * (1.0 + y as f32)));
        let truth = shades(|_| 1.0);
        assert!((factor(&shades(|_| 1.25), &truth) - 0.8).abs() < 1e-6);
        assert!((factor(&shades(|x| (x % 2) as f32), &truth) - 1.0).abs() < 1e-2);
        assert!((factor(&shades(|_| 0.0), &truth) - 1.0).abs() < 1e-6);
    }
}
