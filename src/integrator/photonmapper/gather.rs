//! Final gather: rays from a diffuse point to others, where the global map is read [Jensen 2001, §8.2].

use super::PhotonMapper;
use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::gather::{met_light, sample_direct};
use crate::geometry::{Ray, SurfaceInteraction};
use crate::integrator::{roulette, specular_bounce};
use crate::math::Vec3;
use crate::sample::Sampler;
use crate::scene::Scene;
use crate::tally::Counters;

/// Gather rays that may follow one another in a corner before the map is read all the same.
const MAX_NESTED_GATHER: u32 = 4;

/// How a gather ray shares a light that it meets at once with shadow rays.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightShare {
    /// Where the ray starts.
    p: Vec3,
    /// Density with which it was chosen.
    pdf: f32,
    /// Shadow rays for each gather ray.
    shadow_rays: f32,
}

impl LightShare {
    /// What the ray along `d` sees of a light at `hit`, or of the environment, with its MIS weight.
    #[inline]
    fn met(&self, scene: &Scene, d: Vec3, hit: Option<&SurfaceInteraction>) -> Rgb {
        let light = met_light(scene, self.p, d, hit, self.pdf, self.shadow_rays);
        light.map_or(Rgb::BLACK, |l| l.emitted * l.weight)
    }
}

impl PhotonMapper<'_> {
    /// One gather ray from `si`, and its light by MIS with `shadow_rays` shadow rays for each gather ray.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn gather_ray(
        &self,
        scene: &Scene,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        shadow_rays: f32,
        nested: u32,
        sampler: &mut Sampler,
        counters: &mut Counters,
    ) -> Rgb {
        let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
        let Some(s) = bsdf.sample(si.wo, u_lobe, u, Mode::Radiance, LobeMask::SMOOTH_WIDE) else {
            return Rgb::BLACK;
        };
        let ray = si.spawn_ray(s.wi);
        let share = LightShare { p: si.p, pdf: s.pdf, shadow_rays };
        s.weight * self.arriving(scene, ray, s.eta, Some(share), nested, sampler, counters).0
    }

    /// Indirect radiance that arrives along `ray` from surfaces that scatter it widely, caustics left out, and the distance
    /// to the first surface. `eta` is the product of the relative indices crossed before. With a `share`, the direct light
    /// that the ray meets at once is added, weighted.
    #[allow(clippy::too_many_arguments)]
    #[inline]
    pub(super) fn arriving(
        &self,
        scene: &Scene,
        mut ray: Ray,
        mut eta: f32,
        share: Option<LightShare>,
        nested: u32,
        sampler: &mut Sampler,
        counters: &mut Counters,
    ) -> (Rgb, f32) {
        let (mut sum, mut beta) = (Rgb::BLACK, Rgb::splat(1.0));
        let mut distance = f32::INFINITY;
        let mut depth = 0;
        loop {
            counters.camera_rays += 1;
            let found = scene.hit(&mut ray);
            // A light met at once is direct light; one met through specular surfaces is in the caustic map.
            let share = share.filter(|_| depth == 0);
            let Some(found) = found else {
                if let Some(share) = share {
                    sum += share.met(scene, ray.d, None);
                }
                break;
            };
            let hit = scene.interaction(&ray, &found);
            if depth == 0 {
                distance = hit.t;
            }
            if let Some(share) = share {
                sum += share.met(scene, ray.d, Some(&hit));
            }
            depth += 1;
            // Read the map where photons are stored.
            let bsdf = scene.bsdf(&hit);
            if bsdf.lobes().intersects(LobeMask::SMOOTH_WIDE) {
                sum += beta * self.scattered(scene, &hit, &bsdf, nested, sampler, counters);
            }
            // Follow the specular and sharp glossy lobes.
            if !bsdf.lobes().intersects(LobeMask::SPECULAR) {
                break;
            }
            let Some((next, s)) = specular_bounce(&hit, &bsdf, sampler) else { break };
            beta *= s.weight;
            eta *= s.eta;
            ray = next;
            if !roulette(&mut beta, eta, depth, (self.settings.rr_depth, 1.0), sampler) {
                break;
            }
        }
        (sum, distance)
    }

    /// Radiance that the point `hit` of a gather ray scatters back along it.
    #[inline]
    fn scattered(
        &self,
        scene: &Scene,
        hit: &SurfaceInteraction,
        bsdf: &Bsdf,
        nested: u32,
        sampler: &mut Sampler,
        counters: &mut Counters,
    ) -> Rgb {
        let estimate = self.maps.global_radiance::<Rgb>(hit, bsdf, counters);
        // The blur of the map would show where the gather ray is short: gather once more there.
        let near = hit.t * hit.t < self.settings.short_gather.powi(2) * estimate.radius_sq;
        if near && nested < MAX_NESTED_GATHER && self.settings.max_depth.is_none() {
            sample_direct(scene, hit, bsdf, LobeMask::SMOOTH_WIDE, 1.0, sampler, counters)
                + self.maps.caustic_radiance::<Rgb>(hit, bsdf, counters)
                + self.gather_ray(scene, hit, bsdf, 1.0, nested + 1, sampler, counters)
        } else {
            estimate.radiance
        }
    }
}
