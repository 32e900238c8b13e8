//! Overlapping dielectrics with priorities.

use super::super::case::{Case, Check, Item, Outcome};
use super::super::methods::Light;
use super::super::optics::fresnel;
use super::super::probe::{Probe, load, mean, render_once};
use super::super::xml::*;
use std::f64::consts::PI;

pub fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "nested-stack",
            about: "slabs of glass, water and ice that overlap: transmittance of the stack",
            items: stacks,
        },
        Case {
            name: "nested-dielectrics",
            about: "water that reaches into its glass, against the interfaces modelled one by one",
            items: vessels,
        },
    ]
}

const GLASS: f64 = 1.5;
const WATER: f64 = 1.33;
const ICE: f64 = 1.31;

/// Transmittance of plane interfaces between media of these indices, for light that comes at cosine `c` in the first.
///
/// Without loss and coherence, two layers one behind the other have `T = T₁T₂ Σ (R₁R₂)ᵏ = T₁T₂/(1 − R₁R₂)` with
/// `R = 1 − T`, hence `1/T − 1 = (1/T₁ − 1) + (1/T₂ − 1)`: the ratios R/T of the interfaces add up. The renderer knows no
/// polarisation, so R is that of unpolarised light at each interface. Behind an interface Snell's law gives
/// `c' = √(1 − (n/n')² (1 − c²))`.
fn stack(indices: &[f64], mut c: f64) -> f64 {
    let mut sum = 0.0;
    for pair in indices.windows(2) {
        let n = pair[1] / pair[0];
        let r = fresnel(n, c);
        sum += r / (1.0 - r);
        c = (1.0 - (1.0 - c * c) / (n * n)).sqrt();
    }
    1.0 / (1.0 + sum)
}

/// From above: air, glass down to 0, water down to −0.06, ice down to −0.2, air. The water begins within the glass and
/// ends within the ice; both are stronger.
fn stacks() -> Vec<Item> {
    let of = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let layer = |top: f64, bottom: f64, half: f64, inside: String| {
            cuboid([0.0, 0.0, 0.5 * (top + bottom)], [half, half, 0.5 * (top - bottom)], &inside)
        };
        let xml = scene(&[
            depth(-1),
            parallel_camera([4.0 * sin, 0.0, 4.0 * cos], [0.0; 3], 1e-3, 4),
            layer(0.1, 0.0, 60.0, filling(GLASS, 3)),
            layer(0.05, -0.1, 61.0, filling(WATER, -1)),
            layer(-0.06, -0.2, 62.0, filling(ICE, 2)),
            square([0.0, 0.0, -0.5], 80.0, [0.0, 0.0, 1.0], &lamp(1.0)),
        ]);
        let truth = stack(&[1.0, GLASS, WATER, ICE, 1.0], cos);
        Probe::new(format!("air, glass, water, ice, {degrees}°"), xml, truth, Light::MIRRORED)
            .photons(20)
            .spp(256)
            .relative(0.01)
    };
    vec![of(0.0).into(), of(30.0).into(), of(60.0).fast().once().into(), of(80.0).relative(0.02).into()]
}

