use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3};

use super::surface::{SphereCone, Surface, SurfacePoint, Triangles, triangle_point};
use super::table::{grid_size, tabulate};
use super::{LightContext, LightLe, LightLi, STARTS, StartNumbers, Starts, emit_from_surface};
use crate::color::Rgb;
use crate::geometry::{GeometrySet, Shape, SurfaceInteraction};
use crate::math::{Frame, INV_PI};
use crate::sample::{Distribution2d, warp};
use crate::texture::{ColorParam, Textures};

/// Texture look-ups spent on a textured mesh when it becomes a light.
const PROBES: usize = 1 << 16;

/// A surface that emits diffusely from the side of its geometric normal.
#[derive(Clone, Debug)]
pub struct AreaLight {
    /// Index into [`GeometrySet::shapes`].
    pub shape: u32,
    /// W·m⁻²·sr⁻¹.
    radiance: ColorParam,
    surface: Surface,
    /// Density over the parameters of a textured parallelogram.
    table: Option<Distribution2d>,
    area: f64,
    inv_area: f32,
    /// Mean radiance over the surface.
    mean: Rgb,
}

impl AreaLight {
    /// Makes the shape `shape` emit `radiance` (W·m⁻²·sr⁻¹).
    pub fn new(geometry: &GeometrySet, textures: &Textures, shape: u32, radiance: impl Into<ColorParam>) -> Self {
        let surface = Surface::new(&geometry.shapes[shape as usize]);
        let area = geometry.shapes[shape as usize].area();
        let inv_area = if area > 0.0 { (1.0 / area) as f32 } else { 0.0 };
        let radiance = radiance.into();
        let mut light = Self { shape, radiance, surface, table: None, area, inv_area, mean: Rgb::BLACK };
        match radiance {
            ColorParam::Const(c) => light.mean = c,
            ColorParam::Texture(_) => light.follow_texture(geometry, textures),
        }
        light
    }

    /// Probes the texture for the mean radiance, and for where to sample on parallelograms and meshes.
    fn follow_texture(&mut self, geometry: &GeometrySet, textures: &Textures) {
        let shape = &geometry.shapes[self.shape as usize];
        let value = |p: Option<SurfacePoint>| {
            p.map_or(Rgb::BLACK, |p| {
                textures.color(self.radiance, &self.surface.interaction(shape, self.shape, &p), geometry)
            })
        };
        if let (Surface::Triangles(_), Shape::Mesh(mesh)) = (&self.surface, shape) {
            let count = mesh.indices.len();
            let side = ((PROBES / count.max(1)) as f64).sqrt().clamp(2.0, 64.0) as usize;
            let means: Vec<Rgb> = (0..count as u32)
                .map(|i| tabulate(side, side, |u| value(triangle_point(mesh, i, warp::uniform_triangle(u)))).1)
                .collect();
            // Weigh in f64, so that a million triangles add up.
            let (mut sum, mut area) = (DVec3::ZERO, 0.0);
            for (i, m) in means.iter().enumerate() {
                let a = mesh.triangle_area(i as u32);
                sum += a * DVec3::new(m.r as f64, m.g as f64, m.b as f64);
                area += a;
            }
            let mean = if area > 0.0 { sum / area } else { DVec3::ZERO };
            let floor = 0.1 * mean.element_sum() / 3.0;
            self.mean = Rgb::new(mean.x as f32, mean.y as f32, mean.z as f32);
            self.surface = Surface::Triangles(Triangles::new(mesh, |i| means[i as usize].mean() as f64 + floor));
        } else {
            let (width, height) = grid_size(textures, self.radiance);
            let (table, mean) = tabulate(width, height, |u| value(self.surface.sample(shape, u)));
            self.mean = mean;
            self.table = matches!(self.surface, Surface::Parallelogram(_)).then_some(table);
        }
    }

    /// Mean radiance over the surface, W·m⁻²·sr⁻¹.
    pub(super) fn mean_radiance(&self) -> Rgb {
        self.mean
    }

    /// Area in square scene units.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// The cone of directions to a sphere light from a point outside; other lights are sampled by area. Spheres that
    /// shine inwards too: from outside only their far side could be seen, and the near side hides it.
    #[inline]
    fn cone(&self, p: Vec3) -> Option<SphereCone> {
        match &self.surface {
            Surface::Ball(s) if s.side > 0.0 => SphereCone::new(s, p),
            _ => None,
        }
    }

    /// A point and its density per area.
    #[inline]
    fn sample_point(&self, ctx: &LightContext, u: Vec2) -> Option<(SurfacePoint, f32)> {
        let shape = &ctx.geometry.shapes[self.shape as usize];
        if let Some(table) = &self.table {
            let (u, density) = table.sample(u)?;
            return Some((self.surface.sample(shape, u)?, density * self.inv_area));
        }
        let point = self.surface.sample(shape, u)?;
        Some((point, self.pdf_a(ctx, point.p, point.prim)))
    }

