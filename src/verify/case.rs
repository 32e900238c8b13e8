//! What a case consists of.

use super::judge::{Judge, Spread};
use super::probe::Probe;
use crate::accel::AccelKind;

/// A family of extreme cases.
pub struct Case {
    /// As given to `--case`.
    pub name: &'static str,
    /// One line for people.
    pub about: &'static str,
    pub items: fn() -> Vec<Item>,
}

/// One line of parameters of a case.
pub enum Item {
    /// A scene to render.
    Probe(Box<Probe>),
    /// A question to the rooms below the renderer.
    Check(Check),
    /// Something that cannot be run yet; listed so that nobody takes it for passed.
    NotYet { parameter: &'static str, why: &'static str },
}

impl From<Probe> for Item {
    fn from(probe: Probe) -> Self {
        Item::Probe(Box::new(probe))
    }
}

impl From<Check> for Item {
    fn from(check: Check) -> Self {
        Item::Check(check)
    }
}

/// A measurement without an image.
pub struct Check {
    pub parameter: String,
    /// What is put to the test, for the table's column of methods.
    pub what: &'static str,
    /// The answer may depend on the back end.
    pub needs_accel: bool,
    pub judge: Judge,
    pub fast: bool,
    /// Fast runs ask one back end only.
    pub once: bool,
    /// Seconds that it may take.
    pub limit: f64,
    /// Gets the back end and the number of seeds.
    #[allow(clippy::type_complexity)]
    pub run: Box<dyn Fn(AccelKind, u64) -> Outcome>,
}

impl Check {
    /// A check of `what` on every back end; exact unless told otherwise.
    pub fn new(
        parameter: impl Into<String>,
        what: &'static str,
        run: impl Fn(AccelKind, u64) -> Outcome + 'static,
    ) -> Self {
        Self {
            parameter: parameter.into(),
            what,
            needs_accel: true,
            judge: Judge::default(),
            fast: true,
            once: false,
            limit: 60.0,
            run: Box::new(run),
        }
    }

    /// A check of something that knows no back end.
    pub fn plain(parameter: impl Into<String>, what: &'static str, run: impl Fn(u64) -> Outcome + 'static) -> Self {
        Self { needs_accel: false, ..Self::new(parameter, what, move |_, seeds| run(seeds)) }
    }

    /// Passes within this relative difference.
    pub fn relative(mut self, relative: f64) -> Self {
        self.judge.relative = relative;
        self.judge.bias = relative;
        self
    }

    /// Passes within this relative difference and 3.5 standard errors.
    pub fn statistical(mut self, relative: f64) -> Self {
        self.judge = Judge { relative, ..Judge::default() };
        self
    }

    /// Passes within this absolute difference.
    pub fn absolute(mut self, absolute: f64) -> Self {
        self.judge.absolute = absolute;
        self
    }

    /// Only in full runs.
    pub fn slow(mut self) -> Self {
        self.fast = false;
        self
    }

    /// In fast runs on one back end only: the answer does not depend on it, or other rows ask that.
    pub fn once(mut self) -> Self {
        self.once = true;
        self
    }

    /// Seconds that it may take.
    pub fn limit(mut self, seconds: f64) -> Self {
        self.limit = seconds;
        self
    }
}

/// What a check found.
pub struct Outcome {
    pub expected: f64,
    pub spread: Spread,
    pub note: String,
    /// Why this is known to go wrong, should it: the row is then listed as not yet possible.
    pub limitation: Option<&'static str>,
}

impl Outcome {
    /// A number without noise.
    pub fn exact(expected: f64, measured: f64) -> Self {
        Self { expected, spread: Spread { mean: measured, error: 0.0 }, note: String::new(), limitation: None }
    }

    /// Independent estimates of one number.
    pub fn estimates(expected: f64, values: impl IntoIterator<Item = f64>) -> Self {
        Self { expected, spread: Spread::of(values), note: String::new(), limitation: None }
    }

    /// Adds what a reader may want to know.
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// A failure is a limitation of something that is not ours.
    pub fn limited(mut self, why: &'static str) -> Self {
        self.limitation = Some(why);
        self
    }
}
