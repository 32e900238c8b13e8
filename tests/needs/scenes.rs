//! Scenes that each lack something, and scenes that only seem to.

use std::path::Path;

use caustica::color::Rgb;
use caustica::image::{Image, WriteOptions, write};
use caustica::scene::{Item, NeedOverride};

/// A scene with the item that decides about it.
#[allow(dead_code)]
pub struct Case {
    pub name: &'static str,
    body: String,
    pub item: Item,
    /// Whether the item is needed.
    pub needed: bool,
    max_depth: i32,
}

impl Case {
    /// The scene file at a film of `size`² pixels.
    pub fn xml(&self, size: u32) -> String {
        format!(
            r#"<scene version="3.0.0">
            <integrator type="photonmapper"><integer name="max_depth" value="{}"/></integrator>
            <sensor type="perspective"><float name="fov" value="60"/>
              <transform name="to_world"><lookat origin="0 -4 2.5" target="0 0 0.6" up="0 0 1"/></transform>
              <film type="hdrfilm"><integer name="width" value="{size}"/><integer name="height" value="{size}"/>
                <rfilter type="box"/></film></sensor>
            {}</scene>"#,
            self.max_depth, self.body
        )
    }
}

/// Everything forced on, but for what trades exactness for time and is made only where a scene file asks for it.
pub fn everything() -> Vec<NeedOverride> {
    Item::ALL.into_iter().filter(|i| i.is_built() && !i.is_opt_in()).map(|i| (i, true)).collect()
}

/// Images that the scenes refer to: all black, and black with one bright texel.
pub fn write_images(dir: &Path) {
    let mut pixels = vec![Rgb::BLACK; 32 * 16];
    let black = Image::rgb(32, 16, pixels.clone());
    // Near the middle: above the floor in the environment, visible on surfaces.
    pixels[4 * 32 + 20] = Rgb::WHITE;
    let speck = Image::rgb(32, 16, pixels);
    for (name, image) in [("black.exr", black), ("speck.exr", speck)] {
        write(dir.join(name), &image, &WriteOptions::default()).expect("a temporary file");
    }
    // A large one that nobody uses.
    let large = Image::constant(1024, 1024, Rgb::splat(0.25));
    write(dir.join("large.exr"), &large, &WriteOptions::default()).expect("a temporary file");
}

