use super::branches::{Discrete, Place};
use super::{MaxDepth, roulette, specular_bounce};
use crate::bsdf::{Bsdf, LobeMask};
use crate::camera::CameraRay;
use crate::color::Rgb;
use crate::geometry::{Ray, SurfaceInteraction};
use crate::sample::Sampler;
use crate::scene::Scene;
use crate::tally::Counters;

/// What a camera path comes upon.
pub(super) trait Sights {
    /// Radiance that a light, or the environment, sends along the path, weighted for the film.
    fn light(&mut self, radiance: Rgb);

    /// A surface with lobes that photons estimate, at the end of `length` scene units of path; paths of at most `edges`
    /// edges may go on from there, and what leaves it counts `beta` times.
    fn wide(&mut self, at: &Sight, sampler: &mut Sampler, counters: &mut Counters);
}

/// See [`Sights::wide`].
pub(super) struct Sight<'a> {
    pub si: &'a SurfaceInteraction,
    pub bsdf: &'a Bsdf,
    pub beta: Rgb,
    pub edges: u32,
    pub length: f32,
}

/// A camera path that scatters at specular and sharp glossy lobes only, on its way to where photons are read.
pub(super) struct LobeWalk {
    pub max_depth: MaxDepth,
    pub rr_depth: u32,
    pub hide_emitters: bool,
    /// Splits where that finds bright lights, down to such a share of the path (see [`Discrete::start`]).
    pub least: Option<f32>,
}

/// Sums what a path comes upon; `wide` gives the radiance that leaves surfaces with lobes that photons estimate.
struct Sum<F> {
    radiance: Rgb,
    wide: F,
}

impl<F: FnMut(&Sight, &mut Sampler, &mut Counters) -> Rgb> Sights for Sum<F> {
    #[inline]
    fn light(&mut self, radiance: Rgb) {
        self.radiance += radiance;
    }

    #[inline]
    fn wide(&mut self, at: &Sight, sampler: &mut Sampler, counters: &mut Counters) {
        self.radiance += at.beta * (self.wide)(at, sampler, counters);
    }
}

impl LobeWalk {
    /// The radiance of the path of a camera ray, `wide` being what leaves surfaces with lobes that photons estimate.
    #[inline(always)]
    pub fn radiance(
        &self,
        scene: &Scene,
        camera_ray: &CameraRay,
        sampler: &mut Sampler,
        counters: &mut Counters,
        wide: impl FnMut(&Sight, &mut Sampler, &mut Counters) -> Rgb,
    ) -> Rgb {
        let mut sum = Sum { radiance: Rgb::BLACK, wide };
        self.follow(scene, camera_ray, &mut sum, sampler, counters);
        sum.radiance
    }

    /// Follows the path of a camera ray and shows what it comes upon.
    #[inline(always)]
    pub fn follow(
        &self,
        scene: &Scene,
        camera_ray: &CameraRay,
        sights: &mut impl Sights,
        sampler: &mut Sampler,
        counters: &mut Counters,
    ) {
        let mut beta = Rgb::splat(camera_ray.weight);
        let mut ray = camera_ray.ray;
        let (mut eta, mut length) = (1.0f32, 0.0f32);
        let mut depth = 0u32;
        let max_depth = self.max_depth.unwrap_or(u32::MAX);
        let mut hide = self.hide_emitters;
        let mut discrete = self.least.map_or_else(Discrete::off, |least| Discrete::start(scene, least));
        while depth < max_depth {
            // Find the next surface; what leaves the scene sees the environment.
            counters.camera_rays += 1;
            let Some(hit) = scene.hit(&mut ray) else {
                if !hide {
                    sights.light(beta * scene.environment_radiance(ray.d) * discrete.share());
                }
                break;
            };
            let si = scene.interaction(&ray, &hit);
            length += si.t;
            if scene.is_emitter(&si) {
                if hide {
                    ray = Ray { tmax: ray.tmax, ..si.spawn_ray(ray.d) };
                    continue;
                }
                sights.light(beta * scene.emitted(&si, si.wo) * discrete.share());
            }
            hide = false;
            depth += 1;
            if depth >= max_depth {
                break;
            }
            // Estimate everything that leaves through the diffuse and wide glossy lobes here.
            let bsdf = scene.bsdf(&si);
            if bsdf.lobes().intersects(LobeMask::SMOOTH_WIDE) {
                let sight = Sight { si: &si, bsdf: &bsdf, beta, edges: max_depth - depth, length };
                sights.wide(&sight, sampler, counters);
            }
            // Follow the specular and sharp glossy ones.
            if !bsdf.lobes().intersects(LobeMask::SPECULAR) {
                break;
            }
            let place = Place { si: &si, bsdf: &bsdf, beta, eta, depth, max_depth: self.max_depth };
            let chosen = specular_bounce(&si, &bsdf, sampler);
            sights.light(discrete.scatter(scene, &place, chosen.as_ref().map(|c| &c.1), sampler, counters));
            let Some((next, s)) = chosen else { break };
            beta *= s.weight;
            eta *= s.eta;
            ray = next;
            if !roulette(&mut beta, eta, depth, self.rr_depth, sampler) {
                break;
            }
        }
    }
}
