//! The vector loops of the balancing for AVX2 and AVX-512, under the contracts of [`x86`](super::x86): a value of [`Avx2`] or
//! [`Avx512`] exists only on a machine that has the instructions, and whole vectors are stored only where slices have the room.

use super::simd_partition::{Columns, ColumnsMut, Extent, Partition, Pivot, Sides};
use super::x86::{Avx2, Avx512, FRONT};
use std::arch::x86_64::*;

/// What moves the lanes of a mask to the front.
#[inline(always)]
unsafe fn front(mask: u32) -> __m256i {
    unsafe { _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(FRONT[mask as usize] as i64)) }
}

/// The first lanes of 8, as many as there are values, as a vector.
#[inline(always)]
unsafe fn first_lanes(count: usize) -> __m256i {
    unsafe { _mm256_cmpgt_epi32(_mm256_set1_epi32(count.min(8) as i32), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)) }
}

#[inline(always)]
unsafe fn mask(v: __m256i) -> u32 {
    unsafe { _mm256_movemask_ps(_mm256_castsi256_ps(v)) as u32 }
}

impl Partition for Avx2 {
    #[inline(always)]
    fn count_less(self, values: &[i32], t: i32) -> usize {
        // The compiler makes eight-wide code of it here.
        values.iter().map(|&v| u32::from(v < t)).sum::<u32>() as usize
    }

    #[inline(always)]
    fn collect(self, values: &[i32], lo: i32, hi: i32, out: &mut [i32]) -> (usize, usize) {
        assert!(out.len() >= values.len() + 16);
        let (mut below, mut inside) = (0, 0);
        let (chunks, rest) = values.as_chunks::<8>();
        // SAFETY: the features are there; loads are whole chunks, and no more is kept than was loaded, with room for 16 more.
        unsafe {
            let (l, h) = (_mm256_set1_epi32(lo), _mm256_set1_epi32(hi));
            for chunk in chunks {
                let v = _mm256_loadu_si256(chunk.as_ptr().cast());
                let less = _mm256_cmpgt_epi32(l, v);
                let within = !mask(_mm256_or_si256(less, _mm256_cmpgt_epi32(v, h))) & 0xff;
                below += mask(less).count_ones() as usize;
                let to = out.as_mut_ptr().add(inside).cast();
                _mm256_storeu_si256(to, _mm256_permutevar8x32_epi32(v, front(within)));
                inside += within.count_ones() as usize;
            }
        }
        for &v in rest {
            out[inside] = v;
            inside += usize::from(v >= lo && v <= hi);
            below += usize::from(v < lo);
        }
        (below, inside)
    }

    #[inline(always)]
    fn partition(self, from: &Columns, pivot: Pivot, left: &mut ColumnsMut, right: &mut ColumnsMut) -> Sides {
        let n = from.len();
        let (nl, nr) = (left.power.len(), right.power.len());
        assert!(from.even() && left.as_ref().even() && right.as_ref().even());
        let (to_left, to_right) = (words(left), words(right));
        let from_words = from_words(from);
        let keys = from_words[pivot.axis];
        let (mut l, mut r, mut seen, mut median) = (0, 0, 0, None);
        // SAFETY: the features are there. Loads are masked to the n lanes that all columns have. Whole vectors are stored where
        // 8 lanes are left on a side, else as many lanes as are kept, which `l` and `r` are asserted to have room for.
        unsafe {
            let at = _mm256_set1_epi32(pivot.at);
            for i in (0..n).step_by(8) {
                let lanes = first_lanes(n - i);
                let valid = mask(lanes);
                let key = _mm256_maskload_epi32(keys.add(i), lanes);
                let mut first = mask(_mm256_cmpgt_epi32(at, key)) & valid;
                let mut ties = mask(_mm256_cmpeq_epi32(at, key)) & valid;
                let mut last = valid & !first;
                while ties != 0 {
                    let tie = ties & ties.wrapping_neg();
                    if seen < pivot.median {
                        first |= tie;
                        last &= !tie;
                    } else if seen == pivot.median {
                        last &= !tie;
                        median = Some(i + tie.trailing_zeros() as usize);
                    }
                    seen += 1;
                    ties ^= tie;
                }
                let (some_left, some_right) = (first.count_ones() as usize, last.count_ones() as usize);
                let (order_left, order_right) = (front(first), front(last));
                let v = from_words.map(|c| _mm256_maskload_epi32(c.add(i), lanes));
                if l + 8 <= nl && r + 8 <= nr {
                    for c in 0..5 {
                        _mm256_storeu_si256(to_left[c].add(l).cast(), _mm256_permutevar8x32_epi32(v[c], order_left));
                        _mm256_storeu_si256(to_right[c].add(r).cast(), _mm256_permutevar8x32_epi32(v[c], order_right));
                    }
                } else {
                    assert!(l + some_left <= nl && r + some_right <= nr);
                    let (ml, mr) = (first_lanes(some_left), first_lanes(some_right));
                    for c in 0..5 {
                        _mm256_maskstore_epi32(to_left[c].add(l), ml, _mm256_permutevar8x32_epi32(v[c], order_left));
                        _mm256_maskstore_epi32(to_right[c].add(r), mr, _mm256_permutevar8x32_epi32(v[c], order_right));
                    }
                }
                (l, r) = (l + some_left, r + some_right);
            }
        }
        assert!(l == nl && r == nr);
        Sides { left: self.extent(&left.as_ref()), right: self.extent(&right.as_ref()), median }
    }
}

