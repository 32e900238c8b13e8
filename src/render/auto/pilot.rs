//! A few passes of one method, and what they cost.

use std::ops::Range;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::{BLUR, PASSES};
use crate::color::Rgb;
use crate::film::Film;
use crate::gather::NARROW;
use crate::image::{Image, block_means};
use crate::integrator::sppm::{LightsMet, PhotonSampling, radius_sq_ratio};
use crate::integrator::vcm::Merging;
use crate::render::doubt::EXTRAPOLATE;
use crate::render::spread::Spread;
use crate::render::{Control, Doubt, Method, Plan, PlanError, PlanOverrides, Session, Silent, render_pass};
use crate::scene::Scene;
use crate::tally::Counters;

/// Passes that measuring the first radii of `sppm` costs: a map of photons of its own and one wide look-up a pixel.
const SETUP: f64 = 1.5;

/// Share of its photons that `photonmapper` shoots in a pilot, where discs are as much larger, so that as many are found.
const MAP_SHARE: f64 = 0.0625;

/// The power of the area that the square of blur goes with from a share of the photons to all of them: as pixels within a radius
/// of an edge have all of it.
const BLUR_OF_SHARE: f64 = 0.5;

/// A photon's ray in closest-hit rays of the camera, where nothing is kept of it but the photon.
const PHOTON_RAY: f64 = 0.7;

/// Pixels that err together as they see the same photons.
const DISC: f64 = 30.0;

/// A few passes of a method.
pub(super) struct Pilot {
    pub method: &'static str,
    pub passes: u64,
    /// Camera samples that a pass of the render takes of a pixel; one in the pilot.
    pub samples: u64,
    pub work: f64,
    /// What of that photons are, where all samples of a pass see the same.
    pub photon_work: f64,
    pub preparation: f64,
    /// What the pilot itself took, in rays.
    pub rays: f64,
    /// All pixels err by about the same factor, which a few passes do not tell.
    pub common_factor: bool,
    pub image: Image,
    /// Variance of one pass.
    pub noise: Vec<Rgb>,
    /// Means over blocks, and the variances of those.
    pub means: Image,
    pub variance: Vec<Rgb>,
    /// Where it estimates densities.
    pub discs: Option<Discs>,
}

/// What a pilot tells about estimates of density.
pub(super) struct Discs {
    /// How fast they shrink, as in [`radius_sq_ratio`]: not at all where it is 1.
    pub alpha: f64,
    /// The area of the first ones in the render over that of all in the pilot, and the blur.
    pub area: f64,
    pub blur: f64,
    /// Variance of one pass of the same samples and photons, read within half the area.
    pub narrow: Vec<Rgb>,
    /// Squares of the share of that which narrow radii blur less, without bias, so that some are below zero; and the variance
    /// of one pass.
    pub sharper: Vec<[f64; 3]>,
    pub noise: Vec<Rgb>,
}

impl Discs {
    /// relMSE of what the first radii blur, as far as it stands out from noise after so many passes.
    pub fn blurred(&self, passes: u64, guide: &[[f64; 3]]) -> f64 {
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
    /// Makes so many passes of a method on the film of `scene`.
    pub fn run(scene: &Scene, method: &'static str, passes: u64, o: &PlanOverrides) -> Result<Self, PlanError> {
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
        let mut pilot = Self::of(scene, method, &plan, alpha, |c| work(c, &plan.method).map(|w| w / pixels));
        if let Method::Sppm(s) = plan.method {
            pilot.preparation += SETUP * pilot.work;
            // As many paths as are seen, which scales all photons of a pass.
            pilot.common_factor = s.photon_sampling == PhotonSampling::Visibility;
        }
        Ok(pilot)
    }

    /// Tries a plan of `photonmapper`, made for a film of `pixels`, on that of `scene`.
    pub fn of_maps(scene: &Scene, plan: &Plan, passes: u64, pixels: f64) -> Self {
        let samples = plan.spp_per_pass;
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
            // As many gather rays are short as in the render.
            s.short_gather *= MAP_SHARE.sqrt() as f32;
        }
        let pilot_pixels = scene.film.window.pixels().max(1) as f64;
        let mut pilot = Self::of(scene, "photonmapper", &small, Some(1.0), |c| {
            [PHOTON_RAY * c.photon_rays as f64 / (MAP_SHARE * pixels), samples as f64 * seen(c) / pilot_pixels]
        });
        pilot.samples = samples;
        if let Some(discs) = &mut pilot.discs {
            discs.area *= MAP_SHARE;
            discs.blur *= MAP_SHARE.powf(BLUR_OF_SHARE);
        }
        pilot
    }

