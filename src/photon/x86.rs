//! The vector loops for AVX2 and AVX-512: the only `unsafe` code of the photon map.
//!
//! Two contracts make it sound. A value of [`Avx2`] or [`Avx512`] exists only on a machine that has the instructions. Loads
//! stay within the slices they are given, whose lengths are checked; stores of a whole vector at the end of [`Found`] stay
//! within its buffers, whose room is checked.

use super::build::Key;
use super::found::Found;
use super::simd::{Portable, Simd, Task};
use std::arch::x86_64::*;

/// Proof that the machine has AVX2 and POPCNT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Avx2(());

/// Proof that the machine has AVX-512 F and VL, BMI2 and POPCNT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Avx512(());

/// For every set of eight lanes, their numbers in order, a byte each: what moves them to the front.
static FRONT: [u64; 256] = {
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
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("popcnt");
        has.then_some(Self(()))
    }

    /// Runs a task in code that may use the instructions.
    #[inline(always)]
    pub fn run<T: Task>(self, task: T) -> T::Output {
        #[target_feature(enable = "avx512f,avx512vl,bmi2,popcnt")]
        fn with_features<T: Task>(simd: Avx512, task: T) -> T::Output {
            task.run(simd)
        }
        // SAFETY: `self` proves that the machine has the features.
        unsafe { with_features(self, task) }
    }
}

/// For every set of four keys, the lanes of a vector in the order that brings those of the set to the front.
static PARTED: [Lanes; 16] = {
    let mut table = [Lanes([0; 16]); 16];
    let mut mask = 0;
    while mask < 16 {
        let (mut front, mut back, mut lane) = (0, (mask as u32).count_ones() as usize * 4, 0);
        while lane < 16 {
            let to = if mask >> (lane / 4) & 1 == 1 { &mut front } else { &mut back };
            table[mask].0[*to] = lane;
            *to += 1;
            lane += 1;
        }
        mask += 1;
    }
    table
};

#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Lanes([i32; 16]);

/// Four keys in a vector.
const KEYS: usize = 4;

/// Brings the keys whose coordinate in lane `SPREAD` is below the limit to the front, and tells which lanes they had.
#[inline(always)]
unsafe fn part512<const SPREAD: i32>(v: __m512i, limit: __m512i) -> (__m512i, u16) {
    unsafe {
        let mask = _mm512_cmplt_epi32_mask(_mm512_shuffle_epi32::<SPREAD>(v), limit);
        // The four lanes of a key agree: one bit of each is enough.
        let order = &PARTED[_pext_u32(u32::from(mask), 0x1111) as usize % 16];
        (_mm512_permutexvar_epi32(_mm512_load_si512((&raw const order.0).cast()), v), mask)
    }
}

