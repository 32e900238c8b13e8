//! Vector kernels and their dispatch: the only unsafe code of this room.

use std::mem::MaybeUninit;

use super::super::Mode;
use super::binned::{self, Binning, Bins, PrimRef, Recipe};
use super::kernel::{Kernel, Portable};
use super::traverse::{self, Best};
use super::wide::{Block, Child, Node8, Tree};
use super::{Bvh, Isa};
use crate::geometry::Ray;

/// Reads a stack entry.
#[inline(always)]
pub(super) fn read<T: Copy, const N: usize>(stack: &[MaybeUninit<T>; N], index: usize) -> T {
    // SAFETY: the traversal loops write entry `size` before they increment `size`, and read only below `size`.
    unsafe { stack[index].assume_init() }
}

/// The node that a child slot of this tree refers to.
#[inline(always)]
pub(super) fn node_of(nodes: &[Node8], child: Child) -> &Node8 {
    debug_assert!((child.0 as usize) < nodes.len());
    // SAFETY: `wide::build` only makes node references below the number of nodes, and a tree is never changed.
    unsafe { nodes.get_unchecked(child.0 as usize) }
}

/// The blocks that a triangle leaf of this tree refers to.
#[inline(always)]
pub(super) fn blocks_of(blocks: &[Block], child: Child) -> &[Block] {
    debug_assert!(child.blocks().end <= blocks.len());
    // SAFETY: `wide::build` only makes leaf references within the blocks, and a tree is never changed.
    unsafe { blocks.get_unchecked(child.blocks()) }
}

impl Isa {
    /// The best one that this processor has.
    pub fn detect() -> Self {
        Self::ALL.into_iter().find(|isa| isa.is_available()).unwrap_or(Self::Portable)
    }

    /// True when this processor can run it.
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "aarch64")]
            Self::Neon => true,
            #[allow(unreachable_patterns)]
            _ => false,
        }
    }
}

/// Searches `tree` with the kernel that was chosen when the tree was built.
#[inline]
pub(super) fn walk<const ANY: bool>(bvh: &Bvh, tree: &Tree, ray: &Ray, placed: u32, best: &mut Best) {
    if bvh.options.mode == Mode::Fast {
        walk_with::<ANY, false>(bvh, tree, ray, placed, best)
    } else {
        walk_with::<ANY, true>(bvh, tree, ray, placed, best)
    }
}

#[inline(always)]
fn walk_with<const ANY: bool, const ROBUST: bool>(bvh: &Bvh, tree: &Tree, ray: &Ray, placed: u32, best: &mut Best) {
    match bvh.isa {
        // SAFETY: `Bvh::isa` is only ever set to an available instruction set.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => unsafe { x86::walk_avx512::<ANY, ROBUST>(bvh, tree, ray, placed, best) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { x86::walk_avx2::<ANY, ROBUST>(bvh, tree, ray, placed, best) },
        #[cfg(target_arch = "aarch64")]
        Isa::Neon => neon::walk::<ANY, ROBUST>(bvh, tree, ray, placed, best),
        _ => walk_portable::<ANY, ROBUST>(bvh, tree, ray, placed, best),
    }
}

/// Sorts references into bins.
#[inline]
pub(super) fn fill_bins(bins: &mut Bins, refs: &[PrimRef], map: &Binning) {
    // Short functions, so the question comes first; the standard library remembers the answer.
    #[cfg(target_arch = "x86_64")]
    if Isa::Avx2.is_available() {
        // SAFETY: AVX2 is available.
        return unsafe { x86::fill_bins(bins, refs, map) };
    }
    bins.fill::<binned::Portable>(refs, map);
}

/// The cheapest plane between bins.
#[inline]
pub(super) fn best_plane(bins: &Bins, recipe: &Recipe) -> Option<(f32, usize, usize)> {
    #[cfg(target_arch = "x86_64")]
    if Isa::Avx2.is_available() {
        // SAFETY: AVX2 is available.
        return unsafe { x86::best_plane(bins, recipe) };
    }
    bins.best::<binned::Portable>(recipe)
}