    /// Makes the passes of a plan; `cost` is that of the photons and of the samples counted, per pixel of the render.
    fn of(
        scene: &Scene,
        method: &'static str,
        plan: &Plan,
        alpha: Option<f64>,
        cost: impl Fn(&Counters) -> [f64; 2],
    ) -> Self {
        let passes = plan.passes.end - plan.passes.start;
        let stop = AtomicBool::new(false);
        let control = Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent };
        let mut session = Session::new(scene, plan);
        let mut narrow = NarrowSpread::new(session.image().pixels().len());
        let mut costs = Vec::new();
        while !session.finished() {
            session.step(&control);
            narrow.add(session.doubt().expect("the plan tracks its error"), &session.image());
            costs.push(cost(&session.summary.counters));
        }
        let (image, doubt) = (session.image(), session.doubt().expect("the plan tracks its error"));
        let counters = session.summary.counters;
        let area = |alpha| mean_area(PASSES, alpha) / mean_area(passes, alpha);
        // The first pass also has what comes before it.
        let (first, last) = (costs[0], costs[costs.len() - 1]);
        let [photon_work, sample_work] = [0, 1].map(|i| (last[i] - first[i]) / (costs.len() - 1) as f64);
        let work = photon_work + sample_work;
        let of_a_pass = |variance: Vec<Rgb>| -> Vec<Rgb> { variance.iter().map(|&v| v * passes as f32).collect() };
        Self {
            method,
            passes,
            samples: 1,
            common_factor: false,
            work,
            photon_work,
            preparation: (first[0] + first[1] - work).max(0.0),
            rays: counters.photon_rays as f64 + seen(&counters),
            noise: of_a_pass(doubt.variance().expect("two passes")),
            means: block_means(&image),
            variance: doubt.block_variance().expect("two passes"),
            discs: alpha.map(|alpha| Discs {
                alpha,
                area: area(alpha),
                blur: area(alpha).powf(BLUR),
                narrow: of_a_pass(narrow.narrow.variance_of_mean().expect("two passes")),
                sharper: narrow.sharper.squares_of_means().expect("two passes"),
                noise: of_a_pass(narrow.sharper.variance_of_mean().expect("two passes")),
            }),
            image,
        }
    }
}

