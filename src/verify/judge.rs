//! From measurements to verdicts.

use serde::Serialize;

/// Largest distance from the truth that noise explains, in standard errors.
pub const MAX_Z: f64 = 3.5;

/// Rounding that is allowed everywhere, relative: images are f32.
const ROUNDING: f64 = 1e-6;

/// Mean and standard error of the mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    pub mean: f64,
    pub error: f64,
}

impl Spread {
    /// Of independent values; the error of a single one is 0.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let v: Vec<f64> = values.into_iter().collect();
        let n = v.len() as f64;
        let mean = v.iter().sum::<f64>() / n;
        let squares = v.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
        Self { mean, error: if v.len() > 1 { (squares / (n - 1.0) / n).sqrt() } else { 0.0 } }
    }
}

/// How far a measurement may be from the truth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Judge {
    /// Largest relative difference, whatever the noise.
    pub relative: f64,
    /// Relative bias that the method declares; noise must explain the rest.
    pub bias: f64,
    /// Absolute difference that is always allowed.
    pub absolute: f64,
}

impl Judge {
    /// The distance from the truth beyond the declared bias, in standard errors.
    pub fn z(&self, expected: f64, s: &Spread) -> f64 {
        let slack = (self.bias + ROUNDING) * expected.abs() + self.absolute;
        let off = (s.mean - expected).abs() - slack;
        if off <= 0.0 {
            0.0
        } else if off.is_nan() {
            f64::NAN
        } else {
            off / s.error
        }
    }

    /// Whether the measurement is as near to the truth as it must be.
    pub fn accepts(&self, expected: f64, s: &Spread) -> bool {
        let limit = (self.relative.max(self.bias) + ROUNDING) * expected.abs() + self.absolute;
        self.z(expected, s) <= MAX_Z && (s.mean - expected).abs() <= limit
    }
}

/// What is said of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    Pass,
    Fail,
    /// Right, but later than its time limit.
    Slow,
    /// Not run: the program cannot do it yet.
    NotYet,
}

impl Verdict {
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Pass => "pass",
            Verdict::Fail => "FAIL",
            Verdict::Slow => "SLOW",
            Verdict::NotYet => "not yet",
        }
    }

    /// True when the run must not count as good.
    pub fn is_bad(self) -> bool {
        matches!(self, Verdict::Fail | Verdict::Slow)
    }
}

/// One line of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub case: &'static str,
    pub parameter: String,
    /// The integrator, or the part of the program that was asked.
    pub method: String,
    /// Empty where no rays are shot.
    pub accel: &'static str,
    pub expected: f64,
    pub measured: f64,
    pub standard_error: f64,
    /// `measured/expected − 1`; none for an expected 0.
    pub relative_error: Option<f64>,
    pub z: Option<f64>,
    pub verdict: Verdict,
    pub seconds: f64,
    /// Seconds that were allowed.
    pub limit: f64,
    pub note: String,
}

impl Row {
    /// A measurement against its truth.
    pub fn judge(
        case: &'static str,
        parameter: &str,
        method: &str,
        accel: &'static str,
        expected: f64,
        s: &Spread,
        judge: &Judge,
    ) -> Self {
        let z = judge.z(expected, s);
        Self {
            case,
            parameter: parameter.into(),
            method: method.into(),
            accel,
            expected,
            measured: s.mean,
            standard_error: s.error,
            relative_error: (expected != 0.0).then(|| s.mean / expected - 1.0),
            z: z.is_finite().then_some(z),
            verdict: if judge.accepts(expected, s) { Verdict::Pass } else { Verdict::Fail },
            seconds: 0.0,
            limit: f64::INFINITY,
            note: String::new(),
        }
    }

    /// A row that could not be measured because something failed.
    pub fn broken(case: &'static str, parameter: &str, accel: &'static str, why: &str) -> Self {
        let nothing = Spread { mean: f64::NAN, error: f64::NAN };
        Self::judge(case, parameter, "", accel, f64::NAN, &nothing, &Judge::default()).with_note(why)
    }

    /// A row of something that cannot be run yet.
    pub fn not_yet(case: &'static str, parameter: &str, why: &str) -> Self {
        Self { verdict: Verdict::NotYet, ..Self::broken(case, parameter, "", why) }
    }

    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        let note = note.into();
        if !note.is_empty() {
            self.note = if self.note.is_empty() { note } else { format!("{}; {note}", self.note) };
        }
        self
    }

    /// Says how long it took, which belongs to the verdict.
    pub fn timed(mut self, seconds: f64, limit: f64) -> Self {
        (self.seconds, self.limit) = (seconds, limit);
        if self.verdict == Verdict::Pass && seconds > limit {
            self.verdict = Verdict::Slow;
        }
        self
    }

    /// Fails the row for a reason beside its number.
    pub fn failed(mut self, why: impl Into<String>) -> Self {
        self.verdict = Verdict::Fail;
        self.with_note(why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts() {
        let judge = Judge { relative: 0.01, ..Judge::default() };
        let s = |mean, error| Spread { mean, error };
        assert!(judge.accepts(1.0, &s(1.003, 0.001)));
        // Too many standard errors; too far whatever the noise; not a number.
        assert!(!judge.accepts(1.0, &s(1.004, 0.001)));
        assert!(!judge.accepts(1.0, &s(1.02, 0.01)));
        assert!(!judge.accepts(1.0, &s(f64::NAN, 0.0)));
        assert!(!judge.accepts(1.0, &s(1.001, f64::NAN)));
        // Declared bias is taken off first.
        let biased = Judge { bias: 0.005, ..judge };
        assert!(biased.accepts(1.0, &s(1.005, 1e-9)) && !judge.accepts(1.0, &s(1.005, 1e-9)));
        // Zero is zero.
        assert!(judge.accepts(0.0, &s(0.0, 0.0)) && !judge.accepts(0.0, &s(1e-30, 0.0)));
    }

    #[test]
    fn spread_of_four() {
        let s = Spread::of([1.0, 2.0, 3.0, 4.0]);
        assert_eq!(s.mean, 2.5);
        assert!((s.error - (5.0f64 / 3.0 / 4.0).sqrt()).abs() < 1e-12);
    }
}
