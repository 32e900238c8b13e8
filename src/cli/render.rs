//! `caustica render`.

use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use super::args::{Aov, RenderArgs};
use super::keep::Keeper;
use super::progress::Reporter;
use super::{CliError, INTERRUPTED, MOST_AIMED, bytes, human, layers, print};
use crate::image::{Format, Image, WriteOptions};
use crate::render::{
    Checkpoint, Choice, ClampSummary, Control, MapSummary, Plan, PlanOverrides, Session, Summary, choose, render_from,
};
use crate::scene::{PhotonAims, Scene};

/// A run with more than this share of dropped samples has failed.
const MAX_NON_FINITE: f64 = 1e-6;

#[derive(Serialize)]
struct Report<'a> {
    scene: String,
    scene_hash: &'a str,
    outputs: Vec<String>,
    accel: String,
    width: u32,
    height: u32,
    triangles: u64,
    seconds: f64,
    rays_per_second: f64,
    accel_memory: usize,
    mean: [f64; 3],
    /// How the integrator was chosen, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    choice: Option<&'a Choice>,
    #[serde(flatten)]
    summary: &'a Summary,
}

pub fn run(a: &RenderArgs) -> Result<u8, CliError> {
    let started = Instant::now();
    // Refuse what cannot be written before any work is done.
    let mut outputs = outputs(a)?;
    super::set_threads(a.scene.threads)?;
    let mut scene = super::load_scene(&a.scene)?;
    let mut overrides = PlanOverrides {
        integrator: a.integrator.clone(),
        spp: a.spp,
        photons: a.photons,
        photon_memory: a.photon_memory,
        passes: a.passes,
        samples_per_pass: a.samples_per_pass,
        pass_range: a.pass_range.clone(),
        seed: a.seed,
        timed: a.time.is_some(),
        clamp: a.clamp,
        track_error: a.aov.contains(&Aov::Variance),
        track_bias: a.aov.contains(&Aov::Bias),
        target_error: a.target_error,
        layers: layers::wanted(a),
        needs: a.scene.needs.clone(),
        ..PlanOverrides::default()
    };
    let loaded = started.elapsed().as_secs_f64();
    let choice = choose(&mut scene, &overrides)?;
    if let Some(choice) = &choice {
        overrides.integrator = Some(choice.method.to_owned());
        // As the pilot took it: photon maps of their own for every pass.
        overrides.fresh_maps = true;
        overrides.samples_per_pass = a.samples_per_pass.or(choice.samples_per_pass);
    }
    let choosing = started.elapsed().as_secs_f64() - loaded;
    let mut plan = Plan::new(&scene, &overrides)?;
    if let Some(path) = &a.photon_map {
        super::map::load(path, &scene, &mut plan)?;
    }
    check_aovs(&plan)?;
    let session = match &a.resume {
        Some(path) => Session::resume(&scene, &plan, &Checkpoint::read(path)?)?,
        None => Session::new(&scene, &plan),
    };
    let mut keeper = Keeper::new(a, &outputs)?;
    let quiet = a.quiet || a.json;
    if !quiet {
        for w in &scene.warnings {
            eprintln!("caustica: warning: {w}");
        }
        eprintln!(
            "{}: {} triangles, {}x{}, {}, {}",
            a.scene.scene.display(),
            human(scene.stats.triangles as f64),
            scene.film.width,
            scene.film.height,
            plan.method.name(),
            scene.accel.description()
        );
        for t in &plan.techniques {
            eprintln!("{}: {}, {}", t.technique.name(), if t.used { "on" } else { "off" }, t.reason);
        }
        if let Some(choice) = &choice {
            let samples = choice.samples_per_pass.filter(|&n| n > 1).map(|n| format!(", {n} camera samples a pass"));
            eprintln!("chose {}{} ({})", choice.method, samples.unwrap_or_default(), choice.reason);
        }
    }
    // Render; Ctrl-C ends it after the running pass.
    let stop = super::stop_flag("finishing the running pass")?;
    let reporter = Reporter::new(quiet);
    let control = Control { stop: &stop, time: a.time, started, progress: &reporter };
    let mut rendering = render_from(session, &control, &mut |session, last| keeper.after_pass(session, last));
    reporter.finish();
    rendering.summary.add_phase("load", loaded);
    if choice.is_some() {
        rendering.summary.add_phase("choose integrator", choosing);
    }
    if let (Some(f), false) = (scene.nesting_faults().filter(|f| f.lost + f.stray > 0), quiet) {
        eprintln!(
            "caustica: warning: dielectrics with priorities: {} crossings left what had not been entered (holes, normals \
             inwards, or surfaces that coincide), {} found more than eight inside one another",
            f.stray, f.lost
        );
    }
    // Write every output.
    let seconds = started.elapsed().as_secs_f64();
    describe(&mut rendering.image, &scene, &rendering.summary, seconds);
    let writing = Instant::now();
    let options = WriteOptions { exposure: a.exposure, half: !a.float, ..WriteOptions::default() };
    for path in &outputs {
        crate::image::write(path, &rendering.image, &options).map_err(CliError::Output)?;
    }
    outputs.extend(layers::write_beside(&outputs, &rendering.image, &plan.layers, &options)?);
    rendering.summary.add_phase("write", writing.elapsed().as_secs_f64());
    let summary = &rendering.summary;
    if a.json {
        let report = Report {
            scene: a.scene.scene.display().to_string(),
            scene_hash: &scene.hash,
            outputs: outputs.iter().map(|p| p.display().to_string()).collect(),
            accel: scene.accel.description(),
            width: scene.film.width,
            height: scene.film.height,
            triangles: scene.stats.triangles,
            seconds,
            rays_per_second: summary.counters.rays() as f64 / (seconds - loaded).max(1e-9),
            accel_memory: scene.accel.memory(),
            mean: crate::image::metrics::mean_rgb(&rendering.image).unwrap_or([f64::NAN; 3]),
            choice: choice.as_ref(),
            summary,
        };
        let text = serde_json::to_string_pretty(&report).map_err(|e| CliError::Failed(e.to_string()))?;
        print(&text);
    } else if !a.quiet {
        print_summary(&scene, summary, seconds, loaded, &outputs);
    }
    let dropped = summary.counters.non_finite();
    if dropped as f64 > MAX_NON_FINITE * summary.counters.samples as f64 {
        return Err(CliError::Failed(format!(
            "{dropped} of {} samples were not finite and were left out (NaN {}, infinite {}); \
             the image is written but not to be trusted",
            summary.counters.samples, summary.counters.nan_samples, summary.counters.infinite_samples
        )));
    }
    keeper.result()?;
    Ok(if summary.interrupted { INTERRUPTED } else { 0 })
}

