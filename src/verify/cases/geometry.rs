//! Geometry at the limits of floats: slivers, coincident surfaces, thin walls, rays at edges.

use super::super::case::{Case, Check, Item, Outcome};
use super::super::methods::Light;
use super::super::probe::{Probe, load};
use super::super::xml::*;
use crate::accel::{Accel, AccelKind};
use crate::geometry::{GeometrySet, Ray, Shape, TriangleMesh, generate};
use crate::math::Vec3;
use crate::sample::{Key, Purpose, Sampler, Sequence, warp};
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};
use std::f64::consts;
use std::sync::Arc;

pub fn cases() -> Vec<Case> {
    vec![
        Case { name: "slivers", about: "closed furnaces of degenerate triangles", items: slivers },
        Case {
            name: "edge-rays",
            about: "rays aimed at edges and vertices of closed meshes find something",
            items: edges,
        },
        Case {
            name: "walls",
            about: "nothing shines through walls, however thin or near to one another",
            items: walls,
        },
    ]
}

/// A closed unit sphere of `rings` rings of `columns` quads, without slivers at the poles but as thin as columns are many.
fn ball(rings: u32, columns: u32) -> TriangleMesh {
    let at = |i: u32, j: u32| {
        let (theta, phi) = (PI * i as f32 / rings as f32, TAU * j as f32 / columns as f32);
        Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    let mut positions = vec![Vec3::Z, -Vec3::Z];
    positions.extend((1..rings).flat_map(|i| (0..columns).map(move |j| at(i, j))));
    let vertex = |i: u32, j: u32| match i {
        0 => 0,
        i if i == rings => 1,
        i => 2 + (i - 1) * columns + j % columns,
    };
    let mut indices = Vec::new();
    for (i, j) in (0..rings).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        // Facing inwards.
        if i > 0 {
            indices.push([vertex(i, j), vertex(i, j + 1), vertex(i + 1, j)]);
        }
        if i < rings - 1 {
            indices.push([vertex(i, j + 1), vertex(i + 1, j + 1), vertex(i + 1, j)]);
        }
    }
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// A cube whose sides are cut into strips of the given aspect.
fn strips(aspect: f32) -> TriangleMesh {
    let mut positions = Vec::new();
    let mut indices = Vec::new();
    let axes = [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)];
    for (u, v) in axes {
        for side in [-1.0f32, 1.0] {
            let n = u.cross(v) * side;
            // One strip of the given aspect between two wide ones; corners are shared with the neighbours' exactly.
            let cuts = [-1.0, 0.0, 2.0 / aspect, 1.0];
            for pair in cuts.windows(2) {
                let first = positions.len() as u32;
                positions.extend([(-1.0, 0), (1.0, 0), (1.0, 1), (-1.0, 1)].map(|(a, b)| n + a * u + pair[b] * v));
                let quad = if side < 0.0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
                indices.extend(quad.map(|t| t.map(|i: u32| first + i)));
            }
        }
    }
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// Triangles without area: points, and corners on a line.
fn with_empty(mut mesh: TriangleMesh, count: u32) -> TriangleMesh {
    let n = mesh.indices.len() as u32;
    let empty = (0..count).map(|i| mesh.indices[(i * 31 % n) as usize]).map(|t| [t[0], t[1], t[0]]).collect::<Vec<_>>();
    mesh.indices.extend(empty);
    mesh
}

/// All triangles twice.
fn doubled(mut mesh: TriangleMesh) -> TriangleMesh {
    let again = mesh.indices.clone();
    mesh.indices.extend(again);
    mesh
}

/// The sky of radiance 1 must not come in; inside, a lossless glass ball or nothing. The furnace is lit by a point light, so
/// that coincident surfaces do not emit twice: direct light varies, its mean over the picture is taken from the smooth
/// sphere's formula only where the mesh is a fine ball.
fn slivers() -> Vec<Item> {
    let furnace = |mesh_inside: &str| {
        scene(&[depth(-1), camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, (8, 8)), mesh("mesh.ply", mesh_inside)])
    };
    let emitting = |what: &str, m: TriangleMesh| {
        // Smooth normals, which a coarse ball would get, lose light.
        let flat = r#"<boolean name="face_normals" value="true"/>"#;
        let xml = furnace(&(flat.to_string() + &diffuse(0.5) + &emits(0.5)));
        Probe::new(what, xml, 1.0, Light::SEEN | Light::DIRECT | Light::INDIRECT).mesh("mesh.ply", m).bias(0.01).spp(32)
    };
    // A dark room under a bright sky: what comes in is a leak.
    let dark = |what: &str, m: TriangleMesh| {
        let xml = scene(&[
            depth(-1),
            camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 120.0, (16, 16)),
            mesh("mesh.ply", &diffuse(0.5)),
            sky(1.0),
        ]);
        Probe::new(what, xml, 0.0, Light::DIRECT | Light::INDIRECT).mesh("mesh.ply", m).photons(100).spp(64)
    };
    let dropped = |what: &'static str, m: fn() -> TriangleMesh, count: f64| {
        Check::new(what, "scene", move |accel, _| {
            let loaded = load(&scene(&[depth(-1), mesh("mesh.ply", &diffuse(0.5))]), &[("mesh.ply", m())], accel);
            Outcome::exact(count, loaded.map_or(f64::NAN, |s| s.stats.dropped_triangles as f64))
        })
    };
    vec![
        emitting("ball of 8000 triangles", ball(40, 100)).fast().into(),
        emitting("ball of slivers, aspect 1e3", ball(4, 10_000)).relative(0.01).into(),
        emitting("cube with strips of aspect 1e7", strips(1e7)).bias(0.025).fast().into(),
        emitting("200 triangles without area", with_empty(ball(40, 100), 200)).into(),
        dark("dark ball under a bright sky", ball(40, 100)).fast().into(),
        dark("dark ball of slivers, aspect 1e3", ball(4, 10_000)).into(),
        dark("dark cube with strips of aspect 1e7", strips(1e7)).into(),
        dark("dark ball, each triangle twice", doubled(ball(40, 100))).into(),
        dropped("triangles without area are counted", || with_empty(ball(40, 100), 200), 200.0).into(),
        dropped("slivers are kept", || strips(1e7), 0.0).into(),
        // Duplicates do not count twice: light is reflected by one of them.
        Probe::new(
            "each triangle twice, point light",
            scene(&[
                depth(-1),
                camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, (8, 8)),
                mesh("mesh.ply", &diffuse(0.5)),
                point_light([0.0; 3], consts::PI),
            ]),
            1.0,
            Light::DIRECT | Light::INDIRECT,
        )
        .mesh("mesh.ply", doubled(ball(40, 100)))
        .spp(32)
        // The flat triangles of a ball of 40 rings are up to 0.2 % nearer to the light.
        .relative(0.015)
        .absolute(0.005)
        .bias(0.01)
        .fast()
        .into(),
    ]
}

