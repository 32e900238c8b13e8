//! Small cells of the surfaces, named by where they are and which way they face, and a hash table of them.

use crate::math::Vec3;
use crate::sample::mix64;

/// Binary logarithms of the smallest and the largest cell, in scene units: keys have 18 bits for each coordinate.
pub(super) const LEVELS: (i32, i32) = (-16, 4);

/// The largest level whose cells are not wider than `side`.
pub(super) fn level_below(side: f32) -> i32 {
    (side.max(f32::MIN_POSITIVE).log2().floor() as i32).clamp(LEVELS.0, LEVELS.1)
}

/// 2^level for the levels of cells and their negatives.
#[inline]
pub(super) fn exp2(level: i32) -> f32 {
    f32::from_bits(((127 + level) as u32) << 23)
}

/// Which of six directions a side of a surface faces.
#[inline]
pub(super) fn facing(normal: Vec3, front: bool) -> u32 {
    let a = normal.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    2 * axis + u32::from((normal[axis as usize] > 0.0) == front)
}

/// The name of the cell at `p`, never 0: level, coordinates and direction, each in its own bits.
#[inline]
pub(super) fn key(p: Vec3, level: i32, facing: u32) -> u64 {
    let cell = p * exp2(-level);
    // Round down without a call into the C library; what is out of range wraps.
    let bits = |x: f32| ((x as i32).wrapping_sub(i32::from(x < x as i32 as f32)) as u64) & 0x3_ffff;
    1 << 63
        | ((level - LEVELS.0) as u64) << 57
        | (facing as u64) << 54
        | bits(cell.x) << 36
        | bits(cell.y) << 18
        | bits(cell.z)
}

/// What a [`Table`] holds.
pub(super) trait Entry: Copy + Default {
    /// 0 for free places only.
    fn key(&self) -> u64;
}

impl Entry for (u64, i32) {
    #[inline]
    fn key(&self) -> u64 {
        self.0
    }
}

/// A hash table with linear probing, filled once, at most half full.
#[derive(Default)]
pub(super) struct Table<E> {
    places: Vec<E>,
}

impl<E: Entry> Table<E> {
    /// Entries with different keys.
    pub(super) fn new(entries: Vec<E>) -> Self {
        let mut places = vec![E::default(); (2 * entries.len()).next_power_of_two()];
        let mask = places.len() - 1;
        for entry in &entries {
            let mut at = mix64(entry.key()) as usize & mask;
            while places[at].key() != 0 {
                at = (at + 1) & mask;
            }
            places[at] = *entry;
        }
        Self { places }
    }

    #[inline]
    pub(super) fn find(&self, key: u64) -> Option<&E> {
        let mask = self.places.len().checked_sub(1)?;
        let mut at = mix64(key) as usize & mask;
        loop {
            let entry = &self.places[at];
            if entry.key() == key {
                return Some(entry);
            }
            if entry.key() == 0 {
                return None;
            }
            at = (at + 1) & mask;
        }
    }

    pub(super) fn memory(&self) -> usize {
        self.places.capacity() * size_of::<E>()
    }
}
