//! Photons found so far, unsorted, and the selection of the nearest k of them.

use super::simd::Simd;

/// Free places that [`Found`] keeps beyond its length, so that a vector store never leaves the buffers.
pub(crate) const ROOM: usize = 96;

/// Squared distances and indices of candidates in the order in which they were met.
#[derive(Default)]
pub(crate) struct Found {
    pub d_sq: Vec<f32>,
    pub index: Vec<u32>,
    pub len: usize,
}

impl Found {
    /// Empties the list and makes places for `count` candidates and the room beyond.
    pub fn reset(&mut self, count: usize) {
        self.len = 0;
        if self.d_sq.len() < count + ROOM {
            self.d_sq.resize(count + ROOM, f32::INFINITY);
            self.index.resize(count + ROOM, 0);
        }
    }

    /// True when a whole bucket still fits.
    #[inline(always)]
    pub fn has_room(&self) -> bool {
        self.len + ROOM <= self.d_sq.len()
    }

    #[inline(always)]
    pub fn push(&mut self, d_sq: f32, index: u32) {
        self.d_sq[self.len] = d_sq;
        self.index[self.len] = index;
        self.len += 1;
    }

    /// Drops the candidates from place `from` on that are not accepted.
    #[inline(always)]
    pub fn filter(&mut self, from: usize, mut accept: impl FnMut(u32) -> bool) {
        let mut kept = from;
        for i in from..self.len {
            let index = self.index[i];
            self.d_sq[kept] = self.d_sq[i];
            self.index[kept] = index;
            kept += usize::from(accept(index));
        }
        self.len = kept;
    }

    /// Keeps the nearest `k` of more than `k` candidates, in their order, and returns the k-th squared distance.
    /// Of those exactly as far as the k-th, the ones met first stay.
    #[inline(always)]
    pub fn keep_nearest<S: Simd>(&mut self, simd: S, k: usize) -> f32 {
        debug_assert!(0 < k && k < self.len);
        let kth = self.kth(simd, k);
        let nearer = simd.count_below(&self.d_sq[..self.len], kth);
        simd.keep(self, kth, k - nearer);
        debug_assert_eq!(self.len, k);
        kth
    }

    /// The k-th smallest squared distance: a search between bounds on which counting decides, by interpolation as long
    /// as that helps (on a surface the squared distances are uniform), then by halving the floats' bit patterns.
    #[inline(always)]
    fn kth<S: Simd>(&self, simd: S, k: usize) -> f32 {
        let values = &self.d_sq[..self.len];
        // Invariant: fewer than k values are below `lo`, at least k below `hi`.
        let (mut lo, mut hi) = (0f32, simd.max(values).next_up());
        let (mut below_lo, mut below_hi) = (0, self.len);
        for step in 0.. {
            let (a, b) = (lo.to_bits(), hi.to_bits());
            if b - a <= 1 {
                break;
            }
            let guess = lo + (hi - lo) * ((k - below_lo) as f32 / (below_hi - below_lo) as f32);
            let middle = if step < 8 { guess.to_bits().clamp(a + 1, b - 1) } else { a + (b - a) / 2 };
            let t = f32::from_bits(middle);
            let below = simd.count_below(values, t);
            if below < k {
                (lo, below_lo) = (t, below);
            } else {
                (hi, below_hi) = (t, below);
                if below == k {
                    return simd.max_below(values, t);
                }
            }
        }
        lo
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photon::simd::{Level, Task};
    use crate::sample::mix64;

    struct Keep<'a>(&'a mut Found, usize);
    impl Task for Keep<'_> {
        type Output = f32;
        fn run<S: Simd>(self, simd: S) -> f32 {
            self.0.keep_nearest(simd, self.1)
        }
    }

    #[test]
    fn selection_is_stable_and_exact() {
        for level in Level::available() {
            for case in 0..400u64 {
                let n = 2 + (mix64(case) % 200) as usize;
                let k = 1 + (mix64(case + 1000) % (n as u64 - 1)) as usize;
                // Many ties in every other case; zeros and huge values among them.
                let mut found = Found::default();
                found.reset(n);
                for i in 0..n {
                    let h = mix64(case << 20 | i as u64);
                    let d = match case % 4 {
                        0 => (h % 8) as f32,
                        1 => (h >> 40) as f32,
                        2 => 2f32.powi((h % 200) as i32 - 140),
                        _ => f32::from_bits((h % 0x7f00_0000) as u32),
                    };
                    found.push(d, i as u32);
                }
                let mut order: Vec<usize> = (0..n).collect();
                order.sort_by(|&a, &b| found.d_sq[a].total_cmp(&found.d_sq[b]).then(a.cmp(&b)));
                let mut expected: Vec<u32> = order[..k].iter().map(|&i| i as u32).collect();
                let kth = found.d_sq[order[k - 1]];
                expected.sort_unstable();
                assert_eq!(level.run(Keep(&mut found, k)), kth, "{level:?}, case {case}");
                assert_eq!(&found.index[..k], expected, "{level:?}, case {case}");
            }
        }
    }
}
