//! Where the photon of a heap slot is kept.
//!
//! Slots have the heap's order, places have the memory's. The bottom subtrees of five or six levels are *buckets*: each is
//! one block of 32 or 64 places, lane `t` of a block being node `t` of the bucket's own little heap. Lane 0 is free in a
//! heap that counts from 1, so block `p` keeps the upper node of slot `p` there, and the places from 1 to n are all used.
//! Blocks of full buckets come first, then those without a last level, then the one whose last level is cut short. All of
//! it is arithmetic on the slot and n; the heap stays Jensen's.

use super::heap;

/// Levels of a full bucket.
const BUCKET_LEVELS: u32 = 6;
/// Places of a full bucket's block.
pub(crate) const BLOCK: usize = 1 << BUCKET_LEVELS;

/// The map from slots to places for one number of photons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    pub n: usize,
    /// Number of buckets, a power of two; also the slot of the first bucket's root.
    pub buckets: usize,
    /// Buckets that have all six levels.
    full: usize,
    /// Whether bucket `full` has a part of its last level.
    cut: bool,
}

impl Layout {
    pub fn new(n: usize) -> Self {
        let height = if n == 0 { 0 } else { heap::level(n) };
        if height + 1 < BUCKET_LEVELS {
            return Self { n, buckets: 1, full: 0, cut: true };
        }
        let last = n + 1 - (1 << height);
        let half = BLOCK / 2;
        Self { n, buckets: 1 << (height + 1 - BUCKET_LEVELS), full: last / half, cut: !last.is_multiple_of(half) }
    }

    /// First place of a block.
    #[inline(always)]
    fn start(&self, block: usize) -> usize {
        BLOCK / 2 * (block + block.min(self.full))
    }

    /// Places of a block, 32 or 64; those after place n are padding.
    #[inline(always)]
    fn lanes(&self, block: usize) -> usize {
        if block < self.full || (self.cut && block + 1 == self.buckets) { BLOCK } else { BLOCK / 2 }
    }

    /// First place and number of places of a block.
    #[inline(always)]
    pub fn block(&self, block: usize) -> (usize, usize) {
        (self.start(block), self.lanes(block))
    }

    /// The block of a bucket.
    #[inline(always)]
    pub fn block_of_bucket(&self, bucket: usize) -> usize {
        if bucket < self.full || !self.cut {
            bucket
        } else if bucket == self.full {
            self.buckets - 1
        } else {
            bucket - 1
        }
    }

    /// The inverse of [`Layout::block_of_bucket`].
    pub fn bucket_of_block(&self, block: usize) -> usize {
        if block < self.full || !self.cut {
            block
        } else if block + 1 == self.buckets {
            self.full
        } else {
            block + 1
        }
    }

    /// The place of a slot.
    #[inline]
    pub fn place(&self, slot: usize) -> usize {
        if slot < self.buckets {
            return self.start(slot);
        }
        let depth = heap::level(slot) - heap::level(self.buckets);
        let bucket = (slot >> depth) - self.buckets;
        self.start(self.block_of_bucket(bucket)) + (1 << depth | slot & ((1 << depth) - 1))
    }

    /// The block and lane of a place.
    #[inline]
    pub fn block_and_lane(&self, place: usize) -> (usize, usize) {
        let long = BLOCK * self.full;
        let block = if place < long {
            place / BLOCK
        } else {
            // A cut block is longer than its neighbours but the last.
            (self.full + (place - long) / (BLOCK / 2)).min(self.buckets - 1)
        };
        (block, place - self.start(block))
    }

    /// The slot of lane `lane` of a block, for places from 1 to n.
    #[inline]
    pub fn slot(&self, block: usize, lane: usize) -> usize {
        if lane == 0 {
            return block;
        }
        let depth = heap::level(lane);
        (self.buckets + self.bucket_of_block(block)) << depth | lane & ((1 << depth) - 1)
    }

    /// Number of places with padding, those of all blocks.
    pub fn places(&self) -> usize {
        let (start, lanes) = self.block(self.buckets - 1);
        start + lanes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_and_places_are_one_to_one() {
        for n in (0..700).chain([1023, 1024, 1025, 2047, 4096, 5000]) {
            let layout = Layout::new(n);
            let mut seen = vec![false; n + 1];
            for slot in 1..=n {
                let place = layout.place(slot);
                assert!((1..=n).contains(&place) && !seen[place], "slot {slot} of {n} at {place}");
                seen[place] = true;
                let (block, lane) = layout.block_and_lane(place);
                assert_eq!(layout.slot(block, lane), slot, "place {place} of {n}");
                let (start, lanes) = layout.block(block);
                assert!(start + lane == place && lane < lanes);
            }
            assert!(layout.places() <= n + BLOCK);
        }
    }
}
