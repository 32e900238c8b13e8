//! What walks from the camera and from lights have in common.

use super::Recipe;
use super::correlation::Trails;
use super::weights::Mis;
use crate::bsdf::{Bsdf, BsdfSample, LobeMask, Mode};
use crate::geometry::SurfaceInteraction;
use crate::math::Vec3;

/// A vertex of a camera path.
pub(super) struct CameraVertex<'a> {
    pub si: &'a SurfaceInteraction,
    pub bsdf: &'a Bsdf,
    pub mis: &'a Mis,
    pub depth: u32,
    /// `eta` when the vertex can be merged with light from a vertex that focuses.
    pub merge: f64,
    /// Where weights are aware of correlation.
    pub trails: Option<Trails<'a>>,
}

/// How a walk left a vertex.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Scattered {
    /// Densities per steradian of the direction taken and of the way back. Of a discrete choice the first is taken for 1.
    pub fwd: f64,
    pub rev: f64,
    pub delta: bool,
}

/// |cosine| to the geometric normal: densities per area count on the surface itself, not on what shading makes of it.
#[inline]
pub(super) fn cosine(si: &SurfaceInteraction, w: Vec3) -> f64 {
    si.ng.dot(w).abs() as f64
}

/// The bsdf as seen from `w`, where that may differ from what it is as seen from `si.wo`.
#[inline(always)]
fn seen_from<R>(recipe: &Recipe, si: &SurfaceInteraction, bsdf: &Bsdf, w: Vec3, f: impl FnOnce(&Bsdf) -> R) -> R {
    if recipe.two_faced(si) && (si.ng.dot(si.wo) > 0.0) != (si.ng.dot(w) > 0.0) {
        return f(&other_side(recipe, si, w));
    }
    f(bsdf)
}

#[cold]
#[inline(never)]
pub(super) fn other_side(recipe: &Recipe, si: &SurfaceInteraction, w: Vec3) -> Bsdf {
    recipe.scene.bsdf(&SurfaceInteraction { wo: w, ..*si })
}

/// Density per steradian of scattering from `from` to `to` at a vertex that was reached from `to`.
#[inline(always)]
pub(super) fn pdf_back(recipe: &Recipe, si: &SurfaceInteraction, bsdf: &Bsdf, from: Vec3, to: Vec3) -> f64 {
    seen_from(recipe, si, bsdf, from, |b| b.pdf(from, to, Mode::Radiance, LobeMask::ALL)) as f64
}

/// Density of the way back over that of the discrete choice taken, times the cosine of the direction taken.
///
/// A choice with probability `P` has the density `P δ`, and the two deltas differ by what refraction does to solid
/// angles: `δ(in)/δ(out) = dσ_out/dσ_in = cos θᵢₙ / (η² cos θ_out)`.
fn discrete_ratio(recipe: &Recipe, si: &SurfaceInteraction, bsdf: &Bsdf, s: &BsdfSample) -> f64 {
    let choices = if recipe.two_faced(si) || matches!(bsdf, Bsdf::Layers(_)) {
        let there = bsdf.discrete_pdf(si.wo, s.lobe, s.transmit);
        let back = seen_from(recipe, si, bsdf, s.wi, |b| b.discrete_pdf(s.wi, s.lobe, s.transmit));
        back as f64 / there as f64
    } else {
        // Fresnel's reflectance is the same from both sides of the same path.
        1.0
    };
    choices * cosine(si, si.wo) / (s.eta as f64 * s.eta as f64)
}

impl Recipe<'_> {
    /// Carries the partial sums over a scattering event; `merge` as for [`Mis::scatter`].
    #[inline(always)]
    pub(super) fn scatter(
        &self,
        mis: &mut Mis,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        s: &BsdfSample,
        merge: (f64, f64),
    ) -> Scattered {
        if s.lobe.intersects(LobeMask::SMOOTH) {
            let rev = pdf_back(self, si, bsdf, s.wi, si.wo);
            mis.scatter(cosine(si, s.wi), (s.pdf as f64, rev), self.connect, merge);
            Scattered { fwd: s.pdf as f64, rev, delta: false }
        } else {
            let ratio = discrete_ratio(self, si, bsdf, s);
            mis.scatter_delta(ratio);
            Scattered { fwd: 1.0, rev: ratio / cosine(si, s.wi), delta: true }
        }
    }
}
