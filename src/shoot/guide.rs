//! Emission aimed at what matters: a learnt density over the random numbers that a light turns into a photon's start.
//!
//! A light's `sample_le` maps four numbers, two for the position and two for the direction, to a ray. A grid over these
//! numbers serves every kind of light. It begins as a projection map [Jensen 2001, §6.2]: cells from which a ray passes near
//! a specular surface get half of the paths. A few short rounds then measure what the paths of each cell deposit, and the
//! final density is proportional to the root of the mean square of that, which makes the variance least. A fixed share stays
//! uniform [Grittmann et al. 2018], so that no power is ever out of proportion, and every path is divided by its density:
//! aiming changes the noise and not the mean.
//!
//! A scene file may weigh what is deposited by the importance of the shape that its path meets first (`photon_target`), and
//! fix the probability of a light (`photon_share`).

use rayon::prelude::*;

use super::walk::{Deposit, Start};
use super::{PATHS_PER_BATCH, ShootSettings};
use crate::bsdf::{LobeMask, may_have};
use crate::light::Light;
use crate::math::{Vec2, Vec3};
use crate::sample::{Cdf, Distribution2d, Key, Purpose, Sampler, hash_u64};
use crate::scene::Scene;

/// Photon paths of the learning rounds, and the share of each that stays uniform.
const ROUNDS: [(u64, f64); 3] = [(4, 0.5), (8, 0.3), (16, 0.2)];

/// Share of the learnt density that lights with photons of use divide evenly: a dim light may be alone in its room.
const EVEN: f64 = 0.25;

/// Share of the finished density that stays uniform.
const DEFENSIVE: f64 = 0.15;

/// Rays sent through each cell of the projection map.
const PROBES: u64 = 4;

/// Spheres around specular surfaces that the projection map tells apart.
const MAX_CASTERS: usize = 256;

/// Cells along each axis of the grids of one light.
#[derive(Clone, Copy, Debug)]
struct Resolution {
    position: usize,
    direction: usize,
}

impl Resolution {
    /// Fine for few lights, coarse for many, so that memory and learning stay bounded. Where all places, or all directions,
    /// are one, all cells are of the other.
    fn of(light: &Light, lights: usize) -> Self {
        let (position, direction, alone) = match lights {
            0..=4 => (4, 32, 64),
            5..=64 => (2, 24, 32),
            65..=1024 => (1, 12, 12),
            _ => (1, 4, 4),
        };
        match light {
            Light::Directional(_) => Self { position: alone, direction: 1 },
            Light::Point(_) | Light::Spot(_) | Light::Projector(_) => Self { position: 1, direction: alone },
            Light::Area(_) | Light::Constant(_) | Light::EnvMap(_) => Self { position, direction },
        }
    }

    fn positions(self) -> usize {
        self.position * self.position
    }

    fn directions(self) -> usize {
        self.direction * self.direction
    }

    fn cells(self) -> usize {
        self.positions() * self.directions()
    }

    /// The cell of a place.
    fn position_cell(self, u_pos: Vec2) -> usize {
        cell(u_pos, self.position)
    }

    fn cell(self, u_pos: Vec2, u_dir: Vec2) -> usize {
        self.position_cell(u_pos) * self.directions() + cell(u_dir, self.direction)
    }
}

fn cell(u: Vec2, n: usize) -> usize {
    let at = |x: f32| ((x * n as f32) as usize).min(n - 1);
    at(u.y) * n + at(u.x)
}

/// The density over the numbers that one light is given.
#[derive(Debug)]
struct Grid {
    resolution: Resolution,
    positions: Distribution2d,
    /// By cell of the position.
    directions: Vec<Distribution2d>,
}

/// Where photon paths start: a density over lights and over the numbers that each light is given.
#[derive(Debug)]
pub struct Guide {
    lights: Cdf,
    /// By light.
    grids: Vec<Grid>,
}

impl Guide {
    /// Learns from short pilots where the photons that `settings` wants come from; `None` where no surface focuses light.
    pub fn learn(scene: &Scene, settings: &ShootSettings) -> Option<Self> {
        if !scene.may_have(LobeMask::SPECULAR) || scene.selector.is_empty() {
            return None;
        }
        let count = scene.lights.len();
        let resolutions: Vec<Resolution> = scene.lights.iter().map(|l| Resolution::of(l, count)).collect();
        let mut guide = Self::new(scene, &resolutions, &projection_map(scene, &resolutions), ROUNDS[0].1);
        // Sum squares over the rounds; each is unbiased whatever density it was made with.
        let mut squares: Vec<Vec<f64>> = resolutions.iter().map(|r| vec![0.0; r.cells()]).collect();
        let mut paths = 0;
        for (round, &(batches, _)) in ROUNDS.iter().enumerate() {
            let share = ROUNDS.get(round + 1).map_or(DEFENSIVE, |next| next.1);
            guide.measure(scene, settings, paths, batches, &mut squares);
            paths += batches * PATHS_PER_BATCH;
            if squares.iter().flatten().any(|&s| s > 0.0) {
                let weights: Vec<Vec<f64>> = squares.iter().zip(&resolutions).map(|(s, r)| roots(s, *r)).collect();
                guide = Self::new(scene, &resolutions, &lift_dim_lights(weights), share);
            }
        }
        Some(guide)
    }

