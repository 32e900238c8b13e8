//! One look around: irradiance, its gradients and the distance to what is seen, from stratified rays.

use std::f32::consts::{PI, TAU};

use super::hessian::{Corner, Derivatives};
use super::{CacheMetric, CacheRecord, REACH, TOTAL_ERROR};
use crate::color::Rgb;
use crate::math::{Frame, Vec2, Vec3};

/// What one ray of the hemisphere saw.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// The ray's direction, a unit vector.
    pub wi: Vec3,
    /// Radiance that arrives, W·m⁻²·sr⁻¹.
    pub radiance: Rgb,
    /// Distance to the first surface; infinite where there is none.
    pub distance: f32,
}

/// Cosine-weighted strata: `rows` of elevation, from the normal down, times `columns` of azimuth [Ward and Heckbert 1992].
#[derive(Clone, Copy, Debug)]
pub struct Hemisphere {
    frame: Frame,
    rows: u32,
    columns: u32,
}

impl Hemisphere {
    /// Strata around the unit vector `n`; `rows` of them in elevation and, as they should be square, π times as many in
    /// azimuth.
    pub fn new(n: Vec3, rows: u32) -> Self {
        let rows = rows.max(2);
        Self { frame: Frame::from_normal(n), rows, columns: (PI * rows as f32).round() as u32 }
    }

    /// Number of strata, which are numbered row by row.
    pub fn len(&self) -> u32 {
        self.rows * self.columns
    }

    /// True for no hemisphere.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The direction at `u` in stratum `i`.
    pub fn direction(&self, i: u32, u: Vec2) -> Vec3 {
        let (j, k) = (i / self.columns, i % self.columns);
        let sin_sq = (j as f32 + u.x) / self.rows as f32;
        let (sin_phi, cos_phi) = (TAU * (k as f32 + u.y) / self.columns as f32).sin_cos();
        let sin = sin_sq.sqrt();
        let local = Vec3::new(sin * cos_phi, sin * sin_phi, (1.0 - sin_sq).max(0.0).sqrt());
        self.frame.to_world(local)
    }

    /// The record at `p` from what the strata saw, in their order.
    pub fn record(&self, p: Vec3, seen: &[Seen], metric: CacheMetric) -> CacheRecord {
        let record = self.ward(p, seen);
        match metric {
            CacheMetric::SplitSphere => record,
            CacheMetric::Hessian => self.bent(record, seen),
        }
    }

    /// Whose radius is the harmonic mean of the distances.
    fn ward(&self, p: Vec3, seen: &[Seen]) -> CacheRecord {
        assert_eq!(seen.len(), self.len() as usize, "every stratum has one ray");
        let (m, n) = (self.rows as usize, self.columns as usize);
        let share = PI / (m * n) as f32;
        let at = |j: usize, k: usize| &seen[j * n + k];
        let mut sum = Rgb::BLACK;
        let mut nearness = 0.0f64;
        let (mut rotation, mut translation) = ([Vec3::ZERO; 3], [Vec3::ZERO; 3]);
        for k in 0..n {
            let before = (k + n - 1) % n;
            // u points along the middle of the column, v across it, v_edge across its first edge.
            let (sin, cos) = (TAU * (k as f32 + 0.5) / n as f32).sin_cos();
            let (u, v) = (self.tangent(cos, sin), self.tangent(-sin, cos));
            let (sin, cos) = (TAU * k as f32 / n as f32).sin_cos();
            let v_edge = self.tangent(-sin, cos);
            for j in 0..m {
                let here = at(j, k);
                sum += here.radiance;
                nearness += 1.0 / here.distance as f64;
                // How turning the surface shifts light between elevations [eq. 5; a turn is
                // n × n′ here].
                let middle = (j as f32 + 0.5) / m as f32;
                let tan = (middle / (1.0 - middle)).sqrt();
                add(&mut rotation, v, here.radiance * (tan * share));
                // How moving it uncovers what lies behind the nearer of two neighbours [eq. 6].
                if j > 0 {
                    let edge = j as f32 / m as f32;
                    let change = change(here, at(j - 1, k)) * (TAU / n as f32 * edge.sqrt() * (1.0 - edge));
                    add(&mut translation, u, change);
                }
                let width = ((j as f32 + 1.0) / m as f32).sqrt() - (j as f32 / m as f32).sqrt();
                add(&mut translation, v_edge, change(here, at(j, before)) * width);
            }
        }
        CacheRecord {
            p,
            n: self.frame.n,
            radius: (seen.len() as f64 / nearness) as f32,
            irradiance: sum * share,
            rotation,
            translation,
        }
    }

    /// The same record with the gradient and the radius that derivatives with occlusion give: the integral of the error
    /// `½ xᵀHx` over a disc of radius R is `π/8·(|λ₁| + |λ₂|)·R⁴` [Schwarzhaupt et al. 2012, §4].
    fn bent(&self, record: CacheRecord, seen: &[Seen]) -> CacheRecord {
        let corners: Vec<Corner> = seen.iter().map(|s| Corner::new(s.wi, s.distance, s.radiance)).collect();
        let d = Derivatives::of(&self.frame, self.rows as usize, self.columns as usize, &corners);
        let irradiance = record.irradiance.to_array().iter().map(|&c| c as f64 / 3.0).sum::<f64>();
        let reach = (4.0 * TOTAL_ERROR * irradiance / (std::f64::consts::PI * d.curvature())).powf(0.25);
        // Where nothing bends a record is good far away, but not beyond what it sees.
        let far = 8.0 * record.radius;
        let radius = if reach.is_finite() { (reach as f32 / REACH).min(far) } else { far };
        CacheRecord { radius, translation: d.gradient, ..record }
    }

    fn tangent(&self, x: f32, y: f32) -> Vec3 {
        self.frame.s * x + self.frame.t * y
    }
}

/// Adds `value` of each channel along `axis`.
fn add(gradient: &mut [Vec3; 3], axis: Vec3, value: Rgb) {
    for (g, v) in gradient.iter_mut().zip(value.to_array()) {
        *g += axis * v;
    }
}

/// Difference of two neighbours over the distance of the nearer one; 0 where both see infinity.
fn change(a: &Seen, b: &Seen) -> Rgb {
    let r = a.distance.min(b.distance);
    if r.is_finite() && r > 0.0 { (a.radiance - b.radiance) / r } else { Rgb::BLACK }
}
