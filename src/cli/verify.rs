//! `caustica verify`.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use super::args::{VerifyAccel, VerifyArgs};
use super::{CliError, FAILED, print};
use crate::accel::AccelKind;
use crate::render::METHODS;
use crate::verify::{Options, Row, back_ends, csv, curves, html, markdown, names, run as verify, summary_line, svg};

#[derive(Serialize)]
struct Report<'a> {
    version: &'static str,
    commit: &'static str,
    seeds: u64,
    fast: bool,
    seconds: f64,
    failed: usize,
    rows: &'a [Row],
}

pub fn run(a: &VerifyArgs) -> Result<u8, CliError> {
    if a.list {
        names().iter().for_each(|(name, about)| print(&format!("{name:20} {about}")));
        return Ok(0);
    }
    super::set_threads(a.threads)?;
    let options = options(a)?;
    if let Some(dir) = &a.output {
        std::fs::create_dir_all(dir).map_err(|e| CliError::Usage(format!("{}: {e}", dir.display())))?;
    }
    let started = Instant::now();
    let rows = verify(&options, &mut |row| {
        if !a.json {
            print(&row.line());
        }
    });
    let seconds = started.elapsed().as_secs_f64();
    if let Some(dir) = &a.output {
        let stiffness = if options.fast { String::new() } else { svg(&curves()) };
        write(dir, &rows, &stiffness)?;
    }
    let failed = rows.iter().filter(|r| r.verdict.is_bad()).count();
    if a.json {
        let report = Report {
            version: env!("CARGO_PKG_VERSION"),
            commit: env!("CAUSTICA_COMMIT"),
            seeds: options.seeds,
            fast: options.fast,
            seconds,
            failed,
            rows: &rows,
        };
        print(&serde_json::to_string_pretty(&report).map_err(|e| CliError::Failed(e.to_string()))?);
    } else {
        print(&format!("{} in {seconds:.0} s", summary_line(&rows)));
    }
    Ok(if failed > 0 { FAILED } else { 0 })
}

/// What the arguments ask for, with every name checked.
fn options(a: &VerifyArgs) -> Result<Options, CliError> {
    let known: Vec<&str> = names().iter().map(|n| n.0).collect();
    if let Some(name) = a.cases.iter().find(|n| !known.contains(&n.as_str())) {
        return Err(CliError::Usage(format!("unknown case {name:?}; `caustica verify --list` names all")));
    }
    let methods: Vec<String> = a.integrators.iter().filter(|m| *m != "all").cloned().collect();
    if let Some(name) = methods.iter().find(|m| !METHODS.contains(&m.as_str())) {
        return Err(CliError::Usage(format!("unknown integrator {name:?}; known are all, {}", METHODS.join(", "))));
    }
    let accels = match a.accel {
        VerifyAccel::Both => back_ends(),
        VerifyAccel::Embree if !crate::accel::embree_available() => {
            return Err(CliError::Usage("this build has no Embree; use --accel bvh".into()));
        }
        VerifyAccel::Embree => vec![AccelKind::Embree],
        VerifyAccel::Bvh => vec![AccelKind::Bvh],
    };
    Ok(Options { cases: a.cases.clone(), accels, methods, seeds: a.seeds, fast: a.fast })
}

/// Writes the tables into a folder.
fn write(dir: &Path, rows: &[Row], stiffness: &str) -> Result<(), CliError> {
    let put = |name: &str, text: String| {
        let path = dir.join(name);
        std::fs::write(&path, text).map_err(|e| CliError::Failed(format!("{}: {e}", path.display())))
    };
    put("verify.csv", csv(rows))?;
    put("verify.md", markdown(rows))?;
    if !stiffness.is_empty() {
        put("stiffness.svg", stiffness.to_owned())?;
    }
    put("verify.html", html(rows, "caustica verify", stiffness))
}
