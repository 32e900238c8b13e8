//! Hits, points and normals of every shape; rays that start on a surface; rays along it.

use std::sync::Arc;

use glam::{DMat4, DVec3, Vec2, Vec3};

use super::*;
use crate::math::{Bounds3, Transform};

/// splitmix64, so that the tests do not depend on the sampling room.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    fn vec3(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.vec3();
            let len = v.length();
            if len > 0.1 && len <= 1.0 {
                return v / len;
            }
        }
    }

    /// A magnitude from 10⁻⁸ to 10⁸ with a random sign.
    fn wild(&mut self) -> f32 {
        10f32.powf(8.0 * self.signed()) * self.signed().signum()
    }
}

fn mesh(tri: [Vec3; 3]) -> TriangleMesh {
    TriangleMesh { positions: tri.to_vec().into(), indices: vec![[0, 1, 2]], ..Default::default() }
}

fn set_of(shape: Shape) -> GeometrySet {
    GeometrySet { shapes: vec![shape], top: vec![0], ..Default::default() }
}

/// Brute force over one shape, with or without an instance.
fn trace(set: &GeometrySet, ray: &Ray) -> Option<Hit> {
    let (local, instance) = match set.instances.first() {
        Some(i) => (i.local_ray(ray), 0),
        None => (*ray, NO_INSTANCE),
    };
    let hit = |t, u, v| Hit { t, u, v, shape: 0, prim: 0, instance };
    match &set.shapes[0] {
        Shape::Mesh(m) => ShearedRay::new(&local)
            .and_then(|s| intersect_triangle(&local, &s, m.triangle(0)))
            .map(|(t, u, v)| hit(t, u, v)),
        Shape::Sphere(s) => s.intersect(&local).map(|t| hit(t, 0.0, 0.0)),
        Shape::Disk(s) => s.intersect(&local).map(|t| hit(t, 0.0, 0.0)),
        Shape::Cylinder(s) => s.intersect(&local).map(|t| hit(t, 0.0, 0.0)),
    }
}

fn affine(scale: DVec3, axis: DVec3, angle: f64, move_by: DVec3) -> Transform {
    let r = DMat4::from_axis_angle(axis.normalize(), angle);
    Transform::new(DMat4::from_translation(move_by) * r * DMat4::from_scale(scale)).expect("invertible")
}

fn random_placement(rng: &mut Random, scale: f64) -> Transform {
    affine(
        DVec3::splat(scale),
        rng.direction().as_dvec3(),
        6.0 * rng.unit() as f64,
        rng.vec3().as_dvec3() * 5.0 * scale,
    )
}

fn sphere(to_world: Transform) -> Sphere {
    let radius = to_world.vector_f64(DVec3::X).length() as f32;
    Sphere { center: to_world.point(Vec3::ZERO), radius, flip_normals: false, uv: true, to_world }
}

fn cylinder(to_world: Transform) -> Cylinder {
    let radius = to_world.vector_f64(DVec3::X).length() as f32;
    Cylinder { to_world, radius, length: to_world.vector_f64(DVec3::Z).length() as f32, flip_normals: false }
}

/// Rays that graze spheres, start on or in them, and lead away from them, at all sizes.
#[test]
fn f32_alone_rejects_no_ray_that_meets_a_sphere() {
    let mut rng = Random(11);
    let (mut rejected, mut met) = (0, 0);
    for _ in 0..200_000 {
        let scale = rng.wild().abs();
        let radius = scale * 10f32.powf(-3.0 * rng.unit());
        let center = scale * rng.vec3();
        let s = Sphere { center, radius, flip_normals: false, uv: false, to_world: Transform::IDENTITY };
        // Aim at the silhouette, up to a few roundings beside it.
        let o = center + rng.direction() * radius * 10f32.powf(3.0 * rng.unit() * rng.unit());
        let side = rng.direction().cross(o - center).normalize_or(Vec3::X);
        let beside = 1.0 + 10f32.powf(-7.0 * rng.unit()) * rng.signed();
        let d = (center + side * radius * beside - o) * rng.signed();
        let ray = Ray::new(o, if rng.unit() < 0.5 { d.normalize_or(side) } else { d });
        let hit = s.intersect_in_f64(&ray);
        met += hit.is_some() as u32;
        if s.surely_missed(&ray) {
            rejected += 1;
            assert_eq!(hit, None, "{s:?} {ray:?}");
        }
    }
    assert!(rejected > 50_000 && met > 20_000, "{rejected}, {met}");
}

