//! Microfacet normal distributions with Smith's shadowing, sampled by visible normals.
//!
//! Directions are local with the macroscopic normal along +z. The shadowing of the two directions is taken as
//! independent, as Mitsuba does, so that pictures agree.

use glam::{Vec2, Vec3};

use crate::math::{INV_PI, safe_sqrt, sin_cos_turns};

/// Shape of a normal distribution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Distribution {
    /// Gaussian slopes [Beckmann and Spizzichino 1963].
    #[default]
    Beckmann,
    /// Long-tailed [Trowbridge and Reitz 1975; Walter et al. 2007].
    Ggx,
}

/// A normal distribution with its roughness along the tangent and the bitangent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Microfacet {
    pub distribution: Distribution,
    pub ax: f32,
    pub ay: f32,
}

impl Microfacet {
    /// Density of microfacet area per steradian around `m`: `D(m)`.
    #[inline(always)]
    pub fn d(&self, m: Vec3) -> f32 {
        if m.z <= 0.0 {
            return 0.0;
        }
        let (x, y) = (m.x / self.ax, m.y / self.ay);
        let scale = INV_PI / (self.ax * self.ay);
        let z_sq = m.z * m.z;
        match self.distribution {
            Distribution::Ggx => {
                let t = x * x + y * y + z_sq;
                scale / (t * t)
            }
            Distribution::Beckmann => {
                let e = (-(x * x + y * y) / z_sq).exp();
                if e > 0.0 { scale * e / (z_sq * z_sq) } else { 0.0 }
            }
        }
    }

    /// `G₁(v)/|cos θ_v|` [Heitz 2014, eqs. 43 and 72–80], finite down to the horizon.
    #[inline(always)]
    pub fn g1_over_cos(&self, v: Vec3) -> f32 {
        let z = v.z.abs();
        let s_sq = (self.ax * v.x) * (self.ax * v.x) + (self.ay * v.y) * (self.ay * v.y);
        match self.distribution {
            // z(1 + Λ) = (z + √(z² + s²))/2
            Distribution::Ggx => 2.0 / (z + (z * z + s_sq).sqrt()),
            // z(1 + Λ) = z + s e^{−a²}/(2√π) − z erfc(a)/2 with a = z/s
            Distribution::Beckmann => {
                let s = s_sq.sqrt();
                if z > 6.0 * s {
                    return 1.0 / z;
                }
                let a = z / s;
                1.0 / (z + s * (-a * a).exp() * HALF_INV_SQRT_PI - 0.5 * z * erfc(a as f64) as f32)
            }
        }
    }

    /// Share of the facets facing `v` that `v` sees; 0 if `m` faces away from it.
    #[inline(always)]
    pub fn g1(&self, v: Vec3, m: Vec3) -> f32 {
        if v.dot(m) * v.z > 0.0 { (self.g1_over_cos(v) * v.z.abs()).min(1.0) } else { 0.0 }
    }

    /// A normal among those that `wo` (`wo.z > 0`) sees; its density is `G₁(wo) D(m) (wo·m)/cos θo`.
    #[inline]
    pub fn sample_visible(&self, wo: Vec3, u: Vec2) -> Vec3 {
        match self.distribution {
            Distribution::Ggx => self.sample_visible_ggx(wo, u),
            Distribution::Beckmann => self.stretched(wo, |v| sample_beckmann(v, u)),
        }
    }

    /// [`Microfacet::sample_visible`] of GGX.
    #[inline(always)]
    pub fn sample_visible_ggx(&self, wo: Vec3, u: Vec2) -> Vec3 {
        self.stretched(wo, |v| sample_ggx(v, u))
    }

    /// A normal seen from `wo`, given how to sample one of unit roughness.
    #[inline(always)]
    fn stretched(&self, wo: Vec3, sample: impl Fn(Vec3) -> Vec3) -> Vec3 {
        let m = sample(Vec3::new(self.ax * wo.x, self.ay * wo.y, wo.z).normalize());
        Vec3::new(self.ax * m.x, self.ay * m.y, m.z).normalize()
    }

    /// The roughness that decides the class of a lobe: the smaller one.
    #[inline]
    pub fn sharpness(&self) -> f32 {
        self.ax.min(self.ay)
    }
}

