//! Closed rooms in which every point and direction has the same radiance.

use super::super::case::{Case, Item};
use super::super::methods::Light;
use super::super::probe::Probe;
use super::super::xml::*;
use std::f64::consts::PI;

pub fn cases() -> Vec<Case> {
    vec![
        Case { name: "furnace", about: "closed sphere of one albedo and emission: L = Le/(1 − ρ)", items: furnace },
        Case {
            name: "furnace-depth", about: "the same with at most n edges: L = Le (1 − ρⁿ)/(1 − ρ)", items: depths
        },
        Case {
            name: "furnace-objects",
            about: "lossless objects in a furnace change nothing; inside glass L = n²·Le",
            items: objects,
        },
        Case {
            name: "integrating-sphere",
            about: "any light in a sphere: indirect E = Φ/(4πR²) · ρ/(1 − ρ(1 − f))",
            items: integrating,
        },
        Case {
            name: "mirror-box", about: "two plates between mirrors: B₁ = E/(1 − ρ₁ρ₂), B₂ = ρ₂B₁", items: plates
        },
    ]
}

/// Methods that connect all vertices of two paths: the square of a path's length, 10⁶ connections at ρ = 0.999.
const CONNECTING: &[&str] = &["bdpt", "vcm"];

/// Methods for which a million bounces are too many: those, and the ones that shoot all their photons anew for each pass
/// or, as `ptracer`, eight paths for each sample.
const WITHOUT_MILLIONS: &[&str] = &["bdpt", "vcm", "ppm", "sppm", "ptracer"];

/// Everything that a closed diffuse room sends.
const ROOM: Light = Light::SEEN;

fn room(rho: f64, emission: f64) -> String {
    hollow([0.0; 3], 1.0, &(diffuse(rho) + &emits(emission)))
}

fn inside(pixels: u32) -> String {
    camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, (pixels, pixels))
}

/// `L = Le + ρ·L`, since the radiance arriving from every direction is L.
fn furnace() -> Vec<Item> {
    // The number of bounces is geometric: one path's relative deviation is almost 1, and a photon path is as correlated.
    let of = |rho: f64, pixels: u32, spp: u64, photons: u64| {
        let emission = 1.0 - rho;
        Probe::new(
            format!("ρ = {rho}"),
            scene(&[depth(-1), inside(pixels), room(rho, emission)]),
            1.0,
            ROOM | Light::DIRECT | Light::INDIRECT,
        )
        .spp(spp)
        .photons(photons)
    };
    vec![
        of(0.0, 8, 4, 1_000).fast().into(),
        of(0.5, 8, 16, 5_000).fast().into(),
        of(0.9, 8, 64, 20_000).relative(0.02).fast().into(),
        of(0.99, 8, 32, 60_000).relative(0.05).except(CONNECTING).into(),
        of(0.99, 8, 4, 100).relative(0.05).only(CONNECTING).into(),
        of(0.999, 8, 8, 100_000).relative(0.1).limit(120.0).except(CONNECTING).into(),
        of(0.999, 4, 1, 100).relative(0.1).limit(120.0).only(&["bdpt"]).into(),
        // A million bounces each: a few paths, and time rather than digits.
        of(0.999999, 2, 1, 200_000).relative(0.6).limit(240.0).except(WITHOUT_MILLIONS).into(),
        of(0.999999, 1, 1, 1).relative(0.6).limit(240.0).only(&["ptracer"]).into(),
        of(0.999999, 2, 1, 8).relative(0.6).limit(240.0).only(&["sppm"]).into(),
    ]
}

/// The first n terms of `Σ Le ρᵏ`; with ρ = 1 all terms are Le, with ρ = 0.999 a cap of 1000 edges loses 36.8 %.
fn depths() -> Vec<Item> {
    let of = |rho: f64, n: i32| {
        let truth: f64 = (0..n).map(|k| rho.powi(k)).sum();
        let light = match n {
            1 => ROOM,
            2 => ROOM | Light::DIRECT,
            _ => ROOM | Light::DIRECT | Light::INDIRECT,
        };
        let xml = scene(&[depth(n.into()), inside(8), room(rho, 1.0)]);
        Probe::new(format!("ρ = {rho}, n = {n}"), xml, truth, light).spp(16).relative(0.01)
    };
    let mut items: Vec<Item> = Vec::new();
    for (rho, n) in [(0.5, 1), (0.5, 2), (0.5, 4), (0.9, 2), (0.9, 4), (1.0, 1), (1.0, 3), (1.0, 8)] {
        let probe = of(rho, n);
        // `direct` has no depth: it always adds one bounce.
        let probe = if n == 1 { probe.except(&["direct"]) } else { probe };
        items.push(if n <= 4 { probe.fast() } else { probe }.into());
    }
    items.push(of(0.999, 1000).spp(2).photons(100_000).relative(0.1).limit(120.0).except(CONNECTING).into());
    items.push(Item::from(
        // No emission and no loss: nothing to see, and nothing may go on for ever.
        Probe::new(
            "ρ = 1, dark, no cap: ends",
            scene(&[depth(-1), inside(2), hollow([0.0; 3], 1.0, &diffuse(1.0))]),
            0.0,
            Light::INDIRECT,
        )
        .spp(1)
        .photons(1000),
    ));
    items
}

