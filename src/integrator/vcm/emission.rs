//! Guided emission: light paths start where a pilot found that they matter to the picture.
//!
//! A light's `sample_le` maps numbers to a place and a direction. Grids over these numbers hold a density: for points and
//! lamps over the direction, for the sun over the place on the disc that it shines through, for environments over both. A few
//! short rounds trace light paths and look at what they splat. The density is proportional to the root of the mean square of
//! splats over the picture, which makes the relative variance of the light image least; a share stays uniform [Jensen 2001,
//! §6.2; Grittmann et al. 2018]. The density of a given path is looked up by the inverse maps, so that all weights are exact.
//!
//! Paths that reach what matters have more vertices, and those cost rays. The pilot compares noise times rays of a sample with
//! and without guidance, and leaves it where that does not fall.
//!
//! Where vertices are merged, a few paths of both kinds also tell how many light paths a camera path can afford. Nothing here
//! depends on the seed of the render.

use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;

use super::camera_path::{LightField, radiance};
use super::light_path::{Collect, LightSink, LightWalk, trace};
use super::{Merging, Recipe, VcmSettings};
use crate::color::Rgb;
use crate::image::FilmWindow;
use crate::light::{Light, LightContext, LightLe};
use crate::math::{Vec2, Vec3};
use crate::sample::{Distribution2d, Key, Purpose, Sampler, Sequence};
use crate::scene::Scene;

/// Lights at most; grids of more would learn little.
const MOST_LIGHTS: usize = 16;

/// Share of starts that stay uniform after each round of the pilot, of which each has twice as many paths as the one before.
const UNIFORM: [f64; 3] = [0.5, 0.3, 0.2];

/// Paths of the second round: a share of the pixels between two bounds.
const PIXELS_PER_PATH: u64 = 4;
const PATHS: (u64, u64) = (256, 12_288);

/// Error times cost must fall below this share of what they are without guidance.
const LEAST_GAIN: f64 = 0.8;

/// The noisiest part of cells and paths counts as the next one does: one bright path would decide alone.
const TRIMMED: f64 = 0.005;

/// Paths of one task.
const CHUNK: u64 = 256;

/// Cells of the film at most, and camera samples in each.
const MOST_CELLS: u64 = 48 * 48;
const SAMPLES: u64 = 2;

/// Paths from both ends that tell what they cost, and light paths for each camera path at most.
const COUNTED: u64 = 512;
const MOST_PER_PIXEL: u64 = 4;

/// Errors are relative to the picture, but where it is darker than this share of its mean.
const DARK: f64 = 0.1;

/// Cells along each axis of the grids of one light.
#[derive(Clone, Copy, Debug)]
struct Resolution {
    place: usize,
    direction: usize,
}

impl Resolution {
    /// `None` where there is nothing to guide.
    fn of(light: &Light) -> Option<Self> {
        let (place, direction) = match light.has_start_numbers() {
            (false, false) => return None,
            (true, false) => (32, 1),
            (false, true) => (1, 32),
            (true, true) => (8, 16),
        };
        Some(Self { place, direction })
    }

    fn cells(self) -> usize {
        (self.place * self.direction).pow(2)
    }

    fn cell(self, (place, direction): (Vec2, Vec2)) -> usize {
        cell(direction, self.direction) * self.place.pow(2) + cell(place, self.place)
    }
}

fn cell(u: Vec2, n: usize) -> usize {
    let at = |x: f32| ((x * n as f32) as usize).min(n - 1);
    at(u.y) * n + at(u.x)
}

/// The density of one light's starts, relative to that of `sample_le`.
#[derive(Debug)]
struct Starts {
    resolution: Resolution,
    /// Of the direction, if there is one.
    directions: Option<Distribution2d>,
    /// Of the place, by cell of the direction.
    places: Vec<Distribution2d>,
    /// By cell.
    densities: Vec<f32>,
}

