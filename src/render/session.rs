use std::ops::Range;

use super::doubt::{Doubt, PassBias};
use super::pass::render_films;
use super::{ClampSummary, Control, Method, Plan, Summary, render_pass};
use super::{layers::LayerFilms, progressive::Progressive};
use crate::color::Rgb;
use crate::film::Film;
use crate::gather::cache::IrradianceCache;
use crate::gather::{NARROW, PhotonMaps, ShadowMap};
use crate::image::Image;
use crate::integrator::sppm::SharedStatistics;
use crate::integrator::vcm::Merging;
use crate::integrator::{PhotonMapper, PhotonMapperSettings, vcm};
use crate::photon::PhotonMap;
use crate::scene::{Item, Scene};
use crate::shoot::{Emission, Target, plan_emission, shoot_paths};
use crate::tally::Counters;

/// A render between two passes: the plan, and the sums of what the finished passes found.
///
/// Passes are independent of each other and known by their number, so the picture after some passes does not depend on
/// how, when or in how many runs they were made.
pub struct Session<'s> {
    pub(super) scene: &'s Scene,
    pub(super) plan: Plan,
    /// Sums over the finished passes.
    pub(super) film: Film,
    /// What the passes say about their own noise; only where it was asked for.
    pub(super) doubt: Option<Doubt>,
    /// What is to be seen beside the picture.
    pub(super) layers: Option<LayerFilms>,
    /// The number of the next pass.
    pub(super) next: u64,
    /// What progressive photon mapping keeps; made by its first step.
    pub(super) progressive: Option<Progressive>,
    /// Statistics of earlier passes, from a checkpoint, until progressive photon mapping takes them up.
    pub(super) resumed_shared: Option<SharedStatistics>,
    /// How photons of each kind are emitted, which is found out once for all passes of `photonmapper`.
    emissions: Vec<(Target, Emission)>,
    /// Memory that passes of the bidirectional methods use again.
    pub(super) workspace: vcm::Workspace,
    pub summary: Summary,
}

impl<'s> Session<'s> {
    /// A render that has not begun.
    pub fn new(scene: &'s Scene, plan: &Plan) -> Self {
        let film = Film::new(scene.camera.window(), scene.film.filter).with_clamp(plan.clamp);
        Self {
            scene,
            doubt: plan.track_error.then(|| Doubt::new(&film, plan.bias_every.is_some())),
            layers: (!plan.layers.is_empty()).then(|| LayerFilms::new(&film, &plan.layers)),
            film,
            next: plan.passes.start,
            progressive: None,
            resumed_shared: None,
            emissions: Vec::new(),
            workspace: vcm::Workspace::default(),
            summary: Summary::new(plan),
            plan: plan.clone(),
        }
    }

    /// Whether all passes of the plan are in.
    pub fn finished(&self) -> bool {
        self.next >= self.plan.passes.end
    }

    /// Passes that are in.
    pub fn passes(&self) -> u64 {
        self.next - self.plan.passes.start
    }