/// Visible normal of the unit hemisphere: reflection of a point in a spherical cap [Dupuy and Benyoub 2023].
#[inline(always)]
fn sample_ggx(v: Vec3, u: Vec2) -> Vec3 {
    // A point on the cap z > −v.z, uniform in area.
    let z = (1.0 - u.y) * (1.0 + v.z) - v.z;
    let r = safe_sqrt((1.0 - z) * (1.0 + z));
    let (sin, cos) = sin_cos_turns(u.x);
    let cap = Vec3::new(r * cos, r * sin, z);
    let h = cap + v;
    Vec3::new(h.x, h.y, h.z.max(0.0))
}

const HALF_INV_SQRT_PI: f32 = 0.282_094_8;

/// Visible normal of the Beckmann distribution of unit roughness: slope along the view by inverting its distribution
/// function, the other slope is an independent Gaussian [Heitz and d'Eon 2014, §3 and supplemental].
fn sample_beckmann(v: Vec3, u: Vec2) -> Vec3 {
    let (cos, sin) = (v.z as f64, f64::hypot(v.x as f64, v.y as f64));
    let along = sample_visible_gaussian_slope(cos, sin, u.x as f64) as f32;
    let across = erf_inv(2.0 * u.y - 1.0);
    // Rotate to the azimuth of the view.
    let azimuth = if sin > 1e-20 { Vec2::new(v.x, v.y) / sin as f32 } else { Vec2::X };
    let slope = along * azimuth + across * Vec2::new(-azimuth.y, azimuth.x);
    Vec3::new(-slope.x, -slope.y, 1.0).normalize()
}

/// The slope `x < cot θ` with density in proportion to `(cos θ − x sin θ) e^{−x²}`.
///
/// Its integral up to x is `cos θ erfc(−x)/2 + sin θ e^{−x²}/(2√π)`; Newton steps inside a shrinking bracket.
fn sample_visible_gaussian_slope(cos: f64, sin: f64, u: f64) -> f64 {
    const LIMIT: f64 = 6.0;
    let integral = |x: f64, e: f64| cos * 0.5 * erfc(-x) + sin * HALF_INV_SQRT_PI as f64 * e;
    let top = if cos < LIMIT * sin { cos / sin } else { LIMIT };
    let target = u * integral(top, (-top * top).exp());
    let (mut low, mut high) = (-LIMIT, top);
    let mut x =
        (erf_inv((2.0 * u - 1.0).clamp(-0.999_999, 0.999_999) as f32) as f64).min(0.5 * (low + high).max(top - 1.0));
    for _ in 0..40 {
        if !(x > low && x < high) {
            x = 0.5 * (low + high);
        }
        let e = (-x * x).exp();
        let excess = integral(x, e) - target;
        if excess > 0.0 {
            high = x;
        } else {
            low = x;
        }
        let density = (cos - x * sin) * e * 2.0 * HALF_INV_SQRT_PI as f64;
        let step = excess / density;
        x -= step;
        if step.abs() < 1e-7 || high - low < 1e-7 {
            break;
        }
    }
    x.clamp(low, high)
}

/// Complementary error function, relative error below 1.2e-7 [Press et al., "Numerical Recipes", §6.2].
pub(super) fn erfc(x: f64) -> f64 {
    const C: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let t = 1.0 / (1.0 + 0.5 * x.abs());
    let poly = C.iter().rev().fold(0.0, |acc, c| acc * t + c);
    let tail = t * (poly - x * x).exp();
    if x >= 0.0 { tail } else { 2.0 - tail }
}