/// Refuses layers that nothing would be known about.
fn check_aovs(plan: &Plan) -> Result<(), CliError> {
    let passes = plan.passes.end - plan.passes.start;
    if plan.track_error && passes < 2 {
        return Err(CliError::Usage(
            "variance and bias are told from the differences between passes, and this render has one: ask for more \
             --spp or --passes"
                .to_owned(),
        ));
    }
    Ok(())
}

/// The files to write, checked for a format that can be written and a folder that exists.
fn outputs(a: &RenderArgs) -> Result<Vec<PathBuf>, CliError> {
    let outputs = if a.output.is_empty() { vec![a.scene.scene.with_extension("exr")] } else { a.output.clone() };
    for path in &outputs {
        if !matches!(Format::from_path(path), Some(f) if f != Format::Jpeg) {
            return Err(CliError::UnknownFormat(path.clone()));
        }
        super::check_folder(path)?;
    }
    Ok(outputs)
}

/// Writes into the image header how it was made.
fn describe(image: &mut Image, scene: &Scene, summary: &Summary, seconds: f64) {
    let mut set = |key: &str, value: String| {
        image.metadata.insert(format!("caustica.{key}"), value);
    };
    set("version", env!("CARGO_PKG_VERSION").to_owned());
    set("commit", env!("CAUSTICA_COMMIT").to_owned());
    set("scene_hash", scene.hash.clone());
    set("integrator", summary.integrator.to_owned());
    set("spp", summary.spp.to_string());
    set("passes", summary.passes.to_string());
    set("seed", summary.seed.to_string());
    set("accel", scene.accel.description());
    set("seconds", format!("{seconds:.3}"));
    for map in &summary.maps {
        set(&format!("{}_photons_emitted", map.name), map.emitted.to_string());
        set(&format!("{}_photons_stored", map.name), map.stored.to_string());
    }
}