    /// A density proportional to `weights` but for the uniform `share`, which is spread as the scene's selector says.
    fn new(scene: &Scene, resolutions: &[Resolution], weights: &[Vec<f64>], share: f64) -> Self {
        let total: f64 = weights.iter().flatten().sum();
        let share = if total > 0.0 { share } else { 1.0 };
        let scale = if total > 0.0 { (1.0 - share) / total } else { 0.0 };
        let mut masses = Vec::with_capacity(scene.lights.len());
        let mut grids = Vec::with_capacity(scene.lights.len());
        for ((light, weights), &resolution) in weights.iter().enumerate().zip(resolutions) {
            let uniform = share * scene.photon_selector.pmf(light) as f64 / resolution.cells() as f64;
            let densities: Vec<f64> = weights.iter().map(|w| uniform + w * scale).collect();
            let (mut by_position, mut directions) = (Vec::with_capacity(resolution.positions()), Vec::new());
            for densities in densities.chunks(resolution.directions()) {
                let mass: f64 = densities.iter().sum();
                directions.push(distribution(resolution.direction, densities, mass));
                by_position.push(mass);
            }
            let mass: f64 = by_position.iter().sum();
            let positions = distribution(resolution.position, &by_position, mass);
            grids.push(Grid { resolution, positions, directions });
            masses.push(mass);
        }
        Self { lights: Cdf::new(scene.photon_aims.divide(masses)), grids }
    }

    /// A start and its density relative to uniform numbers, the probability of the light included.
    pub(super) fn start(&self, u_light: f32, u_pos: Vec2, u_dir: Vec2) -> Option<Start> {
        let (light, pmf, _) = self.lights.sample(u_light)?;
        let grid = &self.grids[light];
        let (u_pos, pdf_pos) = grid.positions.sample(u_pos)?;
        let (u_dir, pdf_dir) = grid.directions[grid.resolution.position_cell(u_pos)].sample(u_dir)?;
        // Rounding may reach the upper end of a cell.
        let below_one = Vec2::splat(1.0f32.next_down());
        let (u_pos, u_dir) = (u_pos.min(below_one), u_dir.min(below_one));
        Some(Start { light, u_pos, u_dir, pdf: pmf * pdf_pos * pdf_dir })
    }

    /// Traces paths and adds, for each cell, the squares of what they deposit over their density.
    fn measure(&self, scene: &Scene, settings: &ShootSettings, first: u64, batches: u64, squares: &mut [Vec<f64>]) {
        let key = Key::new(settings.seed, Purpose::Pilot, hash_u64(settings.target.purpose() as u64, 1));
        let found: Vec<Vec<(usize, usize, f64)>> = (0..batches)
            .into_par_iter()
            .map(|batch| {
                let begin = first + batch * PATHS_PER_BATCH;
                let mut deposit = Deposit::new(settings.target, settings.walk, 1);
                let powers = deposit.measure_all(scene, self, key, begin..begin + PATHS_PER_BATCH);
                let stored = (begin..).zip(powers).filter(|&(_, power)| power > 0.0);
                let found = stored.filter_map(|(index, power)| {
                    let mut numbers = Sampler::new(settings.walk.sequence, key, index);
                    let start = self.start(numbers.next_1d(), numbers.next_2d(), numbers.next_2d())?;
                    // The stored power is f/p, so f²/p is its square times p.
                    let cell = self.grids[start.light].resolution.cell(start.u_pos, start.u_dir);
                    Some((start.light, cell, power * power * start.pdf as f64))
                });
                found.collect()
            })
            .collect();
        for (light, cell, square) in found.into_iter().flatten() {
            squares[light][cell] += square;
        }
    }
}

/// A grid of n × n densities whose sum is `mass`.
fn distribution(n: usize, densities: &[f64], mass: f64) -> Distribution2d {
    // Grids of f32 hold shares of the whole well only when they are near 1.
    let inv = if mass > 0.0 { densities.len() as f64 / mass } else { 0.0 };
    let grid: Vec<f32> = densities.iter().map(|d| (d * inv) as f32).collect();
    Distribution2d::new(n, n, &grid)
}

