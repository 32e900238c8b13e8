//! Radiance from photon maps by density estimation [Jensen 2001, §7].

use std::cell::RefCell;
use std::ops::{AddAssign, Mul};

use super::area::{self, AreaSettings};
use super::irradiance::IrradianceMap;
use super::shadows::ShadowMap;
use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::{INV_PI, Vec3};
use crate::photon::{Kernel, KnnScratch, Neighbours, PhotonClass, PhotonMap};
use crate::tally::Counters;

/// How photon maps are read. Radii are fractions of the radius of the scene's bounding sphere.
#[derive(Clone, Copy, Debug)]
pub struct LookupSettings {
    /// Photons in an estimate from the global map.
    pub global_size: u32,
    /// Photons in an estimate from the caustic map.
    pub caustic_size: u32,
    /// Largest radius of an estimate from the global map.
    pub global_radius: f32,
    /// Largest radius of an estimate from the caustic map.
    pub caustic_radius: f32,
    pub kernel: Kernel,
    pub area: AreaSettings,
}

/// A density estimate.
#[derive(Clone, Copy, Debug, Default)]
pub struct MapEstimate<T = Rgb> {
    /// W·m⁻²·sr⁻¹.
    pub radiance: T,
    /// Squared radius of the disc that it is an average over; 0 where there is no map.
    pub radius_sq: f32,
}

/// Share of their area in which photon maps are read once more to tell the bias of estimates.
pub const NARROW: f32 = 0.5;

/// What is read of photon maps: the estimate alone or [`Both`].
pub trait Reading: Copy + Default + From<Rgb> + AddAssign + Mul<Rgb, Output = Self> {
    /// From an estimate and the one by a share [`NARROW`] of its photons.
    fn of(own: Rgb, narrow: impl FnOnce() -> Rgb) -> Self;
}

impl Reading for Rgb {
    #[inline]
    fn of(own: Rgb, _: impl FnOnce() -> Rgb) -> Self {
        own
    }
}

/// An estimate, and that of [narrow](PhotonMaps::narrow) maps; the same twice for what is not read from maps.
#[derive(Clone, Copy, Debug, Default)]
pub struct Both {
    pub own: Rgb,
    pub narrow: Rgb,
}

impl Reading for Both {
    #[inline]
    fn of(own: Rgb, narrow: impl FnOnce() -> Rgb) -> Self {
        Self { own, narrow: narrow() }
    }
}

impl From<Rgb> for Both {
    #[inline]
    fn from(own: Rgb) -> Self {
        Self { own, narrow: own }
    }
}

impl AddAssign for Both {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.own += other.own;
        self.narrow += other.narrow;
    }
}

impl Mul<Rgb> for Both {
    type Output = Self;

    #[inline]
    fn mul(self, factor: Rgb) -> Self {
        Self { own: self.own * factor, narrow: self.narrow * factor }
    }
}

/// Photons whose surface is turned further than this (60°) from the one they are gathered on do not count.
pub(super) const MIN_NORMAL_COS: f32 = 0.5;

/// Cosine to the geometric normal below which a stored direction is lifted: quantisation may have put it below the horizon.
const MIN_COS: f32 = 1e-3;

/// A map with the way in which it is read.
pub(super) struct Lookup {
    pub(super) map: PhotonMap,
    size: usize,
    max_radius_sq: f32,
    pub(super) kernel: Kernel,
    /// Only where it asks for anything.
    area: Option<AreaSettings>,
    irradiance: Option<IrradianceMap>,
}

/// The photon maps of one pass.
#[derive(Default)]
pub struct PhotonMaps {
    caustic: Option<Lookup>,
    global: Option<Lookup>,
    shadows: Option<ShadowMap>,
}

thread_local! {
    /// Buffers of queries; results do not depend on what they were used for before.
    pub(super) static SCRATCH: RefCell<KnnScratch> = RefCell::new(KnnScratch::new());
}

