//! All seeds of one method with one back end, and what they say together.

use std::collections::BTreeMap;

use serde::Serialize;

use super::reference::Reference;
use super::run::{Run, Snapshot};
use super::stats::{Interval, mean_interval, quartiles, slope};
use crate::image::metrics::RELMSE_EPSILON;
use crate::image::{Comparison, Image};

/// The errors, in the unit of relMSE, that a report tells the time to.
pub const THRESHOLDS: [f64; 3] = [1e-1, 1e-2, 1e-3];

/// The part of a run that a slope is fitted to: the last decade of passes.
const DECADE: f64 = 10.0;

/// Fewest snapshots that a slope is fitted to.
const MIN_POINTS: usize = 4;

/// Which snapshots of different seeds belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Moment {
    Passes(u64),
    /// The end of the time.
    End,
}

/// The sum of the pictures of several seeds at one moment.
#[derive(Clone, Debug)]
struct Sum {
    pixels: Vec<[f64; 3]>,
    relmse: Vec<f64>,
    mse: Vec<f64>,
    seconds: Vec<f64>,
    passes: Vec<u64>,
}

/// A method with a back end: its runs so far.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    pub method: String,
    pub accel: String,
    /// The parameters that the method ran with.
    pub parameters: String,
    pub runs: Vec<Run>,
    /// The picture at the end of the first seed's time, or its latest.
    #[serde(skip)]
    pub picture: Option<Image>,
    #[serde(skip)]
    sums: BTreeMap<Moment, Sum>,
}

/// The median over the seeds with the quartiles around it, at one number of passes.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Point {
    pub passes: u64,
    pub seeds: usize,
    /// Medians.
    pub seconds: f64,
    pub rays: f64,
    /// Lower quartile, median, upper quartile of relMSE.
    pub relmse: [f64; 3],
    /// Medians of the other metrics.
    pub relmse_trimmed: f64,
    pub smape: f64,
    pub flip: f64,
    /// Too close to the reference's own error.
    pub hidden: bool,
}

/// The share of noise and of bias in an error, told from how far seeds lie from each other and from the reference.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Split {
    /// Passes; the median over seeds at the end of the time.
    pub passes: f64,
    pub at_end: bool,
    pub seconds: f64,
    pub seeds: usize,
    /// In the unit of relMSE: mean over seeds, variance of one run, squared bias. Squared bias is an unbiased estimate and
    /// may be below zero by its own noise.
    pub relmse: f64,
    pub variance: f64,
    pub bias_sq: f64,
    /// The same unweighted.
    pub mse: f64,
    pub mse_variance: f64,
    pub mse_bias_sq: f64,
}

/// When an error was first reached.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reached {
    pub relmse: f64,
    /// Median over seeds; `None` when fewer than half of them reached it.
    pub seconds: Option<f64>,
    pub rays: Option<f64>,
    /// The first snapshot was better already.
    pub at_once: bool,
}

/// What the whole series comes to.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Medians over the seeds' last snapshots.
    pub seconds: f64,
    pub passes: f64,
    pub rays: f64,
    pub photons: f64,
    /// Name, median, median without the worst 0.1 % of pixels, and the median share of the error that those hold.
    pub metrics: Vec<(&'static str, Option<[f64; 3]>)>,
    /// 1 / (relMSE · seconds).
    pub merit: Option<f64>,
    pub reached: Vec<Reached>,
    /// Exponent of passes in relMSE over the last decade of passes.
    pub slope: Option<Interval>,
    /// Exponent of seconds.
    pub time_slope: Option<Interval>,
    pub hidden: bool,
    pub split: Option<Split>,
    pub overhead: Overhead,
}

/// What measuring cost.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Overhead {
    /// Snapshots of a run; the median over seeds.
    pub snapshots: f64,
    /// Time for which they stopped the clock, over the time that it ran.
    pub clock_stopped: f64,
    /// The share of the method's own time that they added to it; `None` with too few passes to tell.
    pub added: Option<Interval>,
}

impl Series {
    pub fn new(method: String, accel: String, parameters: String) -> Self {
        Self { method, accel, parameters, runs: Vec::new(), picture: None, sums: BTreeMap::new() }
    }

    /// `photonmapper`, with the back end where several are compared.
    pub fn label(&self, with_accel: bool) -> String {
        if with_accel { format!("{}, {}", self.method, self.accel) } else { self.method.clone() }
    }

    /// Takes the picture of a snapshot into the sums that tell noise from bias.
    pub fn add_picture(&mut self, snapshot: &Snapshot, image: &Image, first_seed: bool) {
        if first_seed {
            self.picture = Some(image.clone());
        }
        // Keep the sums of every third snapshot, which is every doubling.
        let passes = snapshot.passes;
        if snapshot.regular && (passes.is_power_of_two() || passes == 3) {
            self.add_sum(Moment::Passes(passes), snapshot, image);
        }
        if snapshot.last {
            self.add_sum(Moment::End, snapshot, image);
        }
    }

