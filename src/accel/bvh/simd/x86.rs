//! The kernels for AVX2 and AVX-512.

use core::arch::x86_64::*;

use super::super::binned::{Box8, Union};
use super::super::flat::{Depths, FLAT_LANES, Flat, FlatBlock, FlatRay, Limits, Row};
use super::super::kernel::{EDGE, PAD};
use super::super::traverse::{FAR_SCALE, SlabRay};
use super::super::wave::{Candidates, Wave};
use super::super::wide::{Block, Child, Node8, WIDTH};
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

#[inline]
#[target_feature(enable = "avx2,bmi1,fma")]
pub(super) fn test_all_avx2<const ANY: bool>(
    bvh: &Bvh,
    tree: &Tree,
    flat: (&Flat, &FlatRay),
    ray: &Ray,
    placed: u32,
    best: &mut Best,
) {
    flat::test_all::<Avx2, ANY>(bvh, tree, flat, ray, placed, best);
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

#[inline]
#[target_feature(enable = "avx2,bmi1,fma,avx512f,avx512dq,avx512vl")]
pub(super) fn test_all_avx512<const ANY: bool>(
    bvh: &Bvh,
    tree: &Tree,
    flat: (&Flat, &FlatRay),
    ray: &Ray,
    placed: u32,
    best: &mut Best,
) {
    flat::test_all::<Avx512, ANY>(bvh, tree, flat, ray, placed, best);
}

#[target_feature(enable = "avx2,bmi1,fma")]
pub(super) fn run_avx2<T: Task>(task: T) -> T::Output {
    task.run()
}

#[target_feature(enable = "avx2,bmi1,fma,avx512f,avx512dq,avx512vl")]
pub(super) fn run_avx512<T: Task>(task: T) -> T::Output {
    task.run()
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
    fn flat<const ANY: bool>(block: &FlatBlock, ray: &FlatRay, limits: Limits, depths: &mut Depths) -> Option<u32> {
        // SAFETY: called only inside functions that enable what the kernel does.
        unsafe { flat_avx2::<ANY>(block, ray, limits, depths) }
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
    fn flat<const ANY: bool>(block: &FlatBlock, ray: &FlatRay, limits: Limits, depths: &mut Depths) -> Option<u32> {
        // SAFETY: called only inside functions that enable what the kernel does.
        unsafe { flat_avx512::<ANY>(block, ray, limits, depths) }
    }
}

// The operations of `flat_portable`, products and sums fused. Functions of their own, because closures have the instruction
// set of the function that they stand in.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn flat_avx2<const ANY: bool>(block: &FlatBlock, ray: &FlatRay, limits: Limits, depths: &mut Depths) -> Option<u32> {
    let (mut pass, mut hit) = (0, 0);
    for half in 0..2 {
        // SAFETY: rows are 64-byte aligned, as the block and the depths are, so that their halves are 32-byte aligned.
        unsafe {
            let row = |row: &Row| _mm256_load_ps(row.as_ptr().add(8 * half));
            let splat = |x: f32| _mm256_set1_ps(x);
            let dot = |v: &[Row; 3], [x, y, z]: [f32; 3], sum: __m256| {
                let sum = _mm256_fmadd_ps(row(&v[0]), splat(x), sum);
                _mm256_fmadd_ps(row(&v[2]), splat(z), _mm256_fmadd_ps(row(&v[1]), splat(y), sum))
            };
            let (zero, minus) = (_mm256_setzero_ps(), splat(-0.0));
            let slope = dot(&block.normal, ray.d, zero);
            let sign = _mm256_and_ps(slope, minus);
            let slope = _mm256_andnot_ps(minus, slope);
            let volume = |k: usize| _mm256_xor_ps(sign, dot(&block.edge[k], ray.m, dot(&block.moment[k], ray.d, zero)));
            let (u, v) = (volume(0), volume(1));
            let w = _mm256_sub_ps(_mm256_fmsub_ps(row(&block.area), slope, u), v);
            let least = _mm256_min_ps(_mm256_min_ps(u, v), w);
            let [x, y, z] = ray.o;
            let distance = _mm256_xor_ps(sign, dot(&block.normal, [-x, -y, -z], row(&block.offset)));
            let error = _mm256_fmadd_ps(row(&block.origin_error), splat(ray.reach), row(&block.offset_error));
            let slope_error = _mm256_mul_ps(row(&block.slope_error), splat(ray.size));
            let near = _mm256_sub_ps(distance, error);
            let steepest = _mm256_add_ps(slope, slope_error);
            let inside = _mm256_cmp_ps::<_CMP_GE_OQ>(least, splat(-ray.error));
            let ahead = _mm256_or_ps(
                _mm256_cmp_ps::<_CMP_GE_OQ>(distance, _mm256_xor_ps(error, minus)),
                _mm256_cmp_ps::<_CMP_LE_OQ>(slope, slope_error),
            );
            let before = _mm256_cmp_ps::<_CMP_LE_OQ>(near, _mm256_mul_ps(steepest, splat(limits.beyond)));
            let passes = _mm256_and_ps(inside, _mm256_and_ps(ahead, before));
            pass |= (_mm256_movemask_ps(passes) as u32) << (8 * half);
            if ANY {
                let inside = _mm256_cmp_ps::<_CMP_GT_OQ>(least, splat(ray.error));
                let (far, flattest) = (_mm256_add_ps(distance, error), _mm256_sub_ps(slope, slope_error));
                let before = _mm256_cmp_ps::<_CMP_LT_OQ>(far, _mm256_mul_ps(flattest, splat(limits.within)));
                let between = _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(near, zero), before);
                hit |= _mm256_movemask_ps(_mm256_and_ps(inside, between));
            } else {
                _mm256_store_ps(depths.near.as_mut_ptr().add(8 * half), near);
                _mm256_store_ps(depths.slope.as_mut_ptr().add(8 * half), steepest);
            }
        }
    }
    if hit != 0 { None } else { Some(pass) }
}

