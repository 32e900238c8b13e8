//! Progressive photon mapping: it finds the same light as path tracing, and converges as fast as its theory says.

mod common;

#[cfg(feature = "slow-tests")]
use std::sync::atomic::AtomicBool;
#[cfg(feature = "slow-tests")]
use std::time::Instant;

use caustica::accel::AccelKind;
use caustica::image::Image;
use caustica::render::PlanOverrides;
#[cfg(feature = "slow-tests")]
use caustica::render::{Control, Plan, Session, Silent};
use caustica::scene::Scene;
use common::{Estimate, backends, closed_sphere, floor_truth, floor_under_a_pane, scene};

fn render(s: &Scene, integrator: &str, passes: u64, photons: u64, seed: u64) -> Image {
    let o = PlanOverrides {
        integrator: Some(integrator.into()),
        passes: Some(passes),
        photons: Some(photons),
        seed: Some(seed),
        ..PlanOverrides::default()
    };
    common::run(s, o).image
}

/// E = I/R² = π at every wall from a light in the centre; L = (ρE/π)/(1 − ρ) = 1, and Le/(1 − ρ) = 1 for Le = ½.
#[test]
fn closed_sphere_has_radiance_one() {
    let point = r#"<emitter type="point"><rgb name="intensity" value="3.1415927"/></emitter>"#;
    let wall = r#"<emitter type="area"><rgb name="radiance" value="0.5"/></emitter>"#;
    for accel in backends() {
        for (name, emission, lights) in [("point light", "", point), ("emission", wall, "")] {
            let s = scene(&closed_sphere("", "sobol", 0.5, emission, lights), accel);
            for integrator in ["ppm", "sppm"] {
                let e = Estimate::of((1..=4).map(|seed| common::mean(&render(&s, integrator, 16, 20_000, seed))));
                e.assert_is(1.0, f64::MAX, 0.005, &format!("{name}, {integrator}, {accel:?}"));
            }
        }
    }
}

/// One pass reads photons within the first radii: a tenth of them leaves a hundredth of the photons, ten times the noise.
#[test]
fn radius_scale_multiplies_the_radii_that_were_measured() {
    let noise = |parameter: &str| {
        let image = render(&scene(&floor_under_a_pane(parameter), AccelKind::Bvh), "sppm", 1, 200_000, 1);
        let errors = (0..12).flat_map(|y| (0..12).map(move |x| (x, y)));
        errors.map(|(x, y)| (image.pixel(x, y).g as f64 / floor_truth(x, y) - 1.0).powi(2)).sum::<f64>().sqrt()
    };
    let ratio = noise(r#"<float name="radius_scale" value="0.1"/>"#) / noise("");
    assert!((5.0..20.0).contains(&ratio), "{ratio}");
}

/// Three passes of four camera samples, asked for by the scene, from outside or by both numbers: the same picture, and another
/// one than of twelve passes.
#[test]
fn a_pass_may_take_more_samples_than_one() {
    let rendered = |parameter: &str, o: PlanOverrides| {
        let s = scene(&floor_under_a_pane(parameter), AccelKind::Bvh);
        let o = PlanOverrides { integrator: Some("sppm".into()), photons: Some(2_000), seed: Some(1), ..o };
        common::run(&s, o)
    };
    let in_file = r#"<integer name="samples_per_pass" value="4"/>"#;
    let passes = |n| PlanOverrides { passes: Some(n), ..PlanOverrides::default() };
    let told = rendered("", PlanOverrides { samples_per_pass: Some(4), ..passes(3) });
    assert_eq!((told.summary.passes, told.summary.spp), (3, 12));
    assert_eq!(rendered(in_file, passes(3)).image, told.image);
    assert_eq!(rendered("", PlanOverrides { spp: Some(12), ..passes(3) }).image, told.image);
    assert_eq!(rendered(in_file, PlanOverrides { spp: Some(12), ..PlanOverrides::default() }).image, told.image);
    assert_ne!(rendered("", passes(12)).image, told.image);
}

/// A square that a distant light shines on through a pane that changes nothing, E = π: L = ρE/π = 1 up to its edge. Discs of
/// radius 0.4, a fifth of the side, keep that size.
fn lit_square(correction: bool) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="sppm"><float name="initial_radius" value="0.4"/><float name="alpha" value="1"/>
    <boolean name="boundary_correction" value="{correction}"/></integrator>
  <sensor type="orthographic">
    <transform name="to_world"><lookat origin="0, 0.5, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="40"/>
      <rfilter type="box"/></film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="1.5"/><rotate x="1" angle="-90"/><translate y="0.8"/></transform>
    <bsdf type="dielectric"><float name="int_ior" value="1"/><float name="ext_ior" value="1"/></bsdf></shape>
  <emitter type="directional"><vector name="direction" x="0" y="-1" z="0"/><rgb name="irradiance" value="3.1415927"/></emitter>
</scene>"#
    )
}

