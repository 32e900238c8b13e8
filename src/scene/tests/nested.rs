//! Dielectrics with priorities.

use super::*;
use crate::bsdf::Ior;
use crate::geometry::SurfaceInteraction;

fn dielectric(ior: f64, priority: i32) -> String {
    format!(
        "<bsdf type=\"dielectric\"><float name=\"int_ior\" value=\"{ior}\"/><float name=\"ext_ior\" value=\"1\"/>
         <integer name=\"priority\" value=\"{priority}\"/></bsdf>"
    )
}

fn ball(x: f64, radius: f64, inside: &str) -> String {
    format!(
        "<shape type=\"sphere\"><point name=\"center\" x=\"{x}\" y=\"0\" z=\"0\"/><float name=\"radius\" value=\"{radius}\"/>
         {inside}</shape>"
    )
}

/// Glass within 1 of the origin, water within 1 of (1.2, 0, 0).
fn glass_over_water() -> Scene {
    ok(&(ball(0.0, 1.0, &dielectric(1.5, 2)) + &ball(1.2, 1.0, &dielectric(1.33, 1))))
}

/// The interfaces along a straight line, with where they are.
fn interfaces(s: &Scene, mut ray: Ray) -> Vec<(f64, SurfaceInteraction)> {
    let mut found = Vec::new();
    while let Some(si) = s.intersect(&mut ray) {
        found.push((s.to_scene.to_world(si.p).x, si));
        ray = si.spawn_ray(ray.d);
    }
    found
}

#[track_caller]
fn expect(s: &Scene, found: &[(f64, SurfaceInteraction)], expected: &[(f64, f64, f64)]) {
    let positions: Vec<f64> = found.iter().map(|f| f.0).collect();
    assert_eq!(found.len(), expected.len(), "{positions:?}");
    for ((x, si), (at, inside, outside)) in found.iter().zip(expected) {
        assert!((x - at).abs() < 1e-5, "{positions:?}");
        assert_eq!(s.met(si.near, si.far), Some(Ior::new(*inside, *outside)), "at {at}");
    }
}

#[test]
fn the_higher_priority_is_there_from_both_sides() {
    let s = glass_over_water();
    let mut expected = [(-1.0, 1.5, 1.0), (1.0, 1.5, 1.33), (2.2, 1.33, 1.0)];
    expect(&s, &interfaces(&s, Ray::new(at(&s, [-3.0, 0.0, 0.0]), Vec3::X)), &expected);
    expected.reverse();
    expect(&s, &interfaces(&s, Ray::new(at(&s, [5.0, 0.0, 0.0]), Vec3::NEG_X)), &expected);
    assert_eq!(s.nesting_faults(), Some(crate::scene::NestingFaults { lost: 0, stray: 0 }));
}

#[test]
fn of_equal_priorities_the_first_is_there_and_equal_media_are_one() {
    let s = ok(&(ball(0.0, 1.0, &dielectric(1.5, 1)) + &ball(1.2, 1.0, &dielectric(1.33, 1))));
    let ray = Ray::new(at(&s, [-3.0, 0.0, 0.0]), Vec3::X);
    expect(&s, &interfaces(&s, ray), &[(-1.0, 1.5, 1.0), (1.0, 1.5, 1.33), (2.2, 1.33, 1.0)]);
    let s = ok(&(ball(1.2, 1.0, &dielectric(1.33, 1)) + &ball(0.0, 1.0, &dielectric(1.5, 1))));
    let ray = Ray::new(at(&s, [-3.0, 0.0, 0.0]), Vec3::X);
    expect(&s, &interfaces(&s, ray), &[(-1.0, 1.5, 1.0), (0.2, 1.33, 1.5), (2.2, 1.33, 1.0)]);
    let s = ok(&(ball(0.0, 1.0, &dielectric(1.5, 1)) + &ball(1.2, 1.0, &dielectric(1.5, 1))));
    let found = interfaces(&s, Ray::new(at(&s, [-3.0, 0.0, 0.0]), Vec3::X));
    expect(&s, &found, &[(-1.0, 1.5, 1.0), (2.2, 1.5, 1.0)]);
    // The way from the ball's front to the other's back, with the interface that is none on it.
    assert!((found[1].1.t as f64 / s.to_scene.scale - 3.2).abs() < 1e-5);
}

#[test]
fn points_know_what_they_are_in() {
    let s = glass_over_water();
    let top = |x: f64| s.from_light(Ray::new(at(&s, [x, 0.0, 0.1]), Vec3::Z)).inside.top();
    assert_eq!([-1.5, -0.5, 0.5, 1.5, 2.5].map(top), [0, 1, 1, 2, 0]);
    // A ray from inside meets the same interfaces.
    let ray = s.from_light(Ray::new(at(&s, [0.5, 0.0, 0.0]), Vec3::X));
    expect(&s, &interfaces(&s, ray), &[(1.0, 1.5, 1.33), (2.2, 1.33, 1.0)]);
    let camera = "<sensor type=\"perspective\"><transform name=\"to_world\">
        <lookat origin=\"1.5, 0, 0\" target=\"3, 0, 0\" up=\"0, 0, 1\"/></transform></sensor>";
    let balls = ball(0.0, 1.0, &dielectric(1.5, 2)) + &ball(1.2, 1.0, &dielectric(1.33, 1));
    let s = ok(&(camera.to_owned() + &balls));
    let ray = s.camera_ray(glam::Vec2::new(384.0, 288.0), glam::Vec2::ZERO).ray;
    expect(&s, &interfaces(&s, ray), &[(2.2, 1.33, 1.0)]);
}

