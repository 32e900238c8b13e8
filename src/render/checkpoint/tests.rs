use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::{Checkpoint, CheckpointError};
use crate::image::Image;
use crate::integrator::Layer;
use crate::render::{Control, Plan, PlanOverrides, Session, Silent};
use crate::scene::{LoadOptions, Scene};

fn scene(parameter: &str) -> Scene {
    let parameter =
        if parameter.is_empty() { String::new() } else { format!(r#"<boolean name="{parameter}" value="true"/>"#) };
    let text = format!(
        r#"<scene version="3.0.0">
        <integrator type="sppm">{parameter}</integrator>
        <sensor type="perspective">
          <transform name="to_world"><lookat origin="0, 0, 3" target="0, 0, 0" up="0, 1, 0"/></transform>
          <film type="hdrfilm"><integer name="width" value="9"/><integer name="height" value="7"/></film></sensor>
        <shape type="sphere"><bsdf type="plastic"/></shape>
        <shape type="sphere"><point name="center" x="2" y="0" z="0"/><bsdf type="dielectric"/></shape>
        <emitter type="constant"/></scene>"#
    );
    Scene::from_text(&text, Path::new("scene.xml"), &LoadOptions::default()).expect("a good scene")
}

const SHARED: &str = "shared_statistics";

fn plan(scene: &Scene, integrator: &str, passes: std::ops::Range<u64>) -> Plan {
    let o = PlanOverrides {
        integrator: Some(integrator.into()),
        passes: Some(6),
        photons: Some(2000),
        track_error: true,
        ..PlanOverrides::default()
    };
    Plan { passes, ..Plan::new(scene, &o).expect("a good plan") }
}

fn advance(session: &mut Session, passes: u64) {
    let stop = AtomicBool::new(false);
    let control = Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent };
    for _ in 0..passes {
        session.step(&control);
    }
}

fn through_file(c: &Checkpoint) -> Checkpoint {
    Checkpoint::decode(&c.encode(), Path::new("x")).expect("what was written")
}

#[test]
fn a_resumed_render_has_the_bits_of_an_unbroken_one() {
    let cases = [("path", ""), ("sppm", ""), ("sppm", SHARED), ("sppm", "chi_squared_radius"), ("photonmapper", "")];
    for (integrator, parameter) in cases {
        let s = scene(parameter);
        let mut p = plan(&s, integrator, 0..6);
        p.spp = None;
        let mut whole = Session::new(&s, &p);
        advance(&mut whole, 6);
        for stop in [0, 1, 4, 6] {
            let mut first = Session::new(&s, &p);
            advance(&mut first, stop);
            let mut second = Session::resume(&s, &p, &through_file(&Checkpoint::of(&first))).expect("the same render");
            advance(&mut second, 6 - stop);
            let what = format!("{integrator}, {parameter}, stopped after {stop}");
            assert_eq!(whole.image().pixels(), second.image().pixels(), "{what}");
            assert_eq!(whole.variance(), second.variance(), "{what}");
            assert_eq!((whole.summary.spp, whole.passes()), (second.summary.spp, second.passes()), "{what}");
            assert_eq!(whole.summary.counters.samples, second.summary.counters.samples, "{what}");
        }
    }
}

/// Layers of a photon mapper, tinted so that all of them hold something.
fn layered(passes: std::ops::Range<u64>, layers: &[Layer]) -> (Scene, Plan) {
    let s = scene("");
    let p = Plan { spp: None, layers: layers.to_vec(), ..plan(&s, "photonmapper", passes) };
    (s, p)
}

const LAYERS: [Layer; 3] = [Layer::Photons, Layer::Direct, Layer::Density];

/// All channels of a picture with its layers.
fn channels(image: &Image) -> Vec<(&str, Vec<f32>)> {
    let names = image.channels().iter().map(|c| c.name.as_str());
    names.map(|n| (n, image.channel(n).expect("a name of its own").to_vec())).collect()
}

#[test]
fn layers_go_on_with_the_bits_of_an_unbroken_render() {
    let (s, p) = layered(0..6, &LAYERS);
    let layers = |session: &Session| session.layers.as_ref().expect("layers").states();
    let mut whole = Session::new(&s, &p);
    advance(&mut whole, 6);
    assert!(layers(&whole).iter().all(|(_, f)| f.samples.iter().any(|s| s[1] > 0.0)), "a layer is black");
    for stop in [0, 1, 4, 6] {
        let mut first = Session::new(&s, &p);
        advance(&mut first, stop);
        let mut second = Session::resume(&s, &p, &through_file(&Checkpoint::of(&first))).expect("the same render");
        assert_eq!(layers(&first), layers(&second), "taken up after {stop}");
        advance(&mut second, 6 - stop);
        assert_eq!(layers(&whole), layers(&second), "stopped after {stop}");
    }
    // Other layers, or none, are refused.
    let c = Checkpoint::of(&whole);
    for other in [&LAYERS[..2], &[], &[Layer::Direct, Layer::Photons, Layer::Density]] {
        let refused = Session::resume(&s, &layered(0..6, other).1, &c).map(|_| ()).expect_err("other layers");
        assert!(matches!(refused, CheckpointError::Layers { .. }), "{refused}");
        assert!(refused.to_string().contains("photons, direct, density") && refused.to_string().contains("--aov"));
    }
}

#[test]
fn layers_merge_to_those_of_the_single_run() {
    let part = |range: std::ops::Range<u64>, layers: &[Layer]| {
        let (s, p) = layered(range.clone(), layers);
        let mut session = Session::new(&s, &p);
        advance(&mut session, range.end - range.start);
        Checkpoint::of(&session)
    };
    let whole = part(0..4, &LAYERS);
    let merged = Checkpoint::merge(vec![part(3..4, &LAYERS), part(0..3, &LAYERS)]).expect("parts of one render");
    let (a, b) = (whole.image(), through_file(&merged).image());
    let (a, b) = (channels(&a), channels(&b));
    assert!(a.iter().any(|(name, _)| *name == "density.Y") && a.len() == b.len(), "{a:?}");
    for ((name, a), (other, b)) in a.iter().zip(&b) {
        assert_eq!(name, other);
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() <= 1e-6 * a.abs(), "{name}: {a} against {b}");
        }
    }
    let refused = Checkpoint::merge(vec![part(0..1, &LAYERS), part(1..2, &LAYERS[1..])]).expect_err("other layers");
    assert!(matches!(refused, CheckpointError::Layers { .. }), "{refused}");
}