    /// Density per area of sampling the point `p` of triangle `prim`.
    #[inline]
    fn pdf_a(&self, ctx: &LightContext, p: Vec3, prim: u32) -> f32 {
        match (&self.surface, &self.table, &ctx.geometry.shapes[self.shape as usize]) {
            (Surface::Parallelogram(q), Some(table), _) => table.pdf(q.parameters(p)) * self.inv_area,
            (Surface::Triangles(t), _, Shape::Mesh(mesh)) => t.pdf_a(mesh, prim),
            _ => self.inv_area,
        }
    }

    #[inline]
    fn radiance_of(&self, ctx: &LightContext, point: &SurfacePoint) -> Rgb {
        match self.radiance {
            ColorParam::Const(c) => c,
            texture => {
                let shape = &ctx.geometry.shapes[self.shape as usize];
                ctx.textures.color(texture, &self.surface.interaction(shape, self.shape, point), ctx.geometry)
            }
        }
    }

    #[inline(always)]
    pub(super) fn sample_li(&self, ctx: &LightContext, p: Vec3, u: Vec2) -> Option<LightLi> {
        // A plain rectangle, which most lights are, needs neither triangle nor texture coordinates.
        if let (Surface::Parallelogram(q), ColorParam::Const(radiance), None) =
            (&self.surface, self.radiance, &self.table)
        {
            let d = q.position(u) - p;
            let dist_sq = d.length_squared();
            let dist = dist_sq.sqrt();
            let wi = d / dist;
            let cos = -q.n.dot(wi);
            let pdf_w = self.inv_area * dist_sq / cos;
            let seen = cos > 0.0 && pdf_w > 0.0 && pdf_w.is_finite() && !radiance.is_black();
            return seen.then_some(LightLi { wi, dist, radiance, pdf_w, delta: false, p: p + d, n: q.n, p_err: q.err });
        }
        self.sample_li_other(ctx, p, u)
    }

    /// [`AreaLight::sample_li`] of everything but plain rectangles.
    #[inline(never)]
    fn sample_li_other(&self, ctx: &LightContext, p: Vec3, u: Vec2) -> Option<LightLi> {
        if let (Some(cone), Surface::Ball(s)) = (self.cone(p), &self.surface) {
            let (wi, dist, outward) = cone.sample(s.radius, u);
            let point = s.point(outward);
            let radiance = self.radiance_of(ctx, &point);
            let li = LightLi {
                wi,
                dist,
                radiance,
                pdf_w: cone.pdf(),
                delta: false,
                p: point.p,
                n: point.n,
                p_err: point.p_err,
            };
            return (!radiance.is_black()).then_some(li);
        }
        let (point, pdf_a) = self.sample_point(ctx, u)?;
        let d = point.p - p;
        let dist_sq = d.length_squared();
        let dist = dist_sq.sqrt();
        let wi = d / dist;
        let cos = -point.n.dot(wi);
        let pdf_w = pdf_a * dist_sq / cos;
        // Written so that NaN, the back side and a light at no distance give nothing.
        if !(cos > 0.0 && pdf_w > 0.0 && pdf_w.is_finite()) {
            return None;
        }
        let radiance = self.radiance_of(ctx, &point);
        let li = LightLi { wi, dist, radiance, pdf_w, delta: false, p: point.p, n: point.n, p_err: point.p_err };
        (!radiance.is_black()).then_some(li)
    }

    pub(super) fn pdf_li(&self, ctx: &LightContext, p: Vec3, si: &SurfaceInteraction) -> f32 {
        if let Some(cone) = self.cone(p) {
            return cone.pdf();
        }
        let d = si.p - p;
        let dist_sq = d.length_squared();
        let cos = -si.ng.dot(d) / dist_sq.sqrt();
        let pdf_w = self.pdf_a(ctx, si.p, si.prim) * dist_sq / cos;
        if cos > 0.0 && pdf_w.is_finite() { pdf_w } else { 0.0 }
    }

    pub(super) fn radiance_at(&self, ctx: &LightContext, si: &SurfaceInteraction, w: Vec3) -> Rgb {
        if si.ng.dot(w) > 0.0 { ctx.textures.color(self.radiance, si, ctx.geometry) } else { Rgb::BLACK }
    }

    #[inline(always)]
    pub(super) fn sample_le(&self, ctx: &LightContext, u_pos: Vec2, u_dir: Vec2) -> Option<LightLe> {
        // As in `sample_li`.
        if let (Surface::Parallelogram(q), ColorParam::Const(radiance), None) =
            (&self.surface, self.radiance, &self.table)
        {
            return emit((q.position(u_pos), q.n, q.err), self.inv_area, radiance, u_dir);
        }
        self.sample_le_other(ctx, u_pos, u_dir)
    }