/// The outermost of 40 pixels is 1/8 of a radius wide: without the correction it keeps 55 % of its light and a corner's 30 %.
/// Eight seeds of 16 passes; margins are the bias of the quotient, 2 % at edges and 5 % in corners, beside which the noise
/// that is printed is small.
#[test]
fn a_lit_square_is_flat_up_to_its_edge() {
    let means = |correction: bool| {
        let s = scene(&lit_square(correction), AccelKind::Auto);
        let images: Vec<_> = (1..=8).map(|seed| render(&s, "sppm", 16, 2000, seed)).collect();
        let at = |wanted: fn(bool, bool) -> bool| {
            Estimate::of(images.iter().map(|image| {
                let pixels = (0..40).flat_map(|y| (0..40).map(move |x| (x, y)));
                let of_kind = pixels.filter(|&(x, y)| wanted(x == 0 || x == 39, y == 0 || y == 39));
                let values: Vec<_> = of_kind.map(|(x, y)| image.pixel(x, y).g as f64).collect();
                values.iter().sum::<f64>() / values.len() as f64
            }))
        };
        [at(|x, y| !x && !y), at(|x, y| x != y), at(|x, y| x && y)]
    };
    let [inside, edges, corners] = means(true);
    println!("{inside:?}, {edges:?}, {corners:?}");
    inside.assert_is(1.0, f64::MAX, 0.01, "inside");
    edges.assert_is(1.0, f64::MAX, 0.02, "edges");
    corners.assert_is(1.0, f64::MAX, 0.05, "corners");
    let [_, edges, corners] = means(false);
    assert!((edges.mean - 0.56).abs() < 0.04 && (corners.mean - 0.31).abs() < 0.04, "{edges:?}, {corners:?}");
}