/// Shoots at a shape, leaves it in both directions, and counts hits on the same surface that a convex or flat shape
/// cannot have.
fn self_hits(set: &GeometrySet, rng: &mut Random, aim: Vec3, reach: f32, closed: bool) -> (u32, u32) {
    let (mut hits, mut bad) = (0, 0);
    for _ in 0..20 {
        let o = aim + reach * 3.0 * rng.direction();
        let ray = Ray::new(o, (aim + reach * rng.vec3() - o).normalize());
        let Some(hit) = trace(set, &ray) else { continue };
        hits += 1;
        let si = set.interaction(&ray, &hit);
        for _ in 0..20 {
            // Half of the directions are grazing.
            let mut w = rng.direction();
            if rng.unit() < 0.5 {
                w = (w - si.ng * w.dot(si.ng) + si.ng * 1e-4 * rng.signed()).normalize_or(w);
            }
            let inward = closed && w.dot(si.ng) < 0.0;
            if !inward && trace(set, &Ray::new(si.spawn_origin(w), w)).is_some() {
                bad += 1;
            }
        }
    }
    (hits, bad)
}

/// Self-hits over many triangles, each with a point to aim at.
fn triangle_self_hits(rng: &mut Random, triangle: impl Fn(&mut Random) -> [Vec3; 3]) -> (u32, u32) {
    let (mut hits, mut bad) = (0, 0);
    for _ in 0..20_000 {
        let tri = triangle(rng);
        let (a, b) = (rng.unit(), rng.unit());
        let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
        let aim = tri[0] * (1.0 - a - b) + tri[1] * a + tri[2] * b;
        let set = set_of(Shape::Mesh(Arc::new(mesh(tri))));
        let (h, b) = self_hits(&set, rng, aim, 1e-3 * aim.length(), false);
        hits += h;
        bad += b;
    }
    assert!(hits > 10_000, "{hits}");
    (hits, bad)
}

#[test]
fn spawned_rays_do_not_hit_their_triangle() {
    let mut rng = Random(1);
    // Any scale, off centre, and needles of aspect 10⁶.
    let (hits, bad) = triangle_self_hits(&mut rng, |rng| {
        let scale = rng.wild();
        let size = 10f32.powf(-3.0 * rng.unit());
        let corner = rng.vec3();
        let (e, f) = (size * rng.vec3(), size * rng.vec3());
        let f = if rng.unit() < 0.5 { f } else { e * rng.unit() + 1e-6 * f };
        [corner, corner + e, corner + f].map(|p| p * scale)
    });
    assert_eq!(bad, 0, "of {hits}");
}

#[test]
fn spawned_rays_rarely_hit_triangles_beyond_f64() {
    // Every coordinate has its own magnitude from 10⁻⁸ to 10⁸: edge lengths and aspects up to 10¹⁶.
    let mut rng = Random(11);
    let (hits, bad) = triangle_self_hits(&mut rng, |rng| [0; 3].map(|_| Vec3::new(rng.wild(), rng.wild(), rng.wild())));
    assert!((bad as f64) < 0.005 * 20.0 * hits as f64, "{bad} of {hits}");
}

#[test]
fn spawned_rays_do_not_hit_their_quadric() {
    let mut rng = Random(2);
    for kind in 0..3 {
        let (mut hits, mut bad) = (0, 0);
        for _ in 0..3_000 {
            let scale = 10f64.powf(8.0 * rng.signed() as f64);
            let to_world = random_placement(&mut rng, scale);
            let aim = to_world.point(Vec3::ZERO);
            let (shape, closed) = match kind {
                0 => (Shape::Sphere(sphere(to_world)), true),
                1 => (Shape::Disk(Disk { to_world, flip_normals: false }), false),
                _ => (Shape::Cylinder(cylinder(to_world)), true),
            };
            let (h, b) = self_hits(&set_of(shape), &mut rng, aim, 0.8 * scale as f32, closed);
            hits += h;
            bad += b;
        }
        assert!(hits > 10_000, "{hits}");
        assert_eq!(bad, 0, "shape kind {kind}, of {hits}");
    }
}

#[test]
fn spawned_rays_do_not_hit_their_instance() {
    let mut rng = Random(3);
    for kind in 0..3 {
        let (mut hits, mut bad) = (0, 0);
        for _ in 0..3_000 {
            let shape = match kind {
                0 => Shape::Mesh(Arc::new(mesh([0; 3].map(|_| rng.vec3())))),
                1 => Shape::Sphere(sphere(Transform::IDENTITY)),
                _ => Shape::Cylinder(cylinder(Transform::IDENTITY)),
            };
            let scale = 10f64.powf(4.0 * rng.signed() as f64);
            let axis = rng.direction().as_dvec3();
            let stretch = DVec3::new(1.0, 0.2 + rng.unit() as f64, -2.0);
            let to_world = affine(stretch * scale, axis, 2.0, rng.vec3().as_dvec3() * scale);
            let mut set = set_of(shape);
            set.top.clear();
            set.groups = vec![vec![0]];
            set.instances = vec![Instance { group: 0, to_world }];
            let aim = to_world.point(Vec3::ZERO);
            let (h, b) = self_hits(&set, &mut rng, aim, 0.7 * scale as f32, kind > 0);
            hits += h;
            bad += b;
        }
        assert!(hits > 3_000, "{hits}");
        assert_eq!(bad, 0, "shape kind {kind}, of {hits}");
    }
}

