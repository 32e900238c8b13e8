//! Where on a light's disc and in which direction a path starts, as points of the unit square: what [`Light::sample_le`] makes
//! of its numbers, the other way round.

use glam::{Vec2, Vec3};

use super::{Light, LightContext};
use crate::math::Frame;
use crate::sample::warp;

impl Light {
    /// Whether the numbers of the place and of the direction of a start are what [`Light::start_numbers`] returns.
    pub fn has_start_numbers(&self) -> (bool, bool) {
        match self {
            Light::Point(_) | Light::Area(_) => (false, true),
            Light::Directional(_) => (true, false),
            Light::Constant(_) => (true, true),
            Light::EnvMap(_) | Light::Spot(_) | Light::Projector(_) => (false, false),
        }
    }

    /// The point of the disc that a distant light shines through, and the direction, of a path that starts at `p` (on a
    /// surface with normal `n`) along `w`. What [`Light::has_start_numbers`] denies is zero.
    #[inline]
    pub fn start_numbers(&self, ctx: &LightContext, p: Vec3, n: Vec3, w: Vec3) -> (Vec2, Vec2) {
        let disc = || {
            let (center, radius) = ctx.scene_sphere;
            warp::concentric_disk_inverse(Frame::from_normal(w).to_local(p - center).truncate() / radius)
        };
        match self {
            Light::Point(_) => (Vec2::ZERO, warp::uniform_sphere_inverse(w)),
            Light::Area(_) => (Vec2::ZERO, warp::concentric_disk_inverse(Frame::from_normal(n).to_local(w).truncate())),
            Light::Directional(_) => (disc(), Vec2::ZERO),
            Light::Constant(_) => (disc(), warp::uniform_sphere_inverse(w)),
            Light::EnvMap(_) | Light::Spot(_) | Light::Projector(_) => (Vec2::ZERO, Vec2::ZERO),
        }
    }
}
