//! The vector loops of the photon map.

use super::found::Found;
use super::simd_partition::Partition;
#[cfg(target_arch = "x86_64")]
use super::x86;

/// The loops that have a form for every instruction set. All forms give the same bits: no fused multiply-add is used.
pub(crate) trait Simd: Partition {
    /// Appends the photons of a block whose squared distance from `q` is below `r_sq`, without that of lane 0. `block` is
    /// its x, y and z, 32 or 64 of each; `first` is the index of lane 0.
    fn scan(self, block: &[f32], first: u32, q: [f32; 3], r_sq: f32, found: &mut Found);

    /// Asks the memory for a block that will be scanned.
    #[inline(always)]
    fn prefetch(self, _block: &[f32]) {}

    /// Number of values below `t`.
    fn count_below(self, values: &[f32], t: f32) -> usize;

    /// The largest value; 0 without any.
    fn max(self, values: &[f32]) -> f32;

    /// The largest value below `t`; 0 without any.
    fn max_below(self, values: &[f32], t: f32) -> f32;

    /// Keeps, in order, what is nearer than `kth` and the first `ties` that are exactly as far.
    fn keep(self, found: &mut Found, kth: f32, ties: usize);
}

/// Work that is compiled once for every instruction set.
pub(crate) trait Task {
    type Output;
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// An instruction set that this machine has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2(x86::Avx2),
    #[cfg(target_arch = "x86_64")]
    Avx512(x86::Avx512),
}

impl Level {
    /// Every usable level, the best one last.
    pub fn available() -> Vec<Self> {
        let levels = [
            Some(Self::Portable),
            #[cfg(target_arch = "x86_64")]
            x86::Avx2::detect().map(Self::Avx2),
            #[cfg(target_arch = "x86_64")]
            x86::Avx512::detect().map(Self::Avx512),
        ];
        levels.into_iter().flatten().collect()
    }

    /// The best usable level.
    pub fn best() -> Self {
        Self::available().pop().unwrap_or(Self::Portable)
    }

    #[inline(always)]
    pub fn run<T: Task>(self, task: T) -> T::Output {
        match self {
            Self::Portable => task.run(Portable),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(simd) => simd.run(task),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(simd) => simd.run(task),
        }
    }
}

/// Plain loops, which the compiler vectorises as far as the target's baseline allows.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

impl Simd for Portable {
    #[inline(always)]
    fn scan(self, block: &[f32], first: u32, q: [f32; 3], r_sq: f32, found: &mut Found) {
        let lanes = block.len() / 3;
        let (xs, yzs) = block.split_at(lanes);
        let (ys, zs) = yzs.split_at(lanes);
        for (i, ((x, y), z)) in xs.iter().zip(ys).zip(zs).enumerate().skip(1) {
            let (dx, dy, dz) = (x - q[0], y - q[1], z - q[2]);
            let d_sq = dx * dx + dy * dy + dz * dz;
            found.d_sq[found.len] = d_sq;
            found.index[found.len] = first.wrapping_add(i as u32);
            found.len += usize::from(d_sq < r_sq);
        }
    }

    #[inline(always)]
    fn count_below(self, values: &[f32], t: f32) -> usize {
        values.iter().map(|&v| u32::from(v < t)).sum::<u32>() as usize
    }

    #[inline(always)]
    fn max(self, values: &[f32]) -> f32 {
        values.iter().fold(0.0, |m, &v| if v > m { v } else { m })
    }

    #[inline(always)]
    fn max_below(self, values: &[f32], t: f32) -> f32 {
        values.iter().fold(0.0, |m, &v| if v > m && v < t { v } else { m })
    }

    #[inline(always)]
    fn keep(self, found: &mut Found, kth: f32, mut ties: usize) {
        let mut kept = 0;
        for i in 0..found.len {
            let d_sq = found.d_sq[i];
            let tie = d_sq == kth && ties > 0;
            ties -= usize::from(tie);
            found.d_sq[kept] = d_sq;
            found.index[kept] = found.index[i];
            kept += usize::from(d_sq < kth || tie);
        }
        found.len = kept;
    }
}
