//! Damaged scene files: whatever happens to the text, loading it gives a scene or an error and never panics.

use std::path::Path;

use caustica::accel::AccelKind;
use caustica::scene::{LoadOptions, Scene};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

/// Cases per test; together 12 000.
const CASES: u32 = 6000;

const SEED_SCENE: &str = r##"<scene version="3.0.0">
<default name="spp" value="16"/><default name="r" value="0.5"/>
<integrator type="photonmapper"><integer name="max_depth" value="8"/><boolean name="final_gather" value="true"/></integrator>
<sensor type="thinlens"><float name="fov" value="40"/><float name="aperture_radius" value="0.1"/>
 <float name="focus_distance" value="4"/><string name="fov_axis" value="smaller"/>
 <transform name="to_world"><lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
 <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="4"/><rfilter type="tent"/></film>
 <sampler type="multijitter"><integer name="sample_count" value="$spp"/></sampler></sensor>
<bsdf type="twosided" id="wall"><bsdf type="diffuse"><rgb name="reflectance" value="#8080c0"/></bsdf></bsdf>
<bsdf type="blendbsdf" id="mix"><float name="weight" value="0.3"/><ref id="wall"/>
 <bsdf type="conductor"><spectrum name="eta" value="400:0.2, 700:1.5"/><rgb name="k" value="3"/></bsdf></bsdf>
<alias id="wall" as="other"/>
<shape type="rectangle"><transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/><translate y="-1"/></transform>
 <ref id="other"/></shape>
<shape type="sphere"><point name="center" x="0" y="$r" z="0"/><float name="radius" value="$r"/>
 <bsdf type="dielectric"><string name="int_ior" value="bk7"/><float name="ext_ior" value="1"/></bsdf></shape>
<shape type="cylinder"><point name="p0" value="1, 0, 0"/><point name="p1" value="1, 1, 0"/><float name="radius" value="0.2"/>
 <ref id="mix"/></shape>
<shape type="shapegroup" id="group"><shape type="cube"><bsdf type="plastic"><texture type="checkerboard" name="diffuse_reflectance">
 <transform name="to_uv"><scale x="4" y="4"/></transform></texture></bsdf></shape></shape>
<shape type="instance"><ref id="group"/><transform name="to_world"><matrix value="1 0 0 2 0 1 0 0 0 0 1 0 0 0 0 1"/></transform></shape>
<shape type="disk"><emitter type="area"><blackbody name="radiance" temperature="3000K" scale="0.01"/></emitter></shape>
<emitter type="spot"><rgb name="intensity" value="3, 2, 1"/><float name="cutoff_angle" value="30"/></emitter>
<emitter type="directional"><vector name="direction" x="0" y="-1" z="0"/></emitter>
<emitter type="constant"><spectrum type="d65" name="radiance"><float name="scale" value="0.1"/></spectrum></emitter>
</scene>"##;

/// Pieces that are likely to break something.
const PIECES: [&str; 40] = [
    "",
    "\"",
    "<",
    ">",
    "/>",
    "&",
    "&amp;",
    "&#0;",
    "$",
    "${",
    "$spp$spp",
    "-",
    "-1",
    "0",
    "1e308",
    "1e-308",
    "1e39",
    "nan",
    "inf",
    "999999999999999999999",
    "0x10",
    ",",
    ":",
    "\0",
    "\u{feff}",
    "é",
    "\n",
    " id=\"wall\"",
    "<ref id=\"mix\"/>",
    "<ref id=\"group\"/>",
    "<bsdf type=\"twosided\">",
    "<shape type=\"cube\"/>",
    "<transform name=\"to_world\">",
    "</shape>",
    "<include filename=\"x\"/>",
    "<!-- ",
    "-->",
    "<![CDATA[",
    "value=\"",
    "type=\"instance\"",
];

/// One damage: where (as a share of the text), how much is cut out, what is put in.
type Damage = (f64, usize, usize);

fn damaged(damages: &[Damage]) -> String {
    let mut text = SEED_SCENE.to_owned();
    for &(share, cut, piece) in damages {
        let floor = |mut i: usize, text: &str| {
            i = i.min(text.len());
            while !text.is_char_boundary(i) {
                i -= 1;
            }
            i
        };
        let start = floor((share * text.len() as f64) as usize, &text);
        let end = floor(start + cut, &text).max(start);
        text.replace_range(start..end, PIECES[piece % PIECES.len()]);
    }
    text
}

/// Swaps whole attribute values, so that the XML stays well-formed and the meaning breaks.
fn swapped(values: &[(usize, usize)]) -> String {
    let mut parts: Vec<String> = SEED_SCENE.split('"').map(str::to_owned).collect();
    let count = parts.len() / 2;
    for &(at, with) in values {
        let from = match with % (count + PIECES.len()) {
            k if k < count => parts[2 * k + 1].clone(),
            k => PIECES[k - count].replace(['"', '<', '&', '\0'], ""),
        };
        parts[2 * (at % count) + 1] = from;
    }
    parts.join("\"")
}

fn load(text: &str) -> bool {
    let options = LoadOptions { accel: AccelKind::Bvh, ..LoadOptions::default() };
    match Scene::from_text(text, Path::new("mutated.xml"), &options) {
        Ok(scene) => {
            assert!(!scene.hash.is_empty());
            true
        }
        Err(e) => {
            assert!(
                e.to_string().starts_with("mutated.xml:") && e.line > 0 && e.col > 0 && !e.message.is_empty(),
                "{e}"
            );
            false
        }
    }
}

fn runner() -> TestRunner {
    let config = Config { cases: CASES, failure_persistence: None, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]))
}

#[test]
fn the_seed_is_a_scene() {
    let options = LoadOptions { accel: AccelKind::Bvh, ..LoadOptions::default() };
    let scene = Scene::from_text(SEED_SCENE, Path::new("mutated.xml"), &options);
    assert!(scene.is_ok(), "{}", scene.err().map(|e| e.to_string()).unwrap_or_default());
}

#[test]
fn damaged_text_never_panics() {
    let damage = (0.0f64..1.0, prop_oneof![Just(0usize), 0usize..4, 0usize..60], 0usize..PIECES.len());
    runner()
        .run(&proptest::collection::vec(damage, 1..5), |d| {
            load(&damaged(&d));
            Ok(())
        })
        .unwrap_or_else(|e| panic!("{e}"));
}

#[test]
fn swapped_values_never_panic() {
    let loaded = std::cell::Cell::new(0u32);
    runner()
        .run(&proptest::collection::vec((0usize..1000, 0usize..1000), 1..5), |v| {
            loaded.set(loaded.get() + u32::from(load(&swapped(&v))));
            Ok(())
        })
        .unwrap_or_else(|e| panic!("{e}"));
    // Most are refused, but some must get as far as a scene.
    assert!(loaded.get() > CASES / 100, "{}", loaded.get());
}
