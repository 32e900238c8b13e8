//! Means of pictures: what changes where light paths start, and how many, leaves them where they are.

use super::super::emission::{Emission, Learnt};
use super::super::{Merging, Recipe, VcmSettings, Workspace, render_pass};
use super::scenes::{DISTANT, FINITE, load_calm};
use crate::film::Film;

/// Guided light paths leave the picture's mean where it is, for lamps, points, the sun and a sky alike, and so do three for
/// each pixel with merges of a small radius: 32 seeds each; five standard errors, together at most 2 %, which one of 10⁴ right
/// programs would miss.
#[test]
fn guided_and_more_light_paths_keep_the_mean() {
    for (sensor, lights) in [("perspective", FINITE), ("orthographic", DISTANT)] {
        let scene = load_calm(sensor, lights);
        let means = |settings: &VcmSettings, learnt: &Learnt| -> Vec<f64> {
            let mean = |seed| {
                let mut film = Film::new(scene.camera.window(), scene.film.filter);
                let mut workspace = Workspace::default();
                workspace.learnt = Some(learnt.clone());
                render_pass(&scene, settings, seed, 0..32, &mut film, &mut workspace, &|_| ());
                let image = film.develop(1.0 / 32.0);
                let pixels = (0..256).map(|i| image.pixel(i % 16, i / 16).mean() as f64);
                pixels.sum::<f64>() / 256.0
            };
            (1..=32).map(mean).collect()
        };
        let estimate = |values: Vec<f64>| {
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)))
        };
        let unmerged = VcmSettings { merging: Merging::Off, ..VcmSettings::default() };
        let merged = VcmSettings { initial_radius: Some(0.02), ..VcmSettings::default() };
        let (emission, _) = Emission::try_out(&Recipe::new(&scene, &unmerged)).expect("lights that can be guided");
        let plain = Learnt { emission: None, guidance: None, per_pixel: 1 };
        let guided = Learnt { emission: Some(emission), ..plain.clone() };
        let more = Learnt { per_pixel: 3, ..plain.clone() };
        let (mean, a) = estimate(means(&unmerged, &plain));
        for (name, settings, learnt) in [("guided", &unmerged, &guided), ("more", &merged, &more)] {
            let (other, b) = estimate(means(settings, learnt));
            let off = (mean - other).abs() / (a + b).sqrt();
            assert!(off < 5.0 && (a + b).sqrt() < 0.004 * mean, "{sensor}: {mean}, {name} {other}, {off}");
        }
    }
}
