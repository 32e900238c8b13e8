//! The Embree back end; the only file that names the sys crate.
//!
//! Meshes are shared with Embree without a copy. Analytic shapes are user geometry that calls the same Rust functions
//! as the Rust BVH, so both back ends find the same points on them.

use std::sync::Arc;

use embree4_sys as rtc;
use glam::Vec3;

use super::{AccelError, AccelOptions, Mode, Quality};
use crate::geometry::{GeometrySet, Hit, NO_INSTANCE, Ray, Shape, TriangleMesh, is_traceable};

/// Embree's tree over all geometry of a scene.
pub struct EmbreeAccel {
    top: rtc::CommittedScene,
    /// Embree's id of all analytic shapes of a scene together; meshes have their shape's index as id.
    quadrics: u32,
    options: AccelOptions,
}

impl EmbreeAccel {
    /// Builds the tree with Embree's threads; the result does not depend on their number.
    pub fn build(set: Arc<GeometrySet>, options: AccelOptions) -> Result<Self, AccelError> {
        build(&set, options).map_err(|e| AccelError::Embree(e.to_string()))
    }

    /// The nearest hit along `ray`.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        if !is_traceable(ray) {
            return None;
        }
        self.top.intersect1(query(ray)).map(|hit| self.translate(hit))
    }

    /// The nearest hits of `rays`, as many as there is room for in `hits`; those of [`EmbreeAccel::intersect`], asked for in
    /// packets of sixteen. What is in `hits` beyond the last ray stays.
    #[inline]
    pub fn intersect_all<'a>(&self, mut rays: impl Iterator<Item = &'a Ray>, hits: &mut [Option<Hit>]) {
        let mut packet = rtc::Packet16::default();
        for hits in hits.chunks_mut(16) {
            packet.set(rays.by_ref().take(hits.len()).map(|ray| if is_traceable(ray) { query(ray) } else { NOTHING }));
            self.top.intersect16(&mut packet, rtc::Coherence::Incoherent);
            for (lane, hit) in hits.iter_mut().enumerate().take(packet.len()) {
                *hit = packet.hit(lane).map(|hit| self.translate(hit));
            }
        }
    }

    /// True when anything lies on `ray`.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        is_traceable(ray) && self.top.occluded1(query(ray))
    }

    /// Bytes that Embree has allocated.
    pub fn memory(&self) -> usize {
        self.top.device().memory()
    }

    /// Name, version and instruction set, for people.
    pub fn description(&self) -> String {
        format!("Embree {}, {}{}", self.top.device().version(), self.top.device().isa(), self.options.description())
    }

    /// Embree's scene, to measure the cost of this layer above it.
    #[doc(hidden)]
    pub fn scene(&self) -> &rtc::CommittedScene {
        &self.top
    }

    #[inline]
    fn translate(&self, hit: rtc::Hit) -> Hit {
        let rtc::Hit { t, u, v, .. } = hit;
        let (shape, prim) = if hit.geometry == self.quadrics { (hit.prim, 0) } else { (hit.geometry, hit.prim) };
        // Instances are numbered behind the shapes and the quadrics.
        let instance = if hit.instance == rtc::NO_INSTANCE { NO_INSTANCE } else { hit.instance - self.quadrics - 1 };
        Hit { t, u, v, shape, prim, instance }
    }
}

/// A query that ends before it begins.
const NOTHING: rtc::Ray = rtc::Ray { origin: [0.0; 3], direction: [0.0, 0.0, 1.0], tnear: 1.0, tfar: 0.0 };

/// Our rays begin behind 0 and end before `tmax`; Embree's begin at `tnear` and end at `tfar`.
#[inline]
fn query(ray: &Ray) -> rtc::Ray {
    rtc::Ray {
        origin: ray.o.to_array(),
        direction: ray.d.to_array(),
        tnear: f32::MIN_POSITIVE,
        tfar: ray.tmax.next_down(),
    }
}