/// What camera paths meet of lights through mirrors and glass, in each of so many passes of one sample a pixel: light that all
/// methods have, with what is rare and bright in it, as small images of a lamp. The passes share no samples with pilots.
pub(super) fn lights_met(scene: &Scene, passes: Range<u64>, o: &PlanOverrides) -> Result<Vec<Image>, PlanError> {
    let overrides =
        PlanOverrides { integrator: Some("sppm".to_owned()), needs: o.needs.clone(), ..PlanOverrides::default() };
    let plan = Plan::new(scene, &overrides)?;
    let Method::Sppm(settings) = plan.method else { unreachable!("the method is named") };
    let seed = o.seed.unwrap_or(plan.seed).wrapping_add(1);
    let picture = |pass| {
        let mut film = Film::new(scene.film.window, scene.film.filter);
        render_pass(scene, &LightsMet(settings), &mut film, seed, pass..pass + 1, &|_| {});
        film.develop(0.0)
    };
    Ok(passes.map(picture).collect())
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

/// The mean area of the discs of so many passes, by how noise goes with it, in units of that of the first.
fn mean_area(passes: u64, alpha: f64) -> f64 {
    passes as f64 / (0..passes).map(|i| 1.0 / radius_sq_ratio(i, alpha)).sum::<f64>()
}

/// Closest-hit rays that the photons and the samples counted are worth, less what was seen a second time to tell the blur.
fn work(c: &Counters, method: &Method) -> [f64; 2] {
    // A photon's ray is 0.57 to 1.38 in nineteen scenes (half below 0.81), a look-up 0.5 to 2.3 in eight, shading included.
    let (photons, seen) = (c.photon_rays as f64, seen(c));
    match method {
        Method::Vcm(v) if v.merging != Merging::Off => [0.5 * photons, 0.5 * seen],
        _ => [photons, seen],
    }
}

/// The part of it that is not of photons.
fn seen(c: &Counters) -> f64 {
    c.camera_rays as f64 + 0.7 * c.shadow_rays as f64 + 1.5 * c.photon_queries as f64
}

#[cfg(test)]
mod tests {
    use super::super::verdict::Guide;
    use super::*;

    /// What is told of radii that have shrunk is brought back to the first ones.
    #[test]
    fn discs_shrink_while_they_are_looked_at() {
        assert_eq!((mean_area(1, 0.5), mean_area(9, 1.0)), (1.0, 1.0));
        let (two, ratio) = (mean_area(2, 0.5), radius_sq_ratio(1, 0.5));
        assert!((two - 2.0 / (1.0 + 1.0 / ratio)).abs() < 1e-12 && mean_area(8, 0.5) < two);
    }

    /// Fewer photons in larger discs are as noisy as all of them in discs as they are, within what a few passes tell; and a pass
    /// has the noise of its samples and of the photons that they share. Near the wall as many gather rays are short: 1.10 of the work
    /// would be told by the discs of the pilot.
    #[test]
    fn a_share_of_the_photons_tells_the_noise_of_all() {
        let text = r#"<scene version="3.0.0"><sensor type="perspective">
            <transform name="to_world"><lookat origin="0, 3, 5" target="0, 0.5, 0" up="0, 1, 0"/></transform>
            <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
            <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/></film></sensor>
            <shape type="rectangle"><transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/></transform></shape>
            <shape type="rectangle"><transform name="to_world"><scale value="4"/><translate z="-1"/></transform></shape>
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
        let all = Pilot::of(&scene, "photonmapper", &plan, None, |c| {
            [PHOTON_RAY * c.photon_rays as f64 / pixels, seen(c) / pixels]
        });
        let pilots = [all];
        let guide = Guide::new(&pilots);
        let (told, all) = (told.against(&pilots, &guide, 0.0), pilots[0].against(&pilots, &guide, 0.0));
        assert!((0.6..1.7).contains(&(told.noise / all.noise)), "{told:?} {all:?}");
        assert!((0.95..1.05).contains(&(told.work / all.work)), "{told:?} {all:?}");
    }

    fn ring(width: &str, height: &str) -> Scene {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/ring.xml");
        let defines = [("width", width), ("height", height)].map(|(k, v)| (k.to_owned(), v.to_owned()));
        let options = crate::scene::LoadOptions { defines: defines.into_iter().collect(), ..Default::default() };
        Scene::load(&path, &options).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Where camera paths read the maps themselves, reading both radii at once is the same as doing one after the other.
    #[test]
    fn both_radii_are_read_at_once() {
        let scene = ring("48", "36");
        let integrator = Some("photonmapper".to_owned());
        let o =
            PlanOverrides { integrator, photons: Some(3000), track_error: true, seed: Some(3), ..Default::default() };
        let mut plan = Plan { passes: 0..1, bias_every: Some(1), ..Plan::new(&scene, &o).expect("a plan") };
        let Method::PhotonMapper(s) = &mut plan.method else { panic!("{plan:?}") };
        s.final_gather = false;
        let [apart, at_once] = [true, false].map(|bias_of_irradiance| {
            let plan = Plan { bias_of_irradiance, ..plan.clone() };
            let stop = AtomicBool::new(false);
            let mut session = Session::new(&scene, &plan);
            session.step(&Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent });
            (session.image(), session.doubt().and_then(Doubt::bias).expect("it is told"))
        });
        assert_eq!(apart.0.pixels(), at_once.0.pixels());
        let largest = apart.1.iter().map(|b| b.max_channel()).fold(0.0, f32::max);
        assert!(largest > 0.01, "{largest}");
        for (a, b) in apart.1.iter().zip(&at_once.1) {
            assert!((0..3).all(|c| (a[c] - b[c]).abs() < 1e-5 * largest), "{a:?} {b:?}");
        }
    }

    /// What `sppm` reads within narrow discs beside its own is what it sees where its own discs are as narrow.
    #[test]
    fn narrow_discs_are_what_a_narrow_radius_sees() {
        let scene = ring("48", "36");
        let o = PlanOverrides {
            integrator: Some("sppm".to_owned()),
            photons: Some(3000),
            track_error: true,
            seed: Some(3),
            ..Default::default()
        };
        let plan = Plan { passes: 0..1, bias_every: Some(1), ..Plan::new(&scene, &o).expect("a plan") };
        let [wide, narrow] = [0.2, 0.2 * NARROW.sqrt()].map(|radius| {
            let mut plan = plan.clone();
            let Method::Sppm(s) = &mut plan.method else { panic!("{plan:?}") };
            (s.initial_radius, s.boundary_correction) = (Some(radius), false);
            let stop = AtomicBool::new(false);
            let mut session = Session::new(&scene, &plan);
            session.step(&Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent });
            (session.image(), session.doubt().and_then(Doubt::bias).expect("it is told"))
        });
        let mut largest = 0.0f32;
        for ((own, bias), expected) in wide.0.pixels().iter().zip(&wide.1).zip(narrow.0.pixels()) {
            for c in 0..3 {
                let read = own[c] - bias[c] / EXTRAPOLATE;
                assert!((read - expected[c]).abs() <= 1e-5 * own[c].max(1.0), "{own:?} {bias:?} {expected:?}");
                largest = largest.max((own[c] - expected[c]).abs());
            }
        }
        assert!(largest > 0.01, "{largest}");
    }

    /// The edges of the ring's caustic are blurred by as much as `photonmapper` with all photons ends with, 0.028 at 320 × 240.
    #[test]
    fn blur_that_stays_is_told() {
        let scene = ring("128", "96");
        let o = PlanOverrides { fresh_maps: true, seed: Some(3), ..Default::default() };
        let [mapper, vcm] = ["photonmapper", "vcm"].map(|name| {
            let o = PlanOverrides { integrator: Some(name.to_owned()), track_error: true, ..o.clone() };
            Plan::new(&scene, &o).expect("a plan")
        });
        let pixels = scene.film.window.pixels() as f64;
        let maps = Pilot::of_maps(&scene, &mapper, PASSES, pixels);
        let widest = [Pilot::of(&scene, "vcm", &Plan { passes: 0..4, ..vcm }, None, |c| [0.0, seen(c) / pixels])];
        let trial = maps.against(&widest, &Guide::new(&widest), 0.0);
        assert!((0.01..0.08).contains(&trial.blur) && trial.passes.is_infinite(), "{trial:?}");
    }
}
