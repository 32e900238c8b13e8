//! Balancing: photons in emission order become a left-balanced heap.
//!
//! The median is found by rank, recursively, along the widest extent of the node's own points. Ranks compare
//! `(coordinate, emission index)`, so that the tree does not depend on the number of threads, and a million photons at the
//! same place are as good as any others.

use super::heap;
use super::packed::Photon;
use rayon::prelude::*;

/// Subtrees of at least this many photons are balanced as two parallel halves.
const PARALLEL_FROM: usize = 1 << 14;

/// What the balancing moves: a position and the photon's place in emission order.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(crate) struct Key {
    pub p: [f32; 3],
    pub id: u32,
}

impl Key {
    /// Total order along an axis, ties by emission index, as one integer.
    #[inline]
    fn order<const AXIS: usize>(&self) -> u64 {
        let bits = self.p[AXIS].to_bits() as i32;
        // Negative floats count backwards: flip all their bits, and only the sign of the others.
        let ordered = (bits ^ (bits >> 31 | i32::MIN)) as u32;
        u64::from(ordered) << 32 | u64::from(self.id)
    }
}

/// Keys in the tree's left-to-right order, and the split axis of each.
pub(crate) fn balance(photons: &[Photon]) -> (Vec<Key>, Vec<u8>) {
    let mut keys: Vec<Key> = photons.par_iter().enumerate().map(|(i, p)| Key { p: p.position, id: i as u32 }).collect();
    let mut axes = vec![0; keys.len()];
    balance_range(&mut keys, &mut axes);
    (keys, axes)
}

fn balance_range(keys: &mut [Key], axes: &mut [u8]) {
    let n = keys.len();
    if n < 2 {
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
        rayon::join(|| balance_range(left, left_axes), || balance_range(right, right_axes));
    } else {
        balance_range(left, left_axes);
        balance_range(right, right_axes);
    }
}

/// The axis of the widest extent; the first of equal ones.
fn widest_axis(keys: &[Key]) -> usize {
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for key in keys {
        for a in 0..3 {
            lo[a] = if key.p[a] < lo[a] { key.p[a] } else { lo[a] };
            hi[a] = if key.p[a] > hi[a] { key.p[a] } else { hi[a] };
        }
    }
    let extent: [f32; 3] = std::array::from_fn(|a| hi[a] - lo[a]);
    let xy = usize::from(extent[1] > extent[0]);
    if extent[2] > extent[xy] { 2 } else { xy }
}
