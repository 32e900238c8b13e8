//! Error against run time: every method measured against a reference as it goes, and a report that tells what came of it.
//!
//! **Clock.** A run's time begins when its tree for ray queries is built and ends with a pass; photon maps count, files and
//! the measurement itself do not. **Snapshots** are taken when the number of passes has grown by [`SPACING`](run::SPACING),
//! so that their times do too, while the errors of a given snapshot are the same bits in every repetition.
//! **Noise and bias** are told apart by how far seeds lie from each other and from the reference.

pub mod agreement;
mod experiment;
mod html;
mod machine;
mod picture;
mod plot;
pub mod reference;
pub mod run;
mod series;
pub mod stats;
mod table;

use std::path::Path;

pub use experiment::{Experiment, ExperimentError, ExperimentSettings, Watch};
pub use machine::Machine;
pub use reference::{Reference, ReferenceError, ReferenceSettings};
pub use run::{Budget, Run, Snapshot};
pub use series::{Outcome, Overhead, Point, Reached, Series, Split, THRESHOLDS};

use crate::image::replace_file;

/// Writes `report.html`, `report.json`, `convergence.csv` and the plots into a folder, each whole or not at all.
pub fn write(experiment: &Experiment, folder: &Path, exposure: f32) -> std::io::Result<()> {
    let plots = plot::all(experiment);
    for (name, svg) in &plots {
        replace_file(&folder.join(name), svg.as_bytes())?;
    }
    replace_file(&folder.join("convergence.csv"), table::csv(experiment).as_bytes())?;
    replace_file(&folder.join("report.json"), table::json(experiment).as_bytes())?;
    replace_file(&folder.join("report.html"), html::page(experiment, &plots, exposure).as_bytes())
}