    /// Makes the next pass, unless all are in.
    pub fn step(&mut self, control: &Control) {
        if self.finished() {
            return;
        }
        let samples = self.plan.samples_of(self.next);
        let spp = samples.end - samples.start;
        // Give every pass a film of its own, so that no pass depends on those before it.
        let mut film = self.film.fresh();
        let mut others = None;
        let tell_bias = self.plan.tells_bias(self.next);
        let (done, passes) = (self.passes() as f64, (self.plan.passes.end - self.plan.passes.start) as f64);
        let report = |fraction: f64| {
            let by_passes = (done + fraction) / passes;
            control.progress.advance(by_passes.max(control.elapsed_fraction()).min(1.0), done as u64);
        };
        let (scene, seed) = (self.scene, self.plan.seed);
        let counters = match self.plan.method {
            Method::Path(p) => {
                self.summary.time("render", || render_pass(scene, &p, &mut film, seed, samples, &report))
            }
            Method::Direct(d) => {
                self.summary.time("render", || render_pass(scene, &d, &mut film, seed, samples, &report))
            }
            Method::Ppm(settings) | Method::Sppm(settings) => {
                let (counters, narrow) = self.progressive_pass(&settings, &mut film, samples, control, &report);
                others = narrow.map(|narrow| (None, narrow));
                counters
            }
            Method::LightTracer(v) | Method::Bidirectional(v) | Method::Vcm(v) => {
                let range = samples.clone();
                let work = &mut self.workspace;
                let mut counters =
                    self.summary.time("render", || vcm::render_pass(scene, &v, seed, range, &mut film, work, &report));
                self.summary.light_paths = work.guidance();
                self.summary.light_paths_per_sample = work.light_paths_per_sample();
                if tell_bias && v.merging != Merging::Off {
                    let (v, mut narrow) = (v.with_radius_scaled(NARROW.sqrt()), film.fresh());
                    let again = || vcm::render_pass(scene, &v, seed, samples, &mut narrow, work, &|_| {});
                    counters += self.summary.time("estimate bias", again);
                    others = Some((None, narrow));
                }
                counters
            }
            Method::PhotonMapper(settings) => {
                let mut maps = self.build_maps(&settings, control);
                let cache = self.fill_cache(&settings, &maps, control);
                control.progress.phase("render");
                let recipe = PhotonMapper { settings, maps: &maps, cache: cache.as_ref() };
                let range = samples.clone();
                // Gather rays average over what they read, so that it may be taken as it is.
                let at_once = tell_bias && !self.plan.bias_of_irradiance;
                let mut narrow = at_once.then(|| film.fresh());
                let mut counters = self.summary.time("render", || match &mut narrow {
                    Some(narrow) => render_films(scene, &recipe, [&mut film, narrow], seed, range, &report),
                    None => render_pass(scene, &recipe, &mut film, seed, range, &report),
                });
                // See the same samples once more for the layers.
                if let Some(layers) = &mut self.layers {
                    let range = samples.clone();
                    counters += self.summary.time("render layers", || layers.add_pass(scene, recipe, seed, range));
                }
                if let Some(narrow) = narrow {
                    others = Some((None, narrow));
                } else if tell_bias {
                    let exact =
                        maps.forget_irradiance().then(|| self.again(&settings, &maps, samples.clone(), control));
                    maps.narrow();
                    let narrow = self.again(&settings, &maps, samples, control);
                    counters += narrow.1;
                    if let Some(exact) = &exact {
                        counters += exact.1;
                    }
                    others = Some((exact.map(|e| e.0), narrow.0));
                }
                counters
            }
        };
        // Add it to what is there.
        if let Some(doubt) = &mut self.doubt {
            let scale = 1.0 / spp as f64;
            let pass = film.develop(scale);
            let bias = tell_bias.then(|| match others {
                Some((exact, narrow)) => {
                    let exact: Option<Image> = exact.map(|f: Film| f.develop(scale));
                    PassBias::of(&pass, exact.as_ref().unwrap_or(&pass), &narrow.develop(scale))
                }
                None => PassBias::none(&pass),
            });
            doubt.add(&pass, bias, spp);
        }
        self.film.add(&film);
        self.summary.counters += counters;
        self.summary.spp += spp;
        self.summary.clamp = ClampSummary::of(&self.film, self.summary.spp);
        self.next += 1;
        self.summary.passes = self.passes();
    }

    /// Sees the samples of a pass once more, with maps that are read in another way.
    fn again(
        &mut self,
        settings: &PhotonMapperSettings,
        maps: &PhotonMaps,
        samples: Range<u64>,
        control: &Control,
    ) -> (Film, Counters) {
        let mut film = self.film.fresh();
        let cache = self.fill_cache(settings, maps, control);
        let recipe = PhotonMapper { settings: *settings, maps, cache: cache.as_ref() };
        let (scene, seed) = (self.scene, self.plan.seed);
        let counters =
            self.summary.time("estimate bias", || render_pass(scene, &recipe, &mut film, seed, samples, &|_| {}));
        (film, counters)
    }

