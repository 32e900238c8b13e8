//! `caustica converge`.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::args::ConvergeArgs;
use super::progress::Reporter;
use super::{CliError, INTERRUPTED, print};
use crate::image::Image;
use crate::render::{METHODS, Progress};
use crate::report::{
    self, Budget, Experiment, ExperimentError, ExperimentSettings, Reference, ReferenceSettings, Watch,
};
use crate::scene::{LoadOptions, Scene};

/// Integrators that leave out some of the light, so that they are measured only when they are asked for.
const PARTIAL: [&str; 2] = ["direct", "ptracer"];

/// A reference gets this many times the time of a run, and so about a twentieth of its error.
const REFERENCE_SHARE: f64 = 20.0;

impl From<ExperimentError> for CliError {
    fn from(e: ExperimentError) -> Self {
        match e {
            ExperimentError::Plan(e) => CliError::Plan(e),
            ExperimentError::Accel(e) => CliError::Usage(e.to_string()),
            ExperimentError::Metric(e) => CliError::Failed(e.to_string()),
        }
    }
}

pub fn run(a: &ConvergeArgs) -> Result<u8, CliError> {
    let loading = Instant::now();
    let folder = folder(a)?;
    super::set_threads(a.threads)?;
    let options = LoadOptions {
        defines: a.defines.clone(),
        accel: a.accel[0].into(),
        width: a.width,
        height: a.height,
        ..LoadOptions::default()
    };
    let mut scene = Scene::load(&a.scene, &options)?;
    let load_seconds = loading.elapsed().as_secs_f64();
    if scene.lights.is_empty() {
        return Err(CliError::Usage(format!(
            "{}: the scene has no light, so every picture of it is black and there is no error to measure; add an emitter",
            a.scene.display()
        )));
    }
    if !a.quiet {
        for w in &scene.warnings {
            eprintln!("caustica: warning: {w}");
        }
    }
    let settings = settings(a, &scene)?;
    let stop = super::stop_flag("finishing the running pass, then writing the report")?;
    let reference = reference(a, &scene, &folder, &stop)?;
    let name = a.scene.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let mut experiment = Experiment::new(&scene, name, &settings, reference);
    experiment.load_seconds = load_seconds;
    let watch = Folder { folder: &folder, exposure: a.exposure, reporter: Reporter::new(a.quiet) };
    experiment.run(&mut scene, &settings, &stop, &watch)?;
    watch.reporter.finish();
    // Write once more, this time telling what went wrong.
    report::write(&experiment, &folder, a.exposure)
        .map_err(|e| CliError::Failed(format!("{}: {e}", folder.display())))?;
    if !a.quiet {
        print_summary(&experiment, &folder);
    }
    Ok(if stop.load(Ordering::Relaxed) { INTERRUPTED } else { 0 })
}

/// The folder to write into, made if need be.
fn folder(a: &ConvergeArgs) -> Result<PathBuf, CliError> {
    let folder = a.output.clone().unwrap_or_else(|| {
        let stem = a.scene.file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy());
        PathBuf::from(format!("{stem}-converge"))
    });
    std::fs::create_dir_all(&folder)
        .map_err(|e| CliError::Usage(format!("{}: cannot make this folder: {e}", folder.display())))?;
    Ok(folder)
}

fn settings(a: &ConvergeArgs, scene: &Scene) -> Result<ExperimentSettings, CliError> {
    let methods: Vec<String> = match &a.integrators[..] {
        [] => METHODS.iter().filter(|m| !PARTIAL.contains(m)).map(|m| (*m).to_owned()).collect(),
        chosen => chosen.to_vec(),
    };
    // Refuse unknown names before a reference is made.
    for method in &methods {
        let overrides = crate::render::PlanOverrides { integrator: Some(method.clone()), ..Default::default() };
        crate::render::Plan::new(scene, &overrides)?;
    }
    let budget = Budget { passes: a.passes, ..Budget::time(a.time) };
    let backends = a.accel.iter().map(|&b| b.into()).collect();
    let samples_per_pass = a.samples_per_pass;
    Ok(ExperimentSettings { methods, backends, budget, seeds: a.seeds, first_seed: a.seed, samples_per_pass })
}

