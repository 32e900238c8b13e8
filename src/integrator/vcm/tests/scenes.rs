//! The scenes whose paths are weighed.

use std::path::Path;

use crate::scene::{LoadOptions, Scene};

fn shape(kind: &str, place: &str, bsdf: &str) -> String {
    format!(r#"<shape type="{kind}"><transform name="to_world">{place}</transform>{bsdf}</shape>"#)
}

/// Surfaces of every kind in front of the camera, and lights.
pub fn load(sensor: &str, lights: &str) -> Scene {
    let things = [
        shape(
            "rectangle",
            r#"<scale value="0.5"/><translate x="-0.4" z="0.6"/>"#,
            r#"<bsdf type="mask"><float name="opacity" value="0.5"/><bsdf type="twosided">
               <bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf><bsdf type="plastic"/></bsdf></bsdf>"#,
        ),
        shape(
            "sphere",
            r#"<scale value="0.4"/><translate x="-0.4" y="-0.5"/>"#,
            r#"<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>"#,
        ),
        shape(
            "sphere",
            r#"<scale value="0.3"/><translate x="0.4" y="-0.4"/>"#,
            r#"<bsdf type="roughdielectric"><float name="alpha" value="0.3"/></bsdf>"#,
        ),
        shape(
            "sphere",
            r#"<scale value="0.3"/><translate x="0.3" y="0.4"/>"#,
            r#"<bsdf type="blendbsdf"><float name="weight" value="0.5"/>
          <bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>
          <bsdf type="diffuse"/></bsdf>"#,
        ),
    ];
    scene(sensor, &(walls("plastic") + &things.concat()), lights)
}

/// Surfaces that gather no light from afar into a point, so that no few samples make up the picture, and lights.
pub fn load_calm(sensor: &str, lights: &str) -> Scene {
    let ball = shape("sphere", r#"<scale value="0.4"/><translate x="-0.3" y="-0.4"/>"#, r#"<bsdf type="diffuse"/>"#);
    scene(sensor, &(walls("diffuse") + &ball), lights)
}

/// Walls behind, below (of the given kind), left and right.
fn walls(floor: &str) -> String {
    let diffuse = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.9"/></bsdf></bsdf>"#;
    let floor = format!(r#"<bsdf type="{floor}"/>"#);
    let rough = r#"<bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf>"#;
    [
        shape("rectangle", r#"<translate z="-1"/>"#, diffuse),
        shape("rectangle", r#"<rotate x="1" angle="-90"/><translate y="-1"/>"#, &floor),
        shape("rectangle", r#"<rotate y="1" angle="90"/><translate x="-1"/>"#, diffuse),
        shape("rectangle", r#"<rotate y="1" angle="-90"/><translate x="1"/>"#, rough),
    ]
    .concat()
}

fn scene(sensor: &str, shapes: &str, lights: &str) -> Scene {
    let text = format!(
        r#"<scene version="3.0.0"><sensor type="{sensor}"><transform name="to_world">
        <lookat origin="0, 0.2, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
        {shapes}{lights}</scene>"#
    );
    Scene::from_text(&text, Path::new("test.xml"), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// Lamps of finite size and a point.
pub const FINITE: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/>
    <translate y="0.99"/></transform><emitter type="area"><rgb name="radiance" value="6"/></emitter></shape>
  <shape type="sphere"><point name="center" x="0.2" y="0.2" z="0.9"/><float name="radius" value="0.15"/>
    <emitter type="area"><rgb name="radiance" value="6"/></emitter></shape>
  <emitter type="point"><point name="position" x="-0.3" y="0.6" z="0.5"/><rgb name="intensity" value="1"/></emitter>"#;

/// Lights at infinity.
pub const DISTANT: &str = r#"<emitter type="constant"><rgb name="radiance" value="0.6"/></emitter>
  <emitter type="directional"><vector name="direction" x="0.4" y="-1" z="-0.5"/><rgb name="irradiance" value="3"/></emitter>"#;
