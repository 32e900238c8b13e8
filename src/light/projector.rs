use std::f64::consts::PI;

use glam::{Mat3, Vec2, Vec3};

use super::reach::Cone;
use super::table::{at_uv, grid_size, tabulate};
use super::{LightContext, LightLe, LightLi, arrive_from_point, axes, emit_from_point};
use crate::color::Rgb;
use crate::geometry::GeometrySet;
use crate::math::Transform;
use crate::sample::Distribution2d;
use crate::texture::{ColorParam, Textures};

/// A slide projector: the reciprocal of the perspective camera, with +z ahead, x to the left and y up in the slide.
///
/// The slide states the irradiance over π on the plane z = 1; a plane facing the projector is lit without vignetting.
#[derive(Clone, Debug)]
pub struct Projector {
    position: Vec3,
    axes: Mat3,
    /// Tangents of half the horizontal and vertical field of view.
    tan_half: Vec2,
    slide: ColorParam,
    scale: f32,
    /// Density of slide coordinates; uniform for a slide of one colour.
    table: Option<Distribution2d>,
    mean: Rgb,
}

impl Projector {
    /// `slide` times `scale` times π is W·m⁻² at z = 1 (scene units); `fov_x` is the horizontal field of view in radians
    /// and `aspect` the slide's width over its height.
    pub fn new(
        geometry: &GeometrySet,
        textures: &Textures,
        to_world: &Transform,
        (fov_x, aspect): (f64, f64),
        slide: impl Into<ColorParam>,
        scale: f32,
    ) -> Self {
        let slide = slide.into();
        let t = (0.5 * fov_x).tan();
        let (table, mean) = match slide {
            ColorParam::Const(c) => (None, c),
            texture => {
                let (width, height) = grid_size(textures, texture);
                let (table, mean) = tabulate(width, height, |uv| textures.color(texture, &at_uv(uv), geometry));
                (Some(table), mean)
            }
        };
        Self {
            position: to_world.point(Vec3::ZERO),
            axes: axes(to_world),
            tan_half: Vec2::new(t as f32, (t / aspect) as f32),
            slide,
            scale,
            table,
            mean: mean * scale,
        }
    }

    /// Slide coordinates of the local direction `d`, (0, 0) at the top left; `None` outside.
    fn slide_uv(&self, d: Vec3) -> Option<Vec2> {
        let uv = 0.5 - 0.5 * d.truncate() / (d.z * self.tan_half);
        (d.z > 0.0 && uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all()).then_some(uv)
    }

    fn slide_at(&self, ctx: &LightContext, uv: Vec2) -> Rgb {
        match self.slide {
            ColorParam::Const(c) => c * self.scale,
            texture => ctx.textures.color(texture, &at_uv(uv), ctx.geometry) * self.scale,
        }
    }

    /// Density of slide coordinates.
    fn slide_pdf(&self, uv: Vec2) -> f32 {
        self.table.as_ref().map_or(1.0, |t| t.pdf(uv))
    }

    /// Area of the slide at z = 1.
    fn slide_area(&self) -> f32 {
        4.0 * self.tan_half.x * self.tan_half.y
    }

    pub(super) fn sample_li(&self, ctx: &LightContext, p: Vec3) -> Option<LightLi> {
        arrive_from_point(self.position, p, |d| {
            let local = self.axes.transpose() * d;
            let slide = |uv| self.slide_at(ctx, uv) * (PI as f32 / local.z.powi(3));
            self.slide_uv(local).map_or(Rgb::BLACK, slide)
        })
    }

    pub(super) fn sample_le(&self, ctx: &LightContext, u: Vec2) -> Option<LightLe> {
        let (uv, pdf_uv) = match &self.table {
            Some(table) => table.sample(u)?,
            None => (u, 1.0),
        };
        let slide = self.slide_at(ctx, uv);
        let local = ((1.0 - 2.0 * uv) * self.tan_half).extend(1.0).normalize();
        let cos_cubed = local.z.powi(3);
        let pdf_w = pdf_uv / (self.slide_area() * cos_cubed);
        let le = emit_from_point(self.position, self.axes * local, slide * (PI as f32 / cos_cubed), pdf_w);
        (!slide.is_black()).then_some(le)
    }

    pub(super) fn pdf_direction(&self, d: Vec3) -> f32 {
        let local = self.axes.transpose() * d;
        self.slide_uv(local).map_or(0.0, |uv| self.slide_pdf(uv) / (self.slide_area() * local.z.powi(3)))
    }

    /// A cone that all its light is in: around the corners of the slide.
    pub(super) fn cone(&self) -> Cone {
        Cone { apex: self.position, axes: self.axes, angle: f64::from(self.tan_half.length()).atan() }
    }

    pub(super) fn power(&self) -> Rgb {
        self.mean * (PI * self.slide_area() as f64) as f32
    }
}