impl Starts {
    /// A density proportional to `weights` but for the share `uniform`.
    fn new(resolution: Resolution, weights: &[f64], uniform: f64) -> Self {
        let grid = |n: usize, weights: &[f64]| {
            let total: f64 = weights.iter().sum();
            let (share, scale) = if total > 0.0 { (uniform, (1.0 - uniform) / total) } else { (1.0, 0.0) };
            let even = share / weights.len() as f64;
            let mixed: Vec<f32> = weights.iter().map(|w| ((even + w * scale) * weights.len() as f64) as f32).collect();
            Distribution2d::new(n, n, &mixed)
        };
        let by_direction = weights.chunks(resolution.place.pow(2));
        let sums: Vec<f64> = by_direction.clone().map(|w| w.iter().sum()).collect();
        let directions = (resolution.direction > 1).then(|| grid(resolution.direction, &sums));
        let places: Vec<Distribution2d> =
            if resolution.place > 1 { by_direction.map(|w| grid(resolution.place, w)).collect() } else { Vec::new() };
        let middle = |cell: usize, n: usize| Vec2::new((cell % n) as f32 + 0.5, (cell / n) as f32 + 0.5) / n as f32;
        let density = |i: usize| {
            let (direction, place) = (i / resolution.place.pow(2), i % resolution.place.pow(2));
            directions.as_ref().map_or(1.0, |d| d.pdf(middle(direction, resolution.direction)))
                * places.get(direction).map_or(1.0, |p| p.pdf(middle(place, resolution.place)))
        };
        let densities = (0..resolution.cells()).map(density).collect();
        Self { resolution, directions, places, densities }
    }

    /// The density at given numbers.
    #[inline]
    fn density(&self, numbers: (Vec2, Vec2)) -> f32 {
        self.densities[self.resolution.cell(numbers)]
    }

    /// Samples a start; the density is that of the numbers.
    fn sample(&self, light: &Light, ctx: &LightContext, mut u_pos: Vec2, mut u_dir: Vec2) -> Option<(LightLe, f32)> {
        let below_one = Vec2::splat(1.0f32.next_down());
        let mut density = 1.0;
        if let Some(directions) = &self.directions {
            let (u, pdf) = directions.sample(u_dir)?;
            (u_dir, density) = (u.min(below_one), pdf);
        }
        if !self.places.is_empty() {
            let (u, pdf) = self.places[cell(u_dir, self.resolution.direction)].sample(u_pos)?;
            u_pos = u.min(below_one);
            density *= pdf;
        }
        Some((light.sample_le(ctx, u_pos, u_dir)?, density))
    }
}

/// What a pilot says of guiding where light paths start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Guidance {
    /// Light paths are guided.
    pub used: bool,
    /// Noise × rays of a sample with guided light paths over that without.
    pub noise_times_rays: f64,
}

/// What the first pass learns of light paths.
#[derive(Clone, Debug)]
pub(super) struct Learnt {
    /// Where they start, if that is guided.
    pub emission: Option<Arc<Emission>>,
    pub guidance: Option<Guidance>,
    /// Of them for each camera path.
    pub per_pixel: u32,
}

impl Learnt {
    /// Learns the starts that matter to the light image of `recipe`, if there is something to guide and it pays, and how many
    /// paths to start.
    pub fn new(recipe: &Recipe) -> Self {
        let tried = Emission::try_out(recipe);
        let guidance = tried
            .as_ref()
            .map(|&(_, noise_times_rays)| Guidance { used: noise_times_rays < LEAST_GAIN, noise_times_rays });
        let emission = tried.map(|t| t.0).filter(|_| guidance.is_some_and(|g| g.used));
        let per_pixel = match (recipe.settings.light_paths, recipe.settings.merging) {
            (_, Merging::Off) => 1,
            (Some(n), _) => n,
            (None, _) => affordable(recipe, emission.clone()),
        };
        Self { emission, guidance, per_pixel }
    }
}