#[inline(never)]
fn walk_portable<const ANY: bool, const ROBUST: bool>(bvh: &Bvh, tree: &Tree, ray: &Ray, placed: u32, best: &mut Best) {
    traverse::walk::<Portable, ANY, ROBUST>(bvh, tree, ray, placed, best);
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use core::arch::x86_64::*;

    use super::super::binned::{Box8, Union};
    use super::super::kernel::{EDGE, PAD};
    use super::super::traverse::{FAR_SCALE, SlabRay};
    use super::super::wide::{Block, Child, FLAT_LANES, FlatBlock, Node8, WIDTH};
    use super::*;
    use crate::geometry::ShearedRay;

    #[target_feature(enable = "avx2,bmi1,fma")]
    pub(super) fn walk_avx2<const ANY: bool, const ROBUST: bool>(
        bvh: &Bvh,
        tree: &Tree,
        ray: &Ray,
        placed: u32,
        best: &mut Best,
    ) {
        traverse::walk::<Avx2, ANY, ROBUST>(bvh, tree, ray, placed, best);
    }

    #[target_feature(enable = "avx2,bmi1,fma,avx512f,avx512dq,avx512vl")]
    pub(super) fn walk_avx512<const ANY: bool, const ROBUST: bool>(
        bvh: &Bvh,
        tree: &Tree,
        ray: &Ray,
        placed: u32,
        best: &mut Best,
    ) {
        traverse::walk::<Avx512, ANY, ROBUST>(bvh, tree, ray, placed, best);
    }

    struct Avx2Union;

    impl Union for Avx2Union {
        #[inline(always)]
        fn grow(a: &mut Box8, b: &Box8) {
            // SAFETY: used only inside functions that enable AVX2; boxes are 32-byte aligned.
            unsafe {
                let min = _mm256_min_ps(_mm256_load_ps(b.0.as_ptr()), _mm256_load_ps(a.0.as_ptr()));
                _mm256_store_ps(a.0.as_mut_ptr(), min);
            }
        }
    }

    // Without fused multiply-add, so that the tree is the same on every processor.
    #[target_feature(enable = "avx2")]
    pub(super) fn fill_bins(bins: &mut Bins, refs: &[PrimRef], map: &Binning) {
        bins.fill::<Avx2Union>(refs, map);
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn best_plane(bins: &Bins, recipe: &Recipe) -> Option<(f32, usize, usize)> {
        bins.best::<Avx2Union>(recipe)
    }

    /// Eight boxes in one register, four triangles in half of one.
    #[derive(Clone, Copy)]
    pub(super) struct Avx2 {
        /// Slope and offset of the distances to near and to far planes.
        near_rcp: [__m256; 3],
        near_o: [__m256; 3],
        far_rcp: [__m256; 3],
        far_o: [__m256; 3],
        near: [usize; 3],
        far: [usize; 3],
        k: [usize; 3],
        ko: [__m128; 3],
        s: [__m128; 2],
        /// Shear of x and y, scale of z.
        shear: [f32; 3],
        /// Origin with permuted axes.
        origin: [f32; 3],
    }

    impl Avx2 {
        /// Entry and exit distances of the eight boxes.
        ///
        /// With r the reciprocal direction and c = o·r, near planes give r·p − (c + pad) and far planes
        /// s·r·p − s·(c − pad), one rounding each. Let ε be half of `f32::EPSILON`. The padding of 8 ε |c| covers the
        /// roundings of c (ε), of the padded c (2 ε), and, where p is close to o and the terms cancel, of s·r and s·c (2 ε);
        /// where they do not, the latter are ε relative to the distance. Then what is left is relative to the distances: r,
        /// the results, and s·r on the far side, five times ε for both sides, for which s = `FAR_SCALE` has six.
        #[inline(always)]
        fn slabs(&self, node: &Node8, limit: f32) -> (__m256, __m256) {
            // SAFETY: this type exists only inside functions that enable AVX2 and FMA; rows are 32-byte aligned as the
            // node is.
            unsafe {
                let plane =
                    |row: usize, r: __m256, o: __m256| _mm256_fmsub_ps(_mm256_load_ps(node.bounds[row].as_ptr()), r, o);
                let near = |axis: usize| plane(self.near[axis], self.near_rcp[axis], self.near_o[axis]);
                let far = |axis: usize| plane(self.far[axis], self.far_rcp[axis], self.far_o[axis]);
                let n = _mm256_max_ps(near(0), near(1));
                let n = _mm256_max_ps(n, _mm256_max_ps(near(2), _mm256_setzero_ps()));
                let f = _mm256_min_ps(far(0), far(1));
                (n, _mm256_min_ps(f, _mm256_min_ps(far(2), _mm256_set1_ps(limit))))
            }
        }
    }

    /// Four triangles beside a ray: depths of the corners, edge functions, their least and their greatest, and what they may
    /// be wrong by.
    struct Edges {
        z: [__m128; 3],
        e: [__m128; 3],
        low: __m128,
        high: __m128,
        error: __m128,
    }

    // Functions of one instruction set, which are inlined into others that have it.
    impl Edges {
        /// `RANGE` where the processor has AVX-512 DQ. Inlined into functions that enable what it uses.
        #[inline(always)]
        unsafe fn new<const RANGE: bool>(r: &Avx2, block: &Block) -> Self {
            // SAFETY: lanes are 16-byte aligned as the block is.
            unsafe {
                let [kx, ky, kz] = r.k;
                let corner = |v: usize| {
                    let load = |k: usize, o: __m128| _mm_sub_ps(_mm_load_ps(block.v[v][k].as_ptr()), o);
                    let z = load(kz, r.ko[2]);
                    (
                        _mm_sub_ps(load(kx, r.ko[0]), _mm_mul_ps(r.s[0], z)),
                        _mm_sub_ps(load(ky, r.ko[1]), _mm_mul_ps(r.s[1], z)),
                        z,
                    )
                };
                let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (corner(0), corner(1), corner(2));
                let edge = |p, q, r, s| _mm_sub_ps(_mm_mul_ps(p, q), _mm_mul_ps(r, s));
                let (u, v, w) = (edge(cx, by, cy, bx), edge(ax, cy, ay, cx), edge(bx, ay, by, ax));
                let (side, depth) = if RANGE {
                    let most = |a, b| _mm_range_ps::<0b1011>(a, b);
                    (most(most(most(ax, bx), most(cx, ay)), most(by, cy)), most(most(az, bz), cz))
                } else {
                    let abs = |x| _mm_andnot_ps(_mm_set1_ps(-0.0), x);
                    let most = |a, b, c| _mm_max_ps(_mm_max_ps(abs(a), abs(b)), abs(c));
                    (_mm_max_ps(most(ax, bx, cx), most(ay, by, cy)), most(az, bz, cz))
                };
                let error = _mm_mul_ps(_mm_add_ps(side, depth), _mm_mul_ps(side, _mm_set1_ps(EDGE)));
                Self {
                    z: [az, bz, cz],
                    e: [u, v, w],
                    low: _mm_min_ps(_mm_min_ps(u, v), w),
                    high: _mm_max_ps(_mm_max_ps(u, v), w),
                    error: _mm_max_ps(error, _mm_set1_ps(f32::MIN_POSITIVE)),
                }
            }
        }

        /// Lanes whose edge functions agree in sign, as far as can be told.
        #[inline]
        #[target_feature(enable = "avx2")]
        fn pass(&self) -> u32 {
            let minus = _mm_xor_ps(self.error, _mm_set1_ps(-0.0));
            _mm_movemask_ps(_mm_or_ps(_mm_cmpge_ps(self.low, minus), _mm_cmple_ps(self.high, self.error))) as u32
        }

        /// Of lanes that pass, those that are hit between the origin and `within`, and those that are not hit up to
        /// `limit`; both for certain, so that f64 would say the same.
        ///
        /// Where all edge functions are larger than their error, the hit lies between the least and the greatest depth.
        /// Weighted with the edge functions the depths have a sum good to 32 ε (m + M) m times the sum of depths, with the
        /// names of [`EDGE`]: this tells the triangle that the ray starts from, and leaves. Below the normal numbers nothing
        /// is certain.
        #[inline]
        #[target_feature(enable = "avx2")]
        fn certain(&self, scale: f32, within: f32, limit: f32) -> (u32, u32) {
            let (zero, minus) = (_mm_setzero_ps(), _mm_set1_ps(-0.0));
            let abs = |x| _mm_andnot_ps(minus, x);
            let sum = |[a, b, c]: [__m128; 3]| _mm_add_ps(_mm_add_ps(a, b), c);
            let (error, depths) = (self.error, [abs(self.z[0]), abs(self.z[1]), abs(self.z[2])]);
            // All have one sign, so that one of the two is the least absolute value.
            let inside = _mm_cmpgt_ps(_mm_max_ps(self.low, _mm_xor_ps(self.high, minus)), error);
            let s = _mm_set1_ps(scale);
            let [a, b, c] = self.z;
            let [a, b, c] = [_mm_mul_ps(a, s), _mm_mul_ps(b, s), _mm_mul_ps(c, s)];
            let (first, last) = (_mm_min_ps(_mm_min_ps(a, b), c), _mm_max_ps(_mm_max_ps(a, b), c));
            let between = _mm_and_ps(_mm_cmpgt_ps(first, zero), _mm_cmplt_ps(last, _mm_set1_ps(within)));
            let beyond = _mm_and_ps(inside, _mm_cmpgt_ps(first, _mm_set1_ps(limit)));
            // The sign of the distance: that of the weighted sum over that of the weights.
            let det = sum(self.e);
            let [u, v, w] = self.e;
            let at = sum([_mm_mul_ps(u, self.z[0]), _mm_mul_ps(v, self.z[1]), _mm_mul_ps(w, self.z[2])]);
            let sign = _mm_and_ps(minus, _mm_xor_ps(det, s));
            let least = _mm_max_ps(_mm_mul_ps(error, sum(depths)), _mm_set1_ps(f32::MIN_POSITIVE));
            let behind = _mm_cmplt_ps(_mm_xor_ps(at, sign), _mm_xor_ps(least, minus));
            let behind = _mm_and_ps(behind, _mm_cmpgt_ps(abs(det), _mm_mul_ps(error, _mm_set1_ps(3.0))));
            let hit = _mm_movemask_ps(_mm_and_ps(inside, between)) as u32;
            (hit, _mm_movemask_ps(_mm_or_ps(behind, beyond)) as u32)
        }

        /// [`Kernel::block`].
        #[inline]
        #[target_feature(enable = "avx2")]
        fn open(&self, scale: f32, limit: f32) -> u32 {
            let pass = self.pass();
            if pass == 0 {
                return 0;
            }
            let (_, missed) = self.certain(scale, 0.0, limit);
            pass & !missed
        }

        /// [`Kernel::block_any`].
        #[inline]
        #[target_feature(enable = "avx2")]
        fn open_any(&self, scale: f32, within: f32, limit: f32) -> Option<u32> {
            let pass = self.pass();
            if pass == 0 {
                return Some(0);
            }
            let (hit, missed) = self.certain(scale, within, limit);
            if hit & pass != 0 { None } else { Some(pass & !missed) }
        }
    }

    impl Kernel for Avx2 {
        #[inline(always)]
        fn new(slab: &SlabRay, sheared: &ShearedRay) -> Self {
            // Written out: a closure handed to `map` would be compiled without the instruction set.
            let k = sheared.k;
            let c = slab.o * slab.rcp;
            let pad = c.abs() * PAD;
            let (near_o, far_o, far_rcp) = (c + pad, (c - pad) * FAR_SCALE, slab.rcp * FAR_SCALE);
            // SAFETY: called only inside functions that enable AVX2.
            unsafe {
                Self {
                    near_rcp: [_mm256_set1_ps(slab.rcp.x), _mm256_set1_ps(slab.rcp.y), _mm256_set1_ps(slab.rcp.z)],
                    near_o: [_mm256_set1_ps(near_o.x), _mm256_set1_ps(near_o.y), _mm256_set1_ps(near_o.z)],
                    far_rcp: [_mm256_set1_ps(far_rcp.x), _mm256_set1_ps(far_rcp.y), _mm256_set1_ps(far_rcp.z)],
                    far_o: [_mm256_set1_ps(far_o.x), _mm256_set1_ps(far_o.y), _mm256_set1_ps(far_o.z)],
                    near: slab.near,
                    far: slab.far,
                    k,
                    ko: [_mm_set1_ps(slab.o[k[0]]), _mm_set1_ps(slab.o[k[1]]), _mm_set1_ps(slab.o[k[2]])],
                    s: [_mm_set1_ps(sheared.s.x), _mm_set1_ps(sheared.s.y)],
                    shear: [sheared.s.x, sheared.s.y, sheared.s.z],
                    origin: [slab.o[k[0]], slab.o[k[1]], slab.o[k[2]]],
                }
            }
        }

        #[inline(always)]
        fn prefetch(nodes: &[Node8], blocks: &[Block], child: Child) {
            let node = nodes.as_ptr().wrapping_add(child.0 as usize).cast::<i8>();
            let block = blocks.as_ptr().wrapping_add(child.first_block()).cast::<i8>();
            let address = if child.is_node() { node } else { block };
            // SAFETY: a prefetch has no effect but on the cache, for any address.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(address);
                _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(64));
                _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(128));
                _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(192));
            }
        }

        #[inline(always)]
        fn node(&self, node: &Node8, limit: f32, near: &mut [f32; WIDTH]) -> u32 {
            let (n, f) = self.slabs(node, limit);
            // SAFETY: as in `slabs`; the store is unaligned.
            unsafe {
                _mm256_storeu_ps(near.as_mut_ptr(), n);
                _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(n, f)) as u32
            }
        }

        #[inline(always)]
        fn node_any(&self, node: &Node8, limit: f32) -> u32 {
            let (n, f) = self.slabs(node, limit);
            // SAFETY: as in `slabs`.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(n, f)) as u32 }
        }

        #[inline(always)]
        fn block(&self, block: &Block, limit: f32) -> u32 {
            // SAFETY: this type exists only inside functions that enable AVX2.
            unsafe { Edges::new::<false>(self, block).open(self.shear[2], limit) }
        }

        #[inline(always)]
        fn block_any(&self, block: &Block, within: f32, limit: f32) -> Option<u32> {
            // SAFETY: as in `block`.
            unsafe { Edges::new::<false>(self, block).open_any(self.shear[2], within, limit) }
        }

        #[inline(always)]
        fn flat(&self, block: &FlatBlock, limit: f32, near: &mut [f32; FLAT_LANES]) -> u32 {
            // SAFETY: this type exists only inside functions that enable AVX2.
            unsafe { flat_avx2(self, block, limit, near) }
        }
    }

    /// The same with mask registers.
    #[derive(Clone, Copy)]
    pub(super) struct Avx512(Avx2);

    impl Kernel for Avx512 {
        #[inline(always)]
        fn new(slab: &SlabRay, sheared: &ShearedRay) -> Self {
            Self(Avx2::new(slab, sheared))
        }

        #[inline(always)]
        fn prefetch(nodes: &[Node8], blocks: &[Block], child: Child) {
            Avx2::prefetch(nodes, blocks, child);
        }

        #[inline(always)]
        fn node(&self, node: &Node8, limit: f32, near: &mut [f32; WIDTH]) -> u32 {
            let (n, f) = self.0.slabs(node, limit);
            // SAFETY: this type exists only inside functions that enable AVX-512 VL; the store is unaligned.
            unsafe {
                _mm256_storeu_ps(near.as_mut_ptr(), n);
                _mm256_cmp_ps_mask::<_CMP_LE_OQ>(n, f) as u32
            }
        }

        #[inline(always)]
        fn node_any(&self, node: &Node8, limit: f32) -> u32 {
            let (n, f) = self.0.slabs(node, limit);
            // SAFETY: this type exists only inside functions that enable AVX-512 VL.
            unsafe { _mm256_cmp_ps_mask::<_CMP_LE_OQ>(n, f) as u32 }
        }

        #[inline(always)]
        fn push(node: &Node8, mask: u32, stack: &mut [MaybeUninit<Child>; WIDTH]) {
            // SAFETY: as in `node_any`; children are 32-byte aligned as the node is, the store is unaligned.
            unsafe {
                let children = _mm256_load_si256(node.child.as_ptr().cast());
                let packed = _mm256_maskz_compress_epi32(mask as u8, children);
                _mm256_storeu_si256(stack.as_mut_ptr().cast(), packed);
            }
        }

        #[inline(always)]
        fn block(&self, block: &Block, limit: f32) -> u32 {
            // SAFETY: this type exists only inside functions that enable AVX-512 DQ.
            unsafe { Edges::new::<true>(&self.0, block).open(self.0.shear[2], limit) }
        }

        #[inline(always)]
        fn block_any(&self, block: &Block, within: f32, limit: f32) -> Option<u32> {
            // SAFETY: as in `block`.
            unsafe { Edges::new::<true>(&self.0, block).open_any(self.0.shear[2], within, limit) }
        }

        #[inline(always)]
        fn flat(&self, block: &FlatBlock, limit: f32, near: &mut [f32; FLAT_LANES]) -> u32 {
            // SAFETY: this type exists only inside functions that enable AVX-512 F.
            unsafe { flat_avx512(&self.0, block, limit, near) }
        }
    }

    // Functions of their own, because closures have the instruction set of the function that they stand in.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn flat_avx2(r: &Avx2, block: &FlatBlock, limit: f32, near: &mut [f32; FLAT_LANES]) -> u32 {
        let mut pass = 0;
        for half in 0..2 {
            // SAFETY: as in `slabs`; each half of a row is 32-byte aligned as the block is, the store is unaligned.
            unsafe {
                let [kx, ky, kz] = r.k;
                let (sx, sy) = (_mm256_set1_ps(r.shear[0]), _mm256_set1_ps(r.shear[1]));
                let corner = |v: usize| {
                    let load = |k: usize, o: f32| {
                        _mm256_sub_ps(_mm256_load_ps(block.v[v][k].as_ptr().add(8 * half)), _mm256_set1_ps(o))
                    };
                    let z = load(kz, r.origin[2]);
                    (
                        _mm256_sub_ps(load(kx, r.origin[0]), _mm256_mul_ps(sx, z)),
                        _mm256_sub_ps(load(ky, r.origin[1]), _mm256_mul_ps(sy, z)),
                        z,
                    )
                };
                let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (corner(0), corner(1), corner(2));
                let edge = |p, q, r, s| _mm256_sub_ps(_mm256_mul_ps(p, q), _mm256_mul_ps(r, s));
                let (u, v, w) = (edge(cx, by, cy, bx), edge(ax, cy, ay, cx), edge(bx, ay, by, ax));
                let (zero, minus) = (_mm256_setzero_ps(), _mm256_set1_ps(-0.0));
                let abs = |x| _mm256_andnot_ps(minus, x);
                let most = |a, b, c| _mm256_max_ps(_mm256_max_ps(a, b), c);
                let side = _mm256_max_ps(most(abs(ax), abs(bx), abs(cx)), most(abs(ay), abs(by), abs(cy)));
                let reach = _mm256_add_ps(side, most(abs(az), abs(bz), abs(cz)));
                let error = _mm256_mul_ps(reach, _mm256_mul_ps(side, _mm256_set1_ps(EDGE)));
                let error = _mm256_max_ps(error, _mm256_set1_ps(f32::MIN_POSITIVE));
                let scale = _mm256_set1_ps(r.shear[2]);
                let [az, bz, cz] = [_mm256_mul_ps(az, scale), _mm256_mul_ps(bz, scale), _mm256_mul_ps(cz, scale)];
                let low = _mm256_min_ps(_mm256_min_ps(u, v), w);
                let high = most(u, v, w);
                let first = _mm256_min_ps(_mm256_min_ps(az, bz), cz);
                let last = _mm256_max_ps(_mm256_max_ps(az, bz), cz);
                _mm256_storeu_ps(near.as_mut_ptr().add(8 * half), first);
                let inside = _mm256_or_ps(
                    _mm256_cmp_ps::<_CMP_GE_OQ>(low, _mm256_xor_ps(error, minus)),
                    _mm256_cmp_ps::<_CMP_LE_OQ>(high, error),
                );
                let within = _mm256_and_ps(
                    _mm256_cmp_ps::<_CMP_GE_OQ>(last, zero),
                    _mm256_cmp_ps::<_CMP_LE_OQ>(first, _mm256_set1_ps(limit)),
                );
                pass |= (_mm256_movemask_ps(_mm256_and_ps(inside, within)) as u32) << (8 * half);
            }
        }
        pass
    }

    #[inline]
    #[target_feature(enable = "avx512f")]
    fn flat_avx512(r: &Avx2, block: &FlatBlock, limit: f32, near: &mut [f32; FLAT_LANES]) -> u32 {
        // SAFETY: this type exists only inside functions that enable AVX-512 F; rows are 64-byte aligned as the block
        // is, the store is unaligned.
        unsafe {
            let [kx, ky, kz] = r.k;
            let (sx, sy) = (_mm512_set1_ps(r.shear[0]), _mm512_set1_ps(r.shear[1]));
            let corner = |v: usize| {
                let load = |k: usize, o: f32| _mm512_sub_ps(_mm512_load_ps(block.v[v][k].as_ptr()), _mm512_set1_ps(o));
                let z = load(kz, r.origin[2]);
                (
                    _mm512_sub_ps(load(kx, r.origin[0]), _mm512_mul_ps(sx, z)),
                    _mm512_sub_ps(load(ky, r.origin[1]), _mm512_mul_ps(sy, z)),
                    z,
                )
            };
            let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (corner(0), corner(1), corner(2));
            let edge = |p, q, r, s| _mm512_sub_ps(_mm512_mul_ps(p, q), _mm512_mul_ps(r, s));
            let (u, v, w) = (edge(cx, by, cy, bx), edge(ax, cy, ay, cx), edge(bx, ay, by, ax));
            let zero = _mm512_setzero_ps();
            let abs = |x| _mm512_abs_ps(x);
            let most = |a, b, c| _mm512_max_ps(_mm512_max_ps(a, b), c);
            let side = _mm512_max_ps(most(abs(ax), abs(bx), abs(cx)), most(abs(ay), abs(by), abs(cy)));
            let reach = _mm512_add_ps(side, most(abs(az), abs(bz), abs(cz)));
            let error = _mm512_mul_ps(reach, _mm512_mul_ps(side, _mm512_set1_ps(EDGE)));
            let error = _mm512_max_ps(error, _mm512_set1_ps(f32::MIN_POSITIVE));
            let scale = _mm512_set1_ps(r.shear[2]);
            let [az, bz, cz] = [_mm512_mul_ps(az, scale), _mm512_mul_ps(bz, scale), _mm512_mul_ps(cz, scale)];
            let low = _mm512_min_ps(_mm512_min_ps(u, v), w);
            let high = most(u, v, w);
            let first = _mm512_min_ps(_mm512_min_ps(az, bz), cz);
            let last = _mm512_max_ps(_mm512_max_ps(az, bz), cz);
            let inside = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(low, _mm512_sub_ps(zero, error))
                | _mm512_cmp_ps_mask::<_CMP_LE_OQ>(high, error);
            let within = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(last, zero)
                & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(first, _mm512_set1_ps(limit));
            let pass = inside & within;
            if pass == 0 {
                return 0;
            }
            _mm512_storeu_ps(near.as_mut_ptr(), first);
            u32::from(pass)
        }
    }
}

