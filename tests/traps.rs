//! Mistakes that photon mappers have made; each has its test. Where the value is statistical, the bound is four standard
//! errors at least.

mod common;

use caustica::accel::AccelKind;
use caustica::color::{Rgb, rgbe};
use caustica::gather::{AreaSettings, LookupSettings, MapEstimate, PhotonMaps};
use caustica::geometry::{Ray, SurfaceInteraction};
use caustica::integrator::sppm::radius_sq_ratio;
use caustica::math::Vec3;
use caustica::photon::direction::{decode, encode};
use caustica::photon::{Kernel, Photon, PhotonClass, PhotonMap, PhotonRecord};
use caustica::render::PlanOverrides;
use caustica::sample::{Key, Purpose, Sampler, Sequence, mix64};
use caustica::scene::Scene;
use caustica::shoot::{ShootSettings, Shot, Target, WalkSettings, shoot};
use caustica::tally::Counters;
use common::{mean, run, scene};

/// A white square from −1 to 1 at z = 0, seen from z = 2.
const SQUARE: &str = r#"<scene version="3.0.0">
  <sensor type="perspective"><transform name="to_world"><lookat origin="0, 0, 2" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor>
  <shape type="rectangle"><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></bsdf></shape>
</scene>"#;

fn uniform(i: u64) -> f32 {
    (mix64(i) >> 40) as f32 / (1u64 << 24) as f32
}

/// `n` photons of a watt each, spread over the square of half width `half` around the origin, that came from `wi`.
fn sheet(n: u64, half: f32, wi: Vec3, salt: u64) -> impl Iterator<Item = Photon> {
    (0..n).map(move |i| {
        let at = |axis: u64| half * (2.0 * uniform((salt << 40) + 2 * i + axis) - 1.0);
        let record = PhotonRecord {
            p: Vec3::new(at(0), at(1), 0.0),
            power: Rgb::splat(1.0),
            wi,
            side: wi.z > 0.0,
            normal: Vec3::Z,
            class: PhotonClass::Global,
            mark: false,
        };
        Photon::pack(&record, mix64(i)).expect("a storable photon")
    })
}

fn lookup(size: u32, radius: f32) -> LookupSettings {
    LookupSettings {
        global_size: size,
        caustic_size: size,
        global_radius: radius,
        caustic_radius: radius,
        kernel: Kernel::Epanechnikov,
        area: AreaSettings::default(),
    }
}

/// What a map of these photons says at the middle of the square, seen from above.
fn estimate(photons: impl Iterator<Item = Photon>, size: u32, radius: f32) -> MapEstimate {
    let scene = scene(SQUARE, AccelKind::Bvh);
    let mut maps = PhotonMaps::default();
    maps.set_global(PhotonMap::build(photons.collect()), &lookup(size, radius), 1.0);
    let si = middle(&scene);
    maps.global_radiance(&si, &scene.bsdf(&si), &mut Counters::default())
}

fn middle(scene: &Scene) -> SurfaceInteraction {
    scene.intersect(&mut Ray::new(Vec3::new(0.0, 0.0, 0.5), -Vec3::Z)).expect("the square")
}

fn settings(photons: u64, target: Target) -> ShootSettings {
    let walk = WalkSettings { max_depth: None, rr_depth: 1, sequence: Sequence::Independent };
    ShootSettings { seed: 1, pass: 0, target, walk, photons, max_paths: 1 << 23, guided: true }
}

/// A counter of 32 bits overflows at 2³² photons.
#[test]
fn photon_counters_have_64_bits() {
    let (shot, counters) = (Shot::default(), Counters::default());
    assert_eq!(size_of_val(&shot.emitted) + size_of_val(&shot.rejected), 16);
    assert_eq!(size_of_val(&counters.photon_rays) + size_of_val(&counters.photon_queries), 16);
    let key = Key::new(1, Purpose::Photon, 0);
    let first = |index: u64| Sampler::new(Sequence::Sobol, key, index).next_2d();
    assert_ne!(first(3), first(3 + (1 << 32)), "paths repeat after 2^32");
}

