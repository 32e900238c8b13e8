//! The kernel for NEON.

use core::arch::aarch64::*;

use super::super::kernel::{EDGE, PAD};
use super::super::traverse::{FAR_SCALE, SlabRay};
use super::super::wide::WIDTH;
use super::*;
use crate::geometry::ShearedRay;

#[inline(never)]
pub(super) fn walk<const ANY: bool, const ROBUST: bool>(
    bvh: &Bvh,
    tree: &Tree,
    ray: &Ray,
    placed: u32,
    best: &mut Best,
) {
    traverse::walk::<Neon, ANY, ROBUST>(bvh, tree, ray, placed, best);
}

/// Four lanes of a row.
#[inline(always)]
fn load(row: &[f32], first: usize) -> float32x4_t {
    let lanes = &row[first..first + 4];
    // SAFETY: every AArch64 has NEON. There are four lanes, and a load needs no more alignment than they have.
    unsafe { vld1q_f32(lanes.as_ptr()) }
}

#[inline(always)]
fn store(row: &mut [f32], first: usize, x: float32x4_t) {
    let lanes = &mut row[first..first + 4];
    // SAFETY: as in `load`.
    unsafe { vst1q_f32(lanes.as_mut_ptr(), x) }
}

/// Bit `first` + lane in each lane that is true; their sum is a mask.
#[inline(always)]
fn bits(lanes: uint32x4_t, first: usize) -> uint32x4_t {
    let low = (1 | 2 << 32) << first;
    // SAFETY: every AArch64 has NEON.
    unsafe { vandq_u32(lanes, vcombine_u32(vcreate_u32(low), vcreate_u32(low << 2))) }
}

/// Four boxes or triangles in one register. Nothing is prefetched, as there is no stable intrinsic.
#[derive(Clone, Copy)]
pub(super) struct Neon {
    /// Slope and negated offset of the distances to near and to far planes.
    near_rcp: [float32x4_t; 3],
    near_o: [float32x4_t; 3],
    far_rcp: [float32x4_t; 3],
    far_o: [float32x4_t; 3],
    near: [usize; 3],
    far: [usize; 3],
    k: [usize; 3],
    /// Origin with permuted axes.
    ko: [float32x4_t; 3],
    /// Shear of x and y, scale of z.
    s: [float32x4_t; 3],
}

impl Neon {
    /// Entry and exit distances of four of the eight boxes, by the operations of `Avx2::slabs`, where the padding is
    /// explained.
    ///
    /// NaN is ignored, as in the portable kernel: `vmaxnmq` and `vminnmq` return the other operand, where `vmaxq` and
    /// `vminq` would let it spread and miss a box. The entry distances are ordered by their bits, so must not be −0:
    /// `vmaxnmq` takes +0 for the greater.
    #[inline(always)]
    fn slabs(&self, node: &Node8, first: usize, limit: f32) -> (float32x4_t, float32x4_t) {
        // SAFETY: every AArch64 has NEON.
        unsafe {
            let plane = |row: usize, r, o| vfmaq_f32(o, load(&node.bounds[row], first), r);
            let near = |axis: usize| plane(self.near[axis], self.near_rcp[axis], self.near_o[axis]);
            let far = |axis: usize| plane(self.far[axis], self.far_rcp[axis], self.far_o[axis]);
            let n = vmaxnmq_f32(near(0), near(1));
            let n = vmaxnmq_f32(n, vmaxnmq_f32(near(2), vdupq_n_f32(0.0)));
            let f = vminnmq_f32(far(0), far(1));
            (n, vminnmq_f32(f, vminnmq_f32(far(2), vdupq_n_f32(limit))))
        }
    }

