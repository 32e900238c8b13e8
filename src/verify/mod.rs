//! Extreme cases with known answers, run by the program itself: `caustica verify`.
//!
//! A [`Case`] is a family of scenes or of questions to the rooms below, each with a number that a formula gives. Formulas
//! are evaluated in f64 here, never recorded from a run. Every method of [`METHODS`] is put to every scene that it can
//! render (`methods`), on every back end of the build.

mod case;
mod cases;
mod judge;
mod methods;
mod optics;
mod probe;
mod stiff;
mod table;
mod trace;
mod xml;

pub use case::{Case, Check, Item, Outcome};
pub use cases::all;
pub use judge::{Judge, Row, Spread, Verdict};
pub use methods::Light;
pub use probe::Probe;
pub use stiff::{Curve, Point, curves, svg};
pub use table::{csv, html, markdown, summary_line};

use std::time::Instant;

use crate::accel::{AccelKind, embree_available};
use crate::render::METHODS;

/// What to run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Names of cases; empty runs all.
    pub cases: Vec<String>,
    pub accels: Vec<AccelKind>,
    /// Names of methods; empty runs all.
    pub methods: Vec<String>,
    /// Independent renders behind each estimate, at least 2.
    pub seeds: u64,
    /// Leave out what takes long, and what would give the same bits again.
    pub fast: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { cases: Vec::new(), accels: back_ends(), methods: Vec::new(), seeds: 16, fast: false }
    }
}

impl Options {
    /// The back ends that a row is put to; `once` is true when one of them will do in fast runs.
    fn accels(&self, once: bool) -> &[AccelKind] {
        match once && self.fast {
            true => self.accels.get(..1).unwrap_or_default(),
            false => &self.accels,
        }
    }

    fn wants_method(&self, name: &str) -> bool {
        match self.methods.is_empty() {
            // With the settings of these scenes ppm and sppm give the same bits.
            true => !(self.fast && name == "ppm"),
            false => self.methods.iter().any(|m| m == name),
        }
    }
}

/// The back ends of this build.
pub fn back_ends() -> Vec<AccelKind> {
    if embree_available() { vec![AccelKind::Embree, AccelKind::Bvh] } else { vec![AccelKind::Bvh] }
}

/// Names and descriptions of all cases, in the order in which they run.
pub fn names() -> Vec<(&'static str, &'static str)> {
    all().iter().map(|c| (c.name, c.about)).collect()
}

/// Runs the cases that `options` asks for; `tell` hears each row when it is known.
pub fn run(options: &Options, tell: &mut dyn FnMut(&Row)) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut add = |row: Row| {
        tell(&row);
        rows.push(row);
    };
    for case in all() {
        if !options.cases.is_empty() && !options.cases.iter().any(|n| n == case.name) {
            continue;
        }
        for item in (case.items)() {
            match item {
                Item::Probe(probe) if options.fast && !probe.fast => {}
                Item::Check(check) if options.fast && !check.fast => {}
                Item::Probe(probe) => run_probe(&case, &probe, options, &mut add),
                Item::Check(check) => run_check(&case, &check, options, &mut add),
                Item::NotYet { parameter, why } => add(Row::not_yet(case.name, parameter, why)),
            }
        }
    }
    rows
}

/// One scene: every back end, every method.
fn run_probe(case: &Case, probe: &Probe, options: &Options, add: &mut dyn FnMut(Row)) {
    for &accel in options.accels(probe.once) {
        let scene = match probe.load(accel) {
            Ok(scene) => scene,
            Err(e) => {
                add(Row::broken(case.name, &probe.parameter, accel_name(accel), &e.to_string()));
                continue;
            }
        };
        for method in METHODS.into_iter().filter(|m| options.wants_method(m) && probe.applies(m)) {
            add(probe.run(case.name, &scene, method, accel_name(accel), options.seeds));
        }
    }
}

/// One question to the rooms below.
fn run_check(case: &Case, check: &Check, options: &Options, add: &mut dyn FnMut(Row)) {
    if !options.methods.is_empty() && !METHODS.into_iter().any(|m| m == check.what && options.wants_method(m)) {
        return;
    }
    let accels: &[AccelKind] = if check.needs_accel { options.accels(check.once) } else { &[AccelKind::Bvh] };
    for &accel in accels {
        let started = Instant::now();
        let outcome = (check.run)(accel, options.seeds);
        let name = if check.needs_accel { accel_name(accel) } else { "" };
        let row =
            Row::judge(case.name, &check.parameter, check.what, name, outcome.expected, &outcome.spread, &check.judge);
        let row = match outcome.limitation {
            Some(why) if row.verdict == Verdict::Fail => Row { verdict: Verdict::NotYet, ..row }.with_note(why),
            _ => row,
        };
        add(row.with_note(outcome.note).timed(started.elapsed().as_secs_f64(), check.limit));
    }
}

fn accel_name(kind: AccelKind) -> &'static str {
    match kind {
        AccelKind::Auto => "auto",
        AccelKind::Embree => "embree",
        AccelKind::Bvh => "bvh",
    }
}
