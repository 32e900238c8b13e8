//! The vector loops of the balancing: counting, and the stable partition of photons kept as columns.
//!
//! Coordinates are whole numbers here, in the floats' total order ([`ordered`]), so that every comparison is one of integers.

use super::simd::Portable;
use std::ops::Range;

/// A float's place in the total order of floats.
#[inline(always)]
pub(crate) fn ordered(v: f32) -> i32 {
    let bits = v.to_bits() as i32;
    // Negative floats count backwards: flip all their bits but the sign.
    bits ^ ((bits >> 31) & i32::MAX)
}

/// The inverse of [`ordered`].
#[inline(always)]
pub(crate) fn unordered(v: i32) -> f32 {
    f32::from_bits((v ^ ((v >> 31) & i32::MAX)) as u32)
}

/// The box around photons, in ordered coordinates; of none at first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Extent {
    pub lo: [i32; 3],
    pub hi: [i32; 3],
}

impl Extent {
    pub const EMPTY: Self = Self { lo: [i32::MAX; 3], hi: [i32::MIN; 3] };

    pub fn union(self, other: Self) -> Self {
        Self {
            lo: std::array::from_fn(|a| self.lo[a].min(other.lo[a])),
            hi: std::array::from_fn(|a| self.hi[a].max(other.hi[a])),
        }
    }

    /// The axis of the widest extent; the first of equal ones.
    #[inline(always)]
    pub fn widest(&self) -> usize {
        widest(std::array::from_fn(|a| unordered(self.hi[a]) - unordered(self.lo[a])))
    }
}

/// The axis of the largest extent; the first of equal ones.
#[inline(always)]
pub(crate) fn widest(extent: [f32; 3]) -> usize {
    let xy = usize::from(extent[1] > extent[0]);
    if extent[2] > extent[xy] { 2 } else { xy }
}

/// Photons as columns of one length, in emission order.
#[derive(Clone, Copy)]
pub(crate) struct Columns<'a> {
    pub xyz: [&'a [i32]; 3],
    pub power: &'a [[u8; 4]],
    /// Direction and flags.
    pub rest: &'a [[u8; 4]],
}

/// Columns to write to.
pub(crate) struct ColumnsMut<'a> {
    pub xyz: [&'a mut [i32]; 3],
    pub power: &'a mut [[u8; 4]],
    pub rest: &'a mut [[u8; 4]],
}

impl<'a> Columns<'a> {
    pub fn slice(&self, range: Range<usize>) -> Columns<'a> {
        Columns { xyz: self.xyz.map(|c| &c[range.clone()]), power: &self.power[range.clone()], rest: &self.rest[range] }
    }

    pub fn len(&self) -> usize {
        self.power.len()
    }

    /// True when all columns have one length.
    pub fn even(&self) -> bool {
        self.xyz.iter().all(|c| c.len() == self.len()) && self.rest.len() == self.len()
    }
}

impl<'a> ColumnsMut<'a> {
    /// The first photons, and those after them.
    pub fn split(self, at: usize) -> (ColumnsMut<'a>, ColumnsMut<'a>) {
        let [(x, x1), (y, y1), (z, z1)] = self.xyz.map(|c| c.split_at_mut(at));
        let (power, power1) = self.power.split_at_mut(at);
        let (rest, rest1) = self.rest.split_at_mut(at);
        (ColumnsMut { xyz: [x, y, z], power, rest }, ColumnsMut { xyz: [x1, y1, z1], power: power1, rest: rest1 })
    }

    pub fn as_ref(&self) -> Columns<'_> {
        Columns { xyz: self.xyz.each_ref().map(|c| &**c), power: self.power, rest: self.rest }
    }
}

/// Where the photons at a pivot go: the one of number `median` among them, in order, goes to neither side, those before it
/// to the left.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pivot {
    pub axis: usize,
    pub at: i32,
    pub median: isize,
}

/// What a partition has found: the boxes of both sides and the median's place in what was divided.
pub(crate) struct Sides {
    pub left: Extent,
    pub right: Extent,
    pub median: Option<usize>,
}

