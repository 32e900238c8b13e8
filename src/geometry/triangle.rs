use glam::{Vec2, Vec3};

use super::{Hit, Ray, SurfaceInteraction, TriangleMesh};
use crate::math::{Frame, gamma};

/// A ray in the sheared coordinates of the watertight triangle test: axis `k[2]` is where the direction is largest
/// [Woop, Benthin, Wald 2013, "Watertight Ray/Triangle Intersection", §3.1].
#[derive(Clone, Copy, Debug)]
pub struct ShearedRay {
    /// Axis permutation that keeps the handedness.
    pub k: [usize; 3],
    /// Shear of x and y, scale of z.
    pub s: Vec3,
}

impl ShearedRay {
    /// `None` when a coordinate is not finite or the direction is zero: such a ray hits nothing.
    #[inline(always)]
    pub fn new(ray: &Ray) -> Option<Self> {
        if !is_traceable(ray) {
            return None;
        }
        let d = ray.d;
        let [kx, ky, kz] = Self::axes(d);
        let s = Vec3::new(d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]);
        s.z.is_finite().then_some(Self { k: [kx, ky, kz], s })
    }

    /// The axes for a direction, without branches, which directions at random would make slow.
    #[inline(always)]
    pub fn axes(d: Vec3) -> [usize; 3] {
        const AXES: [[[u8; 3]; 2]; 3] = [[[1, 2, 0], [2, 1, 0]], [[2, 0, 1], [0, 2, 1]], [[0, 1, 2], [1, 0, 2]]];
        let a = d.abs();
        let (x, y) = (a.x > a.y, a.y > a.z);
        let x = x & (a.x > a.z);
        // 0 where x is the largest, 1 where y is and exceeds x or equals it, else 2.
        let kz = if x {
            0
        } else if y & (a.y >= a.x) {
            1
        } else {
            2
        };
        // Written out: what is handed to `map` may stay a call.
        let [x, y, z] = AXES[kz][usize::from(d.to_array()[kz] < 0.0)];
        [x as usize, y as usize, z as usize]
    }
}

/// True when a query with this ray is defined; every other ray hits nothing.
#[inline(always)]
pub fn is_traceable(ray: &Ray) -> bool {
    // Zero times what is not finite is NaN.
    let zero = ray.o * 0.0 + ray.d * 0.0;
    zero == Vec3::ZERO && ray.d != Vec3::ZERO && ray.tmax > 0.0
}

/// Watertight triangle test: `(t, u, v)` with `0 < t < tmax`, u and v the weights of the second and third vertex.
///
/// Two triangles with a common edge never let a ray through between them. Both sides are hit.
#[inline]
pub fn intersect_triangle(ray: &Ray, sheared: &ShearedRay, tri: [Vec3; 3]) -> Option<(f32, f32, f32)> {
    PreciseRay::new(ray, sheared.k).intersect(tri.map(|v| sheared.k.map(|i| v[i])), ray.tmax)
}

/// A ray in f64, its axes permuted as in [`ShearedRay`].
#[derive(Clone, Copy, Debug)]
pub struct PreciseRay {
    o: [f64; 3],
    d: [f64; 3],
}

impl PreciseRay {
    #[inline(always)]
    pub fn new(ray: &Ray, [x, y, z]: [usize; 3]) -> Self {
        let (o, d) = (ray.o.to_array(), ray.d.to_array());
        Self::permuted([o[x], o[y], o[z]], [d[x], d[y], d[z]])
    }

    /// From coordinates that are permuted already.
    #[inline(always)]
    pub fn permuted(o: [f32; 3], d: [f32; 3]) -> Self {
        Self { o: [o[0] as f64, o[1] as f64, o[2] as f64], d: [d[0] as f64, d[1] as f64, d[2] as f64] }
    }

    /// [`intersect_triangle`] with a triangle whose corners have permuted coordinates.
    ///
    /// The edge functions of two triangles with a common edge are exactly opposite there, and the rounding of their products
    /// can make them zero but not change their sign; a zero counts as inside. So no ray passes between the two. The sign of
    /// `t` is right for every ray that starts outside the rounding error of the plane, needles included, which f32 cannot
    /// promise.
    #[inline(always)]
    pub fn intersect(&self, tri: [[f32; 3]; 3], tmax: f32) -> Option<(f32, f32, f32)> {
        let edges = self.edges(tri);
        if !edges.inside() {
            return None;
        }
        let (ahead, t, u, v) = edges.at(self.d[2], tmax);
        ahead.then_some((t, u, v))
    }

