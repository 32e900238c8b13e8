use glam::Vec3;

use super::fresnel::fresnel_conductor;
use super::lobe::LobeSample;
use crate::color::Rgb;

/// Mirror reflection about +z.
#[inline]
pub(super) fn mirror(w: Vec3) -> Vec3 {
    Vec3::new(-w.x, -w.y, w.z)
}

/// A smooth conductor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mirror {
    pub eta: Rgb,
    pub k: Rgb,
    pub specular: Rgb,
}

impl Mirror {
    #[inline]
    pub fn sample(&self, wo: Vec3) -> Option<LobeSample> {
        (wo.z > 0.0).then(|| LobeSample::reflection(mirror(wo), self.albedo(wo), 1.0))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.specular * fresnel_conductor(wo.z, self.eta, self.k) } else { Rgb::BLACK }
    }
}
