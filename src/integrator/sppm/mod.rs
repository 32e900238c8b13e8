//! Progressive photon mapping: passes of fresh photons and fresh camera paths whose radii shrink so that both noise and
//! blur vanish in the average [Hachisuka and Jensen 2009, Knaus and Zwicker 2011].
//!
//! Camera paths go through specular and sharp glossy lobes to points with diffuse or wide glossy lobes, where two photon
//! maps are read, each within its own radius. With L the light, E the eye, D a diffuse or wide glossy vertex and S a
//! specular or sharp glossy one, every path is counted once:
//!
//! | paths | estimator |
//! |---|---|
//! | `L S* E` | camera path, with branches where it could go two ways |
//! | `L D S* E` | shadow ray, with MIS against a ray that the lobes at D chose |
//! | `L S⁺ D S* E` | caustic photons at D |
//! | `L (S\|D)* D S* D S* E` | indirect photons at the last D |
//!
//! At narrow glossy lobes, G, photons are a noisy estimate: few come from where the lobe looks. There the camera path goes on
//! by one ray, and what it finds at the next D through lobes that are not narrow stands for the indirect photons that came from
//! there. Those that left their last D by a narrow lobe themselves bear a mark and are read at G: light from a highlight is
//! rarely found by a ray, and often by photons. So every path is still counted once:
//!
//! | paths that end with `D S* G S* E` | estimator |
//! |---|---|
//! | the light leaves D by a narrow lobe | marked indirect photons at G |
//! | by another | shadow ray, caustic photons or indirect photons at D |
//!
//! Where a surface ends inside of the disc of an estimate, `boundary_correction` divides by the share of the disc that is
//! surface ([`Patch::share`]), at the first point of a camera path where photons are read. Which pixels that concerns the
//! pilot finds ([`Clearing`](crate::gather::Clearing)); the others' bits do not change.
//!
//! With `photon_sampling` = `visibility` a pass first follows its camera paths to where photons will be read, then samples
//! photon paths by whether one of their photons is read there ([`shoot_visible`](crate::shoot::shoot_visible)), and follows
//! its camera paths again. It pays where few photons come to what the picture shows; where most do, it costs the second look.
//!
//! `vcm` has no such sampling. Its light paths do more than merge: each vertex is also joined to camera paths and to the
//! lens, so that nearly all of them are seen; and its weights compare densities of techniques, while that of a path that a
//! chain finds is known up to a factor only, b, which would have to be estimated before the weights, not beside the sum.
//!
//! Under a depth limit the photons' paths are as long as fits a camera path of one edge; what the camera sees by way of
//! specular surfaces and narrow lobes may then be longer by the edges of that chain.

mod evenness;
mod radii;
mod schedule;
mod sights;

pub(crate) use evenness::{Evenness, NUMBERS as EVENNESS_NUMBERS};
pub use radii::{FoundPhotons, KINDS, PixelRadii, Radii, SharedStatistics};
pub use schedule::{SharedRadius, radius_sq_ratio};
pub use sights::{Sighting, Sightings};

use super::branches::LEAST;
use super::lobe_walk::{LobeWalk, Sight};
use super::{CameraSample, Integrator, MaxDepth, Outputs};
use crate::color::Rgb;
use crate::gather::{Bins, Both, Lobes, NARROW, Patch, RadiusMap, Reading, sample_direct, sample_lobe_light};
use crate::sample::{Sampler, Sequence};
use crate::scene::Scene;
use crate::shoot::{ShootSettings, Target, WalkSettings};
use crate::tally::Counters;

/// Which photon paths a pass traces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PhotonSampling {
    /// Paths that know nothing of each other.
    #[default]
    Independent,
    /// Markov chains among the paths with photons that the pass's camera paths see
    /// ([`shoot_visible`](crate::shoot::shoot_visible)).
    Visibility,
}

