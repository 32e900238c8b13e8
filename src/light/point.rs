use std::f64::consts::PI;

use glam::{Vec2, Vec3};

use super::{LightLe, LightLi, arrive_from_point, emit_from_point};
use crate::color::Rgb;
use crate::sample::warp;

/// A light that shines from one point equally in all directions.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    pub position: Vec3,
    /// Radiant intensity, W·sr⁻¹.
    pub intensity: Rgb,
}

impl Point {
    pub(super) fn sample_li(&self, p: Vec3) -> Option<LightLi> {
        arrive_from_point(self.position, p, |_| self.intensity)
    }

    #[inline(always)]
    pub(super) fn sample_le(&self, u: Vec2) -> Option<LightLe> {
        let (_, pdf_w) = self.pdf_le();
        let le = emit_from_point(self.position, warp::uniform_sphere(u), self.intensity, pdf_w);
        (!self.intensity.is_black()).then_some(le)
    }

    #[inline(always)]
    pub(super) fn pdf_le(&self) -> (f32, f32) {
        (1.0, (0.25 / PI) as f32)
    }

    pub(super) fn power(&self) -> Rgb {
        self.intensity * (4.0 * PI) as f32
    }
}
