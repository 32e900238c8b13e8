//! Photon paths about to start: emission, many paths at a time.

use std::ops::Range;

use super::lanes::Sums;
use super::{AimCounts, Deposit, Guide};
use crate::color::Rgb;
use crate::light::{STARTS, StartNumbers, Starts};
use crate::math::Vec3;
use crate::sample::{Key, Sampler, Sequence};
use crate::scene::Scene;

/// No light: the path never starts.
const NONE: u32 = u32::MAX;

/// Paths of one light from which on they are done together.
const FEW: u32 = 4;

/// A path that starts: its number, its key, its ray and its flux.
#[derive(Clone, Copy, Debug)]
pub(super) struct Departure {
    pub index: u64,
    pub path: Key,
    pub o: Vec3,
    pub d: Vec3,
    pub flux: Rgb,
}

/// Paths in the order of their numbers, prepared [`STARTS`] at a time.
#[derive(Debug)]
pub(super) struct Launch {
    /// Paths that are not prepared yet.
    waiting: Range<u64>,
    /// Number of the first path prepared, and which of them are still to start, a bit each.
    first: u64,
    left: u32,
    light: [u32; STARTS],
    path: [Key; STARTS],
    /// Those without a light keep what others have left there.
    starts: Starts,
    of_one_light: Starts,
    // What became of all that were prepared.
    emitted: Sums<STARTS>,
    escaped: Sums<STARTS>,
    /// Those whose ray passes by all there is.
    passed_by: u64,
    rejected: u64,
    aimed: AimCounts,
}

impl Launch {
    pub fn new(paths: Range<u64>) -> Self {
        Self {
            first: paths.start,
            waiting: paths,
            left: 0,
            light: [NONE; STARTS],
            path: [Key(0); STARTS],
            starts: Starts::ZERO,
            of_one_light: Starts::ZERO,
            emitted: Sums::ZERO,
            escaped: Sums::ZERO,
            passed_by: 0,
            rejected: 0,
            aimed: AimCounts::default(),
        }
    }

    /// The next path, of a shoot of `1/inv_emitted`, that carries light and may meet something.
    #[inline(always)]
    pub fn next(
        &mut self,
        scene: &Scene,
        guide: Option<&Guide>,
        stream: (Sequence, Key),
        inv_emitted: f32,
    ) -> Option<Departure> {
        while self.left == 0 {
            if self.waiting.is_empty() {
                return None;
            }
            self.prepare(scene, guide, stream, inv_emitted);
        }
        let i = self.left.trailing_zeros();
        self.left &= self.left - 1;
        let (o, d, flux) = self.starts.get(i as usize);
        Some(Departure { index: self.first + i as u64, path: self.path[i as usize], o, d, flux })
    }

    /// Tells what became of the paths that were prepared, but for those that [`Launch::next`] gave out.
    pub fn add_to(mut self, deposit: &mut Deposit) {
        self.emitted.move_to(&mut deposit.balance.emitted);
        self.escaped.move_to(&mut deposit.balance.escaped);
        deposit.counters.photon_rays += self.passed_by;
        deposit.rejected += self.rejected;
        deposit.aimed += &self.aimed;
    }

    #[inline(always)]
    fn prepare(&mut self, scene: &Scene, guide: Option<&Guide>, (sequence, key): (Sequence, Key), inv_emitted: f32) {
        self.first = self.waiting.start;
        let len = (self.waiting.end - self.first).min(STARTS as u64) as usize;
        self.waiting.start += len as u64;
        for (path, index) in self.path.iter_mut().zip(self.first..) {
            *path = key.with(index);
        }
        let mut u = [[0.0; STARTS]; 5];
        Sampler::first_of_many(sequence, key, self.first, &mut u);
        let mut numbers = StartNumbers { pos: [u[1], u[2]], dir: [u[3], u[4]] };
        let mut pdf = [1.0; STARTS];
        // Choose the lights.
        match guide {
            Some(guide) => {
                for i in 0..len {
                    let (pos, dir) = numbers.get(i);
                    self.light[i] = NONE;
                    if let Some(start) = guide.start(u[0][i], pos, dir) {
                        numbers.set(i, start.u_pos, start.u_dir);
                        (self.light[i], pdf[i]) = (start.light as u32, start.pdf);
                    }
                }
            }
            None => scene.photon_selector.sample_all(&u[0], &mut self.light, &mut pdf),
        }
        self.light[len..].fill(NONE);
        for &light in self.light.iter().filter(|&&light| light != NONE) {
            self.aimed.add_path(&scene.photon_aims, light as usize);
        }
        self.start(scene, &numbers);
        // Account for all of them; those that need no ray query end here.
        let (mut left, mut rejected, mut passed_by) = ([0; STARTS], [0; STARTS], [0; STARTS]);
        for i in 0..STARTS {
            let (o, d, weight) = self.starts.get(i);
            let flux = weight * (inv_emitted / pdf[i]);
            self.starts.set(i, (o, d, flux));
            let carries = (self.light[i] != NONE) & !flux.is_black();
            let starts = carries & flux.is_finite();
            let misses = starts & scene.bounds.is_missed(o, d);
            (rejected[i], passed_by[i]) = ((carries & !starts) as u32, misses as u32);
            left[i] = ((starts & !misses) as u32) << i;
            self.emitted.add(i, if starts { flux } else { Rgb::BLACK });
            self.escaped.add(i, if misses { flux } else { Rgb::BLACK });
        }
        self.left = left.iter().sum();
        self.rejected += rejected.iter().sum::<u32>() as u64;
        self.passed_by += passed_by.iter().sum::<u32>() as u64;
    }

    /// Starts the paths of one light after the other, those of each together.
    #[inline(always)]
    fn start(&mut self, scene: &Scene, numbers: &StartNumbers) {
        let ctx = scene.light_context();
        let all = !members(&self.light, NONE);
        let mut left = all;
        while left != 0 {
            let id = self.light[left.trailing_zeros() as usize];
            let own = members(&self.light, id);
            left &= !own;
            let light = &scene.lights[id as usize];
            if own.count_ones() < FEW {
                for i in lanes(own) {
                    let (pos, dir) = numbers.get(i);
                    self.starts.put(i, light.sample_le(&ctx, pos, dir));
                }
            } else if own == all {
                light.sample_le_all(&ctx, numbers, &mut self.starts);
            } else {
                // The others as well, which take nothing: vectors are full anyway.
                light.sample_le_all(&ctx, numbers, &mut self.of_one_light);
                self.starts.take_of(&self.light, id, &self.of_one_light);
            }
        }
    }
}

/// The lanes whose light is `id`, a bit each.
#[inline(always)]
fn members(lights: &[u32; STARTS], id: u32) -> u32 {
    let mut bits = [0; STARTS];
    for i in 0..STARTS {
        bits[i] = ((lights[i] == id) as u32) << i;
    }
    bits.iter().sum()
}

/// The places of the bits that are set, in ascending order.
fn lanes(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let i = (bits != 0).then_some(bits.trailing_zeros() as usize)?;
        bits &= bits - 1;
        Some(i)
    })
}