/// Parameters of `ppm` and `sppm`, named as in Mitsuba 0.6.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SppmSettings {
    pub max_depth: MaxDepth,
    pub rr_depth: u32,
    pub hide_emitters: bool,
    /// Photons wanted in each map of a pass, by default as many as the picture has pixels.
    pub photon_count: u64,
    /// How fast radii shrink: 1 keeps them, 2/3 converges fastest.
    pub alpha: f64,
    /// First radius of all pixels, scene units; `None` measures one for each pixel.
    pub initial_radius: Option<f32>,
    /// Measured first radii are multiplied by this.
    pub radius_scale: f32,
    /// Photons that the measured first radius holds.
    pub lookup_size: u32,
    /// Least and largest measured first radius, in pixel footprints.
    pub clamp: (f32, f32),
    /// Radii stop shrinking at this many pixel footprints. Above 0 the image keeps a blur of that size: a declared bias.
    pub radius_floor: f32,
    /// Radii by the photons that each pixel has found [Hachisuka and Jensen 2009] rather than by the pass's number: passes
    /// then depend on those before.
    pub shared_statistics: bool,
    /// Radii that shrink only where the photons that a pixel has found lie unevenly [Lin et al. 2020]; where a disc reaches
    /// beyond the surface, by their number. Passes depend on those before, and emission is not guided.
    pub chi_squared_radius: bool,
    /// Divide estimates by the share of their disc that is surface, where surfaces end.
    pub boundary_correction: bool,
    /// Shoot caustic photons.
    pub caustics: bool,
    /// Shoot indirect photons.
    pub indirect: bool,
    /// Aim the emission of caustic photons at what focuses light.
    pub guided_emission: bool,
    /// Which photon paths are traced.
    pub photon_sampling: PhotonSampling,
}

/// The maps of a pass, and the pass number of the pilot, that no pass of a picture has.
pub const PILOT_PASS: u64 = u64::MAX;

impl SppmSettings {
    /// Whether radii follow what earlier passes have found.
    pub fn shares(&self) -> bool {
        self.shared_statistics || self.chi_squared_radius
    }

    /// The way of camera paths.
    fn walk(&self) -> LobeWalk {
        LobeWalk {
            max_depth: self.max_depth,
            rr_depth: self.rr_depth,
            hide_emitters: self.hide_emitters,
            least: Some(LEAST),
            narrow: self.indirect,
        }
    }

    /// How the photons of one map are shot.
    pub fn shoot_settings(&self, seed: u64, pass: u64, target: Target, sequence: Sequence) -> ShootSettings {
        // The camera path adds an edge.
        let max_depth = self.max_depth.map(|d| d.saturating_sub(1));
        let walk = WalkSettings { max_depth, rr_depth: 1, sequence };
        ShootSettings {
            seed,
            pass,
            target,
            walk,
            photons: self.photon_count,
            max_paths: self.photon_count.saturating_mul(4),
            guided: self.guided_emission,
        }
    }

    /// The kinds of photons that can exist and are wanted, in the order of [`PassMaps::kind`].
    pub fn targets(&self) -> impl Iterator<Item = Target> {
        let enough = self.max_depth.is_none_or(|d| d > 2);
        let kinds = [(Target::Caustic, self.caustics), (Target::Indirect, self.indirect)];
        kinds.into_iter().filter(move |(_, wanted)| enough && *wanted).map(|(target, _)| target)
    }
}

/// The photon maps of one pass.
#[derive(Default)]
pub struct PassMaps {
    pub caustic: Option<RadiusMap>,
    pub indirect: Option<RadiusMap>,
}

impl PassMaps {
    #[inline]
    pub fn kind(&self, kind: usize) -> Option<&RadiusMap> {
        if kind == 0 { self.caustic.as_ref() } else { self.indirect.as_ref() }
    }

    /// Bytes of both maps.
    pub fn memory(&self) -> usize {
        [&self.caustic, &self.indirect].into_iter().flatten().map(RadiusMap::memory).sum()
    }
}

/// One pass.
pub struct Sppm<'a> {
    pub settings: SppmSettings,
    pub maps: &'a PassMaps,
    pub radii: &'a Radii,
    /// Squared radius of this pass over that of the first, where radii follow the pass's number.
    pub shrink: f32,
    /// Otherwise the radii of this pass, and where to count the photons found.
    pub shared: Option<(&'a SharedStatistics, &'a FoundPhotons)>,
    /// Some light can be met by a ray.
    pub visible_lights: bool,
}

impl Integrator for Sppm<'_> {
    fn li(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> Rgb {
        self.radiance(scene, sample, sampler, counters)
    }
}

impl Outputs<2> for Sppm<'_> {
    /// The radiance, and what it is where photons are read within [narrow](NARROW) discs; those are not counted.
    fn see(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> [Rgb; 2] {
        let Both { own, narrow } = self.radiance(scene, sample, sampler, counters);
        [own, narrow]
    }
}

/// Nothing but the lights that camera paths meet, at once or through mirrors and glass.
pub struct LightsMet(pub SppmSettings);

