//! Direct light between simple shapes: form factors.

use super::super::case::{Case, Check, Item, Outcome};
use super::super::methods::Light;
use super::super::optics::*;
use super::super::probe::{Probe, load};
use super::super::xml::*;
use crate::accel::AccelKind;
use crate::color::Rgb;
use crate::gather::{AreaSettings, LookupSettings, PhotonMaps};
use crate::geometry::{Ray, TriangleMesh};
use crate::math::{DVec3, Vec3};
use crate::photon::{Kernel, PhotonMap};
use crate::sample::Sequence;
use crate::shoot::{ShootSettings, Target, WalkSettings, shoot};
use crate::tally::Counters;

pub fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "sphere-light",
            about: "sphere light of radius R at distance d: E = πL(R/d)² cos θ",
            items: spheres,
        },
        Case {
            name: "square-light",
            about: "unit square light above a point: E = πL · 0.239456470",
            items: square_above,
        },
        Case {
            name: "squares",
            about: "form factors of parallel and perpendicular squares, and a closed cube",
            items: squares,
        },
        Case { name: "discs", about: "form factors of coaxial discs and concentric spheres", items: discs },
        Case {
            name: "shading-normals",
            about: "bent normals reflect the same from lights and from cameras",
            items: bent,
        },
        Case { name: "grazing-sun", about: "sun at 0.05° and less above a plain: E = E₀ sin h", items: grazing },
    ]
}

/// A white floor seen from above through parallel rays; its radiance is E/π.
fn floor(half: f64) -> String {
    square([0.0; 3], half, [0.0, 0.0, 1.0], &diffuse(1.0))
}

/// The view is too small for paths from lights to hit it.
const NARROW: &[&str] = &["ptracer"];

fn spheres() -> Vec<Item> {
    let of = |ratio: f64, degrees: f64| {
        // L so that E = π cos θ.
        let (sin, cos) = degrees.to_radians().sin_cos();
        let truth = cos;
        // The camera looks at the point below the sphere from within the gap.
        let gap = cos - ratio;
        let eye = if degrees == 0.0 { [0.0, 0.0, 0.5 * gap.min(0.1)] } else { [0.0, 0.0, 0.05] };
        let view = 1e-3 * gap.min(0.1);
        let xml = scene(&[
            depth(-1),
            parallel_camera(eye, [0.0; 3], view, 4),
            floor(0.2),
            sphere([sin, 0.0, cos], ratio, &lamp(ratio.powi(-2))),
        ]);
        Probe::new(format!("R/d = {ratio:e}, θ = {degrees}°"), xml, truth, Light::DIRECT)
            .except(NARROW)
            .spp(16)
            .photons(200)
            .relative(0.005)
    };
    let mut items: Vec<Item> = Vec::new();
    for ratio in [1e-6, 1e-4, 1e-3, 0.1, 0.5, 0.9, 0.999] {
        let probe = of(ratio, 0.0);
        items.push(if [1e-6, 0.5].contains(&ratio) { probe.fast() } else { probe }.into());
    }
    for (ratio, degrees) in [(1e-6, 60.0), (0.3, 60.0), (0.1, 80.0), (1e-4, 89.0)] {
        items.push(of(ratio, degrees).into());
    }
    items
}

/// Four corner factors of squares ½ × ½.
fn square_above() -> Vec<Item> {
    let truth = 4.0 * corner_factor(0.5, 0.5, 1.0);
    let of = |what: &str, scale: f64, offset: V3| {
        let at = |z: f64| [offset[0], offset[1], offset[2] + z * scale];
        let xml = scene(&[
            depth(-1),
            parallel_camera(at(0.5), at(0.0), 1e-3 * scale, 4),
            square(at(0.0), 0.1 * scale, [0.0, 0.0, 1.0], &diffuse(1.0)),
            square(at(1.0), 0.5 * scale, [0.0, 0.0, -1.0], &lamp(1.0)),
        ]);
        Probe::new(what, xml, truth, Light::DIRECT).except(NARROW).photons(200).relative(0.005)
    };
    vec![
        of("1 m", 1.0, [0.0; 3]).fast().into(),
        of("1e-9 m", 1e-9, [0.0; 3]).into(),
        of("1e9 m", 1e9, [0.0; 3]).into(),
        of("1 m, 1e3 m away", 1.0, [1e3, -1e3, 1e3]).into(),
        of("1 m, 1e7 m away", 1.0, [1e7, -1e7, 1e7]).fast().into(),
    ]
}