#[test]
fn quadric_points_lie_on_the_surface_and_in_the_box() {
    let mut rng = Random(4);
    for _ in 0..2_000 {
        let to_world = random_placement(&mut rng, 1.0);
        let shapes = [
            Shape::Sphere(sphere(to_world)),
            Shape::Disk(Disk { to_world, flip_normals: false }),
            Shape::Cylinder(cylinder(to_world)),
        ];
        for (kind, shape) in shapes.into_iter().enumerate() {
            let bounds = shape.bounds();
            let set = set_of(shape);
            // From far away, where o + t·d would be off by much more than the bound.
            let o = to_world.point(Vec3::ZERO) + 1e4 * rng.direction();
            let ray = Ray::new(o, to_world.point(0.7 * rng.vec3()) - o);
            let Some(hit) = trace(&set, &ray) else { continue };
            let si = set.interaction(&ray, &hit);
            let p = to_world.inverse_matrix().transform_point3(si.p.as_dvec3());
            let off = match kind {
                0 => p.length() - 1.0,
                1 => p.z,
                _ => p.truncate().length() - 1.0,
            };
            assert!(off.abs() <= 2.0 * si.p_err.length() as f64, "kind {kind}: {off} against {}", si.p_err);
            let slack = Vec3::splat(1e-6);
            assert!(Bounds3::new(bounds.min - slack, bounds.max + slack).contains(si.p));
            // Parametrisation and normal agree.
            assert!(si.ng.dot(si.dpdu).abs() < 1e-4 * si.dpdu.length());
            assert!(si.ng.dot(si.dpdv).abs() < 1e-4 * si.dpdv.length());
            assert!((si.ng.length() - 1.0).abs() < 1e-5);
            assert!(si.uv.cmpge(Vec2::ZERO).all() && si.uv.cmple(Vec2::ONE).all());
        }
    }
}

#[test]
fn derivatives_match_finite_differences() {
    let mut rng = Random(5);
    let m = TriangleMesh {
        uvs: Some(vec![Vec2::new(0.1, 0.2), Vec2::new(0.9, 0.1), Vec2::new(0.3, 0.8)]),
        ..mesh([Vec3::new(-1.0, -1.0, 0.2), Vec3::new(1.2, -0.8, -0.1), Vec3::new(0.1, 1.3, 0.3)])
    };
    let shapes = [
        Shape::Mesh(Arc::new(m)),
        Shape::Sphere(sphere(Transform::IDENTITY)),
        Shape::Disk(Disk { to_world: Transform::IDENTITY, flip_normals: false }),
        Shape::Cylinder(cylinder(affine(DVec3::ONE, DVec3::X, 1.0, DVec3::ZERO))),
    ];
    for (kind, shape) in shapes.into_iter().enumerate() {
        let set = set_of(shape);
        for _ in 0..200 {
            let o = Vec3::new(0.3, 0.2, 4.0);
            let target = Vec3::new(0.5 * rng.signed(), 0.5 * rng.signed(), 0.0);
            let at = |dx: f32, dy: f32| {
                let ray = Ray::new(o, target + Vec3::new(dx, dy, 0.0) - o);
                trace(&set, &ray).map(|h| set.interaction(&ray, &h))
            };
            let h = 2e-3;
            let (Some(a), Some(b), Some(c)) = (at(0.0, 0.0), at(h, 0.0), at(0.0, h)) else { continue };
            for q in [b, c] {
                let duv = q.uv - a.uv;
                if duv.length() > 0.01 {
                    continue; // across the seam or next to a pole
                }
                let predicted = a.dpdu * duv.x + a.dpdv * duv.y;
                let error = (q.p - a.p - predicted).length();
                assert!(error < 0.15 * (q.p - a.p).length() + 1e-5, "kind {kind}: {error}");
            }
        }
    }
}

