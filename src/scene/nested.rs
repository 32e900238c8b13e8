//! Clear media in overlapping closed shapes: which interfaces there are, and between what [Schmidt and Budge 2002].
//!
//! A shape whose dielectric has a priority is full of it. Where several overlap, the one with the highest priority is there;
//! of equal priorities, the one that the scene uses first. Rays carry the list of what they are in ([`Interior`]): a surface
//! at which the strongest stays the same is no interface, and rays of all kinds pass it as if it were not there. At the
//! others the strongest media of both sides meet. Dielectrics without a priority are what the scene file says they are.

use std::sync::atomic::{AtomicU64, Ordering};

use super::Scene;
use crate::bsdf::{Filling, Ior, Material, MaterialId};
use crate::camera::CameraRay;
use crate::geometry::{GeometrySet, Hit, Interior, Ray};
use crate::math::{Bounds3, Vec2, Vec3};

/// A direction that no modeller uses, to count crossings along.
const ASKEW: Vec3 = Vec3::new(0.371_390_7, 0.557_086_05, 0.742_781_4);

/// Crossings after which a count is given up.
const MOST_CROSSINGS: usize = 1 << 16;

/// Shapes up to which each has a box of its own.
const MOST_BOXES: usize = 32;

/// The media of a scene that has some with priorities.
pub struct Nested {
    /// By rank, the strongest first; rank 1 is the first.
    fillings: Vec<Filling>,
    /// Rank of what each shape is full of, or 0.
    of_shape: Vec<u8>,
    /// Outside of these boxes is none of it.
    boxes: Vec<Bounds3>,
    /// A lens point and what it lies in: all rays of a pinhole leave from one.
    lens: Option<(Vec3, Interior)>,
    lost: AtomicU64,
    stray: AtomicU64,
}

/// What was counted of crossings that do not add up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NestingFaults {
    /// Media lost because more than [`Interior::CAPACITY`] overlapped.
    pub lost: u64,
    /// Media left that had not been entered: shapes with holes, with normals inwards, or with surfaces that coincide.
    pub stray: u64,
}

impl Nested {
    /// `None` when no material has a priority. Fails with the number of different fillings when there are too many.
    pub(super) fn of(
        materials: &[Material],
        shape_materials: &[MaterialId],
        geometry: &GeometrySet,
    ) -> Result<Option<Self>, usize> {
        let of_shape: Vec<_> = shape_materials.iter().map(|&id| Material::filling(materials, id)).collect();
        let mut fillings: Vec<Filling> = Vec::new();
        for filling in of_shape.iter().flatten() {
            if !fillings.contains(filling) {
                fillings.push(*filling);
            }
        }
        if fillings.is_empty() {
            return Ok(None);
        }
        if fillings.len() > u8::MAX as usize {
            return Err(fillings.len());
        }
        // The sort is stable: of equal priorities the first stays first.
        fillings.sort_by_key(|f| std::cmp::Reverse(f.priority));
        let rank =
            |f: &Option<Filling>| f.and_then(|f| fillings.iter().position(|g| *g == f)).map_or(0, |i| i as u8 + 1);
        let of_shape: Vec<u8> = of_shape.iter().map(rank).collect();
        let boxes = boxes(geometry, |shape| of_shape[shape as usize] != 0);
        Ok(Some(Self { fillings, of_shape, boxes, lens: None, lost: 0.into(), stray: 0.into() }))
    }

    /// The lists on this side and on the other side of a surface that a ray meets from `near`.
    #[inline(never)]
    fn across(&self, near: Interior, shape: u32, entering: bool) -> Interior {
        let medium = self.of_shape[shape as usize];
        if medium == 0 {
            return near;
        }
        if !entering {
            return near.left(medium).unwrap_or_else(|| {
                self.stray.fetch_add(1, Ordering::Relaxed);
                near
            });
        }
        let (far, fits) = near.entered(medium);
        if !fits {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
        far
    }

    /// The relative index where two lists meet, seen from outside of the shape; `None` where the surface has no filling.
    fn met(&self, near: Interior, far: Interior) -> Option<Ior> {
        let (a, b) = (near.top(), far.top());
        if a == b {
            return None;
        }
        // The shape's own medium is on top on one side: it is the stronger of the two.
        let (own, other) = if a == 0 || (b != 0 && b < a) { (b, a) } else { (a, b) };
        let filling = |rank: u8| &self.fillings[rank as usize - 1];
        let outside = if other == 0 { filling(own).ext_ior } else { filling(other).int_ior };
        Some(Ior::new(filling(own).int_ior, outside))
    }

    fn near(&self, p: Vec3) -> bool {
        self.boxes.iter().any(|b| p.cmpge(b.min).all() && p.cmple(b.max).all())
    }
}

/// Boxes around all places of the shapes that are wanted.
fn boxes(geometry: &GeometrySet, wanted: impl Fn(u32) -> bool) -> Vec<Bounds3> {
    let bounds = |shapes: &[u32]| -> Vec<Bounds3> {
        shapes.iter().filter(|s| wanted(**s)).map(|&s| geometry.shape_bounds(s)).collect()
    };
    let mut all = bounds(&geometry.top);
    for i in &geometry.instances {
        all.extend(bounds(&geometry.groups[i.group as usize]).iter().map(|b| i.bounds(b)));
    }
    if all.len() > MOST_BOXES {
        all = vec![all.iter().fold(Bounds3::EMPTY, |a, b| a.union(*b))];
    }
    all
}

impl Scene {
    /// The ray through a point of the film, in the media that it starts in.
    #[inline(always)]
    pub fn camera_ray(&self, film_pos: Vec2, u: Vec2) -> CameraRay {
        let mut c = self.camera.generate_ray(film_pos, u);
        if let Some(nested) = &self.nested {
            c.ray.inside = self.in_front_of_lens(nested, c.lens, c.ray.o);
        }
        c
    }