/// The first lanes of 16, as many as there are values.
#[inline(always)]
fn lanes(count: usize) -> u16 {
    ((1u32 << count.min(16)) - 1) as u16
}

/// Lowest and highest coordinates seen so far.
#[derive(Clone, Copy)]
struct Box512 {
    lo: [__m512i; 3],
    hi: [__m512i; 3],
}

impl Box512 {
    #[inline(always)]
    unsafe fn empty() -> Self {
        unsafe { Self { lo: [_mm512_set1_epi32(i32::MAX); 3], hi: [_mm512_set1_epi32(i32::MIN); 3] } }
    }

    #[inline(always)]
    unsafe fn extend(&mut self, lanes: u16, v: [__m512i; 3]) {
        for ((lo, hi), v) in self.lo.iter_mut().zip(&mut self.hi).zip(v) {
            unsafe {
                *lo = _mm512_mask_min_epi32(*lo, lanes, *lo, v);
                *hi = _mm512_mask_max_epi32(*hi, lanes, *hi, v);
            }
        }
    }

    #[inline(always)]
    unsafe fn extent(&self) -> Extent {
        unsafe {
            Extent { lo: self.lo.map(|v| _mm512_reduce_min_epi32(v)), hi: self.hi.map(|v| _mm512_reduce_max_epi32(v)) }
        }
    }
}

/// The five columns as words.
type Words = [*mut i32; 5];

#[inline(always)]
fn words(columns: &mut ColumnsMut) -> Words {
    let [x, y, z] = columns.xyz.each_mut().map(|c| c.as_mut_ptr());
    [x, y, z, columns.power.as_mut_ptr().cast(), columns.rest.as_mut_ptr().cast()]
}

#[inline(always)]
fn from_words(columns: &Columns) -> [*const i32; 5] {
    let [x, y, z] = columns.xyz.map(|c| c.as_ptr());
    [x, y, z, columns.power.as_ptr().cast(), columns.rest.as_ptr().cast()]
}

impl Partition for Avx512 {
    #[inline(always)]
    fn count_less(self, values: &[i32], t: i32) -> usize {
        let mut count = 0;
        // SAFETY: the features are there; loads are whole chunks, or masked to what the last one has.
        unsafe {
            let t = _mm512_set1_epi32(t);
            let (chunks, rest) = values.as_chunks::<16>();
            for chunk in chunks {
                count += _mm512_cmplt_epi32_mask(_mm512_loadu_si512(chunk.as_ptr().cast()), t).count_ones();
            }
            let lanes = lanes(rest.len());
            let v = _mm512_maskz_loadu_epi32(lanes, rest.as_ptr());
            count += _mm512_mask_cmplt_epi32_mask(lanes, v, t).count_ones();
        }
        count as usize
    }

    #[inline(always)]
    fn largest_below(self, values: &[i32], t: i32) -> i32 {
        // SAFETY: the features are there; loads are whole chunks, or masked to what the last one has.
        unsafe {
            let t = _mm512_set1_epi32(t);
            let mut max = _mm512_set1_epi32(i32::MIN);
            for chunk in values.chunks(16) {
                let lanes = lanes(chunk.len());
                let v = _mm512_maskz_loadu_epi32(lanes, chunk.as_ptr());
                max = _mm512_mask_max_epi32(max, _mm512_mask_cmplt_epi32_mask(lanes, v, t), max, v);
            }
            _mm512_reduce_max_epi32(max)
        }
    }

