//! Uniform points on emitting surfaces.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::table::at_uv;
use crate::geometry::{RETEST, Shape, SurfaceInteraction, TriangleMesh, triangle_normal, triangle_point_error};
use crate::math::{Frame, gamma, safe_sqrt};
use crate::sample::{Cdf, warp};

/// A sampled point of an emitting surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub p: Vec3,
    pub p_err: Vec3,
    /// On the emitting side.
    pub n: Vec3,
    pub prim: u32,
    /// Barycentric weights on meshes; the point of the unit disc; azimuth in turns and height of a cylinder.
    pub param: Vec2,
}

/// How points of a shape are chosen. Every kind maps the unit square to the surface with constant area density.
#[derive(Clone, Debug)]
pub(super) enum Surface {
    Parallelogram(Parallelogram),
    Triangles(Triangles),
    Ball(Ball),
    Disk(FlatDisk),
    Cylinder(Tube),
}

/// A sphere, with the sign that turns its outside to the emitting side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ball {
    pub center: Vec3,
    pub radius: f32,
    pub side: f32,
}

/// An elliptic disc `o + x·ax + y·ay`.
#[derive(Clone, Copy, Debug)]
pub(super) struct FlatDisk {
    o: Vec3,
    ax: Vec3,
    ay: Vec3,
    n: Vec3,
}

/// The side of a cylinder, `o + cos φ·ax + sin φ·ay + h·axis`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tube {
    o: Vec3,
    ax: Vec3,
    ay: Vec3,
    axis: Vec3,
    side: f32,
}

impl Surface {
    pub fn new(shape: &Shape) -> Self {
        match shape {
            Shape::Mesh(mesh) => match Parallelogram::from_mesh(mesh) {
                Some(p) => Surface::Parallelogram(p),
                None => Surface::Triangles(Triangles::new(mesh, |_| 1.0)),
            },
            Shape::Sphere(s) => Surface::Ball(Ball { center: s.center, radius: s.radius, side: side(s.flip_normals) }),
            Shape::Disk(d) => Surface::Disk(FlatDisk {
                o: d.to_world.point(Vec3::ZERO),
                ax: d.to_world.vector(Vec3::X),
                ay: d.to_world.vector(Vec3::Y),
                n: side(d.flip_normals) * d.to_world.normal(Vec3::Z).normalize_or_zero(),
            }),
            Shape::Cylinder(c) => Surface::Cylinder(Tube {
                o: c.to_world.point(Vec3::ZERO),
                ax: c.to_world.vector(Vec3::X),
                ay: c.to_world.vector(Vec3::Y),
                axis: c.to_world.vector(Vec3::Z),
                side: side(c.flip_normals),
            }),
        }
    }

    /// What a ray would have found at a sampled point, as far as textures ask for it.
    pub fn interaction(&self, shape: &Shape, id: u32, point: &SurfacePoint) -> SurfaceInteraction {
        let uv = match (self, shape) {
            (Surface::Parallelogram(_) | Surface::Triangles(_), Shape::Mesh(mesh)) => mesh_uv(mesh, point),
            (Surface::Ball(ball), Shape::Sphere(s)) => {
                let outward = (ball.side * point.n).as_dvec3();
                let d = s.to_world.inverse_matrix().transform_vector3(outward).as_vec3();
                Vec2::new(turn(d.truncate()), d.truncate().length().atan2(d.z) / PI)
            }
            (Surface::Disk(_), _) => Vec2::new(point.param.length(), turn(point.param)),
            _ => point.param,
        };
        SurfaceInteraction {
            p: point.p,
            p_err: point.p_err,
            ng: point.n,
            ns: point.n,
            shape: id,
            prim: point.prim,
            barycentric: point.param,
            ..at_uv(uv)
        }
    }

