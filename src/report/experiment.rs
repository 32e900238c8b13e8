//! All runs of a report, in an order that leaves something of everything whenever they are stopped.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use serde::Serialize;

use super::machine::{Machine, cpu_seconds};
use super::reference::Reference;
use super::run::{Budget, Snapshot, measure};
use super::series::Series;
use crate::accel::{Accel, AccelError, AccelKind};
use crate::image::metrics::MetricError;
use crate::render::{Control, Method, Plan, PlanError, PlanOverrides, Silent};
use crate::scene::Scene;

/// Reports on disk are renewed after so many seconds, and after each run.
const SAVE_INTERVAL: f64 = 20.0;

/// What to measure.
#[derive(Clone, Debug)]
pub struct ExperimentSettings {
    pub methods: Vec<String>,
    pub backends: Vec<AccelKind>,
    pub budget: Budget,
    pub seeds: u64,
    pub first_seed: u64,
    /// Camera samples per pixel in each pass of `ppm` and `sppm`; `None` takes the scene's.
    pub samples_per_pass: Option<u64>,
}

/// Why nothing can be measured.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    #[error("{0}")]
    Plan(#[from] PlanError),
    #[error("{0}")]
    Accel(#[from] AccelError),
    #[error("{0}")]
    Metric(#[from] MetricError),
}

/// Everything that a report tells.
#[derive(Clone, Debug, Serialize)]
pub struct Experiment {
    pub scene: String,
    pub scene_hash: String,
    pub width: u32,
    pub height: u32,
    pub triangles: u64,
    pub budget: Budget,
    pub seeds: u64,
    pub machine: Machine,
    pub reference: Reference,
    /// What a reader must know before believing the figures.
    pub warnings: Vec<String>,
    /// All runs were made to their end.
    pub finished: bool,
    /// Seconds spent on reading the scene, in nobody's time.
    pub load_seconds: f64,
    /// The runs in progress have this seed.
    pub series: Vec<Series>,
}

/// Told how far an experiment is.
pub trait Watch {
    /// The finished fraction, and what is being done.
    fn progress(&self, fraction: f64, what: &str);
    /// The moment to write a report: a run has ended, or a while has passed.
    fn save(&self, experiment: &Experiment);
}

impl Experiment {
    /// Nothing measured yet.
    pub fn new(scene: &Scene, name: String, settings: &ExperimentSettings, reference: Reference) -> Self {
        Self {
            scene: name,
            scene_hash: scene.hash.clone(),
            width: scene.film.width,
            height: scene.film.height,
            triangles: scene.stats.triangles,
            budget: settings.budget,
            seeds: settings.seeds,
            machine: Machine::here(),
            reference,
            warnings: Vec::new(),
            finished: false,
            load_seconds: 0.0,
            series: Vec::new(),
        }
    }

    /// Whether series differ by back end, so that labels have to name it.
    pub fn several_backends(&self) -> bool {
        self.series.iter().any(|s| s.accel != self.series[0].accel)
    }

    /// Makes all runs: every method with every back end for the first seed, then for the next. Drifts of the machine meet
    /// all methods alike, and what is there after an interruption compares all of them.
    pub fn run(
        &mut self,
        scene: &mut Scene,
        settings: &ExperimentSettings,
        stop: &AtomicBool,
        watch: &dyn Watch,
    ) -> Result<(), ExperimentError> {
        let plans = settings
            .methods
            .iter()
            .map(|m| plan(scene, m, settings.samples_per_pass))
            .collect::<Result<Vec<_>, _>>()?;
        let runs = (plans.len() * settings.backends.len()) as f64 * settings.seeds as f64;
        let mut done = 0.0;
        let mut saved = Instant::now();
        for seed in (0..settings.seeds).map(|i| settings.first_seed + i) {
            for (b, &backend) in settings.backends.iter().enumerate() {
                for (m, plan) in plans.iter().enumerate() {
                    // Build the tree anew: it is part of what a method costs.
                    let (started, cpu_before) = (Instant::now(), cpu_seconds());
                    scene.accel = Accel::build(backend, scene.geometry.clone())?;
                    let build = started.elapsed().as_secs_f64();
                    let build_cpu = cpu_before.zip(cpu_seconds()).map(|(before, after)| after - before);
                    let index = b * plans.len() + m;
                    if self.series.len() == index {
                        let (name, accel) = (plan.method.name().to_owned(), scene.accel.description());
                        self.series.push(Series::new(name, accel, parameters(plan)));
                    }
                    let plan = Plan { seed, ..plan.clone() };
                    let what = format!("{} with {}, seed {seed}", self.series[index].method, scene.accel.name());
                    let control = Control { stop, time: None, started: Instant::now(), progress: &Silent };
                    let first_seed = seed == settings.first_seed;
                    self.series[index].runs.push(super::run::Run::empty(seed, build));
                    let reference = self.reference.clone();
                    let mut sink = |snapshot: &Snapshot, image: &crate::image::Image| {
                        let series = &mut self.series[index];
                        series.add_picture(snapshot, image, first_seed);
                        series.runs.last_mut().expect("pushed above").snapshots.push(snapshot.clone());
                        let share = match settings.budget.passes {
                            Some(n) => snapshot.passes as f64 / n as f64,
                            None => snapshot.seconds / settings.budget.seconds,
                        };
                        watch.progress((done + share.min(1.0)) / runs, &what);
                        if saved.elapsed().as_secs_f64() > SAVE_INTERVAL {
                            watch.save(self);
                            saved = Instant::now();
                        }
                    };
                    let run =
                        measure(scene, &plan, &reference, (build, build_cpu), settings.budget, &control, &mut sink)?;
                    *self.series[index].runs.last_mut().expect("pushed above") = run;
                    done += 1.0;
                    if stop.load(Ordering::Relaxed) {
                        watch.save(self);
                        return Ok(());
                    }
                    watch.save(self);
                    saved = Instant::now();
                }
            }
        }
        self.finished = true;
        watch.save(self);
        Ok(())
    }
}

/// The plan of a method without an end. Methods without photon maps of their own take one sample a pixel in each pass, so
/// that there is something to measure early.
fn plan(scene: &Scene, method: &str, samples_per_pass: Option<u64>) -> Result<Plan, PlanError> {
    let integrator = Some(method.to_owned());
    let overrides = PlanOverrides { integrator, samples_per_pass, timed: true, ..PlanOverrides::default() };
    let mut plan = Plan::new(scene, &overrides)?;
    if !matches!(plan.method, Method::PhotonMapper(_) | Method::Ppm(_) | Method::Sppm(_)) {
        plan.spp_per_pass = 1;
    }
    Ok(plan)
}

/// The parameters of a plan in one line.
fn parameters(plan: &Plan) -> String {
    format!("{} camera samples a pixel in each pass; {:?}", plan.spp_per_pass, plan.method)
}