/// [`Simd::partition`] along the axis whose lane `SPREAD` copies to all lanes of a key, at least `2 * KEYS * U` keys.
///
/// The keys of both ends are put aside; then a run of keys is read from the end where less room is left, so that on both
/// sides there is room to write.
#[inline(always)]
unsafe fn partition512<const SPREAD: i32, const U: usize>(keys: &mut [Key], t: i32) -> usize {
    let (n, run) = (keys.len(), KEYS * U);
    assert!(n >= 2 * run);
    let mut aside = [[Key::default(); 3 * KEYS]; U];
    let aside = aside.as_flattened_mut();
    aside[..run].copy_from_slice(&keys[..run]);
    aside[run..2 * run].copy_from_slice(&keys[n - run..]);
    let base = keys.as_mut_ptr();
    let (mut next, mut end) = (run, n - run);
    let (mut below, mut above) = (0, n);
    // SAFETY: the features are there. Reads stay between `next` and `end`. What has been read but not written leaves room
    // for `3 * run` keys, at least `run` of them on either side whenever `run` keys are written.
    unsafe {
        let limit = _mm512_set1_epi32(t);
        while end - next >= run {
            let from = if next - below <= above - end {
                next += run;
                next - run
            } else {
                end -= run;
                end
            };
            // Read all before the first is written: their own places are among those to be written.
            let mut vectors = [_mm512_setzero_si512(); U];
            for (i, v) in vectors.iter_mut().enumerate() {
                *v = _mm512_loadu_si512(base.add(from + KEYS * i).cast());
            }
            for v in vectors {
                let (v, mask) = part512::<SPREAD>(v, limit);
                _mm512_storeu_si512(base.add(below).cast(), v);
                _mm512_storeu_si512(base.add(above - KEYS).cast(), v);
                let count = mask.count_ones() as usize / KEYS;
                below += count;
                above -= KEYS - count;
            }
        }
        // The rest goes into the gap, which is as large.
        let rest = end - next;
        aside[2 * run..2 * run + rest].copy_from_slice(std::slice::from_raw_parts(base.add(next), rest));
        let (vectors, single) = aside[..2 * run + rest].as_chunks::<KEYS>();
        for four in vectors {
            let (v, mask) = part512::<SPREAD>(_mm512_loadu_si512(four.as_ptr().cast()), limit);
            let front = ((1u32 << mask.count_ones()) - 1) as u16;
            _mm512_mask_storeu_epi32(base.add(below).cast(), front, v);
            _mm512_mask_storeu_epi32(base.add(above - KEYS).cast(), !front, v);
            let count = mask.count_ones() as usize / KEYS;
            below += count;
            above -= KEYS - count;
        }
        for key in single {
            let is_below = key.p[(SPREAD & 3) as usize] < t;
            *base.add(if is_below { below } else { above - 1 }) = *key;
            below += usize::from(is_below);
            above -= usize::from(!is_below);
        }
    }
    below
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

    #[inline(always)]
    fn partition(self, keys: &mut [Key], axis: usize, t: i32) -> usize {
        // SAFETY: the features are there.
        unsafe {
            match (axis, keys.len()) {
                (_, ..16) => Portable.partition(keys, axis, t),
                (0, ..1024) => partition512::<0x00, 2>(keys, t),
                (1, ..1024) => partition512::<0x55, 2>(keys, t),
                (_, ..1024) => partition512::<0xaa, 2>(keys, t),
                (0, _) => partition512::<0x00, 16>(keys, t),
                (1, _) => partition512::<0x55, 16>(keys, t),
                (_, _) => partition512::<0xaa, 16>(keys, t),
            }
        }
    }

    #[inline(always)]
    fn extents(self, keys: &[Key]) -> ([i32; 3], [i32; 3]) {
        let (runs, rest) = keys.as_chunks::<{ 4 * KEYS }>();
        // SAFETY: the features are there; a load takes four of a run's sixteen keys, a store fills its array.
        let (lo, hi) = unsafe {
            let (mut lo, mut hi) = ([_mm512_set1_epi32(i32::MAX); 4], [_mm512_set1_epi32(i32::MIN); 4]);
            for run in runs {
                for i in 0..4 {
                    let v = _mm512_loadu_si512(run.as_ptr().add(KEYS * i).cast());
                    lo[i] = _mm512_min_epi32(lo[i], v);
                    hi[i] = _mm512_max_epi32(hi[i], v);
                }
            }
            let lo = _mm512_min_epi32(_mm512_min_epi32(lo[0], lo[1]), _mm512_min_epi32(lo[2], lo[3]));
            let hi = _mm512_max_epi32(_mm512_max_epi32(hi[0], hi[1]), _mm512_max_epi32(hi[2], hi[3]));
            let (mut least, mut most) = ([[0i32; 4]; KEYS], [[0i32; 4]; KEYS]);
            _mm512_storeu_si512(least.as_mut_ptr().cast(), lo);
            _mm512_storeu_si512(most.as_mut_ptr().cast(), hi);
            (least, most)
        };
        let (mut least, mut most) = Portable.extents(rest);
        for (lo, hi) in lo.iter().zip(&hi) {
            for a in 0..3 {
                least[a] = least[a].min(lo[a]);
                most[a] = most[a].max(hi[a]);
            }
        }
        (least, most)
    }

    #[inline(always)]
    fn prefetch<T>(self, at: &T) {
        // SAFETY: a hint, for an address that can be read.
        unsafe { _mm_prefetch::<_MM_HINT_T0>((&raw const *at).cast()) }
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

    #[inline(always)]
    fn prefetch<T>(self, at: &T) {
        // SAFETY: a hint, for an address that can be read.
        unsafe { _mm_prefetch::<_MM_HINT_T0>((&raw const *at).cast()) }
    }
}
