//! Fresnel reflectance of smooth interfaces, unpolarised.

use crate::color::Rgb;
use crate::math::{safe_sqrt, sqr};

/// The ratio of two refractive indices, as seen from the side that a direction is on.
///
/// `η² − 1` is kept beside `η` because it decides everything when the media are nearly equal, and there `η` alone has
/// lost its digits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ior {
    /// Index beyond the interface over index on this side.
    pub eta: f32,
    /// `η² − 1`.
    pub m: f32,
}

/// What happens at an interface to a direction with cosine `c`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fresnel {
    /// Reflected fraction of the power.
    pub r: f32,
    /// `η·cos θt`; 0 at and beyond total reflection.
    pub g: f32,
}

impl Ior {
    /// Seen from outside: `int_ior / ext_ior`.
    pub fn new(int_ior: f64, ext_ior: f64) -> Self {
        let eta = int_ior / ext_ior;
        Self { eta: eta as f32, m: ((int_ior - ext_ior) * (int_ior + ext_ior) / (ext_ior * ext_ior)) as f32 }
    }

    /// The same interface seen from the other side.
    #[inline(always)]
    pub fn flipped(self) -> Self {
        let inv = 1.0 / self.eta;
        Self { eta: inv, m: -self.m * inv * inv }
    }

    /// The interface seen by a direction whose cosine with the outward normal is `cos`.
    #[inline(always)]
    pub fn seen_from(self, cos: f32) -> Self {
        if cos >= 0.0 { self } else { self.flipped() }
    }

    /// Reflected power for a direction of cosine `c ≥ 0` on this side.
    ///
    /// With `g = η cos θt = √(c² + η² − 1)`, both amplitudes are written without a difference of nearly equal numbers:
    /// `r_s = −(η²−1)/(c+g)²` and `r_p = (η²−1)((η²+1)c² − 1)/(η²c+g)²`. These are the forms in `sin(θi−θt)` and
    /// `tan(θi−θt)` [Born and Wolf 1999, §1.5.2, eq. 21a] with the angles eliminated.
    #[inline(always)]
    pub fn fresnel(self, c: f32) -> Fresnel {
        let g_sq = c * c + self.m;
        let total = g_sq <= 0.0;
        let g = if total { 0.0 } else { g_sq.sqrt() };
        let r = if total { 1.0 } else { self.reflectance(c, g) };
        if self.m == 0.0 { Fresnel { r: 0.0, g: c } } else { Fresnel { r, g } }
    }

    /// Reflected power for the cosines of a ray that is refracted: `c` on this side, `g = η cos θt`.
    #[inline(always)]
    pub fn reflectance(self, c: f32, g: f32) -> f32 {
        let e = self.eta * self.eta;
        let rs = self.m / sqr(c + g);
        let rp = self.m * ((e + 1.0) * c * c - 1.0) / sqr(e * c + g);
        let r = (0.5 * (rs * rs + rp * rp)).min(1.0);
        if self.m == 0.0 { 0.0 } else { r }
    }
}

/// Reflected power of a conductor with complex index `η + ik` (relative to the outside) at cosine `c`, per channel
/// [Born and Wolf 1999, §14.2; in the real form of Gulbrandsen's and Lagarde's notes].
#[inline(always)]
pub fn fresnel_conductor(c: f32, eta: Rgb, k: Rgb) -> Rgb {
    eta.zip(k, |eta, k| fresnel_conductor_1(c, eta, k))
}

#[inline(always)]
fn fresnel_conductor_1(c: f32, eta: f32, k: f32) -> f32 {
    let c_sq = c * c;
    let s_sq = (1.0 - c_sq).max(0.0);
    // a² + b² and a, where (a + ib)² = (η + ik)² − sin²θ.
    let t = eta * eta - k * k - s_sq;
    let ab = (t * t + 4.0 * eta * eta * k * k).sqrt();
    let a = safe_sqrt(0.5 * (ab + t));
    let twice = 2.0 * a * c;
    let ratio = |x: f32, y: f32| if x + y > 0.0 { (x - y) / (x + y) } else { 1.0 };
    let rs = ratio(ab + c_sq, twice);
    let rp = rs * ratio(c_sq * ab + s_sq * s_sq, twice * s_sq);
    (0.5 * (rs + rp)).clamp(0.0, 1.0)
}

