//! Metrics of rendered pictures against an independent computation.
//!
//! `images/` holds pictures of scenes/cornell-spheres.xml (4 samples a pixel; 256 by bdpt) and scenes/environment.xml (1 and
//! 64). The numbers were computed in double precision with numpy from the definitions in `image::metrics`, and ꟻLIP with
//! the authors' package flip-evaluator 1.7 from PyPI (`evaluate(reference, test, "LDR", applyMagma=False)` on float32
//! sRGB values).

use std::path::Path;

use caustica::image::metrics::Metric;
use caustica::image::{compare, read};

/// Plain, without the 0.1 % of pixels with the largest error, share of the error that those hold.
type Row = [f64; 3];

fn check(image: &str, reference: &str, expected: [(&str, Row); 5]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/images");
    let [x, r] = [image, reference].map(|name| read(folder.join(name)).expect("a picture of the repository"));
    let c = compare(&x, &r).expect("pictures of one size");
    let found = [c.rmse, c.relmse, c.mrse.expect("a lit reference"), c.smape, c.flip];
    for ((name, row), Metric { value, trimmed }) in expected.into_iter().zip(found) {
        for (wanted, got) in row.into_iter().zip([value, trimmed.value, trimmed.energy]) {
            assert!((got / wanted - 1.0).abs() < 1e-5, "{image}: {name} is {got}, expected {wanted}");
        }
    }
}

#[test]
fn caustics_with_few_samples() {
    check(
        "spheres-4spp.exr",
        "spheres.exr",
        [
            ("rmse", [2.402413815e-01, 2.005936658e-01, 3.035106596e-01]),
            ("relmse", [1.325909275e+00, 5.250589777e-01, 6.043875439e-01]),
            ("mrse", [1.644577350e+00, 6.080755076e-01, 6.306153165e-01]),
            ("smape", [1.528355273e-01, 1.520181885e-01, 6.319172449e-03]),
            ("flip", [1.531471482e-01, 1.525054498e-01, 5.162548306e-03]),
        ],
    );
}

#[test]
fn an_outdoor_scene_with_one_sample() {
    check(
        "sky-1spp.exr",
        "sky.exr",
        [
            ("rmse", [5.462061739e-01, 3.913122832e-01, 4.872455613e-01]),
            ("relmse", [2.724560482e+00, 6.540409209e-01, 7.601806921e-01]),
            ("mrse", [2.605639981e+00, 6.313639841e-01, 7.579299434e-01]),
            ("smape", [2.288535789e-01, 2.281069358e-01, 4.235912850e-03]),
            ("flip", [2.476172801e-01, 2.470884058e-01, 3.110330428e-03]),
        ],
    );
}
