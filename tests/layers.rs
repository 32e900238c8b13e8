//! Layers of photon maps: what they show, and that they add up.

mod common;

use caustica::accel::AccelKind;
use caustica::color::Rgb;
use caustica::image::Image;
use caustica::integrator::Layer;
use caustica::render::{Plan, PlanError, PlanOverrides};

/// A glass ball and a matt one in a room under a lamp.
fn room(integrator: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="photonmapper">{integrator}
    <integer name="global_photons" value="20000"/><integer name="caustic_photons" value="10000"/>
  </integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 1, 3.4" target="0, 0.8, 0" up="0, 1, 0"/></transform>
    <float name="fov" value="45"/>
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="24"/></film>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/></transform></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate z="-2"/></transform>
    <bsdf type="roughplastic"><float name="alpha" value="0.2"/></bsdf></shape>
  <shape type="sphere"><point name="center" x="-0.6" y="0.5" z="0"/><float name="radius" value="0.5"/>
    <bsdf type="dielectric"/></shape>
  <shape type="sphere"><point name="center" x="0.6" y="0.5" z="0"/><float name="radius" value="0.5"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/><translate y="2.4"/></transform>
    <emitter type="area"><rgb name="radiance" value="8, 6, 4"/></emitter>
  </shape>
</scene>"#
    )
}

fn render(xml: &str, layers: &[Layer]) -> Image {
    let scene = common::scene(xml, AccelKind::Bvh);
    common::run(&scene, PlanOverrides { layers: layers.to_vec(), seed: Some(7), ..PlanOverrides::default() }).image
}

fn layer(image: &Image, layer: Layer) -> Vec<Rgb> {
    image.layer(layer.name()).expect("the layer was asked for")
}

#[track_caller]
fn assert_same(a: impl IntoIterator<Item = Rgb>, b: &[Rgb], what: &str) {
    for (i, (a, b)) in a.into_iter().zip(b).enumerate() {
        let off = (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
        assert!(off <= 1e-5 * (1.0 + b.max_channel()), "{what}, pixel {i}: {a:?}, not {b:?}");
    }
}

/// Without final gather nothing else makes up the picture; the paths are the same, so that only rounding differs.
#[test]
fn direct_and_both_maps_are_the_picture() {
    let image = render(&room(r#"<boolean name="final_gather" value="false"/>"#), &Layer::ALL[..5]);
    let [photons, caustic, global, direct] = [0, 1, 2, 3].map(|i| layer(&image, Layer::ALL[i]));
    for (name, layer) in [("caustic", &caustic), ("global", &global), ("direct", &direct)] {
        assert!(layer.iter().any(|c| !c.is_black()), "{name} is black");
    }
    let sum = caustic.iter().zip(&global).zip(&direct).map(|((&c, &g), &d)| c + g + d);
    assert_same(sum, image.pixels(), "direct + caustic + global");
    assert_same(caustic.iter().zip(&global).map(|(&c, &g)| c + g), &photons, "caustic + global");
    // And the picture is the one that is made without layers.
    let alone = render(&room(r#"<boolean name="final_gather" value="false"/>"#), &[]);
    assert_eq!(image.pixels(), alone.pixels());
}

/// With final gather the global map holds all light, that of caustics too: both maps together show it once.
#[test]
fn a_path_that_is_in_both_maps_counts_once() {
    let layers = [Layer::Photons, Layer::Caustic, Layer::Global, Layer::Direct];
    let image = render(&room(""), &layers);
    let mean = |l: Layer| layer(&image, l).iter().map(|c| f64::from(c.g)).sum::<f64>() / 576.0;
    let [photons, caustic, global, direct] = layers.map(mean);
    // Two estimates of the same light, blurred differently: discs at the borders lose a few per cent.
    assert!((photons / global - 1.0).abs() < 0.05, "{photons} and {global}");
    assert!(caustic > 0.05 * global, "{caustic} of {global} would be counted twice");
    // The global map holds direct light too, but no lights.
    let picture = image.pixels().iter().map(|c| f64::from(c.g)).sum::<f64>() / 576.0;
    assert!(direct < picture && global < 1.1 * picture && global > 0.7 * picture, "{direct} {global} {picture}");
    // Direct light is the same with and without final gather.
    let plain = render(&room(r#"<boolean name="final_gather" value="false"/>"#), &[Layer::Direct]);
    assert_same(layer(&image, Layer::Direct), &layer(&plain, Layer::Direct), "direct");
}

/// A square of 200 × 200 units under parallel light: the photons that are stored, over its area. The small square beside
/// it makes a global map worth having, and hardly changes it.
#[test]
fn density_is_photons_per_square_unit_of_the_scene_file() {
    let xml = r#"<scene version="3.0.0">
  <integrator type="photonmapper"><integer name="global_photons" value="40000"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="10, 15, 300" target="10, 15, 0" up="0, 1, 0"/></transform>
    <float name="fov" value="20"/>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="100"/></transform></shape>
  <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="-90"/><translate x="120" z="20"/></transform>
  </shape>
  <emitter type="directional"><vector name="direction" value="0, 0, -1"/></emitter>
</scene>"#;
    let scene = common::scene(xml, AccelKind::Bvh);
    let o = PlanOverrides { layers: vec![Layer::Density], ..PlanOverrides::default() };
    let rendering = common::run(&scene, o);
    let stored: u64 = rendering.summary.maps.iter().map(|m| m.stored).sum();
    let expected = stored as f64 / 40_000.0;
    let density = rendering.image.channel("density.Y").expect("the layer was asked for");
    let mean = density.iter().map(|&v| f64::from(v)).sum::<f64>() / density.len() as f64;
    // The picture sees 11 000 square units, so some 11 000 photons: 1 % of noise.
    assert!(stored > 30_000 && (mean / expected - 1.0).abs() < 0.04, "{mean}, not {expected}, of {stored} photons");
}

#[test]
fn records_of_the_cache_are_dots() {
    let cached = r#"<boolean name="irradiance_cache" value="true"/><integer name="resolution" value="4"/>"#;
    let xml = room(cached).replace("\"24\"", "\"64\"");
    let image = render(&xml, &[Layer::Cache]);
    let marks = image.channel("cache.Y").expect("the layer was asked for");
    let marked = marks.iter().filter(|&&m| m > 0.0).count();
    let most = marks.iter().copied().fold(0.0, f32::max);
    // Pixels are means of zeros and ones by a filter that is wider than a dot.
    assert!(marks.iter().all(|&m| m >= 0.0) && most > 0.9 && most < 1.00001, "{most}");
    // A dot covers some seven pixels, and records are at least as far apart where there is little to see.
    assert!(marked > 200 && marked < 3500, "{marked} of 4096 pixels");
}

#[test]
fn layers_that_are_not_there_are_refused() {
    let scene = common::scene(&room(""), AccelKind::Bvh);
    let plan = |integrator: &str, layer: Layer| {
        let o = PlanOverrides { integrator: Some(integrator.into()), layers: vec![layer], ..PlanOverrides::default() };
        Plan::new(&scene, &o).map(|_| ())
    };
    assert!(matches!(plan("path", Layer::Caustic), Err(PlanError::NoLayers { layer: "caustic", integrator: "path" })));
    assert!(matches!(plan("sppm", Layer::Density), Err(PlanError::NoLayers { .. })));
    assert!(matches!(plan("photonmapper", Layer::Cache), Err(PlanError::NoCache)));
    assert!(plan("photonmapper", Layer::Density).is_ok());
}
