//! How irradiance bends: its first and second derivatives along a surface, with occlusion, from one hemisphere of rays
//! [Schwarzhaupt, Jensen and Jarosz 2012].
//!
//! The points that neighbouring rays hit are joined to triangles around the record, from the zenith to the horizon. Each
//! triangle shines with the radiance of its farthest corner: between a near surface and what is behind it, moving uncovers
//! what is behind. Irradiance from polygons is a sum over their edges [Lambert 1760],
//! `E = ½ Σ ΔL · n·(a × b) · θ/|a × b|`, with `a` and `b` from the record to the ends of an edge, `θ` the angle between them
//! and `ΔL` the step of radiance across it, so that edges between equal triangles need no look. `n·(a × b)` is linear in the
//! record's position, and `θ/|a × b| = ∫₀¹ dt/|a + t(b − a)|²`, whose derivatives are integrals of powers of distances that
//! have closed forms.

use crate::color::Rgb;
use crate::math::{DVec3, Frame, Vec3};

/// What one ray hit.
#[derive(Clone, Copy, Debug)]
pub struct Corner {
    /// From the record, scene units.
    pub to: DVec3,
    pub radiance: Rgb,
    /// Its length squared.
    pub distance_sq: f64,
}

/// Distance at which what is infinitely far away is placed, scene units: a scene's box measures 1 to 2.
const FAR: f64 = 1e3;

impl Corner {
    /// What a ray along the unit vector `w` saw.
    pub fn new(w: Vec3, distance: f32, radiance: Rgb) -> Self {
        let distance = (distance as f64).clamp(1e-9, FAR);
        Self { to: w.as_dvec3() * distance, radiance, distance_sq: distance * distance }
    }

    /// The point below this one on the horizon of `n`, as far away.
    fn on_horizon(&self, n: DVec3) -> Self {
        let flat = (self.to - n * self.to.dot(n)).normalize_or_zero();
        Self { to: flat * self.distance_sq.sqrt(), ..*self }
    }
}

/// First and second derivatives of irradiance with steps along the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Derivatives {
    /// Of each channel, W·m⁻³.
    pub gradient: [Vec3; 3],
    /// Of the mean of the channels along the two tangents of the frame: ss, st and tt, W·m⁻⁴.
    pub hessian: [f64; 3],
}

impl Derivatives {
    /// From the corners of `rows` × `columns` strata, row by row from the zenith.
    pub fn of(frame: &Frame, rows: usize, columns: usize, corners: &[Corner]) -> Self {
        assert_eq!(corners.len(), rows * columns, "every stratum has one ray");
        let n = frame.n.as_dvec3();
        let mut edges = Edges { n, s: frame.s.as_dvec3(), t: frame.t.as_dvec3(), sum: [[0.0; 3]; 3], bend: [0.0; 3] };
        let horizon: Vec<Corner> = corners[(rows - 1) * columns..].iter().map(|c| c.on_horizon(n)).collect();
        let ring = |j: usize| if j < rows { &corners[j * columns..(j + 1) * columns] } else { &horizon[..] };
        // Around the zenith is one polygon, of the mean radiance of its corners.
        let mut above =
            vec![ring(0).iter().fold(Rgb::BLACK, |sum, c| sum + c.radiance) * (1.0 / columns as f32); columns];
        for j in 0..rows {
            let (inner, outer) = (ring(j), ring(j + 1));
            let quads: Vec<[Rgb; 2]> = (0..columns)
                .map(|k| {
                    let l = (k + 1) % columns;
                    // The diagonal runs from the inner corner k to the outer corner l.
                    [farthest([&inner[k], &inner[l], &outer[l]]), farthest([&inner[k], &outer[l], &outer[k]])]
                })
                .collect();
            for k in 0..columns {
                let l = (k + 1) % columns;
                let [upper, lower] = quads[k];
                let before = quads[(k + columns - 1) % columns][0];
                edges.add(&inner[k], &inner[l], above[k] - upper);
                edges.add(&inner[k], &outer[l], upper - lower);
                edges.add(&inner[k], &outer[k], lower - before);
                above[k] = lower;
            }
        }
        for k in 0..columns {
            edges.add(&horizon[k], &horizon[(k + 1) % columns], above[k]);
        }
        edges.finish()
    }

