use std::path::Path;

use super::*;
use crate::color::rgbe;
use crate::sample::Sequence;
use crate::scene::LoadOptions;

fn scene(inside: &str) -> Scene {
    let text = format!("<scene version=\"3.0.0\"><sensor type=\"perspective\"/>{inside}</scene>");
    Scene::from_text(&text, Path::new("scene.xml"), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// A floor at y = 0 of 4 × 4.
const FLOOR: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/>
    </transform><bsdf type="diffuse"/></shape>"#;

/// A square light of side 0.4 that shines down from y = 2.
const LAMP: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.2"/><rotate x="1" angle="90"/>
    <translate y="2"/></transform><emitter type="area"><rgb name="radiance" value="10"/></emitter></shape>"#;

fn glass(x: f32, y: f32, radius: f32) -> String {
    format!(
        "<shape type=\"sphere\"><point name=\"center\" x=\"{x}\" y=\"{y}\" z=\"0\"/><float name=\"radius\" \
         value=\"{radius}\"/><bsdf type=\"dielectric\"/></shape>"
    )
}

fn settings(seed: u64, guided: bool, paths: u64) -> ShootSettings {
    let walk = WalkSettings { max_depth: None, rr_depth: 1, sequence: Sequence::Independent };
    let photons = 1 << 40;
    ShootSettings { seed, pass: 0, target: Target::Caustic, walk, photons, max_paths: paths, guided }
}

/// Caustic power that lands in each square of an 8 × 8 grid over what the photons cover.
fn landed(scene: &Scene, settings: &ShootSettings) -> Vec<f64> {
    let shot = shoot(scene, settings);
    assert_eq!(shot.emitted, settings.max_paths);
    assert!(shot.balance.relative_error() < 1e-6, "{:?}", shot.balance);
    let (centre, radius) = scene.bounding_sphere();
    let mut bins = vec![0.0; 64];
    for photon in &shot.photons {
        let at = |axis: usize| {
            let x = (photon.position[axis] - centre[axis]) / (0.5 * radius) + 0.5;
            ((x * 8.0).max(0.0) as usize).min(7)
        };
        bins[8 * at(2) + at(0)] += rgbe::unpack(photon.power).g as f64;
    }
    bins
}

/// Mean over the squares of the variance between seeds, and the means of the squares.
fn spread(scene: &Scene, guided: bool, paths: u64, seeds: u64) -> (f64, Vec<f64>) {
    let runs: Vec<Vec<f64>> = (0..seeds).map(|seed| landed(scene, &settings(seed, guided, paths))).collect();
    let n = seeds as f64;
    let means: Vec<f64> = (0..64).map(|b| runs.iter().map(|r| r[b]).sum::<f64>() / n).collect();
    let squares = runs.iter().flat_map(|r| r.iter().zip(&means).map(|(x, m)| (x - m).powi(2)));
    (squares.sum::<f64>() / (n - 1.0) / 64.0, means)
}

/// The same light lands at the same places, with less noise by the factor `gain`: 6 seeds of as many emitted paths.
fn compare(scene: &Scene, paths: u64, gain: f64) {
    let seeds = 6;
    let (plain, plain_means) = spread(scene, false, paths, seeds);
    let (guided, guided_means) = spread(scene, true, paths, seeds);
    // The sum over all squares differs by noise alone: four standard errors, squares taken as independent.
    let (a, b): (f64, f64) = (plain_means.iter().sum(), guided_means.iter().sum());
    let error = (64.0 * (plain + guided) / seeds as f64).sqrt();
    assert!(a > 0.0 && (a - b).abs() < 4.0 * error, "plain {a}, guided {b}, standard error {error}");
    assert!(plain > gain * guided, "variance {plain} plain, {guided} guided: a gain of {}", plain / guided);
}

#[test]
fn aiming_at_a_glass_sphere_gains_ten_times() {
    compare(&scene(&format!("{FLOOR}{LAMP}{}", glass(0.5, 0.4, 0.2))), 8192, 10.0);
}

/// A plate with gaps at its sides hides most of both spheres from the lamp.
#[test]
fn aiming_at_two_casters_behind_an_occluder_gains_five_times() {
    let plate = r#"<shape type="rectangle"><transform name="to_world"><scale x="0.55" y="2" z="1"/>
        <rotate x="1" angle="90"/><translate y="1"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"#;
    let inside = format!("{FLOOR}{LAMP}{plate}{}{}", glass(1.0, 0.4, 0.25), glass(-0.9, 0.3, 0.2));
    compare(&scene(&inside), 8192, 5.0);
}

/// Each light has its own room and its own glass sphere; one is 10⁶ times as strong.
#[test]
fn a_dim_light_alone_in_its_room_gets_its_photons() {
    let room = |x: f32, watts: f32| {
        format!(
            "<shape type=\"cube\"><transform name=\"to_world\"><translate x=\"{x}\"/></transform><bsdf type=\"twosided\">\
             <bsdf type=\"diffuse\"/></bsdf></shape><emitter type=\"point\"><point name=\"position\" x=\"{x}\" y=\"0.8\" \
             z=\"0\"/><rgb name=\"intensity\" value=\"{watts}\"/></emitter>{}",
            glass(x, -0.5, 0.2)
        )
    };
    let scene = scene(&format!("{}{}", room(-2.0, 1e6), room(2.0, 1.0)));
    let shot = shoot(&scene, &settings(1, true, 8192));
    let dim = shot.photons.iter().filter(|p| p.position[0] > 0.0).count();
    assert!(20 * dim > shot.photons.len() && dim > 200, "{dim} of {} photons are in the dim room", shot.photons.len());
}

#[test]
fn nothing_is_learnt_where_nothing_focuses() {
    let scene = scene(&format!("{FLOOR}{LAMP}"));
    assert!(Guide::learn(&scene, &settings(1, true, 4096)).is_none());
    assert_eq!(plan_emission(&scene, &settings(1, true, 4096)).paths, 0);
}

#[test]
fn many_paths_at_a_time_store_what_each_stores_alone() {
    let scene = scene(&format!("{FLOOR}{LAMP}{}", glass(0.0, 0.7, 0.4)));
    for target in [Target::Caustic, Target::Global, Target::Indirect] {
        for sequence in [Sequence::Independent, Sequence::Sobol] {
            let walk = WalkSettings { max_depth: None, rr_depth: 1, sequence };
            let key = Key::new(1, target.purpose(), 0);
            let [mut alone, mut together] = [(); 2].map(|()| Deposit::new(target, walk, 5000));
            for index in 100..5100 {
                alone.trace(&scene, None, key, index);
            }
            together.trace_all(&scene, None, key, 100..5100);
            assert!(alone.photons.len() > 100 || target == Target::Indirect, "{target:?}: {}", alone.photons.len());
            assert_eq!(together.photons, alone.photons, "{target:?}");
            assert_eq!((together.rejected, together.counters), (alone.rejected, alone.counters));
            assert!(together.balance.relative_error() < 1e-12);
        }
    }
}