impl PhotonMaps {
    /// Takes the caustic map. `scene_radius` is that of the scene's bounding sphere.
    pub fn set_caustic(&mut self, map: PhotonMap, lookup: &LookupSettings, scene_radius: f32) {
        let found = Lookup::new(map, lookup.caustic_size, lookup.caustic_radius * scene_radius, lookup.kernel);
        self.caustic = found.map(|l| l.with_area(lookup.area));
    }

    /// Takes the map that indirect light comes from. `scene_radius` is that of the scene's bounding sphere.
    pub fn set_global(&mut self, map: PhotonMap, lookup: &LookupSettings, scene_radius: f32) {
        let found = Lookup::new(map, lookup.global_size, lookup.global_radius * scene_radius, lookup.kernel);
        self.global = found.map(|l| l.with_area(lookup.area));
    }

    /// Takes what is known of direct light.
    pub fn set_shadows(&mut self, shadows: ShadowMap) {
        self.shadows = Some(shadows);
    }

    /// Whether light `light` is visible from `si` in direction `wi`, where shadow photons tell.
    #[inline]
    pub fn visible(&self, si: &SurfaceInteraction, light: usize, wi: Vec3) -> Option<bool> {
        self.shadows.as_ref()?.visible(si, light, wi)
    }

    /// Computes irradiance beforehand at some of the global map's photons; Lambertian surfaces then look it up.
    pub fn precompute_irradiance(&mut self) {
        if let Some(global) = &mut self.global {
            global.irradiance = Some(IrradianceMap::precompute(global));
        }
    }

    /// Estimates irradiance from now on where it is asked for. Tells whether it was precomputed before.
    pub fn forget_irradiance(&mut self) -> bool {
        self.global.as_mut().is_some_and(|global| global.irradiance.take().is_some())
    }

    /// Reads all maps from now on with a share [`NARROW`] of the photons, within that share of the area.
    pub fn narrow(&mut self) {
        for lookup in [&mut self.caustic, &mut self.global].into_iter().flatten() {
            (lookup.size, lookup.max_radius_sq) = lookup.narrower();
        }
    }

    pub fn has_global(&self) -> bool {
        self.global.is_some()
    }

    /// Bytes of all maps.
    pub fn memory(&self) -> usize {
        let shadows = self.shadows.as_ref().map_or(0, ShadowMap::memory);
        shadows + [&self.caustic, &self.global].into_iter().flatten().map(Lookup::memory).sum::<usize>()
    }

    /// Radiance of caustics that leaves `si` towards `si.wo` through its diffuse and wide glossy lobes.
    #[inline]
    pub fn caustic_radiance<T: Reading>(&self, si: &SurfaceInteraction, bsdf: &Bsdf, counters: &mut Counters) -> T {
        self.caustic.as_ref().map_or(T::default(), |l| l.estimate(si, bsdf, counters).radiance)
    }

    /// Radiance that leaves `si` towards `si.wo` through its diffuse and wide glossy lobes, from the global map.
    #[inline]
    pub fn global_radiance<T: Reading>(
        &self,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        counters: &mut Counters,
    ) -> MapEstimate<T> {
        self.global.as_ref().map_or(MapEstimate::default(), |l| l.estimate(si, bsdf, counters))
    }

    /// Radiance of all maps that leaves `si` towards `si.wo`, each photon path counted once: caustics from their own map
    /// even where the global map holds them too. Nothing precomputed is used.
    pub fn photon_radiance(&self, si: &SurfaceInteraction, bsdf: &Bsdf, counters: &mut Counters) -> Rgb {
        let Some(global) = &self.global else { return self.caustic_radiance(si, bsdf, counters) };
        let sharper = self.caustic.is_some();
        let rest = |i: u32| !(sharper && global.map.flags(i).class() == PhotonClass::Caustic);
        self.caustic_radiance::<Rgb>(si, bsdf, counters) + global.estimate_where::<Rgb>(si, bsdf, rest).radiance
    }

    /// As [`PhotonMaps::global_radiance`] without what is precomputed.
    pub fn plain_global_radiance(&self, si: &SurfaceInteraction, bsdf: &Bsdf, counters: &mut Counters) -> Rgb {
        counters.photon_queries += 1;
        self.global.as_ref().map_or(Rgb::BLACK, |l| l.estimate_where(si, bsdf, |_| true).radiance)
    }