/// Light paths for each camera path that all together send out fewer rays than that: where light paths are short, as many of
/// them leave the scene, more of them take more off the noise of merges and of the light image than they cost.
fn affordable(recipe: &Recipe, emission: Option<Arc<Emission>>) -> u32 {
    let unmerged = VcmSettings { merging: Merging::Off, correlation_aware: false, ..recipe.settings };
    let mut recipe = Recipe::new(recipe.scene, &unmerged);
    recipe.emission = emission;
    let (camera, light) = Pilot::new(recipe, &[]).rays();
    (camera / light.max(1)).clamp(1, MOST_PER_PIXEL) as u32
}

/// Densities of the starts of light paths, by light.
#[derive(Debug)]
pub(super) struct Emission {
    lights: Vec<Option<Starts>>,
}

impl Emission {
    /// The start of a path from light `index`, its densities included.
    pub fn start(&self, scene: &Scene, index: usize, u_pos: Vec2, u_dir: Vec2) -> Option<LightLe> {
        let (light, ctx) = (&scene.lights[index], scene.light_context());
        let Some(starts) = &self.lights[index] else { return light.sample_le(&ctx, u_pos, u_dir) };
        let (mut le, density) = starts.sample(light, &ctx, u_pos, u_dir)?;
        le.weight = le.weight / density;
        // Weights see the density that the other techniques look up.
        let density = starts.density(light.start_numbers(&ctx, le.p, le.n, le.ray.d));
        // Lamps take the density of the place for that of light sampling, which stays.
        *(if le.delta_direction { &mut le.pdf_a } else { &mut le.pdf_w }) *= density;
        Some(le)
    }

    /// The density of a path of light `index` that starts at `p` (or passes it, if the light is distant) along `w`, relative
    /// to that of `sample_le`; `n` is the light's normal.
    pub fn density(&self, scene: &Scene, index: usize, p: Vec3, n: Vec3, w: Vec3) -> f64 {
        let Some(starts) = &self.lights[index] else { return 1.0 };
        starts.density(scene.lights[index].start_numbers(&scene.light_context(), p, n, w)) as f64
    }

    /// Starts that matter to the light image of `recipe`, with the noise times rays over those without; `None` where there is
    /// nothing to guide.
    pub(super) fn try_out(recipe: &Recipe) -> Option<(Arc<Self>, f64)> {
        let scene = recipe.scene;
        let used = recipe.settings.guided_emission && recipe.settings.light_image && recipe.traces_light();
        let resolutions: Vec<Option<Resolution>> = scene.lights.iter().map(Resolution::of).collect();
        if !used || scene.lights.len() > MOST_LIGHTS || resolutions.iter().all(Option::is_none) {
            return None;
        }
        let settings = VcmSettings { merging: Merging::Off, correlation_aware: false, ..recipe.settings };
        let mut pilot = Pilot::new(Recipe::new(scene, &settings), &resolutions);
        let mut paths = recipe.light_paths.div_ceil(PIXELS_PER_PATH).clamp(PATHS.0, PATHS.1);
        let uniform = pilot.survey(1);
        pilot.camera.clone_from(&uniform.camera);
        pilot.add(&uniform.paths, uniform.traced);
        let before = pilot.noise(&uniform) * uniform.rays as f64;
        for (round, &share) in UNIFORM.iter().enumerate() {
            if round > 0 {
                let found = pilot.trace(paths);
                pilot.add(&found, paths);
                paths *= 2;
            }
            let weights = pilot.squares.iter().zip(&resolutions).map(|(s, r)| r.map(|r| roots(s, r)));
            let starts = weights.zip(&resolutions).map(|(w, r)| Some(Starts::new((*r)?, &w?, share)));
            pilot.recipe.emission = Some(Arc::new(Self { lights: starts.collect() }));
        }
        let guided = pilot.survey(2);
        let after = pilot.noise(&guided) * guided.rays as f64;
        Some((pilot.recipe.emission?, after / before))
    }
}