fn placed(shape: &str, transform: &str, content: &str) -> String {
    format!(r#"<shape type="{shape}"><transform name="to_world">{transform}</transform>{content}</shape>"#)
}

fn diffuse(v: f32) -> String {
    format!(r#"<bsdf type="diffuse"><rgb name="reflectance" value="{v}"/></bsdf>"#)
}

fn floor() -> String {
    placed("rectangle", r#"<scale value="2"/>"#, &diffuse(0.6))
}

/// A wall behind, facing the camera.
fn wall() -> String {
    let turn = r#"<scale value="2"/><rotate x="1" angle="90"/><translate y="2" z="2"/>"#;
    placed("rectangle", turn, &diffuse(0.5))
}

/// A lamp above that shines down.
fn lamp(bsdf: &str) -> String {
    let turn = r#"<scale value="0.3"/><rotate x="1" angle="180"/><translate z="3"/>"#;
    let emitter = r#"<emitter type="area"><rgb name="radiance" value="8"/></emitter>"#;
    placed("rectangle", turn, &format!("{bsdf}{emitter}"))
}

fn ball(bsdf: &str) -> String {
    format!(
        r#"<shape type="sphere"><float name="radius" value="0.5"/><point name="center" x="0" y="0" z="1"/>{bsdf}</shape>"#
    )
}

const MIRROR: &str = r#"<bsdf type="conductor"/>"#;
const GLASS: &str = r#"<bsdf type="dielectric"/>"#;

fn point(intensity: f32) -> String {
    format!(
        r#"<emitter type="point"><point name="position" x="0.5" y="-1" z="3"/>
        <rgb name="intensity" value="{intensity}"/></emitter>"#
    )
}

fn spot(origin: &str, target: &str) -> String {
    format!(
        r#"<emitter type="spot"><rgb name="intensity" value="20"/><float name="cutoff_angle" value="15"/>
        <transform name="to_world"><lookat origin="{origin}" target="{target}" up="0.1 0 1"/></transform></emitter>"#
    )
}

fn bitmap(name: &str, file: &str) -> String {
    format!(
        r#"<texture type="bitmap" name="{name}"><string name="filename" value="{file}"/>
        <boolean name="raw" value="true"/></texture>"#
    )
}

fn case(name: &'static str, item: Item, needed: bool, parts: &[String]) -> Case {
    Case { name, body: parts.concat(), item, needed, max_depth: -1 }
}

/// Twelve scenes of which each lacks something.
pub fn lacking() -> Vec<Case> {
    let black = diffuse(0.0);
    let upright = r#"<scale value="1.5"/><rotate x="1" angle="90"/><translate y="1" z="1"/>"#;
    let inverted = placed("rectangle", upright, MIRROR);
    let group =
        r#"<shape type="shapegroup" id="nowhere"><shape type="sphere"><bsdf type="dielectric"/></shape></shape>"#;
    let declared = format!(r#"<bsdf type="diffuse" id="unused">{}</bsdf>"#, bitmap("reflectance", "large.exr"));
    let room = placed(
        "cube",
        r#"<scale value="3"/><translate z="2"/>"#,
        r#"<bsdf type="twosided"><bsdf type="diffuse"/></bsdf>"#,
    );
    let dark_sky = r#"<emitter type="envmap"><string name="filename" value="large.exr"/><float name="scale" value="0"/></emitter>"#;
    let no_tint = r#"<bsdf type="conductor"><rgb name="specular_reflectance" value="0"/></bsdf>"#;
    let no_share =
        format!(r#"<bsdf type="blendbsdf">{}{}{MIRROR}</bsdf>"#, bitmap("weight", "black.exr"), diffuse(0.4));
    vec![
        case("no light", Item::Light, false, &[floor(), wall(), ball(MIRROR)]),
        case(
            "black surfaces",
            Item::Direct,
            false,
            &[placed("rectangle", r#"<scale value="2"/>"#, &black), lamp(&black)],
        ),
        case("a floor alone", Item::Indirect, false, &[floor(), point(10.0)]),
        case(
            "a box alone",
            Item::Indirect,
            false,
            &[
                placed("cube", r#"<scale value="0.5"/><translate z="0.5"/>"#, &diffuse(0.7)),
                r#"<emitter type="constant"/>"#.to_owned(),
            ],
        ),
        case(
            "a spot beside the mirror",
            Item::Caustics,
            false,
            &[floor(), wall(), ball(MIRROR), spot("1.5 -1 3", "1.5 0 0")],
        ),
        case("a mirror without tint", Item::Caustics, false, &[floor(), wall(), ball(no_tint), lamp(&black)]),
        case("mirrors alone", Item::Global, false, &[ball(MIRROR), inverted, lamp(&black)]),
        Case {
            max_depth: 2,
            ..case("direct light only", Item::Global, false, &[floor(), wall(), ball(MIRROR), lamp(&black)])
        },
        case("a texture not used", Item::Uv, false, &[declared, floor(), wall(), lamp(&black)]),
        case("a room of flat walls", Item::Normals, false, &[room, lamp(&black)]),
        case(
            "a group not placed",
            Item::Caustics,
            false,
            &[group.to_owned(), dark_sky.to_owned(), floor(), wall(), point(10.0)],
        ),
        case("a share of zero", Item::Caustics, false, &[floor(), wall(), ball(&no_share), point(10.0)]),
    ]
}

/// Scenes that seem to lack what they need.
pub fn deceiving() -> Vec<Case> {
    let black = diffuse(0.0);
    let glossy = |alpha: f32| format!(r#"<bsdf type="roughconductor"><float name="alpha" value="{alpha}"/></bsdf>"#);
    let sheet = r#"<scale value="1"/><translate z="2"/>"#;
    let frosted = r#"<bsdf type="roughdielectric"><float name="alpha" value="0.03"/></bsdf>"#;
    let blend = format!(r#"<bsdf type="blendbsdf">{}{}{MIRROR}</bsdf>"#, bitmap("weight", "speck.exr"), diffuse(0.4));
    let mask = format!(r#"<bsdf type="mask">{}{MIRROR}</bsdf>"#, bitmap("opacity", "speck.exr"));
    let rough = format!(r#"<bsdf type="roughconductor">{}</bsdf>"#, bitmap("alpha", "speck.exr"));
    let far = r#"<shape type="shapegroup" id="far"><shape type="sphere"><bsdf type="dielectric"/></shape></shape>
        <shape type="instance"><ref id="far"/><transform name="to_world"><scale value="0.5"/><translate x="1.2" y="0.5" z="0.8"/>
        </transform></shape>"#;
    let sky = r#"<emitter type="envmap"><string name="filename" value="speck.exr"/><float name="scale" value="300"/>
        <transform name="to_world"><rotate x="1" angle="90"/></transform></emitter>"#;
    let behind = r#"<shape type="sphere"><float name="radius" value="0.4"/><point name="center" x="0" y="-4.8" z="1"/>
        <bsdf type="dielectric"/></shape>"#;
    let mirror_wall =
        placed("rectangle", r#"<scale value="2"/><rotate x="1" angle="90"/><translate y="2" z="2"/>"#, MIRROR);
    let long_floor = placed("rectangle", r#"<scale x="3" y="8"/>"#, &diffuse(0.6));
    let case_of = |bsdf: &str| placed("cube", r#"<scale value="0.7"/><translate z="0.8"/>"#, bsdf);
    let inner =
        r#"<shape type="sphere"><float name="radius" value="0.3"/><point name="center" x="0" y="0" z="0.8"/></shape>"#;
    let bulb = r#"<shape type="sphere"><float name="radius" value="0.1"/><point name="center" x="0" y="0" z="1"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="20"/></emitter></shape>"#;
    let checked = r#"<bsdf type="conductor"><texture type="checkerboard" name="specular_reflectance">
        <rgb name="color0" value="0"/><rgb name="color1" value="0.9"/></texture></bsdf>"#;
    vec![
        case(
            "a caster seen in a mirror",
            Item::Caustics,
            true,
            &[long_floor, mirror_wall, behind.to_owned(), lamp(&black)],
        ),
        case("a receiver in a glass box", Item::Caustics, true, &[case_of(GLASS), inner.to_owned(), point(10.0)]),
        case("frosted glass", Item::Caustics, true, &[floor(), placed("rectangle", sheet, frosted), point(20.0)]),
        case("glossy below the threshold", Item::Caustics, true, &[floor(), ball(&glossy(0.0599)), point(10.0)]),
        case("glossy above the threshold", Item::Global, true, &[floor(), ball(&glossy(0.0601)), point(10.0)]),
        case(
            "a mirror in indirect light",
            Item::Global,
            true,
            &[floor(), wall(), ball(MIRROR), spot("1.5 -1 3", "1.5 0 0")],
        ),
        case("glass in an instance", Item::Caustics, true, &[floor(), far.to_owned(), point(10.0)]),
        case("one texel of mirror", Item::Caustics, true, &[floor(), ball(&blend), point(10.0)]),
        case("one texel that is there", Item::Caustics, true, &[floor(), ball(&mask), point(10.0)]),
        case("all texels but one smooth", Item::Caustics, true, &[floor(), ball(&rough), point(10.0)]),
        case("one bright pixel of sky", Item::Caustics, true, &[floor(), ball(GLASS), sky.to_owned()]),
        case("a lamp in a glass ball", Item::Caustics, true, &[floor(), ball(GLASS), bulb.to_owned()]),
        case("a chequered mirror", Item::Caustics, true, &[floor(), ball(checked), lamp(&black)]),
    ]
}
