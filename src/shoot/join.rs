use std::collections::BTreeMap;

use super::{Deposit, Shot};

/// Photons that memory is asked for at once where few are there yet.
const FIRST: usize = 1 << 17;

/// A batch of paths, and the numbers of its photons in the order of the paths.
#[derive(Debug)]
pub(super) struct Batch {
    pub deposit: Deposit,
    pub order: Vec<u32>,
}

/// Joins batches in the order of their numbers while later ones are still traced: only a few are held apart from the whole,
/// and their memory serves again.
#[derive(Debug)]
pub(super) struct Join {
    shot: Shot,
    /// Batches in all, and the number of the next to join.
    batches: u64,
    next: u64,
    early: BTreeMap<u64, Batch>,
    spare: Vec<Batch>,
}

impl Join {
    pub fn new(batches: u64) -> Self {
        Self { shot: Shot::default(), batches, next: 0, early: BTreeMap::new(), spare: Vec::new() }
    }

    /// A batch that has been joined, to be filled again.
    pub fn spare(&mut self) -> Option<Batch> {
        self.spare.pop()
    }

    /// Takes the batch `number`.
    pub fn put(&mut self, number: u64, batch: Batch) {
        self.early.insert(number, batch);
        while let Some(mut batch) = self.early.remove(&self.next) {
            self.make_room(batch.order.len());
            let photons = std::mem::take(&mut batch.deposit.photons);
            self.shot.photons.extend(batch.order.iter().map(|&i| photons[i as usize]));
            self.shot += batch.deposit.take();
            batch.deposit.photons = photons;
            self.spare.push(batch);
            self.next += 1;
        }
    }

    /// Makes room for `photons` of the next batch: for as many as all that are to come will have by those so far, but for no
    /// more than are there already.
    fn make_room(&mut self, photons: usize) {
        let there = &mut self.shot.photons;
        if there.capacity() - there.len() < photons {
            let mean = (there.len() + photons) as f64 / (self.next + 1) as f64;
            let expected = (1.02 * mean * (self.batches - self.next) as f64) as usize;
            there.reserve_exact(expected.min(there.len().max(FIRST)).max(photons));
        }
    }

    /// All of them. What little was asked for in vain stays: the system would have to clear that memory anew the next time.
    pub fn finish(mut self) -> Shot {
        let photons = &mut self.shot.photons;
        if photons.capacity() - photons.len() > photons.len() / 32 {
            photons.shrink_to_fit();
        }
        self.shot
    }
}