    /// Photons of all maps for each unit of area, scene units, on the side of the surface that `si.wo` sees.
    pub fn density(&self, si: &SurfaceInteraction) -> f32 {
        let front = si.wo.dot(si.ng) > 0.0;
        let of = |l: &Lookup| SCRATCH.with_borrow_mut(|scratch| l.density(si.p, si.ng, front, scratch));
        [&self.caustic, &self.global].into_iter().flatten().map(of).sum()
    }
}

impl Lookup {
    pub(super) fn new(map: PhotonMap, size: u32, radius: f32, kernel: Kernel) -> Option<Self> {
        let size = size.max(1) as usize;
        (!map.is_empty()).then_some(Self {
            map,
            size,
            max_radius_sq: radius * radius,
            kernel,
            area: None,
            irradiance: None,
        })
    }

    /// Reads the map with another area than the disc's.
    pub(super) fn with_area(self, area: AreaSettings) -> Self {
        Self { area: (area != AreaSettings::default()).then_some(area), ..self }
    }

    /// Photons in an estimate.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// Largest radius of an estimate, scene units.
    pub(super) fn max_radius(&self) -> f32 {
        self.max_radius_sq.sqrt()
    }

    /// A share [`NARROW`] of the photons in an estimate, and of its largest squared radius.
    fn narrower(&self) -> (usize, f32) {
        (((self.size as f32 * NARROW) as usize).max(1), self.max_radius_sq * NARROW)
    }

    fn memory(&self) -> usize {
        self.map.memory() + self.irradiance.as_ref().map_or(0, IrradianceMap::memory)
    }

    /// `L = Σ f(wo, wi)·Φ·K(d)` over the nearest photons of this side of this surface [Jensen 2001, eq. 7.6].
    fn estimate<T: Reading>(&self, si: &SurfaceInteraction, bsdf: &Bsdf, counters: &mut Counters) -> MapEstimate<T> {
        counters.photon_queries += 1;
        let front = si.wo.dot(si.ng) > 0.0;
        // Lambertian: the directions of the photons do not matter, and irradiance may be known already.
        if let Some(albedo) = bsdf.lambertian(LobeMask::SMOOTH_WIDE)
            && let Some((irradiance, radius_sq)) =
                self.irradiance.as_ref().and_then(|map| map.lookup(si.p, si.ng, front))
        {
            return MapEstimate { radiance: T::from(albedo * INV_PI * irradiance), radius_sq };
        }
        self.estimate_where(si, bsdf, |_| true)
    }

    /// As [`Lookup::estimate`] over the photons that `accept` takes, without what is precomputed.
    fn estimate_where<T: Reading>(
        &self,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        accept: impl Fn(u32) -> bool,
    ) -> MapEstimate<T> {
        let front = si.wo.dot(si.ng) > 0.0;
        SCRATCH.with_borrow_mut(|scratch| {
            if let Some(albedo) = bsdf.lambertian(LobeMask::SMOOTH_WIDE) {
                let sum = self.sum::<T>(si.p, si.ng, Some(front), scratch, accept, |i| self.map.power(i));
                return sum.map_or(MapEstimate::default(), |(irradiance, radius_sq)| MapEstimate {
                    radiance: irradiance * (albedo * INV_PI),
                    radius_sq,
                });
            }
            let side = if bsdf.transmits(LobeMask::SMOOTH_WIDE) { None } else { Some(front) };
            let term = |i: u32| {
                let wi = above_horizon(self.map.direction(i), si.ng, self.map.side(i));
                // eval() has |wi·ns|; what photons count is flux through the geometric surface, |wi·ng|.
                bsdf.eval(si.wo, wi, Mode::Radiance, LobeMask::SMOOTH_WIDE) * self.map.power(i) / flux_cosine(si, wi)
            };
            let sum = self.sum(si.p, si.ng, side, scratch, accept, term);
            sum.map_or(MapEstimate::default(), |(radiance, radius_sq)| MapEstimate { radiance, radius_sq })
        })
    }

