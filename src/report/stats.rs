//! The statistics behind the figures: quantiles, Student's t, straight lines through points.

/// The value below which the share `q` of the sorted values lies, by linear interpolation; NaN of nothing.
pub fn quantile(sorted: &[f64], q: f64) -> f64 {
    if sorted.is_empty() {
        return f64::NAN;
    }
    let at = q.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let (low, share) = (at.floor() as usize, at.fract());
    let high = (low + 1).min(sorted.len() - 1);
    sorted[low] * (1.0 - share) + sorted[high] * share
}

/// Lower quartile, median and upper quartile.
pub fn quartiles(values: impl IntoIterator<Item = f64>) -> [f64; 3] {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_unstable_by(f64::total_cmp);
    [0.25, 0.5, 0.75].map(|q| quantile(&sorted, q))
}

/// The probability that a variable with Student's t distribution of `dof` degrees of freedom is further from 0 than `t`.
pub fn student_two_sided(t: f64, dof: f64) -> f64 {
    if t.is_infinite() {
        return 0.0;
    }
    incomplete_beta(0.5 * dof, 0.5, dof / (dof + t * t))
}

/// The t that is exceeded in absolute value with probability `p`.
pub fn student_quantile(p: f64, dof: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    while student_two_sided(high, dof) > p && high < 1e12 {
        high *= 2.0;
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if student_two_sided(middle, dof) > p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// A mean with half the width of its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Interval {
    pub mean: f64,
    /// `None` of a single value.
    pub half_width: Option<f64>,
}

/// The mean of independent values and its 95 % interval by Student's t; `None` of nothing.
pub fn mean_interval(values: &[f64]) -> Option<Interval> {
    let n = values.len() as f64;
    if values.is_empty() {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n;
    let half_width = (values.len() > 1).then(|| {
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
        student_quantile(0.05, n - 1.0) * (variance / n).sqrt()
    });
    Some(Interval { mean, half_width })
}

/// The slope of the least-squares line through points; `None` unless they have two different abscissae.
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let sxx: f64 = points.iter().map(|p| (p.0 - mx) * (p.0 - mx)).sum();
    let sxy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    (sxx > 0.0).then(|| sxy / sxx)
}

/// I_x(a, b) by its continued fraction [Abramowitz & Stegun 1964, 26.5.8], evaluated by Lentz's method.
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    // The fraction converges fast below the mean; above it take the complement.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    let front = (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (1.0 - x).ln()).exp() / a;
    let term = |m: usize| {
        let k = (m / 2) as f64;
        if m.is_multiple_of(2) {
            k * (b - k) * x / ((a + 2.0 * k - 1.0) * (a + 2.0 * k))
        } else {
            -(a + k) * (a + b + k) * x / ((a + 2.0 * k) * (a + 2.0 * k + 1.0))
        }
    };
    let keep_off_zero = |v: f64| if v.abs() < 1e-300 { 1e-300 } else { v };
    // The first numerator is 1 and stands over the whole fraction, so that Lentz's C begins at infinity.
    let (mut f, mut c, mut d) = (1.0, f64::INFINITY, 1.0);
    for m in 1..500 {
        d = 1.0 / keep_off_zero(1.0 + term(m) * d);
        c = keep_off_zero(1.0 + term(m) / c);
        f *= c * d;
        if (c * d - 1.0).abs() < 1e-14 {
            break;
        }
    }
    front * f
}

/// ln Γ(x) for x > 0, by Stirling's series after moving x above 10 [Abramowitz & Stegun 1964, 6.1.40].
fn ln_gamma(x: f64) -> f64 {
    let (mut x, mut shift) = (x, 0.0);
    while x < 10.0 {
        shift -= x.ln();
        x += 1.0;
    }
    let r = 1.0 / (x * x);
    let series = (1.0 / 12.0 - r * (1.0 / 360.0 - r * (1.0 / 1260.0 - r / 1680.0))) / x;
    shift + (x - 0.5) * x.ln() - x + 0.5 * (2.0 * std::f64::consts::PI).ln() + series
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Table values of Student's t: 95 % and 99 % two-sided.
    #[test]
    fn quantiles_of_students_t() {
        for (p, dof, t) in [
            (0.05, 1.0, 12.706_2),
            (0.05, 4.0, 2.776_45),
            (0.10, 15.0, 1.753_05),
            (0.01, 10.0, 3.169_27),
            (0.05, 1e6, 1.959_97),
        ] {
            let found = student_quantile(p, dof);
            assert!((found - t).abs() < 2e-4, "p {p}, dof {dof}: {found}, expected {t}");
        }
        // One degree of freedom is Cauchy's distribution: P(|t| > 1) = 1/2.
        assert!((student_two_sided(1.0, 1.0) - 0.5).abs() < 1e-12);
        assert_eq!((student_two_sided(0.0, 7.0), student_two_sided(f64::INFINITY, 7.0)), (1.0, 0.0));
        assert!((ln_gamma(0.5) - 0.5 * std::f64::consts::PI.ln()).abs() < 1e-10);
    }

    #[test]
    fn quartiles_of_few() {
        assert_eq!(quartiles([3.0, 1.0, 2.0]), [1.5, 2.0, 2.5]);
        assert_eq!(quartiles([4.0]), [4.0; 3]);
        assert!(quartiles([])[1].is_nan());
    }

    #[test]
    fn lines_and_means() {
        assert_eq!(slope(&[(0.0, 1.0), (1.0, 0.0), (2.0, -1.0)]), Some(-1.0));
        assert_eq!(slope(&[(1.0, 1.0), (1.0, 2.0)]), None);
        assert_eq!(slope(&[]), None);
        let i = mean_interval(&[1.0, 3.0]).expect("two values");
        assert!((i.mean - 2.0).abs() < 1e-12 && (i.half_width.expect("two values") - 12.7062).abs() < 1e-3);
        assert_eq!(mean_interval(&[2.0]), Some(Interval { mean: 2.0, half_width: None }));
    }
}