#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn flat_avx512<const ANY: bool>(block: &FlatBlock, ray: &FlatRay, limits: Limits, depths: &mut Depths) -> Option<u32> {
    // SAFETY: rows are 64-byte aligned, as the block and the depths are.
    unsafe {
        let row = |row: &Row| _mm512_load_ps(row.as_ptr());
        let splat = |x: f32| _mm512_set1_ps(x);
        let dot = |v: &[Row; 3], [x, y, z]: [f32; 3], sum: __m512| {
            let sum = _mm512_fmadd_ps(row(&v[0]), splat(x), sum);
            _mm512_fmadd_ps(row(&v[2]), splat(z), _mm512_fmadd_ps(row(&v[1]), splat(y), sum))
        };
        let (zero, minus) = (_mm512_setzero_ps(), splat(-0.0));
        let slope = dot(&block.normal, ray.d, zero);
        let sign = _mm512_and_ps(slope, minus);
        let slope = _mm512_abs_ps(slope);
        let volume = |k: usize| _mm512_xor_ps(sign, dot(&block.edge[k], ray.m, dot(&block.moment[k], ray.d, zero)));
        let (u, v) = (volume(0), volume(1));
        let w = _mm512_sub_ps(_mm512_fmsub_ps(row(&block.area), slope, u), v);
        let least = _mm512_min_ps(_mm512_min_ps(u, v), w);
        let [x, y, z] = ray.o;
        let distance = _mm512_xor_ps(sign, dot(&block.normal, [-x, -y, -z], row(&block.offset)));
        let error = _mm512_fmadd_ps(row(&block.origin_error), splat(ray.reach), row(&block.offset_error));
        let slope_error = _mm512_mul_ps(row(&block.slope_error), splat(ray.size));
        let near = _mm512_sub_ps(distance, error);
        let steepest = _mm512_add_ps(slope, slope_error);
        let inside = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(least, splat(-ray.error));
        let ahead = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(distance, _mm512_xor_ps(error, minus))
            | _mm512_cmp_ps_mask::<_CMP_LE_OQ>(slope, slope_error);
        let before = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, _mm512_mul_ps(steepest, splat(limits.beyond)));
        let pass = u32::from(inside & ahead & before);
        if pass == 0 {
            return Some(0);
        }
        if ANY {
            let inside = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(least, splat(ray.error));
            let (far, flattest) = (_mm512_add_ps(distance, error), _mm512_sub_ps(slope, slope_error));
            let before = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(far, _mm512_mul_ps(flattest, splat(limits.within)));
            if inside & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(near, zero) & before != 0 {
                return None;
            }
        } else {
            _mm512_store_ps(depths.near.as_mut_ptr(), near);
            _mm512_store_ps(depths.slope.as_mut_ptr(), steepest);
        }
        Some(pass)
    }
}

