//! A pilot that tells what leaving out techniques would do to noise.
//!
//! Samples of all techniques `t` together have the density `Σ p`, and a weighted contribution is `c = f / Σ p`. Of a recipe
//! that has less of the techniques the second moment is `∫ f² / Σ' p`, so that each contribution of the full recipe adds
//! `c² Σ p / Σ' p` to its estimate [Grittmann, Yazici, Georgiev and Slusallek 2022, "Efficiency-aware multiple importance
//! sampling for bidirectional rendering algorithms", §4]. Light that the full recipe finds and the other one hardly does is
//! thus told by the full recipe's samples, which find it often; what the other cannot find at all makes it infinite.
//!
//! The film is divided into cells, of which each takes one camera sample in each pass, in one of its pixels. Light paths are as
//! many as cells, and merges reach further by as much as those are fewer than pixels: as many are found as in the render.

use std::collections::HashMap;
use std::f64::consts::PI;

use rayon::prelude::*;

use super::Recipe;
use super::camera_path::{CameraWalk, connection_sums, escape_densities, hit_densities, next_event_sums};
use super::event::Event;
use super::grid::MIN_NORMAL_COS;
use super::light_path::{LightVertex, LightWalk, lens_sees, lens_sums};
use super::step::CameraVertex;
use super::weights::{Mis, merged_side};
use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::{Ray, SurfaceInteraction};
use crate::image::FilmWindow;
use crate::math::{Vec2, Vec3};
use crate::sample::{Key, Purpose, Sampler, Sequence};

/// Techniques that can be left out, as bits.
pub(super) const MERGING: u8 = 1;
pub(super) const CONNECTIONS: u8 = 2;
pub(super) const LIGHT_IMAGE: u8 = 4;

/// The full recipe and all that lack some techniques.
pub(super) const MOST_VARIANTS: usize = 8;

/// Passes of the pilot.
pub(super) const PASSES: u64 = 4;

/// Cells of the film at most.
const MOST_CELLS: u64 = 48 * 48;

/// A recipe without some techniques; the first one of a list lacks none.
pub(super) struct Variant<'s> {
    pub recipe: Recipe<'s>,
    /// What is left out, as bits.
    pub without: u8,
}

/// What one pass found in one cell. Values are means of the channels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cell {
    /// The camera sample as each variant weighs it.
    pub value: [f64; MOST_VARIANTS],
    /// Splats of the full recipe, and the sum of their squares.
    pub splats: f64,
    pub splats_sq: f64,
    /// What each variant adds to the second moment of all contributions, by the samples of the full recipe.
    pub added: [f64; MOST_VARIANTS],
    /// The same by the variant's own contributions to the camera sample.
    pub added_here: [f64; MOST_VARIANTS],
}

/// What a pilot did, by technique.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    pub camera_rays: u64,
    pub photon_rays: u64,
    pub light_samples: u64,
    pub connections: u64,
    pub lens: u64,
    pub queries: u64,
    pub merges: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, o: Self) {
        self.camera_rays += o.camera_rays;
        self.photon_rays += o.photon_rays;
        self.light_samples += o.light_samples;
        self.connections += o.connections;
        self.lens += o.lens;
        self.queries += o.queries;
        self.merges += o.merges;
    }
}

/// The cells of the film and what all passes found.
pub(super) struct Findings {
    pub columns: u32,
    /// By pass, row after row.
    pub passes: Vec<Vec<Cell>>,
    pub counts: Counts,
}

/// The partial sums of all variants at a vertex.
type Sums = [Mis; MOST_VARIANTS];

/// A vertex of a light path.
struct LightEnd {
    vertex: LightVertex,
    sums: Sums,
    bsdf: Bsdf,
}

/// A light path's splat, with what the variants make of it.
struct Splat {
    raster: Vec2,
    cell: Cell,
}

#[derive(Default)]
struct LightPath {
    ends: Vec<LightEnd>,
    splats: Vec<Splat>,
    counts: Counts,
}

/// Light vertices that can be merged, by the cell of space that they are in.
struct Photons<'a> {
    cells: HashMap<(i32, i32, i32), Vec<&'a LightEnd>>,
    radius: f32,
}