fn build(set: &Arc<GeometrySet>, options: AccelOptions) -> Result<EmbreeAccel, rtc::Error> {
    let device = rtc::Device::new("")?;
    let quadrics = set.shapes.len() as u32;
    // Build each group once, then place it.
    let group = |shapes: &Vec<u32>| scene_of(&device, set, shapes, options)?.commit().map(Arc::new);
    let groups = set.groups.iter().map(group).collect::<Result<Vec<_>, _>>()?;
    let mut top = scene_of(&device, set, &set.top, options)?;
    for (id, instance) in (quadrics + 1..).zip(&set.instances) {
        let columns = instance.to_world.matrix().as_mat4().to_cols_array_2d().map(|[x, y, z, _]| [x, y, z]);
        top.add_instance(id, groups[instance.group as usize].clone(), columns)?;
    }
    Ok(EmbreeAccel { top: top.commit()?, quadrics, options })
}

/// A scene of some of the shapes.
fn scene_of(
    device: &rtc::Device,
    set: &Arc<GeometrySet>,
    shapes: &[u32],
    options: AccelOptions,
) -> Result<rtc::Scene, rtc::Error> {
    let quality = match options.quality {
        Quality::Fast => rtc::Quality::Low,
        Quality::Default => rtc::Quality::Medium,
        Quality::High => rtc::Quality::High,
    };
    let mut scene = rtc::Scene::with(device, quality, options.mode == Mode::Robust)?;
    let mut quadrics = Vec::new();
    for &shape in shapes {
        match &set.shapes[shape as usize] {
            Shape::Mesh(mesh) => scene.add_triangles(shape, mesh.clone(), buffers)?,
            Shape::Sphere(_) | Shape::Disk(_) | Shape::Cylinder(_) => quadrics.push(shape),
        }
    }
    if !quadrics.is_empty() {
        scene.add_user(set.shapes.len() as u32, Arc::new(Quadrics { set: set.clone(), shapes: quadrics }))?;
    }
    Ok(scene)
}

fn buffers(mesh: &TriangleMesh) -> rtc::TriangleBuffers<'_> {
    rtc::TriangleBuffers {
        positions: bytemuck::cast_slice(mesh.positions.padded()),
        vertex_count: mesh.positions.len(),
        indices: &mesh.indices,
    }
}

/// The analytic shapes of a scene; reports the index of the shape as primitive.
struct Quadrics {
    set: Arc<GeometrySet>,
    shapes: Vec<u32>,
}

impl rtc::UserGeometry for Quadrics {
    fn count(&self) -> usize {
        self.shapes.len()
    }

    fn bounds(&self, prim: u32) -> ([f32; 3], [f32; 3]) {
        let b = self.set.shape_bounds(self.shapes[prim as usize]);
        (b.min.to_array(), b.max.to_array())
    }

    #[inline]
    fn intersect(&self, prim: u32, ray: &rtc::Ray) -> Option<rtc::UserHit> {
        let shape = self.shapes[prim as usize];
        let ray = Ray::segment(Vec3::from(ray.origin), Vec3::from(ray.direction), ray.tfar.next_up());
        let t = self.set.shapes[shape as usize].intersect_quadric(&ray)?;
        Some(rtc::UserHit { t, u: 0.0, v: 0.0, normal: [0.0; 3], prim: shape })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3};

    use super::*;
    use crate::geometry::{Disk, Instance, Sphere};
    use crate::math::Transform;

    fn square(z: f32) -> Shape {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        Shape::Mesh(Arc::new(TriangleMesh {
            positions: corners.map(|[x, y]| Vec3::new(x, y, z)).to_vec().into(),
            indices: vec![[0, 1, 2], [0, 2, 3]],
            ..Default::default()
        }))
    }

    fn sphere(center: Vec3, radius: f32) -> Shape {
        Shape::Sphere(Sphere { center, radius, flip_normals: false, uv: true, to_world: Transform::IDENTITY })
    }

    fn built(set: GeometrySet) -> EmbreeAccel {
        EmbreeAccel::build(Arc::new(set), AccelOptions::default()).expect("Embree works on this machine")
    }

