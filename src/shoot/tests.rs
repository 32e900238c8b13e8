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
    let glass = glass(0.0, 0.7, 0.4);
    // Of a sky, many rays pass by the box of the scene and are not traced at all.
    let sky = r#"<emitter type="constant"><rgb name="radiance" value="0.3, 0.5, 1"/></emitter>"#;
    for light in [LAMP.to_string(), format!("{LAMP}{sky}")] {
        let scene = scene(&format!("{FLOOR}{light}{glass}"));
        for target in [Target::Caustic, Target::Global, Target::Indirect] {
            for sequence in [Sequence::Independent, Sequence::Sobol] {
                let walk = WalkSettings { max_depth: None, rr_depth: 1, sequence };
                let key = Key::new(1, target.purpose(), 0);
                let [mut alone, mut together] = [(); 2].map(|()| Deposit::new(target, walk, 5000));
                for index in 100..5100 {
                    alone.trace(&scene, None, key, index);
                }
                together.trace_all(&scene, None, key, 100..5100);
                assert!(alone.photons.len() > 40 || target == Target::Indirect, "{target:?}: {}", alone.photons.len());
                assert_eq!(together.photons, alone.photons, "{target:?}");
                assert_eq!((together.rejected, together.counters), (alone.rejected, alone.counters));
                let (a, b) = (together.balance, alone.balance);
                assert!(a.relative_error() < 1e-12);
                for (a, b) in [(a.emitted, b.emitted), (a.escaped, b.escaped)] {
                    assert!((0..3).all(|c| (a[c] - b[c]).abs() <= 1e-9 * b[c]), "{a:?} for {b:?}");
                }
            }
        }
    }
}

/// Batches are joined in the order of their numbers, whichever thread has traced them.
#[test]
fn batches_are_joined_in_order() {
    let scene = scene(&format!("{FLOOR}{LAMP}"));
    let settings = ShootSettings { target: Target::Global, ..settings(1, false, 0) };
    let emission = Emission::unaimed(5 * PATHS_PER_BATCH + 7);
    let key = Key::new(settings.seed, settings.target.purpose(), settings.pass);
    let mut alone = Deposit::new(settings.target, settings.walk, emission.paths);
    alone.trace_all(&scene, None, key, 0..emission.paths);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let shot = pool.install(|| shoot_paths(&scene, &settings, &emission));
        assert!(shot.photons == alone.photons && shot.photons.len() > 10_000, "{} photons", shot.photons.len());
        assert!(shot.photons.capacity() <= shot.photons.len() / 32 * 33 + 32, "{}", shot.photons.capacity());
        assert_eq!(shot.counters, alone.counters);
    }
}

/// What a guide learns by: the power of the photons of each path, up to how they are packed.
#[test]
fn many_paths_at_a_time_are_measured_one_by_one() {
    let scene = scene(&format!("{FLOOR}{LAMP}{}", glass(0.0, 0.7, 0.4)));
    let guide = Guide::learn(&scene, &settings(1, true, 4096)).expect("glass focuses");
    let walk = WalkSettings { max_depth: None, rr_depth: 1, sequence: Sequence::Independent };
    for target in [Target::Caustic, Target::Global] {
        let key = Key::new(1, target.purpose(), 0);
        let powers = Deposit::new(target, walk, 1).measure_all(&scene, &guide, key, 20..1020);
        let alone = |index| {
            let mut deposit = Deposit::new(target, walk, 1);
            deposit.trace(&scene, Some(&guide), key, index);
            deposit.photons.iter().map(|p| rgbe::unpack(p.power).max_channel() as f64).sum::<f64>()
        };
        for (index, power) in (20..).zip(&powers) {
            let alone = alone(index);
            assert!((power - alone).abs() <= 0.02 * alone, "{target:?}, path {index}: {power} for {alone}");
        }
        assert!(powers.len() == 1000 && powers.iter().filter(|&&p| p > 0.0).count() > 100, "{target:?}");
    }
}

