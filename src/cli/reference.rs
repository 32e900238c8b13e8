//! `caustica reference`.

use std::sync::atomic::{AtomicBool, Ordering};

use super::args::ReferenceArgs;
use super::progress::Reporter;
use super::{CliError, INTERRUPTED, print};
use crate::image::{Format, Image, WriteOptions};
use crate::render::Progress;
use crate::report::reference::CLAIM_FACTOR;
use crate::report::{Reference, ReferenceError, ReferenceSettings, reference};
use crate::scene::Scene;

/// The seed of references, unlike those that people give to renders: their noise must not be shared.
pub const SEED: u64 = 1_000_001;

impl From<ReferenceError> for CliError {
    fn from(e: ReferenceError) -> Self {
        match e {
            ReferenceError::Plan(e) => CliError::Plan(e),
            e => CliError::Failed(format!("no reference: {e}")),
        }
    }
}

pub fn run(a: &ReferenceArgs) -> Result<u8, CliError> {
    if Format::from_path(&a.output) != Some(Format::Exr) {
        return Err(CliError::Usage(format!(
            "{}: a reference holds variance beside the colour, which only .exr can",
            a.output.display()
        )));
    }
    let folder = a.output.parent().filter(|p| !p.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|f| !f.is_dir()) {
        return Err(CliError::Usage(format!("{}: no such folder; make it first", folder.display())));
    }
    super::set_threads(a.scene.threads)?;
    let scene = super::load_scene(&a.scene)?;
    let methods = match &a.methods[..] {
        [] => reference::default_methods(&scene),
        [one] => [one.clone(), one.clone()],
        [one, two, ..] => [one.clone(), two.clone()],
    };
    let settings = ReferenceSettings { methods, seeds: [a.seed, a.seed + 1], time: a.time, passes: a.passes };
    let stop = super::stop_flag("finishing the running pass, then judging what there is")?;
    let image = make(&scene, &settings, a.quiet, &stop)?;
    crate::image::write(&a.output, &image, &WriteOptions::default()).map_err(CliError::Output)?;
    if !a.quiet {
        let known = Reference::new(image, String::new(), &scene);
        let own = known.relmse.unwrap_or(0.0);
        print(&format!("own error          relmse {own:.3e}: good for claims above {:.1e}", CLAIM_FACTOR * own));
        print(&format!("wrote              {}", a.output.display()));
    }
    Ok(if stop.load(Ordering::Relaxed) { INTERRUPTED } else { 0 })
}

/// Makes a reference and tells how far it is.
pub fn make(scene: &Scene, settings: &ReferenceSettings, quiet: bool, stop: &AtomicBool) -> Result<Image, CliError> {
    let [a, b] = &settings.methods;
    if !quiet {
        eprintln!("reference by {a}, seed {}, and {b}, seed {}", settings.seeds[0], settings.seeds[1]);
        if a == b {
            eprintln!(
                "caustica: note: both halves are by {a}; that they agree shows nothing about errors of the method"
            );
        }
    }
    let reporter = Reporter::new(quiet);
    reporter.say("reference");
    let image = reference::make(scene, settings, stop, &|fraction| reporter.advance(fraction, 0));
    reporter.finish();
    let image = image?;
    if !quiet {
        let note = |key: &str| image.metadata.get(&format!("caustica.reference.{key}")).cloned().unwrap_or_default();
        eprintln!(
            "{} and {} passes agree: largest difference {} standard errors, limit {}",
            note("passes").split(',').next().unwrap_or_default(),
            note("passes").split(',').nth(1).unwrap_or_default(),
            note("largest_z"),
            note("z_limit")
        );
    }
    Ok(image)
}