/// Roots of squares that are blurred over neighbouring directions, or places where those are one, so that cells that no path
/// met by chance are not left out.
fn roots(squares: &[f64], resolution: Resolution) -> Vec<f64> {
    let n = if resolution.direction > 1 { resolution.direction } else { resolution.position };
    let mut roots = Vec::with_capacity(squares.len());
    for grid in squares.chunks(n * n) {
        for y in 0..n {
            for x in 0..n {
                let near = |c: usize| c.saturating_sub(1)..(c + 2).min(n);
                let around: f64 = near(y).flat_map(|j| near(x).map(move |i| grid[j * n + i])).sum();
                roots.push((0.75 * grid[y * n + x] + 0.25 / 9.0 * around).sqrt());
            }
        }
    }
    roots
}

/// Raises the weights of lights that have less than their even share of [`EVEN`].
fn lift_dim_lights(mut weights: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let sums: Vec<f64> = weights.iter().map(|w| w.iter().sum()).collect();
    let useful = sums.iter().filter(|&&s| s > 0.0).count();
    let least = EVEN * sums.iter().sum::<f64>() / useful.max(1) as f64;
    for (weights, &sum) in weights.iter_mut().zip(&sums) {
        if sum > 0.0 && sum < least {
            weights.iter_mut().for_each(|w| *w *= least / sum);
        }
    }
    weights
}

/// For each cell, the power of its light times the importance of the specular surface that a ray of the cell passes near;
/// 0 where there is none.
fn projection_map(scene: &Scene, resolutions: &[Resolution]) -> Vec<Vec<f64>> {
    let casters = casters(scene);
    let context = scene.light_context();
    let met = |light: usize, resolution: Resolution, cell: usize, probe: u64| {
        let hash = hash_u64((light * resolution.cells() + cell) as u64, probe);
        let within = |index: usize, n: usize, bits: u64| {
            let jitter = |b: u64| (b & 0xffff) as f32 / 65536.0;
            let (x, y) = ((index % n) as f32 + jitter(bits), (index / n) as f32 + jitter(bits >> 16));
            Vec2::new(x, y) / n as f32
        };
        let u_pos = within(cell / resolution.directions(), resolution.position, hash);
        let u_dir = within(cell % resolution.directions(), resolution.direction, hash >> 32);
        let Some(le) = scene.lights[light].sample_le(&context, u_pos, u_dir) else { return 0.0 };
        let near = casters.iter().filter(|c| passes_near(le.ray.o, le.ray.d, c));
        near.map(|c| c.importance).fold(0.0, f32::max)
    };
    let of_light = |(light, &resolution): (usize, &Resolution)| {
        let pmf = scene.photon_selector.pmf(light) as f64;
        let weight =
            |cell| pmf * (0..PROBES).map(|probe| met(light, resolution, cell, probe)).fold(0.0, f32::max) as f64;
        (0..resolution.cells()).into_par_iter().map(weight).collect()
    };
    resolutions.par_iter().enumerate().map(of_light).collect()
}

/// Whether a ray comes within a sphere that is wider by an eighth.
fn passes_near(o: Vec3, d: Vec3, caster: &Caster) -> bool {
    let to = caster.centre - o;
    let reach = 1.125 * caster.radius;
    let along = to.dot(d);
    to.length_squared() <= reach * reach || (along > 0.0 && to.length_squared() - along * along <= reach * reach)
}

/// A sphere around a specular shape, and how important it is to aim at it.
struct Caster {
    centre: Vec3,
    radius: f32,
    importance: f32,
}

/// Spheres around the specular shapes that photons are to be aimed at; around all of them where they are too many to tell
/// apart.
fn casters(scene: &Scene) -> Vec<Caster> {
    let geometry = &scene.geometry;
    let importance = |shape: u32| {
        let focuses =
            may_have(&scene.materials, scene.shape_materials[shape as usize], LobeMask::DELTA | LobeMask::SHARP);
        if focuses { scene.photon_aims.importance(shape) } else { 0.0 }
    };
    let top = geometry.top.iter().map(|&s| (geometry.shape_bounds(s), importance(s)));
    let groups: Vec<f32> =
        geometry.groups.iter().map(|g| g.iter().map(|&s| importance(s)).fold(0.0, f32::max)).collect();
    let placed = geometry.instances.iter().filter(|i| groups[i.group as usize] > 0.0);
    let placed = placed.map(|i| (i.bounds(&geometry.group_bounds(i.group)), groups[i.group as usize]));
    let spheres: Vec<Caster> = top
        .chain(placed)
        .filter(|(bounds, importance)| *importance > 0.0 && !bounds.is_empty())
        .map(|(b, importance)| Caster { centre: b.center(), radius: 0.5 * (b.max - b.min).length(), importance })
        .collect();
    if spheres.len() <= MAX_CASTERS {
        return spheres;
    }
    let (centre, radius) = scene.bounding_sphere();
    vec![Caster { centre, radius, importance: 1.0 }]
}
