//! References: pictures good enough to measure others by, and what is known about how good they are.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::agreement::{self, BlockTest, Blocks};
use crate::color::Rgb;
use crate::image::metrics::RELMSE_EPSILON;
use crate::image::{Image, spread_blocks};
use crate::render::{Control, METHODS, Plan, PlanError, PlanOverrides, Session, Silent};
use crate::scene::Scene;

/// Errors closer to a reference than this multiple of its own are not to be claimed.
pub const CLAIM_FACTOR: f64 = 20.0;

/// Passes that each half has at least, so that its noise can be told.
const MIN_PASSES: u64 = 8;

/// Radii of progressive methods over those of a common render. The noise of a reference is known and its blur is not, so
/// blur is traded for noise: half the radius makes noise twice as strong and blur along edges half as strong.
const RADIUS_SCALE: f32 = 0.5;

/// How to make a reference.
#[derive(Clone, Debug)]
pub struct ReferenceSettings {
    /// Two names of integrators, or the same name twice.
    pub methods: [String; 2],
    pub seeds: [u64; 2],
    /// Time of both halves together.
    pub time: Duration,
    /// In place of the time: passes of each half.
    pub passes: Option<u64>,
}

/// Why there is no reference.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    #[error("{0}")]
    Plan(#[from] PlanError),
    #[error("both halves of a reference would have the same random numbers: give them two seeds")]
    SameSeeds,
    #[error(
        "{} and {} do not agree: around pixel {}, {} they are {:.1} standard errors apart where {:.1} is the limit over \
         {} comparisons; one of them is wrong for this scene or has not yet found all of its light: give it more --time, \
         or choose other --methods", .methods[0], .methods[1], .test.at.0, .test.at.1, .test.largest_z.abs(), .test.limit,
        .test.tests
    )]
    Disagreement { methods: [String; 2], test: BlockTest },
    #[error("stopped after {0} passes, before there were enough to tell the noise of the picture")]
    Stopped(u64),
    #[error("samples that are not finite were dropped; no reference can come of it")]
    NotFinite,
}

/// A pair of consistent methods that differ as much as this program can offer for a scene: paths from the camera and, for
/// the other half, something that starts at the lights too.
pub fn default_methods(scene: &Scene) -> [String; 2] {
    // Light that is focused and then seen through glass is found by merging; elsewhere connections have less noise.
    let order: &[&str] = if scene.has_specular() { &["vcm", "sppm", "bdpt"] } else { &["bdpt", "vcm", "sppm"] };
    let second = order.iter().find(|m| METHODS.contains(m)).copied().unwrap_or("path");
    ["path".to_owned(), second.to_owned()]
}

/// One half: a render with its share of the clock.
struct Half<'s> {
    session: Session<'s>,
    seconds: f64,
}

impl<'s> Half<'s> {
    fn new(scene: &'s Scene, method: &str, seed: u64) -> Result<Self, PlanError> {
        let overrides = PlanOverrides {
            integrator: Some(method.to_owned()),
            seed: Some(seed),
            timed: true,
            track_error: true,
            radius_scale: Some(RADIUS_SCALE),
            ..PlanOverrides::default()
        };
        Ok(Self { session: Session::new(scene, &Plan::new(scene, &overrides)?), seconds: 0.0 })
    }

    fn step(&mut self, control: &Control) {
        let started = Instant::now();
        self.session.step(control);
        self.seconds += started.elapsed().as_secs_f64();
    }

    fn blocks(&self, image: &Image) -> Blocks {
        let variance = self.session.doubt().and_then(|d| d.block_variance()).expect("several passes with their error");
        Blocks::new(image, variance, self.session.passes())
    }
}

