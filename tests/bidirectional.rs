//! `ptracer`, `bdpt` and `vcm` show the light that `path` shows.

mod common;

use caustica::film::Film;
use caustica::image::Image;
use caustica::integrator::vcm::{Merging, VcmSettings, Workspace, render_pass};
use caustica::scene::Scene;
use common::{Estimate, backends, image, scene};

const SEEDS: u64 = 16;

/// Camera samples of `path` for each one of the other methods.
const REFERENCE: u64 = 4;

const SPP: u64 = if cfg!(feature = "slow-tests") { 8 } else { 2 };

/// A camera that looks along −z at the origin.
const CAMERA: &str = r#"<sensor type="perspective">
    <float name="fov" value="45"/>
    <transform name="to_world"><lookat origin="0, 0.2, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    FILM</sensor>"#;

const THIN_LENS: &str = r#"<sensor type="thinlens">
    <float name="fov" value="45"/><float name="aperture_radius" value="0.2"/><float name="focus_distance" value="4"/>
    <transform name="to_world"><lookat origin="0, 0.2, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    FILM</sensor>"#;

const ORTHOGRAPHIC: &str = r#"<sensor type="orthographic">
    <transform name="to_world"><lookat origin="0, 0.2, 4" target="0, 0, 0" up="0, 1, 0"/><scale value="1.6"/></transform>
    FILM</sensor>"#;

const FILM: &str = r#"<film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/>
      <rfilter type="FILTER"/></film><sampler type="multijitter"/>"#;

/// An open box with a block, of one material.
fn room(camera: &str, filter: &str, bsdf: &str, lights: &str, max_depth: i32) -> String {
    let film = FILM.replace("FILTER", filter);
    let sensor = camera.replace("FILM", &film);
    let wall = |transform: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world">{transform}</transform><bsdf type="twosided">
      <bsdf type="diffuse"><rgb name="reflectance" value="0.7, 0.5, 0.4"/></bsdf></bsdf></shape>"#
        )
    };
    let walls: String = [
        r#"<translate z="-1"/>"#,
        r#"<rotate x="1" angle="-90"/><translate y="-1"/>"#,
        r#"<rotate y="1" angle="90"/><translate x="-1"/>"#,
        r#"<rotate y="1" angle="-90"/><translate x="1"/>"#,
    ]
    .map(wall)
    .concat();
    format!(
        r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{max_depth}"/></integrator>
  {sensor}
  {walls}
  <shape type="sphere"><point name="center" x="-0.3" y="-0.6" z="0.1"/><float name="radius" value="0.4"/>{bsdf}</shape>
  <shape type="cube"><transform name="to_world"><scale value="0.25"/><rotate y="1" angle="20"/>
    <translate x="0.45" y="-0.75" z="0.2"/></transform>{bsdf}</shape>
  {lights}
</scene>"#
    )
}

const LAMP: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/>
    <translate y="0.99"/></transform><emitter type="area"><rgb name="radiance" value="6, 5, 4"/></emitter></shape>"#;

const BALL_LAMP: &str = r#"<shape type="sphere"><point name="center" x="0.2" y="0.5" z="0.1"/><float name="radius" value="0.25"/>
    <emitter type="area"><rgb name="radiance" value="6, 5, 4"/></emitter></shape>"#;

const DISK_LAMP: &str = r#"<shape type="disk"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/>
    <translate y="0.8"/></transform><emitter type="area"><rgb name="radiance" value="6, 5, 4"/></emitter></shape>"#;

const TUBE_LAMP: &str = r#"<shape type="cylinder"><point name="p0" x="-0.5" y="0.7" z="0"/><point name="p1" x="0.5" y="0.7" z="0.2"/>
    <float name="radius" value="0.1"/><emitter type="area"><rgb name="radiance" value="6, 5, 4"/></emitter></shape>"#;

const CHECKERED: &str = r#"<texture name="radiance" type="checkerboard"><rgb name="color0" value="8, 1, 0"/>
    <rgb name="color1" value="0.2, 3, 9"/><transform name="to_uv"><scale value="2"/></transform></texture>"#;

/// A light with a texture on a shape of one of the kinds that are sampled differently.
fn textured_lamp(shape: &str) -> String {
    format!(
        r#"<shape type="{shape}"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="80"/>
    <translate y="0.6"/></transform><emitter type="area">{CHECKERED}</emitter></shape>"#
    )
}

const POINT: &str = r#"<emitter type="point"><point name="position" x="0.3" y="0.6" z="0.5"/>
    <rgb name="intensity" value="1, 0.9, 0.5"/></emitter>"#;

