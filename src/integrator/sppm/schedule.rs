//! How radii shrink from pass to pass.

/// The squared radius of pass `pass` (from 0 on) over that of pass 0, in the probabilistic schedule
/// [Knaus and Zwicker 2011, eq. 20]: `r²ᵢ₊₁/r²ᵢ = (i + α)/(i + 1)`, in closed form
/// `r²ᵢ/r²₁ = Γ(i + α) / (Γ(1 + α) Γ(i + 1))` for the i-th pass counted from 1.
///
/// The radius of a pass depends on nothing but its number, so passes may be made anywhere and in any order. With α = 2/3
/// the mean square error falls with the −2/3rd power of the passes, the most that a kernel over surfaces allows
/// [Kaplanyan and Dachsbacher 2013]; α = 1 keeps the radius.
pub fn radius_sq_ratio(pass: u64, alpha: f64) -> f64 {
    let i = pass as f64 + 1.0;
    (ln_gamma_ratio(i + 1.0, alpha - 1.0) - ln_gamma_ratio(2.0, alpha - 1.0)).exp()
}

/// `ln Γ(x + d) − ln Γ(x)` for x ≥ 2 and −1 ≤ d ≤ 0.
///
/// Stirling's series at arguments above 12, reached by the recurrence; the large terms are subtracted before they are
/// summed, so that nothing cancels for large x.
fn ln_gamma_ratio(mut x: f64, d: f64) -> f64 {
    let mut below = 0.0;
    while x < 12.0 {
        below += (d / x).ln_1p();
        x += 1.0;
    }
    let y = x + d;
    let tail = |x: f64| {
        let z = 1.0 / (x * x);
        (1.0 / 12.0 - z * (1.0 / 360.0 - z * (1.0 / 1260.0 - z / 1680.0))) / x
    };
    (y - 0.5) * (d / x).ln_1p() + d * x.ln() - d + tail(y) - tail(x) - below
}

/// The radius statistics that the passes of one pixel share [Hachisuka and Jensen 2009, eq. 8 and 10], for one photon map.
///
/// SPPM's running flux `τ` is not kept: scaling it by `R'²/R²` after each pass makes the final `τ/(N π R²)` the plain
/// average of what every pass found within the radius that it had, which is how the passes are added up anyway.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SharedRadius {
    /// Squared radius of the next pass, scene units.
    pub radius_sq: f32,
    /// Photons kept so far, `N`.
    pub photons: f32,
}

impl SharedRadius {
    /// Takes in the `found` photons of a pass: `N' = N + αM`, `R'² = R² N'/(N + M)`. A pass that found none changes nothing.
    pub fn update(&mut self, found: u32, alpha: f64) {
        if found == 0 {
            return;
        }
        let (n, m) = (self.photons as f64, found as f64);
        self.radius_sq = (self.radius_sq as f64 * ((n + alpha * m) / (n + m))) as f32;
        self.photons = (n + alpha * m) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closed_form_is_the_recurrence() {
        for alpha in [0.5, 2.0 / 3.0, 0.7, 0.75, 1.0] {
            let mut ratio = 1.0;
            for i in 1..=100_000u64 {
                if [1, 2, 3, 10, 100, 1000, 100_000].contains(&i) {
                    let r = radius_sq_ratio(i - 1, alpha);
                    assert!((r / ratio - 1.0).abs() < 1e-10, "α = {alpha}, pass {i}: {r} against {ratio}");
                }
                ratio *= (i as f64 + alpha) / (i as f64 + 1.0);
            }
        }
    }

    #[test]
    fn published_radii() {
        // r_i/r_1 after 10, 100 and 1000 passes.
        let table =
            [(2.0 / 3.0, [0.7131, 0.4883, 0.3328]), (0.7, [0.7388, 0.5255, 0.3722]), (0.75, [0.7786, 0.5863, 0.4399])];
        for (alpha, radii) in table {
            for (i, expected) in [10u64, 100, 1000].into_iter().zip(radii) {
                let r = radius_sq_ratio(i - 1, alpha).sqrt();
                assert!((r - expected).abs() < 6e-5, "α = {alpha}, i = {i}: {r} against {expected}");
            }
        }
    }

    #[test]
    fn shared_statistics_follow_their_closed_form_where_every_pass_finds_as_many() {
        // With M photons in πR² and density kept, pass i finds M R²ᵢ/R²₁; the radius then is that of the schedule above.
        for alpha in [2.0 / 3.0, 0.7] {
            let mut s = SharedRadius { radius_sq: 1.0, photons: 0.0 };
            let m = 1e6;
            for _ in 0..1000 {
                s.update((m * s.radius_sq).round() as u32, alpha);
            }
            // The first pass divides by its own photons alone: one factor α more than (i + α)/(i + 1) from i = 1 on.
            let expected = alpha * radius_sq_ratio(999, alpha);
            assert!((s.radius_sq as f64 / expected - 1.0).abs() < 0.01, "{} against {expected}", s.radius_sq);
        }
    }

    #[test]
    fn no_photons_change_nothing() {
        let mut s = SharedRadius { radius_sq: 0.25, photons: 7.0 };
        s.update(0, 0.7);
        assert_eq!(s, SharedRadius { radius_sq: 0.25, photons: 7.0 });
    }
}
