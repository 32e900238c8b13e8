//! A photon on its way from surface to surface.

use super::launch::Departure;
use crate::color::Rgb;
use crate::geometry::Ray;
use crate::math::Vec3;
use crate::photon::PhotonClass;
use crate::sample::{Key, Purpose, Sampler, hash_u64};
use crate::scene::Scene;

/// Photons under way at a time in [`Deposit::trace_all`](super::Deposit::trace_all).
pub(super) const WAVE: usize = 128;

/// A photon under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flight<N = Sampler> {
    pub ray: Ray,
    pub flux: Rgb,
    pub sampler: N,
    /// Its path: the number within the batch, and the key of its random bits.
    pub number: u32,
    pub path: Key,
    /// The shape met first.
    pub first: u32,
    /// Surfaces met.
    pub depth: u32,
    /// Whether all of them were specular.
    pub specular_chain: bool,
    /// Whether one was diffuse or glossy.
    pub scattered: bool,
    /// Whether the last of those scattered it by a narrow lobe, where indirect photons are wanted.
    pub narrow: bool,
}

/// What a stored photon tells about its path.
pub(super) struct Stamp {
    pub class: PhotonClass,
    pub mark: bool,
}

/// Random bits to round the power of a photon of `path` with, at its surface `depth`.
#[inline(always)]
pub(super) fn rounding_bits(path: Key, depth: u32) -> u64 {
    hash_u64(hash_u64(path.0, depth as u64), Purpose::Quantize as u64)
}

impl<N> Flight<N> {
    /// Not under way.
    pub fn none(sampler: N, key: Key) -> Self {
        Self {
            ray: Ray::new(Vec3::ZERO, Vec3::Z),
            flux: Rgb::BLACK,
            sampler,
            number: 0,
            path: key,
            first: u32::MAX,
            depth: 0,
            specular_chain: true,
            scattered: false,
            narrow: false,
        }
    }

    /// Puts a path on its way, all but its numbers.
    #[inline(always)]
    pub fn depart(&mut self, scene: &Scene, &Departure { path, o, d, flux, .. }: &Departure, number: u32) {
        self.ray = scene.from_light(Ray::new(o, d));
        self.flux = flux;
        (self.number, self.path, self.first, self.depth) = (number, path, u32::MAX, 0);
        (self.specular_chain, self.scattered, self.narrow) = (true, false, false);
    }

    /// Counts a surface.
    #[inline(always)]
    pub fn meet(&mut self, shape: u32) {
        if self.depth == 0 {
            self.first = shape;
        }
        self.depth += 1;
    }

    #[inline(always)]
    pub fn stamp(&self) -> Stamp {
        Stamp {
            class: if self.specular_chain && self.depth > 1 { PhotonClass::Caustic } else { PhotonClass::Global },
            mark: !self.scattered || self.narrow,
        }
    }
}
