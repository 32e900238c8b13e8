//! Passes: iterations of light paths, then camera paths, in fixed pieces whose results are joined in their order.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::camera_path::{LightField, radiance};
use super::correlation::Link;
use super::emission::{Guidance, Learnt};
use super::grid::{Grid, Photon};
use super::light_path::{Collect, LightSink, LightVertex, trace};
use super::{Merging, Recipe, VcmSettings};
use crate::accel::{self, Task};
use crate::film::{Film, FilmTile, SplatBuffer};
use crate::math::Vec2;
use crate::sample::{Key, Purpose, Sampler};
use crate::scene::Scene;
use crate::shoot::PATHS_PER_BATCH;
use crate::tally::Counters;

/// Takes the camera samples `samples` of every pixel, with as many light paths or more, and adds them to `film`; `workspace` is
/// memory of earlier passes of the same scene and settings, or new: the first pass learns there where light paths should
/// start and how many are worth their rays.
///
/// Splats are estimates of the picture, one for each sample of a pixel: a film that holds `n` samples per pixel is
/// developed with a splat scale of `1/n`. The merging radius depends on the number of the sample alone, counted from 0.
pub fn render_pass(
    scene: &Scene,
    settings: &VcmSettings,
    seed: u64,
    samples: Range<u64>,
    film: &mut Film,
    workspace: &mut Workspace,
    progress: &(dyn Fn(f64) + Sync),
) -> Counters {
    let mut recipe = Recipe::new(scene, settings);
    recipe.learn(workspace.learnt.get_or_insert_with(|| Learnt::new(&recipe)));
    let mut counters = Counters::default();
    let count = samples.end - samples.start;
    for (done, sample) in samples.enumerate() {
        let iteration = Iteration { recipe: &recipe, seed, sample };
        let report = |fraction: f64| progress((done as f64 + fraction) / count as f64);
        counters += iteration.render(film, workspace, &report);
    }
    counters
}

/// Memory that passes use again: what an iteration stores of its light is large, and pages fresh from the system are
/// cleared first. It holds nothing that one iteration leaves to the next.
#[derive(Default)]
pub struct Workspace {
    batches: Vec<Batch>,
    grid: Grid,
    /// By the first pass from the scene and the settings.
    pub(super) learnt: Option<Learnt>,
}

impl Workspace {
    /// What the first pass found of guiding light paths, if there is something to guide.
    pub fn guidance(&self) -> Option<Guidance> {
        self.learnt.as_ref()?.guidance
    }

    /// Light paths for each camera path.
    pub fn light_paths_per_sample(&self) -> Option<u32> {
        self.learnt.as_ref().map(|l| l.per_pixel)
    }
}

/// One sample of every pixel.
struct Iteration<'a, 's> {
    recipe: &'a Recipe<'s>,
    seed: u64,
    sample: u64,
}

/// Light vertices of a batch of paths.
#[derive(Default)]
struct Batch {
    sink: LightSink,
    /// The end of each path's vertices.
    ends: Vec<u32>,
}

/// A tile with what its light paths splat.
struct Done {
    tile: FilmTile,
    splats: SplatBuffer,
    counters: Counters,
}

