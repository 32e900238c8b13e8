//! Kernels of the density estimate, each with integral 1 over the disc of its radius.
//!
//! With a fixed radius the estimate is `Σ f·Φ·K(d², r²)` over the photons within. With the k nearest photons the radius is
//! that of the k-th, a random number: the photons nearer than it are then independent and uniform in the disc, and
//! `E[(k − 1)/(π r_k²)]` is the density. So the k-th photon gives the radius and nothing else, which
//! [`Kernel::nearest_weight`] does; dividing by k instead is biased by k/(k − 1).

use crate::math::DVec2;
use std::f32::consts::PI;

/// Jensen's α of the Gaussian filter.
pub const GAUSSIAN_ALPHA: f32 = 0.918;
/// Jensen's β of the Gaussian filter.
pub const GAUSSIAN_BETA: f32 = 1.953;

/// How a photon's power is spread over the disc.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Kernel {
    /// The same everywhere: `1 / (π r²)` [Jensen 2001, eq. 7.6].
    Disc,
    /// Falling linearly, `(1 − d/(k r)) / ((1 − 2/(3k)) π r²)` with the filter constant `k ≥ 1` [Jensen 2001, eq. 7.7].
    Cone(f32),
    /// `α (1 − (1 − e^(−β d²/2r²)) / (1 − e^−β))` [Jensen 2001, eq. 7.9], divided by its integral, so that α cancels: as
    /// printed it holds only 53 % of the power.
    Gaussian,
    /// `2 (1 − d²/r²) / (π r²)`, of least error at its own best radius [Epanechnikov 1969].
    #[default]
    Epanechnikov,
    /// `3 (1 − d²/r²)² / (π r²)`: its slope vanishes at the rim.
    Biweight,
}

impl Kernel {
    /// The kernel's value in m⁻² at the squared distance `d_sq ≤ r_sq`; 0 beyond.
    #[inline]
    pub fn weight(self, d_sq: f32, r_sq: f32) -> f32 {
        if d_sq > r_sq || r_sq <= 0.0 {
            return 0.0;
        }
        let s = d_sq / r_sq;
        let shape = match self {
            Self::Disc => 1.0,
            Self::Cone(k) => (1.0 - s.sqrt() / k) / (1.0 - 2.0 / (3.0 * k)),
            Self::Gaussian => gaussian(s) / GAUSSIAN_MEAN,
            Self::Epanechnikov => 2.0 * (1.0 - s),
            Self::Biweight => 3.0 * (1.0 - s) * (1.0 - s),
        };
        shape / (PI * r_sq)
    }

    /// The kernel's value when `r_sq` is the squared distance of the k-th nearest photon: that photon itself gets 0.
    #[inline]
    pub fn nearest_weight(self, d_sq: f32, r_sq: f32) -> f32 {
        if d_sq < r_sq { self.weight(d_sq, r_sq) } else { 0.0 }
    }

    /// Where in the disc to look: `s = d²/r²` from a uniform number, with a weight proportional to the kernel over the density
    /// of `s`.
    #[inline]
    pub fn radial(self, u: f32) -> (f32, f32) {
        match self {
            Self::Epanechnikov => (1.0 - (1.0 - u).sqrt(), 1.0),
            _ => (u, PI * self.weight(u, 1.0)),
        }
    }

    /// `∫ K² dA · π r²`, the variance of an estimate relative to that of the disc: 1 for the disc.
    pub fn roughness(self) -> f32 {
        match self {
            Self::Disc => 1.0,
            Self::Cone(k) => (1.0 - 4.0 / (3.0 * k) + 0.5 / (k * k)) / (1.0 - 2.0 / (3.0 * k)).powi(2),
            Self::Gaussian => {
                // Midpoint rule in s = d²/r², which is uniform over the disc.
                let mean_square = (0..256).map(|i| gaussian((i as f32 + 0.5) / 256.0).powi(2)).sum::<f32>() / 256.0;
                mean_square / (GAUSSIAN_MEAN * GAUSSIAN_MEAN)
            }
            Self::Epanechnikov => 4.0 / 3.0,
            Self::Biweight => 9.0 / 5.0,
        }
    }
}

/// Jensen's Gaussian filter as printed, at `s = d²/r²`.
#[inline]
fn gaussian(s: f32) -> f32 {
    GAUSSIAN_ALPHA * (1.0 - -(-0.5 * GAUSSIAN_BETA * s).exp_m1() / GAUSSIAN_RANGE)
}

/// `1 − e^−β`.
const GAUSSIAN_RANGE: f32 = 0.858_152_1;
/// Mean of [`gaussian`] over the disc: `α (1 − (1 − (1 − e^(−β/2))/(β/2)) / (1 − e^−β))`.
const GAUSSIAN_MEAN: f32 = 0.531_154_9;

/// The convex hull of points in a plane.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hull {
    /// m²; 0 with fewer than three points.
    pub area: f64,
    /// Indices of the points at its corners.
    pub vertices: Vec<u32>,
}

/// The convex hull of points in a plane.
///
/// Instead of the disc's `π r²`, the area the photons really cover: at borders and in corners it does not darken
/// [Jensen 2001, section 7.1].
pub fn convex_hull(points: &[DVec2]) -> Hull {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    let at = |i: u32| points[i as usize];
    order.sort_unstable_by(|&a, &b| at(a).x.total_cmp(&at(b).x).then(at(a).y.total_cmp(&at(b).y)).then(a.cmp(&b)));
    // Monotone chains [Andrew 1979]: the lower one from left to right and the upper one back.
    let (mut vertices, upper) = (chain(points, order.iter()), chain(points, order.iter().rev()));
    let sum = shoelace(points, &vertices) + shoelace(points, &upper);
    // The two chains share their ends.
    vertices.extend(upper.get(1..upper.len().saturating_sub(1)).unwrap_or_default());
    Hull { area: 0.5 * sum.abs(), vertices }
}

