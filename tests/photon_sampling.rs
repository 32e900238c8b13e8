//! Photon paths sampled by what is seen of them bring the same light as independent ones, with less noise where little is
//! seen.

mod common;

use std::path::Path;

use caustica::accel::AccelKind;
use caustica::image::Image;
use caustica::render::PlanOverrides;
use caustica::scene::{LoadOptions, Scene};
use common::Estimate;

/// A scene that ships, its integrator replaced by `sppm` with radii that are the same however photons are sampled.
fn load(name: &str, radius: f64, sampling: &str, width: u32) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let text = std::fs::read_to_string(&path).expect("a scene that ships");
    let (before, rest) = text.split_once("<integrator").expect("an integrator");
    let (_, after) = rest.split_once("</integrator>").expect("its end");
    let text = format!(
        "{before}<integrator type=\"sppm\"><float name=\"initial_radius\" value=\"{radius}\"/><string \
         name=\"photon_sampling\" value=\"{sampling}\"/></integrator>{after}"
    );
    let options = LoadOptions { accel: AccelKind::Auto, width: Some(width), ..LoadOptions::default() };
    Scene::from_text(&text, &path, &options).unwrap_or_else(|e| panic!("{e}"))
}

fn render(scene: &Scene, passes: u64, photons: u64, seed: u64) -> Image {
    let (passes, photons, seed) = (Some(passes), Some(photons), Some(seed));
    common::run(scene, PlanOverrides { passes, photons, seed, ..PlanOverrides::default() }).image
}

/// Means of the picture and of its four quarters.
fn parts(image: &Image) -> [f64; 5] {
    let (w, h) = (image.width(), image.height());
    let mut sums = [(0.0, 0u32); 5];
    for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
        let quarter = 1 + usize::from(2 * x >= w) + 2 * usize::from(2 * y >= h);
        for part in [0, quarter] {
            sums[part].0 += image.pixel(x, y).mean() as f64;
            sums[part].1 += 1;
        }
    }
    sums.map(|(sum, n)| sum / n as f64)
}

/// Means of the picture and of its quarters agree: over eight seeds, the mean difference is within 5.4 of its standard errors,
/// the 99.9 % point of Student's t with 7 degrees of freedom, and these are below 2 %. Camera samples are the same in both.
fn agree(name: &str, radius: f64, width: u32, passes: u64, photons: u64) {
    let [alone, chains] = ["independent", "visibility"].map(|sampling| {
        let scene = load(name, radius, sampling, width);
        (1..=8).map(|seed| parts(&render(&scene, passes, photons, seed))).collect::<Vec<_>>()
    });
    for part in 0..5 {
        let mean = Estimate::of(alone.iter().map(|r| r[part])).mean;
        let difference = Estimate::of(alone.iter().zip(&chains).map(|(a, b)| b[part] - a[part]));
        println!("{name}, part {part}: {mean}, {difference:?}");
        assert!(difference.mean.abs() < 5.4 * difference.error, "{name}, part {part}: {difference:?} of {mean}");
        assert!(difference.error < 0.02 * mean, "{name}, part {part}: too noisy to tell, {difference:?} of {mean}");
    }
}

#[test]
fn same_light_in_the_box_with_spheres() {
    agree("cornell-spheres.xml", 10.0, 32, 4, 10_000);
}

#[test]
fn same_light_in_the_pool() {
    agree("pool.xml", 0.03, 32, 4, 10_000);
}

/// Through a small window, the mean square of the noise is less than a fifth at the same number of photon paths. It is that
/// of pictures of single seeds around the mean over all seeds.
#[test]
fn less_noise_through_a_small_window() {
    const SEEDS: u64 = 6;
    let [alone, chains] = ["independent", "visibility"].map(|sampling| {
        let scene = load("window.xml", 0.1, sampling, 32);
        let images: Vec<Image> = (1..=SEEDS).map(|seed| render(&scene, 8, 20_000, seed)).collect();
        let pixels = images[0].pixels().len();
        let square: f64 = (0..pixels)
            .map(|i| {
                let values = images.iter().map(|image| image.pixels()[i].mean() as f64);
                let e = Estimate::of(values);
                e.error.powi(2) * SEEDS as f64
            })
            .sum();
        square / pixels as f64
    });
    println!("mean square noise: {alone} independent, {chains} with chains");
    assert!(chains < 0.2 * alone, "{chains}, not below a fifth of {alone}");
}
