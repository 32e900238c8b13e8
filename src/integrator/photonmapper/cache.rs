//! Filling the irradiance cache in rounds that do not depend on threads.

use rayon::prelude::*;

use super::PhotonMapper;
use crate::bsdf::LobeMask;
use crate::camera::Footprint;
use crate::gather::cache::{CacheRecord, Hemisphere, IrradianceCache, Seen};
use crate::geometry::SurfaceInteraction;
use crate::integrator::specular_bounce;
use crate::math::{Vec2, Vec3};
use crate::sample::{Key, Purpose, Sampler, Sequence};
use crate::scene::Scene;
use crate::tally::Counters;

/// Pixels between the points of the coarsest round; every further round halves it.
const COARSEST: u32 = 64;

/// Points looked up at once in a finished cache.
const POINTS_PER_CHUNK: usize = 16384;

/// Records computed at once from the same cache; part of the result's definition.
const RECORDS_PER_BATCH: usize = 64;

/// Specular surfaces between the camera and a point of the cache.
const MAX_SPECULAR: u32 = 16;

/// A point that the camera sees and for which the cache is to be good.
struct Point {
    si: SurfaceInteraction,
    /// The normal on the lit side.
    n: Vec3,
    /// Width of a pixel there, scene units.
    pixel: f32,
    /// Names its random numbers.
    id: u64,
}

impl PhotonMapper<'_> {
    /// Computes irradiance records so that nearly every point the camera sees can be interpolated.
    ///
    /// Level by level over ever finer grids of pixels: points that the cache does not answer are found in parallel, their
    /// records computed in parallel in batches of fixed size, and inserted in a fixed order.
    pub fn fill_cache(&self, scene: &Scene, seed: u64, pass: u64, counters: &mut Counters) -> Option<IrradianceCache> {
        let settings = self.settings.irradiance_cache?;
        let mut cache = IrradianceCache::new(settings, &scene.bounds);
        let key = Key::new(seed, Purpose::Cache, pass);
        let (width, height) = scene.camera.window().crop_size;
        let mut spacing = COARSEST;
        while spacing > 0 {
            let mut pixels: Vec<(u32, u32)> = grid(width, height, spacing).collect();
            // Scatter neighbours over the batches, so that one of them serves the others.
            pixels.sort_by_cached_key(|&(x, y)| key.with(id_of(x, y)).0);
            for chunk in pixels.chunks(POINTS_PER_CHUNK) {
                let points: Vec<Point> =
                    chunk.par_iter().filter_map(|&(x, y)| self.missing(scene, &cache, key, (x, y))).collect();
                for batch in points.chunks(RECORDS_PER_BATCH) {
                    let records: Vec<Option<(CacheRecord, Counters)>> =
                        batch.par_iter().map(|point| self.record_at(scene, &cache, key, point)).collect();
                    for (point, (record, counted)) in batch.iter().zip(records).filter_map(|(p, r)| Some((p, r?))) {
                        cache.insert(record, point.pixel);
                        *counters += counted;
                    }
                }
            }
            spacing /= 2;
        }
        Some(cache)
    }

    /// The diffuse point behind the middle of a pixel, unless there is none or the cache knows it.
    fn missing(&self, scene: &Scene, cache: &IrradianceCache, key: Key, (x, y): (u32, u32)) -> Option<Point> {
        let offset = scene.camera.window().crop_offset;
        let film = Vec2::new((offset.0 + x) as f32 + 0.5, (offset.1 + y) as f32 + 0.5);
        let camera_ray = scene.camera_ray(film, Vec2::splat(0.5));
        let id = id_of(x, y);
        let mut sampler = Sampler::new(Sequence::Independent, key.with(id), 0);
        let (mut ray, mut length) = (camera_ray.ray, 0.0);
        for _ in 0..=MAX_SPECULAR {
            let hit = scene.hit(&mut ray)?;
            let si = scene.interaction(&ray, &hit);
            length += si.t;
            let bsdf = scene.bsdf(&si);
            if let Some((_, n)) = bsdf.diffuse_only(si.wo) {
                if cache.interpolate(si.p, n).is_some() {
                    return None;
                }
                return Some(Point { si, n, pixel: pixel_width(&camera_ray.footprint, length), id });
            }
            if !bsdf.lobes().intersects(LobeMask::SPECULAR) {
                return None;
            }
            ray = specular_bounce(&si, &bsdf, &mut sampler)?.0;
        }
        None
    }

    /// Looks around from a point, unless the cache has come to know it.
    fn record_at(
        &self,
        scene: &Scene,
        cache: &IrradianceCache,
        key: Key,
        point: &Point,
    ) -> Option<(CacheRecord, Counters)> {
        if cache.interpolate(point.si.p, point.n).is_some() {
            return None;
        }
        let mut counters = Counters::default();
        let hemisphere = Hemisphere::new(point.n, cache.settings().resolution);
        let key = key.with(point.id);
        let front = point.si.wo.dot(point.si.ng) > 0.0;
        let seen: Vec<Seen> = (0..hemisphere.len())
            .map(|i| {
                let mut sampler = Sampler::new(Sequence::Independent, key, 1 + i as u64);
                let wi = hemisphere.direction(i, sampler.next_2d());
                // Shading normals may turn directions below the surface.
                if (wi.dot(point.si.ng) > 0.0) != front {
                    return Seen { wi, radiance: crate::color::Rgb::BLACK, distance: f32::INFINITY };
                }
                let ray = point.si.spawn_ray(wi);
                let (radiance, distance) = self.arriving(scene, ray, 1.0, None, 0, &mut sampler, &mut counters);
                Seen { wi, radiance, distance }
            })
            .collect();
        Some((hemisphere.record(point.si.p, &seen, cache.settings().metric), counters))
    }
}

/// A number for each pixel of the crop window.
fn id_of(x: u32, y: u32) -> u64 {
    (y as u64) << 32 | x as u64
}

/// The pixels of a grid, in the middle of its squares.
fn grid(width: u32, height: u32, spacing: u32) -> impl Iterator<Item = (u32, u32)> {
    let (first, step) = (spacing / 2, spacing as usize);
    (first..height).step_by(step).flat_map(move |y| (first..width).step_by(step).map(move |x| (x, y)))
}

/// Width of a pixel at a distance along a ray, scene units.
pub(super) fn pixel_width(footprint: &Footprint, length: f32) -> f32 {
    let x = footprint.origin_dx + footprint.dir_dx * length;
    let y = footprint.origin_dy + footprint.dir_dy * length;
    x.length().min(y.length())
}
