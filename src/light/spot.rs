use std::f64::consts::PI;

use glam::{Mat3, Vec2, Vec3};

use super::reach::Cone;
use super::table::{at_uv, tabulate};
use super::{LightContext, LightLe, LightLi, arrive_from_point, axes, emit_from_point};
use crate::color::Rgb;
use crate::geometry::GeometrySet;
use crate::math::{Transform, one_minus_cos, safe_sqrt};
use crate::sample::{Distribution2d, warp};
use crate::texture::{ColorParam, Textures};

/// A point light with a cone around its local +z axis: full inside `beam_width`, falling linearly with the angle to
/// nothing at `cutoff`; optionally seen through a slide.
#[derive(Clone, Debug)]
pub struct Spot {
    position: Vec3,
    axes: Mat3,
    intensity: Rgb,
    slide: Option<ColorParam>,
    beam_width: f32,
    cutoff: f32,
    one_minus_cos_cutoff: f32,
    /// Over (azimuth in turns, (1 − cos θ) as a share of the cone).
    directions: Distribution2d,
    power: Rgb,
}

impl Spot {
    /// `intensity` on the axis in W·sr⁻¹; `cutoff` and `beam_width` in radians, measured from the axis.
    pub fn new(to_world: &Transform, intensity: Rgb, cutoff: f32, beam_width: f32) -> Self {
        let beam_width = beam_width.min(cutoff);
        let mut spot = Self {
            position: to_world.point(Vec3::ZERO),
            axes: axes(to_world),
            intensity,
            slide: None,
            beam_width,
            cutoff,
            one_minus_cos_cutoff: one_minus_cos(cutoff as f64) as f32,
            directions: Distribution2d::default(),
            power: intensity * spot_solid_angle(beam_width as f64, cutoff as f64) as f32,
        };
        spot.directions = tabulate(1, 128, |u| {
            let h = u.y * spot.one_minus_cos_cutoff;
            Rgb::splat(spot.falloff(safe_sqrt(h * (2.0 - h)), 1.0 - h))
        })
        .0;
        spot
    }

    /// The light behind a slide that just covers the cone: texture coordinates run from 0 to 1 across it.
    pub fn with_slide(mut self, geometry: &GeometrySet, textures: &Textures, slide: ColorParam) -> Self {
        self.slide = Some(slide);
        let cone = self.one_minus_cos_cutoff;
        let (directions, mean) = tabulate(128, 128, |u| {
            let local = warp::uniform_cone(Vec2::new(u.y, u.x), cone);
            self.local_intensity(geometry, textures, local)
        });
        self.power = mean * (2.0 * PI * cone as f64) as f32;
        self.directions = directions;
        self
    }

    /// The profile in [0, 1] at an angle θ from the axis, given by `sin θ` and `cos θ`.
    fn falloff(&self, sin_theta: f32, cos_theta: f32) -> f32 {
        // atan2 keeps the digits of narrow cones, which acos loses.
        let theta = sin_theta.atan2(cos_theta);
        if theta >= self.cutoff {
            0.0
        } else if theta <= self.beam_width {
            1.0
        } else {
            (self.cutoff - theta) / (self.cutoff - self.beam_width)
        }
    }

    /// W·sr⁻¹ along the local unit direction `d`.
    fn local_intensity(&self, geometry: &GeometrySet, textures: &Textures, d: Vec3) -> Rgb {
        let full = self.intensity * self.falloff(d.truncate().length(), d.z);
        match self.slide {
            Some(slide) if !full.is_black() => {
                let uv = 0.5 + 0.5 * d.truncate() / (d.z * self.cutoff.tan());
                full * textures.color(slide, &at_uv(uv), geometry)
            }
            _ => full,
        }
    }

    /// W·sr⁻¹ along the unit direction `d`.
    fn intensity(&self, ctx: &LightContext, d: Vec3) -> Rgb {
        self.local_intensity(ctx.geometry, ctx.textures, self.axes.transpose() * d)
    }

    pub(super) fn sample_li(&self, ctx: &LightContext, p: Vec3) -> Option<LightLi> {
        arrive_from_point(self.position, p, |d| self.intensity(ctx, d))
    }

    pub(super) fn sample_le(&self, ctx: &LightContext, u: Vec2) -> Option<LightLe> {
        let (cell, density) = self.directions.sample(u)?;
        let local = warp::uniform_cone(Vec2::new(cell.y, cell.x), self.one_minus_cos_cutoff);
        let pdf_w = density * warp::uniform_cone_pdf(self.one_minus_cos_cutoff);
        let d = self.axes * local;
        let intensity = self.intensity(ctx, d);
        (!intensity.is_black() && pdf_w.is_finite()).then(|| emit_from_point(self.position, d, intensity, pdf_w))
    }

    pub(super) fn pdf_direction(&self, d: Vec3) -> f32 {
        let local = self.axes.transpose() * d;
        let sin_sq = local.truncate().length_squared();
        // 1 − cos θ without cancellation on either side of the equator.
        let h = if local.z > 0.0 { sin_sq / (1.0 + local.z) } else { 1.0 - local.z };
        let y = h / self.one_minus_cos_cutoff;
        if y >= 1.0 {
            return 0.0;
        }
        let azimuth = (local.y.atan2(local.x) / (2.0 * PI) as f32).rem_euclid(1.0);
        self.directions.pdf(Vec2::new(azimuth, y)) * warp::uniform_cone_pdf(self.one_minus_cos_cutoff)
    }

    /// The cone that all its light is in.
    pub(super) fn cone(&self) -> Cone {
        Cone { apex: self.position, axes: self.axes, angle: f64::from(self.cutoff) }
    }

    pub(super) fn power(&self) -> Rgb {
        self.power
    }
}

/// ∫ of the profile over directions, `2π (1 − (sin c − sin b)/(c − b))`, with its digits for narrow cones.
fn spot_solid_angle(b: f64, c: f64) -> f64 {
    let (mid, half) = (0.5 * (b + c), 0.5 * (c - b));
    // The difference quotient is cos m · sinc h, and 1 − cos m · sinc h = (1 − cos m) + cos m · (1 − sinc h).
    let one_minus_sinc =
        if half < 1e-2 { half * half / 6.0 * (1.0 - half * half / 20.0) } else { 1.0 - half.sin() / half };
    2.0 * PI * (one_minus_cos(mid) + mid.cos() * one_minus_sinc)
}
