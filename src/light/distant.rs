use std::f64::consts::PI;

use glam::{Vec2, Vec3};

use super::{LightContext, LightLe, LightLi};
use crate::color::Rgb;
use crate::geometry::Ray;
use crate::math::Frame;
use crate::sample::warp;

/// Parallel light from infinitely far away.
#[derive(Clone, Copy, Debug)]
pub struct Directional {
    /// Unit direction in which the light travels.
    pub direction: Vec3,
    /// Irradiance on a plane perpendicular to the direction, W·m⁻².
    pub irradiance: Rgb,
}

/// The same radiance from every direction.
#[derive(Clone, Copy, Debug)]
pub struct Constant {
    /// W·m⁻²·sr⁻¹.
    pub radiance: Rgb,
}

impl Directional {
    pub(super) fn sample_li(&self, ctx: &LightContext, p: Vec3) -> Option<LightLi> {
        let li = arrive_from_infinity(ctx, p, -self.direction, self.irradiance, 1.0, true);
        (!self.irradiance.is_black()).then_some(li)
    }

    #[inline(always)]
    pub(super) fn sample_le(&self, ctx: &LightContext, u_pos: Vec2) -> Option<LightLe> {
        let le = emit_from_infinity(ctx, self.direction, self.irradiance, 1.0, true, u_pos);
        (!self.irradiance.is_black()).then_some(le)
    }

    pub(super) fn power(&self, ctx: &LightContext) -> Rgb {
        self.irradiance * ctx.disc_area() as f32
    }
}

impl Constant {
    #[inline(always)]
    pub(super) fn pdf(&self) -> f32 {
        (0.25 / PI) as f32
    }

    pub(super) fn sample_li(&self, ctx: &LightContext, p: Vec3, u: Vec2) -> Option<LightLi> {
        let li = arrive_from_infinity(ctx, p, warp::uniform_sphere(u), self.radiance, self.pdf(), false);
        (!self.radiance.is_black()).then_some(li)
    }

    #[inline(always)]
    pub(super) fn sample_le(&self, ctx: &LightContext, u_pos: Vec2, u_dir: Vec2) -> Option<LightLe> {
        let le = emit_from_infinity(ctx, warp::uniform_sphere(u_dir), self.radiance, self.pdf(), false, u_pos);
        (!self.radiance.is_black()).then_some(le)
    }

    pub(super) fn power(&self, ctx: &LightContext) -> Rgb {
        self.radiance * (4.0 * PI * ctx.disc_area()) as f32
    }
}

/// Light that reaches `p` from the direction `wi`, placed beyond the scene.
pub(super) fn arrive_from_infinity(
    ctx: &LightContext,
    p: Vec3,
    wi: Vec3,
    radiance: Rgb,
    pdf_w: f32,
    delta: bool,
) -> LightLi {
    let (center, radius) = ctx.scene_sphere;
    let reach = 2.0 * radius.max(p.distance(center));
    LightLi { wi, dist: f32::INFINITY, radiance, pdf_w, delta, p: p + reach * wi, n: -wi, p_err: Vec3::ZERO }
}

/// A photon that travels along `d` through a uniform point of the disc that covers the scene.
#[inline(always)]
pub(super) fn emit_from_infinity(
    ctx: &LightContext,
    d: Vec3,
    radiance: Rgb,
    pdf_w: f32,
    delta_direction: bool,
    u_pos: Vec2,
) -> LightLe {
    let (center, radius) = ctx.scene_sphere;
    let disc = radius * warp::concentric_disk(u_pos);
    let p = center + Frame::from_normal(d).to_world(disc.extend(-radius));
    let pdf_a = (1.0 / ctx.disc_area()) as f32;
    LightLe {
        ray: Ray::new(p, d),
        p,
        n: d,
        p_err: Vec3::ZERO,
        radiance,
        weight: radiance / pdf_w * ctx.disc_area() as f32,
        pdf_a,
        pdf_w,
        delta_position: false,
        delta_direction,
        finite: false,
    }
}