/// What photons meet of all kinds that are scattered together: what is two-sided, what is not, a needle, a ball, waves with
/// normals of their own, glass and metal, smooth and rough.
fn solids() -> String {
    let place = |scale: &str, angle: i32, at: &str| {
        format!(
            "<transform name=\"to_world\"><scale {scale}/><rotate x=\"1\" angle=\"{angle}\"/><translate {at}/></transform>"
        )
    };
    let sheet = |scale: &str, angle: i32, at: &str, bsdf: &str| {
        format!("<shape type=\"rectangle\">{}{bsdf}</shape>", place(scale, angle, at))
    };
    let waves = |angle: i32, y: f32, bsdf: &str| {
        let file = format!("{}/scenes/waves.ply", env!("CARGO_MANIFEST_DIR"));
        let at = place(r#"value="0.5""#, angle, &format!(r#"x="1.2" y="{y}" z="-1""#));
        format!(r#"<shape type="ply"><string name="filename" value="{file}"/>{at}{bsdf}</shape>"#)
    };
    let ball = |at: &str, radius: f32, bsdf: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" {at}/><float name="radius" value="{radius}"/>{bsdf}</shape>"#
        )
    };
    let both = |bsdf: &str| format!(r#"<bsdf type="twosided">{bsdf}</bsdf>"#);
    let chalk = r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.9, 0.4"/></bsdf>"#;
    let tinted = r#"<bsdf type="dielectric"><rgb name="specular_transmittance" value="0.9, 0.5, 0.2"/></bsdf>"#;
    let silver = |alpha: f32| {
        let ggx = r#"<string name="material" value="Ag"/><string name="distribution" value="ggx"/>"#;
        format!(r#"<bsdf type="roughconductor">{ggx}<float name="alpha" value="{alpha}"/></bsdf>"#)
    };
    [
        sheet(r#"x="1e-4" y="2" z="1""#, -60, r#"y="0.5""#, &both(chalk)),
        ball(r#"x="-1" y="0.6" z="0""#, 0.3, &both(r#"<bsdf type="diffuse"/>"#)),
        waves(170, 0.4, &(both(chalk) + r#"<boolean name="flip_normals" value="true"/>"#)),
        waves(0, 0.9, r#"<bsdf type="dielectric"/>"#),
        waves(20, 1.4, &both(&silver(0.2))),
        sheet(r#"value="0.6""#, 80, r#"x="-1" y="1.2" z="1""#, tinted),
        sheet(r#"value="0.4""#, -70, r#"x="-1" y="0.7" z="-1.3""#, &silver(0.02)),
        sheet(r#"value="0.4""#, 60, r#"x="0" y="0.7" z="-1.3""#, &silver(0.5)),
        ball(r#"x="0.5" y="1.3" z="0.4""#, 0.15, &both(r#"<bsdf type="conductor"/>"#)),
    ]
    .concat()
}

/// Lights of every kind, alone and mixed, over all these: photons alone, which are compiled for any processor, are those that start
/// and land together in vectors.
#[test]
fn every_light_starts_many_paths_as_one() {
    let sky = format!("{}/scenes/sky.exr", env!("CARGO_MANIFEST_DIR"));
    let lights = [
        format!(r#"<emitter type="envmap"><string name="filename" value="{sky}"/></emitter>"#),
        r#"<emitter type="constant"><rgb name="radiance" value="1, 2, 3"/></emitter>"#.to_owned(),
        r#"<emitter type="directional"><vector name="direction" value="0.3, -1, 0.2"/></emitter>"#.to_owned(),
        r#"<emitter type="point"><point name="position" x="0.3" y="1.5" z="0.8"/></emitter>"#.to_owned(),
        r#"<emitter type="spot"><transform name="to_world"><lookat origin="0, 3, 0" target="0, 0, 0" up="1, 0, 0"/>
            </transform></emitter>"#
            .to_owned(),
        r#"<shape type="sphere"><point name="center" x="1" y="2" z="0"/><float name="radius" value="0.2"/>
            <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>"#
            .to_owned(),
        LAMP.to_owned(),
    ];
    // All but the first environment, of which there is one at most, and a light that the floor turns its back to.
    let below = lights[3].replace("1.5", "-1.5");
    let mixed = lights[1..].concat() + &below;
    let solids = solids();
    for light in lights.iter().chain([&mixed]) {
        let scene = scene(&format!("{FLOOR}{solids}{light}{}", glass(0.0, 0.7, 0.4)));
        let walk = WalkSettings { max_depth: Some(5), rr_depth: 2, sequence: Sequence::Independent };
        for (target, guided) in [(Target::Global, false), (Target::Indirect, false), (Target::Caustic, true)] {
            let guide = guided.then(|| Guide::learn(&scene, &settings(1, true, 4096)).expect("glass focuses"));
            let key = Key::new(1, target.purpose(), 0);
            let [mut alone, mut together] = [(); 2].map(|()| Deposit::new(target, walk, 3000));
            for index in 7..3007 {
                alone.trace(&scene, guide.as_ref(), key, index);
            }
            together.trace_all(&scene, guide.as_ref(), key, 7..3007);
            assert!(alone.photons.len() > 20, "{light}: {} photons", alone.photons.len());
            assert_eq!(together.photons, alone.photons, "{light}");
            assert_eq!((together.rejected, together.counters), (alone.rejected, alone.counters), "{light}");
            let (a, b) = (alone.balance, together.balance);
            for (a, b) in [(a.emitted, b.emitted), (a.absorbed, b.absorbed), (a.escaped, b.escaped), (a.cut, b.cut)] {
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9 * alone.balance.emitted[0]), "{light}");
            }
        }
    }
}

/// Two scenes shine the same light on the same places: 6 seeds, four standard errors of the sum over all places.
fn same_light(a: &Scene, b: &Scene, guided: bool, paths: u64) {
    let seeds = 6;
    let ((va, ma), (vb, mb)) = (spread(a, guided, paths, seeds), spread(b, guided, paths, seeds));
    let (sum_a, sum_b): (f64, f64) = (ma.iter().sum(), mb.iter().sum());
    let error = (64.0 * (va + vb) / seeds as f64).sqrt();
    assert!(sum_a > 10.0 * error && (sum_a - sum_b).abs() < 4.0 * error, "{sum_a} and {sum_b}, standard error {error}");
}

/// Two lamps of which the scene file gives the weaker the share `share` of the photons, if any, over a glass sphere.
fn two_lamps(share: Option<f32>) -> Scene {
    let share = share.map_or(String::new(), |s| format!("<float name=\"photon_share\" value=\"{s}\"/>"));
    let point = format!(
        "<emitter type=\"point\"><point name=\"position\" x=\"0.6\" y=\"1.5\" z=\"0.3\"/>\
         <rgb name=\"intensity\" value=\"0.1\"/>{share}</emitter>"
    );
    scene(&format!("{FLOOR}{LAMP}{point}{}", glass(0.3, 0.5, 0.35)))
}

#[test]
fn lights_emit_their_shares_of_the_photons_and_no_more_light() {
    let (plain, shared) = (two_lamps(None), two_lamps(Some(0.8)));
    for (target, guided) in [(Target::Caustic, false), (Target::Caustic, true), (Target::Global, false)] {
        let shot = shoot(&shared, &ShootSettings { target, ..settings(3, guided, 40_000) });
        let paths = shot.aimed.paths[0] as f64;
        // Five standard deviations of a binomial count.
        let deviation = (40_000.0 * 0.8 * 0.2f64).sqrt();
        assert!((paths - 32_000.0).abs() < 5.0 * deviation, "{target:?}: {paths} of 40000 paths");
    }
    same_light(&plain, &shared, false, 16_384);
    same_light(&plain, &shared, true, 8192);
}

#[test]
fn a_light_without_photons_is_told() {
    let dark = two_lamps(Some(0.0));
    assert!(dark.warnings.iter().any(|w| w.contains("the light emits no photons")), "{:?}", dark.warnings);
    assert!(shoot(&dark, &settings(1, true, 8192)).aimed.paths.is_empty());
    // With no other light there is nothing to shoot.
    let alone = "<emitter type=\"point\"><float name=\"photon_share\" value=\"0\"/></emitter>";
    let shot = shoot(&scene(&format!("{FLOOR}{alone}")), &settings(1, true, 8192));
    assert_eq!((shot.emitted, shot.photons.len()), (0, 0));
}

#[test]
fn more_photons_take_the_way_of_a_target_and_bring_no_more_light() {
    let two = |first: &str, second: &str| {
        let add = |sphere: String, target: &str| match target {
            "" => sphere,
            t => sphere.replace("<bsdf", &format!("<float name=\"photon_target\" value=\"{t}\"/><bsdf")),
        };
        scene(&format!("{FLOOR}{LAMP}{}{}", add(glass(0.7, 0.4, 0.3), first), add(glass(-0.7, 0.4, 0.3), second)))
    };
    let shares = |scene: &Scene| {
        let shot = shoot(scene, &settings(3, true, 40_000));
        let found = &shot.aimed.photons;
        [0, 1].map(|i| found.get(i).copied().unwrap_or(0) as f64 / shot.photons.len() as f64)
    };
    let (even, uneven) = (two("1", "1"), two("8", "1"));
    let ([a, b], [c, d]) = (shares(&even), shares(&uneven));
    assert!((a - b).abs() < 0.1 && a + b > 0.9, "{a} {b}");
    assert!(c > 0.7 && c > 4.0 * d, "{c} {d}");
    // What is not aimed at is still met by chance.
    let [e, f] = shares(&two("0", "1"));
    assert!(e > 0.0 && e < 0.3 * f, "{e} {f}");
    let plain = two("", "");
    assert_eq!(shoot(&even, &settings(1, true, 8192)).photons, shoot(&plain, &settings(1, true, 8192)).photons);
    same_light(&plain, &uneven, true, 8192);
    same_light(&plain, &two("0", "1"), true, 8192);
}
