//! Radiance from a photon map by density estimation within a radius that is known beforehand, as progressive methods do.

use super::bins::Bins;
use super::photons::{MIN_NORMAL_COS, SCRATCH, above_horizon, flux_cosine};
use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::{Frame, INV_PI, Vec3};
use crate::photon::{Flags, Kernel, PhotonMap};
use crate::tally::Counters;

/// A photon map that is read within given radii.
pub struct RadiusMap {
    map: PhotonMap,
    kernel: Kernel,
}

/// Whether an estimate on `side` of a surface, or on both, takes in a photon with these flags: it arrived on that side, on a
/// surface with about the same normal.
#[inline]
pub fn takes_in(photon: Flags, side: Option<bool>, ng: Vec3) -> bool {
    side.is_none_or(|s| photon.side() == s) && photon.normal().dot(ng) > MIN_NORMAL_COS
}

/// The lobes that scatter what photons bring.
#[derive(Clone, Copy, Debug)]
pub struct Lobes {
    /// Of photons with the [mark](Flags::mark), and of others.
    pub marked: LobeMask,
    pub unmarked: LobeMask,
}

/// A density estimate within a given radius.
#[derive(Clone, Copy, Debug, Default)]
pub struct RadiusEstimate {
    /// W·m⁻²·sr⁻¹.
    pub radiance: Rgb,
    /// Photons that added to it: neither those of the other side or of another surface, nor those that scatter nothing.
    pub count: u32,
}

impl RadiusMap {
    /// `None` for an empty map, which adds nothing anywhere.
    pub fn new(map: PhotonMap, kernel: Kernel) -> Option<Self> {
        (!map.is_empty()).then_some(Self { map, kernel })
    }

    /// How a photon's power is spread over the disc.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    pub fn memory(&self) -> usize {
        self.map.memory()
    }

    /// `L = Σ f(wo, wi)·Φ·K(d)` over the photons of this side of this surface within `r_sq`: unbiased for the average of
    /// the radiance under the kernel. Radiance leaves `si` towards `si.wo` through `lobes`.
    #[inline]
    pub fn estimate(
        &self,
        si: &SurfaceInteraction,
        (bsdf, lobes): (&Bsdf, Lobes),
        r_sq: f32,
        counters: &mut Counters,
    ) -> RadiusEstimate {
        self.estimate_and(si, (bsdf, lobes), r_sq, counters, |_, _| {})
    }

    /// As [`RadiusMap::estimate`]; adds where the photons lie in the disc to `bins`.
    pub fn estimate_in_bins(
        &self,
        si: &SurfaceInteraction,
        (bsdf, lobes): (&Bsdf, Lobes),
        r_sq: f32,
        counters: &mut Counters,
        bins: &mut Bins,
    ) -> RadiusEstimate {
        let frame = Frame::from_normal(si.ng);
        self.estimate_and(si, (bsdf, lobes), r_sq, counters, |i, d_sq| {
            let d = self.map.position(i) - si.p;
            bins.count((d.dot(frame.s) < 0.0, d.dot(frame.t) < 0.0), d_sq, r_sq);
        })
    }

    /// As [`RadiusMap::estimate`]; `visit` hears the index and the squared distance of every photon that counts.
    #[inline(always)]
    fn estimate_and(
        &self,
        si: &SurfaceInteraction,
        (bsdf, lobes): (&Bsdf, Lobes),
        r_sq: f32,
        counters: &mut Counters,
        visit: impl FnMut(u32, f32),
    ) -> RadiusEstimate {
        let Lobes { marked, unmarked } = lobes;
        if !bsdf.lobes().intersects(marked | unmarked) {
            return RadiusEstimate::default();
        }
        counters.photon_queries += 1;
        if let Some(albedo) = bsdf.lambertian(marked)
            && bsdf.lambertian(unmarked).is_some()
        {
            let mut e = self.sum(si, Some(si.wo.dot(si.ng) > 0.0), r_sq, visit, |i| self.map.power(i));
            e.radiance = albedo * INV_PI * e.radiance;
            return e;
        }
        let side = if bsdf.transmits(marked | unmarked) { None } else { Some(si.wo.dot(si.ng) > 0.0) };
        self.sum(si, side, r_sq, visit, |i| {
            let mask = if self.map.flags(i).mark() { marked } else { unmarked };
            let wi = above_horizon(self.map.direction(i), si.ng, self.map.side(i));
            // eval() has |wi·ns|; what photons count is flux through the geometric surface, |wi·ng|.
            bsdf.eval(si.wo, wi, Mode::Radiance, mask) * self.map.power(i) / flux_cosine(si, wi)
        })
    }

    #[inline(always)]
    fn sum(
        &self,
        si: &SurfaceInteraction,
        side: Option<bool>,
        r_sq: f32,
        mut visit: impl FnMut(u32, f32),
        term: impl Fn(u32) -> Rgb,
    ) -> RadiusEstimate {
        let mut e = RadiusEstimate::default();
        SCRATCH.with_borrow_mut(|scratch| {
            self.map.within(si.p, r_sq, scratch, |i, d_sq| {
                let flags = self.map.flags(i);
                if !takes_in(flags, side, si.ng) {
                    return;
                }
                let term = term(i);
                if !term.is_black() {
                    e.radiance += term * self.kernel.weight(d_sq, r_sq);
                    e.count += 1;
                    visit(i, d_sq);
                }
            });
        });
        e
    }

    /// The squared distance of the `size`-th nearest photon on this side of this surface, at most `max_r_sq`.
    pub fn nearest_radius_sq(&self, si: &SurfaceInteraction, size: usize, max_r_sq: f32) -> f32 {
        let front = si.wo.dot(si.ng) > 0.0;
        SCRATCH.with_borrow_mut(|scratch| {
            let found = self.map.nearest_where(si.p, size, max_r_sq, scratch, |i| {
                let flags = self.map.flags(i);
                flags.side() == front && flags.normal().dot(si.ng) > MIN_NORMAL_COS
            });
            found.radius_sq
        })
    }
}
