//! Which method can see which light.
//!
//! Paths from the light L over diffuse vertices D and mirror-like vertices S to the eye E. A method is put to a scene when
//! it can sample all the paths that carry the scene's light. A method that this file does not know is taken to sample
//! everything: a new one comes in by itself, and is either right or says why it is not.

use std::ops::BitOr;

/// The kinds of paths that carry the light of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Light(u16);

impl Light {
    /// L E: the light itself in view.
    pub const SEEN: Light = Light(1);
    /// L S⁺ E: a light in view through glass or in a mirror.
    pub const MIRRORED: Light = Light(2);
    /// L D E.
    pub const DIRECT: Light = Light(4);
    /// L (S|D)⁺ D E with two diffuse vertices or more.
    pub const INDIRECT: Light = Light(8);
    /// L … D S⁺ E: a surface in view through glass or in a mirror.
    pub const BEHIND_GLASS: Light = Light(16);
    /// L S⁺ D E from a light that has an extent.
    pub const CAUSTIC: Light = Light(32);
    /// L S⁺ D E from a point light or a parallel beam.
    pub const POINT_CAUSTIC: Light = Light(64);
    /// L S⁺ D S⁺ E from a point light or a parallel beam.
    pub const POINT_SDS: Light = Light(128);
    /// Nothing is lit.
    pub const NONE: Light = Light(0);

    const ALL: Light = Light(255);

    fn without(self, other: Light) -> Light {
        Light(self.0 & !other.0)
    }

    fn within(self, other: Light) -> bool {
        self.0 & !other.0 == 0
    }
}

impl BitOr for Light {
    type Output = Light;

    fn bitor(self, o: Light) -> Light {
        Light(self.0 | o.0)
    }
}

/// The light that a method can sample.
fn sampled_by(method: &str) -> Light {
    match method {
        "direct" => Light::SEEN | Light::DIRECT,
        "path" => Light::ALL.without(Light::POINT_CAUSTIC | Light::POINT_SDS),
        "ptracer" => Light::SEEN | Light::DIRECT | Light::INDIRECT | Light::CAUSTIC | Light::POINT_CAUSTIC,
        "bdpt" => Light::ALL.without(Light::POINT_SDS),
        _ => Light::ALL,
    }
}

/// Whether `method` can render a scene lit by `light`.
pub fn can_render(method: &str, light: Light) -> bool {
    light.within(sampled_by(method))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_can_what() {
        assert!(can_render("direct", Light::DIRECT) && !can_render("direct", Light::DIRECT | Light::INDIRECT));
        assert!(can_render("path", Light::CAUSTIC) && !can_render("path", Light::POINT_CAUSTIC));
        assert!(can_render("photonmapper", Light::ALL) && can_render("a method of tomorrow", Light::ALL));
        assert!(!can_render("ptracer", Light::MIRRORED) && can_render("bdpt", Light::POINT_CAUSTIC));
        assert!(can_render("direct", Light::NONE));
    }
}