    /// The mean of the absolute second derivatives along the principal directions.
    pub fn curvature(&self) -> f64 {
        let [a, b, c] = self.hessian;
        let (middle, spread) = (0.5 * (a + c), (0.25 * (a - c) * (a - c) + b * b).sqrt());
        0.5 * ((middle + spread).abs() + (middle - spread).abs())
    }
}

/// The radiance of the farthest of three corners.
fn farthest(corners: [&Corner; 3]) -> Rgb {
    let [a, b, c] = corners;
    let ab = if a.distance_sq >= b.distance_sq { a } else { b };
    if ab.distance_sq >= c.distance_sq { ab.radiance } else { c.radiance }
}

/// Sums over edges.
struct Edges {
    n: DVec3,
    s: DVec3,
    t: DVec3,
    /// By channel: the irradiance, for tests, and its derivatives along s and t.
    sum: [[f64; 3]; 3],
    bend: [f64; 3],
}

impl Edges {
    /// Adds the edge from `a` to `b` across which radiance steps up by `step` to its left, seen from the record.
    fn add(&mut self, a: &Corner, b: &Corner, step: Rgb) {
        if step.is_black() {
            return;
        }
        let e = b.to - a.to;
        let length = e.length();
        if length <= 1e-12 {
            return;
        }
        // The foot of the record on the line of the edge, and the ends along it.
        let along = e / length;
        let (first, last) = (a.to.dot(along), b.to.dot(along));
        let foot = a.to - along * first;
        let h_sq = foot.length_squared();
        if h_sq <= 1e-9 * a.distance_sq.max(b.distance_sq) {
            return;
        }
        let h = h_sq.sqrt();
        let (ra, rb) = (h_sq + first * first, h_sq + last * last);
        // Integrals of r⁻², r⁻⁴ and r⁻⁶ over the edge, and with powers of the place along it.
        let i2 = (h * (last - first)).atan2(h_sq + first * last) / h;
        let i4 = 0.5 / h_sq * (last / rb - first / ra + i2);
        let i6 = 0.25 / h_sq * (last / (rb * rb) - first / (ra * ra) + 3.0 * i4);
        let m4 = 0.5 * (1.0 / ra - 1.0 / rb);
        let m6 = 0.25 * (1.0 / (ra * ra) - 1.0 / (rb * rb));
        let q6 = i4 - h_sq * i6;
        // u = n·(a × b), s = ∫ r⁻², each with derivatives along the tangents.
        let inv = 1.0 / length;
        let u = self.n.dot(a.to.cross(b.to));
        let du = self.n.cross(e);
        let (us, ut) = (du.dot(self.s), du.dot(self.t));
        let (fs, ft, es, et) = (foot.dot(self.s), foot.dot(self.t), along.dot(self.s), along.dot(self.t));
        let (ds, dt) = (2.0 * inv * (fs * i4 + es * m4), 2.0 * inv * (ft * i4 + et * m4));
        let second = |fa: f64, ea: f64, fb: f64, eb: f64, same: f64| {
            8.0 * inv * (fa * fb * i6 + (fa * eb + ea * fb) * m6 + ea * eb * q6) - same * 2.0 * inv * i4
        };
        let gradient = [us * inv * i2 + u * ds, ut * inv * i2 + u * dt];
        let hessian = [
            2.0 * us * ds + u * second(fs, es, fs, es, 1.0),
            us * dt + ut * ds + u * second(fs, es, ft, et, 0.0),
            2.0 * ut * dt + u * second(ft, et, ft, et, 1.0),
        ];
        let mean = step.to_array().iter().map(|&c| c as f64 / 6.0).sum::<f64>();
        for (sum, c) in self.sum.iter_mut().zip(step.to_array()) {
            let half = 0.5 * c as f64;
            sum[0] += half * u * inv * i2;
            sum[1] += half * gradient[0];
            sum[2] += half * gradient[1];
        }
        self.bend.iter_mut().zip(hessian).for_each(|(b, h)| *b += mean * h);
    }

