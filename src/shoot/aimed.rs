use std::ops::AddAssign;

use serde::Serialize;

use crate::scene::PhotonAims;

/// What became of `photon_share` and `photon_target`: counts for the lights and shapes of which the scene file says
/// something.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct AimCounts {
    /// Photon paths that started at each of [`PhotonAims::shares`]; may be shorter.
    pub paths: Vec<u64>,
    /// Stored photons whose path met each of [`PhotonAims::targets`] first; may be shorter.
    pub photons: Vec<u64>,
}

impl AimCounts {
    /// Counts a path from a light.
    #[inline]
    pub(super) fn add_path(&mut self, aims: &PhotonAims, light: usize) {
        if let Some(i) = aims.share_of(light) {
            add(&mut self.paths, i, 1);
        }
    }

    /// Counts a stored photon whose path met the shape `first` first; the importance of that shape.
    #[inline]
    pub(super) fn add_photon(&mut self, aims: &PhotonAims, first: u32) -> f32 {
        let Some(i) = aims.target_of(first) else { return 1.0 };
        add(&mut self.photons, i, 1);
        aims.targets()[i].importance
    }
}

impl AddAssign<&AimCounts> for AimCounts {
    fn add_assign(&mut self, other: &AimCounts) {
        other.paths.iter().enumerate().for_each(|(i, &n)| add(&mut self.paths, i, n));
        other.photons.iter().enumerate().for_each(|(i, &n)| add(&mut self.photons, i, n));
    }
}

fn add(counts: &mut Vec<u64>, index: usize, count: u64) {
    if counts.len() <= index {
        counts.resize(index + 1, 0);
    }
    counts[index] += count;
}