/// The reference that was named, or one made now and kept in the folder.
fn reference(a: &ConvergeArgs, scene: &Scene, folder: &Path, stop: &AtomicBool) -> Result<Reference, CliError> {
    let Some(path) = &a.reference else {
        let time = a.reference_time.unwrap_or_else(|| {
            let runs_of_time = if a.passes.is_some() { Duration::from_secs(10) } else { a.time };
            runs_of_time.mul_f64(REFERENCE_SHARE)
        });
        let settings = ReferenceSettings {
            methods: report::reference::default_methods(scene),
            seeds: [super::reference::SEED, super::reference::SEED + 1],
            time,
            passes: None,
        };
        let image = super::reference::make(scene, &settings, a.quiet, stop)?;
        let path = folder.join("reference.exr");
        crate::image::write(&path, &image, &Default::default()).map_err(CliError::Output)?;
        return Ok(Reference::new(image, "made for this report, kept as reference.exr".to_owned(), scene));
    };
    let image = crate::image::read(path).map_err(CliError::Input)?;
    check(&image, scene, path)?;
    let reference = Reference::new(image, path.display().to_string(), scene);
    if reference.same_scene == Some(false) && !a.trust_reference {
        return Err(CliError::Usage(format!(
            "{}: the reference is of another scene, or of this one before it was changed or with other -D values (its scene \
             hash differs); make a new one with `caustica reference`, or say --trust-reference if it shows the same picture",
            path.display()
        )));
    }
    Ok(reference)
}

fn check(image: &Image, scene: &Scene, path: &Path) -> Result<(), CliError> {
    let (wanted, found) = ((scene.film.width, scene.film.height), (image.width(), image.height()));
    if wanted != found {
        return Err(CliError::Usage(format!(
            "{}: the reference has {} x {} pixels and the scene's film {} x {}; make one of this size with \
             `caustica reference`",
            path.display(),
            found.0,
            found.1,
            wanted.0,
            wanted.1
        )));
    }
    if let Some((x, y)) = image.first_non_finite() {
        return Err(CliError::Usage(format!(
            "{}: the reference has NaN or infinity at pixel {x}, {y}; nothing can be measured by it",
            path.display()
        )));
    }
    Ok(())
}

/// Writes reports while runs go on.
struct Folder<'a> {
    folder: &'a Path,
    exposure: f32,
    reporter: Reporter,
}

impl Watch for Folder<'_> {
    fn progress(&self, fraction: f64, what: &str) {
        self.reporter.say(what);
        self.reporter.advance(fraction, 0);
    }

    fn save(&self, experiment: &Experiment) {
        // The last attempt reports what goes wrong.
        let _ = report::write(experiment, self.folder, self.exposure);
    }
}

fn print_summary(e: &Experiment, folder: &Path) {
    print(&format!(
        "{:28} {:>10} {:>8} {:>12} {:>12} {:>16}",
        "method", "seconds", "passes", "relmse", "flip", "slope"
    ));
    for series in &e.series {
        let Some(o) = series.outcome(&e.reference) else { continue };
        let metric = |k: usize| o.metrics[k].1.map_or_else(|| "-".to_owned(), |m| format!("{:.4e}", m[0]));
        let slope = o.slope.map_or_else(String::new, |s| {
            s.half_width.map_or_else(|| format!("{:.3}", s.mean), |h| format!("{:.3} ± {h:.3}", s.mean))
        });
        let label = series.label(e.several_backends());
        print(&format!(
            "{label:28} {:10.3} {:8.0} {:>12} {:>12} {slope:>16}",
            o.seconds,
            o.passes,
            metric(1),
            metric(4)
        ));
    }
    print(&format!("wrote {}", folder.join("report.html").display()));
}