#[test]
fn files_of_older_formats_are_refused_by_name() {
    let s = scene("");
    let mut bytes = Checkpoint::of(&Session::new(&s, &plan(&s, "ppm", 0..6))).encode();
    bytes[8..12].copy_from_slice(&3u32.to_le_bytes());
    let refused = Checkpoint::decode(&bytes, Path::new("old.ckpt")).expect_err("an older format");
    assert!(matches!(refused, CheckpointError::Version { found: 3, expected: 4, .. }), "{refused}");
    assert!(refused.to_string().contains("old.ckpt") && refused.to_string().contains("format 3"));
}

#[test]
fn the_clamp_outlives_a_checkpoint() {
    let s = scene("");
    let mut p = plan(&s, "path", 0..6);
    p.spp = None;
    p.clamp = Some(0.9);
    let part = |range, passes| {
        let mut session = Session::new(&s, &Plan { passes: range, ..p.clone() });
        advance(&mut session, passes);
        session
    };
    let whole = part(0..6, 6).summary.clamp.expect("a clamp");
    assert!(whole.samples > 0 && whole.bias[0] < 0.0, "{whole:?}");
    // Resumed, before and after the next pass.
    let first = part(0..6, 4);
    let mut second = Session::resume(&s, &p, &through_file(&Checkpoint::of(&first))).expect("the same render");
    assert_eq!(second.summary.clamp, first.summary.clamp);
    advance(&mut second, 2);
    assert_eq!(second.summary.clamp, Some(whole.clone()));
    // Merged; sums of f64 in another order.
    let parts = [part(0..2, 2), part(2..6, 4)].map(|s| Checkpoint::of(&s));
    let merged = Checkpoint::merge(parts.to_vec()).expect("parts of one render").clamp().expect("a clamp");
    assert_eq!((merged.limit, merged.samples), (whole.limit, whole.samples));
    assert!((merged.bias[0] / whole.bias[0] - 1.0).abs() < 1e-12);
    // Another limit is another plan.
    let other = Plan { clamp: None, ..p.clone() };
    let refused = Session::resume(&s, &other, &Checkpoint::of(&first)).map(|_| ());
    assert!(matches!(refused, Err(CheckpointError::Plan { .. })), "{refused:?}");
}