/// The loops of the balancing. All forms give the same.
pub(crate) trait Partition: Copy {
    /// Number of values below `t`.
    fn count_less(self, values: &[i32], t: i32) -> usize;

    /// The largest value below `t`; the smallest number without any.
    #[inline(always)]
    fn largest_below(self, values: &[i32], t: i32) -> i32 {
        values.iter().fold(i32::MIN, |m, &v| if v < t { m.max(v) } else { m })
    }

    /// The smallest value from `t` on; the largest number without any.
    #[inline(always)]
    fn smallest_from(self, values: &[i32], t: i32) -> i32 {
        values.iter().fold(i32::MAX, |m, &v| if v >= t { m.min(v) } else { m })
    }

    /// Copies the values from `lo` up to `hi` to the front of `out`, which is at least 16 longer than `values`; returns how
    /// many are below and how many were copied.
    #[inline(always)]
    fn collect(self, values: &[i32], lo: i32, hi: i32, out: &mut [i32]) -> (usize, usize) {
        let (mut below, mut inside) = (0, 0);
        for &v in values {
            out[inside] = v;
            inside += usize::from(v >= lo && v <= hi);
            below += usize::from(v < lo);
        }
        (below, inside)
    }

    /// The box around photons.
    #[inline(always)]
    fn extent(self, photons: &Columns) -> Extent {
        let mut extent = Extent::EMPTY;
        for a in 0..3 {
            extent.lo[a] = photons.xyz[a].iter().fold(i32::MAX, |m, &v| m.min(v));
            extent.hi[a] = photons.xyz[a].iter().fold(i32::MIN, |m, &v| m.max(v));
        }
        extent
    }

    /// Moves photons to the left or the right of a pivot, in order. Both sides are exactly as long as they must be.
    #[inline(always)]
    fn partition(self, from: &Columns, pivot: Pivot, left: &mut ColumnsMut, right: &mut ColumnsMut) -> Sides {
        let (mut l, mut r, mut seen, mut median) = (0, 0, 0, None);
        for (chunk, keys) in from.xyz[pivot.axis].chunks(64).enumerate() {
            // Which of the chunk go where.
            let (mut to_left, mut to_right) = ([0u8; 65], [0u8; 65]);
            let (mut nl, mut nr) = (0usize, 0usize);
            for (i, &key) in keys.iter().enumerate() {
                let tie = key == pivot.at;
                let first = usize::from(key < pivot.at || tie && seen < pivot.median);
                let middle = usize::from(tie && seen == pivot.median);
                to_left[nl & 63] = i as u8;
                to_right[nr & 63] = i as u8;
                nl += first;
                nr += 1 - first - middle;
                seen += isize::from(tie);
                if middle == 1 {
                    median = Some(64 * chunk + i);
                }
            }
            let at = 64 * chunk..64 * chunk + keys.len();
            let (to_left, to_right) = (&to_left[..nl], &to_right[..nr]);
            for a in 0..3 {
                pick(&from.xyz[a][at.clone()], to_left, &mut left.xyz[a][l..l + nl]);
                pick(&from.xyz[a][at.clone()], to_right, &mut right.xyz[a][r..r + nr]);
            }
            pick(&from.power[at.clone()], to_left, &mut left.power[l..l + nl]);
            pick(&from.power[at.clone()], to_right, &mut right.power[r..r + nr]);
            pick(&from.rest[at.clone()], to_left, &mut left.rest[l..l + nl]);
            pick(&from.rest[at], to_right, &mut right.rest[r..r + nr]);
            (l, r) = (l + nl, r + nr);
        }
        assert!(l == left.power.len() && r == right.power.len());
        Sides { left: self.extent(&left.as_ref()), right: self.extent(&right.as_ref()), median }
    }
}

/// Copies the chosen ones.
#[inline(always)]
fn pick<T: Copy>(from: &[T], chosen: &[u8], to: &mut [T]) {
    for (to, &i) in to.iter_mut().zip(chosen) {
        *to = from[i as usize];
    }
}

impl Partition for Portable {
    #[inline(always)]
    fn count_less(self, values: &[i32], t: i32) -> usize {
        values.iter().map(|&v| u32::from(v < t)).sum::<u32>() as usize
    }
}
