use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::accel::{self, Task};
use crate::camera::FilmWindow;
use crate::film::{Film, FilmTile};
use crate::integrator::sppm::{Sighting, Sppm};
use crate::integrator::{CameraSample, Integrator, Outputs};
use crate::math::Vec2;
use crate::sample::{Key, Purpose, Sampler};
use crate::scene::Scene;
use crate::tally::Counters;

/// Takes the camera samples `samples` of every pixel and adds them to `film`.
///
/// Tiles of fixed size are rendered in parallel and merged in their order. `progress` hears the finished fraction.
pub fn render_pass<I: Integrator>(
    scene: &Scene,
    integrator: &I,
    film: &mut Film,
    seed: u64,
    samples: Range<u64>,
    progress: &(dyn Fn(f64) + Sync),
) -> Counters {
    render_films(scene, integrator, [film], seed, samples, progress)
}

/// As [`render_pass`], with a film for each picture.
pub(super) fn render_films<const N: usize>(
    scene: &Scene,
    integrator: &impl Outputs<N>,
    mut films: [&mut Film; N],
    seed: u64,
    samples: Range<u64>,
    progress: &(dyn Fn(f64) + Sync),
) -> Counters {
    let key = Key::new(seed, Purpose::Camera, 0);
    let tiles = films[0].tile_count();
    let done = AtomicUsize::new(0);
    let rendered: Vec<_> = (0..tiles)
        .into_par_iter()
        .map(|index| {
            let films = films.each_ref().map(|film| &**film);
            let (tile, counters) = accel::run(Tile { scene, integrator, films, index, key, samples: samples.clone() });
            let finished = done.fetch_add(1, Ordering::Relaxed) + 1;
            progress(finished as f64 / tiles as f64);
            (tile, counters)
        })
        .collect();
    // Merge in the order of the tiles, whatever the order in which they were finished.
    let mut counters = Counters::default();
    for (tiles, c) in rendered {
        for (film, tile) in films.iter_mut().zip(&tiles) {
            film.merge(tile);
        }
        counters += c;
    }
    counters
}

/// The samples of one tile.
struct Tile<'a, I, const N: usize> {
    scene: &'a Scene,
    integrator: &'a I,
    films: [&'a Film; N],
    index: usize,
    key: Key,
    samples: Range<u64>,
}

impl<I: Outputs<N>, const N: usize> Task for Tile<'_, I, N> {
    type Output = ([FilmTile; N], Counters);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { scene, integrator, films, index, key, samples } = self;
        let mut tiles = films.map(|film| film.tile(index));
        let mut counters = Counters::default();
        for (x, y) in tiles[0].pixels() {
            let pixel_key = pixel_key(key, (x, y));
            for index in samples.clone() {
                let (film_pos, sample, mut sampler) = camera_sample(scene, pixel_key, (x, y), index);
                let radiances = integrator.see(scene, &sample, &mut sampler, &mut counters);
                counters.samples += 1;
                // Drop what is not a number, and say so.
                for (tile, radiance) in tiles.iter_mut().zip(radiances) {
                    if !tile.add_sample(film_pos, radiance) {
                        if radiance.to_array().iter().any(|c| c.is_nan()) {
                            counters.nan_samples += 1;
                        } else {
                            counters.infinite_samples += 1;
                        }
                    }
                }
            }
        }
        (tiles, counters)
    }
}

/// Where the camera samples `samples` of every pixel will read photons, as `recipe` says.
pub(super) fn sightings(
    scene: &Scene,
    recipe: &Sppm,
    seed: u64,
    samples: Range<u64>,
    counters: &mut Counters,
) -> Vec<Sighting> {
    let key = Key::new(seed, Purpose::Camera, 0);
    let FilmWindow { crop_offset: (ox, oy), crop_size: (w, h), .. } = scene.camera.window();
    let row = |y: u32| {
        let (mut found, mut counters) = (Vec::new(), Counters::default());
        for (x, index) in (ox..ox + w).flat_map(|x| samples.clone().map(move |index| (x, index))) {
            let (_, sample, mut sampler) = camera_sample(scene, pixel_key(key, (x, y)), (x, y), index);
            recipe.sightings(scene, &sample, &mut sampler, &mut counters, &mut found);
        }
        (found, counters)
    };
    let rows: Vec<_> = (oy..oy + h).into_par_iter().map(row).collect();
    let mut all = Vec::with_capacity(rows.iter().map(|r| r.0.len()).sum());
    for (found, c) in rows {
        all.extend_from_slice(&found);
        *counters += c;
    }
    all
}

/// The key of a pixel's samples.
#[inline]
pub(super) fn pixel_key(key: Key, (x, y): (u32, u32)) -> Key {
    key.with(((y as u64) << 32) | x as u64)
}

/// Places sample `index` of a pixel on the film and the lens; the rest of its random numbers follows.
#[inline(always)]
pub(super) fn camera_sample(
    scene: &Scene,
    pixel_key: Key,
    (x, y): (u32, u32),
    index: u64,
) -> (Vec2, CameraSample, Sampler) {
    let mut sampler = Sampler::new(scene.sampler.sequence, pixel_key, index);
    let film_pos = Vec2::new(x as f32, y as f32) + sampler.next_2d();
    let camera_ray = scene.camera_ray(film_pos, sampler.next_2d());
    (film_pos, CameraSample { camera_ray, pixel: (x, y) }, sampler)
}
