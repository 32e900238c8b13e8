//! The wrapper on whichever Embree is installed. Without one there is nothing to test.
#![cfg(embree)]

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use embree4_sys::{
    Coherence, CommittedScene, Device, Error, ErrorKind, Hit, NO_INSTANCE, Packet16, Ray, Scene, TriangleBuffers,
    UserGeometry, UserHit,
};

struct Mesh {
    /// One position more than there are vertices.
    positions: Vec<[f32; 3]>,
    indices: Vec<[u32; 3]>,
}

impl Mesh {
    fn buffers(&self) -> TriangleBuffers<'_> {
        TriangleBuffers {
            positions: &self.positions,
            vertex_count: self.positions.len().saturating_sub(1),
            indices: &self.indices,
        }
    }
}

/// A square `[-1, 1]²` at height z, of two triangles.
fn square(z: f32) -> Mesh {
    Mesh {
        positions: vec![[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z], [0.0; 3]],
        indices: vec![[0, 1, 2], [0, 2, 3]],
    }
}

/// A bumpy closed surface around the origin: latitude-longitude grid of n × 2n quads.
fn bumpy(n: u32) -> Mesh {
    let position = |i: u32, j: u32| {
        let (theta, phi) = (std::f32::consts::PI * i as f32 / n as f32, std::f32::consts::PI * j as f32 / n as f32);
        let r = 1.0 + 0.1 * (5.0 * theta).sin() * (7.0 * phi).sin();
        [r * theta.sin() * phi.cos(), r * theta.sin() * phi.sin(), r * theta.cos()]
    };
    let columns = 2 * n;
    let mut positions: Vec<_> =
        (0..=n).flat_map(|i| (0..columns).map(move |j| (i, j))).map(|(i, j)| position(i, j)).collect();
    positions.push([0.0; 3]);
    let quad = |(i, j): (u32, u32)| {
        let at = |i: u32, j: u32| i * columns + j % columns;
        [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    };
    let indices = (0..n).flat_map(|i| (0..columns).map(move |j| (i, j))).flat_map(quad).collect();
    Mesh { positions, indices }
}

fn device() -> Device {
    Device::new("").expect("Embree works on this machine")
}

fn scene_of(mesh: Mesh) -> CommittedScene {
    let mut scene = Scene::new(&device()).expect("scene");
    scene.add_triangles(5, Arc::new(mesh), Mesh::buffers).expect("mesh");
    scene.commit().expect("commit")
}

fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    Ray { origin, direction, tnear: 0.0, tfar: f32::INFINITY }
}

/// Uniform numbers in [0, 1) from a 64-bit linear congruential generator.
fn numbers(mut state: u64) -> impl FnMut() -> f32 {
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}

#[test]
fn reports_version_and_instruction_set() {
    let device = device();
    let headers = embree4_sys::HEADER_VERSION.expect("built with Embree");
    // A patch release may be installed under the headers; the minor version may not differ.
    let minor = |v: &str| v.rsplit_once('.').map(|(minor, _)| minor.to_owned());
    assert_eq!(minor(&device.version()), minor(headers));
    assert!(["SSE", "AVX", "AVX2", "AVX-512", "NEON"].contains(&device.isa()), "{}", device.isa());
}

#[test]
fn a_ray_through_a_square_hits_the_right_triangle() {
    let scene = scene_of(square(2.0));
    let hit = scene.intersect1(ray([0.5, -0.25, 0.0], [0.0, 0.0, 1.0])).expect("hit");
    // p = a + u (b − a) + v (c − a) with a = (−1, −1), b = (1, −1), c = (1, 1): v = 0.375, u + v = 0.75.
    assert_eq!((hit.t, hit.geometry, hit.prim, hit.instance), (2.0, 5, 0, NO_INSTANCE));
    assert!((hit.u - 0.375).abs() < 1e-6 && (hit.v - 0.375).abs() < 1e-6, "{hit:?}");
    assert_eq!((hit.normal[0], hit.normal[1], hit.normal[2].abs()), (0.0, 0.0, 4.0));
    let other = scene.intersect1(ray([-0.5, 0.25, 5.0], [0.0, 0.0, -1.0])).expect("no culling");
    assert_eq!((other.t, other.prim), (3.0, 1));
}

#[test]
fn a_ray_beside_or_short_of_the_square_misses() {
    let scene = scene_of(square(2.0));
    assert_eq!(scene.intersect1(ray([1.5, 0.0, 0.0], [0.0, 0.0, 1.0])), None);
    assert_eq!(scene.intersect1(ray([0.0, 0.0, 0.0], [0.0, 0.0, -1.0])), None);
    let short = Ray { tfar: 1.999, ..ray([0.5, 0.0, 0.0], [0.0, 0.0, 1.0]) };
    assert_eq!(scene.intersect1(short), None);
    assert!(!scene.occluded1(short));
    assert!(scene.occluded1(Ray { tfar: 2.001, ..short }));
    let late = Ray { tnear: 2.001, ..ray([0.5, 0.0, 0.0], [0.0, 0.0, 1.0]) };
    assert_eq!(scene.intersect1(late), None);
}

