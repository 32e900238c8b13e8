//! How fast are photon maps built and asked, next to what a programmer could take instead?
//!
//! ```text
//! cargo bench --bench photon_map [-- query build] [--photons 2000000] [--rounds 7]
//! ```
//! Rivals in the same run: kiddo's `ImmutableKdTree`, a textbook scalar `locate_photons` on twenty-byte records, and
//! nanoflann where its header and g++ are installed. Runs alternate in slices; medians are printed. Queries are timed by the
//! thread's running time, builds by the clock.
//!
//! The memory-bandwidth bound of a query is the time that the same thread takes to read, at random and with as many reads
//! under way as there can be, the cache lines that a query must read that knows its radius from the start; of sorted
//! queries, to read every position once in order for all queries of a slice's part of the room.

#[path = "photon_map/memory.rs"]
mod memory;
#[path = "photon_map/nanoflann.rs"]
mod nanoflann;

use caustica::math::{Bounds3, Vec3};
use caustica::photon::{KnnScratch, Photon, PhotonMap, morton_order};
use caustica::sample::mix64;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nanoflann::Nanoflann;
use std::cell::RefCell;
use std::hint::black_box;
use std::num::NonZero;
use std::time::Instant;

/// Queries asked by one method before it is another one's turn.
const SLICE: usize = 50_000;

fn uniform(i: u64) -> f32 {
    (mix64(i) >> 40) as f32 / (1u64 << 24) as f32
}

/// The i-th point on the walls of a unit room (five of six points) or on a sphere in it.
fn surface_point(i: u64) -> Vec3 {
    let (u, v, which) = (uniform(3 * i), uniform(3 * i + 1), (mix64(3 * i + 2) >> 32) % 36);
    if which >= 30 {
        let z = 2.0 * u - 1.0;
        let (s, c) = (std::f32::consts::TAU * v).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        return Vec3::new(0.5, 0.3, 0.6) + 0.25 * Vec3::new(r * c, r * s, z);
    }
    let side = if which % 2 == 0 { 0.0 } else { 1.0 };
    match which / 2 % 3 {
        0 => Vec3::new(side, u, v),
        1 => Vec3::new(u, side, v),
        _ => Vec3::new(u, v, side),
    }
}

fn points(n: usize, from: u64) -> Vec<Vec3> {
    (0..n as u64).map(|i| surface_point(i + from)).collect()
}

fn photons(points: &[Vec3]) -> Vec<Photon> {
    points.iter().map(|p| Photon { position: p.to_array(), power: [128, 128, 128, 129], ..Photon::default() }).collect()
}