#[cfg(target_arch = "aarch64")]
mod neon {
    use core::arch::aarch64::*;

    use super::super::kernel::{EDGE, PAD};
    use super::super::traverse::{FAR_SCALE, SlabRay};
    use super::super::wide::{FLAT_LANES, FlatBlock, WIDTH};
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

        #[inline(always)]
        fn flat(&self, block: &FlatBlock, limit: f32, near: &mut [f32; FLAT_LANES]) -> u32 {
            // SAFETY: every AArch64 has NEON.
            unsafe {
                let mut mask = vdupq_n_u32(0);
                for first in [0, 4, 8, 12] {
                    let (pass, [a, b, c]) = self.edges(&block.v, first);
                    let s = self.s[2];
                    let (a, b, c) = (vmulq_f32(a, s), vmulq_f32(b, s), vmulq_f32(c, s));
                    let (n, f) = (vminq_f32(vminq_f32(a, b), c), vmaxq_f32(vmaxq_f32(a, b), c));
                    store(near, first, n);
                    let within = vandq_u32(vcgezq_f32(f), vcleq_f32(n, vdupq_n_f32(limit)));
                    mask = vorrq_u32(mask, bits(vandq_u32(pass, within), first));
                }
                vaddvq_u32(mask)
            }
        }
    }
}