#[test]
fn bounds_enclose_the_mesh_and_an_empty_scene_has_none() {
    let (lower, upper) = scene_of(square(2.0)).bounds();
    for axis in 0..3 {
        let (l, u) = ([-1.0, -1.0, 2.0][axis], [1.0, 1.0, 2.0][axis]);
        assert!(lower[axis] <= l && lower[axis] > l - 1e-5 && upper[axis] >= u && upper[axis] < u + 1e-5);
    }
    let empty = scene_of(Mesh { positions: vec![], indices: vec![] });
    assert!(empty.bounds().0[0] > empty.bounds().1[0]);
    assert_eq!(empty.intersect1(ray([0.0; 3], [0.0, 0.0, 1.0])), None);
}

#[test]
fn a_vertex_buffer_without_padding_is_refused() {
    let mut scene = Scene::new(&device()).expect("scene");
    let tight = |m: &Mesh| m.positions.len();
    let error = scene
        .add_triangles(0, Arc::new(square(0.0)), |m| TriangleBuffers { vertex_count: tight(m), ..m.buffers() })
        .expect_err("no room behind the last vertex");
    assert_eq!(error, Error::Padding { vertices: 5, missing_bytes: 4 });
    assert!(error.to_string().contains("4 more readable bytes"), "{error}");
}

#[test]
fn an_index_out_of_range_is_refused() {
    let mut mesh = square(0.0);
    mesh.indices[1][2] = 4;
    let mut scene = Scene::new(&device()).expect("scene");
    let error = scene.add_triangles(0, Arc::new(mesh), Mesh::buffers).expect_err("vertex 4 is padding");
    assert_eq!(error, Error::Index { triangle: 1, index: 4, vertices: 4 });
}

#[test]
fn embree_errors_come_with_their_text() {
    let mut scene = Scene::new(&device()).expect("scene");
    scene.add_triangles(3, Arc::new(square(0.0)), Mesh::buffers).expect("first");
    let error = scene.add_triangles(3, Arc::new(square(1.0)), Mesh::buffers).expect_err("id 3 is taken");
    let Error::Embree { kind, text } = &error else { panic!("{error:?}") };
    assert!(matches!(kind, ErrorKind::InvalidArgument | ErrorKind::InvalidOperation) && !text.is_empty(), "{error:?}");
    assert!(error.to_string().ends_with(text.as_str()));
    // The failure was taken with the report; the scene is still good.
    scene.add_triangles(4, Arc::new(square(1.0)), Mesh::buffers).expect("another id");
}

#[test]
fn a_device_that_cannot_be_made_is_an_error() {
    let error = Device::new("threads=many").err().expect("many is no number");
    assert!(matches!(error, Error::Embree { .. }) && !error.to_string().is_empty(), "{error:?}");
    assert_eq!(Device::new("a\0b").err(), Some(Error::Config));
}

#[test]
fn memory_rises_with_a_scene_and_falls_with_it() {
    let device = device();
    let before = device.memory();
    let mut scene = Scene::new(&device).expect("scene");
    let mesh = bumpy(64);
    let triangles = mesh.indices.len();
    scene.add_triangles(0, Arc::new(mesh), Mesh::buffers).expect("mesh");
    let scene = scene.commit().expect("commit");
    let during = device.memory();
    assert!(during > before + 20 * triangles, "{before} → {during} bytes for {triangles} triangles");
    drop(scene);
    assert!(device.memory() < during - 20 * triangles, "{during} → {} bytes", device.memory());
}

#[test]
fn the_scene_keeps_shared_buffers_alive_and_lets_them_go() {
    let mesh = Arc::new(square(1.0));
    let weak = Arc::downgrade(&mesh);
    let mut scene = Scene::new(&device()).expect("scene");
    scene.add_triangles(0, mesh, Mesh::buffers).expect("mesh");
    let scene = scene.commit().expect("commit");
    assert_eq!(weak.strong_count(), 1);
    assert!(scene.occluded1(ray([0.1, 0.2, 0.0], [0.0, 0.0, 1.0])));
    drop(scene);
    assert_eq!(weak.strong_count(), 0);
}

