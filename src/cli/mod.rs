//! The command line: the only place that prints, reads arguments or exits.

mod args;
mod bench;
mod compare;
mod converge;
mod generate;
mod info;
mod keep;
mod layers;
mod map;
mod merge;
mod predict;
mod progress;
mod reference;
mod render;
mod serve;
mod values;
mod verify;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Parser;

use crate::image::ImageError;
use crate::render::{CheckpointError, PlanError};
use crate::scene::SceneError;

/// Lights and shapes with wishes for photons that are told one by one.
const MOST_AIMED: usize = 16;

/// Exit code of bad usage and bad scenes.
const BAD_INPUT: u8 = 2;
/// Exit code of a run that failed.
const FAILED: u8 = 1;
/// Exit code after Ctrl-C, once the image so far is written.
const INTERRUPTED: u8 = 130;

/// Why a command did not succeed.
#[derive(Debug, thiserror::Error)]
enum CliError {
    #[error("{0}")]
    Scene(#[from] SceneError),
    #[error("{0}")]
    Plan(#[from] PlanError),
    #[error("{0}")]
    Checkpoint(#[from] CheckpointError),
    #[error("{0}")]
    Input(ImageError),
    #[error("{0}")]
    Output(ImageError),
    #[error("{}: unknown image format; use a name that ends in .exr, .png, .hdr or .pfm", .0.display())]
    UnknownFormat(PathBuf),
    #[error("{0}")]
    Usage(String),
    #[error("{0}")]
    Failed(String),
}

impl CliError {
    fn exit_code(&self) -> u8 {
        match self {
            CliError::Checkpoint(CheckpointError::Io { action: "write", .. }) => FAILED,
            CliError::Scene(_)
            | CliError::Checkpoint(_)
            | CliError::Plan(_)
            | CliError::Input(_)
            | CliError::UnknownFormat(_)
            | CliError::Usage(_) => BAD_INPUT,
            CliError::Output(_) | CliError::Failed(_) => FAILED,
        }
    }
}

/// Reads the arguments, runs the command, says what went wrong.
pub fn main() -> ExitCode {
    let cli = args::Cli::parse();
    let result = match cli.command {
        args::Command::Render(a) => render::run(&a),
        args::Command::Compare(a) => compare::run(&a),
        args::Command::Bench(a) => bench::run(&a),
        args::Command::Converge(a) => converge::run(&a),
        args::Command::Reference(a) => reference::run(&a),
        args::Command::Merge(a) => merge::run(&a),
        args::Command::Map(a) => map::run(&a),
        args::Command::Info(a) => info::run(&a),
        args::Command::Scene(a) => generate::run(&a),
        args::Command::Verify(a) => verify::run(&a),
    };
    match result {
        Ok(code) => ExitCode::from(code),
        Err(e) => {
            eprintln!("caustica: error: {e}");
            ExitCode::from(e.exit_code())
        }
    }
}

/// Sets the number of worker threads.
fn set_threads(threads: Option<u32>) -> Result<(), CliError> {
    let Some(threads) = threads else { return Ok(()) };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads as usize)
        .build_global()
        .map_err(|e| CliError::Failed(format!("cannot start {threads} threads: {e}")))
}

/// A flag that Ctrl-C sets; a second Ctrl-C ends the program. `message` tells what will be done.
fn stop_flag(message: &'static str) -> Result<Arc<AtomicBool>, CliError> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(INTERRUPTED));
        }
        eprintln!("caustica: {message}; Ctrl-C once more to give up");
    })
    .map_err(|e| CliError::Failed(format!("cannot watch for Ctrl-C: {e}")))?;
    Ok(stop)
}

/// Refuses a file whose folder does not exist, before any work is done.
fn check_folder(path: &Path) -> Result<(), CliError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if folder.is_dir() {
        return Ok(());
    }
    Err(CliError::Usage(format!("{}: the folder {} does not exist; make it first", path.display(), folder.display())))
}

/// Prints to standard output; a closed pipe ends the program quietly.
fn print(text: &str) {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    if writeln!(out, "{text}").and_then(|()| out.flush()).is_err() {
        std::process::exit(0);
    }
}

/// The scene as loaded with the options that every command has.
fn load_scene(a: &args::SceneArgs) -> Result<crate::scene::Scene, CliError> {
    Ok(crate::scene::Scene::load(&a.scene, &load_options(a))?)
}

fn load_options(a: &args::SceneArgs) -> crate::scene::LoadOptions {
    crate::scene::LoadOptions {
        defines: a.defines.clone(),
        accel: a.accel.into(),
        accel_options: a.tree.into(),
        width: a.width,
        height: a.height,
        needs: a.needs.clone(),
    }
}

/// The scene of a mesh file by itself under a white sky, with `camera`; `None` for other files.
fn scene_of_mesh(file: &Path, camera: &str) -> Result<Option<String>, CliError> {
    let plugin = file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if !matches!(&plugin[..], "ply" | "obj" | "serialized") {
        return Ok(None);
    }
    if !file.is_file() {
        return Err(CliError::Usage(format!("{}: no such file", file.display())));
    }
    let mesh = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let name = mesh.display().to_string().replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
    Ok(Some(format!(
        "<scene version=\"3.0.0\">{camera}<emitter type=\"constant\"/>\
         <shape type=\"{plugin}\"><string name=\"filename\" value=\"{name}\"/></shape></scene>"
    )))
}

/// 1234567 as `1.23 M`.
fn human(n: f64) -> String {
    let (value, unit) = match n.abs() {
        x if x >= 1e9 => (n / 1e9, " G"),
        x if x >= 1e6 => (n / 1e6, " M"),
        x if x >= 1e4 => (n / 1e3, " k"),
        _ => return format!("{n:.0}"),
    };
    format!("{value:.3}{unit}")
}

/// Bytes with a binary unit.
fn bytes(n: usize) -> String {
    let n = n as f64;
    match n {
        x if x >= (1u64 << 30) as f64 => format!("{:.2} GiB", x / (1u64 << 30) as f64),
        x if x >= (1 << 20) as f64 => format!("{:.1} MiB", x / (1 << 20) as f64),
        x => format!("{:.1} KiB", x / 1024.0),
    }
}
