//! Exact spheres, discs and cylinders: robust roots in f64, points re-projected onto the surface.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec2, Vec3};

use super::triangle::is_traceable;
use super::{Cylinder, Disk, Ray, Sphere, SurfaceInteraction};
use crate::math::{Bounds3, Frame, Transform, gamma};

/// Roots of `a t² − 2 b t + c = 0`, smaller first, from the discriminant `disc = (b² − a c) / a`, which the caller
/// computes without cancellation [Haines, Akenine-Möller 2019, "Precision Improvements for Ray/Sphere Intersection"].
#[inline]
fn roots(a: f64, b: f64, c: f64, disc: f64) -> Option<[f64; 2]> {
    let (real, roots) = roots_if_real(a, b, c, disc);
    real.then_some(roots)
}

/// [`roots`] without branches: whether there are any, and what they are then.
#[inline(always)]
fn roots_if_real(a: f64, b: f64, c: f64, disc: f64) -> (bool, [f64; 2]) {
    let q = b + (disc * a).sqrt().copysign(b);
    let (r0, r1) = (c / q, q / a);
    let [r0, r1] = if r0 < r1 { [r0, r1] } else { [r1, r0] };
    ((disc >= 0.0) & (a > 0.0), [r0, r1])
}

/// Rounds a root to f32 if it lies on the ray.
#[inline]
fn on_ray(t: f64, ray: &Ray) -> Option<f32> {
    let t = t as f32;
    (t > 0.0 && t < ray.tmax).then_some(t)
}

/// The smallest box of f32 around an interval box of f64.
fn outward(min: DVec3, max: DVec3) -> Bounds3 {
    let down = |x: f64| if (x as f32) as f64 > x { (x as f32).next_down() } else { x as f32 };
    let up = |x: f64| if ((x as f32) as f64) < x { (x as f32).next_up() } else { x as f32 };
    Bounds3::new(Vec3::new(down(min.x), down(min.y), down(min.z)), Vec3::new(up(max.x), up(max.y), up(max.z)))
}

/// The box of a transformed unit circle at height `z` of the local axis.
fn circle_bounds(to_world: &Transform, z: f64) -> Bounds3 {
    let m = to_world.matrix();
    let (x, y) = (m.x_axis.truncate(), m.y_axis.truncate());
    let half = (x * x + y * y).map(f64::sqrt) * (1.0 + 1e-14);
    let center = to_world.point_f64(DVec3::new(0.0, 0.0, z));
    outward(center - half, center + half)
}

/// The error bound of a point that was computed in f64 under `m` and rounded once.
fn rounded_error(m: &Transform, local: DVec3, p: Vec3) -> Vec3 {
    let m = m.matrix();
    let sum = m.x_axis.truncate().abs() * local.x.abs()
        + m.y_axis.truncate().abs() * local.y.abs()
        + m.z_axis.truncate().abs() * local.z.abs()
        + m.w_axis.truncate().abs();
    // The second term covers the f64 arithmetic of this point and of the next ray that starts at it.
    gamma(3) * p.abs() + (sum * 1e-14).as_vec3()
}

/// An angle in [0, 2π).
fn positive_angle(y: f64, x: f64) -> f64 {
    let a = y.atan2(x);
    if a < 0.0 { a + TAU } else { a }
}

struct Parametrised {
    p: Vec3,
    p_err: Vec3,
    n: Vec3,
    uv: Vec2,
    dpdu: Vec3,
    dpdv: Vec3,
}

impl Parametrised {
    fn finish(self, ray: &Ray, t: f32) -> SurfaceInteraction {
        // Replace derivatives at a pole of the parametrisation.
        let (mut dpdu, mut dpdv) = (self.dpdu, self.dpdv);
        if !(dpdu.length_squared() > 0.0 && dpdv.length_squared() > 0.0 && dpdu.is_finite() && dpdv.is_finite()) {
            let f = Frame::from_normal(self.n);
            let scale = dpdu.length_squared().max(dpdv.length_squared()).sqrt();
            let scale = if scale > 0.0 && scale.is_finite() { scale } else { 1.0 };
            (dpdu, dpdv) = (f.s * scale, f.t * scale);
        }
        SurfaceInteraction {
            p: self.p,
            p_err: self.p_err,
            ng: self.n,
            ns: self.n,
            uv: self.uv,
            dpdu,
            dpdv,
            wo: -ray.d.normalize_or(-self.n),
            t,
            shape: 0,
            prim: 0,
            instance: super::NO_INSTANCE,
            barycentric: Vec2::ZERO,
            near: Default::default(),
            far: Default::default(),
        }
    }
}

impl Sphere {
    /// Smallest ray parameter in `(0, tmax)`.
    pub fn intersect(&self, ray: &Ray) -> Option<f32> {
        if !is_traceable(ray) || self.surely_missed(ray) { None } else { self.intersect_in_f64(ray) }
    }

