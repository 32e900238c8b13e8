//! Photons as they are stored.

use super::Arrivals;
use crate::photon::{Photon, PhotonClass, PhotonRecord};
use crate::sample::Key;
use crate::shoot::flight::{Flight, Stamp, WAVE, rounding_bits};

/// What is stored of photons.
#[derive(Debug)]
pub(super) struct Records {
    stamps: Stamps,
    packed: Packed,
}

/// What photons tell of their paths.
#[derive(Debug)]
struct Stamps {
    class: [PhotonClass; WAVE],
    mark: [bool; WAVE],
    path: [Key; WAVE],
    /// Random bits for packing.
    bits: [u64; WAVE],
}

/// Photons as they are stored, but for their places.
#[derive(Debug)]
struct Packed {
    power: [u32; WAVE],
    /// Direction and flags.
    tail: [u32; WAVE],
    /// 1 if it can be stored.
    fits: [u32; WAVE],
}

impl Records {
    pub fn new() -> Self {
        Self {
            stamps: Stamps {
                class: [PhotonClass::Global; WAVE],
                mark: [false; WAVE],
                path: [Key(0); WAVE],
                bits: [0; WAVE],
            },
            packed: Packed { power: [0; WAVE], tail: [0; WAVE], fits: [0; WAVE] },
        }
    }

    /// Takes what the photon in lane `i` tells of its path.
    #[inline(always)]
    pub fn set(&mut self, i: usize, flight: &Flight) {
        let (s, Stamp { class, mark }) = (&mut self.stamps, flight.stamp());
        (s.class[i], s.mark[i], s.path[i]) = (class, mark, flight.path);
    }

    /// Packs all of them.
    #[inline(always)]
    pub fn pack(&mut self, a: &Arrivals, lanes: usize) {
        self.stamps.draw(&a.depth, lanes);
        self.packed.pack(a, &self.stamps, lanes);
    }

    /// Photon `i`, packed, with its power in its largest channel; `None` if it cannot be stored.
    #[inline(always)]
    pub fn photon(&self, i: usize, a: &Arrivals) -> Option<(Photon, f32)> {
        let packed = &self.packed;
        let photon = Photon::from_words(a.p.get(i), [packed.power[i], packed.tail[i]]);
        (packed.fits[i] != 0).then(|| (photon, a.flux.color(i).max_channel()))
    }
}

impl Stamps {
    #[inline(always)]
    fn draw(&mut self, depth: &[u32; WAVE], lanes: usize) {
        assert!(lanes <= WAVE);
        for ((bits, path), depth) in self.bits[..lanes].iter_mut().zip(&self.path).zip(depth) {
            *bits = rounding_bits(*path, *depth);
        }
    }
}

impl Packed {
    #[inline(always)]
    fn pack(&mut self, a: &Arrivals, stamps: &Stamps, lanes: usize) {
        assert!(lanes <= WAVE);
        for i in 0..lanes {
            let (wi, normal) = (a.wo.get(i), a.ng.get(i));
            let record = PhotonRecord {
                p: a.p.get(i),
                power: a.flux.color(i),
                wi,
                normal,
                side: wi.dot(normal) > 0.0,
                class: stamps.class[i],
                mark: stamps.mark[i],
            };
            let (words, fits) = match Photon::pack_words(&record, stamps.bits[i]) {
                Ok(words) => (words, 1),
                Err(_) => ([0; 2], 0),
            };
            (self.power[i], self.tail[i], self.fits[i]) = (words[0], words[1], fits);
        }
    }
}