/// The points of the chain that turns left only.
fn chain<'a>(points: &[DVec2], order: impl Iterator<Item = &'a u32>) -> Vec<u32> {
    let mut hull: Vec<u32> = Vec::new();
    for &i in order {
        let p = points[i as usize];
        while let [.., a, b] = hull[..] {
            let (a, b) = (points[a as usize], points[b as usize]);
            if (b - a).perp_dot(p - b) > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push(i);
    }
    hull
}

/// `Σ a × b` over the edges of a chain, relative to its first point, so that no digits cancel far from the origin.
fn shoelace(points: &[DVec2], chain: &[u32]) -> f64 {
    let at = |i: u32| points[i as usize] - points[chain[0] as usize];
    chain.windows(2).map(|e| at(e[0]).perp_dot(at(e[1]))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::mix64;

    const ALL: [Kernel; 7] = [
        Kernel::Disc,
        Kernel::Cone(1.0),
        Kernel::Cone(1.1),
        Kernel::Cone(3.0),
        Kernel::Gaussian,
        Kernel::Epanechnikov,
        Kernel::Biweight,
    ];

    fn uniform(i: u64) -> f64 {
        (mix64(i) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// ∫ f(d²) dA over the disc by the midpoint rule in d.
    fn integrate(r: f64, f: impl Fn(f32) -> f32) -> f64 {
        let n = 20_000;
        let h = r / f64::from(n);
        (0..n)
            .map(|i| (f64::from(i) + 0.5) * h)
            .map(|d| f64::from(f((d * d) as f32)) * std::f64::consts::TAU * d * h)
            .sum()
    }

    #[test]
    fn every_kernel_integrates_to_one() {
        for kernel in ALL {
            for r in [1e-3, 0.7, 1.0, 25.0] {
                let r_sq = (r * r) as f32;
                let one = integrate(r, |d_sq| kernel.weight(d_sq, r_sq));
                assert!((one - 1.0).abs() < 2e-6, "{kernel:?}, r = {r}: {one}");
                let square = integrate(r, |d_sq| kernel.weight(d_sq, r_sq).powi(2)) * std::f64::consts::PI * r * r;
                assert!((square / f64::from(kernel.roughness()) - 1.0).abs() < 1e-4, "{kernel:?}: {square}");
            }
            assert_eq!(kernel.weight(1.01, 1.0), 0.0);
            assert_eq!(kernel.weight(0.0, 0.0), 0.0);
        }
    }

    #[test]
    fn the_nearest_k_give_the_density_without_bias() {
        // 4000 photons, uniform in a square, seen from its middle; k = 10, 4000 maps. The relative σ of one estimate is at
        // most √(roughness/(k − 2)) < 0.6, so the mean has 0.0095; k in the place of k − 1 would be off by 0.11.
        let (n, k, maps) = (400, 10, 4000u64);
        let mut means = [0f64; ALL.len()];
        for m in 0..maps {
            let mut d_sq: Vec<f32> = (0..n)
                .map(|i| {
                    let key = (m * n + i) * 2;
                    let (x, y) = (uniform(key) - 0.5, uniform(key + 1) - 0.5);
                    (x * x + y * y) as f32
                })
                .collect();
            d_sq.sort_unstable_by(f32::total_cmp);
            for (mean, kernel) in means.iter_mut().zip(ALL) {
                let sum: f32 = d_sq[..k].iter().map(|&d| kernel.nearest_weight(d, d_sq[k - 1])).sum();
                *mean += f64::from(sum) / (n * maps) as f64;
            }
        }
        for (mean, kernel) in means.iter().zip(ALL) {
            assert!((mean - 1.0).abs() < 4.0 * 0.0095, "{kernel:?}: {mean}");
        }
    }

    #[test]
    fn hulls_of_known_shapes() {
        let mut square: Vec<DVec2> = (0..500).map(|i| DVec2::new(uniform(2 * i), uniform(2 * i + 1))).collect();
        square.extend([DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE, DVec2::ONE]);
        let hull = convex_hull(&square);
        assert!((hull.area - 1.0).abs() < 1e-12);
        let mut corners = hull.vertices.clone();
        corners.sort_unstable();
        // The last two points are the same corner.
        assert!(corners.len() == 4 && corners[..3] == [500, 501, 502] && corners[3] >= 503, "{corners:?}");
        let circle: Vec<DVec2> = (0..360).map(|i| 1e6 + 2.0 * DVec2::from_angle(f64::from(i).to_radians())).collect();
        let expected = 0.5 * 360.0 * 4.0 * 1f64.to_radians().sin();
        assert!((convex_hull(&circle).area / expected - 1.0).abs() < 1e-8);
        let line: Vec<DVec2> = (0..10).map(|i| DVec2::new(f64::from(i), 2.0 * f64::from(i))).collect();
        assert!(convex_hull(&line).area.abs() < 1e-12);
        assert_eq!(convex_hull(&[DVec2::ONE; 7]).area, 0.0);
        assert_eq!(convex_hull(&[]), Hull::default());
    }
}
