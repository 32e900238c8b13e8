//! Selection by rank, with the vector loops.
//!
//! Large sets are narrowed to what lies between two values of a sample that enclose the rank [Floyd and Rivest 1975]. Sets
//! that fit into the cache are counted: a search for the value with the wanted number of smaller ones reads the column of
//! one coordinate a few times, and the keys are moved only once.

use super::build::{Key, unordered};
use super::simd::Simd;
use crate::sample::mix64;

/// Sets of at most this many keys are counted.
const COUNTED: usize = 1 << 15;

/// Bad samples in a row after which another algorithm has its turn, whose time is bounded.
const ROUNDS: usize = 12;

/// Memory that selections use in turn.
#[derive(Default)]
pub(super) struct Scratch {
    column: Vec<i32>,
}

/// Moves the key of this rank along the axis to its place, smaller ones to its left; ties by emission index.
#[inline(always)]
pub(super) fn select<S: Simd>(simd: S, keys: &mut [Key], axis: usize, rank: usize, scratch: &mut Scratch) {
    let (mut keys, mut rank) = (keys, rank);
    let mut narrow = false;
    for _ in 0..ROUNDS {
        if keys.len() <= COUNTED {
            return counted(simd, keys, axis, rank, scratch);
        }
        // Part the keys below and above two values.
        let (n, (lo, hi)) = (keys.len(), bracket(keys, axis, rank, narrow, &mut scratch.column));
        let below = simd.partition(keys, axis, lo);
        if rank < below {
            keys = &mut keys[..below];
        } else {
            keys = &mut keys[below..];
            rank -= below;
            let between = simd.partition(keys, axis, hi + 1);
            if rank >= between {
                keys = &mut keys[between..];
                rank -= between;
            } else {
                keys = &mut keys[..between];
                if lo == hi {
                    keys.select_nth_unstable_by_key(rank, |key| key.id);
                    return;
                }
            }
        }
        // Where one value is frequent, two that enclose it part nothing.
        narrow = keys.len() > n / 2;
    }
    keys.select_nth_unstable_by_key(rank, |key| key.order(axis));
}

/// Two values of a sample that probably enclose the rank; a `narrow` bracket has one value.
fn bracket(keys: &[Key], axis: usize, rank: usize, narrow: bool, sample: &mut Vec<i32>) -> (i32, i32) {
    // One key of each of 8·√n strata, so that no regularity of the emission is met.
    let n = keys.len();
    let count = (8.0 * (n as f64).sqrt()) as usize;
    let stride = n / count;
    sample.clear();
    sample.extend((0..count).map(|i| keys[i * stride + mix64(i as u64) as usize % stride].p[axis]));
    // 2.5 standard deviations of the rank on both sides.
    let middle = (rank as f64 / n as f64 * count as f64) as usize;
    let spread = if narrow { 0 } else { (1.25 * (count as f64).sqrt()) as usize + 1 };
    let (first, last) = (middle.saturating_sub(spread), (middle + spread).min(count - 1));
    let (_, &mut lo, above) = sample.select_nth_unstable(first);
    let hi = if last > first { *above.select_nth_unstable(last - first - 1).1 } else { lo };
    (lo, hi)
}

/// [`select`] for sets in the cache.
#[inline(always)]
fn counted<S: Simd>(simd: S, keys: &mut [Key], axis: usize, rank: usize, scratch: &mut Scratch) {
    let column = &mut scratch.column;
    column.clear();
    column.extend(keys.iter().map(|key| key.p[axis]));
    let Some(pivot) = separator(column, rank) else {
        return;
    };
    match pivot {
        Pivot::Value(v) => {
            // The key itself waits at the end.
            let at = first_of(keys, column, v);
            let last = keys.len() - 1;
            keys.swap(at, last);
            let below = simd.partition(&mut keys[..last], axis, v);
            debug_assert_eq!(below, rank);
            keys.swap(rank, last);
        }
        Pivot::Tied(v) => {
            let below = simd.partition(keys, axis, v);
            let keys = &mut keys[below..];
            let equal = simd.partition(keys, axis, v + 1);
            keys[..equal].select_nth_unstable_by_key(rank - below, |key| key.id);
        }
    }
}

enum Pivot {
    /// As many values as wanted are smaller than this one.
    Value(i32),
    /// Fewer values are smaller than this one, more are not larger.
    Tied(i32),
}