struct Pilot<'a, 's> {
    variants: &'a [Variant<'s>],
    eta: f64,
    /// Film of cells.
    small: FilmWindow,
    key: Key,
}

/// Runs the pilot of `variants`, the first of which has all techniques.
pub(super) fn run(variants: &[Variant], seed: u64) -> Findings {
    let full = &variants[0].recipe;
    let radius = full.radius(0);
    let small = full.scene.camera.window().shrunk(MOST_CELLS);
    let pilot = Pilot {
        variants,
        eta: PI * radius * radius * full.light_paths as f64,
        small,
        key: Key::new(seed, Purpose::Pilot, PASSES),
    };
    let (columns, rows) = small.crop_size;
    let reach = radius * (full.light_paths as f64 / (columns as f64 * rows as f64)).sqrt();
    let mut counts = Counts::default();
    let passes = (0..PASSES).map(|pass| pilot.pass(pass, reach as f32, &mut counts)).collect();
    Findings { columns, passes, counts }
}

impl<'a> Photons<'a> {
    fn new(paths: &'a [LightPath], radius: f32) -> Self {
        let mut photons = Self { cells: HashMap::new(), radius };
        if radius > 0.0 {
            for end in paths.iter().flat_map(|p| &p.ends).filter(|e| e.vertex.merges) {
                photons.cells.entry(photons.cell(end.vertex.si.p, Vec3::ZERO)).or_default().push(end);
            }
        }
        photons
    }

    /// The cell at `p`, cells being two radii wide, or one near it.
    fn cell(&self, p: Vec3, shift: Vec3) -> (i32, i32, i32) {
        let c = (p / (2.0 * self.radius) + shift).floor().as_ivec3();
        (c.x, c.y, c.z)
    }

    /// All within the radius around `p`, with their squared distances.
    fn within(&self, p: Vec3) -> impl Iterator<Item = (&'a LightEnd, f32)> {
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) - 0.5;
        let near = (0..8u32).filter_map(move |i| self.cells.get(&self.cell(p, corner(i)))).flatten();
        near.map(move |end| (*end, p.distance_squared(end.vertex.si.p))).filter(|(_, d)| *d < self.radius.powi(2))
    }
}