/// Photons on the back must neither count as neighbours nor shrink the radius.
#[test]
fn photons_of_the_back_do_not_count() {
    let front = estimate(sheet(10_000, 1.0, Vec3::Z, 1), 100, 0.5);
    let both = estimate(sheet(10_000, 1.0, Vec3::Z, 1).chain(sheet(90_000, 1.0, -Vec3::Z, 2)), 100, 0.5);
    assert_eq!(front.radius_sq, both.radius_sq);
    assert!((front.radiance.g / both.radiance.g - 1.0).abs() < 1e-5);
}

/// A surface that takes all light must not send on photons without power that fill the next query.
#[test]
fn photons_without_power_are_not_stored() {
    let walls = r#"<scene version="3.0.0"><sensor type="perspective"/>
        <shape type="cube"><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.9, 0, 0"/></bsdf></bsdf>
        </shape><emitter type="point"><rgb name="intensity" value="0, 1, 0"/></emitter></scene>"#;
    let shot = shoot(&scene(walls, AccelKind::Bvh), &settings(5_000, Target::Global));
    // Green light on red walls ends at the first.
    assert_eq!(shot.photons.len() as u64, shot.emitted);
    assert!(shot.photons.iter().all(|p| rgbe::unpack(p.power).g > 0.0));
}

/// The radius of pass i follows from i; shrinking what was shrunk before, or r ∝ 1/i, is not the schedule.
#[test]
fn the_radius_is_not_compounded_and_variance_falls() {
    let alpha = 2.0 / 3.0;
    let mut product = 1.0;
    for i in 1..1000u64 {
        product *= (i as f64 + alpha) / (i as f64 + 1.0);
        let ratio = radius_sq_ratio(i, alpha);
        assert!((ratio / product - 1.0).abs() < 1e-9, "pass {i}: {ratio}, not {product}");
        // The variance of the mean of i passes is ∝ 1/i² Σ 1/r²: it falls as long as i·r² grows.
        assert!(i as f64 * radius_sq_ratio(i, alpha) > (i - 1) as f64 * radius_sq_ratio(i - 1, alpha));
    }
}

/// Truncating angles and decoding at the corner of a cell turns all directions one way.
#[test]
fn directions_are_decoded_at_the_middle_of_their_cells() {
    let (mut square, mut drift) = (0.0f64, Vec3::ZERO);
    let n = 20_000u64;
    for i in 0..n {
        let (z, phi) = (2.0 * uniform(2 * i) - 1.0, std::f32::consts::TAU * uniform(2 * i + 1));
        let r = (1.0 - z * z).sqrt();
        let d = Vec3::new(r * phi.cos(), r * phi.sin(), z);
        let back = decode(encode(d));
        assert!((back.length() - 1.0).abs() < 1e-5);
        square += (d.cross(back).length() as f64).asin().to_degrees().powi(2);
        drift += (back - d) / n as f32;
    }
    let rms = (square / n as f64).sqrt();
    assert!(rms < 0.40, "{rms}° rms");
    // 0.4° is 0.007; over 20 000 directions the mean has 5e-5.
    assert!(drift.abs().max_element() < 2e-4, "directions drift by {drift}");
}

/// acos(1 + ε) is NaN, and NaN as a byte is a direction somewhere else.
#[test]
fn axes_survive_the_direction_bytes() {
    for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
        for scale in [1.0 - 3e-7, 1.0, 1.0 + 3e-7] {
            let back = decode(encode(axis * scale));
            assert!(back.is_finite() && back.dot(axis) > 0.9999, "{axis} comes back as {back}");
        }
    }
}

