use glam::{DMat4, DVec3, Vec2, Vec3};

use super::{Hit, Interior, NO_INSTANCE, Ray, Shape, TriangleMesh};
use crate::math::{Bounds3, Transform, gamma};

/// A placed copy of a group of shapes.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Index into [`GeometrySet::groups`].
    pub group: u32,
    pub to_world: Transform,
}

/// All geometry of a scene. Indices are stable and are what [`Hit`] refers to.
#[derive(Clone, Debug, Default)]
pub struct GeometrySet {
    pub shapes: Vec<Shape>,
    /// Shapes that stand in the scene as they are.
    pub top: Vec<u32>,
    /// Shapes that exist only through instances.
    pub groups: Vec<Vec<u32>>,
    pub instances: Vec<Instance>,
}

impl Instance {
    /// The ray in the coordinates of the group, with the same parameter `t`. Rounded once from f64.
    #[inline]
    pub fn local_ray(&self, ray: &Ray) -> Ray {
        let inv = self.to_world.inverse_matrix();
        Ray {
            o: inv.transform_point3(ray.o.as_dvec3()).as_vec3(),
            d: inv.transform_vector3(ray.d.as_dvec3()).as_vec3(),
            ..*ray
        }
    }

    /// The point in scene space, with an error bound that also covers the way back of the next ray into the group.
    fn place(&self, local: SurfaceInteraction, wo: Vec3) -> SurfaceInteraction {
        let (m, inv) = (self.to_world.matrix(), self.to_world.inverse_matrix());
        let p = m.transform_point3(local.p.as_dvec3());
        let abs = |m: &DMat4, v: DVec3| {
            m.x_axis.truncate().abs() * v.x + m.y_axis.truncate().abs() * v.y + m.z_axis.truncate().abs() * v.z
        };
        // Add the rounding of a ray origin in the group to the error of the point, then carry both through the map.
        let back = abs(inv, p.abs()) + inv.w_axis.truncate().abs();
        let local_err = local.p_err.as_dvec3() + back * gamma(3) as f64;
        let p_err = abs(m, local_err) + p.abs() * gamma(3) as f64;
        let ng = self.to_world.normal(local.ng).normalize_or(local.ng);
        let ns = self.to_world.normal(local.ns).normalize_or(ng);
        SurfaceInteraction {
            p: p.as_vec3(),
            p_err: p_err.as_vec3(),
            ng,
            ns: if ns.dot(ng) < 0.0 { -ns } else { ns },
            dpdu: self.to_world.vector(local.dpdu),
            dpdv: self.to_world.vector(local.dpdv),
            wo,
            ..local
        }
    }

    /// The box of the placed group, given the box of the group.
    pub fn bounds(&self, group: &Bounds3) -> Bounds3 {
        if group.is_empty() {
            return *group;
        }
        // Widen by the rounding of the corners.
        let b = self.to_world.bounds(group);
        let m = self.to_world.matrix();
        let reach = group.min.abs().max(group.max.abs()).as_dvec3();
        let sum = m.x_axis.truncate().abs() * reach.x
            + m.y_axis.truncate().abs() * reach.y
            + m.z_axis.truncate().abs() * reach.z
            + m.w_axis.truncate().abs();
        let pad = gamma(8) * sum.as_vec3();
        Bounds3::new(b.min - pad, b.max + pad)
    }
}

impl GeometrySet {
    /// Heap bytes of all mesh buffers.
    pub fn memory(&self) -> usize {
        let mesh = |s: &Shape| if let Shape::Mesh(m) = s { m.memory() } else { 0 };
        self.shapes.iter().map(mesh).sum::<usize>() + size_of_val(&self.shapes[..]) + size_of_val(&self.instances[..])
    }

    /// The box of one shape, in scene space or in its group's space.
    pub fn shape_bounds(&self, shape: u32) -> Bounds3 {
        self.shapes[shape as usize].bounds()
    }

    /// The box of a group of shapes, in the group's space.
    pub fn group_bounds(&self, group: u32) -> Bounds3 {
        self.groups[group as usize].iter().fold(Bounds3::EMPTY, |b, &s| b.union(self.shape_bounds(s)))
    }

    /// The box of all geometry in the scene, instances included.
    pub fn bounds(&self) -> Bounds3 {
        let groups: Vec<_> = (0..self.groups.len() as u32).map(|g| self.group_bounds(g)).collect();
        let top = self.top.iter().fold(Bounds3::EMPTY, |b, &s| b.union(self.shape_bounds(s)));
        self.instances.iter().fold(top, |b, i| b.union(i.bounds(&groups[i.group as usize])))
    }

