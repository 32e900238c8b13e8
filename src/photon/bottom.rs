//! The lowest levels of the balancing, one bucket at a time, straight into its block.
//!
//! The photons are sorted along every axis once; a node is then a set of bits in each of the three orders, its extents are
//! at the first and the last bit, and its lower half are its lowest bits.

use super::build::{Cold, Key, unordered, widest};
use super::heap;
use super::layout::BLOCK;
use super::map::Block;
use super::simd::{Simd, Task};

/// A bucket's photons, to be balanced into lanes 1 and up of its block.
pub(super) struct Bottom<'a, 'b> {
    pub keys: &'a [Key],
    pub cold: &'a [Cold],
    pub block: &'a mut Block<'b>,
}

impl Task for Bottom<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { keys, cold, block } = self;
        let mut small = Small::new();
        if !keys.is_empty() {
            // What is fetched by emission index arrives while the positions are sorted.
            let thirds = keys.len().div_ceil(3);
            let fetch = |third: usize| {
                for key in keys.iter().skip(third * thirds).take(thirds) {
                    simd.prefetch(&cold[key.id as usize]);
                }
            };
            fetch(0);
            small.sort::<0>(keys);
            fetch(1);
            small.sort::<1>(keys);
            fetch(2);
            small.sort::<2>(keys);
            small.node([u64::MAX >> (64 - keys.len()); 3], 1);
        }
        small.write(keys, cold, block);
    }
}

/// At most 63 photons and the nodes of their little heap.
struct Small {
    /// Along each axis: the coordinates in order, which photon has which rank, and which rank has which photon.
    sorted: [[i32; BLOCK]; 3],
    label: [[u8; BLOCK]; 3],
    rank: [[u8; BLOCK]; 3],
    /// The result by lane.
    photon: [u8; BLOCK],
    axis: [u8; BLOCK],
}

impl Small {
    #[inline(always)]
    fn new() -> Self {
        let none = [[0; BLOCK]; 3];
        Self { sorted: [[0; BLOCK]; 3], label: none, rank: none, photon: [0; BLOCK], axis: [0; BLOCK] }
    }

    /// Sorts along one axis, ties by emission index.
    #[inline(always)]
    fn sort<const AXIS: usize>(&mut self, keys: &[Key]) {
        let mut values = [i32::MAX; BLOCK];
        for (value, key) in values.iter_mut().zip(keys) {
            *value = key.p[AXIS];
        }
        if values[..keys.len()].iter().all(|v| *v == values[0]) {
            // All on one plane, as on a wall: by emission index alone.
            for (value, key) in values.iter_mut().zip(keys) {
                *value = (key.id ^ 1 << 31) as i32;
            }
        }
        let ranks = ranks(&values);
        let taken = ranks[..keys.len()].iter().fold(0u64, |set, r| set | 1 << (r % 64));
        if taken.count_ones() as usize == keys.len() {
            for (label, (&rank, key)) in ranks.iter().zip(keys).enumerate() {
                self.place::<AXIS>(rank as usize % BLOCK, label, key);
            }
        } else {
            self.sort_with_ties::<AXIS>(keys);
        }
    }

    /// [`Small::sort`] where coordinates repeat.
    #[inline(never)]
    fn sort_with_ties<const AXIS: usize>(&mut self, keys: &[Key]) {
        let mut labels: [u8; BLOCK] = std::array::from_fn(|i| i as u8);
        let labels = &mut labels[..keys.len()];
        labels.sort_unstable_by_key(|&label| keys[label as usize].order(AXIS));
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

    /// Balances the photons whose ranks along the axes are the bits of `sets`, at least one, under the node `lane`.
    fn node(&mut self, sets: [u64; 3], lane: usize) {
        let n = sets[0].count_ones() as usize;
        if n == 1 {
            self.photon[lane % BLOCK] = self.label[0][sets[0].trailing_zeros() as usize % BLOCK];
            return;
        }
        let axis = widest(std::array::from_fn(|a| {
            let (lo, hi) = (sets[a].trailing_zeros(), 63 - sets[a].leading_zeros());
            let at = |rank: u32| unordered(self.sorted[a][rank as usize % BLOCK]);
            at(hi) - at(lo)
        }));
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);

        // Collect the lower half in the orders of all axes.
        let mut rest = sets[axis];
        let mut left = [0; 3];
        for _ in 0..heap::left_size(n) {
            let label = self.label[axis][rest.trailing_zeros() as usize % BLOCK] as usize % BLOCK;
            left[b] |= 1 << (self.rank[b][label] % 64);
            left[c] |= 1 << (self.rank[c][label] % 64);
            rest &= rest - 1;
        }
        left[axis] = sets[axis] ^ rest;

        // Place the median, and balance what is left on both sides of it.
        let label = self.label[axis][rest.trailing_zeros() as usize % BLOCK];
        self.photon[lane % BLOCK] = label;
        self.axis[lane % BLOCK] = axis as u8;
        let right = std::array::from_fn(|a| sets[a] & !left[a] & !(1 << (self.rank[a][label as usize % BLOCK] % 64)));
        self.node(left, 2 * lane);
        if n > 2 {
            self.node(right, 2 * lane + 1);
        }
    }

    /// Writes the block, without its lane 0.
    #[inline(always)]
    fn write(&self, keys: &[Key], cold: &[Cold], block: &mut Block) {
        let mut p = [[unordered_infinity(); BLOCK]; 3];
        for lane in 1..=keys.len() {
            let key = &keys[self.photon[lane] as usize % BLOCK];
            for (stream, v) in p.iter_mut().zip(key.p) {
                stream[lane] = v;
            }
            let Cold { power, direction, flags } = cold[key.id as usize];
            block.set_rest(lane, power, direction, flags.with_axis(u16::from(self.axis[lane])));
        }
        for (to, from) in block.p.chunks_exact_mut(block.p.len() / 3).zip(&p) {
            for (to, &from) in to.iter_mut().zip(from) {
                *to = unordered(from);
            }
        }
    }
}

/// The number of an infinite coordinate.
const fn unordered_infinity() -> i32 {
    f32::INFINITY.to_bits() as i32
}

/// How many values are less than each. Every pair is compared: with vectors that is a fraction of a sort's time.
#[inline(always)]
fn ranks(values: &[i32; BLOCK]) -> [u32; BLOCK] {
    let mut ranks = [0; BLOCK];
    for v in values {
        for (rank, w) in ranks.iter_mut().zip(values) {
            *rank += u32::from(v < w);
        }
    }
    ranks
}
