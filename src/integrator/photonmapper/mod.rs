//! Jensen's two-pass photon mapping [Jensen 2001].
//!
//! The paths from light L to eye E over diffuse or wide glossy vertices D and specular or sharp glossy vertices S are
//! shared out so that each is counted once:
//!
//! | paths | estimator |
//! |---|---|
//! | `L S* E` | camera path, with branches where it could go two ways |
//! | `L D S* E` | shadow ray, with MIS against the gather ray that finds the light |
//! | `L S⁺ D S* E` | caustic map at D |
//! | `L (S\|D)* D S* D S* E` | gather ray from the last D through S* to a D, where the global map is read |

mod cache;
mod gather;
mod layers;

pub use layers::{Layer, LayerView};

use super::branches::LEAST_OF_FEW;
use super::lobe_walk::LobeWalk;
use super::{CameraSample, Integrator, MaxDepth, Outputs};
use crate::bsdf::{Bsdf, LobeMask};
use crate::color::Rgb;
use crate::gather::cache::{CacheSettings, IrradianceCache};
use crate::gather::{Both, LookupSettings, PhotonMaps, Reading, sample_direct_unless, sample_lobe_light};
use crate::geometry::SurfaceInteraction;
use crate::math::{INV_PI, Vec3};
use crate::sample::{Sampler, Sequence};
use crate::scene::Scene;
use crate::shoot::{ShootSettings, Target, WalkSettings};
use crate::tally::Counters;

/// Parameters of `photonmapper`, named as in Mitsuba 0.6.
#[derive(Clone, Copy, Debug)]
pub struct PhotonMapperSettings {
    pub max_depth: MaxDepth,
    pub rr_depth: u32,
    pub hide_emitters: bool,
    /// Shadow rays per camera sample.
    pub direct_samples: u32,
    /// Photons wanted in the global map.
    pub global_photons: u64,
    /// Photons wanted in the caustic map; 0 makes none.
    pub caustic_photons: u64,
    /// Aim the emission of caustic photons at what focuses light.
    pub guided_emission: bool,
    /// Indirect light by gather rays over the global map; otherwise the map itself is shown.
    pub final_gather: bool,
    /// Gather rays per camera sample.
    pub final_gather_samples: u32,
    /// Gather once more where a gather ray is shorter than so many radii of the disc that it finds the map averaged over.
    pub short_gather: f32,
    /// Gather rays find irradiance that was computed beforehand.
    pub irradiance_photons: bool,
    /// Interpolate gathered light between few points.
    pub irradiance_cache: Option<CacheSettings>,
    pub lookup: LookupSettings,
    /// Rays from lights that find where no shadow rays are needed; 0 traces all of them.
    pub shadow_photons: u64,
}

impl PhotonMapperSettings {
    /// The maps that these settings need, in the order in which they are made.
    pub fn targets(&self) -> impl Iterator<Item = Target> {
        let indirect = if self.final_gather { Target::Global } else { Target::Indirect };
        let caustic = (self.caustic_photons > 0).then_some(Target::Caustic);
        // Light that meets the camera after one bounce needs no global map.
        let global = (self.global_photons > 0 && self.max_depth.is_none_or(|d| d > 2)).then_some(indirect);
        caustic.into_iter().chain(global)
    }

    /// How the photons of one map are shot.
    pub fn shoot_settings(&self, seed: u64, pass: u64, target: Target, sequence: Sequence) -> ShootSettings {
        let photons = if target == Target::Caustic { self.caustic_photons } else { self.global_photons };
        // A camera path adds one edge to a photon path, a gather ray another.
        let camera_edges = if target == Target::Global { 2 } else { 1 };
        let max_depth = self.max_depth.map(|d| d.saturating_sub(camera_edges));
        let walk = WalkSettings { max_depth, rr_depth: 1, sequence };
        ShootSettings {
            seed,
            pass,
            target,
            walk,
            photons,
            max_paths: photons.saturating_mul(64),
            guided: self.guided_emission,
        }
    }
}

/// The second pass: renders with finished maps.
pub struct PhotonMapper<'a> {
    pub settings: PhotonMapperSettings,
    pub maps: &'a PhotonMaps,
    /// Where gathered light is interpolated from.
    pub cache: Option<&'a IrradianceCache>,
}

impl Integrator for PhotonMapper<'_> {
    fn li(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> Rgb {
        self.walk().radiance(scene, &sample.camera_ray, sampler, counters, |at, sampler, counters| {
            self.wide_lobes(scene, at.si, at.bsdf, at.edges, sampler, counters)
        })
    }
}

