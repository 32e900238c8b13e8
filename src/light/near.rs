//! Where area lights are near in relation to their size.

use super::{Light, LightContext};
use crate::math::{Bounds3, Vec3};

/// Lights above which all count as one.
const MOST_BOXES: usize = 32;

/// How far "near" reaches, in diagonals of a light's box.
const REACH: f32 = 0.5;

/// Places so near to an area light that points sampled on it differ greatly in what they send: the density per area
/// leaves `cos/d²` to the estimate, which has no bound where the light touches a surface.
#[derive(Clone, Debug, Default)]
pub struct NearLights(Vec<Bounds3>);

impl NearLights {
    pub fn new(lights: &[Light], ctx: &LightContext) -> Self {
        let around = |light: &Light| {
            let Light::Area(light) = light else { return None };
            let b = ctx.geometry.shape_bounds(light.shape);
            let reach = Vec3::splat(REACH * b.diagonal());
            (!b.is_empty()).then(|| Bounds3::new(b.min - reach, b.max + reach))
        };
        let boxes: Vec<Bounds3> = lights.iter().filter_map(around).collect();
        if boxes.len() > MOST_BOXES {
            return Self(vec![boxes.iter().fold(Bounds3::EMPTY, |all, b| all.union(*b))]);
        }
        Self(boxes)
    }

    /// Whether a light is near to `p`. Rays that the surface chooses then share its light with shadow rays.
    #[inline]
    pub fn reach(&self, p: Vec3) -> bool {
        self.0.iter().any(|b| b.contains(p))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::geometry::{GeometrySet, Shape, Sphere};
    use crate::light::AreaLight;
    use crate::math::Transform;
    use crate::texture::Textures;

    #[test]
    fn near_is_in_relation_to_the_size_of_the_light() {
        let ball = |x: f32, radius: f32| {
            let center = Vec3::new(x, 0.0, 0.0);
            Shape::Sphere(Sphere { center, radius, flip_normals: false, uv: true, to_world: Transform::IDENTITY })
        };
        let near = |count: u32| {
            let shapes: Vec<Shape> = (0..count).map(|i| ball(100.0 * i as f32, 1.0 + i as f32)).collect();
            let geometry = GeometrySet { shapes, ..Default::default() };
            let textures = Textures::default();
            let ctx =
                LightContext { geometry: &geometry, textures: &textures, scene_sphere: (Vec3::ZERO, 1e4), sky: None };
            let light = |i| Light::Area(AreaLight::new(&geometry, &textures, i, Rgb::WHITE));
            NearLights::new(&(0..count).map(light).collect::<Vec<_>>(), &ctx)
        };
        // Boxes of side 2 and 4: half of their diagonals are 1.7 and 3.5.
        let two = near(2);
        for (x, expected) in [(2.5, true), (3.0, false), (94.0, false), (95.0, true), (105.0, true), (106.0, false)] {
            assert_eq!(two.reach(Vec3::new(x, 0.0, 0.0)), expected, "{x}");
        }
        assert!(!near(0).reach(Vec3::ZERO));
        // Many lights are taken together, and nothing between them is far.
        assert!(near(40).reach(Vec3::new(50.0, 0.0, 0.0)));
    }
}
