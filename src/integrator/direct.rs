//! Direct light only, as Mitsuba 3's `direct`.

use super::{CameraSample, Integrator};
use crate::bsdf::{Bsdf, LobeMask};
use crate::color::Rgb;
use crate::gather::{sample_direct, sample_lobe_light};
use crate::geometry::{Ray, SurfaceInteraction};
use crate::sample::Sampler;
use crate::scene::Scene;
use crate::tally::Counters;

/// Emitted light and light scattered once.
#[derive(Clone, Copy, Debug)]
pub struct Direct {
    /// Light samples per camera ray.
    pub emitter_samples: u32,
    /// BSDF samples per camera ray.
    pub bsdf_samples: u32,
    pub hide_emitters: bool,
}

impl Default for Direct {
    fn default() -> Self {
        Self { emitter_samples: 1, bsdf_samples: 1, hide_emitters: false }
    }
}

impl Direct {
    /// Half of the direct light: from directions sampled from the BSDF.
    fn by_bsdf(
        &self,
        scene: &Scene,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        sampler: &mut Sampler,
        counters: &mut Counters,
    ) -> Rgb {
        let light_share = self.emitter_samples as f32 / self.bsdf_samples as f32;
        let mut sum = Rgb::BLACK;
        for _ in 0..self.bsdf_samples {
            let found = sample_lobe_light(scene, si, bsdf, LobeMask::ALL, light_share, sampler, counters);
            if let Some((weight, light)) = found {
                sum += weight * light.emitted * (light.weight / self.bsdf_samples as f32);
            }
        }
        sum
    }
}

impl Integrator for Direct {
    fn li(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> Rgb {
        let mut ray = sample.camera_ray.ray;
        let si = loop {
            counters.camera_rays += 1;
            match scene.intersect(&mut ray) {
                None if self.hide_emitters => return Rgb::BLACK,
                None => return sample.camera_ray.weight * scene.environment_radiance(ray.d),
                Some(si) if self.hide_emitters && scene.is_emitter(&si) => {
                    ray = Ray { tmax: ray.tmax, ..si.spawn_ray(ray.d) };
                }
                Some(si) => break si,
            }
        };
        let bsdf = scene.bsdf(&si);
        let mut radiance = scene.emitted(&si, si.wo);
        if bsdf.lobes().intersects(LobeMask::SMOOTH) {
            let n = self.emitter_samples;
            let share = self.bsdf_samples as f32 / n.max(1) as f32;
            let sum: Rgb =
                (0..n).map(|_| sample_direct(scene, &si, &bsdf, LobeMask::ALL, share, sampler, counters)).sum();
            radiance += sum / n.max(1) as f32;
        }
        radiance += self.by_bsdf(scene, &si, &bsdf, sampler, counters);
        sample.camera_ray.weight * radiance
    }
}
