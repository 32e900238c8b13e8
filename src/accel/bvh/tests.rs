//! The tree against brute force, at edges, with undefined rays, and its invariants.

use glam::{DMat4, DVec3};

use super::super::Mode;
use super::*;
use crate::geometry::{
    Cylinder, Disk, Instance, NO_INSTANCE, Shape, ShearedRay, Sphere, TriangleMesh, intersect_triangle,
};
use crate::math::{Transform, Vec3};
use crate::sample::mix64;

pub(super) struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed << 32)
    }

    pub fn unit(&mut self) -> f32 {
        self.0 += 1;
        (mix64(self.0) >> 40) as f32 / (1u64 << 24) as f32
    }

    pub fn vec3(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.vec3();
            if (0.01..1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }
}

pub(super) fn soup(rng: &mut Random, n: usize, size: f32) -> TriangleMesh {
    let mut points = Vec::new();
    for _ in 0..n {
        let c = rng.vec3();
        points.extend([c + size * rng.vec3(), c + size * rng.vec3(), c + size * rng.vec3()]);
    }
    let indices = (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    TriangleMesh { positions: points.into(), indices, ..Default::default() }
}

/// A closed sphere of `2 · n · (n − 1)` triangles with shared vertices.
fn ball(n: u32) -> TriangleMesh {
    let at = |i: u32, j: u32| {
        let (theta, phi) =
            (std::f32::consts::PI * i as f32 / n as f32, std::f32::consts::TAU * (j % n) as f32 / n as f32);
        Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    let mut points = vec![Vec3::Z, -Vec3::Z];
    points.extend((1..n).flat_map(|i| (0..n).map(move |j| at(i, j))));
    let v = |i: u32, j: u32| {
        if i == 0 {
            0
        } else if i == n {
            1
        } else {
            2 + (i - 1) * n + j % n
        }
    };
    let mut indices = Vec::new();
    for i in 0..n {
        for j in 0..n {
            if i > 0 {
                indices.push([v(i, j), v(i + 1, j), v(i, j + 1)]);
            }
            if i < n - 1 {
                indices.push([v(i, j + 1), v(i + 1, j), v(i + 1, j + 1)]);
            }
        }
    }
    TriangleMesh { positions: points.into(), indices, ..Default::default() }
}

pub(super) fn mesh_set(mesh: TriangleMesh) -> Arc<GeometrySet> {
    Arc::new(GeometrySet { shapes: vec![Shape::Mesh(Arc::new(mesh))], top: vec![0], ..Default::default() })
}

/// Everything at once: two meshes, three quadrics, a group of a mesh and a sphere placed several times.
pub(super) fn mixed_set(rng: &mut Random) -> Arc<GeometrySet> {
    let place = |rng: &mut Random, scale: f64| {
        let m = DMat4::from_translation(rng.vec3().as_dvec3())
            * DMat4::from_axis_angle(rng.direction().as_dvec3(), 2.0)
            * DMat4::from_scale(DVec3::splat(scale));
        Transform::new(m).expect("invertible")
    };
    let sphere = |to_world: Transform, radius| {
        Shape::Sphere(Sphere { center: to_world.point(Vec3::ZERO), radius, flip_normals: false, uv: true, to_world })
    };
    let mut shapes = vec![Shape::Mesh(Arc::new(soup(rng, 300, 0.1))), Shape::Mesh(Arc::new(soup(rng, 40, 0.3)))];
    let to_world = place(rng, 0.3);
    shapes.push(sphere(to_world, 0.3));
    shapes.push(Shape::Disk(Disk { to_world: place(rng, 0.5), flip_normals: false }));
    shapes.push(Shape::Cylinder(Cylinder { to_world: place(rng, 0.2), radius: 0.2, length: 0.2, flip_normals: false }));
    shapes.push(Shape::Mesh(Arc::new(TriangleMesh::default())));
    let to_world = place(rng, 0.5);
    shapes.push(sphere(to_world, 0.5));
    let instances = (0..20).map(|i| Instance { group: i % 2, to_world: place(rng, 0.2) }).collect();
    Arc::new(GeometrySet { shapes, top: vec![4, 0, 2, 3, 5], groups: vec![vec![1, 6], vec![0]], instances })
}

/// Tries every primitive, in the order in which ties are broken.
pub(super) fn brute_force(set: &GeometrySet, ray: &Ray) -> Option<Hit> {
    let mut best: Option<Hit> = None;
    let mut group = |shapes: &[u32], ray: &Ray, instance: u32| {
        let mut shapes = shapes.to_vec();
        shapes.sort_unstable();
        let mut offer = |t: f32, u: f32, v: f32, shape: u32, prim: u32| {
            if best.is_none_or(|b| t < b.t) {
                best = Some(Hit { t, u, v, shape, prim, instance });
            }
        };
        for s in shapes {
            let t = match &set.shapes[s as usize] {
                Shape::Mesh(m) => {
                    let Some(sheared) = ShearedRay::new(ray) else { continue };
                    for prim in 0..m.indices.len() as u32 {
                        if let Some((t, u, v)) = intersect_triangle(ray, &sheared, m.triangle(prim)) {
                            offer(t, u, v, s, prim);
                        }
                    }
                    continue;
                }
                Shape::Sphere(q) => q.intersect(ray),
                Shape::Disk(q) => q.intersect(ray),
                Shape::Cylinder(q) => q.intersect(ray),
            };
            if let Some(t) = t {
                offer(t, 0.0, 0.0, s, 0);
            }
        }
    };
    group(&set.top, ray, NO_INSTANCE);
    for (i, instance) in set.instances.iter().enumerate() {
        group(&set.groups[instance.group as usize], &instance.local_ray(ray), i as u32);
    }
    best
}

fn available() -> impl Iterator<Item = Isa> {
    Isa::ALL.into_iter().filter(|isa| isa.is_available())
}

/// Trees of every quality.
fn trees(set: &Arc<GeometrySet>, mode: Mode) -> [Bvh; 3] {
    [Quality::Default, Quality::Fast, Quality::High].map(|quality| {
        let bvh = Bvh::build_with(set.clone(), AccelOptions { quality, mode }).expect("small");
        bvh.validate().expect("valid");
        bvh
    })
}

#[test]
fn every_aarch64_has_neon() {
    assert_eq!(Isa::Neon.is_available(), cfg!(target_arch = "aarch64"));
    assert_eq!(Isa::detect() == Isa::Neon, cfg!(target_arch = "aarch64"));
}

fn agree(set: &Arc<GeometrySet>, rng: &mut Random, rays: usize) -> usize {
    let mut trees = trees(set, Mode::Robust);
    let mut hits = 0;
    for i in 0..rays {
        let o = 1.5 * rng.vec3();
        let mut d = rng.direction();
        if i % 3 == 0 {
            d[i % 7 % 3] = 0.0;
        }
        let tmax = if i % 5 == 0 { 2.0 * rng.unit() } else { f32::INFINITY };
        let ray = Ray::segment(o, d * 10f32.powf(4.0 * rng.unit() - 2.0), tmax);
        let expected = brute_force(set, &ray);
        for bvh in &mut trees {
            for isa in available() {
                bvh.isa = isa;
                assert_eq!(bvh.intersect(&ray), expected, "{isa:?} {:?} {ray:?}", bvh.options);
                assert_eq!(bvh.occluded(&ray), expected.is_some(), "{isa:?} {:?} {ray:?}", bvh.options);
            }
        }
        hits += usize::from(expected.is_some());
    }
    hits
}

#[test]
fn hits_equal_brute_force() {
    let mut rng = Random::new(1);
    for n in [0, 1, 2, 3, 4, 5, 8, 9, 16, 17, 33, 48, 49, 100, 1000] {
        let set = mesh_set(soup(&mut rng, n, 0.3));
        let hits = agree(&set, &mut rng, 2000);
        assert!(hits > 100 || n < 100, "{hits}");
    }
    let set = mixed_set(&mut rng);
    assert!(agree(&set, &mut rng, 20_000) > 2_000);
}

/// In f32 the same triangles are hit, but for rays at edges, at almost the same places.
#[test]
fn the_fast_mode_differs_by_rounding() {
    let mut rng = Random::new(9);
    let set = mesh_set(soup(&mut rng, 1000, 0.3));
    let mut trees = trees(&set, Mode::Fast);
    let (mut hits, mut differ) = (0, 0);
    for i in 0..20_000 {
        let ray = Ray::segment(1.5 * rng.vec3(), rng.direction(), if i % 5 == 0 { rng.unit() } else { f32::INFINITY });
        let expected = brute_force(&set, &ray);
        let mut found = Vec::new();
        for bvh in &mut trees {
            for isa in available() {
                bvh.isa = isa;
                found.push(bvh.intersect(&ray));
                assert_eq!(bvh.occluded(&ray), found[0].is_some(), "{isa:?} {ray:?}");
            }
        }
        assert!(found.iter().all(|f| *f == found[0]), "{ray:?}");
        match (found[0], expected) {
            (Some(a), Some(b)) if a.prim == b.prim => {
                assert!((a.t - b.t).abs() < 1e-4 * b.t.max(1.0) && (a.u - b.u).abs() < 1e-2, "{a:?} {b:?}");
                hits += 1;
            }
            (None, None) => {}
            _ => differ += 1,
        }
    }
    assert!(hits > 5000 && differ < 20, "{hits} {differ}");
}

/// Large triangles among small ones are cut, and rays meet fewer boxes.
#[test]
fn large_triangles_are_cut_in_trees_of_high_quality() {
    let mut rng = Random::new(10);
    let mut m = soup(&mut rng, 2000, 0.02);
    let beams: Vec<Vec3> = (0..200).flat_map(|_| [rng.vec3(), rng.vec3(), rng.vec3()]).collect();
    let first = m.positions.len() as u32;
    m.indices.extend((0..200).map(|i| [first + 3 * i, first + 3 * i + 1, first + 3 * i + 2]));
    m.positions = m.positions.as_slice().iter().copied().chain(beams).collect::<Vec<_>>().into();
    let set = mesh_set(m);
    let [default, _, high] = trees(&set, Mode::Robust);
    let leaves = |b: &Bvh| b.top.blocks.iter().flat_map(|b| b.id).filter(|&id| id != u32::MAX).count();
    assert_eq!(leaves(&default), 2200);
    assert!((2300..=2860).contains(&leaves(&high)), "{}", leaves(&high));
    // The expected cost of a ray by the surface area heuristic.
    let cost = |b: &Bvh| {
        let used = |n: &wide::Node8, i: usize| (n.child[i] != wide::Child::NONE).then(|| n.slot_bounds(i));
        let areas = b.top.nodes.iter().flat_map(|n| (0..wide::WIDTH).filter_map(move |i| used(n, i)));
        let half = |b: Bounds3| {
            let e = b.max - b.min;
            f64::from(e.x * e.y + e.y * e.z + e.z * e.x)
        };
        areas.map(half).sum::<f64>() / half(b.top.bounds)
    };
    assert!(cost(&high) < 0.9 * cost(&default), "{} {}", cost(&high), cost(&default));
    assert!(agree(&set, &mut rng, 6000) > 1000);
}

#[test]
fn degenerate_meshes_build_and_are_searched() {
    let mut rng = Random::new(2);
    let tri = [Vec3::ZERO, Vec3::X, Vec3::Y];
    // A thousand copies of one triangle: the first one wins.
    let copies = TriangleMesh { positions: tri.to_vec().into(), indices: vec![[0, 1, 2]; 1000], ..Default::default() };
    let set = mesh_set(copies);
    agree(&set, &mut rng, 500);
    let bvh = Bvh::build(set).expect("small");
    let hit = bvh.intersect(&Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z)).expect("hit");
    assert_eq!((hit.prim, hit.t), (0, 1.0));
    // Points, lines, a flat grid, and magnitudes whose areas overflow.
    for scale in [1e-30, 1.0, 1e30] {
        let mut m = soup(&mut rng, 200, 0.2);
        let flat: Vec<Vec3> = m.positions.as_slice().iter().map(|p| Vec3::new(p.x, p.y, 0.0) * scale).collect();
        m.positions = flat.into();
        m.indices.extend([[0, 0, 0], [1, 1, 2]].repeat(20));
        // Rays near the origin cannot be placed against coordinates of 10³⁰: there, only build and validate.
        agree(&mesh_set(m), &mut rng, if scale > 1.0 { 0 } else { 200 });
    }
    // Vertices that are not finite are never hit and do no harm.
    let mut m = soup(&mut rng, 50, 0.3);
    let mut points = m.positions.as_slice().to_vec();
    points[0].x = f32::NAN;
    points[4].y = f32::INFINITY;
    m.positions = points.into();
    agree(&mesh_set(m), &mut rng, 1000);
}

/// Rays almost along the axes, far from the origin and in units of any size: no box may be missed.
#[test]
fn boxes_are_not_missed_far_from_the_origin() {
    let mut rng = Random::new(7);
    let mut hits = 0;
    for scale in [1e-9, 1.0, 1e9] {
        for offset in [0.0, 1e3, 1e7] {
            let mut m = soup(&mut rng, 200, 0.3);
            m.positions = m.positions.as_slice().iter().map(|&p| (p + offset) * scale).collect::<Vec<_>>().into();
            let mut bvh = Bvh::build(mesh_set(m.clone())).expect("small");
            for i in 0..600 {
                let [a, b, c] = m.triangle(i % 200);
                let target = a * 0.5 + b * 0.25 + c * 0.25;
                let mut d = rng.direction();
                for axis in 0..3 {
                    d[axis] *= [1.0, 1e-4, 1e-20, 1e-38][(4.0 * rng.unit()) as usize];
                }
                let ray = Ray::new(target - d / d.length() * scale * 3.0, d / d.length());
                let expected = brute_force(&bvh.set, &ray);
                hits += usize::from(expected.is_some());
                for isa in available() {
                    bvh.isa = isa;
                    assert_eq!(bvh.intersect(&ray), expected, "{isa:?} {ray:?}");
                    assert_eq!(bvh.occluded(&ray), expected.is_some(), "{isa:?} {ray:?}");
                }
            }
        }
    }
    assert!(hits > 2000, "{hits}");
}

/// Rays that graze a plane of small triangles, where edge functions are noise: what is found in f32 to be hit for certain is
/// hit.
#[test]
fn grazing_rays_are_answered_alike() {
    let mut rng = Random::new(8);
    let (n, s, t) = (24, Vec3::new(0.9, 0.3, -0.2), Vec3::new(-0.1, 0.8, 0.4));
    let normal = s.cross(t).normalize();
    for offset in [0.0, 1.0, 1e3] {
        let at = |u: f32, v: f32| Vec3::splat(offset) + u * s + v * t;
        let grid = |i: u32| at((i % (n + 1)) as f32 / n as f32, (i / (n + 1)) as f32 / n as f32);
        let cell = |i: u32| {
            let a = i % n + i / n * (n + 1);
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        };
        let mesh = TriangleMesh {
            positions: (0..(n + 1) * (n + 1)).map(grid).collect::<Vec<_>>().into(),
            indices: (0..n * n).flat_map(cell).collect(),
            ..Default::default()
        };
        let mut bvh = Bvh::build(mesh_set(mesh)).expect("small");
        let mut hits = 0;
        for i in 0..3000 {
            let (a, b) = (at(rng.unit(), rng.unit()), at(rng.unit(), rng.unit()));
            let height = [0.0, 1e-8, 1e-7, 1e-6, 1e-3][i % 5] * (2.0 * rng.unit() - 1.0);
            let fall = [0.0, 1e-7, 1e-4, 1.0][i % 4] * (2.0 * rng.unit() - 1.0);
            let d = if i % 3 == 0 { normal } else { b - a + fall * normal };
            let ray = Ray::segment(a + height * normal - d * (i / 1000) as f32, d, [0.999, 1.0, 3.5][i % 3]);
            bvh.isa = Isa::Portable;
            let expected = bvh.intersect(&ray);
            hits += usize::from(expected.is_some());
            for isa in available() {
                bvh.isa = isa;
                assert_eq!(bvh.intersect(&ray), expected, "{isa:?} {ray:?}");
                assert_eq!(bvh.occluded(&ray), expected.is_some(), "{isa:?} {ray:?}");
            }
        }
        assert!((500..2500).contains(&hits), "{hits}");
    }
}

/// A room with walls across the axes, and small triangles and needles in it.
fn room(rng: &mut Random) -> TriangleMesh {
    let mut mesh = soup(rng, 20, 0.3);
    let mut points = mesh.positions.as_slice().to_vec();
    for i in 0..4 {
        points[3 * i + 2] = points[3 * i].lerp(points[3 * i + 1], 0.3) + 1e-6 * rng.vec3();
    }
    let first = points.len() as u32;
    points.extend((0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - 1.0));
    let walls = [[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4], [2, 3, 7], [2, 7, 6], [0, 2, 6]];
    mesh.indices.extend(walls.map(|t| t.map(|i| first + i)));
    mesh.positions = points.into();
    mesh
}

/// From beside one triangle at an edge, a corner or a point of another, to end beside it.
fn between_triangles(rng: &mut Random, mesh: &TriangleMesh, scale: f32, i: usize) -> Ray {
    let [a, b] = [0; 2].map(|_| mesh.triangle((rng.unit() * mesh.indices.len() as f32) as u32));
    let at = |t: [Vec3; 3], u: f32, v: f32| t[0] + u * (t[1] - t[0]) + v * (t[2] - t[0]);
    let (u, v) = (rng.unit(), rng.unit());
    let o = at(a, u, v * (1.0 - u)) + [0.0, 1e-7, 1e-6, 0.3][i % 4] * scale * rng.vec3();
    let (u, v) = [(rng.unit(), 0.0), (0.0, 1.0), (0.3 * rng.unit(), 0.7 * rng.unit())][i % 3];
    let tmax = if i.is_multiple_of(5) { f32::INFINITY } else { 1.0 + ((i % 40) as f32 - 20.0) * f32::EPSILON };
    Ray::segment(o, at(b, u, v) - o, tmax)
}

#[test]
fn few_triangles_are_found_as_by_brute_force() {
    let mut rng = Random::new(11);
    let mut hits = 0;
    for (scale, offset) in [(1.0, 0.0), (1.0, 3.0), (1e-3, 1.0), (1e-6, 0.0), (1e7, 0.0), (1e-12, 0.0), (1e12, 0.0)] {
        let mut mesh = room(&mut rng);
        mesh.positions = mesh.positions.as_slice().iter().map(|&p| (p + offset) * scale).collect::<Vec<_>>().into();
        let mut bvh = Bvh::build(mesh_set(mesh.clone())).expect("small");
        let rays: Vec<Ray> = (0..4000).map(|i| between_triangles(&mut rng, &mesh, scale, i)).collect();
        let expected: Vec<_> = rays.iter().map(|ray| brute_force(&bvh.set, ray)).collect();
        hits += expected.iter().flatten().count();
        for isa in available() {
            bvh.isa = isa;
            for (ray, &expected) in rays.iter().zip(&expected) {
                assert_eq!(bvh.intersect(ray), expected, "{isa:?} {scale:e} {ray:?}");
                assert_eq!(bvh.occluded(ray), expected.is_some(), "{isa:?} {scale:e} {ray:?}");
            }
            assert_eq!(all_hits(&bvh, &rays), expected, "{isa:?} {scale:e}");
        }
    }
    assert!(hits > 7000, "{hits}");
}

fn all_hits(bvh: &Bvh, rays: &[Ray]) -> Vec<Option<Hit>> {
    // What was there before does not stay.
    let stale = Hit { t: 1.0, u: 0.0, v: 0.0, shape: 7, prim: 7, instance: 7 };
    let mut hits = vec![Some(stale); rays.len() + 1];
    bvh.intersect_all(rays.iter(), &mut hits);
    assert_eq!(hits.pop(), Some(Some(stale)));
    hits
}

/// In groups without a tree, with and without triangles and shapes of other kinds, and with one.
#[test]
fn many_rays_at_once_find_what_each_finds() {
    let mut rng = Random::new(13);
    let place = |rng: &mut Random| {
        let matrix = DMat4::from_translation(rng.vec3().as_dvec3()) * DMat4::from_scale(DVec3::splat(0.4));
        Transform::new(matrix).expect("regular")
    };
    for (triangles, others) in [(0, 1), (1, 0), (16, 2), (17, 0), (33, 3), (48, 4), (48, 0), (49, 1), (0, 5)] {
        let mut shapes = vec![Shape::Mesh(Arc::new(soup(&mut rng, triangles, 0.5)))];
        for i in 0..others {
            let to_world = place(&mut rng);
            let center = to_world.point(Vec3::ZERO);
            shapes.push(match i % 3 {
                0 => Shape::Sphere(Sphere { center, radius: 0.4, flip_normals: false, uv: false, to_world }),
                1 => Shape::Disk(Disk { to_world, flip_normals: false }),
                _ => Shape::Sphere(Sphere { center, radius: 1e-3, flip_normals: true, uv: false, to_world }),
            });
        }
        // All once more, at the same distances.
        let copy = shapes[0].clone();
        if triangles == 17 {
            shapes.push(copy);
        }
        let top = (0..shapes.len() as u32).collect();
        let set = Arc::new(GeometrySet { shapes, top, ..Default::default() });
        let mut bvh = Bvh::build(set).expect("small");
        let bad = [f32::NAN, f32::INFINITY, 0.0];
        let mut rays: Vec<Ray> = (0..1001)
            .map(|i| {
                let far = if i % 7 == 0 { 1e4 } else { 2.0 };
                let o = far * rng.direction();
                Ray::segment(o, 0.5 * rng.vec3() - o, [f32::INFINITY, 1.0, 0.9][i % 3])
            })
            .collect();
        for (i, x) in bad.into_iter().enumerate() {
            rays[20 + i].d = Vec3::splat(x);
            rays[40 + i].tmax = x;
        }
        for isa in available() {
            bvh.isa = isa;
            let expected: Vec<_> = rays.iter().map(|ray| bvh.intersect(ray)).collect();
            assert!(expected.iter().flatten().count() > 20, "{triangles} triangles, {others} other shapes");
            for len in [1, 15, 16, 17, 32, 1001] {
                assert_eq!(
                    all_hits(&bvh, &rays[..len]),
                    expected[..len],
                    "{isa:?}, {triangles} and {others}, {len} rays"
                );
            }
        }
    }
}

/// The same rays are answered wrongly by kernels that believe what f32 says.
#[test]
fn rounding_must_be_bounded() {
    let mut rng = Random::new(12);
    let mesh = room(&mut rng);
    let mut bvh = Bvh::build(mesh_set(mesh.clone())).expect("small");
    bvh.top.flat.as_mut().expect("few triangles have no tree").trust_f32();
    for isa in available() {
        bvh.isa = isa;
        let (mut nearest, mut any, mut together) = (0, 0, 0);
        for i in 0..4000 {
            let ray = between_triangles(&mut rng, &mesh, 1.0, i);
            let expected = brute_force(&bvh.set, &ray);
            nearest += usize::from(bvh.intersect(&ray) != expected);
            any += usize::from(bvh.occluded(&ray) != expected.is_some());
            together += usize::from(all_hits(&bvh, &[ray]) != [expected]);
        }
        assert!(nearest > 0 && any > 0 && together > 0, "{isa:?} {nearest} {any} {together}");
    }
}

#[test]
fn undefined_rays_hit_nothing() {
    let mut rng = Random::new(3);
    let set = mixed_set(&mut rng);
    let bvh = Bvh::build(set).expect("small");
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let hits = |ray: Ray| bvh.intersect(&ray).is_some() || bvh.occluded(&ray);
    for x in bad {
        for axis in 0..3 {
            let mut v = Vec3::new(0.1, 0.2, -0.3);
            v[axis] = x;
            assert!(!hits(Ray::new(v, Vec3::Z)) && !hits(Ray::new(Vec3::ZERO, v)));
        }
    }
    for i in 0..1000 {
        let o = rng.vec3();
        let d = rng.direction();
        assert!(!hits(Ray::new(o, Vec3::ZERO)) && !hits(Ray::new(o, d * 1e-42)));
        let tmax = [0.0, -1.0, -f32::INFINITY, f32::NAN][i % 4];
        assert!(!hits(Ray::segment(o, d, tmax)));
    }
}

#[test]
fn a_closed_mesh_does_not_leak() {
    let mut rng = Random::new(4);
    let mesh = ball(60);
    let points = mesh.positions.as_slice().to_vec();
    let indices = mesh.indices.clone();
    let mut bvh = Bvh::build(mesh_set(mesh)).expect("small");
    let kinds: Vec<Isa> = available().collect();
    for i in 0..200_000 {
        bvh.isa = kinds[i / 3 % kinds.len()];
        // From inside, at vertices, at points of edges, and anywhere.
        let tri = indices[(rng.unit() * indices.len() as f32) as usize].map(|k| points[k as usize]);
        let target = match i % 3 {
            0 => tri[i % 5 % 3],
            1 => tri[0].lerp(tri[1], rng.unit()),
            _ => rng.direction(),
        };
        let o = 0.7 * rng.vec3() / 3f32.sqrt();
        let ray = Ray::new(o, target - o);
        assert!(bvh.intersect(&ray).is_some() && bvh.occluded(&ray), "{ray:?}");
    }
}

#[test]
fn the_tree_does_not_depend_on_the_number_of_threads() {
    let mut rng = Random::new(5);
    let set = mesh_set(soup(&mut rng, 300_000, 0.01));
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| Bvh::build(set.clone()).expect("small"))
    };
    let one = build(1);
    for threads in [2, 3] {
        let many = build(threads);
        assert_eq!(one.top.root, many.top.root);
        let bytes = |t: &Tree| [bytemuck::cast_slice::<_, u8>(&t.nodes), bytemuck::cast_slice(&t.blocks)].concat();
        assert!(bytes(&one.top) == bytes(&many.top));
        assert_eq!((one.top.nodes.len(), one.top.blocks.len()), (many.top.nodes.len(), many.top.blocks.len()));
    }
}

#[test]
fn validation_finds_damage() {
    let mut rng = Random::new(6);
    let fresh = || Bvh::build(mesh_set(soup(&mut Random::new(6), 500, 0.1))).expect("small");
    let mut bvh = fresh();
    bvh.top.nodes[0].bounds[3][0] -= 0.5;
    assert!(bvh.validate().is_err());
    let mut bvh = fresh();
    bvh.top.blocks[0].id[0] = bvh.top.blocks[1].id[0];
    assert!(bvh.validate().is_err());
    let mut bvh = fresh();
    bvh.top.blocks[3].v[0][0][0] += 0.1 + rng.unit();
    assert!(bvh.validate().is_err());
}
