//! The starts of many photon paths from one light, field by field in arrays: [`Light::sample_le`] in loops that the compiler
//! makes vectors of. Each path sees the very operations that it would see alone: the bits are the same.

use glam::{Vec2, Vec3};

use super::{Light, LightContext, LightLe};
use crate::color::Rgb;
use crate::math::choose;

/// Paths in [`Starts`].
pub const STARTS: usize = 32;

type Column = [f32; STARTS];

/// The numbers that starts are made of.
#[derive(Clone, Copy, Debug)]
pub struct StartNumbers {
    pub pos: [Column; 2],
    pub dir: [Column; 2],
}

impl StartNumbers {
    pub const ZERO: Self = Self { pos: [[0.0; STARTS]; 2], dir: [[0.0; STARTS]; 2] };

    #[inline(always)]
    pub(super) fn pos(&self, i: usize) -> Vec2 {
        Vec2::new(self.pos[0][i], self.pos[1][i])
    }

    #[inline(always)]
    pub(super) fn dir(&self, i: usize) -> Vec2 {
        Vec2::new(self.dir[0][i], self.dir[1][i])
    }

    /// The numbers of path `i`.
    #[inline(always)]
    pub fn get(&self, i: usize) -> (Vec2, Vec2) {
        (self.pos(i), self.dir(i))
    }

    #[inline(always)]
    pub fn set(&mut self, i: usize, pos: Vec2, dir: Vec2) {
        (self.pos[0][i], self.pos[1][i]) = (pos.x, pos.y);
        (self.dir[0][i], self.dir[1][i]) = (dir.x, dir.y);
    }
}

/// What paths need of [`LightLe`]: origin, direction and weight of each.
#[derive(Clone, Copy, Debug)]
pub struct Starts {
    o: [Column; 3],
    d: [Column; 3],
    weight: [Column; 3],
}

impl Starts {
    pub const ZERO: Self = Self { o: [[0.0; STARTS]; 3], d: [[0.0; STARTS]; 3], weight: [[0.0; STARTS]; 3] };

    /// Origin, direction and weight of path `i`; the weight is black where the light emits nothing.
    #[inline(always)]
    pub fn get(&self, i: usize) -> (Vec3, Vec3, Rgb) {
        let of = |c: &[Column; 3]| Vec3::new(c[0][i], c[1][i], c[2][i]);
        let w = of(&self.weight);
        (of(&self.o), of(&self.d), Rgb::new(w.x, w.y, w.z))
    }

    #[inline(always)]
    pub fn set(&mut self, i: usize, (o, d, weight): (Vec3, Vec3, Rgb)) {
        let set = |c: &mut [Column; 3], v: [f32; 3]| [c[0][i], c[1][i], c[2][i]] = v;
        set(&mut self.o, o.to_array());
        set(&mut self.d, d.to_array());
        set(&mut self.weight, weight.to_array());
    }

    /// Takes those of `others` whose `light` is `id`.
    #[inline(always)]
    pub fn take_of(&mut self, light: &[u32; STARTS], id: u32, others: &Self) {
        let mut mask = [0; STARTS];
        for i in 0..STARTS {
            mask[i] = u32::from(light[i] == id).wrapping_neg();
        }
        let all = [(&mut self.o, &others.o), (&mut self.d, &others.d), (&mut self.weight, &others.weight)];
        for (own, others) in all {
            for (own, others) in own.iter_mut().zip(others) {
                for i in 0..STARTS {
                    own[i] = choose(mask[i], others[i], own[i]);
                }
            }
        }
    }

    /// Sets path `i` to what [`Light::sample_le`] gives.
    #[inline(always)]
    pub fn put(&mut self, i: usize, le: Option<LightLe>) {
        self.set(i, le.map_or((Vec3::ZERO, Vec3::Z, Rgb::BLACK), |le| (le.ray.o, le.ray.d, le.weight)));
    }
}

impl Light {
    /// [`Light::sample_le`] for all `numbers`.
    #[inline(always)]
    pub fn sample_le_all(&self, ctx: &LightContext, numbers: &StartNumbers, out: &mut Starts) {
        match self {
            Light::Area(l) => l.sample_le_all(ctx, numbers, out),
            Light::EnvMap(l) => l.sample_le_all(ctx, numbers, out),
            // Loops that are written out: the compiler does not inline closures as it should.
            Light::Constant(l) => {
                for i in 0..STARTS {
                    out.put(i, l.sample_le(ctx, numbers.pos(i), numbers.dir(i)));
                }
            }
            Light::Directional(l) => {
                for i in 0..STARTS {
                    out.put(i, l.sample_le(ctx, numbers.pos(i)));
                }
            }
            Light::Point(l) => {
                for i in 0..STARTS {
                    out.put(i, l.sample_le(numbers.dir(i)));
                }
            }
            Light::Spot(_) | Light::Projector(_) => self.sample_le_each(ctx, numbers, out),
        }
    }

    /// [`Light::sample_le_all`] one by one.
    #[inline(never)]
    fn sample_le_each(&self, ctx: &LightContext, numbers: &StartNumbers, out: &mut Starts) {
        for i in 0..STARTS {
            out.put(i, self.sample_le(ctx, numbers.pos(i), numbers.dir(i)));
        }
    }
}
