//! The first radius of every pixel, and the statistics that its passes share.

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use super::evenness::Evenness;
use super::{PassMaps, SharedRadius, SppmSettings};
use crate::bsdf::{LobeMask, Mode};
use crate::camera::{CameraRay, FilmWindow};
use crate::gather::{BINS, Bins, Clearing, Patch};
use crate::geometry::SurfaceInteraction;
use crate::math::Vec2;
use crate::sample::{Key, Purpose, Sampler};
use crate::scene::Scene;
use crate::tally::Counters;

/// Kinds of photons that have radii of their own: caustic and indirect.
pub const KINDS: usize = 2;

/// Specular surfaces that the pilot looks through.
const MAX_CHAIN: u32 = 16;

/// Squared radii of a pixel, scene units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelRadii {
    /// Of the first pass, for caustic and for indirect photons.
    pub first_sq: [f32; KINDS],
    /// Below this no radius shrinks.
    pub floor_sq: f32,
}

/// The first radii of all pixels.
#[derive(Clone, Debug)]
pub struct Radii {
    window: FilmWindow,
    pixels: Vec<PixelRadii>,
    /// How far surfaces go on around what the middle of each pixel sees; empty where nobody asks.
    clearings: Vec<Clearing>,
}

impl Radii {
    /// Measures the first radii with the maps of a pilot pass: the distance of the k-th photon from what the middle of the
    /// pixel sees, held between `settings.clamp` pixel footprints. `initial_radius` overrides it.
    pub fn measure(scene: &Scene, settings: &SppmSettings, pilot: &PassMaps, seed: u64) -> Self {
        let window = scene.camera.window();
        let (w, h) = window.crop_size;
        let key = Key::new(seed, Purpose::Pilot, PIXELS);
        let seen: Vec<Option<(PixelRadii, Clearing)>> = (0..w as usize * h as usize)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i as u32 % w + window.crop_offset.0, i as u32 / w + window.crop_offset.1);
                let mut sampler = Sampler::new(scene.sampler.sequence, key.with(((y as u64) << 32) | x as u64), 0);
                let camera_ray = scene.camera_ray(Vec2::new(x as f32 + 0.5, y as f32 + 0.5), Vec2::splat(0.5));
                let (si, distance) = visible_point(scene, &camera_ray, &mut sampler)?;
                let footprint = footprint(&camera_ray, distance);
                let radii = pixel_radii(settings, pilot, &si, footprint, scene.bounding_sphere().1);
                if !settings.boundary_correction {
                    return Some((radii, Clearing::UNKNOWN));
                }
                Some((radii, clearing(scene, pilot, &si, &radii, footprint)))
            })
            .collect();
        let known = if settings.boundary_correction { &seen[..] } else { &[] };
        let clearings = known.iter().map(|s| s.map_or(Clearing::UNKNOWN, |(_, clearing)| clearing)).collect();
        let radii = seen.iter().map(|s| s.map(|(radii, _)| radii)).collect();
        Self { window, pixels: fill_gaps(radii, w as usize, scene.bounding_sphere().1), clearings }
    }

    /// The index of a pixel given in coordinates of the whole film.
    #[inline]
    pub fn index(&self, pixel: (u32, u32)) -> usize {
        let (ox, oy) = self.window.crop_offset;
        (pixel.1 - oy) as usize * self.window.crop_size.0 as usize + (pixel.0 - ox) as usize
    }

    /// The radii of a pixel by its index.
    #[inline]
    pub fn pixel(&self, index: usize) -> &PixelRadii {
        &self.pixels[index]
    }

    /// How far the surface that a pixel sees goes on, by the pixel's index.
    #[inline]
    pub fn clearing(&self, index: usize) -> &Clearing {
        self.clearings.get(index).unwrap_or(&Clearing::UNKNOWN)
    }

    pub fn len(&self) -> usize {
        self.pixels.len()
    }

    pub fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }
}

/// The pass number of the random stream of pilot pixels; photon kinds have their own.
const PIXELS: u64 = 1 << 32;

