use std::path::Path;

use glam::DVec3;

use super::*;
use crate::sample::{Key, Sequence};
use crate::scene::LoadOptions;

fn scene(shapes: &str) -> Scene {
    let text = format!("<scene version=\"3.0.0\"><sensor type=\"perspective\"/>{shapes}</scene>");
    Scene::from_text(&text, Path::new("scene.xml"), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// A rectangle of 2 × 2 around `at`, looking along +z before `turn`.
fn rectangle(turn: &str, at: [f64; 3], bsdf: &str) -> String {
    let [x, y, z] = at;
    format!(
        r#"<shape type="rectangle"><transform name="to_world">{turn}<translate x="{x}" y="{y}" z="{z}"/></transform>
        {bsdf}</shape>"#
    )
}

const DIFFUSE: &str = r#"<bsdf type="diffuse"/>"#;

/// What a ray from `eye` to `at` meets there.
fn seen(scene: &Scene, eye: DVec3, at: DVec3) -> SurfaceInteraction {
    let (o, p) = (scene.to_scene.point(eye), scene.to_scene.point(at));
    let si = scene.intersect(&mut Ray::new(o, (p - o).normalize())).expect("a surface");
    assert!(si.p.distance(p) < 1e-5, "{} is in the way of {p}", si.p);
    si
}

/// Mean share of the disc of radius `r` over 64 sets of probes.
fn share(scene: &Scene, si: &SurfaceInteraction, r: f64, kernel: Kernel) -> f32 {
    let patch = Patch::new(scene, si, true);
    let r_sq = (r * scene.to_scene.scale).powi(2) as f32;
    let of = |i| {
        let sampler = Sampler::new(Sequence::Independent, Key::new(1, Purpose::Test, 0), i);
        patch.share(kernel, r_sq, &sampler, &mut Counters::default())
    };
    (0..64).map(of).sum::<f32>() / 64.0
}

/// The first radius, world units, at which the surroundings are no longer whole.
fn clearing(scene: &Scene, si: &SurfaceInteraction, reach: f64) -> (f64, bool) {
    let mut patch = Patch::new(scene, si, true);
    let c = patch.clearing((reach * scene.to_scene.scale) as f32, &mut Counters::default());
    (c.radius as f64 / scene.to_scene.scale, c.solids)
}

/// The part of the disc's weight at x < d radii from its middle, by the midpoint rule.
fn half_plane(kernel: Kernel, d: f64) -> f64 {
    const N: i32 = 1000;
    let at = |i: i32| (f64::from(i) + 0.5) * 2.0 / f64::from(N) - 1.0;
    let cells = (0..N).flat_map(|i| (0..N).map(move |j| (at(i), at(j))));
    cells.filter(|c| c.0 < d).map(|(x, y)| f64::from(kernel.weight((x * x + y * y) as f32, 1.0))).sum::<f64>()
        * (2.0 / f64::from(N)).powi(2)
}

/// Stratified probes: one set of 8 is off by less than 0.1 rms, the mean of 64 by 0.0125; three of those.
const NOISE: f64 = 0.0375;

#[test]
fn the_share_of_a_rectangle_is_known() {
    let s = scene(&rectangle("", [0.0, 0.0, 0.0], DIFFUSE));
    let kernels = [Kernel::Epanechnikov, Kernel::Disc, Kernel::Gaussian];
    for (x, y) in [(0.0, 0.0), (0.8, 0.0), (0.9999, 0.0), (0.9999, 0.9999)] {
        let si = seen(&s, DVec3::new(x, y, 1.0), DVec3::new(x, y, 0.0));
        for kernel in kernels {
            let r = 0.4;
            let along = |c: f64| half_plane(kernel, (1.0 - c) / r);
            let expected = if y > 0.0 { 0.25 } else { along(x) };
            let found = f64::from(share(&s, &si, r, kernel));
            assert!((found - expected).abs() < NOISE, "{kernel:?} at {x}, {y}: {found}, not {expected}");
        }
        let (radius, solids) = clearing(&s, &si, 0.4);
        let edge = 1.0 - f64::max(x, y);
        assert!(
            radius <= 1.001 * edge.min(0.4) && radius > 0.75 * edge.min(0.4) - 0.03 && !solids,
            "{x}, {y}: {radius}"
        );
    }
}

/// Photons lie on a sphere's whole ball: what curves away is as much surface as it hides.
#[test]
fn spheres_are_whole_inside_and_outside() {
    let s = scene(
        r#"<shape type="sphere"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <shape type="sphere"><float name="radius" value="3"/><bsdf type="diffuse"/>
        <boolean name="flip_normals" value="true"/></shape>"#,
    );
    let d = DVec3::new(0.48, 0.6, 0.64);
    for (eye, at, radius) in [(2.0 * d, d, 1.0), (DVec3::ZERO, d, 1.0), (2.0 * d, 3.0 * d, 3.0)] {
        let si = seen(&s, eye, at);
        assert_eq!(
            clearing(&s, &si, 0.4 * radius),
            ((0.4 * radius * s.to_scene.scale) as f32 as f64 / s.to_scene.scale, false)
        );
        // Beyond what the pilot finds whole, shares above 1 are cut.
        for (r, margin) in [(0.01, 0.01), (0.1, 0.01), (0.3, 0.01), (0.6, 0.02)] {
            let found = share(&s, &si, r * radius, Kernel::Epanechnikov);
            assert!((found - 1.0).abs() < margin, "{eye} to {at}, r = {r}: {found}");
        }
    }
}

#[test]
fn sheets_above_each_other_count_once() {
    // The upper one ends at x = 1 with the lower one, or before it.
    for (lower, expected) in [(0.0, 0.5), (0.5, 1.0)] {
        let planes = rectangle("", [0.0, 0.0, 1e-3], DIFFUSE) + &rectangle("", [lower, 0.0, 0.0], DIFFUSE);
        let s = scene(&planes);
        let si = seen(&s, DVec3::new(0.9999, 0.0, 1.0), DVec3::new(0.9999, 0.0, 1e-3));
        let found = f64::from(share(&s, &si, 0.3, Kernel::Epanechnikov));
        assert!((found - expected).abs() < NOISE, "{found}, not {expected}");
    }
    // A wall of two sides: the far one is none of the near one's surface.
    let back = rectangle(r#"<rotate y="1" angle="180"/>"#, [0.5, 0.0, -1e-3], DIFFUSE);
    let s = scene(&(rectangle("", [0.0, 0.0, 0.0], DIFFUSE) + &back));
    let si = seen(&s, DVec3::new(0.9999, 0.0, 1.0), DVec3::new(0.9999, 0.0, 0.0));
    let found = f64::from(share(&s, &si, 0.3, Kernel::Epanechnikov));
    assert!((found - 0.5).abs() < NOISE, "{found}");
}

/// At the foot of a wall that stands on the floor's edge, of a block, and of a sheet with light on both sides.
#[test]
fn what_stands_on_a_floor() {
    let floor = rectangle(r#"<scale value="2"/>"#, [0.0, 0.0, 0.0], DIFFUSE);
    let upright = r#"<rotate y="1" angle="-90"/>"#;
    let cube = r#"<shape type="cube"><transform name="to_world"><scale value="0.5"/><translate x="0.5" z="0.5"/></transform>
        <bsdf type="diffuse"/></shape>"#;
    let two = r#"<bsdf type="twosided"><bsdf type="diffuse"/></bsdf>"#;
    let cases = [
        ("wall", rectangle(upright, [2.0, 0.0, 1.0], DIFFUSE), 1.9999, 0.5, false),
        ("block", cube.to_owned(), -0.0001, 0.5, true),
        ("sheet", rectangle(upright, [0.0, 0.0, 1.0], two), -0.0001, 1.0, false),
    ];
    for (name, standing, x, expected, solids) in cases {
        let s = scene(&(floor.clone() + &standing));
        let si = seen(&s, DVec3::new(x - 1.0, 0.0, 1.0), DVec3::new(x, 0.0, 0.0));
        let found = f64::from(share(&s, &si, 0.3, Kernel::Epanechnikov));
        assert!((found - expected).abs() < NOISE, "{name}: {found}, not {expected}");
        let (radius, covered) = clearing(&s, &si, 0.3);
        assert!(covered == solids && (radius < 0.01) == (expected < 1.0), "{name}: {radius}, {covered}");
    }
}

/// Where another material takes over that keeps no photons, the surface ends.
#[test]
fn mirrors_hold_no_photons() {
    let mirror = rectangle("", [2.0, 0.0, 0.0], r#"<bsdf type="conductor"/>"#);
    let s = scene(&(rectangle("", [0.0, 0.0, 0.0], DIFFUSE) + &mirror));
    let si = seen(&s, DVec3::new(0.9999, 0.0, 1.0), DVec3::new(0.9999, 0.0, 0.0));
    let found = f64::from(share(&s, &si, 0.3, Kernel::Epanechnikov));
    assert!((found - 0.5).abs() < NOISE, "{found}");
}
