use std::f64::consts::PI;

use glam::{Mat3, Vec2, Vec3};

use super::{LightContext, LightLe, LightLi, arrive_from_point, axes, emit_from_point};
use crate::color::Rgb;
use crate::math::{Transform, one_minus_cos};
use crate::sample::{Distribution2d, warp};

/// Cells of the table from which emission directions are drawn: around the axis and away from it.
const TABLE: (usize, usize) = (1, 128);

/// A point light with a cone around its local +z axis: full inside `beam_width`, falling linearly with the angle to
/// nothing at `cutoff`.
#[derive(Clone, Debug)]
pub struct Spot {
    position: Vec3,
    axes: Mat3,
    intensity: Rgb,
    beam_width: f32,
    cutoff: f32,
    one_minus_cos_cutoff: f32,
    /// Over (azimuth, 1 − cos θ) inside the cone.
    directions: Distribution2d,
}

impl Spot {
    /// `intensity` on the axis in W·sr⁻¹; `cutoff` and `beam_width` in radians, measured from the axis.
    pub fn new(to_world: &Transform, intensity: Rgb, cutoff: f32, beam_width: f32) -> Self {
        let beam_width = beam_width.min(cutoff);
        let one_minus_cos_cutoff = one_minus_cos(cutoff as f64) as f32;
        let mut spot = Self {
            position: to_world.point(Vec3::ZERO),
            axes: axes(to_world),
            intensity,
            beam_width,
            cutoff,
            one_minus_cos_cutoff,
            directions: Distribution2d::default(),
        };
        let cell = |y: usize| {
            let at = |f: f32| {
                let h = (y as f32 + f) / TABLE.1 as f32 * one_minus_cos_cutoff;
                spot.falloff((h * (2.0 - h)).max(0.0).sqrt(), 1.0 - h)
            };
            (0..4).map(|i| at((i as f32 + 0.5) / 4.0)).sum::<f32>() + 1e-3
        };
        let weights: Vec<f32> = (0..TABLE.0 * TABLE.1).map(|i| cell(i / TABLE.0)).collect();
        spot.directions = Distribution2d::new(TABLE.0, TABLE.1, &weights);
        spot
    }

    /// The profile in [0, 1] at an angle θ from the axis, given by `sin θ` and `cos θ`.
    fn falloff(&self, sin_theta: f32, cos_theta: f32) -> f32 {
        // atan2 keeps the digits of narrow cones, which acos loses.
        let theta = sin_theta.atan2(cos_theta);
        if theta <= self.beam_width {
            1.0
        } else if theta < self.cutoff {
            (self.cutoff - theta) / (self.cutoff - self.beam_width)
        } else {
            0.0
        }
    }

    /// W·sr⁻¹ along the unit direction `d`.
    fn intensity(&self, _ctx: &LightContext, d: Vec3) -> Rgb {
        let local = self.axes.transpose() * d;
        self.intensity * self.falloff(local.truncate().length(), local.z)
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
        (!intensity.is_black()).then(|| emit_from_point(self.position, d, intensity, pdf_w))
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

    pub(super) fn power(&self) -> Rgb {
        // ∫ of the profile: 1 − (sin c − sin b)/(c − b), with the difference quotient as a product.
        let (b, c) = (self.beam_width as f64, self.cutoff as f64);
        let half = 0.5 * (c - b);
        let sinc = if half > 0.0 { half.sin() / half } else { 1.0 };
        let mid = 0.5 * (b + c);
        // 1 − cos(m)·sinc(h) = (1 − cos m) + cos m·(1 − sinc h)
        let one_minus_sinc = if half < 1e-2 { half * half / 6.0 * (1.0 - half * half / 20.0) } else { 1.0 - sinc };
        let solid = 2.0 * PI * (one_minus_cos(mid) + mid.cos() * one_minus_sinc);
        self.intensity * solid as f32
    }
}