fn median(mut v: Vec<f64>) -> f64 {
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

/// Jensen's algorithm as printed: records in a heap, recursion, and a maximum heap once k are found.
mod textbook {
    use super::{Photon, Vec3};

    pub struct Nearest {
        pub q: [f32; 3],
        pub k: usize,
        pub found: usize,
        heaped: bool,
        pub d_sq: Vec<f32>,
        pub index: Vec<u32>,
    }

    impl Nearest {
        pub fn new(q: Vec3, k: usize, mut d_sq: Vec<f32>, index: Vec<u32>) -> Self {
            d_sq[0] = f32::INFINITY;
            Self { q: q.to_array(), k, found: 0, heaped: false, d_sq, index }
        }

        fn sift_down(&mut self, mut i: usize) {
            let (d, index) = (self.d_sq[i], self.index[i]);
            while 2 * i <= self.found {
                let mut child = 2 * i;
                if child < self.found && self.d_sq[child] < self.d_sq[child + 1] {
                    child += 1;
                }
                if d >= self.d_sq[child] {
                    break;
                }
                (self.d_sq[i], self.index[i]) = (self.d_sq[child], self.index[child]);
                i = child;
            }
            (self.d_sq[i], self.index[i]) = (d, index);
        }

        fn offer(&mut self, d: f32, index: u32) {
            if self.found < self.k {
                self.found += 1;
                (self.d_sq[self.found], self.index[self.found]) = (d, index);
                return;
            }
            if !self.heaped {
                self.heaped = true;
                (1..=self.found / 2).rev().for_each(|i| self.sift_down(i));
            }
            if d < self.d_sq[1] {
                (self.d_sq[1], self.index[1]) = (d, index);
                self.sift_down(1);
            }
            // Place 0 keeps the search radius.
            self.d_sq[0] = self.d_sq[1];
        }
    }

    /// `heap` counts from 1.
    pub fn locate_photons(heap: &[Photon], i: usize, nearest: &mut Nearest) {
        let photon = &heap[i];
        if 2 * i < heap.len() {
            let axis = photon.flags.axis();
            let d = nearest.q[axis] - photon.position[axis];
            let (near, far) = if d > 0.0 { (2 * i + 1, 2 * i) } else { (2 * i, 2 * i + 1) };
            if near < heap.len() {
                locate_photons(heap, near, nearest);
            }
            if d * d < nearest.d_sq[0] && far < heap.len() {
                locate_photons(heap, far, nearest);
            }
        }
        let [dx, dy, dz] = std::array::from_fn(|a| photon.position[a] - nearest.q[a]);
        let d_sq = dx * dx + dy * dy + dz * dz;
        if d_sq < nearest.d_sq[0] {
            nearest.offer(d_sq, i as u32);
        }
    }
}

type Tree = ImmutableKdTree<f32, 3>;

struct Bench {
    points: Vec<Vec3>,
    map: PhotonMap,
    heap: Vec<Photon>,
    kiddo: Tree,
    nanoflann: Option<RefCell<Nanoflann>>,
    /// Bytes a second in order, cache lines a second at random.
    memory: (f64, f64),
    rounds: usize,
}

impl Bench {
    fn new(n: usize, rounds: usize) -> Self {
        let points = points(n, 0);
        let map = PhotonMap::build(photons(&points));
        let heap = std::iter::once(Photon::default()).chain(map.heap_order()).collect();
        let arrays: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
        let kiddo = Tree::new_from_slice(&arrays).expect("finite points");
        let nanoflann = Nanoflann::start(&points).map(RefCell::new);
        if nanoflann.is_none() {
            println!("without nanoflann: its header or g++ is missing");
        }
        let memory = memory::rates(map.len() * 12, |work| {
            let start = thread_seconds();
            work();
            thread_seconds() - start
        });
        Self { points, map, heap, kiddo, nanoflann, memory, rounds }
    }

    fn ours(&self, queries: &[Vec3], k: usize) -> f64 {
        let mut scratch = KnnScratch::new();
        queries.iter().map(|&q| f64::from(self.map.nearest(q, k, f32::INFINITY, &mut scratch).radius_sq)).sum()
    }

    fn textbook(&self, queries: &[Vec3], k: usize) -> f64 {
        let (mut d_sq, mut index) = (vec![0.0; k + 1], vec![0; k + 1]);
        let mut sum = 0.0;
        for &q in queries {
            let mut nearest = textbook::Nearest::new(q, k, d_sq, index);
            textbook::locate_photons(&self.heap, 1, &mut nearest);
            sum += f64::from(nearest.d_sq[1..].iter().fold(0f32, |m, &d| m.max(d)));
            (d_sq, index) = (nearest.d_sq, nearest.index);
        }
        sum
    }

    fn kiddo(&self, queries: &[Vec3], k: usize) -> f64 {
        let k = NonZero::new(k).expect("k is not 0");
        let mut scratch = self.kiddo.create_scratch::<SquaredEuclidean<f32>>();
        let farthest = |q: &Vec3| {
            let q = q.to_array();
            let answer =
                self.kiddo.query(&q).nearest_n::<SquaredEuclidean<f32>>(k).with_scratch(&mut scratch).execute();
            f64::from(answer[answer.len() - 1].distance)
        };
        queries.iter().map(farthest).sum()
    }

    /// Times a method by the thread's running time; seconds and what it returned.
    fn timed(method: impl FnOnce() -> f64) -> (f64, f64) {
        let start = thread_seconds();
        let sum = black_box(method());
        (thread_seconds() - start, sum)
    }

    /// Median nanoseconds a query of every method, asked in alternating slices.
    fn compare(&self, name: &str, queries: &[Vec3], k: usize, sorted: bool) {
        type Query<'a> = (&'a str, Box<dyn Fn(&[Vec3]) -> (f64, f64) + 'a>);
        let mut methods: Vec<Query> = vec![
            ("caustica", Box::new(move |q| Self::timed(|| self.ours(q, k)))),
            ("textbook", Box::new(move |q| Self::timed(|| self.textbook(q, k)))),
            ("kiddo", Box::new(move |q| Self::timed(|| self.kiddo(q, k)))),
        ];
        if let Some(rival) = &self.nanoflann {
            let ask = move |q: &[Vec3]| rival.borrow_mut().query(q, k).expect("nanoflann answers");
            methods.push(("nanoflann", Box::new(ask)));
        }
        let mut times = vec![Vec::new(); methods.len()];
        let slices: Vec<&[Vec3]> = queries.chunks(SLICE).collect();
        for round in 0..self.rounds {
            let slice = slices[round * 5 % slices.len()];
            let mut sums = vec![0.0; methods.len()];
            for (i, (_, method)) in methods.iter().enumerate() {
                let (seconds, sum) = method(slice);
                times[i].push(seconds * 1e9 / slice.len() as f64);
                sums[i] = sum;
            }
            assert!(sums.iter().all(|s| (s / sums[0] - 1.0).abs() < 1e-6), "the methods disagree: {sums:?}");
        }
        let ns: Vec<f64> = times.into_iter().map(median).collect();
        println!("{name}, k = {k}:");
        for (i, (label, _)) in methods.iter().enumerate() {
            println!("  {label:9} {:8.0} ns/query {:7.3} M queries/s  {:5.2}x", ns[i], 1e3 / ns[i], ns[i] / ns[0]);
        }
        self.print_bound(ns[0], queries, k, sorted);
    }

    /// Prints which share of a query's time the memory would need.
    fn print_bound(&self, ns: f64, queries: &[Vec3], k: usize, sorted: bool) {
        let (bytes_a_second, lines_a_second) = self.memory;
        if sorted {
            // The map's positions and the queries themselves, once.
            let bytes = 12.0 * (self.points.len() as f64 / queries.len() as f64 + 1.0);
            let bound = bytes / bytes_a_second * 1e9;
            println!("  {bytes:.0} bytes a query in order: {bound:.1} ns, {:.1} % of its time", 100.0 * bound / ns);
            return;
        }
        let mut scratch = KnnScratch::new();
        let some = &queries[..queries.len().min(2000)];
        let lines = |&q: &Vec3| {
            let r_sq = self.map.nearest(q, k, f32::INFINITY, &mut scratch).radius_sq;
            self.map.lines_within(q, r_sq)
        };
        let lines = some.iter().map(lines).sum::<usize>() as f64 / some.len() as f64;
        let bound = lines / lines_a_second * 1e9;
        println!("  {lines:.0} cache lines a query at random: {bound:.0} ns, {:.0} % of its time", 100.0 * bound / ns);
    }

    fn queries(&self) {
        let bytes = self.map.memory() as f64 / self.points.len() as f64;
        println!("{} photons on walls and a sphere, {bytes:.2} bytes a photon, one thread", self.points.len());
        let (bytes, lines) = self.memory;
        println!("memory: {:.1} GB/s in order, {:.0} M cache lines/s at random", bytes * 1e-9, lines * 1e-6);
        let unsorted = points(1_000_000, 1 << 40);
        let order = morton_order(&unsorted, &Bounds3::from_points(unsorted.iter().copied()));
        let sorted: Vec<Vec3> = order.iter().map(|&i| unsorted[i as usize]).collect();
        for k in [50, 200] {
            self.compare("Morton-sorted", &sorted, k, true);
            self.compare("unsorted", &unsorted, k, false);
        }
    }
}

/// Seconds this thread has run, where the system tells; else seconds since the first call. On a machine that others use as
/// well the first is what a method costs.
fn thread_seconds() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    let schedstat = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let running = schedstat.and_then(|s| s.split_whitespace().next()?.parse::<f64>().ok());
    running.map_or_else(|| START.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Seconds by the clock until the result is there; giving its memory back is not counted.
fn seconds<T>(work: impl FnOnce() -> T) -> f64 {
    let start = Instant::now();
    let result = black_box(work());
    let seconds = start.elapsed().as_secs_f64();
    drop(result);
    seconds
}

/// Building, on one thread and on two.
fn build(n: usize, rounds: usize) {
    let points = points(n, 0);
    let photons = photons(&points);
    let arrays: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
    drop(points);
    println!("building {n} photons");
    let mut medians = Vec::new();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let (mut ours, mut kiddo) = (Vec::new(), Vec::new());
        for _ in 0..rounds {
            let input = photons.clone();
            ours.push(pool.install(|| seconds(|| PhotonMap::build(input))));
            kiddo.push(pool.install(|| {
                seconds(|| {
                    if threads == 1 { Tree::new_from_slice(&arrays) } else { Tree::new_from_slice_parallel(&arrays) }
                })
            }));
        }
        let (ours, kiddo) = (median(ours) * 1e9 / n as f64, median(kiddo) * 1e9 / n as f64);
        println!("  {threads} thread(s): caustica {ours:.1} ns/photon, kiddo {kiddo:.1} ns/point");
        medians.push(ours);
    }
    println!("  two threads are {:.2}x faster", medians[0] / medians[1]);
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str, otherwise: usize| {
        let place = arguments.iter().position(|a| a == name);
        place.and_then(|i| arguments.get(i + 1)).map_or(otherwise, |v| v.parse().expect("a number"))
    };
    let wanted = |name: &str| {
        let names = ["query", "build"];
        arguments.iter().any(|a| a == name) || !arguments.iter().any(|a| names.contains(&a.as_str()))
    };
    // `cargo test --benches` only wants to know that it runs.
    let smoke = arguments.iter().any(|a| a == "--test");
    let (n, rounds) =
        (number("--photons", if smoke { 10_000 } else { 2_000_000 }), number("--rounds", if smoke { 1 } else { 15 }));
    if wanted("query") {
        Bench::new(n, rounds).queries();
    }
    if wanted("build") {
        build(if smoke { n } else { number("--photons", 8_000_000) }, rounds.min(5));
    }
}
