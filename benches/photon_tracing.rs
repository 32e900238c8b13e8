//! What does a photon path cost beyond its ray queries? The rate of `shoot` against the same rays traced bare through the
//! back end, by turns in one process on one thread; processor time, medians. The aim is a ratio of at least 0.60.
//!
//! ```text
//! cargo bench --bench photon_tracing [-- SCENE.xml …]
//! ```

use std::hint::black_box;
use std::path::{Path, PathBuf};

use caustica::accel::AccelKind;
use caustica::bsdf::{LobeMask, Mode};
use caustica::geometry::Ray;
use caustica::sample::{Key, Sampler, Sequence};
use caustica::scene::{LoadOptions, Scene};
use caustica::shoot::{Emission, ShootSettings, Target, WalkSettings, shoot_paths, survival};

const PATHS: u64 = 1 << 16;
const ROUNDS: usize = 9;
/// What one round does so often, since some machines count processor time in steps of milliseconds.
const REPEATS: usize = 32;

fn main() {
    let given: Vec<PathBuf> = std::env::args().skip(1).filter(|a| a.ends_with(".xml")).map(PathBuf::from).collect();
    let own = [
        "cornell-box.xml",
        "cornell-spheres.xml",
        "environment.xml",
        "gallery/sphereflake.xml",
        "gallery/matterhorn.xml",
        "ring.xml",
        "gallery/glossy.xml",
        "gallery/poolhouse.xml",
        "gallery/fractal-box.xml",
        "pool.xml",
    ];
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let scenes = if given.is_empty() { own.map(|s| folder.join(s)).to_vec() } else { given };
    let mut kinds = vec![AccelKind::Bvh];
    if caustica::accel::embree_available() {
        kinds.push(AccelKind::Embree);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for path in scenes {
        for &accel in &kinds {
            let options = LoadOptions { accel, ..LoadOptions::default() };
            match Scene::load(&path, &options) {
                Ok(scene) => pool.install(|| measure(&path, &scene)),
                Err(e) => println!("{e}"),
            }
        }
    }
}

fn measure(path: &Path, scene: &Scene) {
    let walk = WalkSettings { max_depth: None, rr_depth: 1, sequence: Sequence::Independent };
    let target = Target::Global;
    let settings = ShootSettings { seed: 1, pass: 0, target, walk, photons: 0, max_paths: PATHS, guided: false };
    let emission = Emission::unaimed(PATHS);
    let shot = shoot_paths(scene, &settings, &emission);
    let key = Key::new(settings.seed, target.purpose(), settings.pass);
    let rays: Vec<Ray> = (0..PATHS).flat_map(|index| replay(scene, &walk, key, index)).collect();
    assert_eq!(rays.len() as u64, shot.counters.photon_rays, "the rays are not those of the shoot");
    let mut ratios = Vec::new();
    let (mut bare, mut whole) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        let b = seconds(|| {
            for _ in 0..REPEATS {
                black_box(rays.iter().filter(|r| scene.accel.intersect(black_box(r)).is_some()).count());
            }
        });
        let w = seconds(|| {
            for _ in 0..REPEATS {
                black_box(shoot_paths(scene, &settings, &emission).photons.len());
            }
        });
        ratios.push(b / w);
        bare.push((REPEATS * rays.len()) as f64 / b * 1e-6);
        whole.push((REPEATS * rays.len()) as f64 / w * 1e-6);
    }
    println!(
        "{:20} {:28} {} photons, bare {:6.2} Mray/s, shoot {:6.2} Mray/s, ratio {:.2}",
        path.file_stem().unwrap_or_default().display(),
        scene.accel.description(),
        shot.photons.len(),
        median(bare),
        median(whole),
        median(ratios)
    );
}

/// The rays of one photon path, with the random numbers that `shoot` gives it.
fn replay(scene: &Scene, walk: &WalkSettings, key: Key, index: u64) -> Vec<Ray> {
    let mut rays = Vec::new();
    let mut sampler = Sampler::new(walk.sequence, key, index);
    let (u_light, u_pos, u_dir) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
    let Some((light, pdf)) = scene.selector.sample(u_light) else { return rays };
    let Some(le) = scene.lights[light].sample_le(&scene.light_context(), u_pos, u_dir) else { return rays };
    let mut flux = le.weight * ((1.0 / PATHS as f64) as f32 / pdf);
    let (mut ray, mut depth) = (le.ray, 0);
    while !flux.is_black() && flux.is_finite() {
        rays.push(ray);
        let Some(si) = scene.intersect(&mut ray) else { break };
        depth += 1;
        let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
        let Some(s) = scene.bsdf(&si).sample(si.wo, u_lobe, u, Mode::Importance, LobeMask::ALL) else { break };
        let before = flux;
        flux *= s.weight;
        let survive = survival(flux.max_channel() / before.max_channel(), depth, walk.rr_depth);
        if survive < 1.0 {
            if sampler.next_1d() >= survive {
                break;
            }
            flux = flux / survive;
        }
        ray = si.spawn_ray(s.wi);
    }
    rays
}

/// Processor time of this thread that `work` takes.
fn seconds<R>(work: impl FnOnce() -> R) -> f64 {
    let start = thread_seconds();
    black_box(work());
    thread_seconds() - start
}

/// Running time of this thread, seconds; elsewhere than on Linux the clock's.
fn thread_seconds() -> f64 {
    static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    let schedstat = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let running = schedstat.and_then(|s| s.split_whitespace().next()?.parse::<f64>().ok());
    running.map_or_else(|| START.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