    fn add_sum(&mut self, moment: Moment, snapshot: &Snapshot, image: &Image) {
        let sum = self.sums.entry(moment).or_insert_with(|| Sum {
            pixels: vec![[0.0; 3]; image.pixels().len()],
            relmse: Vec::new(),
            mse: Vec::new(),
            seconds: Vec::new(),
            passes: Vec::new(),
        });
        for (s, p) in sum.pixels.iter_mut().zip(image.pixels()) {
            for (s, v) in s.iter_mut().zip(p.to_array()) {
                *s += f64::from(v);
            }
        }
        sum.relmse.push(snapshot.error.relmse.value);
        sum.mse.push(snapshot.error.rmse.value.powi(2));
        sum.seconds.push(snapshot.seconds);
        sum.passes.push(snapshot.passes);
    }

    /// The curve: medians over seeds at the passes that all of them have a snapshot at.
    pub fn curve(&self) -> Vec<Point> {
        // A run that goes on still, or was stopped, counts as long as there is no other.
        let any = self.runs.iter().any(|r| r.finished);
        let runs: Vec<&Run> = self.runs.iter().filter(|r| r.finished || !any).collect();
        let mut at: BTreeMap<u64, Vec<&Snapshot>> = BTreeMap::new();
        for s in runs.iter().flat_map(|r| &r.snapshots).filter(|s| s.regular) {
            at.entry(s.passes).or_default().push(s);
        }
        at.into_iter()
            .filter(|(_, snapshots)| snapshots.len() == runs.len())
            .map(|(passes, snapshots)| {
                let of = |f: &dyn Fn(&Snapshot) -> f64| quartiles(snapshots.iter().map(|s| f(s)));
                let relmse = of(&|s| s.error.relmse.value);
                Point {
                    passes,
                    seeds: snapshots.len(),
                    seconds: of(&|s| s.seconds)[1],
                    rays: of(&|s| s.rays as f64)[1],
                    relmse,
                    relmse_trimmed: of(&|s| s.error.relmse.trimmed.value)[1],
                    smape: of(&|s| s.error.smape.value)[1],
                    flip: of(&|s| s.error.flip.value)[1],
                    hidden: snapshots.iter().any(|s| s.hidden),
                }
            })
            .collect()
    }

    /// Noise and bias at the moments that at least two seeds have in common.
    pub fn splits(&self, reference: &Reference) -> Vec<Split> {
        let moments = self.sums.iter().filter(|(_, s)| s.relmse.len() >= 2);
        moments.map(|(&moment, sum)| sum.split(moment, reference)).collect()
    }

    /// What the last snapshots of all runs come to; `None` before there is one.
    pub fn outcome(&self, reference: &Reference) -> Option<Outcome> {
        let last: Vec<&Snapshot> = self.runs.iter().filter_map(|r| r.snapshots.last()).collect();
        if last.is_empty() {
            return None;
        }
        let median = |f: &dyn Fn(&Snapshot) -> f64| quartiles(last.iter().map(|s| f(s)))[1];
        let metric = |f: &dyn Fn(&Comparison) -> Option<crate::image::metrics::Metric>| {
            let found: Vec<_> = last.iter().filter_map(|s| f(&s.error)).collect();
            let of = |g: &dyn Fn(&crate::image::metrics::Metric) -> f64| quartiles(found.iter().map(g))[1];
            (!found.is_empty()).then(|| [of(&|m| m.value), of(&|m| m.trimmed.value), of(&|m| m.trimmed.energy)])
        };
        let fit = |x: &dyn Fn(&Snapshot) -> f64| {
            let slopes: Vec<f64> = self.runs.iter().filter_map(|r| fit_last_decade(&r.snapshots, x)).collect();
            mean_interval(&slopes)
        };
        let split = self.splits(reference).pop();
        Some(Outcome {
            seconds: median(&|s| s.seconds),
            passes: median(&|s| s.passes as f64),
            rays: median(&|s| s.rays as f64),
            photons: median(&|s| s.photons as f64),
            metrics: vec![
                ("RMSE", metric(&|c| Some(c.rmse))),
                ("relMSE", metric(&|c| Some(c.relmse))),
                ("MRSE", metric(&|c| c.mrse)),
                ("SMAPE", metric(&|c| Some(c.smape))),
                ("ꟻLIP", metric(&|c| Some(c.flip))),
            ],
            merit: Some(median(&|s| 1.0 / (s.error.relmse.value * s.seconds))).filter(|m| m.is_finite()),
            reached: THRESHOLDS.map(|t| self.reached(t)).to_vec(),
            slope: fit(&|s| s.passes as f64),
            time_slope: fit(&|s| s.seconds),
            hidden: last.iter().any(|s| s.hidden),
            split,
            overhead: self.overhead(),
        })
    }

