//! Generated meshes and rays, for tests and benches of the back ends. Not every user needs all of it.
#![allow(dead_code)]

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use caustica::accel::Accel;
use caustica::geometry::{GeometrySet, Ray, Shape, SurfaceInteraction, TriangleMesh};
use caustica::math::{Frame, Vec2, Vec3};
use caustica::sample::{Key, Sampler, Sequence, warp};

/// A closed bumpy ball around the origin of `4 n (n − 1)` triangles; radius 0.85 to 1.15.
pub fn bumpy_ball(n: u32) -> TriangleMesh {
    let columns = 2 * n;
    let at = |i: u32, j: u32| {
        let (theta, phi) = (PI * i as f32 / n as f32, PI * j as f32 / n as f32);
        let w = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let bumps = (9.0 * w.x).sin() * (11.0 * w.y).sin() * (8.0 * w.z).cos() + 0.5 * (41.0 * w.x + 37.0 * w.z).sin();
        (1.0 + 0.1 * bumps) * w
    };
    // One vertex at each pole, `columns` in each ring between them.
    let mut positions = vec![at(0, 0), at(n, 0)];
    positions.extend((1..n).flat_map(|i| (0..columns).map(move |j| at(i, j))));
    let vertex = |i: u32, j: u32| match i {
        0 => 0,
        i if i == n => 1,
        i => 2 + (i - 1) * columns + j % columns,
    };
    let mut indices = Vec::new();
    for (i, j) in (0..n).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        if i > 0 {
            indices.push([vertex(i, j), vertex(i + 1, j), vertex(i, j + 1)]);
        }
        if i < n - 1 {
            indices.push([vertex(i, j + 1), vertex(i + 1, j), vertex(i + 1, j + 1)]);
        }
    }
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// `n` unconnected triangles in the cube [−1, 1]³, whose sizes span three powers of ten, inside a cube of twelve.
pub fn soup(n: u32, seed: u64) -> TriangleMesh {
    let (mut positions, mut indices) = cube(1.5);
    for i in 0..n {
        let mut s = sampler(seed, i as u64);
        let mut point = || uniform_cube(&mut s);
        let center = point();
        let size = 0.3 * 10f32.powf(-1.5 + 1.5 * point().x);
        let first = positions.len() as u32;
        positions.extend((0..3).map(|_| center + size * point()));
        indices.push([first, first + 1, first + 2]);
    }
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// A room of twelve large triangles with a fine, connected terrain of `2 n²` long thin triangles as its floor.
pub fn terrain_room(n: u32) -> TriangleMesh {
    let (mut positions, mut indices) = cube(1.2);
    let first = positions.len() as u32;
    for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
        // Rows crowd together towards one side, which makes the triangles thin there.
        let (x, y) = (2.0 * i as f32 / n as f32 - 1.0, 2.0 * (j as f32 / n as f32).powi(3) - 1.0);
        positions.push(Vec3::new(x, y, -0.8 + 0.1 * (TAU * 3.0 * x).sin() * (TAU * 5.0 * y).cos()));
    }
    let at = |i: u32, j: u32| first + i * (n + 1) + j;
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        indices.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        indices.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// The cube [−h, h]³ of twelve triangles.
fn cube(h: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let corner = |i: u32| Vec3::new(i as f32 % 2.0, (i / 2) as f32 % 2.0, (i / 4) as f32) * 2.0 * h - h;
    let quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    ((0..8).map(corner).collect(), quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

pub fn set_of(mesh: TriangleMesh) -> Arc<GeometrySet> {
    Arc::new(GeometrySet { shapes: vec![Shape::Mesh(Arc::new(mesh))], top: vec![0], ..Default::default() })
}

pub fn sampler(seed: u64, index: u64) -> Sampler {
    Sampler::new(Sequence::Independent, Key(seed), index)
}

fn uniform_cube(s: &mut Sampler) -> Vec3 {
    2.0 * Vec3::new(s.next_1d(), s.next_1d(), s.next_1d()) - 1.0
}

/// The kinds of rays that a renderer asks for.
#[derive(Clone, Copy, Debug)]
pub enum Class {
    /// From a pinhole near the middle, in scanline order.
    Primary,
    /// From a point that a primary ray saw to a point in the scene.
    Shadow,
    /// From such a point along a cosine-distributed direction.
    Diffuse,
    /// From a light near the middle, or from where its light has gone after one to three diffuse reflections.
    Photon,
}

/// Ray number `index` of `count`; `None` where its primary ray leaves the scene.
pub fn ray(class: Class, set: &GeometrySet, accel: &Accel, count: u64, index: u64) -> Option<Ray> {
    // Scan a square image of the whole sphere of directions, one ray for each pixel, jittered.
    let mut s = sampler(0x5eed, index);
    let side = (count as f32).sqrt().ceil();
    let pixel = Vec2::new((index % side as u64) as f32, (index / side as u64) as f32) + s.next_2d();
    let primary = Ray::new(Vec3::new(0.031, -0.023, 0.017), warp::uniform_sphere(pixel / side));
    match class {
        Class::Primary => return Some(primary),
        Class::Photon => return photon_ray(set, accel, &mut s, index % 4),
        _ => {}
    }
    let si = set.interaction(&primary, &accel.intersect(&primary)?);
    match class {
        Class::Shadow => {
            let to = 0.7 * uniform_cube(&mut s);
            let o = si.spawn_origin(to - si.p);
            Some(Ray::segment(o, to - o, 1.0))
        }
        _ => Some(scattered(&si, &mut s)),
    }
}

/// A ray that a diffuse surface sends back to the side from which it was seen.
fn scattered(si: &SurfaceInteraction, s: &mut Sampler) -> Ray {
    let facing = if si.ng.dot(si.wo) < 0.0 { -si.ng } else { si.ng };
    let d = Frame::from_normal(facing).to_world(warp::cosine_hemisphere(s.next_2d()));
    si.spawn_ray(d)
}

/// The edge of a photon path that follows `bounces` reflections; `None` where the path leaves the scene before.
fn photon_ray(set: &GeometrySet, accel: &Accel, s: &mut Sampler, bounces: u64) -> Option<Ray> {
    let mut ray = Ray::new(Vec3::new(-0.13, 0.21, 0.34), warp::uniform_sphere(s.next_2d()));
    for _ in 0..bounces {
        ray = scattered(&set.interaction(&ray, &accel.intersect(&ray)?), s);
    }
    Some(ray)
}
