//! What a render says about its own error, against the error that it has.

mod common;

use caustica::accel::AccelKind;
use caustica::image::{self, Image};
use caustica::render::PlanOverrides;

/// A lamp over a floor with a sphere, direct and indirect light, `SIZE` × `SIZE` pixels.
fn small_scene() -> String {
    r#"<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 1.2, 4" target="0, 0.4, 0" up="0, 1, 0"/></transform>
    <float name="fov" value="45"/>
    <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="48"/>
      <rfilter type="box"/></film>
    <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/></transform></shape>
  <shape type="sphere"><point name="center" x="0" y="0.5" z="0"/><float name="radius" value="0.5"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/><translate y="2"/></transform>
    <emitter type="area"><rgb name="radiance" value="8"/></emitter>
  </shape>
</scene>"#
        .to_owned()
}

fn overrides(integrator: &str, seed: u64) -> PlanOverrides {
    PlanOverrides { integrator: Some(integrator.into()), seed: Some(seed), ..PlanOverrides::default() }
}

fn relmse(image: &Image, reference: &Image) -> f64 {
    image::metrics::relmse(image, reference).expect("images of one size").value
}

/// The stop rule looks at an estimate whose own noise is that of 4 passes at least over 2304 pixels; a factor of 1.5
/// would be off by more than any seed was.
#[test]
fn a_wanted_error_is_reached_and_not_by_far() {
    let scene = common::scene(&small_scene(), AccelKind::Bvh);
    let reference = common::image(&scene, "path", 1024, 99);
    for (seed, target) in [(1, 1e-2), (2, 3e-3)] {
        let o = PlanOverrides { target_error: Some(target), passes: None, ..overrides("path", seed) };
        let rendering = common::run(&scene, o);
        let estimate = rendering.summary.estimated_relmse.expect("an estimate");
        assert!(estimate <= target && estimate > 0.5 * target, "estimated {estimate}, wanted {target}");
        let truth = relmse(&rendering.image, &reference);
        assert!((truth / target).ln().abs() < 1.5f64.ln(), "true {truth}, wanted {target}");
        assert!(rendering.image.layer("variance").is_some() && rendering.image.layer("blockvariance").is_some());
    }
}

#[test]
fn a_path_tracer_has_no_bias_and_a_photon_mapper_some() {
    let scene = common::scene(&small_scene(), AccelKind::Bvh);
    let bias = |integrator: &str| {
        let o = PlanOverrides { track_bias: true, spp: Some(4), photons: Some(5000), ..overrides(integrator, 3) };
        common::run(&scene, o).image.layer("bias").expect("a layer")
    };
    assert!(bias("path").iter().all(|b| b.is_black()));
    assert!(bias("photonmapper").iter().any(|b| !b.is_black()));
}