/// Roots of squares that are blurred over all axes by ¼, ½, ¼: cells that no path met by chance are not left out.
fn roots(squares: &[f64], resolution: Resolution) -> Vec<f64> {
    let (place, direction) = (resolution.place, resolution.direction);
    let mut blurred = squares.to_vec();
    let mut stride = 1;
    for n in [place, place, direction, direction] {
        let before = blurred.clone();
        for (i, b) in blurred.iter_mut().enumerate() {
            let at = i / stride % n;
            let low = if at > 0 { before[i - stride] } else { before[i] };
            let high = if at + 1 < n { before[i + stride] } else { before[i] };
            *b = 0.5 * before[i] + 0.25 * (low + high);
        }
        stride *= n;
    }
    blurred.into_iter().map(f64::sqrt).collect()
}

/// What the rounds have found so far.
struct Pilot<'s> {
    recipe: Recipe<'s>,
    small: FilmWindow,
    /// By cell of the film.
    camera: Vec<f64>,
    splats: Vec<f64>,
    paths: u64,
    /// By light and cell of its numbers.
    squares: Vec<Vec<f64>>,
}

/// A light path that the lens sees.
struct Seen {
    light: usize,
    cell: usize,
    /// Density of the start relative to that of `sample_le`, with the probability of the light.
    density: f64,
    /// Cells of the film and what they receive.
    splats: Vec<(usize, f64)>,
}

/// Whole samples, [`SAMPLES`] in each cell.
struct Survey {
    /// What camera paths find, and how far the samples of a cell are apart, squared.
    camera: Vec<f64>,
    apart: Vec<f64>,
    paths: Vec<Seen>,
    /// Paths traced, seen or not.
    traced: u64,
    /// Rays of all kinds.
    rays: u64,
}

impl<'s> Pilot<'s> {
    fn new(recipe: Recipe<'s>, resolutions: &[Option<Resolution>]) -> Self {
        let small = recipe.scene.camera.window().shrunk(MOST_CELLS);
        let squares = resolutions.iter().map(|r| vec![0.0; r.map_or(0, Resolution::cells)]).collect();
        let cells = small.crop_size.0 as usize * small.crop_size.1 as usize;
        Self { recipe, small, camera: vec![0.0; cells], splats: vec![0.0; cells], paths: 0, squares }
    }

    fn sampler(&self, index: u64, purpose: u64) -> Sampler {
        Sampler::new(Sequence::Independent, Key::new(purpose, Purpose::Pilot, Purpose::LightPath as u64), index)
    }

    fn survey(&self, number: u64) -> Survey {
        let cells = self.camera.len() as u64;
        let look = |i: u64| {
            let mut sink = LightSink::default();
            let collect = Collect { vertices: self.recipe.connects(), bsdfs: true, splats: true };
            let seen = self.path(self.sampler(i, 4 * number), collect, &mut sink);
            (self.look(i / SAMPLES, self.sampler(i, 4 * number + 1), &mut sink), seen, sink.counters)
        };
        let found: Vec<_> = (0..cells * SAMPLES).into_par_iter().map(look).collect();
        let pairs = found.chunks(SAMPLES as usize).map(|c| (c[0].0, c[1].0));
        Survey {
            camera: pairs.clone().map(|(a, b)| 0.5 * (a + b)).collect(),
            apart: pairs.map(|(a, b)| 0.5 * (a - b).powi(2)).collect(),
            traced: cells * SAMPLES,
            rays: found.iter().map(|f| f.2.camera_rays + f.2.shadow_rays + f.2.photon_rays).sum(),
            paths: found.into_iter().filter_map(|f| f.1).collect(),
        }
    }

    /// Rays that as many camera paths and light paths send out, those to the lens among the latter's.
    fn rays(&self) -> (u64, u64) {
        let cells = self.camera.len() as u64;
        let count = cells.min(COUNTED);
        let rays = |i: u64| {
            let mut sink = LightSink::default();
            let collect = Collect { vertices: false, bsdfs: false, splats: true };
            self.path(self.sampler(i, 12), collect, &mut sink);
            let light = sink.counters.photon_rays + sink.counters.shadow_rays;
            self.look(i * cells / count, self.sampler(i, 13), &mut sink);
            (sink.counters.camera_rays, light)
        };
        (0..count).map(rays).fold((0, 0), |(c, l), (camera, light)| (c + camera, l + light))
    }

