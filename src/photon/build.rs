//! Balancing: photons in emission order become a left-balanced heap.
//!
//! The median is found by rank, recursively, along the widest extent of the node's own points. Ranks compare
//! `(coordinate, emission index)`, so that the tree does not depend on the number of threads, and a million photons at the
//! same place are as good as any others.

use super::heap;
use super::layout::BLOCK;
use super::packed::{Flags, Photon};
use super::simd::{Level, Simd, Task};
use crate::pages::Pages;
use rayon::prelude::*;

/// Subtrees of at least this many photons are balanced as two parallel halves.
const PARALLEL_FROM: usize = 1 << 14;

/// Subtrees of fewer photons are balanced as sets of bits.
const SMALL: usize = 64;

/// What the balancing moves: a position and the photon's place in emission order.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(16))]
pub(crate) struct Key {
    pub p: [f32; 3],
    pub id: u32,
}

impl Key {
    /// Total order along an axis, ties by emission index, as one integer.
    #[inline]
    fn order<const AXIS: usize>(&self) -> u64 {
        u64::from(ordered(self.p[AXIS])) << 32 | u64::from(self.id)
    }
}

/// A float's place in the total order of floats.
#[inline]
fn ordered(v: f32) -> u32 {
    let bits = v.to_bits() as i32;
    // Negative floats count backwards: flip all their bits, and only the sign of the others.
    (bits ^ (bits >> 31 | i32::MIN)) as u32
}

/// What the balancing does not move.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(8))]
pub(crate) struct Cold {
    pub power: [u8; 4],
    pub direction: [u8; 2],
    pub flags: Flags,
}

/// Keys in the tree's left-to-right order and the split axis of each, and what stays in emission order.
pub(crate) struct Balanced {
    keys: Pages<Key>,
    axes: Vec<u8>,
    cold: Vec<Cold>,
}

impl Balanced {
    /// Balances photons, and gives back their memory first.
    pub fn new(photons: Vec<Photon>) -> Self {
        let n = photons.len();
        let mut keys = Pages::<Key>::zeroed(n);
        keys.par_chunks_mut(PARALLEL_FROM).zip(photons.par_chunks(PARALLEL_FROM)).enumerate().for_each(
            |(chunk, (keys, photons))| {
                for (i, (key, photon)) in keys.iter_mut().zip(photons).enumerate() {
                    *key = Key { p: photon.position, id: (chunk * PARALLEL_FROM + i) as u32 };
                }
            },
        );
        let cold = |p: &Photon| Cold { power: p.power, direction: p.direction, flags: p.flags };
        let cold = photons.par_iter().with_min_len(PARALLEL_FROM).map(cold).collect();
        drop(photons);
        let mut axes = vec![0; n];
        balance_range(Level::best(), &mut keys, &mut axes);
        Self { keys, axes, cold }
    }

    /// The photons at these places from left to right. One waits for memory while the others do.
    pub fn gather(&self, places: &[usize], photons: &mut [Photon]) {
        let mut colds = [Cold { power: [0; 4], direction: [0; 2], flags: Flags(0) }; BLOCK];
        for (cold, &place) in colds.iter_mut().zip(places) {
            *cold = self.cold[self.keys[place].id as usize];
        }
        for ((photon, cold), &place) in photons.iter_mut().zip(&colds).zip(places) {
            let Cold { power, direction, flags } = *cold;
            let flags = flags.with_axis(u16::from(self.axes[place]));
            *photon = Photon { position: self.keys[place].p, power, direction, flags };
        }
    }
}

fn balance_range(level: Level, keys: &mut [Key], axes: &mut [u8]) {
    let n = keys.len();
    if n < SMALL {
        if n > 1 {
            level.run(Bottom { keys, axes });
        }
        return;
    }
    // Put the photon of the root's rank in its place, smaller ones to its left.
    let axis = widest_axis(keys);
    let middle = heap::left_size(n);
    match axis {
        0 => keys.select_nth_unstable_by_key(middle, Key::order::<0>),
        1 => keys.select_nth_unstable_by_key(middle, Key::order::<1>),
        _ => keys.select_nth_unstable_by_key(middle, Key::order::<2>),
    };
    axes[middle] = axis as u8;

    // Balance both sides.
    let (left, right) = keys.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    let (right, right_axes) = (&mut right[1..], &mut right_axes[1..]);
    if n >= PARALLEL_FROM {
        rayon::join(|| balance_range(level, left, left_axes), || balance_range(level, right, right_axes));
    } else {
        balance_range(level, left, left_axes);
        balance_range(level, right, right_axes);
    }
}

/// The axis of the widest extent; the first of equal ones.
fn widest_axis(keys: &[Key]) -> usize {
    // Four lanes, the index among them, make one vector of a key.
    let (mut lo, mut hi) = ([f32::INFINITY; 4], [f32::NEG_INFINITY; 4]);
    for key in keys {
        let v = [key.p[0], key.p[1], key.p[2], 0.0];
        for a in 0..4 {
            lo[a] = if v[a] < lo[a] { v[a] } else { lo[a] };
            hi[a] = if v[a] > hi[a] { v[a] } else { hi[a] };
        }
    }
    widest(std::array::from_fn(|a| hi[a] - lo[a]))
}

fn widest(extent: [f32; 3]) -> usize {
    let xy = usize::from(extent[1] > extent[0]);
    if extent[2] > extent[xy] { 2 } else { xy }
}