/// Renders a scene by two methods from two seeds, tests that they agree, and joins them, the less noisy with more weight.
///
/// `progress` hears the finished fraction. With `stop` the picture so far is taken, if it has enough passes.
pub fn make(
    scene: &Scene,
    settings: &ReferenceSettings,
    stop: &AtomicBool,
    progress: &dyn Fn(f64),
) -> Result<Image, ReferenceError> {
    if settings.seeds[0] == settings.seeds[1] {
        return Err(ReferenceError::SameSeeds);
    }
    let half = |i: usize| Half::new(scene, &settings.methods[i], settings.seeds[i]);
    let mut halves = [half(0)?, half(1)?];
    // Step the half that has had less time, so that both have the same in the end.
    loop {
        let [a, b] = &halves;
        let least = a.session.passes().min(b.session.passes());
        let (done, wanted) = match settings.passes {
            Some(n) => (least as f64, n.max(MIN_PASSES) as f64),
            None => (a.seconds + b.seconds, settings.time.as_secs_f64()),
        };
        progress((done / wanted.max(1e-9)).min(least as f64 / MIN_PASSES as f64).min(1.0));
        if stop.load(Ordering::Relaxed) || (done >= wanted && least >= MIN_PASSES) {
            break;
        }
        let first = match settings.passes {
            Some(_) => a.session.passes() <= b.session.passes(),
            // Whoever lacks passes comes first, however slow.
            None if least < MIN_PASSES && done >= wanted => a.session.passes() < MIN_PASSES,
            None => a.seconds <= b.seconds,
        };
        let control = Control { stop, time: None, started: Instant::now(), progress: &Silent };
        halves[usize::from(!first)].step(&control);
    }
    let least = halves[0].session.passes().min(halves[1].session.passes());
    if least < MIN_PASSES {
        return Err(ReferenceError::Stopped(least));
    }
    if halves.iter().any(|h| h.session.summary.counters.non_finite() > 0) {
        return Err(ReferenceError::NotFinite);
    }
    join(scene, settings, &halves)
}

/// Tests that the halves agree, and weighs them by their noise.
fn join(scene: &Scene, settings: &ReferenceSettings, halves: &[Half; 2]) -> Result<Image, ReferenceError> {
    let [a, b] = [0, 1].map(|i| halves[i].session.image());
    let test = agreement::test(&halves[0].blocks(&a), &halves[1].blocks(&b));
    if test.rejected {
        return Err(ReferenceError::Disagreement { methods: settings.methods.clone(), test });
    }
    let variance = [0, 1].map(|i| halves[i].session.variance().expect("several passes with their error"));
    let block_variance =
        [0, 1].map(|i| halves[i].session.doubt().and_then(|d| d.block_variance()).expect("several passes"));
    // Give every pixel the same weights, so that no weight depends on the noise that it weighs.
    let relative = |v: &[Rgb]| weighted_mean(v, &a);
    let (va, vb) = (relative(&variance[0]), relative(&variance[1]));
    let wa = if va + vb > 0.0 { vb / (va + vb) } else { 0.5 };
    let (fa, fb) = (wa as f32, 1.0 - wa as f32);
    let mix = |x: &[Rgb], y: &[Rgb], fx: f32, fy: f32| -> Vec<Rgb> {
        x.iter().zip(y).map(|(x, y)| *x * fx + *y * fy).collect()
    };
    let mut image = Image::rgb(a.width(), a.height(), mix(a.pixels(), b.pixels(), fa, fb));
    image.set_layer("variance", &mix(&variance[0], &variance[1], fa * fa, fb * fb));
    let blocks = mix(&block_variance[0], &block_variance[1], fa * fa, fb * fb);
    let columns = a.width().div_ceil(crate::image::BLOCK_SIZE);
    let blocks = Image::rgb(columns, blocks.len() as u32 / columns, blocks);
    image.set_layer("blockvariance", spread_blocks(&blocks, a.width(), a.height()).pixels());
    // The halves' difference tells the noise a second time: E (A−B)²·wa·wb = variance of wa·A + wb·B.
    let half_buffer: Vec<Rgb> = (a.pixels().iter().zip(b.pixels()))
        .map(|(x, y)| Rgb::from([0, 1, 2].map(|c| (x[c] - y[c]) * (x[c] - y[c]) * fa * fb)))
        .collect();
    let mse = half_buffer.iter().map(|v| f64::from(v.r) + f64::from(v.g) + f64::from(v.b)).sum::<f64>();
    let mse = mse / (3 * half_buffer.len()) as f64;
    let pair = |f: &dyn Fn(usize) -> String| format!("{},{}", f(0), f(1));
    let relmse = weighted_mean(&half_buffer, &image);
    let notes = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("commit", env!("CAUSTICA_COMMIT").to_owned()),
        ("scene_hash", scene.hash.clone()),
        ("reference.methods", pair(&|i| settings.methods[i].clone())),
        ("reference.seeds", pair(&|i| settings.seeds[i].to_string())),
        ("reference.passes", pair(&|i| halves[i].session.passes().to_string())),
        ("reference.spp", pair(&|i| halves[i].session.summary.spp.to_string())),
        ("reference.seconds", pair(&|i| format!("{:.3}", halves[i].seconds))),
        ("reference.weights", format!("{wa:.6},{:.6}", 1.0 - wa)),
        ("reference.mse", format!("{mse:.6e}")),
        ("reference.relmse", format!("{relmse:.6e}")),
        ("reference.largest_z", format!("{:.3}", test.largest_z)),
        ("reference.z_limit", format!("{:.3}", test.limit)),
        ("reference.p_value", format!("{:.4}", test.p_value)),
    ];
    for (key, value) in notes {
        image.metadata.insert(format!("caustica.{key}"), value);
    }
    Ok(image)
}

