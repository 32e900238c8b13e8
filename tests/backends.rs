//! Embree and the Rust BVH find the same hits, but where a ray passes within the rounding error of Embree's tests.
//!
//! Rays of four classes on three generated meshes: 2·10⁵ of each, 10⁷ with the feature `slow-tests`. The same hit is the
//! same triangle at the same point, to 10⁻⁵ of the scene. At most 10⁻⁵ of the rays may have another answer, and for each of
//! those the truth is looked up in f64 with bounds on its rounding: where these decide, and they leave hardly one ray open,
//! it must be what the Rust BVH says.
#![cfg(embree)]

mod meshes;
mod truth;

use caustica::accel::{Accel, AccelKind};
use std::sync::Arc;

use caustica::geometry::{GeometrySet, Hit, Instance, Ray, Shape, TriangleMesh};
use caustica::math::{DMat4, DVec3, Transform, Vec3};
use caustica::sample::{Sampler, warp};
use meshes::{Class, bumpy_ball, ray, sampler, set_of, soup, terrain_room};
use rayon::prelude::*;
use truth::first_hit;

const RAYS: u64 = if cfg!(feature = "slow-tests") { 10_000_000 } else { 200_000 };

/// How the answers of the two back ends compare.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    rays: u64,
    hits: u64,
    /// Different answers.
    differ: u64,
    /// Those where the Rust BVH is wrong, and those where f64 cannot tell.
    wrong: u64,
    unclear: u64,
}

impl Count {
    fn add(self, o: Self) -> Self {
        Self {
            rays: self.rays + o.rays,
            hits: self.hits + o.hits,
            differ: self.differ + o.differ,
            wrong: self.wrong + o.wrong,
            unclear: self.unclear + o.unclear,
        }
    }
}

/// Same triangle, same point. The scenes are about one unit large; at glancing angles and close to the origin the
/// relative error of `t` has no bound.
fn same(a: &Hit, b: &Hit, ray: &Ray) -> bool {
    a.prim == b.prim && (a.t - b.t).abs() * ray.d.length() <= 1e-5
}

/// True when this is the first hit for certain, and its distance is as good as f32 can be; an error where f64 cannot tell.
fn is_true(answer: Option<Hit>, mesh: &TriangleMesh, ray: &Ray) -> Result<bool, &'static str> {
    Ok(match (first_hit(mesh, ray)?, answer) {
        (None, None) => true,
        (Some((t, prim)), Some(h)) => h.prim == prim && (f64::from(h.t) - t).abs() <= t * f64::from(f32::EPSILON),
        _ => false,
    })
}

fn compare(embree: &Accel, bvh: &Accel, mesh: &TriangleMesh, ray: &Ray, class: Class) -> Count {
    let (hit, same, right) = if let Class::Shadow = class {
        let (a, b) = (embree.occluded(ray), bvh.occluded(ray));
        (b, a == b, if a == b { Ok(true) } else { first_hit(mesh, ray).map(|hit| hit.is_some() == b) })
    } else {
        let (a, b) = (embree.intersect(ray), bvh.intersect(ray));
        let same = match (a, b) {
            (Some(a), Some(b)) => same(&a, &b, ray),
            (a, b) => a == b,
        };
        (b.is_some(), same, if same { Ok(true) } else { is_true(b, mesh, ray) })
    };
    if right != Ok(true) {
        eprintln!("{class:?} {ray:?}: {:?} {:?}, {right:?}", embree.intersect(ray), bvh.intersect(ray));
    }
    Count {
        rays: 1,
        hits: hit as u64,
        differ: !same as u64,
        wrong: (right == Ok(false)) as u64,
        unclear: right.is_err() as u64,
    }
}

fn agree(name: &str, mesh: TriangleMesh) {
    let set = set_of(mesh);
    let build = |kind| Accel::build(kind, set.clone()).expect("both back ends are built in");
    let (embree, bvh) = (build(AccelKind::Embree), build(AccelKind::Bvh));
    for class in [Class::Primary, Class::Shadow, Class::Diffuse, Class::Photon] {
        let count = count(&set, &embree, &bvh, class);
        println!("{name}, {} triangles, {class:?}: {count:?}", set.shapes[0].primitives());
        assert!(count.rays > RAYS * 9 / 10 && count.hits > count.rays / 100, "{count:?}");
        assert_eq!(count.wrong, 0, "{class:?}: {count:?}");
        // A bound that leaves one event to the small number of rays.
        assert!(count.differ <= 2 + count.rays / 100_000 && count.unclear <= 2, "{class:?}: {count:?}");
    }
}