/// What stands at the rank. Interpolates as long as that helps (on a surface coordinates are nearly uniform), then halves.
#[inline(always)]
fn separator(column: &[i32], rank: usize) -> Option<Pivot> {
    let below = |t: i32| column.iter().map(|&v| u32::from(v < t)).sum::<u32>() as usize;
    let (min, max) = column.iter().fold((i32::MAX, i32::MIN), |(lo, hi), &v| (lo.min(v), hi.max(v)));
    // Invariant: at most `rank` values are below `lo`, more are below `hi`.
    let (mut lo, mut hi) = (min, max.checked_add(1)?);
    let (mut below_lo, mut below_hi) = (0, column.len());
    for step in 0.. {
        if below_lo == rank {
            let first = column.iter().fold(i32::MAX, |m, &v| if v >= lo { m.min(v) } else { m });
            return Some(Pivot::Value(first));
        }
        if hi.wrapping_sub(lo) == 1 {
            return Some(Pivot::Tied(lo));
        }
        let share = (rank as f32 + 0.5 - below_lo as f32) / (below_hi - below_lo) as f32;
        let (a, b) = (unordered(lo), unordered(hi));
        let guess = super::build::ordered(a + (b - a) * share);
        let t = if step < 8 { guess.clamp(lo + 1, hi - 1) } else { i32::midpoint(lo, hi) };
        let count = below(t);
        if count <= rank {
            (lo, below_lo) = (t, count);
        } else {
            (hi, below_hi) = (t, count);
        }
    }
    None
}

/// The place of the first photon in emission order that has this coordinate.
#[inline(always)]
fn first_of(keys: &[Key], column: &[i32], v: i32) -> usize {
    let mut first = (u32::MAX, 0);
    for (chunk, values) in column.chunks(64).enumerate() {
        if values.iter().fold(false, |any, &w| any | (w == v)) {
            for (i, _) in values.iter().enumerate().filter(|(_, w)| **w == v) {
                let at = 64 * chunk + i;
                first = first.min((keys[at].id, at));
            }
        }
    }
    first.1
}

#[cfg(test)]
mod tests {
    use super::super::build::ordered;
    use super::super::simd::{Level, Task};
    use super::*;

    struct Select<'a>(&'a mut [Key], usize, usize);
    impl Task for Select<'_> {
        type Output = ();
        fn run<S: Simd>(self, simd: S) {
            select(simd, self.0, self.1, self.2, &mut Scratch::default());
        }
    }

    /// Few values, one very frequent value, all different ones, or values that the floats crowd at.
    fn value(kind: usize, i: u64) -> f32 {
        let h = mix64(i) >> 40;
        let v = h as f32 / (1 << 23) as f32 - 1.0;
        match kind {
            0 => (8.0 * v).floor(),
            1 => {
                if h % 5 < 3 {
                    -0.0
                } else {
                    v
                }
            }
            2 => v,
            _ => v.powi(9) * 1e9,
        }
    }

    #[test]
    fn the_key_of_every_rank_is_found() {
        for level in Level::available() {
            for n in (1..90).chain([500, 1023, 1024, 1025, 5000, COUNTED + 1, 3 * COUNTED]) {
                for kind in 0..4 {
                    let axis = (n + kind) % 3;
                    let key = |i: usize| Key {
                        p: std::array::from_fn(|a| ordered(value(kind, (3 * i + a) as u64))),
                        // Emission indices above 2^31 as well.
                        id: (i as u32).wrapping_mul(0x9e37_79b1),
                    };
                    let keys: Vec<Key> = (0..n).map(key).collect();
                    let mut sorted = keys.clone();
                    sorted.sort_unstable_by_key(|key| key.order(axis));
                    for rank in [0, n / 3, n / 2, n - 1] {
                        let mut parted = keys.clone();
                        level.run(Select(&mut parted, axis, rank));
                        let order = |key: &Key| key.order(axis);
                        assert_eq!(order(&parted[rank]), order(&sorted[rank]), "{level:?}, {n} keys, rank {rank}");
                        parted[..rank].sort_unstable_by_key(order);
                        parted[rank..].sort_unstable_by_key(order);
                        assert!(bytemuck::cast_slice::<_, u32>(&parted) == bytemuck::cast_slice::<_, u32>(&sorted));
                    }
                }
            }
        }
    }
}