/// A room with a lamp, or one that is all lamp.
fn room(inside: &str) -> String {
    cuboid([0.0; 3], [1.0; 3], &format!(r#"<boolean name="flip_normals" value="true"/>{inside}"#))
}

/// A glass bowl full of water with a ball in it: a wall from 0.5 to 0.6, and water up to 0.55. A second ball of water within
/// the water is nothing at all.
fn overlapping() -> String {
    [
        sphere([0.0; 3], 0.6, &filling(GLASS, 2)),
        hollow([0.0; 3], 0.5, &filling(GLASS, 2)),
        sphere([0.0; 3], 0.55, &filling(WATER, 1)),
        sphere([-0.1, 0.0, 0.0], 0.25, &filling(WATER, 1)),
        ball(),
    ]
    .concat()
}

/// The same, with the interfaces modelled: glass against air, water against glass.
fn modelled() -> String {
    [sphere([0.0; 3], 0.6, &glass(GLASS)), sphere([0.0; 3], 0.5, &interface(WATER, GLASS)), ball()].concat()
}

fn ball() -> String {
    sphere([0.3, 0.0, 0.0], 0.1, &diffuse(0.8))
}

fn vessels() -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    // In a room whose walls send 1 in all directions a point of index n has n² everywhere, whatever surrounds it: radiance
    // over n² is the same along a ray, and what is reflected comes from where it is the same.
    let furnace = room(&(diffuse(0.5) + &emits(0.5)));
    let light = Light::SEEN | Light::DIRECT | Light::INDIRECT | Light::MIRRORED | Light::BEHIND_GLASS | Light::CAUSTIC;
    let vessel = overlapping().replace(&ball(), "");
    for (what, origin, truth) in [
        ("furnace, camera in the water", [-0.2, 0.1, 0.0], WATER * WATER),
        ("furnace, camera in the glass", [-0.52, 0.0, 0.0], GLASS * GLASS),
        ("furnace, camera outside", [-0.9, 0.1, 0.2], 1.0),
    ] {
        let xml = scene(&[depth(-1), camera(origin, [1.0, 0.1, 0.0], 60.0, (8, 8)), furnace.clone(), vessel.clone()]);
        let probe = Probe::new(what, xml, truth, light).spp(32).bias(0.025);
        items.push(if truth == 1.0 { probe.fast().once().into() } else { probe.into() });
    }
    // The same walks through both models differ by roundings alone.
    let lit = || room(&diffuse(0.7)) + &square([0.0, 0.0, 0.99], 0.4, [0.0, 0.0, -1.0], &lamp(5.0));
    let outside = || camera([-0.9, 0.1, 0.2], [0.0; 3], 80.0, (16, 16));
    let in_water = || camera([-0.2, 0.1, 0.1], [0.3, 0.0, 0.0], 90.0, (16, 16));
    let inner_light = || room(&diffuse(0.7)) + &point_light([-0.1, 0.05, 0.1], PI);
    let scenes: [(&str, &[&str], String); 4] = [
        ("bowl against modelled", &["path", "photonmapper", "sppm", "bdpt", "vcm", "ptracer"], lit() + &outside()),
        ("camera in the water", &["path", "photonmapper", "sppm", "bdpt", "vcm", "ptracer"], lit() + &in_water()),
        ("light in the water", &["photonmapper", "sppm", "vcm"], inner_light() + &outside()),
        (
            "camera and light in the water",
            &["direct", "path", "photonmapper", "sppm", "bdpt", "vcm", "ptracer"],
            inner_light() + &in_water(),
        ),
    ];
    for (what, methods, common) in scenes {
        for &method in methods {
            let of = |vessel: String| scene(&[unguided(method), common.clone(), vessel]);
            items.push(same_picture(what, method, of(overlapping()), of(modelled())));
        }
    }
    items
}

/// An integrator whose light paths start where their numbers say. A pilot that sees a single walk go another way, as roundings
/// send it, would let all of them start elsewhere.
fn unguided(method: &str) -> String {
    match method {
        "bdpt" | "vcm" | "ptracer" => format!(
            r#"<integrator type="{method}"><integer name="max_depth" value="-1"/>
            <boolean name="guided_emission" value="false"/></integrator>"#
        ),
        _ => depth(-1),
    }
}

/// The mean of one scene over that of another, seed by seed.
fn same_picture(what: &'static str, method: &'static str, nested: String, explicit: String) -> Item {
    let check = Check::new(format!("{what}, {method}"), method, move |accel, seeds| {
        let scenes = [&nested, &explicit].map(|xml| load(xml, &[], accel).expect("the program's own scene"));
        // Where roundings change which photons are found, four seeds know their own spread badly.
        let seeds = if method == "photonmapper" { seeds.max(2) } else { seeds.clamp(2, 4) };
        let ratios = (1..=seeds).map(|seed| {
            let spp = if method == "sppm" { 2 } else { 16 };
            let [a, b] = [0, 1].map(|i| mean(&render_once(&scenes[i], method, spp, 3000, seed, None).image));
            a / b
        });
        Outcome::estimates(1.0, ratios)
    })
    .statistical(0.005)
    .once();
    // Density estimates take their time.
    if matches!(method, "photonmapper" | "sppm") { check.slow().into() } else { check.into() }
}