    /// The point that belongs to `u`. `None` only for surfaces without area.
    #[inline]
    pub fn sample(&self, shape: &Shape, u: Vec2) -> Option<SurfacePoint> {
        match (self, shape) {
            (Surface::Parallelogram(q), _) => Some(q.point(u)),
            (Surface::Triangles(t), Shape::Mesh(mesh)) => t.sample(mesh, u),
            (Surface::Ball(ball), _) => Some(ball.point(warp::uniform_sphere(u))),
            (Surface::Disk(d), _) => Some(d.point(u)),
            (Surface::Cylinder(c), _) => Some(c.point(u)),
            // A surface is always made from the shape it is used with.
            (Surface::Triangles(_), _) => None,
        }
    }
}

/// Two triangles that form a parallelogram, sampled as one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Parallelogram {
    origin: Vec3,
    e1: Vec3,
    e2: Vec3,
    /// On the emitting side.
    pub n: Vec3,
    /// Bound on the absolute rounding error of each coordinate of a sampled point.
    pub err: Vec3,
    /// Which corner of triangle 0 and of triangle 1 lies off the shared diagonal (`origin` and the corner opposite).
    corner: [usize; 2],
    /// Which corner of triangle 1 is `origin + e1`.
    other: usize,
}

impl Parallelogram {
    /// `None` unless the mesh is two triangles with a common diagonal that close to a parallelogram.
    pub fn from_mesh(mesh: &TriangleMesh) -> Option<Self> {
        if mesh.indices.len() != 2 {
            return None;
        }
        let (a, b) = (mesh.triangle(0), mesh.triangle(1));
        let i = (0..3).find(|&i| !b.contains(&a[i]))?;
        let j = (0..3).find(|&j| !a.contains(&b[j]))?;
        // Name the corners so that e1 × e2 follows the winding of triangle 0.
        let (origin, p1, p2) = (a[i], a[(i + 1) % 3], a[(i + 2) % 3]);
        let other = b.iter().position(|&p| p == p1)?;
        if !b.contains(&p2) || p1 == p2 {
            return None;
        }
        let (e1, e2) = (p1 - origin, p2 - origin);
        let cross = e1.as_dvec3().cross(e2.as_dvec3());
        let size = e1.length().max(e2.length());
        let closes = (origin + e1 + e2 - b[j]).length() <= 1e-6 * (size + origin.abs().max_element());
        // Both triangles must face the same way, or one half would shine backwards.
        let same_side = cross.dot((b[1] - b[0]).as_dvec3().cross((b[2] - b[0]).as_dvec3())) > 0.0;
        if !(closes && same_side) {
            return None;
        }
        let flip = if mesh.flip_normals { -1.0 } else { 1.0 };
        let n = (cross.normalize() * flip).as_vec3();
        // The corner of the triangles that is farthest from a point is at most the sum of the edges away.
        let err = gamma(6) * (origin.abs() + e1.abs() + e2.abs()) + RETEST * (e1.length() + e2.length());
        Some(Self { origin, e1, e2, n, err, corner: [i, j], other })
    }

    /// The position `origin + s·e1 + t·e2` with `u = (s, t)`.
    #[inline(always)]
    pub fn position(&self, u: Vec2) -> Vec3 {
        self.origin + u.x * self.e1 + u.y * self.e2
    }

    /// The point that belongs to `u`.
    #[inline]
    pub fn point(&self, u: Vec2) -> SurfacePoint {
        let p = self.position(u);
        let mut point = SurfacePoint { p, p_err: self.err, n: self.n, prim: 0, param: Vec2::ZERO };
        // Weights of the corner off the diagonal, of origin + e1 and of origin + e2, in the triangle that is hit.
        let mut b = [0.0; 3];
        if u.x + u.y <= 1.0 {
            let i = self.corner[0];
            (b[i], b[(i + 1) % 3], b[(i + 2) % 3]) = (1.0 - u.x - u.y, u.x, u.y);
        } else {
            point.prim = 1;
            let third = 3 - self.corner[1] - self.other;
            (b[self.corner[1]], b[self.other], b[third]) = (u.x + u.y - 1.0, 1.0 - u.y, 1.0 - u.x);
        }
        point.param = Vec2::new(b[1], b[2]);
        point
    }