/// A square of radiance 1 lights another: the mean radiance of a white one is the form factor from it to the light.
fn squares() -> Vec<Item> {
    let parallel = |x: f64| {
        let xml = scene(&[
            depth(-1),
            parallel_camera([0.0, 0.0, 0.5], [0.0; 3], 0.5 * x, 8),
            square([0.0; 3], 0.5 * x, [0.0, 0.0, 1.0], &diffuse(1.0)),
            square([0.0, 0.0, 1.0], 0.5 * x, [0.0, 0.0, -1.0], &lamp(1.0)),
        ]);
        Probe::new(format!("parallel, X = Y = {x}"), xml, parallel_factor(x, x), Light::DIRECT)
            .spp(64)
            .photons(200)
            .relative(0.005)
    };
    let floor_of_cube = || square([0.0; 3], 0.5, [0.0, 0.0, 1.0], &diffuse(1.0));
    let wall = |n: V3| square([-0.5 * n[0], -0.5 * n[1], 0.5], 0.5, n, &lamp(1.0));
    let view = || parallel_camera([0.0, 0.0, 0.5], [0.0; 3], 0.5, 8);
    let perpendicular = scene(&[depth(-1), view(), floor_of_cube(), wall([1.0, 0.0, 0.0])]);
    let closed = scene(&[
        depth(-1),
        view(),
        floor_of_cube(),
        wall([1.0, 0.0, 0.0]),
        wall([-1.0, 0.0, 0.0]),
        wall([0.0, 1.0, 0.0]),
        wall([0.0, -1.0, 0.0]),
        square([0.0, 0.0, 1.0], 0.5, [0.0, 0.0, -1.0], &lamp(1.0)),
    ]);
    vec![
        parallel(1.0).fast().into(),
        parallel(10.0).into(),
        // One path of light in 30 000 meets the other square.
        parallel(0.01).except(&["ptracer"]).into(),
        Probe::new("perpendicular", perpendicular, perpendicular_factor(), Light::DIRECT)
            .spp(64)
            .photons(200)
            .relative(0.01)
            .fast()
            .into(),
        // F∥ + 4 F⊥ = 1.
        Probe::new("cube of five lights", closed, 1.0, Light::DIRECT).spp(64).photons(200).relative(0.005).into(),
    ]
}

fn discs() -> Vec<Item> {
    let coaxial = scene(&[
        depth(-1),
        parallel_camera([0.0, 0.0, 0.5], [0.0; 3], 1.0, 16),
        disc([0.0; 3], 1.0, true, &diffuse(1.0)),
        disc([0.0, 0.0, 1.0], 1.0, false, &lamp(1.0)),
    ]);
    // The disc fills π/4 of the picture; its rim is sampled like everything else.
    let truth = std::f64::consts::FRAC_PI_4 * disc_factor(1.0, 1.0, 1.0);
    // Seen from between the spheres: E at the outer one is π(R₁/R₂)², and what it sends back to itself is its F₂₂ = 1 − F₂₁.
    let spheres = |rho: f64, ratio: f64| {
        let xml = scene(&[
            depth(-1),
            camera([0.0, 0.0, 0.5 * (1.0 + ratio)], [0.0, 0.0, 1.0], 60.0, (8, 8)),
            hollow([0.0; 3], 1.0, &diffuse(rho)),
            sphere([0.0; 3], ratio, &lamp(1.0)),
        ]);
        let f21 = ratio * ratio;
        let truth = rho * f21 / (1.0 - rho * (1.0 - f21));
        Probe::new(format!("spheres, R₁/R₂ = {ratio}, ρ = {rho}"), xml, truth, Light::DIRECT | Light::INDIRECT)
            .spp(64)
            .photons(20_000)
    };
    vec![
        Probe::new("coaxial, r = h", coaxial, truth, Light::DIRECT).spp(64).photons(200).relative(0.005).fast().into(),
        spheres(0.5, 0.5).fast().into(),
        spheres(0.5, 0.01).into(),
        spheres(0.9, 0.9).relative(0.02).into(),
    ]
}

/// A parallel beam at elevation h lights a plain with E₀ sin h.
fn grazing() -> Vec<Item> {
    let of = |degrees: f64| {
        let h = degrees.to_radians();
        let xml = scene(&[
            depth(-1),
            parallel_camera([0.0, 0.0, 0.5], [0.0; 3], 0.5, 4),
            floor(1.0),
            sun([h.cos(), 0.0, -h.sin()], std::f64::consts::PI / h.sin()),
        ]);
        Probe::new(format!("h = {degrees}°"), xml, 1.0, Light::DIRECT).photons(200).relative(1e-4)
    };
    // A path from the sun meets the floor once in 10³ times and more: never, for light tracing.
    let exact: &[&str] = &["ptracer", "bdpt", "vcm"];
    // Bidirectional methods leave these paths a share of the light that grows with their number, 0.17 sin h here. It takes a
    // quarter of a million paths until some of them are found; what is lower is left out.
    let shared: &[&str] = &["bdpt", "vcm"];
    let mut items: Vec<Item> = Vec::new();
    for degrees in [1.0f64, 0.05, 0.001, 0.0001] {
        let (all, some) = (of(degrees).except(exact), of(degrees).only(shared));
        let some = if degrees < 0.05 {
            some.absolute(0.2 * degrees.to_radians().sin())
        } else {
            some.spp(1024).relative(1e-3)
        };
        items.extend(if degrees == 0.05 { [all.fast(), some.fast().once()] } else { [all, some] }.map(Item::from));
    }
    // Photons of the sun itself, on a floor turned so that the bytes of their direction all point below it: the centre of
    // the byte's step of 0.7° around 109.95° is 110.04°, the floor's own horizon is at 110°.
    let blend = r#"<bsdf type="blendbsdf"><float name="weight" value="0.5"/><bsdf type="diffuse"><rgb name="reflectance" value="0.4"/></bsdf><bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></bsdf>"#;
    for (name, bsdf) in [("plain", diffuse(0.5)), ("blended", blend.to_owned())] {
        let check =
            Check::new(format!("map of photons, h = 0.05°, {name} floor"), "photon map", move |accel, seeds| {
                Outcome::estimates(1.0, (1..=seeds).map(|seed| radiance_from_map(accel, &bsdf, 0.05, seed)))
            })
            .statistical(0.05);
        // The plain one does not look at directions.
        items.push(if name == "plain" { check.slow() } else { check }.into());
    }
    items
}

