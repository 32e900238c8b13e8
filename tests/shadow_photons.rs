//! Shadow photons spare shadow rays and hardly change the picture.

mod common;

use caustica::accel::AccelKind;
use caustica::render::{PlanOverrides, Rendering};

/// Balls under a lamp (or a small sun) over a floor, with a wall behind.
fn scene(shadow_photons: u64, light: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="photonmapper">
    <integer name="global_photons" value="5000"/><integer name="caustic_photons" value="0"/>
    <boolean name="final_gather" value="false"/>
    <integer name="shadow_photons" value="{shadow_photons}"/>
  </integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 2, 5" target="0, 0.7, 0" up="0, 1, 0"/></transform>
    <float name="fov" value="45"/>
    <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="48"/><rfilter type="box"/></film>
    <sampler type="independent"><integer name="sample_count" value="8"/></sampler>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-3"/></transform></shape>
  <shape type="sphere"><point name="center" x="-0.7" y="0.6" z="0"/><float name="radius" value="0.6"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.4"/><rotate y="1" angle="30"/>
    <translate x="0.8" y="0.4" z="-0.4"/></transform></shape>
  {light}
</scene>"#
    )
}

const LAMP: &str = r#"<shape type="rectangle">
    <transform name="to_world"><scale value="0.3"/><rotate x="1" angle="90"/><translate x="0.5" y="3.5"/></transform>
    <emitter type="area"><rgb name="radiance" value="30"/></emitter></shape>"#;
const SUN: &str = r#"<emitter type="directional"><vector name="direction" value="0.5, -1, -0.6"/>
    <rgb name="irradiance" value="3"/></emitter>
  <emitter type="point"><point name="position" x="-2" y="2.5" z="1"/><rgb name="intensity" value="4"/></emitter>"#;

fn render(shadow_photons: u64, light: &str) -> Rendering {
    let scene = common::scene(&scene(shadow_photons, light), AccelKind::Bvh);
    common::run(&scene, PlanOverrides { seed: Some(5), ..PlanOverrides::default() })
}

/// Visibility takes no random numbers, so pixels differ only where a verdict was wrong.
#[test]
fn most_shadow_rays_are_spared_and_hardly_a_pixel_changes() {
    for light in [LAMP, SUN] {
        let (with, without) = (render(200_000, light), render(0, light));
        let (traced, all) = (with.summary.counters.shadow_rays, without.summary.counters.shadow_rays);
        assert!(traced * 2 < all, "{traced} of {all} shadow rays traced");
        let differs = |(a, b): &(_, &_)| *a != *b;
        let wrong = with.image.pixels().iter().zip(without.image.pixels()).filter(differs).count();
        assert!(wrong * 50 < with.image.pixels().len(), "{wrong} pixels differ");
        let (a, b) = (common::mean(&with.image), common::mean(&without.image));
        assert!((a / b - 1.0).abs() < 2e-3, "mean {a}, not {b}");
    }
}

/// No photons, or too few to judge a cell by, change nothing.
#[test]
fn too_few_shadow_photons_decide_nothing() {
    let (with, without) = (render(100, LAMP), render(0, LAMP));
    let differ = with.image.pixels().iter().zip(without.image.pixels()).filter(|(a, b)| a != b).count();
    assert!(differ * 50 < with.image.pixels().len(), "{differ} pixels differ");
}