    fn finish(self) -> Derivatives {
        let gradient = self.sum.map(|[_, s, t]| (self.s * s + self.t * t).as_vec3());
        Derivatives { gradient, hessian: self.bend }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: Frame = Frame { s: Vec3::X, t: Vec3::Y, n: Vec3::Z };

    /// The sums of a triangle of radiance 1 seen from `p`.
    fn triangle(p: DVec3, corners: [DVec3; 3]) -> Edges {
        let (n, s, t) = (DVec3::Z, DVec3::X, DVec3::Y);
        let mut edges = Edges { n, s, t, sum: [[0.0; 3]; 3], bend: [0.0; 3] };
        let at = |q: DVec3| Corner { to: q - p, radiance: Rgb::WHITE, distance_sq: (q - p).length_squared() };
        for i in 0..3 {
            edges.add(&at(corners[i]), &at(corners[(i + 1) % 3]), Rgb::WHITE);
        }
        edges
    }

    /// Closed forms against central differences of the irradiance, which they contain; one edge is seen nearly end-on.
    #[test]
    fn derivatives_of_a_triangle() {
        let corners = [DVec3::new(-0.4, -0.3, 0.9), DVec3::new(0.7, -0.2, 1.3), DVec3::new(0.1, 0.8, 0.5)];
        let end_on = [DVec3::new(0.32, 0.61, 3.0), DVec3::new(0.1, 0.2, 1.0), DVec3::new(-0.5, 0.6, 0.8)];
        for corners in [corners, end_on] {
            let e = |x: f64, y: f64| triangle(DVec3::new(x, y, 0.0), corners).sum[1][0];
            assert!(e(0.0, 0.0).abs() > 1e-3, "seen");
            let h = 1e-4;
            let found = triangle(DVec3::ZERO, corners);
            let gradient = [(e(h, 0.0) - e(-h, 0.0)) / (2.0 * h), (e(0.0, h) - e(0.0, -h)) / (2.0 * h)];
            let cross = (e(h, h) - e(h, -h) - e(-h, h) + e(-h, -h)) / (4.0 * h * h);
            let second = |a: f64, b: f64| (a - 2.0 * e(0.0, 0.0) + b) / (h * h);
            let hessian = [second(e(h, 0.0), e(-h, 0.0)), cross, second(e(0.0, h), e(0.0, -h))];
            for (found, expected) in found.sum[1][1..].iter().chain(&found.bend).zip(gradient.iter().chain(&hessian)) {
                assert!((found - expected).abs() < 1e-5 * (1.0 + expected.abs()), "{found}, not {expected}");
            }
        }
    }

    #[test]
    fn equal_light_from_everywhere_does_not_bend() {
        let (rows, columns) = (8, 25);
        let corners: Vec<Corner> = (0..rows * columns)
            .map(|i| {
                let (sin_sq, phi) = (((i / columns) as f32 + 0.5) / rows as f32, (i % columns) as f32 * 0.2513);
                let w = Vec3::new(sin_sq.sqrt() * phi.cos(), sin_sq.sqrt() * phi.sin(), (1.0 - sin_sq).sqrt());
                Corner::new(w, 1.0, Rgb::new(1.0, 2.0, 3.0))
            })
            .collect();
        let d = Derivatives::of(&FRAME, rows, columns, &corners);
        assert!(d.gradient.iter().all(|g| g.length() < 1e-3) && d.curvature() < 0.02, "{d:?}");
    }
}
