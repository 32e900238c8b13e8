//! Curved mirrors, lenses and prisms, and light that is trapped by total reflection.

use super::super::case::{Case, Check, Item, Outcome};
use super::super::methods::Light;
use super::super::optics::fresnel;
use super::super::probe::{Probe, load};
use super::super::trace::{Turn, angle, follow};
use super::super::xml::*;
use crate::accel::AccelKind;
use crate::geometry::TriangleMesh;
use crate::math::{DVec3, Vec3};
use crate::sample::Sequence;
use crate::scene::Scene;
use crate::shoot::{Emission, ShootSettings, Shot, Target, WalkSettings, shoot, shoot_paths};
use std::f64::consts::{PI, TAU};

pub fn cases() -> Vec<Case> {
    vec![
        Case { name: "prism", about: "least deviation of a 60° prism: 2 asin(n sin 30°) − 60°", items: prisms },
        Case {
            name: "ball-lens",
            about: "sun through a glass ball: where rays land, how much light within a circle",
            items: balls,
        },
        Case {
            name: "curved-mirrors",
            about: "ellipsoid, paraboloid and cylinder focus where they must",
            items: mirrors,
        },
        Case {
            name: "trapped",
            about: "isotropic light in a glass cube: 3(1 − cos θc) gets out, the rest never, and the run ends",
            items: cube,
        },
    ]
}