/// Hemispherical reflectance of the interface under diffuse illumination, `2∫R(μ)μ dμ`; index ratio `eta` as seen from
/// the illuminated side.
pub fn diffuse_reflectance(eta: f64) -> f64 {
    if eta == 1.0 {
        return 0.0;
    }
    if eta < 1.0 {
        // The power that enters is the same from both sides, but for the étendue [Egan and Hilgeman 1979].
        return 1.0 - (1.0 - diffuse_reflectance(1.0 / eta)) * eta * eta;
    }
    // μ = x³ spreads the steep end at grazing; Simpson's rule.
    const STEPS: usize = 2000;
    let m = (eta - 1.0) * (eta + 1.0);
    let f = |x: f64| {
        let c = x * x * x;
        let g = (c * c + m).sqrt();
        let e = eta * eta;
        let rs = m / ((c + g) * (c + g));
        let rp = m * ((e + 1.0) * c * c - 1.0) / ((e * c + g) * (e * c + g));
        (rs * rs + rp * rp) * c * 3.0 * x * x
    };
    let h = 1.0 / STEPS as f64;
    let sum: f64 = (1..STEPS).map(|i| f(i as f64 * h) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
    (sum + f(0.0) + f(1.0)) * h / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn r(n: f64, cos: f64) -> f64 {
        Ior::new(n, 1.0).fresnel(cos as f32).r as f64
    }

    fn close(a: f64, b: f64, tolerance: f64) {
        assert!((a - b).abs() <= tolerance, "{a} is not {b} ± {tolerance}");
    }

    #[test]
    fn grazing_reflectance_of_glass() {
        for (deg, want) in [(85.0, 0.612800), (89.0, 0.904185), (89.9, 0.989912), (89.99, 0.998986), (89.999, 0.999899)]
        {
            close(r(1.5, f64::to_radians(deg).cos()), want, 1.5e-6);
        }
    }

    #[test]
    fn normal_reflectance_of_extreme_indices() {
        for (n, want) in [(1.000001, 2.5e-13), (1.0003, 2.249e-8), (2.42, 0.172395), (4.0, 0.36), (1000.0, 0.996008)] {
            close(r(n, 1.0) / want, 1.0, 3e-4);
            close(Ior::new(n, 1.0).flipped().fresnel(1.0).r as f64 / want, 1.0, 3e-4);
        }
        // An interface between equal media does not exist, at any angle.
        for c in [1.0, 0.5, 1e-3, 1e-20, 0.0] {
            assert_eq!(r(1.0, c), 0.0);
        }
    }

    #[test]
    fn nearly_equal_media_keep_their_digits() {
        // Against the textbook form in f64.
        for n in [1.0 + 1e-3, 1.0 + 1e-5, 1.0 - 1e-5, 1.0 + 1e-7] {
            for c in [1.0, 0.7, 0.3, 0.05] {
                let g = f64::sqrt(c * c + n * n - 1.0);
                let (s, p) = ((c - g) / (c + g), (n * n * c - g) / (n * n * c + g));
                // The r_p factor has a zero near Brewster's angle, so the tolerance is relative to the s part.
                close(r(n, c), 0.5 * (s * s + p * p), 3e-6 * s * s + 1e-7 * 0.5 * (s * s + p * p));
            }
        }
    }

    #[test]
    fn total_reflection_starts_at_the_critical_angle() {
        let inside = Ior::new(1.5, 1.0).flipped();
        let c = f64::sqrt(1.0 - 1.0 / 2.25);
        assert_eq!(inside.fresnel((c - 1e-6) as f32).r, 1.0);
        let just_above = inside.fresnel((c + 1e-6) as f32);
        assert!(just_above.r < 1.0 && just_above.r > 0.97 && just_above.g > 0.0, "{just_above:?}");
        // Continuous from above: 1 − R shrinks like √(c − cc).
        let mut last = 0.0;
        for i in 0..1000 {
            let t = 1.0 - inside.fresnel((c + i as f64 * 1e-5) as f32).r;
            assert!(t >= last - 2e-3 && t <= 1.0);
            last = t;
        }
    }

    #[test]
    fn diffuse_reflectance_of_three_interfaces() {
        for (n, ext, int) in [(1.33, 0.065931, 0.471949), (1.5, 0.091778, 0.596346), (2.42, 0.212541, 0.865539)] {
            close(diffuse_reflectance(n), ext, 6e-7);
            close(diffuse_reflectance(1.0 / n), int, 6e-7);
        }
        assert_eq!(diffuse_reflectance(1.0), 0.0);
        close(diffuse_reflectance(1.0 + 1e-9), 0.0, 1e-8);
    }

    #[test]
    fn conductor_matches_the_dielectric_without_absorption_and_the_complex_formula_with() {
        for c in [1.0f32, 0.6, 0.1, 1e-3, 0.0] {
            let d = Ior::new(1.7, 1.0).fresnel(c).r;
            assert!((fresnel_conductor_1(c, 1.7, 0.0) - d).abs() < 2e-6, "{c}");
            assert!((fresnel_conductor_1(c, 0.0, 1.0) - 1.0).abs() < 1e-6);
        }
        // Normal incidence: ((η−1)² + k²)/((η+1)² + k²).
        for (e, k) in [(0.2f32, 3.9f32), (1.5, 7.0), (0.05, 1.5)] {
            let want = ((e - 1.0) * (e - 1.0) + k * k) / ((e + 1.0) * (e + 1.0) + k * k);
            assert!((fresnel_conductor_1(1.0, e, k) - want).abs() < 1e-6);
            assert!((fresnel_conductor_1(0.0, e, k) - 1.0).abs() < 1e-6);
        }
    }
}