#[test]
fn merged_ranges_are_the_single_run() {
    for integrator in ["path", "ppm", "photonmapper"] {
        let s = scene("");
        let part = |range| {
            let mut p = plan(&s, integrator, range);
            p.spp = None;
            let mut session = Session::new(&s, &p);
            advance(&mut session, 6);
            Checkpoint::of(&session)
        };
        let whole = part(0..6);
        let merged = Checkpoint::merge(vec![part(3..6), part(0..1), part(1..3)]).expect("parts of one render");
        assert_eq!((&merged.ranges, merged.spp), (&whole.ranges, whole.spp));
        let (a, b) = (whole.image(), merged.image());
        for (a, b) in a.pixels().iter().zip(b.pixels()) {
            for (a, b) in a.to_array().into_iter().zip(b.to_array()) {
                assert!((a - b).abs() <= 1e-6 * a.abs(), "{integrator}: {a} against {b}");
            }
        }
        // What is merged can go on, too.
        let p = Plan { spp: None, ..plan(&s, integrator, 0..8) };
        assert_eq!(Session::resume(&s, &p, &through_file(&merged)).expect("passes 0..6 of 8").passes(), 6);
    }
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let (s, t) = (scene(""), scene(SHARED));
    let part = |s: &Scene, integrator: &str, range: std::ops::Range<u64>| {
        let passes = range.end - range.start;
        let mut session = Session::new(s, &plan(s, integrator, range));
        advance(&mut session, passes);
        Checkpoint::of(&session)
    };
    let a = part(&s, "ppm", 0..2);
    let refused = |parts: Vec<Checkpoint>| Checkpoint::merge(parts).expect_err("not parts of one render");
    assert!(matches!(refused(vec![a.clone(), part(&s, "ppm", 1..3)]), CheckpointError::Overlap { .. }));
    assert!(matches!(refused(vec![a.clone(), part(&s, "path", 2..3)]), CheckpointError::Plan { .. }));
    assert!(matches!(refused(vec![a.clone(), part(&t, "ppm", 2..3)]), CheckpointError::Scene { .. }));
    assert!(matches!(refused(vec![]), CheckpointError::Nothing));
    let shared = vec![part(&t, "sppm", 0..1), part(&t, "sppm", 1..2)];
    assert!(matches!(refused(shared), CheckpointError::Dependent));
    let tested = scene("chi_squared_radius");
    let tested = vec![part(&tested, "sppm", 0..1), part(&tested, "sppm", 1..2)];
    assert!(matches!(refused(tested), CheckpointError::Dependent));
    let resume = |s: &Scene, p: Plan| Session::resume(s, &p, &a).map(|_| ()).expect_err("another render");
    assert!(matches!(resume(&t, plan(&t, "ppm", 0..6)), CheckpointError::Scene { .. }));
    assert!(matches!(resume(&s, plan(&s, "sppm", 0..6)), CheckpointError::Plan { .. }));
    assert!(matches!(resume(&s, Plan { seed: 3, ..plan(&s, "ppm", 0..6) }), CheckpointError::Plan { .. }));
    assert!(matches!(resume(&s, plan(&s, "ppm", 1..6)), CheckpointError::Passes { .. }));
    assert!(matches!(resume(&s, plan(&s, "ppm", 0..1)), CheckpointError::Passes { .. }));
}

#[test]
fn damage_is_found() {
    let s = scene("");
    let p = Plan { layers: vec![Layer::Density], ..plan(&s, "photonmapper", 0..6) };
    let mut session = Session::new(&s, &p);
    advance(&mut session, 2);
    let bytes = Checkpoint::of(&session).encode();
    let read = |bytes: &[u8]| Checkpoint::decode(bytes, Path::new("x"));
    assert!(read(&bytes).is_ok());
    // Any flipped bit and any cut is noticed.
    for at in 0..bytes.len() {
        let mut b = bytes.clone();
        b[at] ^= 1 << (at % 8);
        assert!(read(&b).is_err(), "byte {at}");
    }
    for len in 0..bytes.len() {
        assert!(read(&bytes[..len]).is_err(), "{len} bytes");
    }
    // So are nonsense bodies under a right checksum; none is given much memory.
    for at in (44..bytes.len()).step_by(8) {
        for word in [0, u64::MAX, 1 << 40] {
            let mut b = bytes.clone();
            let end = (at + 8).min(b.len());
            b[at..end].copy_from_slice(&word.to_le_bytes()[..end - at]);
            let hash = *blake3::hash(&b[44..]).as_bytes();
            b[12..44].copy_from_slice(&hash);
            if let Ok(c) = read(&b) {
                c.image();
            }
        }
    }
}