    #[test]
    fn hits_carry_our_ids() {
        let disk =
            Disk { to_world: Transform::new(DMat4::from_translation(DVec3::Z)).expect("regular"), flip_normals: true };
        let shapes = vec![square(9.0), sphere(Vec3::new(5.0, 0.0, 0.0), 1.0), square(-3.0), Shape::Disk(disk)];
        let accel = built(GeometrySet { shapes, top: vec![1, 2, 3], ..Default::default() });
        let ids = |o: [f32; 3], d: [f32; 3]| {
            accel.intersect(&Ray::new(o.into(), d.into())).map(|h| (h.t, h.shape, h.prim, h.instance))
        };
        assert_eq!(ids([0.1, 0.2, 0.0], [0.0, 0.0, 1.0]), Some((1.0, 3, 0, NO_INSTANCE)));
        assert_eq!(ids([5.0, 0.0, 4.0], [0.0, 0.0, -2.0]), Some((1.5, 1, 0, NO_INSTANCE)));
        assert_eq!(ids([-0.5, 0.25, 0.0], [0.0, 0.0, -1.0]), Some((3.0, 2, 1, NO_INSTANCE)));
        // Shape 0 is in no list, so it is not there.
        assert_eq!(ids([0.1, 0.2, 2.0], [0.0, 0.0, 1.0]), None);
    }

    #[test]
    fn instances_carry_their_index_and_the_shape_in_the_group() {
        let place = |x, s| Instance {
            group: 0,
            to_world: Transform::new(DMat4::from_translation(DVec3::X * x) * DMat4::from_scale(DVec3::splat(s)))
                .expect("regular"),
        };
        let accel = built(GeometrySet {
            shapes: vec![square(0.0), sphere(Vec3::Z * 4.0, 1.0), square(-8.0)],
            top: vec![2],
            groups: vec![vec![0, 1]],
            instances: vec![place(0.0, 1.0), place(10.0, 2.0)],
        });
        let down = |x: f32| accel.intersect(&Ray::new(Vec3::new(x, 0.2, 20.0), -Vec3::Z)).expect("hit");
        let hit = down(0.5);
        assert_eq!((hit.shape, hit.instance), (1, 0));
        let hit = down(10.5);
        assert_eq!((hit.shape, hit.instance), (1, 1));
        // 8 + 2 sqrt(1 − 0.25² − 0.1²) above the ground.
        assert!((hit.t - (12.0 - 2.0 * (1.0f32 - 0.0725).sqrt())).abs() < 1e-5, "{hit:?}");
        let from_below = accel.intersect(&Ray::new(Vec3::new(11.5, 1.0, -1.0), Vec3::Z)).expect("square");
        assert_eq!((from_below.t, from_below.shape, from_below.prim, from_below.instance), (1.0, 0, 0, 1));
        let ground = accel.intersect(&Ray::new(Vec3::new(0.5, 0.2, -1.0), -Vec3::Z)).expect("ground");
        assert_eq!((ground.t, ground.shape, ground.instance), (7.0, 2, NO_INSTANCE));
    }

    #[test]
    fn every_quality_and_mode_finds_the_same() {
        let shapes: Vec<Shape> = (0..200).map(|i| square(i as f32)).collect();
        let set = Arc::new(GeometrySet { top: (0..200).collect(), shapes, ..Default::default() });
        for quality in [Quality::Fast, Quality::Default, Quality::High] {
            for mode in [Mode::Robust, Mode::Fast] {
                let options = AccelOptions { quality, mode };
                let accel = EmbreeAccel::build(set.clone(), options).expect("Embree works on this machine");
                let hit = accel.intersect(&Ray::new(Vec3::new(0.3, 0.1, 99.5), Vec3::Z)).expect("hit");
                assert_eq!((hit.t, hit.shape, hit.prim), (0.5, 100, 0), "{options:?}");
                assert_eq!(accel.description().ends_with("fast mode"), mode == Mode::Fast);
            }
        }
    }

