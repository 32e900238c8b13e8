//! Passes over the film: the plan of a render, its clock, its statistics.

mod pass;
mod plan;
mod summary;

pub use pass::render_pass;
pub use plan::{METHODS, Method, Plan, PlanError, PlanOverrides};
pub use summary::{MapSummary, Phase, Summary};

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::film::Film;
use crate::gather::PhotonMaps;
use crate::image::Image;
use crate::integrator::PhotonMapper;
use crate::scene::Scene;
use crate::shoot::Target;

/// Told what a render is doing; calls come from several threads.
pub trait Progress: Sync {
    /// A phase begins.
    fn phase(&self, _name: &'static str) {}
    /// The fraction of the camera samples that has been taken, with the passes finished.
    fn advance(&self, _fraction: f64, _passes: u64) {}
}

/// Tells nobody.
pub struct Silent;
impl Progress for Silent {}

/// What may end a render before its last pass.
pub struct Control<'a> {
    /// Set from outside, for example by Ctrl-C: the running pass is finished.
    pub stop: &'a AtomicBool,
    /// Measured from `started`.
    pub time: Option<Duration>,
    pub started: Instant,
    pub progress: &'a dyn Progress,
}

/// A finished render.
pub struct Rendering {
    pub image: Image,
    pub summary: Summary,
}

/// Renders `scene` as `plan` says, pass after pass.
///
/// The image depends on the scene, the plan and the number of finished passes, not on threads or time.
pub fn render(scene: &Scene, plan: &Plan, control: &Control) -> Rendering {
    let mut film = Film::new(scene.camera.window(), scene.film.filter);
    let mut summary = Summary::new(plan);
    let passes = if control.time.is_some() && !plan.bounded { u64::MAX } else { plan.passes };
    for pass in 0..passes {
        let range = plan.samples_of(pass);
        summary.spp += range.end - range.start;
        let report = |fraction: f64| {
            let by_passes = (pass as f64 + fraction) / passes as f64;
            let by_time = control.time.map_or(0.0, |t| control.started.elapsed().as_secs_f64() / t.as_secs_f64());
            control.progress.advance(by_passes.max(by_time).min(1.0), pass);
        };
        let counters = match &plan.method {
            Method::Path(p) => summary.time("render", || render_pass(scene, p, &mut film, plan.seed, range, &report)),
            Method::Direct(d) => summary.time("render", || render_pass(scene, d, &mut film, plan.seed, range, &report)),
            Method::PhotonMapper(settings) => {
                let maps = build_maps(scene, plan, settings, pass, control, &mut summary);
                let recipe = PhotonMapper { settings: *settings, maps: &maps };
                control.progress.phase("render");
                summary.time("render", || render_pass(scene, &recipe, &mut film, plan.seed, range, &report))
            }
        };
        summary.counters += counters;
        summary.passes = pass + 1;
        let over = control.time.is_some_and(|t| control.started.elapsed() >= t);
        if control.stop.load(Ordering::Relaxed) || over {
            summary.interrupted = control.stop.load(Ordering::Relaxed);
            break;
        }
    }
    control.progress.advance(1.0, summary.passes);
    Rendering { image: film.develop(1.0), summary }
}

/// Shoots and balances the photon maps of one pass.
fn build_maps(
    scene: &Scene,
    plan: &Plan,
    settings: &crate::integrator::PhotonMapperSettings,
    pass: u64,
    control: &Control,
    summary: &mut Summary,
) -> PhotonMaps {
    let mut maps = PhotonMaps::default();
    for target in settings.targets() {
        control.progress.phase("shoot photons");
        let shot = summary.time("shoot photons", || {
            crate::shoot::shoot(scene, &settings.shoot_settings(plan.seed, pass, target, scene.sampler.sequence))
        });
        summary.add_shot(target, &shot);
        control.progress.phase("balance map");
        let map = summary.time("balance map", || crate::photon::PhotonMap::build(shot.photons));
        let radius = scene.bounding_sphere().1;
        match target {
            Target::Caustic => maps.set_caustic(map, &settings.lookup, radius),
            Target::Global | Target::Indirect => maps.set_global(map, &settings.lookup, radius),
        }
    }
    if settings.final_gather {
        summary.time("irradiance", || maps.precompute_irradiance());
    }
    summary.photon_memory = summary.photon_memory.max(maps.memory());
    maps
}