impl Pilot<'_, '_> {
    fn full(&self) -> &Recipe<'_> {
        &self.variants[0].recipe
    }

    fn pass(&self, pass: u64, reach: f32, counts: &mut Counts) -> Vec<Cell> {
        let (columns, rows) = self.small.crop_size;
        let count = columns * rows;
        let sampler =
            |i: u32, end: u64| Sampler::new(Sequence::Independent, self.key.with(2 * u64::from(i) + end), pass);
        let light = |i| if self.full().traces_light() { self.light_path(sampler(i, 0)) } else { LightPath::default() };
        let paths: Vec<LightPath> = (0..count).into_par_iter().map(light).collect();
        let photons = Photons::new(&paths, reach);
        let camera = |i: u32| {
            let mut counts = Counts::default();
            let cell = self.camera_path(i, &paths[i as usize].ends, &photons, sampler(i, 1), &mut counts);
            (cell, counts)
        };
        let found: Vec<(Cell, Counts)> = (0..count).into_par_iter().map(camera).collect();
        let mut cells: Vec<Cell> = found.iter().map(|f| f.0).collect();
        for (_, c) in &found {
            *counts += *c;
        }
        // Splats come in the order of their paths.
        let window = self.full().scene.camera.window();
        let place = |x: f32, offset: u32, size: u32, cells: u32| {
            (((x - offset as f32) * cells as f32 / size as f32) as u32).min(cells - 1)
        };
        for path in &paths {
            *counts += path.counts;
            for s in &path.splats {
                let x = place(s.raster.x, window.crop_offset.0, window.crop_size.0, columns);
                let y = place(s.raster.y, window.crop_offset.1, window.crop_size.1, rows);
                let cell = &mut cells[(y * columns + x) as usize];
                cell.splats += s.cell.splats;
                cell.splats_sq += s.cell.splats * s.cell.splats;
                for (sum, a) in cell.added.iter_mut().zip(s.cell.added) {
                    *sum += a;
                }
            }
        }
        cells
    }

    /// Weighs a contribution of `technique` (0 for those that stay), where `value` has no weight yet and `sums` are what the
    /// other techniques of each variant amount to. Returns what it is in the full recipe.
    fn weigh(&self, value: f32, technique: u8, sums: &[f64; MOST_VARIANTS], cell: &mut Cell) -> f64 {
        let all = 1.0 + sums[0];
        let c = f64::from(value) / all;
        if !(c > 0.0 && c.is_finite()) {
            return 0.0;
        }
        for (i, v) in self.variants.iter().enumerate() {
            let own = if v.without & technique == 0 { 1.0 } else { 0.0 };
            // Both sums round.
            let ratio = (all / (own + sums[i])).max(1.0);
            cell.added[i] += c * c * (ratio - 1.0);
            let here = own * c * ratio;
            if technique != LIGHT_IMAGE {
                cell.value[i] += here;
                cell.added_here[i] += here * here - c * c;
            }
        }
        c
    }

    /// `f` of each variant.
    fn each(&self, mut f: impl FnMut(usize, &Recipe) -> f64) -> [f64; MOST_VARIANTS] {
        let mut out = [0.0; MOST_VARIANTS];
        for (i, v) in self.variants.iter().enumerate() {
            out[i] = f(i, &v.recipe);
        }
        out
    }

    fn light_path(&self, mut sampler: Sampler) -> LightPath {
        let (full, scene) = (self.full(), self.full().scene);
        let mut path = LightPath::default();
        let numbers = sampler;
        let walks: Option<Vec<LightWalk>> = self
            .variants
            .iter()
            .map(|v| {
                sampler = numbers;
                LightWalk::start(&v.recipe, &mut sampler)
            })
            .collect();
        let Some(mut walks) = walks else { return path };
        let mut depth = 0;
        while depth + 1 < full.max_depth {
            path.counts.photon_rays += 1;
            let Some(si) = scene.intersect(&mut walks[0].ray) else { break };
            depth += 1;
            let mut sums = Sums::default();
            for ((walk, v), mis) in walks.iter_mut().zip(self.variants).zip(&mut sums) {
                walk.arrive(&v.recipe, &si);
                *mis = walk.mis;
            }
            let bsdf = scene.bsdf(&si);
            if bsdf.lobes().intersects(LobeMask::SMOOTH) {
                let end = LightEnd { vertex: walks[0].vertex(full, &si), sums, bsdf };
                let u = sampler.next_2d();
                if full.settings.light_image {
                    path.counts.lens += 1;
                    path.splats.extend(self.splat(&end, u));
                }
                path.ends.push(end);
            }
            let numbers = sampler;
            let mut alive = true;
            for (walk, v) in walks.iter_mut().zip(self.variants) {
                sampler = numbers;
                alive &= walk.scatter(&v.recipe, &si, &bsdf, self.eta, &mut sampler);
            }
            if !alive {
                break;
            }
        }
        path
    }

    /// The vertex as variant `i` knows it.
    fn end_of(&self, end: &LightEnd, i: usize) -> LightVertex {
        let merges = end.vertex.merges && self.variants[i].without & MERGING == 0;
        LightVertex { mis: end.sums[i], merges, ..end.vertex }
    }

    fn splat(&self, end: &LightEnd, u: Vec2) -> Option<Splat> {
        let (full, si) = (self.full(), &end.vertex.si);
        if full.settings.hide_emitters && full.scene.is_emitter(si) {
            return None;
        }
        let we = full.scene.camera.we(si.p, u)?;
        let event = Event::new(full, si, &end.bsdf, we.wi, Mode::Importance)?;
        if !lens_sees(full, si, we.start) {
            return None;
        }
        let sums = self.each(|i, recipe| {
            lens_sums(recipe, self.eta, &self.end_of(end, i), (we.wi, we.importance), event.pdf, None)
        });
        let value = (end.vertex.beta * event.f).mean() * we.importance / full.light_paths as f32;
        let mut cell = Cell::default();
        cell.splats = self.weigh(value, LIGHT_IMAGE, &sums, &mut cell);
        Some(Splat { raster: we.raster, cell })
    }

    /// A camera sample in cell `index`.
    fn camera_path(
        &self,
        index: u32,
        ends: &[LightEnd],
        photons: &Photons,
        mut sampler: Sampler,
        counts: &mut Counts,
    ) -> Cell {
        let (full, scene) = (self.full(), self.full().scene);
        let mut cell = Cell::default();
        let (window, (columns, rows)) = (scene.camera.window(), self.small.crop_size);
        let middle = |i: u32, offset: u32, size: u32, cells: u32| {
            offset + (((i as f64 + 0.5) * size as f64 / cells as f64) as u32).min(size - 1)
        };
        let x = middle(index % columns, window.crop_offset.0, window.crop_size.0, columns);
        let y = middle(index / columns, window.crop_offset.1, window.crop_size.1, rows);
        let start = scene.camera_ray(Vec2::new(x as f32, y as f32) + sampler.next_2d(), sampler.next_2d());
        let mut walks: Vec<CameraWalk> = self.variants.iter().map(|v| CameraWalk::start(&v.recipe, &start)).collect();
        let mut hide = full.settings.hide_emitters;
        while walks[0].depth < full.max_depth {
            counts.camera_rays += 1;
            let Some(si) = scene.intersect(&mut walks[0].ray) else {
                let light = if hide { Rgb::BLACK } else { scene.environment_radiance(walks[0].ray.d) };
                if !light.is_black() {
                    let (direct, emit) = escape_densities(full, walks[0].from, walks[0].ray.d);
                    walks.iter_mut().for_each(|w| w.depth += 1);
                    self.meet(&walks, light, (direct, emit), &mut cell);
                }
                break;
            };
            let emitter = scene.is_emitter(&si);
            if emitter && hide {
                walks[0].ray = Ray { tmax: walks[0].ray.tmax, ..si.spawn_ray(walks[0].ray.d) };
                continue;
            }
            hide = false;
            let from = walks[0].from;
            walks.iter_mut().for_each(|w| w.arrive(&si));
            if emitter {
                let densities = hit_densities(full, &si, from);
                self.meet(&walks, scene.emitted(&si, si.wo), densities, &mut cell);
            }
            if walks[0].depth >= full.max_depth {
                break;
            }
            for (w, v) in walks.iter_mut().zip(self.variants) {
                w.mis.resolve(v.recipe.focuses(&si));
                v.recipe.settle(&mut w.mis, w.depth);
            }
            let bsdf = scene.bsdf(&si);
            if bsdf.lobes().intersects(LobeMask::SMOOTH) {
                self.light_sample(&walks, &si, &bsdf, &mut sampler, &mut cell, counts);
                self.connect(&walks, &si, &bsdf, ends, &mut cell, counts);
                self.merge(&walks, &si, &bsdf, photons, &mut cell, counts);
            }
            let numbers = sampler;
            let mut alive = true;
            for (w, v) in walks.iter_mut().zip(self.variants) {
                sampler = numbers;
                alive &= w.scatter(&v.recipe, &si, &bsdf, self.eta, &mut sampler);
            }
            if !alive {
                break;
            }
        }
        cell
    }

    /// Light that all walks have met.
    fn meet(&self, walks: &[CameraWalk], light: Rgb, (direct, emit): (f64, f64), cell: &mut Cell) {
        let sums = self.each(|i, recipe| 1.0 / f64::from(walks[i].emitter_weight(recipe, direct, emit)) - 1.0);
        self.weigh((walks[0].beta * light).mean(), 0, &sums, cell);
    }

    /// The vertex as variant `i` knows it.
    fn vertex<'v>(
        &self,
        walks: &'v [CameraWalk],
        si: &'v SurfaceInteraction,
        bsdf: &'v Bsdf,
        i: usize,
    ) -> CameraVertex<'v> {
        let merge = if self.variants[i].recipe.mergeable(si) { self.eta } else { 0.0 };
        CameraVertex { si, bsdf, mis: &walks[i].mis, depth: walks[i].depth, merge, trails: None }
    }

    fn light_sample(
        &self,
        walks: &[CameraWalk],
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        sampler: &mut Sampler,
        cell: &mut Cell,
        counts: &mut Counts,
    ) {
        let scene = self.full().scene;
        let (u_light, u) = (sampler.next_1d(), sampler.next_2d());
        let Some((index, pmf)) = scene.selector.sample(u_light) else { return };
        let Some(li) = scene.lights[index].sample_li(&scene.light_context(), si.p, u) else { return };
        if li.radiance.is_black() {
            return;
        }
        let Some(event) = Event::new(self.full(), si, bsdf, li.wi, Mode::Radiance) else { return };
        counts.light_samples += 1;
        if scene.unoccluded(si, &li) {
            let sums = self.each(|i, recipe| {
                next_event_sums(recipe, &self.vertex(walks, si, bsdf, i), self.eta, (index, &li), event.pdf)
            });
            let value = (walks[0].beta * event.f * li.radiance).mean() / (pmf * li.pdf_w);
            self.weigh(value, 0, &sums, cell);
        }
    }

    fn connect(
        &self,
        walks: &[CameraWalk],
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        ends: &[LightEnd],
        cell: &mut Cell,
        counts: &mut Counts,
    ) {
        let full = self.full();
        let depth = walks[0].depth;
        if !full.connects() {
            return;
        }
        for end in ends.iter().take_while(|e| e.vertex.depth + depth < full.max_depth) {
            let light = &end.vertex.si;
            let d = light.p - si.p;
            let dist_sq = d.length_squared();
            let w = d / dist_sq.sqrt();
            let Some(here) = Event::new(full, si, bsdf, w, Mode::Radiance) else { continue };
            let Some(there) = Event::new(full, light, &end.bsdf, -w, Mode::Importance) else { continue };
            counts.connections += 1;
            if !full.scene.visible(si, (light.p, light.p_err, light.ng)) {
                continue;
            }
            let sums = self.each(|i, recipe| {
                let (v, z) = (self.vertex(walks, si, bsdf, i), self.end_of(end, i));
                connection_sums(recipe, &v, &z, (here.pdf, there.pdf), (w, dist_sq as f64), self.eta)
            });
            let value = (walks[0].beta * here.f * there.f * end.vertex.beta).mean() / dist_sq;
            self.weigh(value, CONNECTIONS, &sums, cell);
        }
    }

    fn merge(
        &self,
        walks: &[CameraWalk],
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        photons: &Photons,
        cell: &mut Cell,
        counts: &mut Counts,
    ) {
        let full = self.full();
        if !full.mergeable(si) {
            return;
        }
        counts.queries += 1;
        let deepest = full.max_depth - walks[0].depth;
        let paths = self.small.crop_size.0 as f32 * self.small.crop_size.1 as f32;
        let area = PI as f32 * photons.radius * photons.radius * paths;
        for (end, d_sq) in photons.within(si.p).filter(|(e, _)| e.vertex.depth <= deepest) {
            let (wi, ng) = (end.vertex.si.wo, end.vertex.si.ng);
            let f = bsdf.eval(si.wo, wi, Mode::Radiance, LobeMask::ALL);
            if ng.dot(si.ng) < MIN_NORMAL_COS || f.is_black() {
                continue;
            }
            counts.merges += 1;
            let fwd = bsdf.pdf(si.wo, wi, Mode::Radiance, LobeMask::ALL) as f64;
            let rev = bsdf.pdf(wi, si.wo, Mode::Importance, LobeMask::ALL) as f64;
            // A variant without merges holds none in its sums: they are relative to the density of this one all the same.
            let sums = self.each(|i, recipe| {
                merged_side(&end.sums[i], fwd, recipe.connect, self.eta)
                    + merged_side(&walks[i].mis, rev, recipe.connect, self.eta)
            });
            let kernel = 2.0 * (1.0 - d_sq / photons.radius.powi(2)) / (wi.dot(ng).abs() * area);
            let value = (walks[0].beta * f * end.vertex.beta).mean() * kernel;
            self.weigh(value, MERGING, &sums, cell);
        }
    }
}
