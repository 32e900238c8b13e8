//! The sums of a film as plain numbers, to be kept in a file and taken up again.

use super::tile::Sum;
use super::{Clamp, Film};

/// Everything that a film has summed up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FilmState {
    /// Weighted sums of red, green and blue, and the weight, of every pixel.
    pub samples: Vec<[f64; 4]>,
    /// Sums of splats of every pixel; empty without any.
    pub splats: Vec<[f64; 3]>,
    pub non_finite: u64,
    /// The bound on samples, and what it has taken away.
    pub clamp: Clamp,
}

impl Film {
    /// A copy of the sums.
    pub fn state(&self) -> FilmState {
        FilmState {
            samples: self.sums.iter().copied().map(Sum::to_array).collect(),
            splats: self.splats.clone(),
            non_finite: self.non_finite,
            clamp: self.clamp,
        }
    }

    /// Takes up sums in place of its own; false, and nothing done, when they are those of another number of pixels.
    pub fn set_state(&mut self, state: &FilmState) -> bool {
        let pixels = self.sums.len();
        if state.samples.len() != pixels || !(state.splats.is_empty() || state.splats.len() == pixels) {
            return false;
        }
        self.sums = state.samples.iter().map(|&s| Sum::from_array(s)).collect();
        self.splats = state.splats.clone();
        self.non_finite = state.non_finite;
        self.clamp = state.clamp;
        true
    }
}