impl Outputs<2> for PhotonMapper<'_> {
    /// The radiance, and what it is where the camera's own paths read [narrow](PhotonMaps::narrow) maps.
    fn see(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> [Rgb; 2] {
        let Both { own, narrow } =
            self.walk().radiance(scene, &sample.camera_ray, sampler, counters, |at, sampler, counters| {
                self.wide_lobes::<Both>(scene, at.si, at.bsdf, at.edges, sampler, counters)
            });
        [own, narrow]
    }
}

impl PhotonMapper<'_> {
    /// How camera paths go on to where photons are read.
    fn walk(&self) -> LobeWalk {
        let s = &self.settings;
        LobeWalk {
            max_depth: s.max_depth,
            rr_depth: s.rr_depth,
            hide_emitters: s.hide_emitters,
            least: Some(LEAST_OF_FEW),
            narrow: false,
        }
    }

    /// Radiance that leaves `si` through lobes that photons estimate, over paths of at most `edges` edges more.
    fn wide_lobes<T: Reading>(
        &self,
        scene: &Scene,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        edges: u32,
        sampler: &mut Sampler,
        counters: &mut Counters,
    ) -> T {
        let gathers = self.settings.final_gather && edges >= 2 && self.maps.has_global();
        // Gathered light that the cache knows leaves direct light to the shadow rays.
        let cached = if gathers { self.cached(si, bsdf, counters) } else { None };
        let gathers = gathers && cached.is_none();
        let gather_rays = if gathers { self.settings.final_gather_samples.max(1) } else { 0 };
        let (direct, share) = self.direct(scene, si, bsdf, gather_rays, sampler, counters);
        let mut sum = T::from(direct);
        // Caustics from their map.
        sum += self.maps.caustic_radiance(si, bsdf, counters);
        // Indirect light by gathering over the global map, or from the map of indirect photons itself.
        if gathers {
            let gathered: Rgb = sampler
                .split(gather_rays)
                .map(|mut s| self.gather_ray(scene, si, bsdf, 1.0 / share, 0, &mut s, counters))
                .sum();
            sum += T::from(gathered / gather_rays as f32);
        } else if let Some(cached) = cached {
            sum += T::from(cached);
        } else if edges >= 2 {
            sum += self.maps.global_radiance(si, bsdf, counters).radiance;
        }
        sum
    }

    /// Direct light that leaves `si`, shared between shadow rays and those of `gather_rays` gather rays that meet a light;
    /// and how many of those there are for each shadow ray. Where none are traced, narrow lobes send rays of their own, since
    /// light sampling alone hardly finds them, and so do surfaces near to a light.
    #[inline]
    fn direct(
        &self,
        scene: &Scene,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        gather_rays: u32,
        sampler: &mut Sampler,
        counters: &mut Counters,
    ) -> (Rgb, f32) {
        let shadow_rays = self.settings.direct_samples.max(1);
        let own_rays = gather_rays == 0 && (bsdf.lobes().intersects(LobeMask::GLOSSY) || scene.near_lights.reach(si.p));
        let share = if own_rays { 1.0 } else { gather_rays as f32 / shadow_rays as f32 };
        let direct: Rgb = sampler
            .split(shadow_rays)
            .map(|mut s| {
                let known = |light: usize, wi: Vec3| self.maps.visible(si, light, wi);
                sample_direct_unless(scene, si, bsdf, LobeMask::SMOOTH_WIDE, share, &mut s, counters, known)
            })
            .sum();
        let mut sum = direct / shadow_rays as f32;
        if own_rays {
            let met: Rgb = sampler
                .split(shadow_rays)
                .filter_map(|mut s| sample_lobe_light(scene, si, bsdf, LobeMask::SMOOTH_WIDE, 1.0, &mut s, counters))
                .map(|(weight, light)| weight * (light.emitted * light.weight))
                .sum();
            sum += met / shadow_rays as f32;
        }
        (sum, share)
    }

    /// Gathered radiance that leaves a diffuse point, if the cache has records for it.
    #[inline]
    fn cached(&self, si: &SurfaceInteraction, bsdf: &Bsdf, counters: &mut Counters) -> Option<Rgb> {
        let cache = self.cache?;
        let (albedo, n) = bsdf.diffuse_only(si.wo)?;
        let irradiance = cache.interpolate(si.p, n);
        let count = if irradiance.is_some() { &mut counters.cache_hits } else { &mut counters.cache_misses };
        *count += 1;
        Some(albedo * INV_PI * irradiance?)
    }
}