/// Inverse error function, single precision [Giles 2012, "Approximating the erfinv function", table 5].
fn erf_inv(x: f32) -> f32 {
    let w = -((1.0 - x) * (1.0 + x)).max(1e-30).ln();
    const CENTRE: [f32; 9] = [
        2.810_226_4e-8,
        3.432_739_4e-7,
        -3.523_387_7e-6,
        -4.391_506_5e-6,
        0.000_218_580_87,
        -0.001_253_725,
        -0.004_177_681_6,
        0.246_640_73,
        1.501_409_4,
    ];
    const TAIL: [f32; 9] = [
        -0.000_200_214_26,
        0.000_100_950_56,
        0.001_349_343_2,
        -0.003_673_428_4,
        0.005_739_507_7,
        -0.007_622_461_3,
        0.009_438_870_5,
        1.001_674,
        2.832_976_8,
    ];
    let (w, c) = if w < 5.0 { (w - 2.5, &CENTRE) } else { (w.sqrt() - 3.0, &TAIL) };
    x * c.iter().fold(0.0, |acc, c| acc * w + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [Distribution; 2] = [Distribution::Beckmann, Distribution::Ggx];

    #[test]
    fn error_functions_match_known_values() {
        for (x, want) in
            [(0.0, 1.0), (0.5, 0.479_500_122), (1.0, 0.157_299_207), (2.0, 0.004_677_735), (-1.0, 1.842_700_793)]
        {
            assert!((erfc(x) / want - 1.0).abs() < 2e-7, "{x}");
        }
        for x in [-2.5f64, -0.7, 0.0, 0.1, 1.3, 3.0] {
            let back = erf_inv((1.0 - erfc(x)) as f32) as f64;
            // Near ±1 the argument itself has few digits: derivative e^{x²}√π/2 times the rounding of the argument.
            assert!((back - x).abs() < 2e-6 + 1e-7 * (x * x).exp(), "{x} {back}");
        }
    }

    /// Projected area ∫ D(m) cos θ dm = 1 and visible area ∫ G₁ D ⟨wo·m⟩ dm = cos θo, by midpoint rule in slopes.
    #[test]
    fn normals_are_normalised_and_shadowing_conserves_visible_area() {
        for distribution in BOTH {
            for (ax, ay) in [(0.3, 0.3), (0.1, 0.6), (1.0, 1.0)] {
                let f = Microfacet { distribution, ax, ay };
                for wo in [Vec3::new(0.0, 0.6, 0.8), Vec3::new(0.9, 0.3, 0.1).normalize(), Vec3::Z] {
                    let (mut area, mut visible) = (0.0f64, 0.0f64);
                    let n = 1500;
                    for i in 0..n {
                        // cos² θ = uniform after tan²θ = α² q/(1−q): equal shares of the GGX distribution.
                        // A square spreads the long tail of slopes, which sees the most.
                        let t = 1.0 - (i as f64 + 0.5) / n as f64;
                        let q = 1.0 - t * t;
                        for j in 0..256 {
                            let phi = (j as f64 + 0.5) / 256.0 * std::f64::consts::TAU;
                            let r = (q / (1.0 - q)).sqrt();
                            let (sx, sy) = (ax as f64 * r * phi.cos(), ay as f64 * r * phi.sin());
                            let z = 1.0 / (1.0 + sx * sx + sy * sy).sqrt();
                            let m = Vec3::new((sx * z) as f32, (sy * z) as f32, z as f32);
                            // Projected solid angle of this share: D_ggx cos dm = 1/(256 n).
                            let ggx = Microfacet { distribution: Distribution::Ggx, ax, ay };
                            let share = 2.0 * t / (256.0 * n as f64) / ggx.d(m) as f64 * f.d(m) as f64;
                            area += share;
                            visible += share / z * f.g1(wo, m) as f64 * wo.dot(m).max(0.0) as f64;
                        }
                    }
                    assert!((area - 1.0).abs() < 1e-4, "{f:?} {area}");
                    assert!((visible / wo.z as f64 - 1.0).abs() < 3e-3, "{f:?} {wo} {visible}");
                }
            }
        }
    }

    #[test]
    fn shadowing_is_finite_down_to_the_horizon() {
        for distribution in BOTH {
            for a in [1e-4, 0.1, 1.0] {
                let f = Microfacet { distribution, ax: a, ay: a };
                for z in [1.0f32, 1e-3, 1e-10, 1e-30, 0.0] {
                    let v = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
                    let g = f.g1_over_cos(v);
                    assert!(g.is_finite() && g > 0.0, "{f:?} {z} {g}");
                    let m = f.sample_visible(v, Vec2::new(0.3, 0.99999));
                    assert!(m.is_finite() && m.z >= 0.0 && (m.length() - 1.0).abs() < 1e-5, "{f:?} {z} {m}");
                }
            }
        }
    }
}