/// Radiance is the same in all directions at all points of the room; a lossless object only permutes rays. In a dielectric,
/// L/n² is conserved along rays.
fn objects() -> Vec<Item> {
    let light = ROOM | Light::DIRECT | Light::INDIRECT | Light::CAUSTIC;
    let seen = light | Light::MIRRORED | Light::BEHIND_GLASS;
    let view = || camera([-0.6, 0.0, 0.0], [0.2, 0.0, 0.0], 70.0, (8, 8));
    let of = |what: String, object: String, light: Light| {
        Probe::new(what, scene(&[depth(-1), view(), room(0.5, 0.5), object]), 1.0, light).spp(32).relative(0.01)
    };
    let ball = |inside: &str| sphere([0.25, 0.0, 0.0], 0.4, inside);
    let mut items: Vec<Item> = vec![
        of("white ball".into(), ball(&diffuse(1.0)), light).fast().into(),
        of("mirror ball".into(), ball(&mirror()), seen).fast().into(),
    ];
    for n in [1.0, 1.0 - 1e-7, 1.0 + 1e-7, 1.0003, 1.5, 4.0, 1000.0] {
        let probe = of(format!("glass ball, n = {n}"), ball(&glass(n)), seen);
        items.push(if n == 1.5 { probe.fast() } else { probe }.into());
    }
    for n in [1.0, 1.5, 2.42] {
        // From the middle of the ball no ray is beyond the critical angle.
        let xml = scene(&[
            depth(-1),
            camera([0.25, 0.0, 0.0], [0.9, 0.1, 0.0], 80.0, (8, 8)),
            room(0.5, 0.5),
            ball(&glass(n)),
        ]);
        let probe = Probe::new(format!("camera in glass, n = {n}"), xml, n * n, seen).spp(32);
        items.push(if n == 1.5 { probe.fast() } else { probe }.into());
    }
    items
}

/// Light that has been scattered once has the same irradiance everywhere in a sphere: from any point to any other the form
/// factor is dA/(4πR²). With direct E = Φ/(4πR²) the sum is `Φ/(4πR²)/(1 − ρ(1 − f))`, where f is the share of the wall
/// that absorbs. A black disc stands for the cap behind it: it stops exactly the rays that would have reached the cap.
fn integrating() -> Vec<Item> {
    let light = Light::DIRECT | Light::INDIRECT;
    // A point light in the middle, of intensity π: E = π, and L = ρ/π · π/(1 − ρ) without a port.
    let of = |rho: f64, spp: u64, photons: u64| {
        let xml = scene(&[
            depth(-1),
            inside(8),
            hollow([0.0; 3], 1.0, &diffuse(rho)),
            point_light([0.0; 3], PI * (1.0 - rho)),
        ]);
        Probe::new(format!("ρ = {rho}, point light"), xml, rho, light).spp(spp).photons(photons)
    };
    let mut items: Vec<Item> = vec![
        of(0.5, 16, 5_000).fast().into(),
        of(0.9, 32, 50_000).relative(0.02).into(),
        of(0.99, 32, 60_000).relative(0.05).except(CONNECTING).into(),
        of(0.99, 4, 100).relative(0.05).only(CONNECTING).into(),
        of(0.999, 8, 100_000).relative(0.1).limit(120.0).except(CONNECTING).into(),
        of(0.9999, 1, 1_000_000).relative(0.4).limit(200.0).except(WITHOUT_MILLIONS).into(),
        of(0.9999, 1, 400).relative(0.4).limit(200.0).only(&["sppm"]).into(),
    ];
    // A light elsewhere: at one point of the wall E = I cos θ/d² more.
    let (rho, at, seen): (f64, V3, V3) = (0.8, [0.5, 0.0, 0.0], [-0.6, 0.0, -0.8]);
    let to = [at[0] - seen[0], at[1] - seen[1], at[2] - seen[2]];
    let d_sq = to[0] * to[0] + to[1] * to[1] + to[2] * to[2];
    // The inner normal at a point of the unit sphere is minus that point.
    let cos = -(to[0] * seen[0] + to[1] * seen[1] + to[2] * seen[2]) / d_sq.sqrt();
    let direct = cos / d_sq;
    let indirect = rho / (1.0 - rho);
    // So small a view meets few photons of a pass within the radius that its pixels would choose.
    let wide = progressive(&[("float", "initial_radius", "0.25".into())]);
    let progressive_only: &[&str] = &["ppm", "sppm"];
    for (name, integrator) in [("", depth(-1)), (", r = 0.25", wide)] {
        let xml = scene(&[
            integrator,
            camera([-0.3, 0.0, -0.4], seen, 0.5, (2, 2)),
            hollow([0.0; 3], 1.0, &diffuse(rho)),
            point_light(at, PI),
        ]);
        let probe = Probe::new(format!("ρ = {rho}, light off centre{name}"), xml, rho * (direct + indirect), light)
            .spp(256)
            .photons(10_000)
            .relative(0.02)
            .fast();
        items.push(match name {
            // The view is also too small to be hit.
            "" => probe.except(&["ptracer", "ppm", "sppm"]).into(),
            _ => probe.only(progressive_only).into(),
        });
    }
    // A port of 10 % of the wall.
    for (rho, f) in [(0.9, 0.1), (0.9, 0.01)] {
        // The cap of share f reaches down to z = 1 − 2f.
        let z = 1.0 - 2.0 * f;
        let xml = scene(&[
            depth(-1),
            camera([0.0, 0.0, 0.5], [0.0, 0.0, -1.0], 60.0, (8, 8)),
            hollow([0.0; 3], 1.0, &diffuse(rho)),
            disc([0.0, 0.0, z], (1.0 - z * z).sqrt(), false, &black()),
            point_light([0.0; 3], PI),
        ]);
        let truth = rho / (1.0 - rho * (1.0 - f));
        items.push(
            Probe::new(format!("ρ = {rho}, port f = {f}"), xml, truth, light)
                .spp(64)
                .photons(20_000)
                .bias(0.01)
                .relative(0.02)
                .into(),
        );
    }
    // Glass around the light, concentric: every ray meets it at right angles and no power is lost.
    let xml = scene(&[
        depth(-1),
        camera([0.0, 0.0, 0.5], [0.0, 0.0, 1.0], 60.0, (8, 8)),
        hollow([0.0; 3], 1.0, &diffuse(0.5)),
        sphere([0.0; 3], 0.3, &glass(1.5)),
        point_light([0.0; 3], PI),
    ]);
    items.push(
        Probe::new("ρ = 0.5, light in a glass ball", xml, 1.0, Light::POINT_CAUSTIC | Light::INDIRECT)
            .spp(16)
            .photons(10_000)
            .bias(0.01)
            .relative(0.02)
            .fast()
            .into(),
    );
    items
}