/// The density estimate of direct photons on a floor of albedo ½, leaning by 20° towards x, under a sun for which L = 1. Of
/// 800 photons 560 are read, within a radius of 0.94 of the floor's half side 1: a relative standard deviation of
/// √(4/3 / 560) = 0.05, and a quarter of it over 16 seeds.
fn radiance_from_map(accel: AccelKind, bsdf: &str, degrees: f64, seed: u64) -> f64 {
    let (h, lean) = (degrees.to_radians(), 20f64.to_radians());
    let normal = DVec3::new(lean.sin(), 0.0, lean.cos());
    let down = -(h.cos() * DVec3::new(lean.cos(), 0.0, -lean.sin()) + h.sin() * normal);
    let xml = scene(&[
        depth(-1),
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="20"/></transform>{bsdf}</shape>"#
        ),
        sun(down.to_array(), 2.0 * std::f64::consts::PI / h.sin()),
    ]);
    let scene = load(&xml, &[], accel).unwrap_or_else(|e| panic!("the program's own scene: {e}"));
    let walk = WalkSettings { max_depth: Some(1), rr_depth: 1, sequence: Sequence::Independent };
    let settings =
        ShootSettings { seed, pass: 0, target: Target::Global, walk, photons: 800, max_paths: 1 << 24, guided: false };
    let shot = shoot(&scene, &settings);
    let lookup = LookupSettings {
        global_size: 560,
        caustic_size: 560,
        global_radius: 0.69,
        caustic_radius: 0.69,
        kernel: Kernel::Epanechnikov,
        area: AreaSettings::default(),
    };
    let mut maps = PhotonMaps::default();
    maps.set_global(PhotonMap::build(shot.photons), &lookup, scene.bounding_sphere().1);
    let mut ray = Ray::new(scene.to_scene.point(0.5 * normal), -normal.as_vec3());
    let si = scene.intersect(&mut ray).expect("the floor is below");
    maps.global_radiance::<Rgb>(&si, &scene.bsdf(&si), &mut Counters::default()).radiance.g as f64
}

/// A floor whose shading normals lean by δ towards a wall, under a sun straight above. The floor sends
/// `L = ρ/π · E₀ cos δ` whichever way it is looked at, so that the wall has the radiance `ρ_wall L F⊥`. Paths from the sun
/// must carry |ωi·ns| |ωo·ng| / (|ωi·ng| |ωo·ns|) [Veach 1997, eq. 5.19] to find the same.
fn bent() -> Vec<Item> {
    let floor = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let corners = [(0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5)];
        let positions: Vec<Vec3> = corners.iter().map(|&(x, y)| Vec3::new(x, y, 0.0)).collect();
        let normals = vec![DVec3::new(-sin, 0.0, cos).as_vec3(); 4];
        let indices = vec![[0, 1, 2], [0, 2, 3]];
        TriangleMesh { positions: positions.into(), normals: Some(normals), indices, ..Default::default() }
    };
    [0.0, 30.0, 60.0]
        .into_iter()
        .map(|degrees: f64| {
            let xml = scene(&[
                depth(3),
                parallel_camera([0.5, 0.0, 0.5], [0.0, 0.0, 0.5], 0.5, 8),
                mesh("floor.ply", &diffuse(0.8)),
                square([0.0, 0.0, 0.5], 0.5, [1.0, 0.0, 0.0], &diffuse(1.0)),
                sun([0.0, 0.0, -1.0], std::f64::consts::PI),
            ]);
            let truth = 0.8 * degrees.to_radians().cos() * perpendicular_factor();
            let probe = Probe::new(format!("δ = {degrees}°"), xml, truth, Light::INDIRECT)
                .mesh("floor.ply", floor(degrees))
                .photons(if degrees == 60.0 { 120_000 } else { 60_000 })
                .spp(32)
                // Within a radius r of its sides the floor's estimate lacks what would lie beyond them: 0.17 r of the light
                // for each unit of a side under Epanechnikov's kernel, √2 times that where r reaches the k-th photon. The
                // wall sees the near side best, dF/dx = ½ of F⊥ = 0.2: 0.6 r there, about 0.7 r in all. The 60 nearest of
                // 4000 to 8000 photons lie within r = 0.05 to 0.07: 3.5 to 5 %.
                .bias(0.05)
                .relative(0.02);
            if degrees == 60.0 { probe.fast() } else { probe }.into()
        })
        .collect()
}