impl Integrator for LightsMet {
    fn li(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> Rgb {
        let walk = LobeWalk { narrow: false, ..self.0.walk() };
        walk.radiance(scene, &sample.camera_ray, sampler, counters, |_, _, _| Rgb::BLACK)
    }
}

impl Sppm<'_> {
    #[inline(always)]
    fn radiance<T: Reading>(
        &self,
        scene: &Scene,
        sample: &CameraSample,
        sampler: &mut Sampler,
        counters: &mut Counters,
    ) -> T {
        let pixel = self.radii.index(sample.pixel);
        let mut first = self.settings.boundary_correction;
        let walk = self.settings.walk();
        walk.radiance(scene, &sample.camera_ray, sampler, counters, |at, sampler, counters| {
            let ends = std::mem::take(&mut first).then_some((scene, *sampler));
            let mut sum = T::from(self.direct(scene, at, sampler, counters));
            sum += self.photons(pixel, at, ends, counters);
            sum
        })
    }

    /// Squared radius within which a pixel is read in this pass, scene units.
    #[inline]
    fn radius_sq(&self, pixel: usize, kind: usize) -> f32 {
        let radii = self.radii.pixel(pixel);
        let r_sq = match self.shared {
            None => radii.first_sq[kind] * self.shrink,
            Some((shared, _)) => shared.pixels[pixel][kind].radius_sq,
        };
        r_sq.max(radii.floor_sq)
    }

    /// Light that comes straight from a light, by one shadow ray and one ray that the lobes choose.
    fn direct(&self, scene: &Scene, at: &Sight, sampler: &mut Sampler, counters: &mut Counters) -> Rgb {
        let &Sight { si, bsdf, lobes, .. } = at;
        let share = if self.visible_lights { 1.0 } else { 0.0 };
        let mut sum = sample_direct(scene, si, bsdf, lobes, share, sampler, counters);
        if !self.visible_lights {
            return sum;
        }
        let found = sample_lobe_light(scene, si, bsdf, lobes, 1.0, sampler, counters);
        if let Some((weight, light)) = found {
            sum += weight * light.emitted * light.weight;
        }
        sum
    }

    /// Light that photons have brought; with `ends`, corrected where the surface ends.
    #[inline]
    fn photons<T: Reading>(
        &self,
        pixel: usize,
        at: &Sight,
        ends: Option<(&Scene, Sampler)>,
        counters: &mut Counters,
    ) -> T {
        let &Sight { si, bsdf, .. } = at;
        let mut sum = T::default();
        for kind in 0..KINDS {
            let Some(map) = self.maps.kind(kind) else { continue };
            // What surfaces scatter widely is left to the path where it goes on.
            let marked = at.lobes;
            let unmarked = if kind == 0 { marked } else { marked & !at.followed };
            let lobes = Lobes { marked, unmarked };
            let r_sq = self.radius_sq(pixel, kind);
            let mut bins = None;
            let mut estimate = match self.shared {
                Some((shared, _)) if shared.tests() => {
                    map.estimate_in_bins(si, (bsdf, lobes), r_sq, counters, bins.insert(Bins::default()))
                }
                _ => map.estimate(si, (bsdf, lobes), r_sq, counters),
            };
            let share = |r_sq: f32, counters: &mut Counters| {
                let (scene, sampler) = ends.as_ref()?;
                let clearing = self.radii.clearing(pixel);
                let cut = !clearing.holds(si.p, r_sq.sqrt());
                cut.then(|| Patch::new(scene, si, clearing.solids).share(map.kernel(), r_sq, sampler, counters))
            };
            if estimate.count > 0
                && let Some(share) = share(r_sq, counters)
            {
                estimate.radiance = estimate.radiance / share;
                // Photons that lie on a part of the disc are uneven, and say nothing about the light.
                bins = None;
            }
            sum += T::of(estimate.radiance, || {
                let (r_sq, mut uncounted) = (NARROW * r_sq, Counters::default());
                let estimate = map.estimate(si, (bsdf, lobes), r_sq, &mut uncounted);
                let share = if estimate.count > 0 { share(r_sq, &mut uncounted) } else { None };
                estimate.radiance / share.unwrap_or(1.0)
            });
            match (self.shared, &bins) {
                (Some((_, found)), Some(bins)) => found.add_bins(pixel, kind, bins),
                (Some((_, found)), None) => found.add(pixel, kind, estimate.count),
                (None, _) => {}
            }
        }
        sum
    }
}
