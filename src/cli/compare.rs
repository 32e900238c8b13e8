//! `caustica compare`.

use serde::Serialize;

use super::args::CompareArgs;
use super::{CliError, print};
use crate::image::diff::{HeatmapOptions, heatmap};
use crate::image::metrics::{Metric, RELMSE_EPSILON, error_map};
use crate::image::{Comparison, Format, Image, WriteOptions};
use crate::report::agreement::{self, BlockTest, Blocks};

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    comparison: &'a Comparison,
    /// Whether the images may show the same light; `null` where neither says how noisy it is.
    same_light: Option<BlockTest>,
}

pub fn run(a: &CompareArgs) -> Result<u8, CliError> {
    if let Some(path) = a.heatmap.as_ref().filter(|p| Format::from_path(p) != Some(Format::Png)) {
        return Err(CliError::Usage(format!("{}: an error image is written as .png", path.display())));
    }
    let image = crate::image::read(&a.image).map_err(CliError::Input)?;
    let reference = crate::image::read(&a.reference).map_err(CliError::Input)?;
    let wrong = |e| CliError::Usage(format!("{} and {}: {e}", a.image.display(), a.reference.display()));
    let comparison = crate::image::compare(&image, &reference).map_err(wrong)?;
    let same_light = test(&image, &reference);
    if let Some(path) = &a.heatmap {
        let relative = |x: f64, r: f64| (x - r).powi(2) / (r * r + RELMSE_EPSILON * RELMSE_EPSILON);
        let map: Vec<f64> = error_map(&image, &reference, relative).map_err(wrong)?;
        let map: Vec<f64> = map.into_iter().map(f64::sqrt).collect();
        let picture = heatmap(&map, image.width(), image.height(), &HeatmapOptions { range: None, log: true });
        crate::image::write(path, &picture, &WriteOptions::default()).map_err(CliError::Output)?;
    }
    if a.json {
        let text = serde_json::to_string_pretty(&Report { comparison: &comparison, same_light })
            .map_err(|e| CliError::Failed(e.to_string()))?;
        print(&text);
    } else {
        print_table(&comparison);
        match same_light {
            Some(t) => print_test(&t),
            None => print("same light  unknown: neither image has a variance layer (render --aov variance)"),
        }
    }
    Ok(0)
}

/// Tests block by block whether two images may show the same light. One without a variance layer counts as exact.
fn test(image: &Image, reference: &Image) -> Option<BlockTest> {
    let blocks = |image: &Image| {
        let text = |key: &str| image.metadata.get(&format!("caustica.{key}"));
        // Of a reference's two halves the shorter one limits what is known.
        let passes = text("reference.passes").or_else(|| text("passes"));
        let passes = passes.and_then(|p| p.split(',').filter_map(|n| n.parse().ok()).min());
        Blocks::from_layers(image, passes)
    };
    match (blocks(image), blocks(reference)) {
        (None, None) => None,
        (x, r) => {
            let (x, r) = (x.unwrap_or_else(|| Blocks::exact(image)), r.unwrap_or_else(|| Blocks::exact(reference)));
            Some(agreement::test(&x, &r))
        }
    }
}

fn print_table(c: &Comparison) {
    print(&format!("size        {} x {}", c.width, c.height));
    let rgb = |m: [f64; 3]| format!("{:.6} {:.6} {:.6}", m[0], m[1], m[2]);
    print(&format!("mean        {} against {}", rgb(c.mean_image), rgb(c.mean_reference)));
    if let Some(d) = c.mean_difference {
        print(&format!("difference  {:+.4} % of the mean", 100.0 * d));
    }
    print(&format!("{:11} {:>14} {:>20} {:>18}", "metric", "value", "without worst 0.1 %", "error held there"));
    let row = |name: &str, m: &Metric| {
        let energy = 100.0 * m.trimmed.energy;
        print(&format!("{name:11} {:14.6e} {:20.6e} {energy:16.2} %", m.value, m.trimmed.value));
    };
    row("rmse", &c.rmse);
    row("relmse", &c.relmse);
    match &c.mrse {
        Some(m) => row("mrse", m),
        None => print("mrse        undefined: the reference is black"),
    }
    row("smape", &c.smape);
    row("flip", &c.flip);
    print(&format!("largest     {:.6e} at pixel {}, {}", c.max_difference, c.max_at.0, c.max_at.1));
}

fn print_test(t: &BlockTest) {
    let verdict = if t.rejected { "no" } else { "may be" };
    print(&format!(
        "same light  {verdict}: block at pixel {}, {} differs by {:.1} standard errors, limit {:.1} over {} comparisons, \
         p = {:.2e}",
        t.at.0, t.at.1, t.largest_z, t.limit, t.tests, t.p_value
    ));
}