    /// What a camera path finds in a cell, with the light path in `sink`.
    fn look(&self, cell: u64, mut sampler: Sampler, sink: &mut LightSink) -> f64 {
        let window = self.recipe.scene.camera.window();
        let columns = self.small.crop_size.0 as u64;
        let side = |a: (u32, u32)| Vec2::new(a.0 as f32, a.1 as f32);
        let scale = side(window.crop_size) / side(self.small.crop_size);
        // One pixel of each cell: what is seen elsewhere in it is no noise.
        let at = Vec2::new((cell % columns) as f32, (cell / columns) as f32) + self.sampler(cell, 3).next_2d();
        let pixel = side(window.crop_offset) + (at * scale).floor().min(side(window.crop_size) - 1.0);
        let ray = self.recipe.scene.camera_ray(pixel + sampler.next_2d(), sampler.next_2d());
        let LightSink { vertices, bsdfs, links, counters, .. } = sink;
        let field = LightField { vertices, bsdfs, grid: None, eta: 0.0, links };
        let value = radiance(&self.recipe, &ray, &field, &mut sampler, counters).mean();
        if value.is_finite() { value as f64 } else { 0.0 }
    }

    /// Light paths alone.
    fn trace(&self, paths: u64) -> Vec<Seen> {
        let first = self.paths;
        let chunk = |chunk: u64| {
            let (mut sink, mut seen) = (LightSink::default(), Vec::new());
            for index in first + chunk * CHUNK..first + ((chunk + 1) * CHUNK).min(paths) {
                let collect = Collect { vertices: false, bsdfs: false, splats: true };
                seen.extend(self.path(self.sampler(index, 0), collect, &mut sink));
                sink.clear();
            }
            seen
        };
        let chunks: Vec<Vec<Seen>> = (0..paths.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
        chunks.into_iter().flatten().collect()
    }

    /// Adds the squares of what paths splat; `traced` of them were not all seen.
    fn add(&mut self, paths: &[Seen], traced: u64) {
        self.paths += traced;
        for &(cell, value) in paths.iter().flat_map(|s| &s.splats) {
            self.splats[cell] += value;
        }
        let picture = self.picture();
        for seen in paths {
            // A splat is f/p, so that f²/p is its square times p.
            if let Some(sum) = self.squares[seen.light].get_mut(seen.cell) {
                *sum += seen.square(&picture) * seen.density;
            }
        }
    }

    /// Variance of one sample of a pixel over the picture squared, with the splats of as many light paths as pixels.
    fn noise(&self, survey: &Survey) -> f64 {
        let picture = self.picture();
        let camera = trimmed(survey.apart.iter().zip(&picture).map(|(a, p)| a / p.powi(2)).collect());
        let splats = trimmed(survey.paths.iter().map(|s| s.square(&picture)).collect());
        camera * survey.camera.len() as f64 + splats * survey.paths.len() as f64 / SAMPLES as f64
    }

    fn path(&self, sampler: Sampler, collect: Collect, sink: &mut LightSink) -> Option<Seen> {
        let scene = self.recipe.scene;
        let (window, (columns, rows)) = (scene.camera.window(), self.small.crop_size);
        let walk = LightWalk::start(&self.recipe, &mut sampler.clone())?;
        trace(&self.recipe, 0.0, sampler, collect, sink);
        if sink.splats.is_empty() {
            return None;
        }
        let place = |x: f32, offset: u32, size: u32, cells: u32| {
            (((x - offset as f32) * cells as f32 / size as f32) as u32).min(cells - 1)
        };
        let splat = |&(raster, value): &(Vec2, Rgb)| {
            let x = place(raster.x, window.crop_offset.0, window.crop_size.0, columns);
            let y = place(raster.y, window.crop_offset.1, window.crop_size.1, rows);
            ((y * columns + x) as usize, value.mean() as f64)
        };
        let (light, pmf) = walk.light;
        let (le, kind) = (&walk.le, &scene.lights[light]);
        let numbers = kind.start_numbers(&scene.light_context(), le.p, le.n, le.ray.d);
        let cell = Resolution::of(kind).map_or(0, |r| r.cell(numbers));
        let density = pmf as f64 * self.recipe.emission_density(light, le.p, le.n, le.ray.d);
        Some(Seen { light, cell, density, splats: sink.splats.iter().map(splat).collect() })
    }

    /// The picture so far, smoothed, and not darker than what errors are relative to.
    fn picture(&self) -> Vec<f64> {
        let (columns, rows) = (self.small.crop_size.0 as usize, self.small.crop_size.1 as usize);
        // Splats are W·m⁻²·sr⁻¹ of one pixel, of as many paths as pixels.
        let scale = self.camera.len() as f64 / self.paths as f64;
        let raw = |i: usize| self.camera[i] + scale * self.splats[i];
        let near = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
        let smooth = |i: usize| {
            let (xs, ys) = (near(i % columns, columns), near(i / columns, rows));
            let count = xs.len() * ys.len();
            ys.flat_map(|y| xs.clone().map(move |x| raw(y * columns + x))).sum::<f64>() / count as f64
        };
        let picture: Vec<f64> = (0..self.camera.len()).map(smooth).collect();
        let floor = DARK * picture.iter().sum::<f64>() / picture.len().max(1) as f64;
        picture.into_iter().map(|p| p.hypot(floor).max(f64::MIN_POSITIVE)).collect()
    }
}

impl Seen {
    /// The sum of squares of all splats over the picture.
    fn square(&self, picture: &[f64]) -> f64 {
        self.splats.iter().map(|&(c, v)| (v / picture[c]).powi(2)).sum()
    }
}

/// The mean, where the highest values count as the next one does.
fn trimmed(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let most = values[last - (TRIMMED * values.len() as f64) as usize];
    values.iter().map(|v| v.min(most)).sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::super::tests::scenes::{DISTANT, load};
    use super::super::{Workspace, render_pass};
    use super::*;
    use crate::film::Film;

    /// Light that leaves an open scene costs less than camera paths that go through glass; in a closed box it costs as much.
    #[test]
    fn light_paths_are_as_many_as_camera_paths_can_afford() {
        let per_pixel = |name: &str, settings: VcmSettings| {
            let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
            let scene = Scene::load(&path, &crate::scene::LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
            Learnt::new(&Recipe::new(&scene, &settings)).per_pixel
        };
        let vcm = VcmSettings::default();
        assert_eq!((per_pixel("gallery/glass-sphere.xml", vcm), per_pixel("cornell-spheres.xml", vcm)), (2, 1));
        let asked = VcmSettings { light_paths: Some(3), ..vcm };
        assert_eq!(per_pixel("cornell-spheres.xml", asked), 3);
        let unmerged = VcmSettings { merging: Merging::Off, ..asked };
        assert_eq!(per_pixel("cornell-spheres.xml", unmerged), 1);
    }

    /// A render tells what its pilot found, and has none where it is not asked for.
    #[test]
    fn guidance_is_told() {
        let scene = load("orthographic", DISTANT);
        for asked in [true, false] {
            let settings = VcmSettings { guided_emission: asked, ..VcmSettings::bdpt() };
            let mut film = Film::new(scene.camera.window(), scene.film.filter);
            let mut workspace = Workspace::default();
            render_pass(&scene, &settings, 1, 0..1, &mut film, &mut workspace, &|_| ());
            let guidance = workspace.guidance();
            assert_eq!(guidance.is_some(), asked);
            assert!(guidance.is_none_or(|g| g.used == (g.noise_times_rays < LEAST_GAIN) && g.noise_times_rays > 0.0));
            assert_eq!(workspace.learnt.unwrap().emission.is_some(), guidance.is_some_and(|g| g.used));
        }
    }
}
