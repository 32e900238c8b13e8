//! The report for machines: one row for each snapshot, and everything as JSON.

use std::fmt::Write;

use serde_json::json;

use super::experiment::Experiment;
use super::run::{Run, Snapshot};
use super::series::Series;
use crate::image::metrics::Metric;

/// A column: its name, what it holds, and its value.
type Column = (&'static str, &'static str, fn(&Series, &Run, &Snapshot) -> String);

/// The columns of `convergence.csv` before those of the metrics.
const COLUMNS: [Column; 13] = [
    ("method", "integrator", |s, _, _| s.method.clone()),
    ("accel", "back end for ray queries", |s, _, _| s.accel.replace(',', ";")),
    ("seed", "seed of all random numbers of the run", |_, r, _| r.seed.to_string()),
    ("passes", "passes that the picture is the mean of", |_, _, x| x.passes.to_string()),
    ("spp", "camera samples a pixel", |_, _, x| x.spp.to_string()),
    (
        "seconds",
        "wall-clock time of the run so far: tree, photon maps and passes; no files, no measuring",
        |_, _, x| format!("{:.6}", x.seconds),
    ),
    ("cpu_seconds", "processor time of all threads in that time; empty where the system does not tell", |_, _, x| {
        x.cpu_seconds.map_or_else(String::new, |c| format!("{c:.2}"))
    }),
    ("rays", "ray queries of all kinds", |_, _, x| x.rays.to_string()),
    ("photons", "photon paths emitted", |_, _, x| x.photons.to_string()),
    ("regular", "1 if the number of passes is one at which every run has a snapshot", |_, _, x| flag(x.regular)),
    ("last", "1 if the run's time was over", |_, _, x| flag(x.last)),
    ("hidden", "1 if relmse is less than 20 times the reference's own: not to be claimed", |_, _, x| flag(x.hidden)),
    ("mean_difference", "mean of the picture over that of the reference, less 1", |_, _, x| {
        x.error.mean_difference.map_or_else(String::new, |d| format!("{d:.9e}"))
    }),
];

/// Takes a metric from a snapshot; `None` where it is not defined.
type Reading = fn(&Snapshot) -> Option<Metric>;

/// The metrics, each of which has three columns.
const METRICS: [(&str, &str, Reading); 5] = [
    ("rmse", "√ mean (x−r)²", |x| Some(x.error.rmse)),
    ("relmse", "mean (x−r)² / (r² + 0.01²)", |x| Some(x.error.relmse)),
    ("mrse", "mean (x−r)² / (r + 0.01·mean r)²; empty against a black reference", |x| x.error.mrse),
    ("smape", "mean |x−r| / (|x| + |r| + 0.01·mean r)", |x| Some(x.error.smape)),
    ("flip", "mean ꟻLIP at exposure 0 and 67 pixels per degree", |x| Some(x.error.flip)),
];

fn flag(b: bool) -> String {
    u8::from(b).to_string()
}

/// Every column's name and meaning.
pub fn columns() -> Vec<(String, String)> {
    let mut all: Vec<(String, String)> = COLUMNS.iter().map(|c| (c.0.to_owned(), c.1.to_owned())).collect();
    for (name, meaning, _) in METRICS {
        all.push((name.to_owned(), meaning.to_owned()));
        all.push((format!("{name}_trimmed"), "the same without the 0.1 % of pixels with the largest error".to_owned()));
        all.push((format!("{name}_trimmed_energy"), "share of the error that those pixels hold".to_owned()));
    }
    all
}

/// One row for each snapshot of each run, in the order of the series.
pub fn csv(experiment: &Experiment) -> String {
    let names: Vec<String> = columns().into_iter().map(|c| c.0).collect();
    let mut text = names.join(",") + "\n";
    for series in &experiment.series {
        for run in &series.runs {
            for snapshot in &run.snapshots {
                let mut cells: Vec<String> = COLUMNS.iter().map(|c| c.2(series, run, snapshot)).collect();
                for (_, _, metric) in METRICS {
                    cells.extend(match metric(snapshot) {
                        Some(m) => [m.value, m.trimmed.value, m.trimmed.energy].map(|v| format!("{v:.9e}")),
                        None => [const { String::new() }; 3],
                    });
                }
                writeln!(text, "{}", cells.join(",")).expect("strings take all that is written");
            }
        }
    }
    text
}

/// Settings, machine, reference, all snapshots, and for each series its curve, its outcome and its noise and bias.
pub fn json(experiment: &Experiment) -> String {
    let mut value = serde_json::to_value(experiment).expect("plain structures");
    let all = value["series"].as_array_mut().expect("a list");
    for (entry, series) in all.iter_mut().zip(&experiment.series) {
        entry["curve"] = json!(series.curve());
        entry["outcome"] = json!(series.outcome(&experiment.reference));
        entry["noise_and_bias"] = json!(series.splits(&experiment.reference));
    }
    value["columns"] = columns().into_iter().map(|(name, meaning)| json!({"name": name, "meaning": meaning})).collect();
    serde_json::to_string_pretty(&value).expect("plain structures")
}