fn own(xml: &str, meshes: &[(&'static str, TriangleMesh)], accel: AccelKind) -> Scene {
    load(xml, meshes, accel).unwrap_or_else(|e| panic!("the program's own scene: {e}"))
}

/// An equilateral prism of side 2 along y, its apex up.
fn prism() -> TriangleMesh {
    let apex = 3f32.sqrt();
    let corners = [(0.0, apex), (-1.0, 0.0), (1.0, 0.0)];
    let positions: Vec<Vec3> = [-1.0, 1.0].iter().flat_map(|&y| corners.map(|(x, z)| Vec3::new(x, y, z))).collect();
    let mut indices = vec![[0, 1, 2], [3, 5, 4]];
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        indices.extend([[a, a + 3, b], [b, a + 3, b + 3]]);
    }
    // Turn all faces outwards.
    let center = Vec3::new(0.0, 0.0, apex / 3.0);
    for t in &mut indices {
        let [a, b, c] = t.map(|i: u32| positions[i as usize]);
        if (b - a).cross(c - a).dot(a - center) < 0.0 {
            t.swap(1, 2);
        }
    }
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// At least deviation the ray crosses the prism parallel to its base, refracted to 30° at both faces.
fn prisms() -> Vec<Item> {
    let of = |name: &str, n: f64| {
        let i = (n * 0.5).asin();
        let truth = (2.0 * i).to_degrees() - 60.0;
        let check = Check::new(format!("{name}, n = {n}, degrees"), "trace", move |accel, _| {
            let scene = own(
                &scene(&[
                    depth(-1),
                    mesh("prism.ply", &(r#"<boolean name="face_normals" value="true"/>"#.to_owned() + &glass(n))),
                ]),
                &[("prism.ply", prism())],
                accel,
            );
            let up = i - PI / 6.0;
            let d = DVec3::new(up.cos(), 0.0, up.sin());
            let at = DVec3::new(-0.5, 0.1, 0.75f64.sqrt());
            let out = follow(&scene, at - 2.0 * d, d, &[Turn::Refract, Turn::Refract]);
            Outcome::exact(truth, out.map_or(f64::NAN, |(_, out)| angle(d, out).to_degrees()))
        });
        Item::from(check.relative(2e-6))
    };
    vec![of("glass", 1.5), of("BK7 at the d line", 1.5168)]
}

const BALL: f64 = 1.5;

/// Where a ray of impact parameter `b` meets the plane at distance `z` behind the centre of a unit ball, and the share of
/// its power that gets there by two refractions.
fn through_ball(b: f64, z: f64) -> (f64, f64) {
    let (i, t) = (b.asin(), (b / BALL).asin());
    let out = 2.0 * t - i;
    let x = out.sin() - (z - out.cos()) * (2.0 * (i - t)).tan();
    (x, (1.0 - fresnel(BALL, i.cos())).powi(2))
}

/// `∫ g(x(b), weight) 2b db`: a mean over the ball's cross-section.
fn over_ball(z: f64, g: impl Fn(f64, f64) -> f64) -> f64 {
    const STEPS: usize = 400_000;
    let h = 1.0 / STEPS as f64;
    (0..STEPS)
        .map(|i| {
            let b = (i as f64 + 0.5) * h;
            let (x, weight) = through_ball(b, z);
            g(x, weight) * 2.0 * b * h
        })
        .sum()
}

fn ball_scene(z: f64, camera: &str, receiver: &str) -> String {
    scene(&[
        depth(4),
        camera.into(),
        sphere([0.0; 3], 1.0, &glass(BALL)),
        square([0.0, 0.0, -z], 3.0, [0.0, 0.0, 1.0], receiver),
        sun([0.0, 0.0, -1.0], 1.0),
    ])
}

fn caustic_photons(scene: &Scene, photons: u64, seed: u64, max_depth: u32) -> Shot {
    let walk = WalkSettings { max_depth: Some(max_depth), rr_depth: u32::MAX, sequence: Sequence::Independent };
    shoot(
        scene,
        &ShootSettings {
            seed,
            pass: 0,
            target: Target::Caustic,
            walk,
            photons,
            max_paths: photons * 64,
            guided: false,
        },
    )
}

fn balls() -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    // Single rays.
    for (b, z) in [(0.01, 3.0), (0.5, 3.0), (0.9, 3.0), (0.999, 1.2)] {
        let check = Check::new(format!("b = {b}, Z = {z}"), "trace", move |accel, _| {
            let scene = own(&ball_scene(z, "", &black()), &[], accel);
            let out = follow(&scene, DVec3::new(b, 0.0, 4.0), DVec3::NEG_Z, &[Turn::Refract, Turn::Refract]);
            let x = out.map_or(f64::NAN, |(p, d)| p.x + (-z - p.z) / d.z * d.x);
            Outcome::exact(through_ball(b, z).0, x)
        });
        // At grazing incidence the last digits of the direction count a thousandfold.
        items.push(if b > 0.99 { check.relative(1e-3) } else { check.absolute(3e-6) }.into());
    }
    // Shares of the light that falls on the ball.
    for (z, radius) in [(3.0, 0.1), (3.0, 0.2), (3.0, 0.4), (3.0, 0.8), (2.0, 0.1), (2.0, 0.2), (2.0, 0.4), (2.0, 0.8)]
    {
        let truth = over_ball(z, |x, weight| if x.abs() <= radius { weight } else { 0.0 });
        let check = Check::new(format!("within {radius}, Z = {z}"), "photons", move |accel, seeds| {
            let scene = own(&ball_scene(z, "", &black()), &[], accel);
            // Light that only touches the ball lands farther out; light reflected inside of it comes later than depth 3.
            let share = |seed| {
                let shot = caustic_photons(&scene, 20_000, seed, 3);
                let inside = |p: &crate::photon::Photon| {
                    let at = scene.to_scene.to_world(Vec3::from_array(p.position));
                    at.x.hypot(at.y) <= radius
                };
                let power: f64 = shot.photons.iter().filter(|p| inside(p)).map(|p| p.unpack().power.g as f64).sum();
                power / (PI * scene.to_scene.scale.powi(2))
            };
            Outcome::estimates(truth, (1..=seeds).map(share))
        })
        .statistical(0.05);
        items.push(if radius == 0.4 { check } else { check.slow() }.into());
    }
    // A picture of the spot at Z = 3, from 45° aside: a rectangle 1 × √2.
    let (a, b) = (0.5 * 2f64.sqrt(), 0.5);
    let inside = |x: f64| {
        let steps = 64;
        let hit = |i: usize| {
            let (sin, cos) = (TAU * (i as f64 + 0.5) / steps as f64).sin_cos();
            (x * cos).abs() <= a && (x * sin).abs() <= b
        };
        (0..steps).filter(|&i| hit(i)).count() as f64 / steps as f64
    };
    let power = PI * over_ball(3.0, |x, weight| if x.abs() < a.hypot(b) { weight * inside(x.abs()) } else { 0.0 });
    let camera = parallel_camera([2.0, 0.0, -1.0], [0.0, 0.0, -3.0], 0.5, 8);
    let xml = ball_scene(3.0, &camera, &diffuse(1.0));
    items.push(
        Probe::new("spot at Z = 3", xml, power / (4.0 * a * b) / PI, Light::POINT_CAUSTIC)
            .photons(20_000)
            .spp(64)
            .relative(0.1)
            .bias(0.02)
            .fast()
            .into(),
    );
    items
}

/// A surface of revolution about z with exact normals that point towards the axis.
fn revolved(rows: u32, columns: u32, profile: impl Fn(f64) -> (f64, f64, DVec3)) -> TriangleMesh {
    let (mut positions, mut normals, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..=rows {
        // The profile gives radius, height and the normal in the plane y = 0.
        let (r, z, n) = profile(i as f64 / rows as f64);
        for j in 0..columns {
            let (sin, cos) = (TAU * j as f64 / columns as f64).sin_cos();
            positions.push(DVec3::new(r * cos, r * sin, z).as_vec3());
            normals.push(DVec3::new(n.x * cos, n.x * sin, n.z).normalize().as_vec3());
        }
    }
    for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        let at = |i: u32, j: u32| i * columns + j % columns;
        indices.extend([[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]);
    }
    // Turn all faces to the side of the normals.
    for t in &mut indices {
        let [a, b, c] = t.map(|i: u32| positions[i as usize]);
        if (b - a).cross(c - a).dot(normals[t[0] as usize] + normals[t[2] as usize]) < 0.0 {
            t.swap(1, 2);
        }
    }
    TriangleMesh { positions: positions.into(), normals: Some(normals), indices, ..Default::default() }
}

fn mirrors() -> Vec<Item> {
    // Semi-axes 0.8 and 1: foci at ±0.6.
    let ellipsoid = || {
        revolved(500, 1000, |t| {
            let (sin, cos) = (PI * t).sin_cos();
            (0.8 * sin, cos, DVec3::new(-sin / 0.8, 0.0, -cos))
        })
    };
    let ellipse = Check::new("ellipsoid: power within 1e-4 of its length", "photons", move |accel, _| {
        let xml = scene(&[
            depth(-1),
            mesh("mirror.ply", &mirror()),
            sphere([0.0, 0.0, 0.6], 2e-4, &black()),
            point_light([0.0, 0.0, -0.6], 1.0),
        ]);
        let scene = own(&xml, &[("mirror.ply", ellipsoid())], accel);
        let shot = caustic_photons(&scene, 50_000, 1, 2);
        let stored: f64 = shot.photons.iter().map(|p| p.unpack().power.g as f64).sum();
        Outcome::exact(1.0, stored / shot.balance.emitted[1])
    });
    // Focal length ½: z = r²/2.
    let paraboloid = || revolved(300, 1000, |t| (t, 0.5 * t * t, DVec3::new(-t, 0.0, 1.0)));
    let parabola = Check::new("paraboloid: power within 1e-4 of its width", "photons", move |accel, seeds| {
        let xml = scene(&[
            depth(-1),
            mesh("mirror.ply", &mirror()),
            sphere([0.0, 0.0, 0.5], 2e-4, &black()),
            sun([0.0, 0.0, -1.0], 1.0),
        ]);
        let scene = own(&xml, &[("mirror.ply", paraboloid())], accel);
        let share = |seed| {
            let shot = caustic_photons(&scene, 20_000, seed, 2);
            let power: f64 = shot.photons.iter().map(|p| p.unpack().power.g as f64).sum();
            power / (PI * scene.to_scene.scale.powi(2))
        };
        Outcome::estimates(1.0, (1..=seeds).map(share))
    });
    let mut items = vec![
        Item::from(ellipse.absolute(1e-3).slow().limit(60.0)),
        Item::from(parabola.statistical(0.005).slow().limit(60.0)),
    ];
    // A ray at distance b from the axis of a hollow cylinder of radius 1 meets the diameter along it at 1/(2 cos θ), with
    // sin θ = b: at ½ for small b, the cusp of the nephroid.
    for b in [1e-3, 0.1, 0.5, 0.9f64] {
        let check = Check::new(format!("cylinder, b = {b}"), "trace", move |accel, _| {
            let wall = r#"<shape type="cylinder"><point name="p0" x="0" y="0" z="-1"/><point name="p1" x="0" y="0" z="1"/><boolean name="flip_normals" value="true"/><bsdf type="conductor"/></shape>"#;
            let scene = own(&scene(&[depth(-1), wall.into()]), &[], accel);
            let out = follow(&scene, DVec3::new(0.0, b, 0.0), DVec3::X, &[Turn::Reflect]);
            let x = out.map_or(f64::NAN, |(p, d)| p.x - p.y / d.y * d.x);
            Outcome::exact(0.5 / b.asin().cos(), x)
        });
        items.push(check.absolute(2e-6 / b.min(0.1)).into());
    }
    items
}

/// In a cube the absolute components of a direction never change, so that a direction within θc of an axis gets out sooner
/// or later and every other stays: six cones of solid angle 2π(1 − cos θc), disjoint since n > √2, over 4π.
fn cube() -> Vec<Item> {
    let truth = 3.0 * (1.0 - (1.0f64 - 1.0 / 2.25).sqrt());
    let of = |paths: u64, what: &'static str| {
        let share = move |scene: &Scene, seed: u64| {
            let walk = WalkSettings { max_depth: None, rr_depth: 5, sequence: Sequence::Independent };
            let settings =
                ShootSettings { seed, pass: 0, target: Target::Global, walk, photons: 1, max_paths: 1, guided: false };
            let shot = shoot_paths(scene, &settings, &Emission::unaimed(paths));
            let b = shot.balance;
            let part = if what == "escaped" { b.escaped[1] } else { b.roulette[1] };
            part / b.emitted[1]
        };
        let truth = if what == "escaped" { truth } else { 1.0 - truth };
        Check::new(format!("{what}, {paths} paths a seed"), "photons", move |accel, seeds| {
            let xml = scene(&[depth(-1), cuboid([0.0; 3], [1.0; 3], &glass(1.5)), point_light([0.2, 0.3, -0.1], 1.0)]);
            let scene = own(&xml, &[], accel);
            use rayon::prelude::*;
            let shares: Vec<f64> = (1..=seeds).into_par_iter().map(|seed| share(&scene, seed)).collect();
            Outcome::estimates(truth, shares)
        })
        .statistical(0.1)
        .limit(60.0)
    };
    vec![
        of(16, "escaped").into(),
        of(256, "escaped").statistical(0.03).slow().into(),
        of(256, "ended by roulette").slow().into(),
    ]
}
