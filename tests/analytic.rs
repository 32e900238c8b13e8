//! Scenes whose radiance is known.

mod common;

use common::{Estimate, backends, closed_sphere, scene};

/// See [`closed_sphere`]; paths are at most `max_depth` edges long.
fn sphere(rho: f64, max_depth: i32, emission: &str, lights: &str) -> String {
    let path = format!(r#"<integrator type="path"><integer name="max_depth" value="{max_depth}"/></integrator>"#);
    closed_sphere(&path, "independent", rho, emission, lights)
}

fn point(intensity: f64) -> String {
    format!(
        r#"<emitter type="point"><point name="position" x="0" y="0" z="0"/><rgb name="intensity" value="{intensity}"/></emitter>"#
    )
}

fn emission(radiance: f64) -> String {
    format!(r#"<emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter>"#)
}

/// E = I/R² = π at every wall from a light in the centre; L = (ρE/π)/(1−ρ) = 1 for ρ = ½, and ½/(1−½) = 1 for Le = ½.
#[test]
fn closed_sphere_has_radiance_one() {
    let four = point(std::f64::consts::FRAC_PI_4).repeat(4);
    let cases = [
        ("point light", sphere(0.5, -1, "", &point(std::f64::consts::PI))),
        ("four lights", sphere(0.5, -1, "", &four)),
        ("emission", sphere(0.5, -1, &emission(0.5), "")),
    ];
    for accel in backends() {
        for (name, xml) in &cases {
            let s = scene(xml, accel);
            Estimate::over_seeds(&s, "path", 64, 16).assert_is(1.0, 3.0, 0.002, &format!("{name}, path, {accel:?}"));
            let photons = Estimate::over_seeds(&s, "photonmapper", 16, 4);
            photons.assert_is(1.0, f64::MAX, 0.01, &format!("{name}, photonmapper, {accel:?}"));
        }
    }
}

/// L = Le Σ ρⁿ: the sum over all depths and its partial sums.
#[test]
fn furnace_sums_its_depths() {
    let cases = [0.5, 0.9, 0.99].into_iter().flat_map(|rho| [1, 2, 4, -1].map(|max_depth| (rho, max_depth)));
    for (rho, max_depth) in cases {
        for accel in backends() {
            let s = scene(&sphere(rho, max_depth, &emission(1.0), ""), accel);
            let truth = match max_depth {
                -1 => 1.0 / (1.0 - rho),
                n => (0..n).map(|k| rho.powi(k)).sum(),
            };
            let what = format!("albedo {rho}, max_depth {max_depth}, {accel:?}");
            // The number of bounces is geometric: its relative deviation is almost 1 for each sample.
            let path = Estimate::over_seeds(&s, "path", if rho > 0.95 { 128 } else { 64 }, 8);
            path.assert_is(truth, 4.0, 0.005, &format!("path, {what}"));
            // So is that of the photons of one path: three million photons are 30 000 paths at an albedo of 0.99.
            let photons = Estimate::of((1..=4).map(|seed| {
                let count = if rho > 0.95 && max_depth < 0 { 3_000_000 } else { 250_000 };
                common::mean(&common::photon_image(&s, 4, count, seed))
            }));
            photons.assert_is(truth, f64::MAX, 0.01, &format!("photonmapper, {what}"));
        }
    }
}
