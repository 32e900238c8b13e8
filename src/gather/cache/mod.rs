//! The irradiance cache: indirect irradiance computed at few points and interpolated between them [Ward et al. 1988].
//!
//! A record is an average over a whole hemisphere of rays, with the gradients of [Ward and Heckbert 1992], and is good for
//! its neighbourhood up to a radius, which follows from how irradiance bends there or from the distances of what it sees
//! ([`CacheMetric`]), within limits. The cache is filled in rounds (see the photon mapper), each from what the rounds before
//! it left, so that it does not depend on threads.

mod hemisphere;
mod hessian;
mod octree;
#[cfg(test)]
mod tests;

pub use hemisphere::{Hemisphere, Seen};

use crate::color::Rgb;
use crate::math::{Bounds3, Vec3};
use octree::Octree;

/// What says how far a record is good.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CacheMetric {
    /// The harmonic mean of the distances of what it sees [Ward et al. 1988], less where the gradient is steep.
    #[default]
    SplitSphere,
    /// How much irradiance bends, by its second derivatives with occlusion [Schwarzhaupt et al. 2012]: the error that gradients
    /// leave. Better where records are few.
    Hessian,
}

impl CacheMetric {
    /// The names in scene files.
    pub const NAMES: [(&'static str, Self); 2] = [("split_sphere", Self::SplitSphere), ("hessian", Self::Hessian)];
}

/// Parameters, named as in Mitsuba 0.6's `irrcache`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CacheSettings {
    /// Rows of strata in a hemisphere of rays; π times as many in azimuth.
    pub resolution: u32,
    /// Records are valid over a distance that this divides.
    pub quality: f32,
    /// What says how far records are good.
    pub metric: CacheMetric,
    /// Interpolate with gradients.
    pub gradients: bool,
    /// Let a record's radius not exceed a neighbour's by more than their distance [Křivánek et al. 2006].
    pub clamp_neighbor: bool,
    /// Keep a record's reach on the screen within [`PIXELS`].
    pub clamp_screen: bool,
}

impl Default for CacheSettings {
    fn default() -> Self {
        let metric = CacheMetric::default();
        Self { resolution: 16, quality: 1.0, metric, gradients: true, clamp_neighbor: true, clamp_screen: true }
    }
}

/// The largest error, in Ward's measure `d/R + √(1 − n·nᵢ)`, at which a record is used; divided by the quality.
const REACH: f32 = 0.5;

/// The error that a record of the Hessian metric makes over its whole reach, relative to its irradiance times the area of a
/// square of unit side; divided by the fourth power of the quality. At quality 1 the Cornell box has about as many records as
/// by [`CacheMetric::SplitSphere`].
const TOTAL_ERROR: f64 = 1e-3;

/// Least and greatest reach of a record on the screen, in pixels.
pub const PIXELS: (f32, f32) = (1.5, 20.0);

/// Irradiance around one point, on one side of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CacheRecord {
    pub p: Vec3,
    /// Unit normal on the side that is lit.
    pub n: Vec3,
    /// Distance over which irradiance changes, by the metric, within limits.
    pub radius: f32,
    /// W·m⁻².
    pub irradiance: Rgb,
    /// Change of each channel with a turn of the normal about an axis, W·m⁻² per radian.
    pub rotation: [Vec3; 3],
    /// Change of each channel with a step, W·m⁻³.
    pub translation: [Vec3; 3],
}

/// Records and the way to find them.
pub struct IrradianceCache {
    settings: CacheSettings,
    /// The error at which a record is no longer used.
    reach: f32,
    records: Vec<CacheRecord>,
    octree: Octree,
}

impl IrradianceCache {
    /// An empty cache for points in `bounds`.
    pub fn new(settings: CacheSettings, bounds: &Bounds3) -> Self {
        let reach = REACH / settings.quality.max(1e-3);
        Self { settings, reach, records: Vec::new(), octree: Octree::new(bounds) }
    }

