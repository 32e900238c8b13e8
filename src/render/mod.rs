//! Passes over the film: the plan of a render, its clock, its statistics.

mod auto;
mod checkpoint;
mod doubt;
mod forecast;
mod layers;
mod leave_out;
mod pass;
mod plan;
mod progressive;
mod session;
mod spread;
mod summary;

pub use auto::{AUTO, Choice, Trial, choose};
pub use checkpoint::{Checkpoint, CheckpointError};
pub use doubt::Doubt;
pub use forecast::Forecast;
pub use pass::render_pass;
pub use plan::{METHODS, Method, Plan, PlanError, PlanOverrides};
pub use session::Session;
pub use summary::{ChainSummary, ClampSummary, MapSummary, Phase, Summary};

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::image::Image;
use crate::scene::Scene;

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

impl Control<'_> {
    /// Whether a render is to end after the running pass.
    pub fn over(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.time.is_some_and(|t| self.started.elapsed() >= t)
    }

    /// The share of the time that is used up; 0 without a limit.
    pub(crate) fn elapsed_fraction(&self) -> f64 {
        self.time.map_or(0.0, |t| self.started.elapsed().as_secs_f64() / t.as_secs_f64())
    }
}

/// A finished render.
pub struct Rendering {
    /// With the layers that the plan asks for, and those of [`Doubt::add_layers`] where it tracks the error.
    pub image: Image,
    pub summary: Summary,
}

/// Renders `scene` as `plan` says, pass after pass.
///
/// The image depends on the scene, the plan and the number of finished passes, not on threads or time.
pub fn render(scene: &Scene, plan: &Plan, control: &Control) -> Rendering {
    render_from(Session::new(scene, plan), control, &mut |_, _| {})
}

/// As [`render`], from a session that may have passes already; `after_pass` sees it after each pass, and hears
/// whether that was the last.
pub fn render_from(mut session: Session, control: &Control, after_pass: &mut dyn FnMut(&Session, bool)) -> Rendering {
    let mut next_look = 0;
    let target_error = session.plan.target_error;
    while !session.finished() {
        session.step(control);
        let mut last = session.finished() || control.over();
        // Look at the error seldom enough that looking costs little, and looking often misleads little.
        if let Some(target) = target_error
            && !last
            && session.passes() >= next_look
        {
            next_look = session.passes() + 1 + session.passes() / 10;
            last = session.estimated_relmse().is_some_and(|e| e <= target);
        }
        after_pass(&session, last);
        if last {
            break;
        }
    }
    session.summary.interrupted = control.stop.load(Ordering::Relaxed);
    session.summary.estimated_relmse = session.estimated_relmse();
    control.progress.advance(1.0, session.passes());
    let mut image = session.image();
    if let Some(layers) = &session.layers {
        layers.add_to(&mut image);
    }
    if let Some(doubt) = session.doubt() {
        doubt.add_layers(&mut image);
    }
    Rendering { image, summary: session.summary }
}