/// Dividing by the cosine of arrival, or clamping it, breaks grazing light. The sun 0.05° above the ground gives the
/// ground sin 0.05° of its irradiance, in photons as in density estimates.
#[test]
fn grazing_light_is_not_divided_by_its_cosine() {
    let elevation = 0.05f32.to_radians();
    let d = Vec3::new(elevation.cos(), 0.0, -elevation.sin());
    let sun = format!(
        "<emitter type=\"directional\"><vector name=\"direction\" x=\"{}\" y=\"0\" z=\"{}\"/>\
         <rgb name=\"irradiance\" value=\"1000\"/></emitter></scene>",
        d.x, d.z
    );
    let scene = scene(&SQUARE.replace("</scene>", &sun), AccelKind::Bvh);
    // 9e-4 · 4/π of the disc of all the light meets the square.
    let shot = shoot(&scene, &settings(2_000, Target::Global));
    let power: f64 = shot.photons.iter().map(|p| rgbe::unpack(p.power).g as f64).sum();
    let area = 4.0 * scene.to_scene.scale.powi(2);
    let expected = 1000.0 * elevation.sin() as f64 * area;
    let error = 4.0 / (shot.photons.len() as f64).sqrt();
    assert!((power / expected - 1.0).abs() < error, "{power} W of {expected} W, {} photons", shot.photons.len());
    // As much per area when the same photons come from the zenith as from the horizon.
    let low = estimate(sheet(10_000, 1.0, -d, 3), 100, 0.5);
    let high = estimate(sheet(10_000, 1.0, Vec3::Z, 3), 100, 0.5);
    assert!((low.radiance.g / high.radiance.g - 1.0).abs() < 1e-4);
}

/// k photons in the area of the largest radius, rather than of the k-th, make bright places dark.
#[test]
fn the_area_is_that_of_the_photons_counted() {
    let expected = 40_000.0 / 4.0 / std::f32::consts::PI;
    let found = estimate(sheet(40_000, 1.0, Vec3::Z, 4), 400, 0.5);
    // 400 photons, Epanechnikov: √(4/3/398) = 5.8 %.
    assert!((found.radiance.g / expected - 1.0).abs() < 0.24, "{} of {expected}", found.radiance.g);
    assert!((found.radius_sq / (400.0 / 10_000.0 / std::f32::consts::PI) - 1.0).abs() < 0.2);
}

/// r in the place of r² shows when everything is half as large: densities are four times as high.
#[test]
fn estimates_go_with_the_square_of_lengths() {
    for radius in [0.5, 0.05] {
        let size = if radius == 0.5 { 100 } else { 1_000_000 };
        let large = estimate(sheet(100_000, 1.0, Vec3::Z, 5), size, radius);
        let small = estimate(sheet(100_000, 0.5, Vec3::Z, 5), size, 0.5 * radius);
        assert!((small.radiance.g / large.radiance.g - 4.0).abs() < 1e-3, "{radius}");
        assert!((large.radius_sq / small.radius_sq - 4.0).abs() < 1e-3, "{radius}");
    }
}

/// Powers are divided by the paths emitted, not by the photons asked for or stored: in a black box the photons hold what
/// the light gives, whatever number was wanted.
#[test]
fn powers_are_divided_by_the_emitted_paths() {
    let walls = r#"<scene version="3.0.0"><sensor type="perspective"/>
        <shape type="cube"><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>
        <emitter type="point"><rgb name="intensity" value="2"/></emitter></scene>"#;
    let scene = scene(walls, AccelKind::Bvh);
    let expected = scene.lights[0].power(&scene.light_context()).g as f64;
    for photons in [1_000, 30_000] {
        let shot = shoot(&scene, &settings(photons, Target::Global));
        let stored: f64 = shot.photons.iter().map(|p| rgbe::unpack(p.power).g as f64).sum();
        // Rounding to RGBE at random is 0.3 % a photon at most.
        assert!((stored / expected - 1.0).abs() < 1e-3, "{photons}: {stored} W of {expected} W");
    }
}