/// Mean of v / (r² + ε²) over pixels and channels: squared errors in the unit of relMSE.
fn weighted_mean(v: &[Rgb], r: &Image) -> f64 {
    let term = |v: f32, r: f32| f64::from(v) / (f64::from(r).powi(2) + RELMSE_EPSILON.powi(2));
    let sum: f64 = v.iter().zip(r.pixels()).map(|(v, r)| (0..3).map(|c| term(v[c], r[c])).sum::<f64>()).sum();
    sum / (3 * v.len().max(1)) as f64
}

/// A reference as it is used: the picture, and what is known about its error.
#[derive(Clone, Debug, Serialize)]
pub struct Reference {
    #[serde(skip)]
    pub image: Image,
    /// Its file, or how else it came to be.
    pub source: String,
    /// The two methods and their seeds, where the file says so.
    pub methods: Option<String>,
    pub seeds: Option<String>,
    /// Mean variance, plain and in the unit of relMSE: the larger of what the variance layer and what the difference of
    /// the two halves say. `None` for a file that says nothing.
    pub mse: Option<f64>,
    pub relmse: Option<f64>,
    /// The file's scene hash is that of the scene; `None` where the file has none.
    pub same_scene: Option<bool>,
    pub black: bool,
}

impl Reference {
    /// Takes a picture for a reference of `scene`.
    pub fn new(image: Image, source: String, scene: &Scene) -> Self {
        let text = |key: &str| image.metadata.get(&format!("caustica.{key}")).cloned();
        let number = |key: &str| text(key).and_then(|v| v.parse::<f64>().ok());
        let layer = image.layer("variance");
        let largest = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        };
        let plain = layer.as_ref().map(|v| {
            let sum: f64 = v.iter().map(|v| f64::from(v.r) + f64::from(v.g) + f64::from(v.b)).sum();
            sum / (3 * v.len().max(1)) as f64
        });
        Self {
            methods: text("reference.methods").or_else(|| text("integrator")),
            seeds: text("reference.seeds").or_else(|| text("seed")),
            mse: largest(plain, number("reference.mse")),
            relmse: largest(layer.map(|v| weighted_mean(&v, &image)), number("reference.relmse")),
            same_scene: text("scene_hash").map(|h| h == scene.hash),
            black: image.pixels().iter().all(|p| p.is_black()),
            source,
            image,
        }
    }

    /// Whether an error in the unit of relMSE is too close to the reference's own to be claimed.
    pub fn hides(&self, relmse: f64) -> bool {
        self.relmse.is_some_and(|own| relmse < CLAIM_FACTOR * own)
    }
}