fn count(set: &GeometrySet, embree: &Accel, bvh: &Accel, class: Class) -> Count {
    let Shape::Mesh(mesh) = &set.shapes[0] else { unreachable!("the set is one mesh") };
    let one = |i| ray(class, set, bvh, RAYS, i).map(|r| compare(embree, bvh, mesh, &r, class)).unwrap_or_default();
    (0..RAYS).into_par_iter().map(one).reduce(Count::default, Count::add)
}

#[test]
fn back_ends_agree_on_a_bumpy_ball() {
    agree("bumpy ball", bumpy_ball(128));
}

#[test]
fn back_ends_agree_on_a_soup() {
    agree("soup", soup(50_000, 3));
}

#[test]
fn back_ends_agree_on_a_terrain_in_a_room() {
    agree("terrain room", terrain_room(200));
}

/// A random triangle: well-shaped or a sliver, near the origin of coordinates or not.
fn triangle(s: &mut Sampler, index: u64) -> TriangleMesh {
    let mut v = || 2.0 * Vec3::new(s.next_1d(), s.next_1d(), s.next_1d()) - 1.0;
    let (center, a, b) = (v(), v(), v());
    let b = a.lerp(b, [1.0, 0.1, 1e-2, 1e-3][index as usize % 4]);
    let center = center * [1.0, 1e-3][index as usize / 4 % 2];
    TriangleMesh {
        positions: vec![center + a, center + b, center - a].into(),
        indices: vec![[0, 1, 2]],
        ..Default::default()
    }
}

/// A rotation of any axis, a stretch of each axis by 0.1 to 10, and a shift.
fn placement(s: &mut Sampler) -> Transform {
    let mut v = || 2.0 * DVec3::new(s.next_1d() as f64, s.next_1d() as f64, s.next_1d() as f64) - 1.0;
    let turn = DMat4::from_axis_angle(v().normalize(), 3.0 * v().x);
    let stretch = DMat4::from_scale(v().map(|x| 10f64.powf(x)));
    Transform::new(DMat4::from_translation(v()) * turn * stretch).expect("a regular map")
}

/// Counts rays that leave a triangle from a point on it and meet it again.
fn meets_again(kind: AccelKind, instanced: bool, triangles: u64) -> (u32, u32) {
    let (mut again, mut rays) = (0, 0);
    for index in 0..triangles {
        let mut s = sampler(77, index);
        let shapes = vec![Shape::Mesh(Arc::new(triangle(&mut s, index)))];
        let set = if instanced {
            let instances = vec![Instance { group: 0, to_world: placement(&mut s) }];
            GeometrySet { shapes, top: vec![], groups: vec![vec![0]], instances }
        } else {
            GeometrySet { shapes, top: vec![0], ..Default::default() }
        };
        let set = Arc::new(set);
        let accel = Accel::build(kind, set.clone()).expect("both back ends are built in");
        let Shape::Mesh(mesh) = &set.shapes[0] else { unreachable!("made above") };
        for _ in 0..100 {
            let b = warp::uniform_triangle(s.next_2d());
            let [p0, p1, p2] = mesh.triangle(0);
            let local = (1.0 - b.x - b.y) * p0 + b.x * p1 + b.y * p2;
            let p = set.instances.first().map_or(local, |i| i.to_world.point(local));
            let o = p + 2.0 * warp::uniform_sphere(s.next_2d());
            let towards = Ray::new(o, p - o);
            let Some(hit) = accel.intersect(&towards) else { continue };
            let si = set.interaction(&towards, &hit);
            for _ in 0..4 {
                let d = warp::uniform_sphere(s.next_2d());
                rays += 1;
                again += accel.occluded(&si.spawn_ray(d)) as u32;
            }
        }
    }
    (again, rays)
}

#[test]
fn rays_that_leave_a_triangle_do_not_meet_it_again() {
    for kind in [AccelKind::Embree, AccelKind::Bvh] {
        for instanced in [false, true] {
            let (again, rays) = meets_again(kind, instanced, 400);
            println!("{kind:?}, instanced {instanced}: {again} of {rays} rays");
            assert!(rays > 100_000 && again == 0, "{kind:?}, instanced {instanced}: {again} of {rays}");
        }
    }
}