#[test]
fn sphere_points_are_hit_from_outside_and_inside() {
    let mut scene = Scene::new(&device()).expect("scene");
    scene.add_spheres(2, Arc::new(vec![[0.0, 0.0, 0.0, 1.0], [5.0, 0.0, 0.0, 2.0]]), |s| s).expect("spheres");
    let scene = scene.commit().expect("commit");
    let hit = scene.intersect1(ray([0.0, 0.0, -3.0], [0.0, 0.0, 1.0])).expect("front");
    assert!((hit.t - 2.0).abs() < 1e-5 && hit.prim == 0 && hit.geometry == 2, "{hit:?}");
    let inside = scene.intersect1(ray([5.0, 0.0, 0.0], [0.0, 1.0, 0.0])).expect("inside");
    assert!((inside.t - 2.0).abs() < 1e-5 && inside.prim == 1, "{inside:?}");
}

#[test]
fn instances_place_a_scene_and_name_themselves() {
    let device = device();
    let mut part = Scene::new(&device).expect("scene");
    part.add_triangles(7, Arc::new(square(0.0)), Mesh::buffers).expect("mesh");
    part.add_user(8, Arc::new(Spheres::at([[0.0, 0.0, 3.0]]))).expect("user");
    let part = Arc::new(part.commit().expect("commit"));
    let mut scene = Scene::new(&device).expect("scene");
    // Twice as large, ten along x: z = 0 stays, the sphere's centre goes to z = 6, its radius to 2.
    let columns = [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0], [10.0, 0.0, 0.0]];
    scene.add_instance(0, part.clone(), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]]).expect("first");
    scene.add_instance(1, part, columns).expect("second");
    let scene = scene.commit().expect("commit");
    let hit = scene.intersect1(ray([11.5, 1.5, -4.0], [0.0, 0.0, 1.0])).expect("enlarged square");
    assert_eq!((hit.t, hit.geometry, hit.instance), (4.0, 7, 1));
    let ball = scene.intersect1(ray([10.0, 0.0, 20.0], [0.0, 0.0, -1.0])).expect("enlarged sphere");
    assert!((ball.t - 12.0).abs() < 1e-4 && (ball.geometry, ball.instance) == (8, 1), "{ball:?}");
    let small = scene.intersect1(ray([0.0, 0.0, 20.0], [0.0, 0.0, -1.0])).expect("first sphere");
    assert!((small.t - 16.0).abs() < 1e-4 && (small.geometry, small.instance) == (8, 0), "{small:?}");
}

/// Unit spheres; reports 100 more than the primitive's number, and counts its tests.
struct Spheres {
    centers: Vec<[f32; 3]>,
    tests: AtomicUsize,
}

impl Spheres {
    fn at(centers: impl Into<Vec<[f32; 3]>>) -> Self {
        Self { centers: centers.into(), tests: AtomicUsize::new(0) }
    }
}

impl UserGeometry for Spheres {
    fn count(&self) -> usize {
        self.centers.len()
    }

    fn bounds(&self, prim: u32) -> ([f32; 3], [f32; 3]) {
        let c = self.centers[prim as usize];
        (c.map(|x| x - 1.0), c.map(|x| x + 1.0))
    }

    fn intersect(&self, prim: u32, ray: &Ray) -> Option<UserHit> {
        self.tests.fetch_add(1, Ordering::Relaxed);
        let c = self.centers[prim as usize];
        let o: [f64; 3] = std::array::from_fn(|i| f64::from(ray.origin[i]) - f64::from(c[i]));
        let d = ray.direction.map(f64::from);
        let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let (a, b) = (dot(d, d), dot(o, d));
        let root = (b * b - a * (dot(o, o) - 1.0)).sqrt();
        let ts = [(-b - root) / a, (-b + root) / a];
        let t = ts.into_iter().map(|t| t as f32).find(|&t| t > ray.tnear && t <= ray.tfar)?;
        Some(UserHit { t, u: 0.25, v: 0.5, normal: [0.0, 0.0, 1.0], prim: prim + 100 })
    }
}

#[test]
fn user_geometry_is_asked_and_its_answer_returned() {
    let spheres = Arc::new(Spheres::at([[0.0; 3], [4.0, 0.0, 0.0], [8.0, 0.0, 0.0]]));
    let mut scene = Scene::new(&device()).expect("scene");
    scene.add_user(1, spheres.clone()).expect("user");
    let scene = scene.commit().expect("commit");
    let hit = scene.intersect1(ray([4.0, 0.0, -5.0], [0.0, 0.0, 1.0])).expect("middle sphere");
    assert_eq!(
        hit,
        Hit { t: 4.0, u: 0.25, v: 0.5, normal: [0.0, 0.0, 1.0], geometry: 1, prim: 101, instance: NO_INSTANCE }
    );
    assert!(spheres.tests.load(Ordering::Relaxed) > 0);
    let along = scene.intersect1(ray([-5.0, 0.0, 0.0], [1.0, 0.0, 0.0])).expect("nearest of three");
    assert_eq!((along.t, along.prim), (4.0, 100));
    assert!(scene.occluded1(ray([6.0, 0.0, 0.0], [1.0, 0.0, 0.0])));
    assert!(!scene.occluded1(Ray { tfar: 0.9, ..ray([6.0, 0.0, 0.0], [1.0, 0.0, 0.0]) }));
}