    /// The picture so far; black before the first pass.
    pub fn image(&self) -> Image {
        self.film.develop(1.0 / self.summary.spp.max(1) as f64)
    }

    /// What the passes tell about the error of [`Session::image`]; `None` unless the plan tracks it.
    pub fn doubt(&self) -> Option<&Doubt> {
        self.doubt.as_ref()
    }

    /// Variance of each pixel of [`Session::image`], from the differences between passes; `None` unless the plan tracks
    /// the error and two passes are in.
    pub fn variance(&self) -> Option<Vec<Rgb>> {
        self.doubt.as_ref()?.variance()
    }

    /// The error of [`Session::image`] against the unknown truth, in the unit of relMSE, as far as the passes show it;
    /// `None` unless the plan tracks the error and a few passes are in.
    pub fn estimated_relmse(&self) -> Option<f64> {
        self.doubt.as_ref()?.relmse(&self.image())
    }

    /// Shoots and balances the photon maps of the next pass.
    fn build_maps(&mut self, settings: &PhotonMapperSettings, control: &Control) -> PhotonMaps {
        let (scene, summary) = (self.scene, &mut self.summary);
        let mut maps = PhotonMaps::default();
        let directions = self.plan.needs.wants(Item::Directions);
        for target in settings.targets() {
            let stored = self.plan.stored_maps.as_ref().and_then(|file| file.map(target.name()));
            let map = stored.cloned().unwrap_or_else(|| {
                control.progress.phase("shoot photons");
                let shooting = settings.shoot_settings(self.plan.seed, self.next, target, scene.sampler.sequence);
                let shot = summary.time("shoot photons", || {
                    let planned = self.emissions.iter().position(|(t, _)| *t == target).unwrap_or_else(|| {
                        self.emissions.push((target, plan_emission(scene, &shooting)));
                        self.emissions.len() - 1
                    });
                    shoot_paths(scene, &shooting, &self.emissions[planned].1)
                });
                summary.add_shot(target, &shot);
                control.progress.phase("balance map");
                summary.time("balance map", || PhotonMap::build_with(shot.photons, directions))
            });
            let radius = scene.bounding_sphere().1;
            match target {
                Target::Caustic => maps.set_caustic(map, &settings.lookup, radius),
                Target::Global | Target::Indirect => maps.set_global(map, &settings.lookup, radius),
            }
        }
        if settings.shadow_photons > 0 {
            let (paths, seed, pass) = (settings.shadow_photons, self.plan.seed, self.next);
            let counters = &mut Counters::default();
            maps.set_shadows(summary.time("shoot photons", || ShadowMap::shoot(scene, paths, seed, pass, counters)));
            summary.counters += *counters;
        }
        if settings.final_gather && settings.irradiance_photons {
            summary.time("irradiance", || maps.precompute_irradiance());
        }
        summary.photon_memory = summary.photon_memory.max(maps.memory());
        maps
    }

    /// Computes the irradiance cache of the next pass, if there is to be one.
    fn fill_cache(
        &mut self,
        settings: &PhotonMapperSettings,
        maps: &PhotonMaps,
        control: &Control,
    ) -> Option<IrradianceCache> {
        if !(settings.irradiance_cache.is_some() && settings.final_gather && maps.has_global()) {
            return None;
        }
        control.progress.phase("fill cache");
        let (scene, seed, pass, summary) = (self.scene, self.plan.seed, self.next, &mut self.summary);
        let mut counters = Counters::default();
        let cache = summary.time("fill cache", || {
            PhotonMapper { settings: *settings, maps, cache: None }.fill_cache(scene, seed, pass, &mut counters)
        })?;
        summary.counters += counters;
        summary.cache_records += cache.len() as u64;
        summary.photon_memory = summary.photon_memory.max(maps.memory() + cache.memory());
        Some(cache)
    }
}