    /// In packets, whatever else is in them: triangles, analytic shapes, and placed copies of both.
    #[test]
    fn many_rays_at_once_find_what_each_finds() {
        let place = |i: u32| Instance {
            group: 0,
            to_world: Transform::new(
                DMat4::from_translation(DVec3::new(f64::from(i), 3.0, 0.0)) * DMat4::from_rotation_x(f64::from(i)),
            )
            .expect("regular"),
        };
        let mut shapes: Vec<Shape> = (0..40).map(|i| square(i as f32 * 0.1)).collect();
        shapes.extend((0..5).map(|i| sphere(Vec3::new(i as f32, 0.3, 1.0), 0.7)));
        let accel = built(GeometrySet {
            shapes,
            top: (0..45).collect(),
            groups: vec![vec![3, 20, 41]],
            instances: (0..6).map(place).collect(),
        });
        let coordinate = |i: u64| (crate::sample::mix64(i) >> 40) as f32 / (1u64 << 22) as f32 - 2.0;
        let point = |i: u64| Vec3::new(coordinate(3 * i), coordinate(3 * i + 1), coordinate(3 * i + 2));
        let mut rays: Vec<Ray> =
            (0..5000).map(|i| Ray::new(3.0 * point(2 * i), 2.0 * point(2 * i + 1) - 3.0 * point(2 * i))).collect();
        (rays[4].d, rays[17].o.x) = (Vec3::ZERO, f32::NAN);
        let expected: Vec<_> = rays.iter().map(|ray| accel.intersect(ray)).collect();
        let placed = expected.iter().flatten().filter(|hit| hit.instance != NO_INSTANCE).count();
        assert!(placed > 200 && expected.iter().flatten().count() > placed + 500, "{placed} on placed copies");
        for len in [1, 16, 17, 5000] {
            let mut hits = vec![expected[0]; len];
            accel.intersect_all(rays.iter(), &mut hits);
            assert_eq!(hits, expected[..len]);
        }
        let mut hits = [expected[1]; 20];
        accel.intersect_all(rays[..18].iter(), &mut hits);
        assert_eq!((&hits[..18], hits[19]), (&expected[..18], expected[1]));
    }

    #[test]
    fn a_ray_ends_before_tmax() {
        let accel = built(GeometrySet {
            shapes: vec![square(2.0), sphere(Vec3::new(5.0, 0.0, 3.0), 1.0)],
            top: vec![0, 1],
            ..Default::default()
        });
        for x in [0.5, 5.0] {
            let ray = |tmax| Ray::segment(Vec3::new(x, 0.0, 0.0), Vec3::Z, tmax);
            assert_eq!(accel.intersect(&ray(2.0)), None);
            assert!(!accel.occluded(&ray(2.0)));
            assert_eq!(accel.intersect(&ray(2.0f32.next_up())).map(|h| h.t), Some(2.0));
            assert!(accel.occluded(&ray(2.0f32.next_up())));
            assert!(accel.occluded(&ray(f32::INFINITY)));
        }
    }

    #[test]
    fn undefined_rays_and_empty_sets_hit_nothing() {
        let accel = built(GeometrySet { shapes: vec![sphere(Vec3::ZERO, 1.0)], top: vec![0], ..Default::default() });
        for (o, d, tmax) in [
            (Vec3::NAN, Vec3::Z, 1e9),
            (Vec3::ZERO, Vec3::ZERO, 1e9),
            (Vec3::ZERO, Vec3::INFINITY, 1e9),
            (Vec3::ZERO, Vec3::Z, 0.0),
            (Vec3::ZERO, Vec3::Z, -1.0),
            (Vec3::ZERO, Vec3::Z, f32::NAN),
        ] {
            assert_eq!(accel.intersect(&Ray::segment(o, d, tmax)), None);
            assert!(!accel.occluded(&Ray::segment(o, d, tmax)));
        }
        let empty = built(GeometrySet::default());
        assert_eq!(empty.intersect(&Ray::new(Vec3::ZERO, Vec3::Z)), None);
        assert!(accel.memory() > 0 && accel.description().starts_with("Embree "), "{}", accel.description());
    }
}