    /// The parameters `(s, t)` of a point of the parallelogram, in [0, 1]².
    pub fn parameters(&self, p: Vec3) -> Vec2 {
        let (e1, e2, d) = (self.e1.as_dvec3(), self.e2.as_dvec3(), (p - self.origin).as_dvec3());
        let n = e1.cross(e2);
        let inv = 1.0 / n.length_squared();
        let st = Vec2::new((d.cross(e2).dot(n) * inv) as f32, (e1.cross(d).dot(n) * inv) as f32);
        st.clamp(Vec2::ZERO, Vec2::ONE)
    }
}

/// A mesh whose triangles are chosen by area times a weight.
#[derive(Clone, Debug)]
pub(super) struct Triangles {
    cdf: Cdf,
    area: f64,
    /// Set when the weight differs between triangles; the area density is then not constant.
    weighted: bool,
}

impl Triangles {
    /// `weight` gives each triangle its importance per area.
    pub fn new(mesh: &TriangleMesh, weight: impl Fn(u32) -> f64) -> Self {
        let areas: Vec<f64> = (0..mesh.indices.len() as u32).map(|i| mesh.triangle_area(i)).collect();
        let weights: Vec<f64> = (0..areas.len() as u32).map(weight).collect();
        let weighted = weights.windows(2).any(|w| w[0] != w[1]);
        let cdf = Cdf::new(areas.iter().zip(&weights).map(|(a, w)| a * w));
        Self { cdf, area: areas.iter().sum(), weighted }
    }

    pub fn sample(&self, mesh: &TriangleMesh, u: Vec2) -> Option<SurfacePoint> {
        let (i, _, rest) = self.cdf.sample(u.x)?;
        triangle_point(mesh, i as u32, warp::uniform_triangle(Vec2::new(rest, u.y)))
    }

    /// Density per area at triangle `prim`.
    pub fn pdf_a(&self, mesh: &TriangleMesh, prim: u32) -> f32 {
        if !self.weighted {
            return (1.0 / self.area) as f32;
        }
        let area = mesh.triangle_area(prim);
        if area > 0.0 { (self.cdf.pmf(prim as usize) as f64 / area) as f32 } else { 0.0 }
    }
}

/// The point of a triangle with the given barycentric weights. `None` without area.
pub(super) fn triangle_point(mesh: &TriangleMesh, prim: u32, b: Vec2) -> Option<SurfacePoint> {
    let tri = mesh.triangle(prim);
    let [p0, p1, p2] = tri;
    let (w0, w1, w2) = (1.0 - b.x - b.y, b.x, b.y);
    let n = triangle_normal(tri)?;
    let p = w0 * p0 + w1 * p1 + w2 * p2;
    Some(SurfacePoint {
        p,
        p_err: triangle_point_error(tri, [w0, w1, w2], p),
        n: if mesh.flip_normals { -n } else { n },
        prim,
        param: b,
    })
}
/// Texture coordinates; the barycentric weights themselves on meshes without any, as in Mitsuba.
fn mesh_uv(mesh: &TriangleMesh, point: &SurfacePoint) -> Vec2 {
    let b = point.param;
    match &mesh.uvs {
        Some(uvs) => {
            let [t0, t1, t2] = mesh.indices[point.prim as usize].map(|i| uvs[i as usize]);
            (1.0 - b.x - b.y) * t0 + b.x * t1 + b.y * t2
        }
        None => b,
    }
}

/// The azimuth of a vector in turns, in [0, 1).
fn turn(v: Vec2) -> f32 {
    let t = v.y.atan2(v.x) / (2.0 * PI);
    if t < 0.0 { (t + 1.0).min(1.0f32.next_down()) } else { t }
}