#[test]
fn shadow_rays_pass_what_is_no_interface() {
    let floor = "<shape type=\"rectangle\"><transform name=\"to_world\"><scale value=\"0.1\"/></transform></shape>";
    let in_water = |inner: &str| ok(&(floor.to_owned() + &ball(0.0, 5.0, &dielectric(1.33, 1)) + inner));
    let sees = |s: &Scene| {
        let floor = s.intersect(&mut s.from_light(Ray::new(at(s, [0.0, 0.0, 0.5]), Vec3::NEG_Z))).expect("the floor");
        assert!(s.shape_materials[floor.shape as usize].0 == s.shape_materials[0].0 && floor.near.top() != 0);
        s.visible(&floor, (at(s, [0.0, 0.0, 4.0]), Vec3::ZERO, Vec3::ZERO))
    };
    assert!(sees(&in_water(&ball(0.0, 2.0, &dielectric(1.5, 0)))), "weaker");
    assert!(sees(&in_water(&ball(0.0, 2.0, &dielectric(1.33, 1)))), "the same");
    assert!(!sees(&in_water(&ball(0.0, 2.0, &dielectric(1.5, 2)))), "stronger");
    assert!(!sees(&in_water(&ball(0.0, 2.0, "<bsdf type=\"dielectric\"/>"))), "as modelled");
}

#[test]
fn instances_are_full_too() {
    let instance = |x: f64| {
        format!(
            "<shape type=\"instance\"><ref id=\"g\"/><transform name=\"to_world\"><translate x=\"{x}\"/></transform></shape>"
        )
    };
    let group = format!("<shape type=\"shapegroup\" id=\"g\">{}</shape>", ball(0.0, 1.0, &dielectric(1.5, 1)));
    let s = ok(&(group + &instance(0.0) + &instance(1.2)));
    let ray = Ray::new(at(&s, [-3.0, 0.0, 0.0]), Vec3::X);
    expect(&s, &interfaces(&s, ray), &[(-1.0, 1.5, 1.0), (2.2, 1.5, 1.0)]);
    assert_eq!(s.from_light(Ray::new(at(&s, [1.7, 0.0, 0.0]), Vec3::Z)).inside.top(), 1);
}

#[test]
fn too_many_at_once_are_counted() {
    let balls: String = (0..10).map(|i| ball(0.0, 1.0 + i as f64, &dielectric(1.1 + 0.1 * i as f64, i))).collect();
    let s = ok(&balls);
    assert_eq!(interfaces(&s, Ray::new(at(&s, [-20.0, 0.0, 0.0]), Vec3::X)).first().map(|f| f.0.round()), Some(-10.0));
    let faults = s.nesting_faults().expect("priorities");
    assert!(faults.lost > 0 && faults.stray > 0, "{faults:?}");
}

#[test]
fn without_priorities_nothing_is_listed() {
    let s = ok(&ball(0.0, 1.0, "<bsdf type=\"dielectric\"/>"));
    let found = interfaces(&s, Ray::new(at(&s, [-3.0, 0.0, 0.0]), Vec3::X));
    assert_eq!(found.len(), 2);
    assert!(s.nesting_faults().is_none() && found.iter().all(|f| s.met(f.1.near, f.1.far).is_none()));
}

#[test]
fn wrong_priorities_are_told() {
    let with = |plugin: &str, value: &str| ball(0.0, 1.0, &format!("<bsdf type=\"{plugin}\">{value}</bsdf>"));
    let one = "<integer name=\"priority\" value=\"1\"/>";
    for (text, message) in [
        (with("dielectric", "<integer name=\"priority\" value=\"2000000\"/>"), "\"priority\" is 2000000"),
        (with("dielectric", "<float name=\"priority\" value=\"1.5\"/>"), "an integer here"),
        (with("dielectric", "<string name=\"priority\" value=\"high\"/>"), "an integer here"),
        (with("thindielectric", one), "priority"),
        (
            with("mask", &format!("<bsdf type=\"dielectric\">{one}</bsdf>")),
            "a dielectric with a \"priority\" is only a part of this shape's material",
        ),
        (
            ball(0.0, 1.0, &format!("<bsdf type=\"dielectric\">{one}</bsdf><emitter type=\"area\"/>")),
            "the shape is a lamp, and its dielectric has a \"priority\"",
        ),
    ] {
        let error = super::error(&text);
        assert!(error.contains(message), "{error}");
    }
    let bumpy = format!("<texture type=\"checkerboard\"/><bsdf type=\"roughdielectric\">{one}</bsdf>");
    assert!(ok(&with("bumpmap", &bumpy)).nesting_faults().is_some());
}