    /// [`AreaLight::sample_le`] for many paths at once.
    #[inline(always)]
    pub(super) fn sample_le_all(&self, ctx: &LightContext, numbers: &StartNumbers, out: &mut Starts) {
        match (&self.surface, self.radiance, &self.table) {
            (Surface::Parallelogram(q), ColorParam::Const(radiance), None) => {
                for i in 0..STARTS {
                    let point = (q.position(numbers.pos(i)), q.n, q.err);
                    out.put(i, emit(point, self.inv_area, radiance, numbers.dir(i)));
                }
            }
            (Surface::Ball(ball), ColorParam::Const(radiance), None) => {
                for i in 0..STARTS {
                    let point = ball.point(warp::uniform_sphere(numbers.pos(i)));
                    out.put(i, emit((point.p, point.n, point.p_err), self.inv_area, radiance, numbers.dir(i)));
                }
            }
            _ => self.sample_le_each(ctx, numbers, out),
        }
    }

    #[inline(never)]
    fn sample_le_each(&self, ctx: &LightContext, numbers: &StartNumbers, out: &mut Starts) {
        for i in 0..STARTS {
            out.put(i, self.sample_le_other(ctx, numbers.pos(i), numbers.dir(i)));
        }
    }

    /// [`AreaLight::sample_le`] of everything but plain rectangles.
    #[inline(never)]
    fn sample_le_other(&self, ctx: &LightContext, u_pos: Vec2, u_dir: Vec2) -> Option<LightLe> {
        let (point, pdf_a) = self.sample_point(ctx, u_pos)?;
        emit((point.p, point.n, point.p_err), pdf_a, self.radiance_of(ctx, &point), u_dir)
    }

    pub(super) fn pdf_le(&self, ctx: &LightContext, p: Vec3, n: Vec3, w: Vec3) -> (f32, f32) {
        let pdf_a = if matches!(self.surface, Surface::Triangles(_)) { self.inv_area } else { self.pdf_a(ctx, p, 0) };
        (pdf_a, warp::cosine_hemisphere_pdf(n.dot(w)))
    }

    pub(super) fn pdf_le_at(&self, ctx: &LightContext, si: &SurfaceInteraction, w: Vec3) -> (f32, f32) {
        (self.pdf_a(ctx, si.p, si.prim), warp::cosine_hemisphere_pdf(si.ng.dot(w)))
    }

    /// As [`AreaLight::pdf_le`] at the sampled point of `li`.
    pub(super) fn pdf_le_li(&self, li: &LightLi) -> (f32, f32) {
        let cos = -li.n.dot(li.wi);
        // All surfaces but balls, which may be sampled by solid angle, are sampled by area.
        let pdf_a =
            if matches!(self.surface, Surface::Ball(_)) { self.inv_area } else { li.pdf_w * cos / (li.dist * li.dist) };
        (pdf_a, warp::cosine_hemisphere_pdf(cos))
    }

    /// Density per steradian with which the start of `le` is sampled from `p`.
    pub(super) fn pdf_li_le(&self, p: Vec3, le: &LightLe) -> f32 {
        if let Some(cone) = self.cone(p) {
            return cone.pdf();
        }
        let cos = le.n.dot(le.ray.d);
        let pdf_w = le.pdf_a * (le.p - p).length_squared() / cos;
        if cos > 0.0 && pdf_w.is_finite() { pdf_w } else { 0.0 }
    }

    /// W·m⁻²·sr⁻¹, on the side of the geometric normal.
    pub(super) fn radiance(&self) -> ColorParam {
        self.radiance
    }

    pub(super) fn power(&self) -> Rgb {
        self.mean * (PI * self.area) as f32
    }
}

/// The start of a path at a point, given with its normal and its error bound.
#[inline(always)]
fn emit((p, n, p_err): (Vec3, Vec3, Vec3), pdf_a: f32, radiance: Rgb, u_dir: Vec2) -> Option<LightLe> {
    let local = warp::cosine_hemisphere(u_dir);
    let d = Frame::from_normal(n).to_world(local);
    if radiance.is_black() || !(pdf_a > 0.0 && pdf_a.is_finite() && local.z > 0.0) {
        return None;
    }
    Some(LightLe {
        ray: emit_from_surface(p, n, p_err, d),
        p,
        n,
        p_err,
        radiance,
        // The cosine cancels against its density exactly.
        weight: radiance * (PI as f32 / pdf_a),
        pdf_a,
        pdf_w: local.z * INV_PI,
        delta_position: false,
        delta_direction: false,
        finite: true,
    })
}