/// Rooms whose floor, or what stands on it, has narrow lobes: where camera paths go on there, every path of light still counts
/// once. Narrow lobes see each other, and through mirrors; they are mixed with diffuse, sharp and mirroring ones; they
/// transmit. `bdpt` tells the truth, the whole and blocks of 8 × 8 pixels of six seeds: within 5 standard errors (t with 10
/// degrees of freedom, 78 comparisons: 4 %) and 0.5 % of the mean for what discs of a hundredth of the room blur.
#[cfg(feature = "slow-tests")]
#[test]
fn paths_that_go_on_at_narrow_lobes_count_once() {
    let metal = |alpha: f64| format!(r#"<bsdf type="roughconductor"><float name="alpha" value="{alpha}"/></bsdf>"#);
    let blend = |a: &str, b: &str| format!(r#"<bsdf type="blendbsdf"><float name="weight" value="0.5"/>{a}{b}</bsdf>"#);
    let diffuse = r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf>"#;
    let half = blend(diffuse, &metal(0.2));
    let plastic = r#"<bsdf type="roughplastic"><float name="alpha" value="0.1"/></bsdf>"#;
    let frosted = r#"<bsdf type="roughdielectric"><float name="alpha" value="0.2"/></bsdf>"#;
    let mirror = r#"<bsdf type="conductor"><string name="material" value="none"/></bsdf>"#;
    for (name, floor, ball) in [
        ("narrow beside narrow", half.as_str(), half.as_str()),
        ("narrow beside a mirror", plastic, mirror),
        ("metal beside plastic", &metal(0.15), plastic),
        ("sharp and narrow", &blend(&half, &metal(0.05)), &half),
        ("mirror and narrow", &blend(mirror, &metal(0.2)), &half),
        ("frosted glass", &half, frosted),
    ] {
        let room = format!(
            r#"<scene version="3.0.0"><integrator type="sppm"><float name="initial_radius" value="0.02"/></integrator>
  <sensor type="perspective"><float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0, 0.2, 0.95" target="0, -0.8, -0.2" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="32"/><rfilter type="box"/></film>
    <sampler type="independent"/></sensor>
  <shape type="cube"><bsdf type="twosided">{diffuse}</bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><translate y="-0.99"/></transform>
    <bsdf type="twosided">{floor}</bsdf></shape>
  <shape type="sphere"><point name="center" x="0.3" y="-0.6" z="-0.2"/><float name="radius" value="0.35"/>{ball}</shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/><translate y="0.98"/>
    </transform><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape></scene>"#
        );
        let s = scene(&room, AccelKind::Auto);
        let images = |integrator: &str, passes: u64| -> Vec<Image> {
            (1..=6).map(|seed| render(&s, integrator, passes, 40_000, seed)).collect()
        };
        let (truth, found) = (images("bdpt", 96), images("sppm", 24));
        let same = |what: &str, of: &dyn Fn(&Image) -> f64| {
            let [a, b] = [&truth, &found].map(|images| Estimate::of(images.iter().map(of)));
            let allowed = 5.0 * (a.error.powi(2) + b.error.powi(2)).sqrt() + 0.005 * a.mean;
            assert!((a.mean - b.mean).abs() < allowed, "{name}, {what}: bdpt {a:?}, sppm {b:?}");
        };
        same("all", &common::mean);
        for (x0, y0) in (0..4).flat_map(|y| (0..3).map(move |x| (8 * x, 8 * y))) {
            same(&format!("block at {x0}, {y0}"), &|image| {
                let pixels = (y0..y0 + 8).flat_map(|y| (x0..x0 + 8).map(move |x| (x, y)));
                pixels.map(|(x, y)| image.pixel(x, y).mean() as f64).sum::<f64>() / 64.0
            });
        }
    }
}

#[cfg(feature = "slow-tests")]
fn mean_square_error(image: &Image) -> f64 {
    let (w, h) = (image.width(), image.height());
    let pixels = (0..h).flat_map(|y| (0..w).map(move |x| (x, y)));
    pixels.map(|(x, y)| (image.pixel(x, y).g as f64 - floor_truth(x, y)).powi(2)).sum::<f64>() / (w * h) as f64
}

/// The first pass with a small radius has no bias to speak of: the mean over many seeds is the truth.
#[test]
fn caustic_photons_bring_the_light_of_a_point_light() {
    for accel in backends() {
        let s = scene(&floor_under_a_pane(r#"<float name="initial_radius" value="0.05"/>"#), accel);
        let truth = (0..12).flat_map(|y| (0..12).map(move |x| floor_truth(x, y))).sum::<f64>() / 144.0;
        let e = Estimate::of((1..=16).map(|seed| common::mean(&render(&s, "sppm", 4, 20_000, seed))));
        e.assert_is(truth, 4.0, 0.01, &format!("{accel:?}"));
    }
}

/// The slope of log MSE against log passes: −2/3 for α = 2/3 with both schedules, −0.6 for 0.7 where blur dominates.
///
/// The theory is that of independent photons. The error at each number of passes is the mean over eight seeds and 144 pixels;
/// over six binary decades the fitted slope then has a deviation of about 0.02.
#[cfg(feature = "slow-tests")]
#[test]
fn slopes() {
    const SEEDS: u64 = 8;
    let (shared, tested) = ("shared_statistics", "chi_squared_radius");
    let cases = [
        (2.0 / 3.0, 0.25, 2000, ""),
        (2.0 / 3.0, 0.25, 2000, shared),
        (0.7, 0.42, 3000, ""),
        (2.0 / 3.0, 0.25, 2000, tested),
    ];
    let mut last = Vec::new();
    for (alpha, radius, photons, parameter) in cases {
        let mut schedule =
            format!(r#"<float name="initial_radius" value="{radius}"/><float name="alpha" value="{alpha}"/>"#);
        if !parameter.is_empty() {
            schedule += &format!(r#"<boolean name="{parameter}" value="true"/>"#);
        }
        let s = scene(&floor_under_a_pane(&schedule), AccelKind::Auto);
        let snapshots = [8u64, 32, 128, 512];
        let mut errors = [0.0; 4];
        for seed in 1..=SEEDS {
            let o = PlanOverrides {
                passes: Some(512),
                photons: Some(photons),
                seed: Some(seed),
                ..PlanOverrides::default()
            };
            let plan = Plan::new(&s, &o).expect("a known integrator");
            let mut session = Session::new(&s, &plan);
            let stop = AtomicBool::new(false);
            let control = Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent };
            for (passes, error) in snapshots.into_iter().zip(&mut errors) {
                while session.passes() < passes {
                    session.step(&control);
                }
                *error += mean_square_error(&session.image()) / SEEDS as f64;
            }
        }
        let points: Vec<_> = snapshots.iter().zip(errors).map(|(n, e)| ((*n as f64).ln(), e.ln())).collect();
        let slope = fitted_slope(&points);
        let expected = -f64::min(alpha, 2.0 * (1.0 - alpha));
        let what = format!("α = {alpha}, {parameter}: slope {slope}, errors {errors:?}");
        println!("{what}");
        last.push(errors[3]);
        // Radii that are kept while light is even end no slower, and with less error.
        assert!(slope < expected + 0.07 && (parameter == tested || slope > expected - 0.07), "{what}");
    }
    assert!(last[3] < last[0], "{last:?}");
}

#[cfg(feature = "slow-tests")]
fn fitted_slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>() / points.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>()
}

/// A scene of unit-box size or scaled by 2^20 has the same bits: radii, footprints and schedules carry no lengths.
#[test]
fn a_power_of_two_changes_no_bit() {
    let of_scale = |k: f64| {
        let (i, half) = (k * k, 0.5 * k);
        let xml = format!(
            r#"<scene version="3.0.0">
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, {k}, {half}" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="{k}"/></transform>
    <bsdf type="plastic"/></shape>
  <shape type="sphere"><point name="center" x="0" y="{half}" z="0"/><float name="radius" value="{}"/>
    <bsdf type="dielectric"/></shape>
  <emitter type="point"><point name="position" x="{half}" y="{k}" z="0"/><rgb name="intensity" value="{i}"/></emitter>
</scene>"#,
            0.25 * k
        );
        let s = scene(&xml, backends()[0]);
        ["ppm", "sppm"].map(|integrator| render(&s, integrator, 3, 5000, 1).pixels().to_vec())
    };
    let one = of_scale(1.0);
    assert!(one[0].iter().any(|p| p.g > 0.0));
    assert_eq!(one, of_scale(2f64.powi(20)));
    assert_eq!(one, of_scale(2f64.powi(-20)));
}

/// On the scenes that ship, means within 0.5 % plus three standard errors of those of `path`, and blocks of 16 × 16 pixels
/// within 3 % of the mean of the block plus the noise: Student's t with 6 degrees of freedom at 99.9 %, Šidák-corrected for
/// 36 blocks (10.3). The 3 % are for what is left of the blur at edges after 24 passes.
#[cfg(feature = "slow-tests")]
#[test]
fn agrees_with_path_tracing() {
    use caustica::scene::{LoadOptions, Scene};
    for name in ["cornell-box.xml", "cornell-spheres.xml", "environment.xml"] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
        let s = Scene::load(&path, &LoadOptions { width: Some(96), ..LoadOptions::default() }).expect("a good scene");
        let blocks = |image: &Image| -> Vec<f64> {
            let (w, h) = (image.width() / 16, image.height() / 16);
            let mean = |bx: u32, by: u32| -> f64 {
                let pixels = (0..256).map(|i| image.pixel(16 * bx + i % 16, 16 * by + i / 16).mean() as f64);
                pixels.sum::<f64>() / 256.0
            };
            (0..h).flat_map(|by| (0..w).map(move |bx| mean(bx, by))).collect()
        };
        let path: Vec<_> = (1..=4).map(|seed| common::image(&s, "path", 128, seed)).collect();
        let ppm: Vec<_> = (1..=4).map(|seed| render(&s, "ppm", 24, 20_000, seed)).collect();
        let mean = |images: &[Image]| Estimate::of(images.iter().map(common::mean));
        let (a, b) = (mean(&path), mean(&ppm));
        let noise = 3.0 * a.error.hypot(b.error);
        println!("{name}: path {a:?}, ppm {b:?}");
        assert!((a.mean - b.mean).abs() < 0.005 * a.mean + noise, "{name}: path {a:?}, ppm {b:?}");
        let (path, ppm): (Vec<_>, Vec<_>) = (path.iter().map(blocks).collect(), ppm.iter().map(blocks).collect());
        for block in 0..path[0].len() {
            let of = |images: &[Vec<f64>]| Estimate::of(images.iter().map(|i| i[block]));
            let (a, b) = (of(&path), of(&ppm));
            let z = ((a.mean - b.mean).abs() - 0.03 * a.mean.max(b.mean)) / a.error.hypot(b.error).max(1e-12);
            assert!(z < 10.3, "{name}, block {block}: path {a:?}, ppm {b:?}");
        }
    }
}
