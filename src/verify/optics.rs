//! Formulas of optics and radiative exchange, in f64, on the reference side.

use std::f64::consts::PI;

/// Reflectance of a smooth dielectric of relative index `n` for unpolarised light at cosine `c` [Born and Wolf 1999, §1.5.2].
pub fn fresnel(n: f64, c: f64) -> f64 {
    let g_sq = n * n - 1.0 + c * c;
    if g_sq <= 0.0 {
        return 1.0;
    }
    let g = g_sq.sqrt();
    // r_s = (c − g)/(c + g) with c − g = −(n² − 1)/(c + g); r_p likewise, which keeps the digits near n = 1.
    let m = (n - 1.0) * (n + 1.0);
    let s = m / (c + g).powi(2);
    let p = m * ((n * n + 1.0) * c * c - 1.0) / (n * n * c + g).powi(2);
    0.5 * (s * s + p * p)
}

/// Transmittance of a lossless slab, all internal reflections summed: `T = (1 − R)²/(1 − R²) = (1 − R)/(1 + R)`.
pub fn slab(n: f64, c: f64) -> f64 {
    let r = fresnel(n, c);
    (1.0 - r) / (1.0 + r)
}

/// Reflectance of the slab under diffuse light, `∫ (1 − T(μ)) 2μ dμ`.
pub fn diffuse_slab_reflectance(n: f64) -> f64 {
    integrate(0.0, 1.0, |u| {
        // μ = u³ spreads the steep end at grazing.
        let c = u * u * u;
        (1.0 - slab(n, c)) * 2.0 * c * 3.0 * u * u
    })
}

/// `∫ f` over [a, b]: 1024 panels of Gauss's four-point rule.
pub fn integrate(a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
    const PANELS: usize = 1024;
    const POINTS: [(f64, f64); 2] =
        [(0.339_981_043_584_856_3, 0.652_145_154_862_546_1), (0.861_136_311_594_052_6, 0.347_854_845_137_453_86)];
    let h = 0.5 * (b - a) / PANELS as f64;
    let panel = |i: usize| {
        let middle = a + h * (2 * i + 1) as f64;
        POINTS.iter().map(|(x, w)| w * (f(middle - h * x) + f(middle + h * x))).sum::<f64>()
    };
    h * (0..PANELS).map(panel).sum::<f64>()
}

/// Form factor from a surface element to a rectangle a × b at distance `h`, one of whose corners lies straight above it
/// [Howell, Menguc, Daun, Siegel 2020, C.1: B-4].
pub fn corner_factor(a: f64, b: f64, h: f64) -> f64 {
    let (x, y) = (a / h, b / h);
    let part = |x: f64, y: f64| x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan();
    (part(x, y) + part(y, x)) / (2.0 * PI)
}

/// Form factor between equal opposite rectangles with sides `x`, `y` in units of their distance [Howell C-11].
pub fn parallel_factor(x: f64, y: f64) -> f64 {
    let (xx, yy) = (1.0 + x * x, 1.0 + y * y);
    let log = 0.5 * (xx * yy / (1.0 + x * x + y * y)).ln();
    let a = x * yy.sqrt() * (x / yy.sqrt()).atan() + y * xx.sqrt() * (y / xx.sqrt()).atan();
    2.0 / (PI * x * y) * (log + a - x * x.atan() - y * y.atan())
}

/// Form factor between unit squares at right angles with a common edge [Howell C-14 with H = W = 1].
pub fn perpendicular_factor() -> f64 {
    let root = 2f64.sqrt();
    let logs = (4.0f64 / 3.0).ln() + 2.0 * (3.0f64 / 4.0).ln();
    (2.0 * 1f64.atan() - root * (1.0 / root).atan() + 0.25 * logs) / PI
}

/// Form factor between coaxial discs of radii `r1`, `r2` at distance `h`, from the first to the second [Howell C-41].
pub fn disc_factor(r1: f64, r2: f64, h: f64) -> f64 {
    let (a, b) = (r1 / h, r2 / h);
    let s = 1.0 + (1.0 + b * b) / (a * a);
    0.5 * (s - (s * s - 4.0 * (b / a).powi(2)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64, tolerance: f64) {
        assert!((a - b).abs() <= tolerance * b.abs(), "{a} is not {b}");
    }

    /// Against published values.
    #[test]
    fn formulas_give_the_numbers_in_the_books() {
        close(4.0 * corner_factor(0.5, 0.5, 1.0), 0.239456470, 1e-8);
        close(parallel_factor(1.0, 1.0), 0.199824896, 1e-8);
        close(parallel_factor(10.0, 10.0), 0.826994522, 1e-8);
        close(parallel_factor(0.01, 0.01), 3.18288667e-5, 1e-8);
        close(perpendicular_factor(), 0.200043776, 1e-8);
        close(parallel_factor(1.0, 1.0) + 4.0 * perpendicular_factor(), 1.0, 1e-12);
        close(disc_factor(1.0, 1.0, 1.0), 0.381966011, 1e-8);
        for (deg, t) in
            [(0.0, 0.923077), (30.0, 0.920266), (45.0, 0.904327), (60.0, 0.836232), (80.0, 0.441229), (89.0, 0.050318)]
        {
            close(slab(1.5, f64::to_radians(deg).cos()), t, 1.2e-5);
        }
        close(diffuse_slab_reflectance(1.5), 0.155444, 1e-5);
    }
}
