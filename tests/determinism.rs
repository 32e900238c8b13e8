//! The same bits for any number of threads.

mod common;

use caustica::render::PlanOverrides;
use common::{backends, run, scene};

/// A box with a glass and a mirror sphere: diffuse, specular and caustic paths, an area light and an environment.
const BOX: &str = r#"<scene version="3.0.0">
  <sensor type="perspective">
    <float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0, 0, 3" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="24"/>
      <rfilter type="gaussian"/></film>
  </sensor>
  <emitter type="constant"><rgb name="radiance" value="0.1, 0.2, 0.3"/></emitter>
  <shape type="rectangle">
    <transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/><translate y="-1"/></transform>
    <bsdf type="plastic"/>
  </shape>
  <shape type="sphere"><point name="center" x="-0.5" y="-0.5" z="0"/><float name="radius" value="0.4"/>
    <bsdf type="dielectric"/></shape>
  <shape type="sphere"><point name="center" x="0.5" y="-0.5" z="0"/><float name="radius" value="0.4"/>
    <bsdf type="conductor"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.3"/><rotate x="1" angle="90"/><translate y="1"/></transform>
    <emitter type="area"><rgb name="radiance" value="10"/></emitter>
  </shape>
</scene>"#;

/// The bits of `text` rendered by `integrator` on pools of 1, 2, 3 and 8 threads are the same.
fn same_bits(text: &str, accel: caustica::accel::AccelKind, integrator: &str) {
    let pictures: Vec<_> = [1, 2, 3, 8]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let overrides = PlanOverrides {
                    integrator: Some(integrator.into()),
                    spp: Some(4),
                    passes: Some(2),
                    photons: Some(20_000),
                    ..PlanOverrides::default()
                };
                let image = run(&scene(text, accel), overrides).image;
                let bits = image.pixels().iter().flat_map(|p| p.to_array().map(f32::to_bits));
                bits.collect::<Vec<u32>>()
            })
        })
        .collect();
    for other in &pictures[1..] {
        assert!(pictures[0] == *other, "{integrator} on {accel:?}");
    }
}

#[test]
fn same_bits_for_any_number_of_threads() {
    for accel in backends() {
        for integrator in caustica::render::METHODS {
            same_bits(BOX, accel, integrator);
        }
    }
}

#[test]
fn same_bits_from_chains_of_photon_paths() {
    let chains = "<integrator type=\"sppm\"><string name=\"photon_sampling\" value=\"visibility\"/></integrator>";
    let text = BOX.replace("<sensor", &format!("{chains}<sensor"));
    for accel in backends() {
        same_bits(&text, accel, "sppm");
    }
}

#[test]
fn same_bits_from_the_irradiance_cache() {
    let cached = "<integrator type=\"photonmapper\"><boolean name=\"irradiance_cache\" value=\"true\"/></integrator>";
    let text = BOX.replace("type=\"plastic\"", "type=\"diffuse\"").replace("<sensor", &format!("{cached}<sensor"));
    for accel in backends() {
        same_bits(&text, accel, "photonmapper");
    }
}

#[test]
fn same_bits_from_radii_that_follow_the_photons() {
    for parameter in ["shared_statistics", "chi_squared_radius"] {
        let shared = format!(r#"<integrator type="sppm"><boolean name="{parameter}" value="true"/></integrator>"#);
        let text = BOX.replace("<sensor", &format!("{shared}<sensor"));
        for accel in backends() {
            same_bits(&text, accel, "sppm");
        }
    }
}