/// [`flat_portable`](flat::flat_portable) with one triangle beside sixteen rays, products and sums fused.
#[target_feature(enable = "avx512f,avx512dq")]
pub(super) fn meet_triangles(w: &Wave, c: &mut Candidates, flat: &Flat) {
    // SAFETY: rows of waves and candidates are 64-byte aligned, as their types and the sizes of their fields are; places in
    // rows of blocks are below their length.
    unsafe {
        let row = |row: &Row| _mm512_load_ps(row.as_ptr());
        let splat = |x: f32| _mm512_set1_ps(x);
        let rows = |r: &[Row; 3]| (row(&r[0]), row(&r[1]), row(&r[2]));
        let (o, d, m) = (rows(&w.o), rows(&w.d), rows(&w.m));
        let (reach, size, tmax) = (row(&w.reach), row(&w.size), row(&w.tmax));
        let (zero, minus) = (_mm512_setzero_ps(), splat(-0.0));
        let (inside, outside) = (row(&w.error), _mm512_xor_ps(row(&w.error), minus));
        // Reciprocals are good to 2⁻¹⁴.
        let (sooner, later) = (splat(1.0 - 1.0 / 4096.0), splat(1.0 + 1.0 / 4096.0));
        let (mut c_least, mut c_most) = (row(&c.least), row(&c.most));
        let (mut low, mut high) = (_mm512_setzero_si512(), _mm512_setzero_si512());
        for i in 0..flat.triangles {
            let (block, lane) = (&flat.blocks[i / FLAT_LANES], i % FLAT_LANES);
            let at = |row: &Row| _mm512_set1_ps(*row.get_unchecked(lane));
            let dot = |v: &[Row; 3], (x, y, z): (__m512, __m512, __m512), sum: __m512| {
                _mm512_fmadd_ps(at(&v[2]), z, _mm512_fmadd_ps(at(&v[1]), y, _mm512_fmadd_ps(at(&v[0]), x, sum)))
            };
            let slope = dot(&block.normal, d, zero);
            let sign = _mm512_and_ps(slope, minus);
            let slope = _mm512_abs_ps(slope);
            let u = _mm512_xor_ps(sign, dot(&block.edge[0], m, dot(&block.moment[0], d, zero)));
            let v = _mm512_xor_ps(sign, dot(&block.edge[1], m, dot(&block.moment[1], d, zero)));
            let rest = _mm512_sub_ps(_mm512_fmsub_ps(at(&block.area), slope, u), v);
            let least = _mm512_min_ps(_mm512_min_ps(u, v), rest);
            let below = _mm512_sub_ps(dot(&block.normal, o, zero), at(&block.offset));
            let distance = _mm512_xor_ps(_mm512_xor_ps(sign, minus), below);
            let error = _mm512_fmadd_ps(at(&block.origin_error), reach, at(&block.offset_error));
            let slope_error = _mm512_mul_ps(at(&block.slope_error), size);
            let near = _mm512_sub_ps(distance, error);
            let steepest = _mm512_add_ps(slope, slope_error);
            let ahead = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(distance, _mm512_xor_ps(error, minus))
                | _mm512_cmp_ps_mask::<_CMP_LE_OQ>(slope, slope_error);
            let passes = _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(ahead, least, outside);
            let passes = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(passes, near, _mm512_mul_ps(steepest, c_most));
            let (far, flattest) = (_mm512_add_ps(distance, error), _mm512_sub_ps(slope, slope_error));
            // NaN is below everything.
            let first = _mm512_mul_ps(_mm512_mul_ps(near, _mm512_rcp14_ps(steepest)), sooner);
            let first = _mm512_max_ps(first, zero);
            let last = _mm512_mul_ps(_mm512_mul_ps(far, _mm512_rcp14_ps(flattest)), later);
            let certain = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(passes, least, inside);
            let certain = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(certain, near, zero);
            let certain = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(certain, flattest, zero);
            let certain = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(certain, last, tmax);
            let alone = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(certain, last, c_least);
            low = _mm512_mask_mov_epi32(low, alone, _mm512_setzero_si512());
            high = _mm512_mask_mov_epi32(high, alone, _mm512_setzero_si512());
            let bit = _mm512_set1_epi32(1 << (i % 32));
            if i < 32 {
                low = _mm512_mask_or_epi32(low, passes, low, bit);
            } else {
                high = _mm512_mask_or_epi32(high, passes, high, bit);
            }
            c_least = _mm512_mask_min_ps(c_least, passes, c_least, first);
            c_least = _mm512_mask_mov_ps(c_least, alone, first);
            c_most = _mm512_mask_min_ps(c_most, certain, c_most, last);
        }
        _mm512_store_ps(c.least.as_mut_ptr(), c_least);
        _mm512_store_ps(c.most.as_mut_ptr(), c_most);
        _mm512_store_si512(c.bits[0].as_mut_ptr().cast(), low);
        _mm512_store_si512(c.bits[1].as_mut_ptr().cast(), high);
    }
}