fn side(flip_normals: bool) -> f32 {
    if flip_normals { -1.0 } else { 1.0 }
}

impl Ball {
    /// The point in the direction `outward` from the centre.
    #[inline(always)]
    pub fn point(&self, outward: Vec3) -> SurfacePoint {
        SurfacePoint {
            p: self.center + self.radius * outward,
            p_err: gamma(5) * (self.center.abs() + self.radius * outward.abs()),
            n: self.side * outward,
            prim: 0,
            param: Vec2::ZERO,
        }
    }
}

impl FlatDisk {
    fn point(&self, u: Vec2) -> SurfacePoint {
        let q = warp::concentric_disk(u);
        SurfacePoint {
            p: self.o + q.x * self.ax + q.y * self.ay,
            p_err: gamma(6) * (self.o.abs() + self.ax.abs() + self.ay.abs()),
            n: self.n,
            prim: 0,
            param: q,
        }
    }
}

impl Tube {
    fn point(&self, u: Vec2) -> SurfacePoint {
        let q = Vec2::from_angle(2.0 * PI * u.x);
        let radial = q.x * self.ax + q.y * self.ay;
        SurfacePoint {
            p: self.o + radial + u.y * self.axis,
            p_err: gamma(7) * (self.o.abs() + self.ax.abs() + self.ay.abs() + self.axis.abs()),
            n: self.side * radial.normalize_or_zero(),
            prim: 0,
            param: u,
        }
    }
}

/// The cone under which a sphere is seen from a point outside it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SphereCone {
    /// Unit vector from the centre to the point that sees the sphere.
    axis: Vec3,
    dist: f32,
    sin_max_sq: f32,
    pub one_minus_cos_max: f32,
}

impl SphereCone {
    /// `None` from inside.
    #[inline]
    pub fn new(s: &Ball, p: Vec3) -> Option<Self> {
        let d = p - s.center;
        let dist_sq = d.length_squared();
        let sin_max_sq = s.radius * s.radius / dist_sq;
        // Written so that NaN counts as inside.
        if !(sin_max_sq < 1.0 && sin_max_sq > 0.0) {
            return None;
        }
        let dist = dist_sq.sqrt();
        // 1 − cos θ = sin² θ / (1 + cos θ) keeps its digits for spheres far away.
        let one_minus_cos_max = sin_max_sq / (1.0 + (1.0 - sin_max_sq).sqrt());
        Some(Self { axis: d / dist, dist, sin_max_sq, one_minus_cos_max })
    }

    #[inline]
    pub fn pdf(&self) -> f32 {
        warp::uniform_cone_pdf(self.one_minus_cos_max)
    }

    /// A direction uniform in the cone: `(wi, distance, outward normal where it meets the sphere)`.
    #[inline]
    pub fn sample(&self, radius: f32, u: Vec2) -> (Vec3, f32, Vec3) {
        let frame = Frame::from_normal(self.axis);
        let h = u.x * self.one_minus_cos_max;
        let (sin_sq, cos) = (h * (2.0 - h), 1.0 - h);
        let side = Vec2::from_angle(2.0 * PI * u.y);
        let to_world = |r: f32, z: f32| frame.to_world((r * side).extend(z));
        let wi = to_world(sin_sq.sqrt(), -cos);
        // Find the near intersection from the sine of its angle at the sphere, sin θ / sin θ_max.
        let ratio = (sin_sq / self.sin_max_sq).min(1.0);
        let depth = safe_sqrt(1.0 - ratio);
        let cos_alpha = (ratio * self.sin_max_sq.sqrt() + cos * depth).clamp(-1.0, 1.0);
        let sin_alpha = safe_sqrt((1.0 - cos_alpha) * (1.0 + cos_alpha));
        (wi, self.dist * cos - radius * depth, to_world(sin_alpha, cos_alpha))
    }
}