    /// Irradiance (W·m⁻²) on one side of a surface, and the squared radius of the disc it is averaged over.
    pub(super) fn irradiance(&self, p: Vec3, ng: Vec3, front: bool, scratch: &mut KnnScratch) -> Option<(Rgb, f32)> {
        self.sum(p, ng, Some(front), scratch, |_| true, |i| self.map.power(i))
    }

    /// Photons for each unit of area on one side of a surface.
    fn density(&self, p: Vec3, ng: Vec3, front: bool, scratch: &mut KnnScratch) -> f32 {
        let found = self.sum::<Rgb>(p, ng, Some(front), scratch, |_| true, |_| Rgb::splat(1.0));
        found.map_or(0.0, |(density, _)| density.g)
    }

    /// `Σ term·K(d)` over the nearest photons on this surface, and the squared radius.
    ///
    /// The k-th photon only sets the radius: the other k − 1 are uniform within it, so that the estimate has no bias in
    /// uniform light, whereas k/(πr²) is too large by k/(k − 1).
    #[inline]
    fn sum<T: Reading>(
        &self,
        p: Vec3,
        ng: Vec3,
        side: Option<bool>,
        scratch: &mut KnnScratch,
        accept: impl Fn(u32) -> bool,
        term: impl Fn(u32) -> Rgb,
    ) -> Option<(T, f32)> {
        let found = self.map.nearest_where(p, self.size, self.max_radius_sq, scratch, |i| {
            let flags = self.map.flags(i);
            side.is_none_or(|s| flags.side() == s) && flags.normal().dot(ng) > MIN_NORMAL_COS && accept(i)
        });
        if found.radius_sq <= 0.0 {
            return None;
        }
        let (own, radius_sq) = self.weighted(&found, (p, ng), &term);
        let narrow = || {
            let (size, max_radius_sq) = self.narrower();
            self.weighted(&found.nearest(size, max_radius_sq).as_neighbours(), (p, ng), &term).0
        };
        Some((T::of(own, narrow), radius_sq))
    }

    /// `Σ term·K(d)` over photons found around a point of a surface, and the squared radius.
    #[inline]
    fn weighted(&self, found: &Neighbours, at: (Vec3, Vec3), term: &impl Fn(u32) -> Rgb) -> (Rgb, f32) {
        let (kernel, radius_sq) = (self.kernel, found.radius_sq);
        if let Some(area) = &self.area {
            return area::sum(area, (&self.map, found), at, kernel, term);
        }
        let sum = if found.full {
            found.iter().map(|(i, d_sq)| term(i) * kernel.nearest_weight(d_sq, radius_sq)).sum()
        } else {
            found.iter().map(|(i, d_sq)| term(i) * kernel.weight(d_sq, radius_sq)).sum()
        };
        (sum, radius_sq)
    }
}

/// What to divide `f·|wi·ns|` by for a photon that came in along `wi`: the cosine with the geometric surface, through which
/// photons count flux.
///
/// The quotient of the two cosines is 1 on average, but a photon may have landed on another facet of a curved surface, where
/// its own cosine was not small and this one is: the mean of `|wi·ns|/|wi·ng|` is then infinite. Below [`SMALL_COS`] both
/// are lifted by the same amount, which bounds the quotient and changes nothing where the normals agree.
#[inline]
pub(super) fn flux_cosine(si: &SurfaceInteraction, wi: Vec3) -> f32 {
    let (g, s) = (wi.dot(si.ng).abs(), wi.dot(si.ns).abs().max(MIN_COS));
    let lifted = g.max(SMALL_COS);
    s * (lifted / (s + (lifted - g)))
}

/// See [`flux_cosine`].
const SMALL_COS: f32 = 0.1;

/// A stored direction put back on the side of the surface that the photon is known to have come from.
#[inline]
pub(super) fn above_horizon(wi: Vec3, ng: Vec3, front: bool) -> Vec3 {
    let n = if front { ng } else { -ng };
    let cos = wi.dot(n);
    if cos >= MIN_COS { wi } else { (wi + n * (MIN_COS - cos)).normalize() }
}
