//! Where direct light is known to arrive, or not to: shadow photons [Jensen and Christensen 1995].
//!
//! Rays from the lights are followed through everything that they meet. The first surface is lit by them, those behind it
//! are in shadow. A cell of the surfaces in which all such photons of a light agree, and all those in the cells around it,
//! needs no shadow rays to that light. What is smaller than a cell and met by no photon is missed: an approximation, off
//! unless asked for.

use rayon::prelude::*;

use super::cells::{Entry, LEVELS, Table, exp2, facing, key, level_below};
use crate::geometry::SurfaceInteraction;
use crate::math::Vec3;
use crate::sample::{Key, Purpose, Sampler, Sequence, hash_u64};
use crate::scene::Scene;
use crate::tally::Counters;

/// Photons of a light in a cell on average; cells are as small as that allows.
const PHOTONS_PER_CELL: f64 = 48.0;

/// Photons of a light in a cell at least, for the cell to be judged.
const LEAST_PHOTONS: u32 = 12;

/// Rays that one task follows.
const RAYS_PER_BATCH: u64 = 4096;

/// Surfaces that a ray from a light is followed through.
const MAX_HITS: u32 = 8;

/// A meeting of a ray from a light with a surface.
struct ShadowPhoton {
    p: Vec3,
    facing: u32,
    light: u32,
    lit: bool,
}

/// Photons of one light in one cell.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    key: u64,
    lit: u32,
    shadowed: u32,
    /// One of the photons, to find the cells around it.
    photon: u32,
}

/// Whether a light is wholly visible from a cell, or wholly hidden.
#[derive(Clone, Copy, Debug, Default)]
struct Verdict {
    key: u64,
    lit: bool,
}

impl Entry for Count {
    #[inline]
    fn key(&self) -> u64 {
        self.key
    }
}

impl Entry for Verdict {
    #[inline]
    fn key(&self) -> u64 {
        self.key
    }
}

/// The cells of the surfaces from which lights are known to be visible or hidden.
pub struct ShadowMap {
    /// Binary logarithm of the cells' side, scene units.
    level: i32,
    cells: Table<Verdict>,
}

impl ShadowMap {
    /// Follows `paths` rays from lights chosen by their power. Light of the environment is left to shadow rays.
    pub fn shoot(scene: &Scene, paths: u64, seed: u64, pass: u64, counters: &mut Counters) -> Self {
        let key = Key::new(seed, Purpose::Shadow, pass);
        let batches: Vec<Vec<ShadowPhoton>> = (0..paths.div_ceil(RAYS_PER_BATCH))
            .into_par_iter()
            .map(|batch| {
                let first = batch * RAYS_PER_BATCH;
                let mut photons = Vec::new();
                (first..(first + RAYS_PER_BATCH).min(paths)).for_each(|i| follow(scene, key, i, &mut photons));
                photons
            })
            .collect();
        let photons: Vec<ShadowPhoton> = batches.into_iter().flatten().collect();
        counters.photon_rays += photons.len() as u64;
        let (level, counts) = finest(&photons, scene.bounding_sphere().1);
        let table = Table::new(counts.clone());
        let verdicts = counts.par_iter().filter_map(|count| judge(&table, &photons, count, level)).collect();
        Self { level, cells: Table::new(verdicts) }
    }

    /// Whether light `light` is visible from `si` in direction `wi`, where that is known.
    #[inline]
    pub fn visible(&self, si: &SurfaceInteraction, light: usize, wi: Vec3) -> Option<bool> {
        let facing = facing(si.ng, wi.dot(si.ng) > 0.0);
        self.cells.find(cell_key(si.p, self.level, facing, light as u32)).map(|v| v.lit)
    }

    pub fn memory(&self) -> usize {
        self.cells.memory()
    }
}

/// The surfaces that the ray `index` meets on its way from a light.
fn follow(scene: &Scene, key: Key, index: u64, photons: &mut Vec<ShadowPhoton>) {
    let mut sampler = Sampler::new(Sequence::Sobol, key, index);
    let (u_light, u_pos, u_dir) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
    let Some((light, _)) = scene.selector.sample(u_light) else { return };
    if scene.environment == Some(light as u32) {
        return;
    }
    let Some(le) = scene.lights[light].sample_le(&scene.light_context(), u_pos, u_dir) else { return };
    let mut ray = scene.from_light(le.ray);
    for hits in 0..MAX_HITS {
        let Some(hit) = scene.hit(&mut ray) else { return };
        let si = scene.interaction(&ray, &hit);
        let facing = facing(si.ng, si.wo.dot(si.ng) > 0.0);
        photons.push(ShadowPhoton { p: si.p, facing, light: light as u32, lit: hits == 0 });
        ray = si.spawn_ray(ray.d);
    }
}

/// The name of a cell as one light sees it.
#[inline]
fn cell_key(p: Vec3, level: i32, facing: u32, light: u32) -> u64 {
    hash_u64(key(p, level, facing), u64::from(light)) | 1 << 63
}

/// The smallest cells that hold enough photons, and what is in them, in the order of their keys.
fn finest(photons: &[ShadowPhoton], radius: f32) -> (i32, Vec<Count>) {
    let coarsest = level_below(0.25 * radius);
    let mut best = (coarsest, count(photons, coarsest));
    for level in (LEVELS.0..coarsest).rev() {
        let counts = count(photons, level);
        if (photons.len() as f64) < PHOTONS_PER_CELL * counts.len() as f64 {
            break;
        }
        best = (level, counts);
    }
    best
}

/// Counts photons by cell and light.
fn count(photons: &[ShadowPhoton], level: i32) -> Vec<Count> {
    let one = |(i, s): (usize, &ShadowPhoton)| {
        let key = cell_key(s.p, level, s.facing, s.light);
        Count { key, lit: u32::from(s.lit), shadowed: u32::from(!s.lit), photon: i as u32 }
    };
    let mut counts: Vec<Count> = photons.par_iter().enumerate().map(one).collect();
    counts.par_sort_unstable_by_key(|c| (c.key, c.photon));
    counts.dedup_by(|next, first| {
        let same = next.key == first.key;
        if same {
            first.lit += next.lit;
            first.shadowed += next.shadowed;
        }
        same
    });
    counts
}

/// What is known of a cell, if its photons and those of the cells around it agree.
fn judge(table: &Table<Count>, photons: &[ShadowPhoton], count: &Count, level: i32) -> Option<Verdict> {
    if count.lit + count.shadowed < LEAST_PHOTONS || (count.lit > 0 && count.shadowed > 0) {
        return None;
    }
    let lit = count.lit > 0;
    let photon = &photons[count.photon as usize];
    let side = exp2(level);
    let middle = ((photon.p / side).floor() + 0.5) * side;
    let around = |i: u32| {
        let step = Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) - 1.0;
        let near = table.find(cell_key(middle + step * side, level, photon.facing, photon.light));
        near.is_none_or(|c| if lit { c.shadowed == 0 } else { c.lit == 0 })
    };
    (0..27).all(around).then_some(Verdict { key: count.key, lit })
}