impl Iteration<'_, '_> {
    fn render(&self, film: &mut Film, workspace: &mut Workspace, progress: &(dyn Fn(f64) + Sync)) -> Counters {
        let recipe = self.recipe;
        let mut counters = Counters::default();
        let Workspace { batches, grid, .. } = workspace;
        let mut eta = 0.0;
        // With merging, all light comes before the first camera path.
        if recipe.settings.merging == Merging::Off {
            batches.clear();
        } else {
            let radius = recipe.radius(self.sample);
            eta = std::f64::consts::PI * radius * radius * recipe.light_paths as f64;
            self.trace_batches(eta, batches);
            for batch in batches.iter() {
                film.merge_splats(&batch.sink.splats);
                counters += batch.sink.counters;
            }
            let photons: Vec<&[Photon]> = batches.iter().map(|b| &b.sink.photons[..]).collect();
            grid.fill(&photons, radius as f32);
            if recipe.settings.correlation_aware {
                grid.keep_links(batches.iter().map(|b| &b.sink.links[..]));
            }
        }
        let (batches, grid) = (&batches[..], (!batches.is_empty() && !grid.is_empty()).then_some(&*grid));
        // Render tiles, and merge them in their order.
        let done = AtomicUsize::new(0);
        let count = film.tile_count();
        let tiles: Vec<Done> = (0..count)
            .into_par_iter()
            .map(|index| {
                let tile = accel::run(TileWork { iteration: self, tile: film.tile(index), batches, grid, eta });
                progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / count as f64);
                tile
            })
            .collect();
        for Done { tile, splats, counters: c } in &tiles {
            film.merge(tile);
            film.merge_splats(splats);
            counters += *c;
        }
        counters
    }

    fn light_sampler(&self, path: u64) -> Sampler {
        let key = Key::new(self.seed, Purpose::LightPath, 0);
        Sampler::new(self.recipe.scene.sampler.sequence, key, self.sample * self.recipe.light_paths + path)
    }

    /// All light paths of the iteration, into `batches`.
    fn trace_batches(&self, eta: f64, batches: &mut Vec<Batch>) {
        let paths = self.recipe.light_paths;
        batches.resize_with(paths.div_ceil(PATHS_PER_BATCH) as usize, Batch::default);
        batches.par_iter_mut().enumerate().for_each(|(batch, out)| {
            let first = batch as u64 * PATHS_PER_BATCH;
            let range = first..(first + PATHS_PER_BATCH).min(paths);
            accel::run(BatchWork { iteration: self, range, out, eta });
        });
    }

    /// Light paths of a batch. The first of them belong to camera paths, which alone are connected to their vertices.
    #[inline(always)]
    fn trace_batch(&self, range: Range<u64>, eta: f64, out: &mut Batch) {
        out.sink.clear();
        out.ends.clear();
        let connected = if self.recipe.connects() { self.recipe.pixels() } else { 0 };
        for path in range {
            let collect = Collect { vertices: path < connected, bsdfs: false, splats: true };
            trace(self.recipe, eta, self.light_sampler(path), collect, &mut out.sink);
            out.ends.push(out.sink.vertices.len() as u32);
        }
    }

    /// Camera paths of a tile, with their light paths unless `batches` holds them.
    #[inline(always)]
    fn render_tile(&self, mut tile: FilmTile, batches: &[Batch], grid: Option<&Grid>, eta: f64) -> Done {
        let recipe = self.recipe;
        let scene = recipe.scene;
        let window = scene.camera.window();
        let key = Key::new(self.seed, Purpose::Camera, 0);
        let mut counters = Counters::default();
        let (mut sink, mut bsdfs) = (LightSink::default(), Vec::new());
        let own_light = batches.is_empty() && recipe.traces_light();
        let collect = Collect { vertices: recipe.connects(), bsdfs: true, splats: true };
        for (x, y) in tile.pixels() {
            // Find or make the light path of this camera path.
            let (column, row) = (x - window.crop_offset.0, y - window.crop_offset.1);
            let path = row as u64 * window.crop_size.0 as u64 + column as u64;
            if own_light {
                sink.vertices.clear();
                sink.links.clear();
                sink.bsdfs.clear();
                trace(recipe, eta, self.light_sampler(path), collect, &mut sink);
            }
            let vertices = if own_light { &sink.vertices[..] } else { vertices_of(batches, path) };
            if !own_light {
                bsdfs.clear();
                bsdfs.extend(vertices.iter().map(|v| scene.bsdf(&v.si)));
            }
            // Place the sample on the film and the lens.
            let mut sampler =
                Sampler::new(scene.sampler.sequence, key.with(((y as u64) << 32) | x as u64), self.sample);
            let film_pos = Vec2::new(x as f32, y as f32) + sampler.next_2d();
            let camera_ray = scene.camera_ray(film_pos, sampler.next_2d());
            let links = if own_light { &sink.links[..] } else { links_of(batches, path) };
            let bsdfs = if own_light { &sink.bsdfs } else { &bsdfs };
            let field = LightField { vertices, bsdfs, grid, eta, links };
            let value = radiance(recipe, &camera_ray, &field, &mut sampler, &mut counters);
            counters.samples += 1;
            // Drop what is not a number, and say so.
            if !tile.add_sample(film_pos, value) {
                if value.to_array().iter().any(|c| c.is_nan()) {
                    counters.nan_samples += 1;
                } else {
                    counters.infinite_samples += 1;
                }
            }
        }
        counters += sink.counters;
        Done { tile, splats: sink.splats, counters }
    }
}

/// [`Iteration::trace_batch`], compiled for each instruction set.
struct BatchWork<'a, 's> {
    iteration: &'a Iteration<'a, 's>,
    range: Range<u64>,
    out: &'a mut Batch,
    eta: f64,
}

impl Task for BatchWork<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.iteration.trace_batch(self.range, self.eta, self.out);
    }
}

/// [`Iteration::render_tile`], compiled for each instruction set.
struct TileWork<'a, 's> {
    iteration: &'a Iteration<'a, 's>,
    tile: FilmTile,
    batches: &'a [Batch],
    grid: Option<&'a Grid>,
    eta: f64,
}

impl Task for TileWork<'_, '_> {
    type Output = Done;

    #[inline(always)]
    fn run(self) -> Done {
        self.iteration.render_tile(self.tile, self.batches, self.grid, self.eta)
    }
}

/// The vertices of one light path.
fn vertices_of(batches: &[Batch], path: u64) -> &[LightVertex] {
    let Some(batch) = batches.get((path / PATHS_PER_BATCH) as usize) else { return &[] };
    let i = (path % PATHS_PER_BATCH) as usize;
    let first = if i == 0 { 0 } else { batch.ends[i - 1] };
    &batch.sink.vertices[first as usize..batch.ends[i] as usize]
}

/// The links of the batch that a light path is in.
fn links_of(batches: &[Batch], path: u64) -> &[Link] {
    batches.get((path / PATHS_PER_BATCH) as usize).map_or(&[], |b| &b.sink.links)
}
