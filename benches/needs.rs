//! What leaving things out gains: processor time of rendering each scene of `tests/needs/scenes.rs` as planned, over that
//! with everything forced on, loading included. `cargo bench --bench needs [-- --rounds 5]`.
#[path = "../tests/needs/scenes.rs"]
mod scenes;

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use caustica::accel::AccelKind;
use caustica::render::{Control, Plan, PlanOverrides, Silent, render};
use caustica::scene::{Item, LoadOptions, NeedOverride, Scene};

/// Seconds to load and render on one thread.
fn seconds(dir: &Path, xml: &str, needs: &[NeedOverride]) -> f64 {
    let started = Instant::now();
    let options = LoadOptions { accel: AccelKind::Auto, needs: needs.to_vec(), ..LoadOptions::default() };
    let scene = Scene::from_text(xml, &dir.join("scene.xml"), &options).expect("a valid scene");
    let overrides =
        PlanOverrides { spp: Some(16), photons: Some(20_000), needs: needs.to_vec(), ..PlanOverrides::default() };
    let plan = Plan::new(&scene, &overrides).expect("a known integrator");
    let stop = AtomicBool::new(false);
    render(&scene, &plan, &Control { stop: &stop, time: None, started, progress: &Silent });
    started.elapsed().as_secs_f64()
}

fn median(mut v: Vec<f64>) -> f64 {
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let rounds: usize =
        args.iter().position(|a| a == "--rounds").and_then(|i| args.get(i + 1)?.parse().ok()).unwrap_or(3);
    // One thread: time is then work.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the pool is not built yet");
    let dir = tempfile::tempdir().expect("a temporary folder");
    scenes::write_images(dir.path());
    let everything = Item::ALL.map(|item| (item, true));
    for (title, cases) in [("lacking", scenes::lacking()), ("deceiving", scenes::deceiving())] {
        println!("{title:<28}  planned   forced   ratio");
        let (mut product, mut least) = (0.0, f64::INFINITY);
        let count = cases.len() as f64;
        for case in cases {
            let xml = case.xml(64);
            let (mut planned, mut forced, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
            for _ in 0..rounds {
                planned.push(seconds(dir.path(), &xml, &[]));
                forced.push(seconds(dir.path(), &xml, &everything));
                ratios.push(forced[forced.len() - 1] / planned[planned.len() - 1]);
            }
            let ratio = median(ratios);
            println!("{:<28} {:7.3} s {:7.3} s {ratio:7.2}", case.name, median(planned), median(forced));
            product += ratio.ln();
            least = least.min(ratio);
        }
        println!("geometric mean {:.2}, least {least:.2}", (product / count).exp());
    }
}