/// Rays from inside of a closed mesh, aimed at its vertices or at points of its edges, that find nothing.
fn leaks(mesh: &TriangleMesh, kind: AccelKind, vertices: bool, rays: u64) -> u64 {
    const CHUNK: u64 = 1 << 14;
    let shapes = vec![Shape::Mesh(Arc::new(mesh.clone()))];
    let set = Arc::new(GeometrySet { shapes, top: vec![0], ..Default::default() });
    let accel = Accel::build(kind, set).expect("a back end of this build");
    let count = |chunk: u64| {
        let mut s = Sampler::new(Sequence::Independent, Key::new(1, Purpose::Test, 34), chunk);
        let mut one = || {
            let o = 0.3 * warp::uniform_sphere(s.next_2d());
            let triangle = mesh.indices[(s.next_1d() * mesh.indices.len() as f32) as usize % mesh.indices.len()];
            let [a, b] = [triangle[0], triangle[1]].map(|v| mesh.positions.as_slice()[v as usize]);
            let at = if vertices { a } else { a.lerp(b, s.next_1d()) };
            accel.intersect(&Ray::new(o, at - o)).is_none() as u64
        };
        (0..CHUNK.min(rays - chunk * CHUNK)).map(|_| one()).sum::<u64>()
    };
    (0..rays.div_ceil(CHUNK)).into_par_iter().map(count).sum()
}

/// What is known of Embree's test against triangles.
const VERTEX_LEAK: &str = "Embree's test has no rule for rays exactly through a vertex";