    /// A ray that leaves a light, in the media that it starts in.
    #[inline]
    pub fn from_light(&self, ray: Ray) -> Ray {
        match &self.nested {
            None => ray,
            Some(nested) => Ray { inside: self.media_at(nested, ray.o), ..ray },
        }
    }

    /// Crossings that did not add up so far; `None` in a scene without priorities.
    pub fn nesting_faults(&self) -> Option<NestingFaults> {
        let n = self.nested.as_ref()?;
        Some(NestingFaults { lost: n.lost.load(Ordering::Relaxed), stray: n.stray.load(Ordering::Relaxed) })
    }

    /// Finds once what a pinhole lies in.
    pub(super) fn place_lens(&mut self) {
        if let Some(nested) = &self.nested {
            let lens = self.camera.generate_ray(Vec2::ZERO, Vec2::splat(0.5)).lens;
            let inside = self.media_at(nested, lens);
            self.nested.as_mut().expect("just seen").lens = Some((lens, inside));
        }
    }

    #[inline(never)]
    fn in_front_of_lens(&self, nested: &Nested, lens: Vec3, o: Vec3) -> Interior {
        if !nested.near(lens) && !nested.near(o) {
            return Interior::NONE;
        }
        let inside = match nested.lens {
            Some((p, inside)) if p == lens => inside,
            _ => self.media_at(nested, lens),
        };
        // Follow the stretch before the near plane.
        let mut ray = Ray { inside, ..Ray::segment(lens, o - lens, 1.0) };
        for _ in 0..MOST_CROSSINGS {
            let Some(hit) = self.accel.intersect(&ray) else { break };
            let d = ray.d;
            ray = self.past(nested, &ray, &hit, Some(o)).0;
            // Moved off the surface, the ray may have gone past its end.
            if ray.d.dot(d) <= 0.0 {
                break;
            }
        }
        ray.inside
    }

    /// What a point lies in: every medium that a ray from there leaves more often than it enters.
    #[inline(never)]
    fn media_at(&self, nested: &Nested, p: Vec3) -> Interior {
        if !nested.near(p) {
            return Interior::NONE;
        }
        let mut left = [0i32; 256];
        let mut ray = Ray::new(p, ASKEW);
        for _ in 0..MOST_CROSSINGS {
            let Some(hit) = self.accel.intersect(&ray) else { break };
            let si = self.geometry.interaction(&ray, &hit);
            left[nested.of_shape[hit.shape as usize] as usize] += if si.wo.dot(si.ng) > 0.0 { -1 } else { 1 };
            ray = Ray::new(si.spawn_origin(ray.d), ray.d);
        }
        // Rank 0 is all that has no filling.
        let inside = (1..=u8::MAX).flat_map(|m| (0..left[m as usize]).map(move |_| m));
        inside.fold(Interior::NONE, |list, m| {
            let (list, fits) = list.entered(m);
            if !fits {
                nested.lost.fetch_add(1, Ordering::Relaxed);
            }
            list
        })
    }

    /// The rest of a ray behind a surface, and whether the surface is an interface. A ray with an end stays aimed at it.
    fn past(&self, nested: &Nested, ray: &Ray, hit: &Hit, end: Option<Vec3>) -> (Ray, bool) {
        let si = self.geometry.interaction(ray, hit);
        let inside = nested.across(ray.inside, hit.shape, si.wo.dot(si.ng) > 0.0);
        let o = si.spawn_origin(ray.d);
        let (d, tmax) = end.map_or((ray.d, ray.tmax - hit.t), |end| (end - o, ray.tmax));
        (Ray { o, d, tmax, passed: ray.passed + hit.t, inside }, inside.top() != ray.inside.top())
    }

    /// The first hit that is more than a surface between the same media, and the ray from behind the last of those.
    #[inline(never)]
    pub(super) fn hit_something(&self, nested: &Nested, mut ray: Ray) -> (Ray, Option<Hit>) {
        loop {
            let hit = self.accel.intersect(&ray);
            let Some(found) = hit.filter(|h| nested.of_shape[h.shape as usize] != 0) else { return (ray, hit) };
            let (next, interface) = self.past(nested, &ray, &found, None);
            if interface {
                return (ray, hit);
            }
            ray = next;
        }
    }

    /// True when nothing but such surfaces is on the ray, up to `end` if it has one.
    #[inline(never)]
    pub(super) fn clear(&self, nested: &Nested, mut ray: Ray, end: Option<Vec3>) -> bool {
        loop {
            let Some(hit) = self.accel.intersect(&ray) else { return true };
            if nested.of_shape[hit.shape as usize] == 0 {
                return false;
            }
            let (next, interface) = self.past(nested, &ray, &hit, end);
            if interface {
                return false;
            }
            // Moved off the surface, the ray may have gone past its end.
            if next.d.dot(ray.d) <= 0.0 {
                return true;
            }
            ray = next;
        }
    }

    /// The lists on both sides of a hit.
    #[inline(always)]
    pub(super) fn sides(&self, near: Interior, shape: u32, entering: bool) -> (Interior, Interior) {
        match &self.nested {
            None => (Interior::NONE, Interior::NONE),
            Some(nested) => (near, nested.across(near, shape, entering)),
        }
    }

    /// The relative index between the media that meet at a point, where overlaps decide it.
    #[inline(always)]
    pub(super) fn met(&self, near: Interior, far: Interior) -> Option<Ior> {
        self.nested.as_ref().and_then(|nested| nested.met(near, far))
    }
}
