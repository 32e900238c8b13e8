//! `caustica compare`.

use super::args::CompareArgs;
use super::{CliError, print};
use crate::image::Comparison;
use crate::image::metrics::Metric;

pub fn run(a: &CompareArgs) -> Result<u8, CliError> {
    let image = crate::image::read(&a.image).map_err(CliError::Input)?;
    let reference = crate::image::read(&a.reference).map_err(CliError::Input)?;
    let comparison = crate::image::compare(&image, &reference)
        .map_err(|e| CliError::Usage(format!("{} and {}: {e}", a.image.display(), a.reference.display())))?;
    if a.json {
        let text = serde_json::to_string_pretty(&comparison).map_err(|e| CliError::Failed(e.to_string()))?;
        print(&text);
    } else {
        print_table(&comparison);
    }
    Ok(0)
}

fn print_table(c: &Comparison) {
    print(&format!("size        {} x {}", c.width, c.height));
    let rgb = |m: [f64; 3]| format!("{:.6} {:.6} {:.6}", m[0], m[1], m[2]);
    print(&format!("mean        {} against {}", rgb(c.mean_image), rgb(c.mean_reference)));
    if let Some(d) = c.mean_difference {
        print(&format!("difference  {:+.4} % of the mean", 100.0 * d));
    }
    print(&format!("{:11} {:>14} {:>20}", "metric", "value", "without worst 0.1 %"));
    let row = |name: &str, m: &Metric| print(&format!("{name:11} {:14.6e} {:20.6e}", m.value, m.trimmed.value));
    row("rmse", &c.rmse);
    row("relmse", &c.relmse);
    match &c.mrse {
        Some(m) => row("mrse", m),
        None => print("mrse        undefined: the reference is black"),
    }
    row("smape", &c.smape);
    print(&format!("largest     {:.6e} at pixel {}, {}", c.max_difference, c.max_at.0, c.max_at.1));
}
