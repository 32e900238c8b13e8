//! The vector loops of queries for AVX2 and AVX-512. `unsafe` code of the photon map stands here and in `x86_partition`.
//!
//! Two contracts make it sound. A value of [`Avx2`] or [`Avx512`] exists only on a machine that has the instructions. Loads
//! stay within the slices they are given, whose lengths are checked; stores of a whole vector at the end of [`Found`] stay
//! within its buffers, whose room is checked.

use super::found::Found;
use super::simd::{Simd, Task};
use std::arch::x86_64::*;

/// Proof that the machine has AVX2 and POPCNT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Avx2(());

/// Proof that the machine has AVX-512 F and VL, and POPCNT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Avx512(());

/// For every set of eight lanes, their numbers in order, a byte each: what moves them to the front.
pub(super) static FRONT: [u64; 256] = {
    let mut table = [0; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut place) = (0, 0);
        while lane < 8 {
            if mask >> lane & 1 == 1 {
                table[mask] |= lane << (8 * place);
                place += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

impl Avx2 {
    pub fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt")).then_some(Self(()))
    }

    /// Runs a task in code that may use the instructions.
    #[inline(always)]
    pub fn run<T: Task>(self, task: T) -> T::Output {
        #[target_feature(enable = "avx2,popcnt")]
        fn with_features<T: Task>(simd: Avx2, task: T) -> T::Output {
            task.run(simd)
        }
        // SAFETY: `self` proves that the machine has the features.
        unsafe { with_features(self, task) }
    }
}

impl Avx512 {
    pub fn detect() -> Option<Self> {
        let has = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("popcnt");
        has.then_some(Self(()))
    }

    /// Runs a task in code that may use the instructions.
    #[inline(always)]
    pub fn run<T: Task>(self, task: T) -> T::Output {
        #[target_feature(enable = "avx512f,avx512dq,avx512vl,popcnt")]
        fn with_features<T: Task>(simd: Avx512, task: T) -> T::Output {
            task.run(simd)
        }
        // SAFETY: `self` proves that the machine has the features.
        unsafe { with_features(self, task) }
    }
}

/// Asks for every cache line of a block; a prefetch never faults.
#[inline(always)]
fn prefetch(block: &[f32]) {
    for line in block.chunks(16) {
        // SAFETY: every x86-64 has the instruction.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast()) };
    }
}

/// Appends the lanes of `mask` to `found`, whose buffers have room for 16 more.
#[inline(always)]
unsafe fn append512(found: &mut Found, mask: u16, d_sq: __m512, index: __m512i) {
    unsafe {
        _mm512_storeu_ps(found.d_sq.as_mut_ptr().add(found.len), _mm512_maskz_compress_ps(mask, d_sq));
        let to = found.index.as_mut_ptr().add(found.len).cast();
        _mm512_storeu_si512(to, _mm512_maskz_compress_epi32(mask, index));
    }
    found.len += mask.count_ones() as usize;
}

impl Simd for Avx512 {
    #[inline(always)]
    fn prefetch(self, block: &[f32]) {
        prefetch(block);
    }

    #[inline(always)]
    fn scan(self, block: &[f32], first: u32, q: [f32; 3], r_sq: f32, found: &mut Found) {
        let lanes = block.len() / 3;
        assert!(
            lanes.is_multiple_of(16)
                && found.index.len() == found.d_sq.len()
                && found.len + lanes + 16 <= found.d_sq.len()
        );
        // SAFETY: the features are there; loads end at 3·lanes, the length of the block; each append has room for the
        // lanes that are left and 16 more.
        unsafe {
            let [qx, qy, qz] = q.map(|v| _mm512_set1_ps(v));
            let limit = _mm512_set1_ps(r_sq);
            let iota = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
            let mut index = _mm512_add_epi32(iota, _mm512_set1_epi32(first as i32));
            let mut valid = 0xfffe;
            for i in (0..lanes).step_by(16) {
                let x = block.as_ptr().add(i);
                let dx = _mm512_sub_ps(_mm512_loadu_ps(x), qx);
                let dy = _mm512_sub_ps(_mm512_loadu_ps(x.add(lanes)), qy);
                let dz = _mm512_sub_ps(_mm512_loadu_ps(x.add(2 * lanes)), qz);
                let xy = _mm512_add_ps(_mm512_mul_ps(dx, dx), _mm512_mul_ps(dy, dy));
                let d_sq = _mm512_add_ps(xy, _mm512_mul_ps(dz, dz));
                let mask = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(valid, d_sq, limit);
                append512(found, mask, d_sq, index);
                index = _mm512_add_epi32(index, _mm512_set1_epi32(16));
                valid = 0xffff;
            }
        }
    }

    #[inline(always)]
    fn count_below(self, values: &[f32], t: f32) -> usize {
        let mut count = 0;
        // SAFETY: the features are there; a load is masked to the lanes the chunk has.
        unsafe {
            let t = _mm512_set1_ps(t);
            for chunk in values.chunks(16) {
                let lanes = (0xffff_u32 >> (16 - chunk.len())) as u16;
                let v = _mm512_maskz_loadu_ps(lanes, chunk.as_ptr());
                count += _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(lanes, v, t).count_ones();
            }
        }
        count as usize
    }

    #[inline(always)]
    fn max(self, values: &[f32]) -> f32 {
        self.max_below(values, f32::INFINITY)
    }

    #[inline(always)]
    fn max_below(self, values: &[f32], t: f32) -> f32 {
        // SAFETY: the features are there; a load is masked to the lanes the chunk has.
        unsafe {
            let t = _mm512_set1_ps(t);
            let mut max = _mm512_setzero_ps();
            for chunk in values.chunks(16) {
                let lanes = (0xffff_u32 >> (16 - chunk.len())) as u16;
                let v = _mm512_maskz_loadu_ps(lanes, chunk.as_ptr());
                let below = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(lanes, v, t);
                max = _mm512_mask_max_ps(max, below, max, v);
            }
            _mm512_reduce_max_ps(max)
        }
    }

    #[inline(always)]
    fn keep(self, found: &mut Found, kth: f32, mut ties: usize) {
        let len = found.len;
        assert!(found.index.len() == found.d_sq.len() && len + 16 <= found.d_sq.len());
        found.len = 0;
        // SAFETY: the features are there; loads start before `len` and there are 16 places after it, appended ends before
        // the load does.
        unsafe {
            let limit = _mm512_set1_ps(kth);
            for i in (0..len).step_by(16) {
                let lanes = if len - i < 16 { 0xffff >> (16 - (len - i)) } else { 0xffff };
                let d_sq = _mm512_loadu_ps(found.d_sq.as_ptr().add(i));
                let index = _mm512_loadu_si512(found.index.as_ptr().add(i).cast());
                let nearer = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(lanes, d_sq, limit);
                let mut equal = _mm512_mask_cmp_ps_mask::<_CMP_EQ_OQ>(lanes, d_sq, limit);
                // Let the last ones go until the rest may stay.
                while equal.count_ones() as usize > ties {
                    equal &= !(1 << (15 - equal.leading_zeros()));
                }
                ties -= equal.count_ones() as usize;
                append512(found, nearer | equal, d_sq, index);
            }
        }
    }
}

/// Appends the lanes of `mask` to `found`, whose buffers have room for 8 more.
#[inline(always)]
unsafe fn append256(found: &mut Found, mask: u32, d_sq: __m256, index: __m256i) {
    unsafe {
        let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(FRONT[mask as usize] as i64));
        _mm256_storeu_ps(found.d_sq.as_mut_ptr().add(found.len), _mm256_permutevar8x32_ps(d_sq, order));
        let to = found.index.as_mut_ptr().add(found.len).cast();
        _mm256_storeu_si256(to, _mm256_permutevar8x32_epi32(index, order));
    }
    found.len += mask.count_ones() as usize;
}

impl Simd for Avx2 {
    #[inline(always)]
    fn prefetch(self, block: &[f32]) {
        prefetch(block);
    }

    #[inline(always)]
    fn scan(self, block: &[f32], first: u32, q: [f32; 3], r_sq: f32, found: &mut Found) {
        let lanes = block.len() / 3;
        assert!(
            lanes.is_multiple_of(8)
                && found.index.len() == found.d_sq.len()
                && found.len + lanes + 8 <= found.d_sq.len()
        );
        // SAFETY: the features are there; loads end at 3·lanes, the length of the block; each append has room for the
        // lanes that are left and 8 more.
        unsafe {
            let [qx, qy, qz] = q.map(|v| _mm256_set1_ps(v));
            let limit = _mm256_set1_ps(r_sq);
            let iota = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let mut index = _mm256_add_epi32(iota, _mm256_set1_epi32(first as i32));
            let mut valid = 0xfe;
            for i in (0..lanes).step_by(8) {
                let x = block.as_ptr().add(i);
                let dx = _mm256_sub_ps(_mm256_loadu_ps(x), qx);
                let dy = _mm256_sub_ps(_mm256_loadu_ps(x.add(lanes)), qy);
                let dz = _mm256_sub_ps(_mm256_loadu_ps(x.add(2 * lanes)), qz);
                let xy = _mm256_add_ps(_mm256_mul_ps(dx, dx), _mm256_mul_ps(dy, dy));
                let d_sq = _mm256_add_ps(xy, _mm256_mul_ps(dz, dz));
                let mask = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(d_sq, limit)) as u32 & valid;
                append256(found, mask, d_sq, index);
                index = _mm256_add_epi32(index, _mm256_set1_epi32(8));
                valid = 0xff;
            }
        }
    }

    #[inline(always)]
    fn count_below(self, values: &[f32], t: f32) -> usize {
        // The compiler makes eight-wide code of it here.
        values.iter().map(|&v| u32::from(v < t)).sum::<u32>() as usize
    }

    #[inline(always)]
    fn max(self, values: &[f32]) -> f32 {
        self.max_below(values, f32::INFINITY)
    }

    #[inline(always)]
    fn max_below(self, values: &[f32], t: f32) -> f32 {
        // Eight maxima, so that no comparison waits for the one before.
        let (chunks, rest) = values.as_chunks::<8>();
        let larger = |m: f32, v: f32| if v > m && v < t { v } else { m };
        let maxima = chunks.iter().fold([0.0; 8], |m, c| std::array::from_fn(|i| larger(m[i], c[i])));
        maxima.into_iter().chain(rest.iter().copied()).fold(0.0, larger)
    }

    #[inline(always)]
    fn keep(self, found: &mut Found, kth: f32, mut ties: usize) {
        let len = found.len;
        assert!(found.index.len() == found.d_sq.len() && len + 8 <= found.d_sq.len());
        found.len = 0;
        // SAFETY: the features are there; loads start before `len` and there are 8 places after it, appended ends before
        // the load does.
        unsafe {
            let limit = _mm256_set1_ps(kth);
            for i in (0..len).step_by(8) {
                let lanes = if len - i < 8 { 0xff >> (8 - (len - i)) } else { 0xff };
                let d_sq = _mm256_loadu_ps(found.d_sq.as_ptr().add(i));
                let index = _mm256_loadu_si256(found.index.as_ptr().add(i).cast());
                let nearer = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(d_sq, limit)) as u32 & lanes;
                let mut equal = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(d_sq, limit)) as u32 & lanes;
                // Let the last ones go until the rest may stay.
                while equal.count_ones() as usize > ties {
                    equal &= !(1 << (31 - equal.leading_zeros()));
                }
                ties -= equal.count_ones() as usize;
                append256(found, nearer | equal, d_sq, index);
            }
        }
    }
}