fn edges() -> Vec<Item> {
    let of = |name: &'static str, m: fn() -> TriangleMesh, vertices: bool, rays: u64| {
        let target = if vertices { "vertices" } else { "edges" };
        Check::new(format!("{name}, {rays:.0e} rays at {target}", rays = rays as f64), "ray query", move |kind, _| {
            let missed = leaks(&m(), kind, vertices, rays);
            let outcome = Outcome::exact(0.0, missed as f64).note(format!("{missed} missed"));
            if kind == AccelKind::Embree && vertices { outcome.limited(VERTEX_LEAK) } else { outcome }
        })
        .limit(120.0)
    };
    // In fast runs and in full ones.
    const MANY: [u64; 2] = [100_000, 10_000_000];
    let mut items: Vec<Item> = Vec::new();
    let mut add = |name: &'static str, m: fn() -> TriangleMesh, at_vertices: [u64; 2]| {
        for (vertices, [few, many]) in [(false, MANY), (true, at_vertices)] {
            items.push(of(name, m, vertices, few).into());
            items.push(of(name, m, vertices, many).slow().into());
        }
    };
    add("ball", || ball(40, 100), MANY);
    // Ten thousand triangles meet at each pole: a ray aimed there is tested against all of them.
    add("ball of slivers", || ball(4, 10_000), [5_000, 1_000_000]);
    add("bumpy sphere", || generate::displaced_sphere(100_000, 5), MANY);
    items
}

/// A lamp and everything that it lights are behind a wall.
fn walls() -> Vec<Item> {
    let view = || camera([0.0, 0.0, -0.6], [0.0, 0.0, 0.0], 60.0, (8, 8));
    let up = [0.0, 0.0, 1.0];
    let down = [0.0, 0.0, -1.0];
    let light = Light::DIRECT | Light::INDIRECT;
    let of = |what: String, pieces: &[String]| {
        let mut all = vec![depth(-1), view()];
        all.extend_from_slice(pieces);
        Probe::new(what, scene(&all), 0.0, light).spp(64)
    };
    let lit = || point_light([0.0, 0.0, 0.5], 10.0) + &square([0.0, 0.0, 1.0], 1.0, down, &diffuse(0.8));
    let mut items: Vec<Item> =
        vec![of("one sheet, lit from behind".into(), &[square([0.0; 3], 1.0, up, &diffuse(0.8)), lit()]).fast().into()];
    for gap in [1e-2, 1e-5] {
        items.push(
            of(
                format!("two sheets {gap:e} apart"),
                &[square([0.0; 3], 1.0, down, &diffuse(0.8)), square([0.0, 0.0, gap], 1.0, up, &diffuse(0.8)), lit()],
            )
            .into(),
        );
    }
    // Sheets that reflect on both sides, lit from above, seen from below: no light gets around them. The maps are read where
    // the camera looks, on the dark side, and all their photons on the sheets came from the other.
    let direct_map = photon_mapper(&[
        ("boolean", "final_gather", "false".into()),
        ("float", "global_lookup_radius", "0.25".into()),
        ("float", "caustic_lookup_radius", "0.25".into()),
    ]);
    let both = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></bsdf>"#;
    for gap in [0.0, 1e-5] {
        let lower = if gap > 0.0 { square([0.0, 0.0, -gap], 1.0, up, both) } else { String::new() };
        let xml = scene(&[direct_map.clone(), view(), square([0.0; 3], 1.0, up, both), lower, lit()]);
        let what =
            if gap > 0.0 { format!("two sheets {gap:e} apart, two-sided") } else { "one sheet, two-sided".into() };
        items.push(Probe::new(what, xml, 0.0, light).fast().into());
    }
    // A lamp just behind a sheet sends nothing to a floor at distance 1.
    for gap in [1e-2, 1e-3, 1e-4, 1e-5] {
        let xml = scene(&[
            depth(-1),
            camera([0.0, 0.0, 0.5], [0.0, 0.0, 0.0], 60.0, (8, 8)),
            square([0.0; 3], 1.0, up, &diffuse(0.8)),
            square([0.0, 0.0, 1.0], 1.0, down, &diffuse(0.8)),
            square([0.0, 0.0, 1.0 + gap], 0.9, down, &lamp(1.0)),
        ]);
        let probe = Probe::new(format!("lamp {gap:e} behind a sheet"), xml, 0.0, light).spp(64).photons(1000);
        items.push(if gap == 1e-5 { probe.fast() } else { probe }.into());
    }
    items
}