    pub(super) fn intersect_in_f64(&self, ray: &Ray) -> Option<f32> {
        let (found, t) = self.meet(ray.o, ray.d, ray.tmax);
        found.then_some(t)
    }

    /// [`Sphere::intersect`] of a ray that is [traceable](is_traceable), without branches, for loops that are to become
    /// vectors: whether it is hit, and the ray parameter.
    #[inline(always)]
    pub fn meet(&self, o: Vec3, d: Vec3, tmax: f32) -> (bool, f32) {
        let (o, d) = (o.as_dvec3() - self.center.as_dvec3(), d.as_dvec3());
        let r = self.radius as f64;
        // Measure the miss distance at the closest approach: `b² − ac` would subtract large products. The squares of f32
        // lengths that are subtracted here keep 29 bits more than t.
        let a = d.length_squared();
        let b = -o.dot(d);
        let miss_sq = (o + d * (b / a)).length_squared();
        let (real, [t0, t1]) = roots_if_real(a, b, o.length_squared() - r * r, r * r - miss_sq);
        let (t0, t1) = (t0 as f32, t1 as f32);
        let on_ray = |t: f32| (t > 0.0) & (t < tmax);
        (real & (on_ray(t0) | on_ray(t1)), if on_ray(t0) { t0 } else { t1 })
    }

    /// Whether f32 is enough to tell that the line of the ray misses, or that the ray leads away.
    ///
    /// With ε half of `f32::EPSILON`, `o` is good to ε in each coordinate, so `|o|²` and `(o·d)²/|d|²` are good to 6 ε |o|²
    /// and 12 ε |o|².
    #[inline(always)]
    pub(super) fn surely_missed(&self, ray: &Ray) -> bool {
        const ERROR: f32 = 16.0 * f32::EPSILON;
        let (o, d) = (ray.o - self.center, ray.d);
        let (o_sq, d_sq, b) = (o.length_squared(), d.length_squared(), o.dot(d));
        let (most, r_sq) = (o_sq * d_sq, self.radius * self.radius);
        // Nothing below may be lost under the normal numbers; what overflows fails the comparisons.
        if !(d_sq > 1e-12 && r_sq > 1e-12 && o_sq > 1e-12) {
            return false;
        }
        let beside = most - b * b > (r_sq * (1.0 + ERROR) + o_sq * ERROR) * d_sq;
        let behind = b > 0.0 && b * b > ERROR * most && o_sq * (1.0 - ERROR) > r_sq;
        beside || behind
    }

    pub fn bounds(&self) -> Bounds3 {
        let (c, r) = (self.center.as_dvec3(), DVec3::splat(self.radius as f64));
        outward(c - r, c + r)
    }

    /// Surface area in the square of the scene's unit.
    pub fn area(&self) -> f64 {
        4.0 * PI * (self.radius as f64).powi(2)
    }

    pub(super) fn interaction(&self, ray: &Ray, t: f32) -> SurfaceInteraction {
        let (c, r) = (self.center.as_dvec3(), self.radius as f64);
        // Project the hit point onto the sphere.
        let at = ray.o.as_dvec3() + ray.d.as_dvec3() * t as f64 - c;
        let n = at.try_normalize().unwrap_or(DVec3::Z);
        let p = (c + n * r).as_vec3();
        let p_err = gamma(5) * (self.center.abs() + (n.abs() * r).as_vec3());
        let normal = if self.flip_normals { -n } else { n }.as_vec3();
        let (uv, dpdu, dpdv) = if self.uv { self.parametrise(n) } else { (Vec2::ZERO, Vec3::ZERO, Vec3::ZERO) };
        Parametrised { p, p_err, n: normal, uv, dpdu, dpdv }.finish(ray, t)
    }

    /// Texture coordinates and the derivatives along them where the outward normal is `n`, as in Mitsuba: u = φ/2π, v = θ/π.
    fn parametrise(&self, n: DVec3) -> (Vec2, Vec3, Vec3) {
        let r = self.radius as f64;
        let local = self.to_world.inverse_matrix().transform_vector3(n).try_normalize().unwrap_or(DVec3::Z);
        let (phi, sin) = (positive_angle(local.y, local.x), local.x.hypot(local.y));
        let theta = sin.atan2(local.z);
        let (cos_phi, sin_phi) = if sin > 0.0 { (local.x / sin, local.y / sin) } else { (1.0, 0.0) };
        let tangent = |v: DVec3| self.to_world.vector_f64(v).normalize_or_zero() * r;
        let dpdu = tangent(DVec3::new(-sin_phi, cos_phi, 0.0)) * TAU * sin.max(1e-7);
        let dpdv = tangent(DVec3::new(local.z * cos_phi, local.z * sin_phi, -sin)) * PI;
        (Vec2::new((phi / TAU) as f32, (theta / PI) as f32), dpdu.as_vec3(), dpdv.as_vec3())
    }
}