/// Side of a pixel, seen from where the camera path is after `distance`; focusing on the way is left out.
fn footprint(ray: &CameraRay, distance: f32) -> f32 {
    let f = &ray.footprint;
    let dx = (f.origin_dx + distance * f.dir_dx).length();
    let dy = (f.origin_dy + distance * f.dir_dy).length();
    (dx * dy).sqrt()
}

/// The first point along a camera path where photons are read, and the length of the path up to it.
fn visible_point(scene: &Scene, camera_ray: &CameraRay, sampler: &mut Sampler) -> Option<(SurfaceInteraction, f32)> {
    let mut ray = camera_ray.ray;
    let mut distance = (ray.o - camera_ray.lens).length();
    for _ in 0..MAX_CHAIN {
        let from = ray.o;
        let si = scene.intersect(&mut ray)?;
        distance += (si.p - from).length();
        let bsdf = scene.bsdf(&si);
        if bsdf.lobes().intersects(LobeMask::SMOOTH_WIDE) {
            return Some((si, distance));
        }
        let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
        let s = bsdf.sample(si.wo, u_lobe, u, Mode::Radiance, LobeMask::SPECULAR)?;
        ray = si.spawn_ray(s.wi);
    }
    None
}

fn pixel_radii(
    settings: &SppmSettings,
    pilot: &PassMaps,
    si: &SurfaceInteraction,
    footprint: f32,
    scene_radius: f32,
) -> PixelRadii {
    let floor_sq = (settings.radius_floor * footprint).powi(2);
    if let Some(r) = settings.initial_radius {
        return PixelRadii { first_sq: [r * r; KINDS], floor_sq };
    }
    // A footprint may be tiny or, far out, huge; neither may the radius be.
    let limit = MAX_RADIUS * scene_radius;
    let most = (settings.clamp.1 * footprint).min(limit);
    let least = (settings.clamp.0 * footprint).min(most);
    let (most_sq, least_sq) = (most * most, least * least);
    let scale_sq = settings.radius_scale * settings.radius_scale;
    let measured = |kind| {
        let Some(map) = pilot.kind(kind) else { return most_sq };
        let wanted = map.nearest_radius_sq(si, settings.lookup_size as usize, most_sq).max(least_sq);
        // Indirect light is smooth: rather blur it over some pixels than see no photon for many passes. Caustics are not.
        if wanted < most_sq || kind == CAUSTIC {
            return wanted;
        }
        map.nearest_radius_sq(si, (settings.lookup_size / FEW).max(1) as usize, limit * limit).max(wanted)
    };
    PixelRadii { first_sq: std::array::from_fn(|kind| scale_sq * measured(kind)), floor_sq }
}

/// How far the surface goes on around what the middle of a pixel sees, as far as any sample of the pixel may look.
fn clearing(scene: &Scene, pilot: &PassMaps, si: &SurfaceInteraction, radii: &PixelRadii, footprint: f32) -> Clearing {
    // Of kinds of photons that the pilot has not found there are none; without a pilot the radii are given.
    let any = (0..KINDS).any(|kind| pilot.kind(kind).is_some());
    let asked = (0..KINDS).filter(|&kind| !any || pilot.kind(kind).is_some());
    let widest_sq = asked.map(|kind| radii.first_sq[kind]).fold(radii.floor_sq, f32::max);
    // Samples fall half a diagonal beside the middle, and further where the surface is seen aslant.
    let aslant = si.wo.dot(si.ng).abs().max(LEAST_COS);
    Patch::new(scene, si, true).clearing(widest_sq.sqrt() + footprint / aslant, &mut Counters::default())
}

/// The cosine under which a surface is no longer followed as far as a pixel sees of it.
const LEAST_COS: f32 = 0.2;

/// The kind of photons that have come through specular surfaces alone.
const CAUSTIC: usize = 0;

/// A radius above the largest of `clamp` holds `lookup_size` photons over this.
const FEW: u32 = 4;