    /// [`PreciseRay::intersect`] without branches, for loops that are to become vectors: whether it is hit, and `t`, `u`, `v`.
    #[inline(always)]
    pub fn meet(&self, tri: [[f32; 3]; 3], tmax: f32) -> (bool, f32, f32, f32) {
        let edges = self.edges(tri);
        let (ahead, t, u, v) = edges.at(self.d[2], tmax);
        (edges.inside() & ahead, t, u, v)
    }

    #[inline(always)]
    fn edges(&self, tri: [[f32; 3]; 3]) -> Edges {
        let (o, d) = (self.o, self.d);
        // Shear without the division, which only scales all three edge functions by dz².
        let shear = |p: [f32; 3]| {
            let [x, y, z] = [p[0] as f64 - o[0], p[1] as f64 - o[1], p[2] as f64 - o[2]];
            (x * d[2] - d[0] * z, y * d[2] - d[1] * z, z)
        };
        let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (shear(tri[0]), shear(tri[1]), shear(tri[2]));
        Edges { u: cx * by - cy * bx, v: ax * cy - ay * cx, w: bx * ay - by * ax, z: [az, bz, cz] }
    }
}

/// The edge functions of a triangle beside a ray, and the depths of its corners.
#[derive(Clone, Copy)]
struct Edges {
    u: f64,
    v: f64,
    w: f64,
    z: [f64; 3],
}

impl Edges {
    #[inline(always)]
    fn inside(&self) -> bool {
        let Self { u, v, w, .. } = *self;
        !(((u < 0.0) | (v < 0.0) | (w < 0.0)) & ((u > 0.0) | (v > 0.0) | (w > 0.0)))
    }

    /// Whether the plane is met with `0 < t < tmax`; `t` and the weights of the second and third corner.
    #[inline(always)]
    fn at(&self, dz: f64, tmax: f32) -> (bool, f32, f32, f32) {
        let Self { u, v, w, z } = *self;
        let rcp = 1.0 / ((u + v + w) * dz);
        let t = ((u * z[0] + v * z[1] + w * z[2]) * rcp) as f32;
        let rcp = rcp * dz;
        let weight = |x: f64| ((x * rcp) as f32).clamp(0.0, 1.0);
        // An infinite reciprocal or NaN fails the comparisons.
        ((t > 0.0) & (t < tmax), t, weight(v), weight(w))
    }
}

/// The unit normal of a triangle by the right-hand rule; `None` for zero area.
#[inline]
pub fn triangle_normal(p: [Vec3; 3]) -> Option<Vec3> {
    let (n, good) = quick_normal(p);
    if good { Some(n) } else { needle_normal(p) }
}

/// [`triangle_normal`] in f32 alone, and whether that is good enough.
#[inline(always)]
pub fn quick_normal(p: [Vec3; 3]) -> (Vec3, bool) {
    // With an angle of 6° or more between the edges, f32 is good to 20 ulps.
    let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
    let n = e1.cross(e2);
    let len_sq = n.length_squared();
    let wide = len_sq > 0.01 * (e1.length_squared() * e2.length_squared());
    (n / len_sq.sqrt(), wide & (1e-30..1e30).contains(&len_sq))
}

/// [`triangle_normal`] in f64, so that needles keep theirs.
#[cold]
fn needle_normal(p: [Vec3; 3]) -> Option<Vec3> {
    let [a, b, c] = p.map(|p| p.as_dvec3());
    let n = (b - a).cross(c - a);
    let len = n.length();
    (len > 0.0 && len.is_finite()).then(|| (n / len).as_vec3())
}

/// How far off a triangle a ray must start so as not to meet it again, in units of the distance to its farthest corner.
///
/// Plücker tests in f32, which Embree makes, misplace a triangle by about that much whatever the coordinates of the
/// point. Measured: up to 1.0 ε on well-shaped triangles (ε = 2⁻²³), with a long tail on slivers: of 3·10⁶ rays that
/// leave triangles, three quarters of them slivers, 792 met theirs again with 0 here, 70 with 4 ε, 14 with 8 ε. The Rust BVH
/// needs nothing.
pub const RETEST: f32 = 8.0 * f32::EPSILON;