const SPOT: &str = r#"<emitter type="spot"><transform name="to_world"><lookat origin="0.5, 0.9, 1" target="-0.2, -0.7, 0" up="0, 0, 1"/>
    </transform><rgb name="intensity" value="6"/><float name="cutoff_angle" value="30"/></emitter>"#;

const SUN: &str = r#"<emitter type="directional"><vector name="direction" x="0.4" y="-1" z="-0.5"/>
    <rgb name="irradiance" value="3, 2.8, 2.2"/></emitter>"#;

const SKY: &str = r#"<emitter type="constant"><rgb name="radiance" value="0.6, 0.8, 1"/></emitter>"#;

const PROJECTOR: &str = r#"<emitter type="projector"><transform name="to_world">
    <lookat origin="0.5, 0.9, 1.5" target="-0.2, -0.7, 0" up="0, 0, 1"/></transform><float name="fov" value="40"/>
    <texture name="irradiance" type="checkerboard"><rgb name="color0" value="8, 1, 0"/><rgb name="color1" value="0.2, 3, 9"/>
      <transform name="to_uv"><scale value="2"/></transform></texture></emitter>"#;

const DIFFUSE: &str = r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.6, 0.5"/></bsdf>"#;
const GLOSSY: &str =
    r#"<bsdf type="twosided"><bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf></bsdf>"#;
const SHARP: &str =
    r#"<bsdf type="twosided"><bsdf type="roughconductor"><float name="alpha" value="0.04"/></bsdf></bsdf>"#;
const FROSTED: &str = r#"<bsdf type="roughdielectric"><float name="alpha" value="0.3"/></bsdf>"#;
const GLASS: &str = r#"<bsdf type="dielectric"/>"#;
const PLASTIC: &str = r#"<bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.2, 0.5, 0.8"/></bsdf>"#;
const PRINCIPLED: &str = r#"<bsdf type="principled"><rgb name="base_color" value="0.7, 0.4, 0.2"/><float name="roughness" value="0.3"/>
    <float name="metallic" value="0.3"/><float name="spec_trans" value="0.5"/><float name="clearcoat" value="0.5"/></bsdf>"#;
const LEAF: &str = r#"<bsdf type="mask"><float name="opacity" value="0.6"/><bsdf type="twosided">
    <bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></bsdf></bsdf>"#;
const BLEND: &str = r#"<bsdf type="blendbsdf"><float name="weight" value="0.4"/><bsdf type="dielectric"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.5, 0.5"/></bsdf></bsdf>"#;

/// Mean of all channels of each of 4 × 4 blocks.
fn blocks(image: &Image) -> Vec<f64> {
    let (w, h) = (image.width(), image.height());
    let mut sums = [0.0; 16];
    for y in 0..h {
        for x in 0..w {
            sums[(y * 4 / h * 4 + x * 4 / w) as usize] += image.pixel(x, y).mean() as f64;
        }
    }
    sums.iter().map(|s| s * 16.0 / (w * h) as f64).collect()
}

/// A picture by a variant that has no name of its own.
fn variant(scene: &Scene, settings: &VcmSettings, spp: u64, seed: u64) -> Image {
    let settings = VcmSettings { max_depth: max_depth(scene), ..*settings };
    let mut film = Film::new(scene.camera.window(), scene.film.filter);
    render_pass(scene, &settings, seed, 0..spp, &mut film, &mut Workspace::default(), &|_| ());
    film.develop(1.0 / spp as f64)
}

fn max_depth(scene: &Scene) -> Option<u32> {
    scene.integrator.integer("max_depth").and_then(|d| u32::try_from(d).ok())
}

/// Compares pictures of 16 seeds block by block. The mean of the whole may be off by `bias` plus 5.5 standard errors, a
/// block by three times `bias` plus 9: Student's t with 15 degrees of freedom at 99 %, Šidák-corrected for the two hundred
/// pictures and their 16 blocks that this file compares.
#[track_caller]
fn compare(what: &str, reference: &[Vec<f64>], other: &[Vec<f64>], bias: f64) {
    let total = |images: &[Vec<f64>]| Estimate::of(images.iter().map(|b| b.iter().sum::<f64>() / b.len() as f64));
    let off = |a: Estimate, b: Estimate, bias: f64| {
        let error = (a.error.powi(2) + b.error.powi(2)).sqrt();
        ((a.mean - b.mean).abs() - bias * a.mean).max(0.0) / error.max(1e-9 * a.mean.max(1e-9))
    };
    let (a, b) = (total(reference), total(other));
    println!("{what}: {:.5} ± {:.5}, {:.5} ± {:.5}", a.mean, a.error, b.mean, b.error);
    assert!(off(a, b, bias) < 5.5, "{what}: path {a:?}, measured {b:?}, {:+.3} %", 100.0 * (b.mean / a.mean - 1.0));
    for block in 0..reference[0].len() {
        let of = |images: &[Vec<f64>]| Estimate::of(images.iter().map(|i| i[block]));
        let (a, b) = (of(reference), of(other));
        assert!(off(a, b, 3.0 * bias) < 9.0, "{what}, block {block}: path {a:?}, measured {b:?}");
    }
}

