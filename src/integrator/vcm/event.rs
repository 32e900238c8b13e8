//! Scattering at a vertex between two given directions.

use super::Recipe;
use super::step::other_side;
use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::Vec3;

/// What a vertex makes of a pair of directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Event {
    /// `f |cos|` towards `wi`, per steradian.
    pub f: Rgb,
    pub pdf: Pdf,
}

/// Densities per steradian of the pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pdf {
    /// Of going on to `wi`.
    pub fwd: f64,
    /// Of the way back.
    pub rev: f64,
}

impl Event {
    /// The vertex `si`, reached from `si.wo`, with the direction `wi`; `None` where nothing is scattered there.
    #[inline(always)]
    pub fn new(recipe: &Recipe, si: &SurfaceInteraction, bsdf: &Bsdf, wi: Vec3, mode: Mode) -> Option<Self> {
        let (f, fwd, mut rev) = bsdf.eval_with_pdfs(si.wo, wi, mode);
        if f.is_black() {
            return None;
        }
        // Diffuse surfaces scatter to one side alone.
        if !matches!(bsdf, Bsdf::Diffuse(_))
            && recipe.two_faced(si)
            && (si.ng.dot(si.wo) > 0.0) != (si.ng.dot(wi) > 0.0)
        {
            rev = other_side(recipe, si, wi).pdf(wi, si.wo, Mode::Radiance, LobeMask::ALL);
        }
        Some(Self { f, pdf: Pdf { fwd: fwd as f64, rev: rev as f64 } })
    }
}
