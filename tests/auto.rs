//! `--integrator auto`: it picks what suits the scene, the same each time, and says why.

mod common;

use std::path::Path;

use caustica::accel::AccelKind;
use caustica::render::{Choice, PlanOverrides, choose};
use caustica::scene::{LoadOptions, Scene};
use common::program::Folder;
use common::{floor_under_a_pane, scene};

/// A ball on a floor under a grey sky: light samples find everything at once.
const UNDER_THE_SKY: &str = r#"<scene version="3.0.0">
  <integrator type="auto"/>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 1.2, 4" target="0, 0.4, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/></film>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/></transform></shape>
  <shape type="sphere"><point name="center" x="0" y="0.5" z="0"/><float name="radius" value="0.5"/></shape>
  <emitter type="constant"/>
</scene>"#;

fn chosen(xml: &str) -> Choice {
    let mut s = scene(xml, AccelKind::Bvh);
    let window = s.camera.window();
    let o = PlanOverrides { integrator: Some("auto".into()), ..PlanOverrides::default() };
    let choice = choose(&mut s, &o).expect("a plan").expect("a choice was asked for");
    assert_eq!(s.camera.window(), window, "the film is as it was");
    choice
}

/// The choice for a scene of the repository.
fn chosen_for(name: &str, seed: u64) -> Choice {
    chosen_with(name, &PlanOverrides { seed: Some(seed), ..PlanOverrides::default() })
}

fn chosen_with(name: &str, o: &PlanOverrides) -> Choice {
    let o = PlanOverrides { integrator: Some("auto".into()), ..o.clone() };
    let options = LoadOptions { accel: AccelKind::Bvh, ..LoadOptions::default() };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let mut s = Scene::load(&path, &options).expect("a scene of the repository");
    choose(&mut s, &o).expect("a plan").expect("a choice was asked for")
}

