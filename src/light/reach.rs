//! What a light cannot do, proven from its kind and place.

use glam::{Mat3, Vec3};

use super::{Light, LightContext};
use crate::color::Rgb;
use crate::geometry::{Outlook, corners};
use crate::math::Bounds3;

/// Radians by which cones are taken wider than they are.
const MARGIN: f64 = 1e-4;

impl Light {
    /// True when the light emits nothing anywhere.
    pub fn is_dark(&self, ctx: &LightContext) -> bool {
        let most: Rgb = match self {
            Light::Area(l) => ctx.textures.color_range(l.radiance()).1,
            Light::Constant(l) => l.radiance,
            other => other.power(ctx),
        };
        // What is not a number is not known to be dark.
        most.max_channel() <= 0.0
    }

    /// False when no light goes straight from here to anything inside `bounds`, whatever stands between.
    pub fn may_reach(&self, ctx: &LightContext, bounds: &Bounds3) -> bool {
        if bounds.is_empty() {
            return false;
        }
        match self {
            Light::Area(l) => !Outlook::of(&ctx.geometry.shapes[l.shape as usize]).misses(&corners(bounds), false),
            Light::Spot(l) => l.cone().reaches(bounds),
            Light::Projector(l) => l.cone().reaches(bounds),
            Light::Point(_) | Light::Directional(_) | Light::Constant(_) | Light::EnvMap(_) => true,
        }
    }
}

/// A cone around the +z axis of a frame that holds all light of a source at its apex.
pub(super) struct Cone {
    pub apex: Vec3,
    pub axes: Mat3,
    /// Half of the opening, radians.
    pub angle: f64,
}

impl Cone {
    fn reaches(&self, bounds: &Bounds3) -> bool {
        let (center, radius) = bounds.bounding_sphere();
        let (d, radius) = ((center - self.apex).as_dvec3(), f64::from(radius) * 1.001);
        let dist = d.length();
        // A source inside the sphere may reach it, and so may one whose place rounding has lost.
        if dist <= radius {
            return true;
        }
        let cos = self.axes.z_axis.as_dvec3().dot(d) / dist;
        cos.clamp(-1.0, 1.0).acos() <= self.angle + (radius / dist).asin() + MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cone_reaches_what_it_touches() {
        let cone = Cone { apex: Vec3::ZERO, axes: Mat3::IDENTITY, angle: 0.5 };
        let at = |x: f32, z: f32| Bounds3::new(Vec3::new(x - 0.1, -0.1, z - 0.1), Vec3::new(x + 0.1, 0.1, z + 0.1));
        assert!(cone.reaches(&at(0.0, 1.0)) && cone.reaches(&at(0.5, 1.0)) && cone.reaches(&at(0.0, 0.0)));
        assert!(!cone.reaches(&at(0.0, -1.0)) && !cone.reaches(&at(2.0, 1.0)));
        // tan 0.5 = 0.546; the box's sphere has radius 0.173.
        assert!(cone.reaches(&at(0.72, 1.0)) && !cone.reaches(&at(0.85, 1.0)));
    }
}
