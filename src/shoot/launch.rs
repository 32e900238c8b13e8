//! Photon paths about to start: emission, many paths at a time.

use std::ops::Range;

use super::Guide;
use crate::color::Rgb;
use crate::light::{STARTS, StartNumbers, Starts};
use crate::math::{Vec2, Vec3};
use crate::sample::{Key, Sampler, Sequence};
use crate::scene::Scene;

/// No light: the path never starts.
const NONE: u32 = u32::MAX;

/// Paths of one light from which on they are done together.
const FEW: u32 = 4;

/// A path that may start: its number, its light, its ray and its flux, which is black where nothing is emitted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Departure {
    pub index: u64,
    pub light: Option<usize>,
    pub o: Vec3,
    pub d: Vec3,
    pub flux: Rgb,
}

/// Paths in the order of their numbers, prepared [`STARTS`] at a time.
#[derive(Debug)]
pub(super) struct Launch {
    /// Paths that are not prepared yet.
    waiting: Range<u64>,
    /// Number of the first path prepared, how many are, and how many of them are gone.
    first: u64,
    len: usize,
    gone: usize,
    light: [u32; STARTS],
    starts: Starts,
}

impl Launch {
    pub fn new(paths: Range<u64>) -> Self {
        Self { first: paths.start, waiting: paths, len: 0, gone: 0, light: [NONE; STARTS], starts: Starts::ZERO }
    }

    /// The next path, of a shoot of `1/inv_emitted`.
    #[inline(always)]
    pub fn next(
        &mut self,
        scene: &Scene,
        guide: Option<&Guide>,
        (sequence, key): (Sequence, Key),
        inv_emitted: f32,
    ) -> Option<Departure> {
        if self.gone == self.len {
            (self.first, self.gone) = (self.waiting.start, 0);
            self.len = (self.waiting.end - self.first).min(STARTS as u64) as usize;
            self.waiting.start += self.len as u64;
            if self.len == 0 {
                return None;
            }
            self.prepare(scene, guide, (sequence, key), inv_emitted);
        }
        let i = self.gone;
        self.gone += 1;
        let (o, d, flux) = self.starts.get(i);
        let light = (self.light[i] != NONE).then_some(self.light[i] as usize);
        Some(Departure { index: self.first + i as u64, light, o, d, flux })
    }

    #[inline(always)]
    fn prepare(&mut self, scene: &Scene, guide: Option<&Guide>, (sequence, key): (Sequence, Key), inv_emitted: f32) {
        let mut u = [[0.0; STARTS]; 5];
        Sampler::first_of_many(sequence, key, self.first, &mut u);
        let mut numbers = StartNumbers { pos: [u[1], u[2]], dir: [u[3], u[4]] };
        let mut pdf = [1.0; STARTS];
        // Choose the lights.
        self.light = [NONE; STARTS];
        for i in 0..self.len {
            if let Some(guide) = guide {
                let (pos, dir) = numbers.get(i);
                if let Some(start) = guide.start(u[0][i], pos, dir) {
                    numbers.set(i, start.u_pos, start.u_dir);
                    (self.light[i], pdf[i]) = (start.light as u32, start.pdf);
                }
            } else if let Some((light, p)) = scene.photon_selector.sample(u[0][i]) {
                (self.light[i], pdf[i]) = (light as u32, p);
            }
        }
        self.start(scene, &numbers);
        for (i, pdf) in pdf.into_iter().enumerate() {
            let (o, d, weight) = self.starts.get(i);
            self.starts.set(i, (o, d, weight * (inv_emitted / pdf)));
        }
    }

    /// Starts the paths of one light after the other, those of each together.
    #[inline(always)]
    fn start(&mut self, scene: &Scene, numbers: &StartNumbers) {
        let ctx = scene.light_context();
        let all: u32 = (0..self.len).filter(|&i| self.light[i] != NONE).map(|i| 1 << i).sum();
        let mut left = all;
        self.starts = Starts::ZERO;
        while left != 0 {
            let light = self.light[left.trailing_zeros() as usize];
            let members: u32 = lanes(left).filter(|&i| self.light[i] == light).map(|i| 1 << i).sum();
            left &= !members;
            let light = &scene.lights[light as usize];
            if members.count_ones() < FEW {
                for i in lanes(members) {
                    let (pos, dir) = numbers.get(i);
                    if let Some(le) = light.sample_le(&ctx, pos, dir) {
                        self.starts.set(i, (le.ray.o, le.ray.d, le.weight));
                    }
                }
                continue;
            }
            // Side by side, where others stand between them.
            let (mut own, mut starts) = (*numbers, Starts::ZERO);
            if members != all {
                for (to, from) in lanes(members).enumerate() {
                    let (pos, dir): (Vec2, Vec2) = numbers.get(from);
                    own.set(to, pos, dir);
                }
            }
            light.sample_le_all(&ctx, &own, &mut starts);
            if members == all {
                // Paths without a light have a start by this, and do not take it.
                self.starts = starts;
                continue;
            }
            for (from, to) in lanes(members).enumerate() {
                self.starts.set(to, starts.get(from));
            }
        }
    }
}

/// The places of the bits that are set, in ascending order.
fn lanes(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let i = (bits != 0).then_some(bits.trailing_zeros() as usize)?;
        bits &= bits - 1;
        Some(i)
    })
}