    /// Passes right after a snapshot against the passes after those, in all runs.
    fn overhead(&self) -> Overhead {
        let runs = || self.runs.iter().filter_map(|r| Some((r, r.snapshots.last()?.seconds)));
        let total = |f: &dyn Fn(&Run, f64) -> f64| runs().map(|(r, seconds)| f(r, seconds)).sum::<f64>();
        let shares = |r: &Run, seconds: f64| {
            let snapshots = r.snapshots.len() as f64;
            r.slower_after.iter().map(move |slower| slower * snapshots / seconds).collect::<Vec<_>>()
        };
        let added: Vec<f64> = runs().flat_map(|(r, seconds)| shares(r, seconds)).collect();
        Overhead {
            snapshots: quartiles(self.runs.iter().map(|r| r.snapshots.len() as f64))[1],
            clock_stopped: total(&|r, _| r.snapshot_seconds) / total(&|_, seconds| seconds),
            added: mean_interval(&added).filter(|i| i.half_width.is_some()),
        }
    }

    fn reached(&self, relmse: f64) -> Reached {
        let crossings: Vec<_> = self.runs.iter().map(|r| crossing(&r.snapshots, relmse)).collect();
        let found: Vec<_> = crossings.iter().flatten().collect();
        let enough = !found.is_empty() && 2 * found.len() > crossings.len();
        let median = |f: &dyn Fn(&(f64, f64, bool)) -> f64| enough.then(|| quartiles(found.iter().map(|c| f(c)))[1]);
        Reached {
            relmse,
            seconds: median(&|c| c.0),
            rays: median(&|c| c.1),
            at_once: enough && found.iter().filter(|c| c.2).count() * 2 > found.len(),
        }
    }
}

impl Sum {
    /// E‖x−r‖² = variance + bias² + variance of the reference, and ‖mean of K − r‖² = variance/K + bias² + the same.
    fn split(&self, moment: Moment, reference: &Reference) -> Split {
        let k = self.relmse.len() as f64;
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let (mut relative, mut plain) = (0.0, 0.0);
        for (sum, r) in self.pixels.iter().zip(reference.image.pixels()) {
            for (sum, r) in sum.iter().zip(r.to_array()) {
                let r = f64::from(r);
                let off = (sum / k - r).powi(2);
                plain += off;
                relative += off / (r * r + RELMSE_EPSILON * RELMSE_EPSILON);
            }
        }
        let n = (3 * self.pixels.len()) as f64;
        let part = |error: f64, of_mean: f64, own: Option<f64>| {
            let variance = ((error - of_mean) * k / (k - 1.0)).max(0.0);
            (variance, of_mean - variance / k - own.unwrap_or(0.0))
        };
        let (relmse, mse) = (mean(&self.relmse), mean(&self.mse));
        let (variance, bias_sq) = part(relmse, relative / n, reference.relmse);
        let (mse_variance, mse_bias_sq) = part(mse, plain / n, reference.mse);
        Split {
            passes: quartiles(self.passes.iter().map(|&p| p as f64))[1],
            at_end: moment == Moment::End,
            seconds: quartiles(self.seconds.iter().copied())[1],
            seeds: self.relmse.len(),
            relmse,
            variance,
            bias_sq,
            mse,
            mse_variance,
            mse_bias_sq,
        }
    }
}

/// Seconds and rays at which a run's error first falls to a value, between snapshots by a straight line through the
/// logarithms; true when its first snapshot is there already.
fn crossing(snapshots: &[Snapshot], relmse: f64) -> Option<(f64, f64, bool)> {
    let i = snapshots.iter().position(|s| s.error.relmse.value <= relmse)?;
    let at = &snapshots[i];
    let Some(before) = i.checked_sub(1).map(|j| &snapshots[j]) else {
        return Some((at.seconds, at.rays as f64, true));
    };
    let (high, low) = (before.error.relmse.value, at.error.relmse.value.max(1e-300));
    let share = ((high / relmse).ln() / (high / low).ln()).clamp(0.0, 1.0);
    let between = |a: f64, b: f64| (a.max(1e-300).ln() * (1.0 - share) + b.max(1e-300).ln() * share).exp();
    Some((between(before.seconds, at.seconds), between(before.rays as f64, at.rays as f64), false))
}

/// The exponent of `x` in the error over the last decade of passes, as far as the reference can tell it.
fn fit_last_decade(snapshots: &[Snapshot], x: &dyn Fn(&Snapshot) -> f64) -> Option<f64> {
    let usable = |s: &&Snapshot| !s.hidden && s.error.relmse.value > 0.0;
    let end = snapshots.iter().rfind(usable)?.passes as f64;
    let points: Vec<(f64, f64)> = snapshots
        .iter()
        .filter(usable)
        .filter(|s| s.regular && s.passes as f64 >= end / DECADE)
        .map(|s| (x(s).ln(), s.error.relmse.value.ln()))
        .collect();
    if points.len() < MIN_POINTS { None } else { slope(&points) }
}

#[cfg(test)]
mod tests;
