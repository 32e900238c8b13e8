use super::branches::{Discrete, Place};
use super::{MaxDepth, bounce, roulette};
use crate::bsdf::{Bsdf, LobeMask};
use crate::camera::CameraRay;
use crate::color::Rgb;
use crate::gather::Reading;
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
    /// The lobes whose light is wanted.
    pub lobes: LobeMask,
    /// The lobes that the path goes on at; what comes to them from surfaces it finds itself, as far as it can.
    pub followed: LobeMask,
    pub beta: Rgb,
    pub edges: u32,
    pub length: f32,
}

/// A camera path that scatters at specular and sharp glossy lobes on its way to where photons are read.
///
/// It may go on at one narrow lobe. Photons give a noisy estimate there of what other surfaces scatter widely, and a ray a good
/// one; but what those scatter narrowly themselves, a highlight seen in a glossy floor, photons find better. So after a narrow
/// lobe the path asks for all but the light of narrow lobes, and for none of lights themselves: the rest is left to photons at
/// the first of two narrow lobes that only mirrors are between.
pub(super) struct LobeWalk {
    pub max_depth: MaxDepth,
    pub rr_depth: u32,
    pub hide_emitters: bool,
    /// Splits where that finds bright lights, down to such a share of the path (see [`Discrete::start`]).
    pub least: Option<f32>,
    /// Goes on at a [narrow](LobeMask::NARROW) lobe.
    pub narrow: bool,
}

/// Sums what a path comes upon; `wide` gives the radiance that leaves surfaces with lobes that photons estimate.
struct Sum<T, F> {
    radiance: T,
    wide: F,
}

impl<T: Reading, F: FnMut(&Sight, &mut Sampler, &mut Counters) -> T> Sights for Sum<T, F> {
    #[inline]
    fn light(&mut self, radiance: Rgb) {
        self.radiance += T::from(radiance);
    }

    #[inline]
    fn wide(&mut self, at: &Sight, sampler: &mut Sampler, counters: &mut Counters) {
        self.radiance += (self.wide)(at, sampler, counters) * at.beta;
    }
}

impl LobeWalk {
    /// The radiance of the path of a camera ray, `wide` being what leaves surfaces with lobes that photons estimate.
    #[inline(always)]
    pub fn radiance<T: Reading>(
        &self,
        scene: &Scene,
        camera_ray: &CameraRay,
        sampler: &mut Sampler,
        counters: &mut Counters,
        wide: impl FnMut(&Sight, &mut Sampler, &mut Counters) -> T,
    ) -> T {
        let mut sum = Sum { radiance: T::default(), wide };
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
        // Before a narrow lobe.
        let mut whole = true;
        let mut discrete = self.least.map_or_else(Discrete::off, |least| Discrete::start(scene, least));
        while depth < max_depth {
            // Find the next surface; what leaves the scene sees the environment.
            counters.camera_rays += 1;
            let Some(hit) = scene.hit(&mut ray) else {
                if !hide && whole {
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
                if whole {
                    sights.light(beta * scene.emitted(&si, si.wo) * discrete.share());
                }
            }
            hide = false;
            depth += 1;
            if depth >= max_depth {
                break;
            }
            // Estimate everything that leaves through the diffuse and wide glossy lobes here.
            let bsdf = scene.bsdf(&si);
            let mut lobes = LobeMask::SMOOTH_WIDE;
            let mut followed = LobeMask::SPECULAR;
            if !whole {
                lobes = lobes & !LobeMask::NARROW;
            } else if self.narrow && !bsdf.lobes().intersects(LobeMask::SHARP) {
                // Directions of sharp lobes would be drawn together with those of narrow ones, and a light there could not be
                // told to belong to the one or the other.
                followed |= LobeMask::NARROW;
            }
            if bsdf.lobes().intersects(lobes) {
                let sight = Sight { si: &si, bsdf: &bsdf, lobes, followed, beta, edges: max_depth - depth, length };
                sights.wide(&sight, sampler, counters);
            }
            // Follow the specular and sharp glossy ones, and perhaps the narrow ones.
            if !bsdf.lobes().intersects(followed) {
                break;
            }
            let place = Place { si: &si, bsdf: &bsdf, beta, eta, depth, max_depth: self.max_depth };
            let chosen = bounce(&si, &bsdf, followed, sampler);
            let branches = discrete.scatter(scene, &place, chosen.as_ref().map(|c| &c.1), sampler, counters);
            if whole {
                sights.light(branches);
            }
            let Some((next, s)) = chosen else { break };
            whole &= !s.lobe.intersects(LobeMask::NARROW);
            beta *= s.weight;
            eta *= s.eta;
            ray = next;
            if !roulette(&mut beta, eta, depth, (self.rr_depth, 1.0), sampler) {
                break;
            }
        }
    }
}