#[test]
fn packets_find_what_single_rays_find() {
    let mut scene = Scene::new(&device()).expect("scene");
    scene.add_triangles(0, Arc::new(bumpy(96)), Mesh::buffers).expect("mesh");
    scene.add_user(1, Arc::new(Spheres::at([[2.0, 0.0, 0.0], [0.0, 0.0, 2.0]]))).expect("user");
    let scene = scene.commit().expect("commit");
    let mut next = numbers(1);
    let mut packet = Packet16::default();
    let (mut hits, mut rays_done) = (0, 0);
    for round in 0..2000 {
        // Neighbouring rays of a pinhole camera at (4, 3, 2), of every packet length.
        let corner = [next() - 0.5, next() - 0.5];
        let rays: Vec<Ray> = (0..1 + round % 16)
            .map(|i| {
                let (x, y) = (corner[0] + 0.01 * (i % 4) as f32, corner[1] + 0.01 * (i / 4) as f32);
                ray([4.0, 3.0, 2.0], [-4.0 - 3.0 * x, -3.0 + 4.0 * x, -2.0 + 5.0 * y])
            })
            .collect();
        packet.set(rays.iter().copied());
        assert_eq!(packet.len(), rays.len());
        scene.intersect16(&mut packet, Coherence::Coherent);
        for (i, &r) in rays.iter().enumerate() {
            let (single, many) = (scene.intersect1(r), packet.hit(i));
            rays_done += 1;
            match (single, many) {
                (Some(a), Some(b)) => {
                    hits += 1;
                    assert!((a.t - b.t).abs() <= 2e-6 * a.t, "{a:?} {b:?}");
                    // The two ways may settle a ray through an edge differently.
                    assert!((a.geometry, a.prim) == (b.geometry, b.prim) || a.u.min(a.v).min(1.0 - a.u - a.v) < 1e-3);
                }
                (None, None) => {}
                other => panic!("{other:?} for {r:?}"),
            }
        }
        packet.set(rays.iter().copied());
        scene.occluded16(&mut packet);
        for (i, &r) in rays.iter().enumerate() {
            assert_eq!(packet.is_occluded(i), scene.occluded1(r));
        }
    }
    assert!(hits * 4 > rays_done && hits < rays_done, "{hits} of {rays_done}: the test should see hits and misses");
}

/// Embree's robust triangle test is watertight but for rays within rounding error of a vertex: of rays aimed exactly at
/// vertices and edges, 0.1 % slip through (Embree 3.13.5 and 4.3.3, measured here).
#[test]
fn few_rays_aimed_at_edges_and_vertices_slip_through() {
    let mesh = bumpy(48);
    let mut next = numbers(7);
    let targets: Vec<[f32; 3]> = (0..20_000)
        .map(|_| {
            let t = mesh.indices[(next() * mesh.indices.len() as f32) as usize];
            let (a, b) = (mesh.positions[t[0] as usize], mesh.positions[t[1] as usize]);
            let s = if next() < 0.3 { 0.0 } else { next() };
            std::array::from_fn(|i| a[i] + s * (b[i] - a[i]))
        })
        .collect();
    let scene = scene_of(mesh);
    let origin = [0.013, -0.021, 0.034];
    let slips = |p: &&[f32; 3]| !scene.occluded1(ray(origin, std::array::from_fn(|i| p[i] - origin[i])));
    let leaks = targets.iter().filter(slips).count();
    assert!(leaks <= 100, "{leaks} of {} rays", targets.len());
}

#[test]
fn threads_share_a_scene() {
    let scene = scene_of(bumpy(32));
    let count = |seed| {
        let mut next = numbers(seed);
        (0..5000)
            .filter(|_| scene.occluded1(ray([3.0, 0.0, 0.0], [-3.0, 4.0 * next() - 2.0, 4.0 * next() - 2.0])))
            .count()
    };
    let alone: Vec<usize> = (0..4).map(count).collect();
    let together: Vec<usize> = std::thread::scope(|s| {
        (0..4)
            .map(|i| s.spawn(move || count(i)))
            .collect::<Vec<_>>()
            .into_iter()
            .map(|t| t.join().expect("no panic"))
            .collect()
    });
    assert_eq!(alone, together);
}