/// Grids over a cluster of photons and one far away must not overflow.
#[test]
fn a_far_photon_overflows_no_grid() {
    let scene = scene(SQUARE, AccelKind::Bvh);
    let mut photons: Vec<Photon> = sheet(2_000, 1e-6, Vec3::Z, 6).collect();
    photons.push(Photon { position: [1e15, -1e15, 3e14], ..photons[0] });
    let mut maps = PhotonMaps::default();
    maps.set_global(PhotonMap::build(photons), &lookup(100, 1e-4), 1.0);
    maps.precompute_irradiance();
    let si = middle(&scene);
    let found: MapEstimate = maps.global_radiance(&si, &scene.bsdf(&si), &mut Counters::default());
    assert!(found.radiance.is_finite() && found.radiance.g > 0.0);
}

/// A white room around the camera, in which light goes to and fro.
const ROOM: &str = r#"<scene version="3.0.0"><sensor type="perspective">
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor>
  <shape type="cube"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <emitter type="point"><point name="position" x="0.5" y="0.5" z="0"/><rgb name="intensity" value="1"/></emitter></scene>"#;

/// A pass must not keep what the pass before it needed.
#[test]
fn memory_does_not_grow_from_pass_to_pass() {
    let memory = |passes: u64| {
        let o = PlanOverrides {
            integrator: Some("photonmapper".into()),
            photons: Some(2_000),
            spp: Some(passes),
            passes: Some(passes),
            ..PlanOverrides::default()
        };
        run(&scene(ROOM, AccelKind::Bvh), o).summary.photon_memory as f64
    };
    let (one, many) = (memory(1), memory(6));
    assert!(many < 1.2 * one, "{one} bytes for one pass, {many} for six");
}

/// A budget in bytes is kept, and made use of.
#[test]
fn a_memory_budget_is_kept() {
    for integrator in ["photonmapper", "sppm"] {
        let o = PlanOverrides {
            integrator: Some(integrator.into()),
            photon_memory: Some(3_000_000),
            spp: Some(1),
            passes: Some(1),
            ..PlanOverrides::default()
        };
        let used = run(&scene(ROOM, AccelKind::Bvh), o).summary.photon_memory;
        assert!((300_000..3_000_000).contains(&used), "{integrator}: {used} bytes");
    }
}

/// On the two sides of the roughness at which photons no longer store, the picture is the same.
#[test]
fn roughness_thresholds_do_not_show() {
    let ball = |alpha: f32| {
        let text = format!(
            "<scene version=\"3.0.0\"><sensor type=\"perspective\"><float name=\"fov\" value=\"30\"/>\
             <transform name=\"to_world\"><lookat origin=\"0, 0, 5\" target=\"0, 0, 0\" up=\"0, 1, 0\"/></transform>\
             <film type=\"hdrfilm\"><integer name=\"width\" value=\"16\"/><integer name=\"height\" value=\"16\"/>\
             </film></sensor><emitter type=\"constant\"/><shape type=\"sphere\"><bsdf type=\"roughconductor\">\
             <string name=\"material\" value=\"none\"/><float name=\"alpha\" value=\"{alpha}\"/></bsdf></shape></scene>"
        );
        mean(&common::photon_image(&scene(&text, AccelKind::Bvh), 16, 20_000, 1))
    };
    let (below, above) = (ball(0.0599), ball(0.0601));
    assert!((below / above - 1.0).abs() < 0.01, "{below} below the threshold, {above} above");
}

/// Equal times are measured by the clock on the wall; processor time counts every thread.
#[test]
fn time_is_wall_time() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/render");
    for entry in std::fs::read_dir(folder).expect("src/render") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            continue;
        }
        let text = std::fs::read_to_string(path).expect("a source file");
        assert!(!["getrusage", "CPUTIME", "times("].iter().any(|c| text.contains(c)));
    }
}