#[test]
fn the_method_suits_the_scene() {
    assert_eq!(chosen(UNDER_THE_SKY).method, "path");
    // Path tracing finds nothing under a pane and would report no noise at all.
    let pane = chosen(&floor_under_a_pane(""));
    assert!(["sppm", "vcm"].contains(&pane.method), "{pane:?}");
    assert_eq!(pane.trials.len(), 3);
    // Direct light alone.
    let shallow = UNDER_THE_SKY.replace(r#""auto"/>"#, r#""auto"><integer name="max_depth" value="2"/></integrator>"#);
    assert_eq!(chosen(&shallow).method, "path");
}

/// Three samples of `path` a pixel meet the sun that comes through the window here and there, and its noise is sixty times the
/// square of the picture; chains of photon paths have less, though nothing but `path` and `vcm` is sure about the level.
#[test]
fn rare_light_is_not_taken_for_little_noise() {
    let o = PlanOverrides { integrator: Some("auto".into()), ..PlanOverrides::default() };
    let options = LoadOptions { accel: AccelKind::Bvh, ..LoadOptions::default() };
    let mut s =
        Scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/window.xml"), &options).expect("a scene");
    let choice = choose(&mut s, &o).expect("a plan").expect("a choice");
    let noise = |method: &str| choice.trials.iter().find(|t| t.method == method).expect("tried").noise;
    assert!(choice.method == "sppm" && noise("path") > 20.0 && noise("sppm") < 2.0, "{choice:?}");
}

/// The caustic of a glass ball lights a few blocks only: on the average over all of them it does not stand out from noise. Few
/// samples of `path` ever meet it, and a picture looks best without. Of the noise of `sppm` about a third is of photons: the rest
/// falls with the passes.
#[test]
fn light_in_a_small_place_is_missed() {
    for seed in 1..=4 {
        let choice = chosen_for("gallery/glass-sphere.xml", seed);
        let trial = |method: &str| choice.trials.iter().find(|t| t.method == method).expect("tried");
        let promise = |method: &str| trial(method).work_to_goal();
        assert!(choice.method != "path" && promise("path") > 10.0 * promise("sppm"), "{choice:?}");
        let share = |method: &str| trial(method).photon_noise / trial(method).noise;
        assert!((0.15..0.6).contains(&share("sppm")) && (0.3..0.8).contains(&share("vcm")), "{choice:?}");
        // First radii take a map of photons of their own.
        assert!(trial("sppm").preparation > trial("sppm").work && trial("vcm").preparation < 0.1, "{choice:?}");
    }
}

/// Everything else promises many seconds under a glass ball, so that photon maps are tried as well; not in a box of walls, which
/// others are done with before, and not where less is wanted than what they blur.
#[test]
fn photon_maps_are_tried_where_they_can_save_much() {
    for seed in 1..=3 {
        let choice = chosen_for("gallery/glass-sphere.xml", seed);
        let maps = choice.trials.last().expect("trials");
        assert_eq!(
            (choice.method, maps.method, choice.trials.len()),
            ("photonmapper", "photonmapper", 4),
            "{choice:?}"
        );
    }
    assert_eq!(chosen_for("cornell-box.xml", 1).trials.len(), 3);
    let fine = PlanOverrides { target_error: Some(1e-3), ..PlanOverrides::default() };
    let choice = chosen_with("gallery/glass-sphere.xml", &fine);
    assert!(choice.trials.iter().all(|t| t.method != "photonmapper"), "{choice:?}");
}

/// With these seeds two samples of `path` a pixel meet no light through the glass, and none is missing that stands out.
#[test]
fn light_through_glass_is_met_before_path_is_believed() {
    for (name, seed) in [("gallery/iced-water.xml", 4), ("gallery/cognac.xml", 3)] {
        let choice = chosen_for(name, seed);
        assert_ne!(choice.method, "path", "{name}: {choice:?}");
    }
}

/// The lamp is seen in every ball of glass, much smaller than a pixel: noise of all methods alike, of several times the square of
/// the picture, which two passes do not meet or take for the picture (0.12 is told by them). Then the cheaper sample wins.
#[test]
fn images_of_a_lamp_in_glass_are_known_for_what_they_are() {
    let choice = chosen_for("gallery/sphereflake.xml", 1);
    let noise = |method: &str| {
        let t = choice.trials.iter().find(|t| t.method == method).expect("tried");
        (t.noise - t.photon_noise) * t.samples as f64
    };
    let [sppm, vcm] = ["sppm", "vcm"].map(noise);
    assert!(sppm > 0.6 && (0.5..2.0).contains(&(sppm / vcm)), "{choice:?}");
    assert!(choice.method == "vcm" || choice.samples_per_pass >= Some(4), "{choice:?}");
}

/// What `sppm` blurs at the edges of the ring's caustic takes it more passes than its noise.
#[test]
fn blur_is_seen() {
    let choice = chosen_for("ring.xml", 2);
    let sppm = choice.trials.iter().find(|t| t.method == "sppm").expect("tried");
    assert!(choice.method == "vcm" && sppm.blur > 0.01 && sppm.passes > 20.0, "{choice:?}");
}

#[test]
fn a_named_method_is_no_choice() {
    let mut s = scene(&floor_under_a_pane(""), AccelKind::Bvh);
    assert!(choose(&mut s, &PlanOverrides::default()).expect("a plan").is_none());
}

#[test]
fn a_large_film_is_tried_in_small_and_rendered_whole() {
    let f = Folder::new(&UNDER_THE_SKY.replace("\"48\"", "\"600\"").replace("\"32\"", "\"400\""));
    let report = f.json("render scene.xml -o a.exr --json --spp 1");
    assert_eq!((report["choice"]["method"].as_str(), report["integrator"].as_str()), (Some("path"), Some("path")));
    // Path tracing is done here before others have been tried.
    assert_eq!(report["choice"]["trials"].as_array().map(Vec::len), Some(1));
    assert_eq!((f.image("a.exr").width(), f.image("a.exr").height()), (600, 400));
    // The choice depends on the scene and the seed alone.
    let again = f.json("render scene.xml -o b.exr --json --spp 1 --threads 3");
    assert_eq!(report["choice"], again["choice"]);
    assert_eq!(f.image("a.exr").pixels(), f.image("b.exr").pixels());
}

#[test]
fn the_choice_is_told() {
    let f = Folder::new(UNDER_THE_SKY);
    assert!(f.succeeds("info scene.xml").contains("auto"));
    let told = f.run("render scene.xml -o a.exr --spp 1");
    assert!(String::from_utf8_lossy(&told.stderr).contains("chose path (rays per pixel to relmse"));
}
