//! How fast ray queries are on a scene: both back ends on the rays that rendering it asks for.

mod rays;

use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;

use crate::accel::{Accel, AccelError, AccelKind, AccelOptions};
use crate::geometry::Hit;
use crate::scene::Scene;
pub use rays::{Class, RayClass, collect};

/// Rays in one unit of work.
const CHUNK: usize = 4096;

/// Two hits are the same when they name the same primitive, or lie this close together relative to their distance.
const SAME_DISTANCE: f32 = 1e-5;

/// What a back end costs before the first ray.
#[derive(Clone, Debug, Serialize)]
pub struct Build {
    /// `embree` or `bvh`.
    pub accel: &'static str,
    /// Name, version and instruction set.
    pub description: String,
    /// Median wall-clock seconds.
    pub seconds: f64,
    /// Bytes without the geometry itself.
    pub memory: usize,
}

/// What one back end did with one class of rays.
#[derive(Clone, Debug, Serialize)]
pub struct Rate {
    pub accel: &'static str,
    pub rays: &'static str,
    pub count: usize,
    /// Rays per second of all threads together, median of the rounds.
    pub rays_per_second: f64,
    /// Rate relative to the first back end, median of the rounds.
    pub ratio: f64,
    /// Share of the rays that hit something.
    pub hits: f64,
    /// Rays whose answer differs from that of the first back end: another primitive at another distance, or hit against
    /// miss.
    pub differ: u64,
}

/// A back end built for a scene.
pub struct Contender {
    pub accel: Accel,
    pub build: Build,
}

/// Builds the back end `kind` over a scene `rounds` times and keeps the last.
///
/// # Errors
/// When this build or machine does not have the back end.
pub fn contender(
    scene: &Scene,
    kind: AccelKind,
    options: AccelOptions,
    rounds: usize,
) -> Result<Contender, AccelError> {
    let mut seconds = Vec::new();
    let mut last = None;
    for _ in 0..rounds.max(1) {
        drop(last.take());
        let started = Instant::now();
        last = Some(Accel::build_with(kind, options, scene.geometry.clone())?);
        seconds.push(started.elapsed().as_secs_f64());
    }
    let accel = last.expect("at least one round");
    let build = Build {
        accel: accel.name(),
        description: accel.description(),
        seconds: median(seconds),
        memory: accel.memory(),
    };
    Ok(Contender { accel, build })
}

/// Measures one class of rays: the back ends take turns, so that a disturbance of the machine meets all of them.
pub fn measure(contenders: &[Contender], class: &RayClass, rounds: usize) -> Vec<Rate> {
    if class.rays.is_empty() {
        return Vec::new();
    }
    let mut rates = vec![Vec::new(); contenders.len()];
    for _ in 0..rounds.max(1) {
        for (contender, rates) in contenders.iter().zip(&mut rates) {
            let started = Instant::now();
            std::hint::black_box(run(&contender.accel, class));
            rates.push(class.rays.len() as f64 / started.elapsed().as_secs_f64());
        }
    }
    let entry = |(i, contender): (usize, &Contender)| Rate {
        accel: contender.build.accel,
        rays: class.class.name(),
        count: class.rays.len(),
        rays_per_second: median(rates[i].clone()),
        ratio: median(rates[i].iter().zip(&rates[0]).map(|(a, b)| a / b).collect()),
        hits: run(&contender.accel, class) as f64 / class.rays.len() as f64,
        differ: if i == 0 { 0 } else { differences(&contenders[0].accel, &contender.accel, class) },
    };
    contenders.iter().enumerate().map(entry).collect()
}

/// Asks for every ray on all threads; the number of hits.
fn run(accel: &Accel, class: &RayClass) -> u64 {
    let hits = |rays: &[crate::geometry::Ray]| {
        if class.class.is_any_hit() {
            rays.iter().filter(|r| accel.occluded(r)).count() as u64
        } else {
            rays.iter().filter(|r| accel.intersect(r).is_some()).count() as u64
        }
    };
    class.rays.par_chunks(CHUNK).map(hits).sum()
}

fn differences(a: &Accel, b: &Accel, class: &RayClass) -> u64 {
    let differ = |r: &crate::geometry::Ray| {
        if class.class.is_any_hit() {
            return a.occluded(r) != b.occluded(r);
        }
        match (a.intersect(r), b.intersect(r)) {
            (None, None) => false,
            (Some(a), Some(b)) => !same(&a, &b),
            _ => true,
        }
    };
    class.rays.par_iter().filter(|r| differ(r)).count() as u64
}

fn same(a: &Hit, b: &Hit) -> bool {
    (a.shape, a.prim, a.instance) == (b.shape, b.prim, b.instance) || (a.t - b.t).abs() <= SAME_DISTANCE * a.t.max(b.t)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
