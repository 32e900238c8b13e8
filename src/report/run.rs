//! One run: a method with a back end and a seed, measured against the reference as it goes.

use std::time::{Duration, Instant};

use serde::Serialize;

use super::machine::cpu_seconds;
use super::reference::Reference;
use crate::image::metrics::MetricError;
use crate::image::{Comparison, Image, compare};
use crate::render::{Control, Plan, Session};
use crate::scene::Scene;

/// Snapshots are taken when the number of passes has grown by this factor, and the time with it.
pub const SPACING: f64 = 1.26;

/// When a run ends.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Budget {
    /// Seconds by the run's own clock.
    pub seconds: f64,
    /// In place of the clock: so many passes.
    pub passes: Option<u64>,
}

/// The picture after some passes: what it cost and how wrong it is.
#[derive(Clone, Debug, Serialize)]
pub struct Snapshot {
    pub passes: u64,
    pub spp: u64,
    /// Wall-clock seconds since the run began, trees and maps built included; files and this measurement are not.
    pub seconds: f64,
    /// Processor seconds of all threads in the same time.
    pub cpu_seconds: Option<f64>,
    /// Closest-hit and any-hit queries, those of photons included.
    pub rays: u64,
    /// Photon paths emitted.
    pub photons: u64,
    /// The number of passes is one at which every run of every length has a snapshot.
    pub regular: bool,
    /// The run's last snapshot, at the end of its time.
    pub last: bool,
    /// Closer to the reference than the reference is to the truth, times [`CLAIM_FACTOR`](super::reference::CLAIM_FACTOR).
    pub hidden: bool,
    #[serde(flatten)]
    pub error: Comparison,
}

/// All snapshots of one seed.
#[derive(Clone, Debug, Serialize)]
pub struct Run {
    pub seed: u64,
    /// Seconds to build the tree for ray queries, part of every snapshot's time.
    pub build_seconds: f64,
    /// Seconds that snapshots took, in nobody's time.
    pub snapshot_seconds: f64,
    /// Seconds by which passes right after a snapshot took longer than the passes after them: what snapshots do to the
    /// method's own time, by caches that they leave cold. Only where the second of the two had no snapshot before it.
    pub slower_after: Vec<f64>,
    pub finished: bool,
    pub snapshots: Vec<Snapshot>,
}

impl Run {
    /// A run that has just built its tree.
    pub fn empty(seed: u64, build_seconds: f64) -> Self {
        Self {
            seed,
            build_seconds,
            snapshot_seconds: 0.0,
            slower_after: Vec::new(),
            finished: false,
            snapshots: Vec::new(),
        }
    }
}

/// The number of passes after `passes` at which the next snapshot is due. Depending on passes alone, snapshots of two runs
/// are of the same passes, whatever the clock says.
pub fn next_due(passes: u64) -> u64 {
    ((passes as f64 * SPACING).round() as u64).max(passes + 1)
}

/// Renders until the budget is used up or `control` says stop, and hands each snapshot with its picture to `sink`.
///
/// An error tells that picture and reference cannot be compared.
pub fn measure(
    scene: &Scene,
    plan: &Plan,
    reference: &Reference,
    build: (f64, Option<f64>),
    budget: Budget,
    control: &Control,
    sink: &mut dyn FnMut(&Snapshot, &Image),
) -> Result<Run, MetricError> {
    let (mut seconds, mut cpu) = build;
    let mut run = Run::empty(plan.seed, seconds);
    let started = Instant::now();
    let mut session = Session::new(scene, plan);
    seconds += started.elapsed().as_secs_f64();
    let mut due = 1;
    // The time of a pass right after a snapshot, until the next pass is there to compare it with.
    let (mut after_snapshot, mut snapshot_before) = (None, false);
    loop {
        // Let the clock run for the pass alone.
        let cpu_before = cpu_seconds();
        let started = Instant::now();
        session.step(control);
        let of_pass = started.elapsed().as_secs_f64();
        seconds += of_pass;
        if let Some(cold) = after_snapshot.take().filter(|_| !snapshot_before) {
            run.slower_after.push(cold - of_pass);
        }
        after_snapshot = snapshot_before.then_some(of_pass);
        cpu = cpu.zip(cpu_before).zip(cpu_seconds()).map(|((sum, before), after)| sum + after - before);
        let passes = session.passes();
        let over = match budget.passes {
            Some(n) => passes >= n,
            // The next pass would end after the time: this one is nearest.
            None => seconds + 0.5 * seconds / passes as f64 >= budget.seconds,
        } || session.finished();
        let stopped = control.stop.load(std::sync::atomic::Ordering::Relaxed);
        snapshot_before = passes == due || over || stopped;
        if snapshot_before {
            let measuring = Instant::now();
            let image = session.image();
            let error = compare(&image, &reference.image)?;
            let counters = &session.summary.counters;
            let snapshot = Snapshot {
                passes,
                spp: session.summary.spp,
                seconds,
                cpu_seconds: cpu,
                rays: counters.rays(),
                photons: session.summary.maps.iter().map(|m| m.emitted).sum(),
                regular: passes == due,
                last: over && !stopped,
                hidden: reference.hides(error.relmse.value),
                error,
            };
            sink(&snapshot, &image);
            run.snapshots.push(snapshot);
            run.snapshot_seconds += measuring.elapsed().as_secs_f64();
        }
        if passes == due {
            due = next_due(due);
        }
        if over || stopped {
            run.finished = over;
            return Ok(run);
        }
    }
}

impl Budget {
    /// A budget of time.
    pub fn time(time: Duration) -> Self {
        Self { seconds: time.as_secs_f64(), passes: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn snapshots_are_due_at_growing_passes() {
        let mut due = vec![1];
        while due.len() < 14 {
            due.push(next_due(due[due.len() - 1]));
        }
        assert_eq!(due, [1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40]);
    }
}