#[test]
fn normals_flip_and_keep_their_side_under_mirrors() {
    let tri = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let normals = Some(vec![Vec3::new(0.3, 0.0, 1.0).normalize(); 3]);
    let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z);
    let hit = |set: &GeometrySet| trace(set, &ray).map(|h| set.interaction(&ray, &h)).expect("hit");
    let plain = TriangleMesh { normals: normals.clone(), ..mesh(tri) };
    let si = hit(&set_of(Shape::Mesh(Arc::new(plain.clone()))));
    assert!(si.ng == Vec3::Z && si.ns.x > 0.2 && si.ns.z > 0.0 && si.wo == Vec3::Z);
    let flipped = TriangleMesh { flip_normals: true, ..plain.clone() };
    let si = hit(&set_of(Shape::Mesh(Arc::new(flipped))));
    assert!(si.ng == -Vec3::Z && si.ns.x < -0.2 && si.ns.z < 0.0);
    // A mirrored instance keeps its outside outside.
    let to_world = affine(DVec3::new(1.0, 1.0, -1.0), DVec3::X, 0.0, DVec3::ZERO);
    let set = GeometrySet {
        shapes: vec![Shape::Mesh(Arc::new(plain))],
        groups: vec![vec![0]],
        instances: vec![Instance { group: 0, to_world }],
        ..Default::default()
    };
    assert_eq!(hit(&set).ng, -Vec3::Z);
    let inside_out = Sphere { flip_normals: true, ..sphere(Transform::IDENTITY) };
    assert_eq!(hit(&set_of(Shape::Sphere(sphere(Transform::IDENTITY)))).ng.z.signum(), 1.0);
    let far = Ray::new(Vec3::new(0.2, 0.2, 5.0), -Vec3::Z);
    let set = set_of(Shape::Sphere(inside_out));
    assert!(set.interaction(&far, &trace(&set, &far).expect("hit")).ng.z < 0.0);
}

#[test]
fn grazing_and_undefined_rays() {
    let s = sphere(Transform::IDENTITY);
    // A tangent from afar either misses or touches at the tangent point.
    for k in 0..100 {
        let y = 1.0 - 1e-7 * (k as f32 - 50.0);
        let ray = Ray::new(Vec3::new(-1e4, y, 0.0), Vec3::X);
        let hit = s.intersect(&ray);
        assert_eq!(hit.is_some(), y <= 1.0, "y = {y}");
        assert!(hit.is_none_or(|t| (t - 1e4).abs() < 1.0));
    }
    // In the plane of a disc and along the axis of a cylinder there is nothing to hit.
    let disk = Disk { to_world: Transform::IDENTITY, flip_normals: false };
    assert_eq!(disk.intersect(&Ray::new(Vec3::new(-2.0, 0.0, 0.0), Vec3::X)), None);
    let c = cylinder(Transform::IDENTITY);
    assert_eq!(c.intersect(&Ray::new(Vec3::new(0.5, 0.0, -1.0), Vec3::Z)), None);
    assert!(c.intersect(&Ray::new(Vec3::new(0.5, 0.0, 0.5), Vec3::X)).is_some());
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    for (o, d) in [
        (Vec3::new(nan, 0.0, 0.0), Vec3::Z),
        (Vec3::new(0.0, inf, 0.0), Vec3::Z),
        (Vec3::ZERO, Vec3::new(0.0, nan, 1.0)),
        (Vec3::ZERO, Vec3::new(inf, 0.0, 1.0)),
        (Vec3::ZERO, Vec3::ZERO),
    ] {
        let ray = Ray::new(o, d);
        assert!(!is_traceable(&ray) && ShearedRay::new(&ray).is_none());
        assert!(s.intersect(&ray).is_none() && disk.intersect(&ray).is_none() && c.intersect(&ray).is_none());
    }
    for tmax in [0.0, -1.0, nan] {
        assert!(s.intersect(&Ray::segment(Vec3::ZERO, Vec3::Z, tmax)).is_none());
    }
}

#[test]
fn areas_and_bounds_have_closed_forms() {
    let to_world = affine(DVec3::splat(2.0), DVec3::new(1.0, 2.0, 3.0), 1.0, DVec3::new(5.0, -3.0, 1.0));
    let pi = std::f64::consts::PI;
    let near = |a: f64, b: f64| (a - b).abs() < 1e-6 * b;
    assert!(near(Shape::Sphere(sphere(to_world)).area(), 16.0 * pi));
    assert!(near(Shape::Disk(Disk { to_world, flip_normals: false }).area(), 4.0 * pi));
    assert!(near(Shape::Cylinder(cylinder(to_world)).area(), 8.0 * pi));
    assert!(near(mesh([Vec3::ZERO, Vec3::X, Vec3::Y]).area(), 0.5));
    let b = Shape::Sphere(sphere(to_world)).bounds();
    assert_eq!((b.min, b.max), (Vec3::new(3.0, -5.0, -1.0), Vec3::new(7.0, -1.0, 3.0)));
    let tilted = affine(DVec3::ONE, DVec3::X, std::f64::consts::FRAC_PI_4, DVec3::ZERO);
    let b = Disk { to_world: tilted, flip_normals: false }.bounds();
    let h = std::f32::consts::FRAC_1_SQRT_2;
    assert!((b.max - Vec3::new(1.0, h, h)).length() < 1e-6 && (b.min + b.max).length() < 1e-6);
}