    #[inline(always)]
    fn smallest_from(self, values: &[i32], t: i32) -> i32 {
        // SAFETY: the features are there; loads are whole chunks, or masked to what the last one has.
        unsafe {
            let t = _mm512_set1_epi32(t);
            let mut min = _mm512_set1_epi32(i32::MAX);
            for chunk in values.chunks(16) {
                let lanes = lanes(chunk.len());
                let v = _mm512_maskz_loadu_epi32(lanes, chunk.as_ptr());
                min = _mm512_mask_min_epi32(min, _mm512_mask_cmpge_epi32_mask(lanes, v, t), min, v);
            }
            _mm512_reduce_min_epi32(min)
        }
    }

    #[inline(always)]
    fn collect(self, values: &[i32], lo: i32, hi: i32, out: &mut [i32]) -> (usize, usize) {
        assert!(out.len() >= values.len() + 16);
        let (mut below, mut inside) = (0, 0);
        // SAFETY: the features are there; loads are masked to what the chunk has, and no more are stored than were loaded, with
        // room for 16 more.
        unsafe {
            let (lo, hi) = (_mm512_set1_epi32(lo), _mm512_set1_epi32(hi));
            for chunk in values.chunks(16) {
                let lanes = lanes(chunk.len());
                let v = _mm512_maskz_loadu_epi32(lanes, chunk.as_ptr());
                let less = _mm512_mask_cmplt_epi32_mask(lanes, v, lo);
                let within = _mm512_mask_cmple_epi32_mask(lanes & !less, v, hi);
                below += less.count_ones();
                _mm512_storeu_si512(out.as_mut_ptr().add(inside).cast(), _mm512_maskz_compress_epi32(within, v));
                inside += within.count_ones() as usize;
            }
        }
        (below as usize, inside)
    }

    #[inline(always)]
    fn partition(self, from: &Columns, pivot: Pivot, left: &mut ColumnsMut, right: &mut ColumnsMut) -> Sides {
        let n = from.len();
        let (nl, nr) = (left.power.len(), right.power.len());
        assert!(from.even() && left.as_ref().even() && right.as_ref().even());
        let (to_left, to_right) = (words(left), words(right));
        let from_words = from_words(from);
        let keys = from_words[pivot.axis];
        let (mut l, mut r, mut seen, mut median) = (0, 0, 0, None);
        // SAFETY: the features are there. Loads are masked to the n lanes that all columns have. Whole vectors are stored where
        // 16 lanes are left on a side, else as many lanes as are kept, which `l` and `r` are asserted to have room for.
        unsafe {
            let at = _mm512_set1_epi32(pivot.at);
            let (mut left_box, mut right_box) = (Box512::empty(), Box512::empty());
            for i in (0..n).step_by(16) {
                let valid = lanes(n - i);
                let key = _mm512_maskz_loadu_epi32(valid, keys.add(i));
                let mut first = _mm512_mask_cmplt_epi32_mask(valid, key, at);
                let mut ties = _mm512_mask_cmpeq_epi32_mask(valid, key, at);
                let mut last = valid & !first;
                while ties != 0 {
                    let tie = ties & ties.wrapping_neg();
                    if seen < pivot.median {
                        first |= tie;
                        last &= !tie;
                    } else if seen == pivot.median {
                        last &= !tie;
                        median = Some(i + tie.trailing_zeros() as usize);
                    }
                    seen += 1;
                    ties ^= tie;
                }
                let (some_left, some_right) = (first.count_ones() as usize, last.count_ones() as usize);
                let v = from_words.map(|c| _mm512_maskz_loadu_epi32(valid, c.add(i)));
                if l + 16 <= nl && r + 16 <= nr {
                    for c in 0..5 {
                        _mm512_storeu_si512(to_left[c].add(l).cast(), _mm512_maskz_compress_epi32(first, v[c]));
                        _mm512_storeu_si512(to_right[c].add(r).cast(), _mm512_maskz_compress_epi32(last, v[c]));
                    }
                } else {
                    assert!(l + some_left <= nl && r + some_right <= nr);
                    let (ml, mr) = (lanes(some_left), lanes(some_right));
                    for c in 0..5 {
                        _mm512_mask_storeu_epi32(to_left[c].add(l), ml, _mm512_maskz_compress_epi32(first, v[c]));
                        _mm512_mask_storeu_epi32(to_right[c].add(r), mr, _mm512_maskz_compress_epi32(last, v[c]));
                    }
                }
                (l, r) = (l + some_left, r + some_right);
                let v = [v[0], v[1], v[2]];
                left_box.extend(first, v);
                right_box.extend(last, v);
            }
            assert!(l == nl && r == nr);
            Sides { left: left_box.extent(), right: right_box.extent(), median }
        }
    }
}
