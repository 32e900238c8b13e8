use std::sync::atomic::AtomicBool;
use std::time::Instant;

use serde::Serialize;

use super::{Control, Plan, Session, Silent};
use crate::scene::Scene;

/// Films with more pixels than this are not tried out.
const MOST_PIXELS: u64 = 1 << 22;

/// What a render will take, as far as one camera sample per pixel tells.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Forecast {
    /// Bytes of the largest set of photon maps held at once.
    pub photon_memory: usize,
    /// Seconds on this machine; `None` where the clock ends the render.
    pub seconds: Option<f64>,
}

impl Forecast {
    /// Makes one pass of one sample per pixel, photon maps as planned, and extrapolates: maps by passes, everything else
    /// by samples. `None` for films too large to try.
    pub fn of(scene: &Scene, plan: &Plan) -> Option<Self> {
        if u64::from(scene.film.width) * u64::from(scene.film.height) > MOST_PIXELS {
            return None;
        }
        let trial = Plan {
            passes: 0..1,
            spp_per_pass: 1,
            spp: Some(1),
            track_error: false,
            bias_every: None,
            target_error: None,
            ..plan.clone()
        };
        let stop = AtomicBool::new(false);
        let control = Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent };
        let mut session = Session::new(scene, &trial);
        session.step(&control);
        let total: f64 = session.summary.phases.iter().map(|p| p.seconds).sum();
        let render = session.summary.seconds("render");
        let passes = (plan.passes.end - plan.passes.start) as f64;
        let seconds = plan.spp.map(|spp| render * spp as f64 + (total - render) * passes);
        Some(Self { photon_memory: session.summary.photon_memory, seconds })
    }
}