/// Perfect mirrors make two squares infinite: `B₁ = E + ρ₁B₂`, `B₂ = ρ₂B₁` with E = π, so that L₁ = 1/(1 − ρ₁ρ₂).
fn plates() -> Vec<Item> {
    let (r1, r2) = (0.5, 0.8);
    let l1 = 1.0 / (1.0 - r1 * r2);
    let walls: String = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
        .into_iter()
        .map(|n: V3| square([-n[0], -n[1], -n[2]], 1.0, n, &mirror()))
        .collect();
    let plates = square([0.0, 0.0, -1.0], 1.0, [0.0, 0.0, 1.0], &(diffuse(r1) + &emits(1.0)))
        + &square([0.0, 0.0, 1.0], 1.0, [0.0, 0.0, -1.0], &diffuse(r2));
    let light = Light::DIRECT | Light::INDIRECT | Light::CAUSTIC;
    let of = |what: &str, up: bool, fov: f64, pixels: u32, light: Light| {
        let (target, truth) = if up { ([0.0, 0.0, 1.0], r2 * l1) } else { ([0.0, 0.0, -1.0], l1) };
        let xml = scene(&[depth(-1), camera([0.0; 3], target, fov, (pixels, pixels)), walls.clone(), plates.clone()]);
        let spp = (2048 / u64::from(pixels * pixels)).max(1);
        Probe::new(what, xml, truth, light).spp(spp).photons(10_000).relative(0.015).bias(0.01)
    };
    let mirrored = light | Light::BEHIND_GLASS | Light::MIRRORED | Light::SEEN;
    let mut items: Vec<Item> = vec![
        of("lower plate", false, 60.0, 8, light | Light::SEEN).fast().into(),
        of("upper plate", true, 60.0, 8, light).fast().into(),
    ];
    // Here the rims are in view. Without probes for where surfaces end, estimates have the discs that reach beyond them as
    // their bias: small ones are asked for, from more photons or smaller pixels.
    for (what, up) in [("lower plate and mirrors", false), ("upper plate and mirrors", true)] {
        let of = |pixels| of(what, up, 120.0, pixels, mirrored);
        items.push(of(8).except(&["photonmapper", "vcm"]).into());
        items.push(of(8).photons(40_000).relative(0.02).bias(0.02).only(&["photonmapper"]).into());
        items.push(of(128).relative(0.02).bias(0.02).only(&["vcm"]).into());
    }
    items
}