/// The last levels of the balancing. The photons are sorted along every axis once; a node is then a set of bits in each of
/// the three orders, its extents are at the first and the last bit, and its lower half are its lowest bits.
struct Small {
    /// Along each axis: the coordinates in order, which photon has which rank, and which rank has which photon.
    sorted: [[f32; SMALL]; 3],
    label: [[u8; SMALL]; 3],
    rank: [[u8; SMALL]; 3],
    /// The result, from left to right.
    order: [u8; SMALL],
    axes: [u8; SMALL],
}

/// The bottom of the tree under a few photons, at least two.
struct Bottom<'a> {
    keys: &'a mut [Key],
    axes: &'a mut [u8],
}

impl Task for Bottom<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { keys, axes } = self;
        let n = keys.len();
        let none = [[0; SMALL]; 3];
        let mut small =
            Small { sorted: [[0.0; SMALL]; 3], label: none, rank: none, order: [0; SMALL], axes: [0; SMALL] };
        small.sort::<0>(keys);
        small.sort::<1>(keys);
        small.sort::<2>(keys);
        small.node([(1 << n) - 1; 3], 0);

        let mut copy = [Key { p: [0.0; 3], id: 0 }; SMALL];
        copy[..n].copy_from_slice(keys);
        for (key, &label) in keys.iter_mut().zip(&small.order) {
            *key = copy[label as usize % SMALL];
        }
        axes.copy_from_slice(&small.axes[..n]);
    }
}

impl Small {
    /// Sorts along one axis, ties by emission index.
    #[inline(always)]
    fn sort<const AXIS: usize>(&mut self, keys: &[Key]) {
        let mut values = [u32::MAX; SMALL];
        for (value, key) in values.iter_mut().zip(keys) {
            *value = ordered(key.p[AXIS]);
        }
        if values[..keys.len()].iter().all(|v| *v == values[0]) {
            // All on one plane, as on a wall: by emission index alone.
            for (value, key) in values.iter_mut().zip(keys) {
                *value = key.id;
            }
        }
        let ranks = ranks(&values);
        let taken = ranks[..keys.len()].iter().fold(0u64, |set, r| set | 1 << (r % 64));
        if taken.count_ones() as usize == keys.len() {
            for (label, (&rank, key)) in ranks.iter().zip(keys).enumerate() {
                self.place::<AXIS>(rank as usize % SMALL, label, key);
            }
        } else {
            self.sort_with_ties::<AXIS>(keys);
        }
    }

    /// [`Small::sort`] where coordinates repeat.
    #[inline(never)]
    fn sort_with_ties<const AXIS: usize>(&mut self, keys: &[Key]) {
        let mut labels: [u8; SMALL] = std::array::from_fn(|i| i as u8);
        let labels = &mut labels[..keys.len()];
        labels.sort_unstable_by_key(|&label| keys[label as usize].order::<AXIS>());
        for (rank, &label) in labels.iter().enumerate() {
            self.place::<AXIS>(rank, label as usize, &keys[label as usize]);
        }
    }

    /// The photon `label` has this rank along the axis.
    #[inline(always)]
    fn place<const AXIS: usize>(&mut self, rank: usize, label: usize, key: &Key) {
        self.sorted[AXIS][rank] = key.p[AXIS];
        self.label[AXIS][rank] = label as u8;
        self.rank[AXIS][label] = rank as u8;
    }

    /// Balances the photons whose ranks along the axes are the bits of `sets`, at least one, from the place `first` on.
    fn node(&mut self, sets: [u64; 3], first: usize) {
        let n = sets[0].count_ones() as usize;
        if n == 1 {
            self.order[first] = self.label[0][sets[0].trailing_zeros() as usize % SMALL];
            return;
        }
        // The axis of the widest extent.
        let axis = widest(std::array::from_fn(|a| {
            let (lo, hi) = (sets[a].trailing_zeros(), 63 - sets[a].leading_zeros());
            self.sorted[a][hi as usize % SMALL] - self.sorted[a][lo as usize % SMALL]
        }));
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);

        // Collect the lower half in the orders of all axes.
        let middle = heap::left_size(n);
        let mut rest = sets[axis];
        let mut left = [0; 3];
        for _ in 0..middle {
            let label = self.label[axis][rest.trailing_zeros() as usize % SMALL] as usize % SMALL;
            left[b] |= 1 << (self.rank[b][label] % 64);
            left[c] |= 1 << (self.rank[c][label] % 64);
            rest &= rest - 1;
        }
        left[axis] = sets[axis] ^ rest;

        // Place the median, and balance what is left on both sides of it.
        let label = self.label[axis][rest.trailing_zeros() as usize % SMALL];
        self.order[first + middle] = label;
        self.axes[first + middle] = axis as u8;
        let right = std::array::from_fn(|a| sets[a] & !left[a] & !(1 << (self.rank[a][label as usize % SMALL] % 64)));
        self.node(left, first);
        if n > 2 {
            self.node(right, first + middle + 1);
        }
    }
}

/// How many values are less than each. Every pair is compared: with vectors that is a fraction of a sort's time.
#[inline(always)]
fn ranks(values: &[u32; SMALL]) -> [u32; SMALL] {
    let mut ranks = [0; SMALL];
    for v in values {
        for (rank, w) in ranks.iter_mut().zip(values) {
            *rank += u32::from(v < w);
        }
    }
    ranks
}