    /// Sheared x and y, and depth, of one corner of four triangles.
    #[inline(always)]
    fn corner<const N: usize>(&self, v: &[[f32; N]; 3], first: usize) -> (float32x4_t, float32x4_t, float32x4_t) {
        // SAFETY: every AArch64 has NEON.
        unsafe {
            let [kx, ky, kz] = self.k;
            let z = vsubq_f32(load(&v[kz], first), self.ko[2]);
            (
                vsubq_f32(vsubq_f32(load(&v[kx], first), self.ko[0]), vmulq_f32(self.s[0], z)),
                vsubq_f32(vsubq_f32(load(&v[ky], first), self.ko[1]), vmulq_f32(self.s[1], z)),
                z,
            )
        }
    }

    /// Which of four triangles may be hit, and the depths of their corners. Here NaN has to spread, so that it fails the
    /// comparisons: `vminq` and `vmaxq` return it.
    #[inline(always)]
    fn edges<const N: usize>(&self, v: &[[[f32; N]; 3]; 3], first: usize) -> (uint32x4_t, [float32x4_t; 3]) {
        // SAFETY: every AArch64 has NEON.
        unsafe {
            let ((ax, ay, az), (bx, by, bz)) = (self.corner(&v[0], first), self.corner(&v[1], first));
            let (cx, cy, cz) = self.corner(&v[2], first);
            let edge = |p, q, r, s| vsubq_f32(vmulq_f32(p, q), vmulq_f32(r, s));
            let (u, v, w) = (edge(cx, by, cy, bx), edge(ax, cy, ay, cx), edge(bx, ay, by, ax));
            let abs = |x| vabsq_f32(x);
            let most = |a, b, c| vmaxq_f32(vmaxq_f32(a, b), c);
            let side = vmaxq_f32(most(abs(ax), abs(bx), abs(cx)), most(abs(ay), abs(by), abs(cy)));
            let reach = vaddq_f32(side, most(abs(az), abs(bz), abs(cz)));
            let error = vmulq_f32(reach, vmulq_f32(side, vdupq_n_f32(EDGE)));
            let error = vmaxq_f32(error, vdupq_n_f32(f32::MIN_POSITIVE));
            let low = vminq_f32(vminq_f32(u, v), w);
            let high = most(u, v, w);
            let pass = vorrq_u32(vcgeq_f32(low, vnegq_f32(error)), vcleq_f32(high, error));
            (pass, [az, bz, cz])
        }
    }
}

impl Kernel for Neon {
    #[inline(always)]
    fn new(slab: &SlabRay, sheared: &ShearedRay) -> Self {
        let k = sheared.k;
        let c = slab.o * slab.rcp;
        let pad = c.abs() * PAD;
        // SAFETY: every AArch64 has NEON.
        unsafe {
            let splat = |v: [f32; 3]| [vdupq_n_f32(v[0]), vdupq_n_f32(v[1]), vdupq_n_f32(v[2])];
            Self {
                near_rcp: splat(slab.rcp.to_array()),
                near_o: splat((-(c + pad)).to_array()),
                far_rcp: splat((slab.rcp * FAR_SCALE).to_array()),
                far_o: splat((-((c - pad) * FAR_SCALE)).to_array()),
                near: slab.near,
                far: slab.far,
                k,
                ko: splat([slab.o[k[0]], slab.o[k[1]], slab.o[k[2]]]),
                s: splat(sheared.s.to_array()),
            }
        }
    }

    #[inline(always)]
    fn prefetch(_: &[Node8], _: &[Block], _: Child) {}

    #[inline(always)]
    fn node(&self, node: &Node8, limit: f32, near: &mut [f32; WIDTH]) -> u32 {
        // SAFETY: every AArch64 has NEON.
        unsafe {
            let ((n, f), (upper_n, upper_f)) = (self.slabs(node, 0, limit), self.slabs(node, 4, limit));
            store(near, 0, n);
            store(near, 4, upper_n);
            vaddvq_u32(vorrq_u32(bits(vcleq_f32(n, f), 0), bits(vcleq_f32(upper_n, upper_f), 4)))
        }
    }

    #[inline(always)]
    fn block(&self, block: &Block, _limit: f32) -> u32 {
        // SAFETY: every AArch64 has NEON.
        unsafe { vaddvq_u32(bits(self.edges(&block.v, 0).0, 0)) }
    }
}
