//! Irradiance looked up rather than estimated: computed beforehand at some of the photons [Christensen 1999].

use rayon::prelude::*;

use super::photons::Lookup;
use crate::color::{Rgb, rgbe};
use crate::math::Vec3;
use crate::photon::{Flags, KnnScratch, Photon, PhotonClass, PhotonMap};
use crate::sample::{Purpose, hash_u64};

/// Irradiance is computed at every photon whose index this divides.
const STRIDE: usize = 4;

/// Surfaces turned further than this from the precomputed one (25°) do not use it.
const MIN_NORMAL_COS: f32 = 0.9;

/// Precomputed irradiances, each a photon-sized record: W·m⁻² in place of the power, the radius in place of the direction.
pub(super) struct IrradianceMap {
    map: PhotonMap,
}

impl IrradianceMap {
    /// Estimates irradiance at every fourth photon of a map, in parallel.
    pub fn precompute(lookup: &Lookup) -> Self {
        let photons = &lookup.map;
        let points: Vec<Vec3> = (0..photons.len() as u32).step_by(STRIDE).map(|i| photons.position(i)).collect();
        let order = crate::photon::morton_order(&points, &photons.bounds());
        let records: Vec<Photon> = order
            .par_chunks(1024)
            .flat_map_iter(|chunk| {
                let mut scratch = KnnScratch::new();
                chunk.iter().filter_map(|&j| Self::record(lookup, j * STRIDE as u32, &mut scratch)).collect::<Vec<_>>()
            })
            .collect();
        Self { map: PhotonMap::build(records) }
    }

    /// The irradiance around one photon, on its side of its surface.
    fn record(lookup: &Lookup, index: u32, scratch: &mut KnnScratch) -> Option<Photon> {
        let photon = lookup.map.photon(index);
        let (p, flags) = (Vec3::from_array(photon.position), photon.flags);
        let (irradiance, radius_sq) = lookup.irradiance(p, flags.normal(), flags.side(), scratch)?;
        let bits = hash_u64(Purpose::Quantize as u64, index as u64);
        Some(Photon {
            power: rgbe::pack(irradiance, bits)?,
            direction: half::f16::from_f32(radius_sq.sqrt()).to_bits().to_le_bytes(),
            flags: Flags::new(flags.side(), PhotonClass::Irradiance, false, flags.normal()),
            ..photon
        })
    }

    /// Irradiance (W·m⁻²) at the nearest record on this side of a surface with normal `ng`, and the squared radius of the
    /// estimate behind it.
    pub fn lookup(
        &self,
        p: Vec3,
        ng: Vec3,
        front: bool,
        max_r_sq: f32,
        scratch: &mut KnnScratch,
    ) -> Option<(Rgb, f32)> {
        let found = self.map.nearest_where(p, 1, max_r_sq, scratch, |i| {
            let flags = self.map.flags(i);
            flags.side() == front && flags.normal().dot(ng) > MIN_NORMAL_COS
        });
        let (index, _) = found.iter().next()?;
        let radius = half::f16::from_bits(u16::from_le_bytes(self.map.photon(index).direction)).to_f32();
        Some((self.map.power(index), radius * radius))
    }

    pub fn memory(&self) -> usize {
        self.map.memory()
    }
}
