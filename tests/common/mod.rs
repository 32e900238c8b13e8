//! Renders scenes given as text and judges the pictures.
#![allow(dead_code)]

pub mod program;

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use caustica::accel::AccelKind;
use caustica::image::Image;
use caustica::render::{Control, Plan, PlanOverrides, Rendering, Silent, render};
use caustica::scene::{LoadOptions, Scene};

/// The back ends of this build.
pub fn backends() -> Vec<AccelKind> {
    if caustica::accel::embree_available() { vec![AccelKind::Embree, AccelKind::Bvh] } else { vec![AccelKind::Bvh] }
}

/// Loads a scene from text.
pub fn scene(xml: &str, accel: AccelKind) -> Scene {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("scene.xml");
    std::fs::write(&path, xml).expect("a temporary file");
    match Scene::load(&path, &LoadOptions { accel, ..LoadOptions::default() }) {
        Ok(scene) => scene,
        Err(e) => panic!("{e}\n{xml}"),
    }
}

/// A closed unit sphere of albedo `rho`, seen from inside; `emission` goes into the sphere.
pub fn closed_sphere(integrator: &str, sampler: &str, rho: f64, emission: &str, lights: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  {integrator}
  <sensor type="perspective">
    <float name="fov" value="90"/>
    <transform name="to_world"><lookat origin="0.1, 0.2, -0.3" target="0.5, 0.1, 1" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
      <rfilter type="box"/></film>
    <sampler type="{sampler}"/>
  </sensor>
  <shape type="sphere">
    <boolean name="flip_normals" value="true"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf>
    {emission}
  </shape>
  {lights}
</scene>"#
    )
}

/// A floor lit by a point light one above it, through a pane that changes nothing (equal indices inside and out), so that
/// all light comes from caustic photons: L(x) = (ρ/π) I cos θ / d² = (ρ I/π) (1 + x²)^(−3/2).
pub fn floor_under_a_pane(schedule: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="sppm">{schedule}</integrator>
  <sensor type="orthographic">
    <transform name="to_world"><scale value="1"/>
      <lookat origin="0, 0.5, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="12"/>
      <rfilter type="box"/></film>
    <sampler type="independent"/>
  </sensor>
  <shape type="rectangle">
    <transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/><translate y="0.8"/></transform>
    <bsdf type="dielectric"><float name="int_ior" value="1"/><float name="ext_ior" value="1"/></bsdf>
  </shape>
  <emitter type="point"><point name="position" x="0" y="1" z="0"/><rgb name="intensity" value="3.1415927"/></emitter>
</scene>"#
    )
}

/// Mean over the pixel of (1 + x² + z²)^(−3/2), by Gauss-Legendre with two points a side: the pixels are small.
pub fn floor_truth(x: u32, y: u32) -> f64 {
    let half = 1.0;
    let pixel = 2.0 * half / 12.0;
    let at = |i: u32, s: f64| (i as f64 + 0.5 + s * 0.5 / 3f64.sqrt()) * pixel - half;
    let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
    corners.iter().map(|(a, b)| (1.0 + at(x, *a).powi(2) + at(y, *b).powi(2)).powf(-1.5)).sum::<f64>() / 4.0
}

/// Renders with the scene's own settings but for `overrides`.
pub fn run(scene: &Scene, overrides: PlanOverrides) -> Rendering {
    let plan = Plan::new(scene, &overrides).expect("a known integrator");
    let stop = AtomicBool::new(false);
    let control = Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent };
    render(scene, &plan, &control)
}

/// Renders with one integrator, number of samples and seed.
pub fn image(scene: &Scene, integrator: &str, spp: u64, seed: u64) -> Image {
    let o = PlanOverrides {
        integrator: Some(integrator.into()),
        spp: Some(spp),
        seed: Some(seed),
        ..PlanOverrides::default()
    };
    run(scene, o).image
}

/// Renders by photon mapping with a number of photons.
pub fn photon_image(scene: &Scene, spp: u64, photons: u64, seed: u64) -> Image {
    let o = PlanOverrides {
        integrator: Some("photonmapper".into()),
        spp: Some(spp),
        photons: Some(photons),
        seed: Some(seed),
        ..PlanOverrides::default()
    };
    run(scene, o).image
}

/// Mean of all channels of all pixels.
pub fn mean(image: &Image) -> f64 {
    caustica::image::metrics::mean(image).expect("a picture")
}

/// Mean and standard error of the mean of independent numbers.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub mean: f64,
    pub error: f64,
}

impl Estimate {
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let v: Vec<f64> = values.into_iter().collect();
        let n = v.len() as f64;
        let mean = v.iter().sum::<f64>() / n;
        let variance = v.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0);
        Self { mean, error: (variance / n).sqrt() }
    }

    /// The mean of the image under `seeds` independent seeds, as an estimate of the expected mean.
    pub fn over_seeds(scene: &Scene, integrator: &str, spp: u64, seeds: u64) -> Self {
        Self::of((1..=seeds).map(|seed| mean(&image(scene, integrator, spp, seed))))
    }

    /// Fails unless `truth` is within `z` standard errors and `relative` of the mean.
    #[track_caller]
    pub fn assert_is(&self, truth: f64, z: f64, relative: f64, what: &str) {
        let off = (self.mean - truth).abs();
        assert!(
            off <= relative * truth.abs() && off <= z * self.error + 1e-6 * truth.abs(),
            "{what}: expected {truth}, measured {} ± {} ({:+.3} %)",
            self.mean,
            self.error,
            100.0 * (self.mean / truth - 1.0)
        );
    }
}
