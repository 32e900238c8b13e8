//! What a scene file says about its photons: the share of them that a light emits, and the objects that they are aimed at.

use serde::Serialize;

use crate::light::LightSelector;

/// Marks lights and shapes of which the scene file says nothing.
const NONE: u32 = u32::MAX;

/// A light whose share of the photons the scene file fixes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhotonShare {
    /// Index into the lights of the scene.
    pub light: u32,
    /// Share of the emitted photon paths, between 0 and 1.
    pub share: f64,
    /// What it is, and its line in the scene file.
    pub label: String,
}

/// A shape at which more or fewer caustic photons are aimed than at others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhotonTarget {
    /// Index into the shapes of the scene.
    pub shape: u32,
    /// Its importance beside that of other shapes, which is 1; 0 for no aiming.
    pub importance: f32,
    /// What it is, and its line in the scene file.
    pub label: String,
}

/// `photon_share` of the lights and `photon_target` of the shapes of a scene.
///
/// Both change where photons start and not what they carry on average: every path's power is divided by the probability of
/// its start. Only a light with the share 0 loses light.
#[derive(Clone, Debug, Default)]
pub struct PhotonAims {
    shares: Vec<PhotonShare>,
    targets: Vec<PhotonTarget>,
    /// The index of each light in `shares`, or [`NONE`]; empty without shares.
    share_of: Vec<u32>,
    /// The index of each shape in `targets`, or [`NONE`]; empty without targets.
    target_of: Vec<u32>,
}

impl PhotonAims {
    /// For a scene of so many lights and shapes.
    pub(super) fn new(lights: usize, shapes: usize, shares: Vec<PhotonShare>, targets: Vec<PhotonTarget>) -> Self {
        let index = |all: usize, items: Vec<u32>| {
            let mut of = vec![NONE; if items.is_empty() { 0 } else { all }];
            items.into_iter().enumerate().for_each(|(i, item)| of[item as usize] = i as u32);
            of
        };
        let share_of = index(lights, shares.iter().map(|s| s.light).collect());
        let target_of = index(shapes, targets.iter().map(|t| t.shape).collect());
        Self { shares, targets, share_of, target_of }
    }

    /// The lights whose share is fixed, in the order of the lights.
    pub fn shares(&self) -> &[PhotonShare] {
        &self.shares
    }

    /// The shapes whose importance is given, in the order of the shapes.
    pub fn targets(&self) -> &[PhotonTarget] {
        &self.targets
    }

    /// The index of a light in [`PhotonAims::shares`].
    #[inline]
    pub fn share_of(&self, light: usize) -> Option<usize> {
        self.share_of.get(light).filter(|&&i| i != NONE).map(|&i| i as usize)
    }

    /// The index of a shape in [`PhotonAims::targets`].
    #[inline]
    pub fn target_of(&self, shape: u32) -> Option<usize> {
        self.target_of.get(shape as usize).filter(|&&i| i != NONE).map(|&i| i as usize)
    }

    /// How much it matters that photons meet a shape first.
    #[inline]
    pub fn importance(&self, shape: u32) -> f32 {
        self.target_of(shape).map_or(1.0, |i| self.targets[i].importance)
    }

    /// Gives the lights of fixed shares these shares of the whole, and divides the rest among the others as their
    /// `weights` say. Where there are no others, the shares are relative to each other.
    pub fn divide(&self, mut weights: Vec<f64>) -> Vec<f64> {
        if self.shares.is_empty() {
            return weights;
        }
        let fixed: f64 = self.shares.iter().map(|s| s.share).sum();
        let others = |i: usize| self.share_of(i).is_none();
        let rest: f64 = weights.iter().enumerate().filter(|(i, _)| others(*i)).map(|(_, w)| w).sum();
        let scale = if rest > 0.0 { (1.0 - fixed).max(0.0) / rest } else { 0.0 };
        for (i, w) in weights.iter_mut().enumerate() {
            *w = self.share_of(i).map_or(*w * scale, |s| self.shares[s].share);
        }
        weights
    }

    /// Picks the lights that emit photons, where `selector` picks those that light a point directly.
    pub(super) fn selector(&self, selector: &LightSelector) -> LightSelector {
        if self.shares.is_empty() {
            return selector.clone();
        }
        LightSelector::of(self.divide((0..selector.len()).map(|i| selector.pmf(i) as f64).collect()))
    }
}