/// Largest radius as a share of that of the scene's bounding sphere.
const MAX_RADIUS: f32 = 0.1;

/// Gives pixels whose pilot path saw no surface the radii of the nearest one before them in its row or column.
fn fill_gaps(seen: Vec<Option<PixelRadii>>, width: usize, scene_radius: f32) -> Vec<PixelRadii> {
    let default = (0.01 * scene_radius).powi(2);
    let fallback = seen.iter().flatten().next().copied();
    let fallback = fallback.unwrap_or(PixelRadii { first_sq: [default; KINDS], floor_sq: 0.0 });
    let mut pixels: Vec<PixelRadii> = Vec::with_capacity(seen.len());
    for (i, found) in seen.into_iter().enumerate() {
        let before = if i % width > 0 { i.checked_sub(1) } else { i.checked_sub(width) };
        pixels.push(found.unwrap_or_else(|| before.map_or(fallback, |b| pixels[b])));
    }
    pixels
}

/// Radii that shrink with the photons that a pixel has found: one entry a pixel and kind.
#[derive(Clone, Debug, PartialEq)]
pub struct SharedStatistics {
    pub(crate) pixels: Vec<[SharedRadius; KINDS]>,
    /// How the photons lie; only where radii follow that.
    pub(crate) evenness: Vec<[Evenness; KINDS]>,
}

impl SharedStatistics {
    /// Before the first pass.
    pub fn new(radii: &Radii, settings: &SppmSettings) -> Self {
        let start = |p: &PixelRadii| p.first_sq.map(|radius_sq| SharedRadius { radius_sq, photons: 0.0 });
        let tested = if settings.chi_squared_radius { radii.len() } else { 0 };
        Self { pixels: radii.pixels.iter().map(start).collect(), evenness: vec![[Evenness::default(); KINDS]; tested] }
    }

    /// Takes in what a pass found.
    pub fn update(&mut self, found: &FoundPhotons, alpha: f64) {
        for (pixel, counts) in self.pixels.iter_mut().zip(&found.counts) {
            for (shared, count) in pixel.iter_mut().zip(counts) {
                shared.update(count.load(Ordering::Relaxed), alpha);
            }
        }
        for ((pixel, tests), bins) in self.pixels.iter_mut().zip(&mut self.evenness).zip(&found.bins) {
            for ((shared, test), bins) in pixel.iter_mut().zip(tests).zip(bins) {
                let bins = Bins(std::array::from_fn(|i| bins[i].load(Ordering::Relaxed)));
                test.update(&bins, shared, alpha);
            }
        }
    }

    /// The photons of one pass, nothing found yet.
    pub fn begin(&self) -> FoundPhotons {
        let pixels = self.pixels.len();
        FoundPhotons {
            counts: (0..pixels).map(|_| Default::default()).collect(),
            bins: self.evenness.iter().map(|_| Default::default()).collect(),
        }
    }

    /// Whether radii follow how the photons lie.
    #[inline]
    pub fn tests(&self) -> bool {
        !self.evenness.is_empty()
    }
}

/// The photons that each pixel found in one pass, of each kind. Sums of integers, so threads may add in any order.
#[derive(Debug)]
pub struct FoundPhotons {
    /// Those that narrow the radius whatever they look like.
    counts: Vec<[AtomicU32; KINDS]>,
    /// Those that are put to the test.
    bins: Vec<[[AtomicU32; BINS]; KINDS]>,
}

impl FoundPhotons {
    /// Adds photons that narrow the radius.
    #[inline]
    pub fn add(&self, pixel: usize, kind: usize, count: u32) {
        self.counts[pixel][kind].fetch_add(count, Ordering::Relaxed);
    }

    /// Adds photons that narrow the radius if they are uneven.
    #[inline]
    pub fn add_bins(&self, pixel: usize, kind: usize, bins: &Bins) {
        for (sum, &count) in self.bins[pixel][kind].iter().zip(&bins.0) {
            sum.fetch_add(count, Ordering::Relaxed);
        }
    }
}
