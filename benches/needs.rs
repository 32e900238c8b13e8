//! What leaving things out gains: processor time of rendering each scene of `tests/needs/scenes.rs` as planned, over that
//! with everything forced on, loading included. `cargo bench --bench needs [-- --rounds 9 --only lacking]`.
//!
//! One thread does everything, and the time for which it ran counts, not the clock. Both take turns, each going first in
//! half of the rounds, and the least time of each says what it costs: other work on the machine only adds to it.
#[path = "../tests/needs/scenes.rs"]
mod scenes;

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use caustica::accel::AccelKind;
use caustica::render::{Control, Plan, PlanOverrides, Silent, render};
use caustica::scene::{LoadOptions, NeedOverride, Scene};

/// Rounds end early once each way of rendering had so many seconds.
const ENOUGH: f64 = 4.0;

/// Seconds for which this thread has run; of the clock where the system does not tell.
fn running(started: Instant) -> f64 {
    let schedstat = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = schedstat.and_then(|s| s.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| started.elapsed().as_secs_f64(), |ns| 1e-9 * ns)
}

/// Seconds to load and render.
fn seconds(dir: &Path, xml: &str, needs: &[NeedOverride], epoch: Instant) -> f64 {
    let before = running(epoch);
    let options = LoadOptions { accel: AccelKind::Auto, needs: needs.to_vec(), ..LoadOptions::default() };
    let scene = Scene::from_text(xml, &dir.join("scene.xml"), &options).expect("a valid scene");
    let overrides =
        PlanOverrides { spp: Some(16), photons: Some(20_000), needs: needs.to_vec(), ..PlanOverrides::default() };
    let plan = Plan::new(&scene, &overrides).expect("a known integrator");
    let stop = AtomicBool::new(false);
    render(&scene, &plan, &Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent });
    running(epoch) - before
}

/// Least seconds as planned, and with everything.
fn measure(dir: &Path, xml: &str, rounds: usize) -> [f64; 2] {
    let ways = [Vec::new(), scenes::everything()];
    let epoch = Instant::now();
    let (mut least, mut sum) = ([f64::INFINITY; 2], [0.0; 2]);
    for round in 0..rounds {
        for i in 0..2 {
            let way = (round + i) % 2;
            let s = seconds(dir, xml, &ways[way], epoch);
            (least[way], sum[way]) = (least[way].min(s), sum[way] + s);
        }
        if round > 1 && sum[0].min(sum[1]) > ENOUGH {
            break;
        }
    }
    least
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let after = |name: &str| args.iter().position(|a| a == name).and_then(|i| args.get(i + 1));
    let rounds: usize = after("--rounds").and_then(|a| a.parse().ok()).unwrap_or(9);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    let dir = tempfile::tempdir().expect("a temporary folder");
    scenes::write_images(dir.path());
    for (title, cases) in [("lacking", scenes::lacking()), ("deceiving", scenes::deceiving())] {
        if after("--only").is_some_and(|only| only != title) {
            continue;
        }
        println!("| {title} | planned, s | forced, s | ratio |\n|---|---|---|---|");
        let (mut product, mut least) = (0.0, f64::INFINITY);
        let count = cases.len() as f64;
        for case in cases {
            let xml = case.xml(64);
            let [planned, forced] = pool.install(|| measure(dir.path(), &xml, rounds));
            let ratio = forced / planned;
            println!("| {} | {planned:.4} | {forced:.4} | {ratio:.3} |", case.name);
            product += ratio.ln();
            least = least.min(ratio);
        }
        println!("geometric mean {:.2}, least {least:.3}\n", (product / count).exp());
    }
}
