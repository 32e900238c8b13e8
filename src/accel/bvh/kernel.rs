//! What an instruction set has to provide, and the portable version of it.

use std::mem::MaybeUninit;

use super::flat::{Depths, FlatBlock, FlatRay, Limits, flat_portable};
use super::traverse::{FAR_SCALE, SlabRay};
use super::wide::{Block, Child, LANES, Node8, WIDTH};
use crate::geometry::ShearedRay;
use crate::math::Vec3;

/// How much wider than exact slabs are, relative to the origin: triangles that the ray misses by the rounding of coordinates
/// are hit in f32, and must not be missed by the box test.
pub(super) const PAD: f32 = 4.0 * f32::EPSILON;

/// What the edge functions of a triangle beside a sheared ray may be wrong by in f32, in units of (m + M) m, where m is the
/// largest sheared coordinate of a corner and M the largest depth.
///
/// Let ε be half of `f32::EPSILON`. Unsheared coordinates are at most m + M, since the shear is at most 1, and are good to ε;
/// sheared ones to 5 ε (m + M), and an edge function, a difference of two products of such, to 24 ε (m + M) m. Products
/// below the normal numbers are good to `f32::MIN_POSITIVE`.
pub(super) const EDGE: f32 = 20.0 * f32::EPSILON;

/// A ray in the registers of one instruction set. Each version is conservative, in the box test as in the triangle test, and
/// leaves the rest to f64. So their results are equal.
pub(super) trait Kernel: Copy {
    fn new(slab: &SlabRay, sheared: &ShearedRay) -> Self;

    /// Starts to load what a child refers to, which will be needed later.
    fn prefetch(nodes: &[Node8], blocks: &[Block], child: Child);

    /// Which of the eight boxes the ray meets before `limit`; their entry distances go to `near`.
    fn node(&self, node: &Node8, limit: f32, near: &mut [f32; WIDTH]) -> u32;

    /// The same without the distances.
    #[inline(always)]
    fn node_any(&self, node: &Node8, limit: f32) -> u32 {
        self.node(node, limit, &mut [0.0; WIDTH])
    }

    /// Writes the children in the mask to the front of `stack`, and anything behind them.
    #[inline(always)]
    fn push(node: &Node8, mut mask: u32, stack: &mut [MaybeUninit<Child>; WIDTH]) {
        for to in stack {
            if mask == 0 {
                break;
            }
            to.write(node.child[mask.trailing_zeros() as usize & 7]);
            mask &= mask - 1;
        }
    }

    /// Which triangles of the block may be hit: edge functions have one sign up to their rounding. Those may be left out of
    /// which it is certain that f64 will not find them between the origin and `limit`.
    fn block(&self, block: &Block, limit: f32) -> u32;

    /// The same, or `None` where it is certain that f64 will find a hit between the origin and `within`.
    #[inline(always)]
    fn block_any(&self, block: &Block, _within: f32, limit: f32) -> Option<u32> {
        Some(self.block(block, limit))
    }

    /// Which triangles of the block may be hit before the limit; depths are written where any are. `None` where `ANY` is
    /// asked for and it is certain that f64 will find a hit.
    #[inline(always)]
    fn flat<const ANY: bool>(block: &FlatBlock, ray: &FlatRay, limits: Limits, depths: &mut Depths) -> Option<u32> {
        flat_portable::<ANY>(block, ray, limits, depths)
    }
}

/// True where the edge functions of a sheared triangle have one sign up to their rounding.
#[inline(always)]
fn may_hit([[ax, ay, az], [bx, by, bz], [cx, cy, cz]]: [[f32; 3]; 3]) -> bool {
    let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
    let most = |a: f32, b: f32, c: f32| a.abs().max(b.abs()).max(c.abs());
    let (side, depth) = (most(ax, bx, cx).max(most(ay, by, cy)), most(az, bz, cz));
    let error = ((side + depth) * (side * EDGE)).max(f32::MIN_POSITIVE);
    (u >= -error && v >= -error && w >= -error) || (u <= error && v <= error && w <= error)
}

/// Plain arrays, for every processor.
#[derive(Clone, Copy)]
pub(super) struct Portable {
    slab: SlabRay,
    pad: Vec3,
    o: [f32; 3],
    k: [usize; 3],
    s: [f32; 3],
}

impl Kernel for Portable {
    #[inline(always)]
    fn new(slab: &SlabRay, sheared: &ShearedRay) -> Self {
        let k = sheared.k;
        let pad = (slab.o * slab.rcp).abs() * PAD;
        Self { slab: *slab, pad, o: k.map(|k| slab.o[k]), k, s: sheared.s.to_array() }
    }

    #[inline(always)]
    fn prefetch(_: &[Node8], _: &[Block], _: Child) {}

    #[inline(always)]
    fn node(&self, node: &Node8, limit: f32, near: &mut [f32; WIDTH]) -> u32 {
        let r = &self.slab;
        let mut far = [f32::INFINITY; WIDTH];
        *near = [0.0; WIDTH];
        for axis in 0..3 {
            let (n, f) = (&node.bounds[r.near[axis]], &node.bounds[r.far[axis]]);
            for i in 0..WIDTH {
                let a = (n[i] - r.o[axis]) * r.rcp[axis] - self.pad[axis];
                let b = (f[i] - r.o[axis]) * r.rcp[axis] + self.pad[axis];
                near[i] = if a > near[i] { a } else { near[i] };
                far[i] = if b < far[i] { b } else { far[i] };
            }
        }
        let mut mask = 0;
        for i in 0..WIDTH {
            let far = far[i] * FAR_SCALE;
            let far = if far < limit { far } else { limit };
            mask |= u32::from(near[i] <= far) << i;
        }
        mask
    }

    #[inline(always)]
    fn block(&self, block: &Block, _limit: f32) -> u32 {
        let ([kx, ky, kz], [sx, sy, _]) = (self.k, self.s);
        let mut mask = 0;
        for i in 0..LANES {
            let corner = |v: usize| {
                let z = block.v[v][kz][i] - self.o[2];
                [(block.v[v][kx][i] - self.o[0]) - sx * z, (block.v[v][ky][i] - self.o[1]) - sy * z, z]
            };
            mask |= u32::from(may_hit([corner(0), corner(1), corner(2)])) << i;
        }
        mask
    }
}
