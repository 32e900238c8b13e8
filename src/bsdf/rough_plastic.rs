use glam::{Vec2, Vec3};

use super::Ior;
use super::diffuse::Lambert;
use super::lobe::LobeSample;
use super::microfacet::Microfacet;
use super::rough::{coat_half_vector, reflect, reflection_pdf, refract_at, sample_coat};
use crate::color::Rgb;
use crate::math::safe_sqrt;
use crate::sample::warp;

/// The rough coat of a plastic.
#[derive(Clone, Copy, Debug)]
pub(super) struct RoughCoat {
    pub facets: Microfacet,
    pub ior: Ior,
    pub tint: Rgb,
}

impl RoughCoat {
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        match coat_half_vector(wo, wi) {
            Some(m) => {
                let r = self.ior.fresnel(wo.dot(m)).r;
                self.tint * (r * reflection_pdf(&self.facets, wo, m) * self.facets.g1(wi, m))
            }
            None => Rgb::BLACK,
        }
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        let (wi, m) = sample_coat(&self.facets, wo, u)?;
        let weight = self.tint * (self.ior.fresnel(wo.dot(m)).r * self.facets.g1(wi, m));
        Some(LobeSample::reflection(wi, weight, reflection_pdf(&self.facets, wo, m)))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.tint * self.ior.fresnel(wo.z).r } else { Rgb::BLACK }
    }
}

/// Coefficients of [`TransmittanceFit`].
const TERMS: usize = 10;

/// Power that a rough interface lets in from direction `cos θ`, as a Chebyshev series in `√cos θ`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TransmittanceFit([f32; TERMS]);

impl TransmittanceFit {
    /// Measures `facets` over an interface of index ratio `ior` seen from outside.
    pub fn measure(facets: &Microfacet, ior: Ior) -> Self {
        let angle = |i: usize| std::f64::consts::PI * (i as f64 + 0.5) / TERMS as f64;
        let values: [f64; TERMS] = std::array::from_fn(|i| {
            let s = 0.5 * (angle(i).cos() + 1.0);
            transmitted(facets, ior, (s * s) as f32)
        });
        Self(std::array::from_fn(|k| {
            let sum: f64 = (0..TERMS).map(|i| values[i] * (k as f64 * angle(i)).cos()).sum();
            (sum * if k == 0 { 1.0 } else { 2.0 } / TERMS as f64) as f32
        }))
    }

    /// Transmitted fraction at `cos θ` [Clenshaw 1955].
    #[inline]
    pub fn at(&self, cos: f32) -> f32 {
        let x = 2.0 * safe_sqrt(cos) - 1.0;
        let (mut b1, mut b2) = (0.0, 0.0);
        for &c in self.0[1..].iter().rev() {
            (b1, b2) = (2.0 * x * b1 - b2 + c, b1);
        }
        (x * b1 - b2 + self.0[0]).clamp(0.0, 1.0)
    }

    /// Hemispherical mean `2∫T(μ)μ dμ`.
    pub fn mean(&self) -> f32 {
        const N: usize = 256;
        let sum: f32 = (0..N).map(|i| (i as f32 + 0.5) / N as f32).map(|mu| 2.0 * mu * self.at(mu)).sum();
        sum / N as f32
    }
}

fn direction(cos: f32) -> Vec3 {
    Vec3::new(safe_sqrt((1.0 - cos) * (1.0 + cos)), 0.0, cos)
}

/// Mean of `f(m)` over the normals that a direction sees, `n²` of them.
fn mean_over_visible(facets: &Microfacet, wo: Vec3, n: u32, f: impl Fn(Vec3) -> f32) -> f64 {
    let cell = |i: u32| (i as f32 + 0.5) / n as f32;
    let mut sum = 0.0f64;
    for i in 0..n {
        for j in 0..n {
            sum += f(facets.sample_visible(wo, Vec2::new(cell(i), cell(j)))) as f64;
        }
    }
    sum / (n as f64 * n as f64)
}

/// Power that single scattering refracts through the interface.
pub(super) fn transmitted(facets: &Microfacet, ior: Ior, cos: f32) -> f64 {
    let wo = direction(cos.max(1e-6));
    mean_over_visible(facets, wo, 48, |m| {
        let c = wo.dot(m).max(0.0);
        let fresnel = ior.fresnel(c);
        if fresnel.g <= 0.0 {
            return 0.0;
        }
        let wi = refract_at(wo, m, ior, c, fresnel.g);
        if wi.z < 0.0 { (1.0 - fresnel.r) * facets.g1(wi, m) } else { 0.0 }
    })
}

/// Hemispherical reflectance of the rough interface seen from the side that `ior` is seen from: `2∫R(μ)μ dμ`.
pub(super) fn diffuse_rough_reflectance(facets: &Microfacet, ior: Ior) -> f32 {
    const N: usize = 48;
    let sum: f64 = (0..N)
        .map(|i| {
            let mu = (i as f32 + 0.5) / N as f32;
            let wo = direction(mu);
            let r = mean_over_visible(facets, wo, 48, |m| {
                let wi = reflect(wo, m);
                if wi.z > 0.0 { ior.fresnel(wo.dot(m).max(0.0)).r * facets.g1(wi, m) } else { 0.0 }
            });
            2.0 * mu as f64 * r
        })
        .sum();
    (sum / N as f64) as f32
}

/// The diffuse base under a rough coat: as [`PlasticBase`](super::plastic::PlasticBase) with the rough transmittances.
#[derive(Clone, Copy, Debug)]
pub(super) struct RoughBase {
    pub transmittance: TransmittanceFit,
    pub strength: Rgb,
    pub t_ext: f32,
}

impl RoughBase {
    #[inline]
    fn through(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.transmittance.at(wo.z) * self.transmittance.at(wi.z)
    }

    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let pdf = Lambert::pdf(wo, wi);
        if pdf > 0.0 { self.strength * (self.through(wo, wi) * pdf) } else { Rgb::BLACK }
    }

    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<LobeSample> {
        let wi = warp::cosine_hemisphere(u);
        let pdf = Lambert::pdf(wo, wi);
        (pdf > 0.0).then(|| LobeSample::reflection(wi, self.strength * self.through(wo, wi), pdf))
    }

    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if wo.z > 0.0 { self.strength * (self.transmittance.at(wo.z) * self.t_ext) } else { Rgb::BLACK }
    }
}

#[cfg(test)]
mod tests {
    use super::super::microfacet::Distribution;
    use super::*;

    #[test]
    fn fit_follows_the_measured_transmittance() {
        for distribution in [Distribution::Beckmann, Distribution::Ggx] {
            for a in [0.001, 0.03, 0.1, 0.3, 1.0] {
                for n in [1.01, 1.33, 1.49, 2.4] {
                    let facets = Microfacet { distribution, ax: a, ay: a };
                    let ior = Ior::new(n, 1.0);
                    let fit = TransmittanceFit::measure(&facets, ior);
                    for cos in [0.003f32, 0.02, 0.07, 0.2, 0.45, 0.7, 0.95, 1.0] {
                        let (got, want) = (fit.at(cos) as f64, transmitted(&facets, ior, cos));
                        assert!((got - want).abs() < 0.006, "{facets:?} {n} at {cos}: {got} {want}");
                    }
                }
            }
        }
    }
}