/// Bound on the rounding error of each coordinate of `p = Σ b_i p_i`, and on the error of a test that starts there.
#[inline(always)]
pub fn triangle_point_error(tri: [Vec3; 3], b: [f32; 3], p: Vec3) -> Vec3 {
    let sum = (b[0] * tri[0]).abs() + (b[1] * tri[1]).abs() + (b[2] * tri[2]).abs();
    // At least the largest distance to a corner, at most three times as much.
    let reach = (tri[0] - p).abs().max((tri[1] - p).abs()).max((tri[2] - p).abs()).element_sum();
    gamma(7) * sum + RETEST * reach
}

impl TriangleMesh {
    /// Area of one triangle in the square of the mesh's unit.
    #[inline]
    pub fn triangle_area(&self, prim: u32) -> f64 {
        let [a, b, c] = self.triangle(prim).map(|p| p.as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    }

    /// Total area.
    pub fn area(&self) -> f64 {
        (0..self.indices.len() as u32).map(|i| self.triangle_area(i)).sum()
    }

    /// What is known about a hit on this mesh.
    #[inline(always)]
    pub(super) fn interaction(&self, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        let Hit { t, u, v, prim, .. } = *hit;
        let index = self.indices[prim as usize].map(|i| i as usize);
        let tri = self.triangle(prim);
        let [p0, p1, p2] = tri;
        // Interpolate the point; its error does not grow with the distance to the ray origin.
        let b0 = 1.0 - u - v;
        let p = b0 * p0 + u * p1 + v * p2;
        let p_err = triangle_point_error(tri, [b0, u, v], p);
        // Orient the normals.
        let side = if self.flip_normals { -1.0 } else { 1.0 };
        let ng = side * triangle_normal(tri).unwrap_or_else(|| -ray.d.normalize_or(Vec3::Z));
        let ns = self.normals.as_ref().map_or(ng, |n| {
            let n = b0 * n[index[0]] + u * n[index[1]] + v * n[index[2]];
            let n = n.normalize_or_zero();
            let cos = n.dot(ng);
            if cos > 0.0 {
                n
            } else if cos < 0.0 {
                -n
            } else {
                ng
            }
        });
        // Parametrise by the texture coordinates, or by the barycentric weights.
        let (uv, derivatives) = match &self.uvs {
            Some(uvs) => {
                let [t0, t1, t2] = index.map(|i| uvs[i]);
                (b0 * t0 + u * t1 + v * t2, uv_derivatives(tri, [t0, t1, t2]))
            }
            None => (Vec2::new(u, v), Some((p1 - p0, p2 - p0))),
        };
        let (dpdu, dpdv) = derivatives.unwrap_or_else(|| {
            let f = Frame::from_normal(ng);
            (f.s, f.t)
        });
        SurfaceInteraction {
            p,
            p_err,
            ng,
            ns,
            uv,
            dpdu,
            dpdv,
            wo: unit_or(-ray.d, ng),
            t,
            shape: hit.shape,
            prim,
            instance: hit.instance,
            barycentric: Vec2::new(u, v),
            near: Default::default(),
            far: Default::default(),
        }
    }
}

/// `d` with length 1, left as it is when it has it; `other` for a zero vector.
#[inline(always)]
pub fn unit_or(d: Vec3, other: Vec3) -> Vec3 {
    let unit = d.normalize_or(other);
    if (d.length_squared() - 1.0).abs() < 4.0 * f32::EPSILON { d } else { unit }
}

/// ∂p/∂u and ∂p/∂v of an affine parametrisation; `None` when it is degenerate.
#[inline]
fn uv_derivatives(p: [Vec3; 3], uv: [Vec2; 3]) -> Option<(Vec3, Vec3)> {
    let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
    let (d1, d2) = (uv[1] - uv[0], uv[2] - uv[0]);
    let inv_det = 1.0 / (d1.x * d2.y - d1.y * d2.x);
    let du = (d2.y * e1 - d1.y * e2) * inv_det;
    let dv = (d1.x * e2 - d2.x * e1) * inv_det;
    // The derivatives must span the plane of the triangle.
    let spans = du.as_dvec3().cross(dv.as_dvec3()).length_squared();
    (spans > 0.0 && spans.is_finite()).then_some((du, dv))
}