/// All methods against `path`; light tracing only where the camera sees all light off wide surfaces.
fn agree(name: &str, xml: &str, light_tracing: bool) {
    let accels = if cfg!(feature = "slow-tests") { backends() } else { backends()[..1].to_vec() };
    for accel in accels {
        let s = scene(xml, accel);
        let over_seeds = |render: &dyn Fn(u64) -> Image| -> Vec<Vec<f64>> {
            (1..=SEEDS).map(|seed| blocks(&render(seed))).collect()
        };
        let path = over_seeds(&|seed| image(&s, "path", REFERENCE * SPP, seed));
        let check = |what: &str, bias: f64, render: &dyn Fn(u64) -> Image| {
            compare(&format!("{name}, {what}, {accel:?}"), &path, &over_seeds(render), bias);
        };
        check("bdpt", 0.0, &|seed| image(&s, "bdpt", SPP, seed));
        let no_image = VcmSettings { light_image: false, ..VcmSettings::bdpt() };
        check("bdpt without light image", 0.0, &|seed| variant(&s, &no_image, SPP, seed));
        if light_tracing {
            check("ptracer", 0.0, &|seed| image(&s, "ptracer", SPP, seed));
        }
        // Merging blurs; on a film this small the light paths are few and the radius is large.
        check("vcm", 0.003, &|seed| image(&s, "vcm", SPP, seed));
        let radius = Some(0.03);
        let all = VcmSettings { merging: Merging::All, initial_radius: radius, ..VcmSettings::default() };
        check("vcm, all merges", 0.005, &|seed| variant(&s, &all, SPP, seed));
        let bpm = VcmSettings { initial_radius: radius, ..VcmSettings::bpm() };
        check("bpm", 0.01, &|seed| variant(&s, &bpm, SPP, seed));
    }
}

#[test]
fn cameras_and_filters() {
    for (camera, name) in [(CAMERA, "perspective"), (THIN_LENS, "thin lens"), (ORTHOGRAPHIC, "orthographic")] {
        for filter in ["box", "gaussian"] {
            agree(&format!("{name}, {filter}"), &room(camera, filter, DIFFUSE, LAMP, -1), true);
        }
    }
}

#[test]
fn shapes_of_lights() {
    let lights = [
        ("sphere", BALL_LAMP.to_string()),
        ("disk", DISK_LAMP.to_string()),
        ("cylinder", TUBE_LAMP.to_string()),
        ("textured rectangle", textured_lamp("rectangle")),
        ("textured sphere", textured_lamp("sphere")),
        ("textured mesh", textured_lamp("cube")),
    ];
    for (name, light) in lights {
        agree(name, &room(CAMERA, "box", DIFFUSE, &light, -1), true);
    }
}

#[test]
fn lights_without_area() {
    for (name, light) in [("point", POINT), ("spot", SPOT), ("sun", SUN), ("sky", SKY), ("projector", PROJECTOR)] {
        agree(name, &room(CAMERA, "box", DIFFUSE, light, -1), true);
    }
    agree("many", &room(CAMERA, "box", GLOSSY, &[LAMP, POINT, SUN, SKY].concat(), -1), true);
}

#[test]
fn materials() {
    let lights = [LAMP, SKY].concat();
    for (name, bsdf, light_tracing) in [
        ("glossy", GLOSSY, true),
        ("frosted", FROSTED, true),
        ("sharp", SHARP, false),
        ("glass", GLASS, false),
        ("plastic", PLASTIC, false),
        ("principled", PRINCIPLED, true),
        ("leaf", LEAF, false),
        ("blend", BLEND, false),
    ] {
        agree(name, &room(CAMERA, "box", bsdf, &lights, -1), light_tracing);
    }
}

#[test]
fn depths_are_counted_alike() {
    for depth in 1..=4 {
        agree(&format!("depth {depth}"), &room(CAMERA, "box", GLOSSY, LAMP, depth), true);
    }
}
