use std::f64::consts::PI;

use glam::{Vec2, Vec3};

use super::surface::{SphereCone, Surface, SurfacePoint, sphere_point};
use super::{LightContext, LightLe, LightLi, emit_from_surface};
use crate::color::Rgb;
use crate::geometry::{GeometrySet, SurfaceInteraction};
use crate::math::{Frame, INV_PI};
use crate::sample::warp;

/// A surface that emits diffusely from the side of its geometric normal.
#[derive(Clone, Debug)]
pub struct AreaLight {
    /// Index into [`GeometrySet::shapes`].
    pub shape: u32,
    /// W·m⁻²·sr⁻¹.
    radiance: Rgb,
    surface: Surface,
    area: f64,
    inv_area: f32,
}

impl AreaLight {
    /// Makes the shape `shape` emit `radiance` (W·m⁻²·sr⁻¹).
    pub fn new(geometry: &GeometrySet, shape: u32, radiance: Rgb) -> Self {
        let surface = Surface::new(&geometry.shapes[shape as usize]);
        let area = geometry.shapes[shape as usize].area();
        let inv_area = if area > 0.0 { (1.0 / area) as f32 } else { 0.0 };
        Self { shape, radiance, surface, area, inv_area }
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
            Surface::Sphere(s) if !s.flip_normals => SphereCone::new(s, p),
            _ => None,
        }
    }

    #[inline]
    fn sample_point(&self, ctx: &LightContext, u: Vec2) -> Option<(SurfacePoint, f32)> {
        let point = self.surface.sample(&ctx.geometry.shapes[self.shape as usize], u)?;
        Some((point, self.inv_area))
    }

    pub(super) fn sample_li(&self, ctx: &LightContext, p: Vec3, u: Vec2) -> Option<LightLi> {
        if let (Some(cone), Surface::Sphere(s)) = (self.cone(p), &self.surface) {
            let (wi, dist, outward) = cone.sample(s.radius, u);
            let point = sphere_point(s, outward);
            let radiance = self.radiance_of(&point);
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
        let radiance = self.radiance_of(&point);
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
        let pdf_w = self.pdf_a(ctx, si) * dist_sq / cos;
        if cos > 0.0 && pdf_w.is_finite() { pdf_w } else { 0.0 }
    }

    pub(super) fn radiance_at(&self, _ctx: &LightContext, si: &SurfaceInteraction, w: Vec3) -> Rgb {
        if si.ng.dot(w) > 0.0 { self.radiance } else { Rgb::BLACK }
    }

    pub(super) fn sample_le(&self, ctx: &LightContext, u_pos: Vec2, u_dir: Vec2) -> Option<LightLe> {
        let (point, pdf_a) = self.sample_point(ctx, u_pos)?;
        let local = warp::cosine_hemisphere(u_dir);
        let d = Frame::from_normal(point.n).to_world(local);
        let radiance = self.radiance_of(&point);
        if radiance.is_black() || !(pdf_a > 0.0 && local.z > 0.0) {
            return None;
        }
        Some(LightLe {
            ray: emit_from_surface(point.p, point.n, point.p_err, d),
            p: point.p,
            n: point.n,
            p_err: point.p_err,
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

    pub(super) fn pdf_le(&self, _p: Vec3, n: Vec3, w: Vec3) -> (f32, f32) {
        (self.inv_area, warp::cosine_hemisphere_pdf(n.dot(w)))
    }

    pub(super) fn pdf_le_at(&self, ctx: &LightContext, si: &SurfaceInteraction, w: Vec3) -> (f32, f32) {
        (self.pdf_a(ctx, si), warp::cosine_hemisphere_pdf(si.ng.dot(w)))
    }

    pub(super) fn power(&self) -> Rgb {
        self.radiance * (PI * self.area) as f32
    }

    #[inline]
    fn radiance_of(&self, _point: &SurfacePoint) -> Rgb {
        self.radiance
    }

    /// Density per area of sampling the point `si`.
    #[inline]
    fn pdf_a(&self, _ctx: &LightContext, _si: &SurfaceInteraction) -> f32 {
        self.inv_area
    }
}