fn print_summary(scene: &Scene, s: &Summary, seconds: f64, loaded: f64, outputs: &[PathBuf]) {
    let c = &s.counters;
    print(&format!("{:<18} {} spp in {} passes, seed {}", s.integrator, s.spp, s.passes, s.seed));
    for p in &s.phases {
        print(&format!("  {:<16} {:9.3} s", p.name, p.seconds));
    }
    print(&format!("  {:<16} {seconds:9.3} s", "total"));
    let rate = c.rays() as f64 / (seconds - loaded).max(1e-9);
    print(&format!(
        "rays               {} ({} closest-hit, {} shadow, {} photon), {} rays/s",
        human(c.rays() as f64),
        human(c.camera_rays as f64),
        human(c.shadow_rays as f64),
        human(c.photon_rays as f64),
        human(rate)
    ));
    for m in &s.maps {
        print(&format!(
            "{:<18} {} photon paths emitted, {} photons stored, {} rejected; energy balance within {:.1e}",
            format!("{} map", m.name),
            human(m.emitted as f64),
            human(m.stored as f64),
            m.rejected,
            m.energy_error
        ));
        print_aimed(&scene.photon_aims, m);
    }
    for c in &s.chains {
        print(&format!(
            "{:<18} {:.2e} of {} uniform paths seen; {} chains of {} mutations, {:.0} % accepted",
            format!("{} chains", c.name),
            c.visible,
            human(c.uniform as f64),
            c.chains,
            c.mutations,
            100.0 * c.acceptance
        ));
    }
    if let Some(g) = s.light_paths.filter(|g| g.noise_times_rays.is_finite()) {
        print(&format!(
            "light paths        {}: noise x rays {:.2} times as high with guided starts, by a pilot",
            if g.used { "guided" } else { "not guided" },
            g.noise_times_rays
        ));
    }
    if let Some(n) = s.light_paths_per_sample.filter(|&n| n > 1) {
        print(&format!("light paths        {n} for each camera path"));
    }
    print(&format!(
        "memory             {} geometry, {} ray queries, {} photons",
        bytes(scene.geometry.memory()),
        bytes(scene.accel.memory()),
        bytes(s.photon_memory)
    ));
    if let Some(e) = s.estimated_relmse {
        print(&format!("estimated error    relmse {e:.3e}, from the differences between passes"));
    }
    if let Some(c) = &s.clamp {
        print(&clamp_line(c));
    }
    print(&format!("dropped samples    {} NaN, {} infinite of {}", c.nan_samples, c.infinite_samples, c.samples));
    for path in outputs {
        print(&format!("wrote              {}", path.display()));
    }
}

/// What lights and shapes got of a map's photons, where the scene file asks for something.
fn print_aimed(aims: &PhotonAims, m: &MapSummary) {
    let part = |n: Option<&u64>, of: u64| 100.0 * n.copied().unwrap_or(0) as f64 / of.max(1) as f64;
    for (i, s) in aims.shares().iter().enumerate().take(MOST_AIMED) {
        print(&format!("  {:.2} % of the paths from the {}", part(m.aimed.paths.get(i), m.emitted), s.label));
    }
    for (i, t) in aims.targets().iter().enumerate().take(MOST_AIMED) {
        print(&format!("  {:.2} % of the photons by way of the {}", part(m.aimed.photons.get(i), m.stored), t.label));
    }
}

/// What people are told of the firefly clamp.
pub(super) fn clamp_line(c: &ClampSummary) -> String {
    let bias = c.bias.map(|b| format!("{b:+.3e}")).join(" ");
    format!("clamp at {:<9} {} samples dimmed; bias of the mean radiance {bias}", c.limit, c.samples)
}