impl Disk {
    /// The local point in the plane of the disc and its ray parameter.
    #[inline]
    fn local_hit(&self, ray: &Ray) -> (DVec3, f64) {
        let inv = self.to_world.inverse_matrix();
        let (o, d) = (inv.transform_point3(ray.o.as_dvec3()), inv.transform_vector3(ray.d.as_dvec3()));
        let t = -o.z / d.z;
        (DVec3::new(o.x + t * d.x, o.y + t * d.y, 0.0), t)
    }

    /// Ray parameter in `(0, tmax)`.
    pub fn intersect(&self, ray: &Ray) -> Option<f32> {
        if !is_traceable(ray) {
            return None;
        }
        let (p, t) = self.local_hit(ray);
        if p.length_squared() <= 1.0 { on_ray(t, ray) } else { None }
    }

    pub fn bounds(&self) -> Bounds3 {
        circle_bounds(&self.to_world, 0.0)
    }

    /// Surface area in the square of the scene's unit.
    pub fn area(&self) -> f64 {
        let m = self.to_world.matrix();
        PI * m.x_axis.truncate().cross(m.y_axis.truncate()).length()
    }

    pub(super) fn interaction(&self, ray: &Ray, t: f32) -> SurfaceInteraction {
        let (mut local, _) = self.local_hit(ray);
        let radius = local.length();
        if radius > 1.0 {
            local /= radius;
        }
        let p = self.to_world.point_f64(local).as_vec3();
        let p_err = rounded_error(&self.to_world, local, p);
        // Mitsuba's parametrisation: u = radius, v = φ/2π.
        let radial = if radius > 0.0 { local / radius } else { DVec3::X };
        let dpdu = self.to_world.vector_f64(radial);
        let dpdv = self.to_world.vector_f64(DVec3::new(-radial.y, radial.x, 0.0)) * TAU * radius.max(1e-7);
        let n = self.to_world.normal(Vec3::Z).normalize_or(Vec3::Z);
        let n = if self.flip_normals { -n } else { n };
        let uv = Vec2::new(radius.min(1.0) as f32, (positive_angle(local.y, local.x) / TAU) as f32);
        Parametrised { p, p_err, n, uv, dpdu: dpdu.as_vec3(), dpdv: dpdv.as_vec3() }.finish(ray, t)
    }
}

impl Cylinder {
    /// Smallest ray parameter in `(0, tmax)` on the lateral surface.
    pub fn intersect(&self, ray: &Ray) -> Option<f32> {
        if !is_traceable(ray) {
            return None;
        }
        let inv = self.to_world.inverse_matrix();
        let (o, d) = (inv.transform_point3(ray.o.as_dvec3()), inv.transform_vector3(ray.d.as_dvec3()));
        // Intersect the infinite cylinder in the xy plane.
        let (o2, d2) = (o.truncate(), d.truncate());
        let a = d2.length_squared();
        let b = -o2.dot(d2);
        let miss = (o2 + d2 * (b / a)).length();
        let dist = o2.length();
        let roots = roots(a, b, (dist - 1.0) * (dist + 1.0), (1.0 - miss) * (1.0 + miss))?;
        // Keep the first root between the caps.
        roots.into_iter().find_map(|t| {
            let z = o.z + t * d.z;
            if (0.0..=1.0).contains(&z) { on_ray(t, ray) } else { None }
        })
    }

    pub fn bounds(&self) -> Bounds3 {
        circle_bounds(&self.to_world, 0.0).union(circle_bounds(&self.to_world, 1.0))
    }

    /// Area of the lateral surface in the square of the scene's unit.
    pub fn area(&self) -> f64 {
        TAU * self.radius as f64 * self.length as f64
    }

    pub(super) fn interaction(&self, ray: &Ray, t: f32) -> SurfaceInteraction {
        let at = ray.o.as_dvec3() + ray.d.as_dvec3() * t as f64;
        let at = self.to_world.inverse_matrix().transform_point3(at);
        // Project the hit point onto the cylinder.
        let radial = DVec3::new(at.x, at.y, 0.0).try_normalize().unwrap_or(DVec3::X);
        let local = radial + DVec3::Z * at.z.clamp(0.0, 1.0);
        let p = self.to_world.point_f64(local).as_vec3();
        let p_err = rounded_error(&self.to_world, local, p);
        // Mitsuba's parametrisation: u = φ/2π, v = height.
        let dpdu = self.to_world.vector_f64(DVec3::new(-radial.y, radial.x, 0.0)) * TAU;
        let dpdv = self.to_world.vector_f64(DVec3::Z);
        let n = self.to_world.normal(radial.as_vec3()).normalize_or(Vec3::Z);
        let n = if self.flip_normals { -n } else { n };
        let uv = Vec2::new((positive_angle(radial.y, radial.x) / TAU) as f32, local.z as f32);
        Parametrised { p, p_err, n, uv, dpdu: dpdu.as_vec3(), dpdv: dpdv.as_vec3() }.finish(ray, t)
    }
}