    /// What is known about the point that `ray` hit.
    ///
    /// Always inlined for meshes: a caller that took the result through memory would wait for the stores of its parts.
    #[inline(always)]
    pub fn interaction(&self, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        if let (Shape::Mesh(mesh), NO_INSTANCE) = (&self.shapes[hit.shape as usize], hit.instance) {
            return mesh.interaction(ray, hit);
        }
        self.other_interaction(ray, hit)
    }

    /// The mesh whose triangle was hit, if it is not instanced.
    #[inline(always)]
    pub fn own_mesh(&self, hit: &Hit) -> Option<&TriangleMesh> {
        match &self.shapes[hit.shape as usize] {
            Shape::Mesh(mesh) if hit.instance == NO_INSTANCE => Some(mesh),
            _ => None,
        }
    }

    /// Brings what [`GeometrySet::interaction`] will read of large meshes into the caches, for many hits at a time: one waits
    /// for memory while the others do.
    pub fn touch(&self, hits: &[Option<Hit>]) {
        let mut sum = 0.0;
        for hit in hits.iter().flatten() {
            if let Shape::Mesh(mesh) = &self.shapes[hit.shape as usize] {
                let p = mesh.positions.as_slice();
                let index = mesh.indices[hit.prim as usize];
                sum += index.iter().map(|&i| p[i as usize].x).sum::<f32>();
            }
        }
        std::hint::black_box(sum);
    }

    /// [`GeometrySet::interaction`] on analytic shapes and instances.
    #[inline(never)]
    fn other_interaction(&self, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        let instance = (hit.instance != NO_INSTANCE).then(|| &self.instances[hit.instance as usize]);
        let local_ray = instance.map_or(*ray, |i| i.local_ray(ray));
        // Find the point in the space of the shape.
        let mut si = match &self.shapes[hit.shape as usize] {
            Shape::Mesh(m) => m.interaction(&local_ray, hit),
            Shape::Sphere(s) => s.interaction(&local_ray, hit.t),
            Shape::Disk(s) => s.interaction(&local_ray, hit.t),
            Shape::Cylinder(s) => s.interaction(&local_ray, hit.t),
        };
        // Carry it to scene space.
        if let Some(instance) = instance {
            si = instance.place(si, -ray.d.normalize_or(Vec3::Z));
        }
        SurfaceInteraction { shape: hit.shape, prim: hit.prim, instance: hit.instance, ..si }
    }
}

/// The point that a ray hit.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    pub p: Vec3,
    /// Bound on the absolute rounding error of each coordinate of `p`.
    pub p_err: Vec3,
    /// Geometric unit normal, on the side that the shape calls outside.
    pub ng: Vec3,
    /// Shading unit normal, in the hemisphere of `ng`.
    pub ns: Vec3,
    pub uv: Vec2,
    /// ∂p/∂u and ∂p/∂v; perpendicular fallbacks where the parametrisation degenerates.
    pub dpdu: Vec3,
    pub dpdv: Vec3,
    /// Back along the ray, a unit vector.
    pub wo: Vec3,
    /// Ray parameter.
    pub t: f32,
    pub shape: u32,
    pub prim: u32,
    pub instance: u32,
    /// Barycentric weights of the second and third vertex, for mesh attributes.
    pub barycentric: Vec2,
    /// The media with priorities around the point, on the side of `wo` and on the other.
    pub near: Interior,
    pub far: Interior,
}

impl SurfaceInteraction {
    /// An origin for a ray that leaves along `w`, safely on that side of the surface.
    #[inline]
    pub fn spawn_origin(&self, w: Vec3) -> Vec3 {
        crate::math::offset_ray_origin(self.p, self.p_err, self.ng, w)
    }

    /// The media on the side of `w`.
    #[inline]
    pub fn inside(&self, w: Vec3) -> Interior {
        if self.near == self.far || (w.dot(self.ng) > 0.0) == (self.wo.dot(self.ng) > 0.0) {
            return self.near;
        }
        self.far
    }

    /// The ray that leaves along `w`.
    #[inline]
    pub fn spawn_ray(&self, w: Vec3) -> Ray {
        Ray { inside: self.inside(w), ..Ray::new(self.spawn_origin(w), w) }
    }
}