    pub fn settings(&self) -> &CacheSettings {
        &self.settings
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    pub fn records(&self) -> &[CacheRecord] {
        &self.records
    }

    pub fn memory(&self) -> usize {
        self.records.capacity() * size_of::<CacheRecord>() + self.octree.memory()
    }

    /// Takes a record as [`Hemisphere::record`] made it. `pixel` is the width of a pixel seen there, scene units.
    pub fn insert(&mut self, mut record: CacheRecord, pixel: f32) {
        // No further than irradiance takes to change by as much as there is.
        let ward = self.settings.metric == CacheMetric::SplitSphere;
        let steepest = record.translation.iter().map(|g| g.length()).fold(0.0, f32::max);
        if ward && self.settings.gradients && steepest > 0.0 {
            record.radius = record.radius.min(record.irradiance.max_channel() / steepest);
        }
        // No further than a neighbour nearby allows, nor may the neighbour.
        if self.settings.clamp_neighbor {
            self.clamp_to_neighbours(&mut record);
        }
        if self.settings.clamp_screen && pixel.is_finite() {
            let (least, most) = (PIXELS.0 * pixel / self.reach, PIXELS.1 * pixel / self.reach);
            // What is made to reach further than it should must not overshoot.
            if record.radius < least {
                let shrink = record.radius / least;
                record.translation.iter_mut().for_each(|g| *g *= shrink);
            }
            record.radius = record.radius.clamp(least, most);
        }
        let slopes = record.translation.iter().all(|g| g.is_finite());
        if !(slopes && record.radius.is_finite() && record.irradiance.is_finite() && record.radius > 0.0) {
            return;
        }
        let id = self.records.len() as u32;
        self.octree.insert(id, record.p, self.reach * record.radius);
        self.records.push(record);
    }

    fn clamp_to_neighbours(&mut self, record: &mut CacheRecord) {
        let Self { octree, records, reach, .. } = self;
        let near = |r: &CacheRecord, distance: f32| distance <= *reach * r.radius;
        octree.visit(record.p, |i| {
            let other = &records[i as usize];
            let distance = other.p.distance(record.p);
            if near(other, distance) {
                record.radius = record.radius.min(other.radius + distance);
            }
        });
        octree.visit(record.p, |i| {
            let other = &mut records[i as usize];
            let distance = other.p.distance(record.p);
            if near(other, distance) {
                other.radius = other.radius.min(record.radius + distance);
            }
        });
    }

    /// Whether a record of this side of the surface lies within `distance` of `p`, and within its own reach.
    pub fn has_record_near(&self, p: Vec3, n: Vec3, distance: f32) -> bool {
        let mut near = false;
        self.octree.visit(p, |i| {
            let record = &self.records[i as usize];
            near |= record.p.distance_squared(p) < distance * distance && record.n.dot(n) > 0.0;
        });
        near
    }

    /// Irradiance (W·m⁻²) at `p` on the side of the unit normal `n`, if some record is good for it: the mean of what the
    /// records say [Ward and Heckbert 1992, eq. 7], weighted by `1/error − 1/reach`, which fades in from 0.
    #[inline]
    pub fn interpolate(&self, p: Vec3, n: Vec3) -> Option<Rgb> {
        let mut sum = Rgb::BLACK;
        let mut weights = 0.0;
        let inv_reach = 1.0 / self.reach;
        self.octree.visit(p, |i| {
            let record = &self.records[i as usize];
            let d = p - record.p;
            let limit = self.reach * record.radius;
            let d_sq = d.length_squared();
            let cos = n.dot(record.n);
            if d_sq >= limit * limit || cos <= 0.0 {
                return;
            }
            let error = d_sq.sqrt() / record.radius + (1.0 - cos).max(0.0).sqrt();
            // A record in front of the point may see what the point does not.
            if error >= self.reach || d.dot(n + record.n) < -0.1 * limit {
                return;
            }
            let weight = 1.0 / error.max(1e-3 * self.reach) - inv_reach;
            sum += record.at(d, n, self.settings.gradients) * weight;
            weights += weight;
        });
        (weights > 0.0).then(|| (sum / weights).map(|c| c.max(0.0)))
    }
}

impl CacheRecord {
    /// Irradiance at the offset `d` under the normal `n`, by the gradients if they are wanted.
    #[inline]
    fn at(&self, d: Vec3, n: Vec3, gradients: bool) -> Rgb {
        if !gradients {
            return self.irradiance;
        }
        let turn = self.n.cross(n);
        let change = |c: usize| turn.dot(self.rotation[c]) + d.dot(self.translation[c]);
        self.irradiance + Rgb::new(change(0), change(1), change(2))
    }
}
