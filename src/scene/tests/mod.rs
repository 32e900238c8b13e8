//! Loading whole scenes from text.

mod nested;

use std::path::Path;

use glam::Vec3;

use super::*;
use crate::accel::AccelKind;
use crate::bsdf::{LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::{Ray, Shape};
use crate::light::Light;

fn load(text: &str) -> Result<Scene, SceneError> {
    let options = LoadOptions { accel: AccelKind::Bvh, ..LoadOptions::default() };
    Scene::from_text(text, Path::new("t.xml"), &options)
}

fn ok(body: &str) -> Scene {
    match load(&format!("<scene version=\"3.0.0\">\n{body}\n</scene>")) {
        Ok(scene) => scene,
        Err(e) => panic!("{e}"),
    }
}

fn error(body: &str) -> String {
    match load(&format!("<scene version=\"3.0.0\">\n{body}\n</scene>")) {
        Ok(_) => panic!("no error in {body}"),
        Err(e) => e.to_string(),
    }
}

/// A room of 2 × 2 × 2 units with a red wall and a light under the ceiling.
const BOX: &str = r#"
<sensor type="perspective"><float name="fov" value="40"/>
  <transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
  <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="32"/><rfilter type="box"/></film>
  <sampler type="independent"><integer name="sample_count" value="16"/></sampler></sensor>
<integrator type="path"><integer name="max_depth" value="6"/></integrator>
<bsdf type="diffuse" id="red"><rgb name="reflectance" value="0.8, 0.1, 0.1"/></bsdf>
<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><translate y="-1"/></transform></shape>
<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="90"/><translate x="-1"/></transform>
  <ref id="red"/></shape>
<shape type="rectangle"><transform name="to_world"><scale value="0.25"/><rotate x="1" angle="90"/><translate y="0.99"/>
  </transform><emitter type="area"><rgb name="radiance" value="18, 15, 8"/></emitter></shape>
<shape type="sphere"><float name="radius" value="0.3"/><bsdf type="dielectric"/></shape>
"#;

/// A point of the world in scene space.
fn at(scene: &Scene, p: [f64; 3]) -> Vec3 {
    scene.to_scene.point(p.into())
}

#[test]
fn a_box_is_loaded() {
    let s = ok(BOX);
    assert_eq!((s.geometry.shapes.len(), s.stats.triangles, s.lights.len()), (4, 6, 1));
    assert_eq!((s.sampler.spp, s.sampler.sequence), (16, crate::sample::Sequence::Independent));
    assert_eq!((s.integrator.name.as_str(), s.integrator.integer("max_depth")), ("path", Some(6)));
    assert_eq!((s.film.width, s.film.height), (64, 32));
    let d = s.bounds.diagonal();
    assert!((1.0..2.0).contains(&d) && s.to_scene.scale == 0.5, "{d}");
    assert!(s.has_specular() && s.warnings.is_empty());

    // Down to the floor: white, looking up, no light.
    let si = s.intersect(&mut Ray::new(at(&s, [0.5, 0.0, 0.5]), Vec3::NEG_Y)).expect("the floor");
    assert!((si.p - at(&s, [0.5, -1.0, 0.5])).length() < 1e-6 && si.ng == Vec3::Y && !s.is_emitter(&si));
    let f = s.bsdf(&si).eval(Vec3::Y, Vec3::Y, Mode::Radiance, LobeMask::ALL);
    assert!((f.r - 0.5 / std::f32::consts::PI).abs() < 1e-6);
    // To the left: the red wall.
    let si = s.intersect(&mut Ray::new(at(&s, [0.0, 0.5, 0.5]), Vec3::NEG_X)).expect("the wall");
    let albedo = s.bsdf(&si).albedo(si.wo, LobeMask::ALL);
    assert!((albedo.r - 0.8).abs() < 1e-6 && (albedo.g - 0.1).abs() < 1e-6);
    // Up to the light, which shines down only.
    let si = s.intersect(&mut Ray::new(at(&s, [0.0, 0.5, 0.0]), Vec3::Y)).expect("the light");
    assert!(s.is_emitter(&si));
    assert_eq!(s.emitted(&si, si.wo), Rgb::new(18.0, 15.0, 8.0));
    assert_eq!(s.emitted(&si, -si.wo), Rgb::BLACK);
    assert!(s.pdf_direct(at(&s, [0.0, 0.5, 0.0]), &si) > 0.0);
}

#[test]
fn the_camera_sees_what_it_is_aimed_at() {
    let s = ok(BOX);
    // The middle of the film looks at the front of the sphere; its left edge at tan 20° · 4 to the left of the origin.
    let mut ray = s.camera.generate_ray(glam::Vec2::new(32.0, 16.0), glam::Vec2::ZERO).ray;
    let si = s.intersect(&mut ray).expect("the sphere");
    assert!((si.p - at(&s, [0.0, 0.0, 0.3])).length() < 1e-6, "{:?}", si.p);
    let ray = s.camera.generate_ray(glam::Vec2::new(0.0, 16.0), glam::Vec2::ZERO).ray;
    let p = ray.at((at(&s, [0.0; 3]).z - ray.o.z) / ray.d.z);
    let expected = at(&s, [-4.0 * 20f64.to_radians().tan(), 0.0, 0.0]);
    assert!((p - expected).length() < 1e-5, "{p} {expected}");
}

#[test]
fn the_default_view_sees_the_whole_box() {
    let s = ok("<shape type=\"cube\"/>");
    let mut ray = s.camera.generate_ray(glam::Vec2::new(384.0, 288.0), glam::Vec2::ZERO).ray;
    assert!(ray.d.z > 0.999_999 && s.intersect(&mut ray).is_some());
    let mut ray = s.camera.generate_ray(glam::Vec2::new(0.0, 288.0), glam::Vec2::ZERO).ray;
    assert!(s.intersect(&mut ray).is_none());
}

#[test]
fn film_size_crop_and_overrides() {
    let film = |body: &str, width, height| {
        let text = format!(
            "<scene version=\"3.0.0\"><sensor type=\"perspective\"><film type=\"hdrfilm\">{body}</film></sensor></scene>"
        );
        let options = LoadOptions { accel: AccelKind::Bvh, width, height, ..LoadOptions::default() };
        Scene::from_text(&text, Path::new("t.xml"), &options).map(|s| s.film)
    };
    let sized = "<integer name=\"width\" value=\"300\"/><integer name=\"height\" value=\"200\"/>";
    let f = film(sized, Some(150), None).expect("valid");
    assert_eq!(f.window.size, (150, 100));
    let crop =
        format!("{sized}<integer name=\"crop_offset_x\" value=\"100\"/><integer name=\"crop_width\" value=\"50\"/>");
    let f = film(&crop, None, None).expect("valid");
    assert_eq!((f.width, f.height, f.window.crop_offset), (50, 200, (100, 0)));
    let f = film(&crop, Some(600), Some(400)).expect("valid");
    assert_eq!((f.width, f.height, f.window.crop_offset), (100, 400, (200, 0)));
    let f = film(&crop, Some(1), Some(1)).expect("valid");
    assert_eq!((f.width, f.height), (1, 1));
    assert!(film("<integer name=\"width\" value=\"0\"/>", None, None).is_err());
}

#[test]
fn shadow_rays_reach_the_light_and_are_stopped() {
    let s = ok(BOX);
    let light = |x: f64| {
        let si = s.intersect(&mut Ray::new(at(&s, [x, -0.5, 0.0]), Vec3::NEG_Y)).expect("the floor");
        let li = s.lights[0].sample_li(&s.light_context(), si.p, glam::Vec2::splat(0.5)).expect("light");
        s.unoccluded(&si, &li)
    };
    assert!(light(0.9));
    assert!(!light(0.0), "the sphere is between");
}

#[test]
fn scale_does_not_change_the_scene_box() {
    let shapes = |scale: f64| {
        ok(&format!(
            "<shape type=\"sphere\"><transform name=\"to_world\"><translate x=\"0.3\"/><scale value=\"{scale}\"/>
             </transform></shape><shape type=\"cube\"><transform name=\"to_world\"><rotate x=\"1\" y=\"2\" angle=\"33\"/>
             <translate y=\"2.7\"/><scale value=\"{scale}\"/></transform></shape>
             <emitter type=\"point\"><point name=\"position\" x=\"{}\" y=\"0\" z=\"0\"/><rgb name=\"intensity\" value=\"{}\"/>
             </emitter>",
            5.0 * scale,
            scale * scale
        ))
    };
    let (a, b) = (shapes(1.0), shapes(2f64.powi(40)));
    let mesh = |s: &Scene| match &s.geometry.shapes[1] {
        Shape::Mesh(m) => m.positions.as_slice().to_vec(),
        _ => panic!("a mesh"),
    };
    assert_eq!(mesh(&a), mesh(&b));
    assert_eq!(a.bounds, b.bounds);
    let (Light::Point(p), Light::Point(q)) = (&a.lights[0], &b.lights[0]) else { panic!("points") };
    assert_eq!((p.position, p.intensity), (q.position, q.intensity));
}
#[test]
fn instances_and_groups() {
    let s = ok("<shape type=\"shapegroup\" id=\"g\"><shape type=\"cube\"><transform name=\"to_world\">
        <translate x=\"100\"/></transform></shape></shape>
        <shape type=\"instance\"><ref id=\"g\"/><transform name=\"to_world\"><translate x=\"-100\"/></transform></shape>
        <shape type=\"instance\"><ref id=\"g\"/><transform name=\"to_world\"><translate x=\"-90\" y=\"3\"/></transform></shape>");
    assert_eq!((s.stats.shapes, s.stats.instances, s.stats.triangles), (1, 2, 12));
    for (x, y) in [(0.0, 0.0), (10.0, 3.0)] {
        let si = s.intersect(&mut Ray::new(at(&s, [x, y, 20.0]), Vec3::NEG_Z)).expect("a cube");
        assert!((si.p - at(&s, [x, y, 1.0])).length() < 1e-5, "{:?}", si.p);
    }
    assert!(error("<shape type=\"shapegroup\"/>").contains("empty"));
    assert!(error("<shape type=\"instance\"/>").contains("holds no shapegroup"));
    let light = "<shape type=\"shapegroup\"><shape type=\"cube\"><emitter type=\"area\"/></shape></shape>";
    assert!(error(light).contains("emitter inside of a shapegroup"));
}

#[test]
fn an_empty_scene_is_a_scene() {
    let s = ok("<emitter type=\"constant\"/>");
    assert!(s.intersect(&mut Ray::new(Vec3::ZERO, Vec3::X)).is_none());
    assert_eq!(s.environment_radiance(Vec3::X), Rgb::WHITE);
    assert!((s.pdf_environment(Vec3::ZERO, Vec3::X) - 0.25 / std::f32::consts::PI).abs() < 1e-6);
    assert_eq!(s.integrator.name, "path");
    assert_eq!((s.film.width, s.film.height), (768, 576));
}

#[test]
fn hash_follows_content_and_defines() {
    let text = "<scene version=\"3.0.0\"><default name=\"r\" value=\"1\"/><shape type=\"sphere\"><float name=\"radius\" value=\"$r\"/></shape></scene>";
    let hash = |text: &str, defines: &[(&str, &str)]| {
        let defines = defines.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        let options = LoadOptions { defines, accel: AccelKind::Bvh, ..LoadOptions::default() };
        Scene::from_text(text, Path::new("t.xml"), &options).unwrap_or_else(|e| panic!("{e}")).hash
    };
    assert_eq!(hash(text, &[]), hash(text, &[]));
    assert_ne!(hash(text, &[]), hash(text, &[("r", "2")]));
    assert_ne!(hash(text, &[]), hash(&format!("{text} "), &[]));
}

#[test]
fn every_material_loads_with_its_defaults() {
    for plugin in [
        "diffuse",
        "dielectric",
        "thindielectric",
        "roughdielectric",
        "conductor",
        "roughconductor",
        "plastic",
        "roughplastic",
        "phong",
        "principled",
        "principledthin",
        "null",
    ] {
        let s = ok(&format!("<shape type=\"sphere\"><bsdf type=\"{plugin}\"/></shape>"));
        let si = s.intersect(&mut Ray::new(Vec3::new(0.0, 0.1, 2.0), Vec3::NEG_Z)).expect("the sphere");
        assert!(!s.bsdf(&si).lobes().is_empty(), "{plugin}");
    }
}

#[test]
fn nested_materials_and_bump_heights() {
    let texture = "<texture type=\"checkerboard\"/>";
    let s = ok(&format!(
        "<shape type=\"sphere\"><float name=\"radius\" value=\"100\"/><bsdf type=\"bumpmap\"><float name=\"scale\" value=\"4\"/>
         {texture}<bsdf type=\"mask\"><float name=\"opacity\" value=\"0.25\"/><bsdf type=\"twosided\"><bsdf type=\"diffuse\"/>
         <bsdf type=\"plastic\"/></bsdf></bsdf></bsdf></shape>"
    ));
    // The heights are lengths: 4 of a sphere of radius 100.
    let scale = s.materials.iter().find_map(|m| match m {
        crate::bsdf::Material::BumpMap { scale, .. } => Some(*scale),
        _ => None,
    });
    assert_eq!(scale, Some(4.0 * s.to_scene.scale as f32));
    let si = s.intersect(&mut Ray::new(Vec3::new(0.0, 0.1, 2.0), Vec3::NEG_Z)).expect("the sphere");
    let lobes = s.bsdf(&si).lobes();
    assert!(lobes.intersects(LobeMask::NULL) && lobes.intersects(LobeMask::DIFFUSE));
}

#[test]
fn mitsuba_06_files_load() {
    let s = load(
        "<scene version=\"0.6.0\"><integrator type=\"photonmapper\"><integer name=\"globalPhotons\" value=\"1000\"/>
         <float name=\"causticLookupRadius\" value=\"0.01\"/><integer name=\"maxDepth\" value=\"-1\"/></integrator>
         <sensor type=\"perspective\"><string name=\"fovAxis\" value=\"smaller\"/><float name=\"fov\" value=\"40\"/>
         <transform name=\"toWorld\"><scale x=\"-1\"/><lookAt origin=\"0,0,4\" target=\"0,0,0\" up=\"0,1,0\"/></transform>
         <film type=\"hdrfilm\"><string name=\"pixelFormat\" value=\"rgb\"/><boolean name=\"banner\" value=\"false\"/></film>
         <sampler type=\"ldsampler\"><integer name=\"sampleCount\" value=\"8\"/></sampler></sensor>
         <shape type=\"sphere\"><bsdf type=\"dielectric\"><float name=\"intIOR\" value=\"1.5\"/></bsdf></shape>
         <shape type=\"rectangle\"><boolean name=\"flipNormals\" value=\"true\"/><bsdf type=\"roughconductor\"/>
         <emitter type=\"area\"><spectrum name=\"radiance\" value=\"2, 1, 1\"/></emitter></shape></scene>",
    )
    .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(s.integrator.integer("global_photons"), Some(1000));
    assert_eq!(s.integrator.float("caustic_lookup_radius"), Some(0.01));
    assert_eq!((s.sampler.spp, s.lights.len()), (8, 1));
}

#[test]
fn the_scenes_of_the_repository_load() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let options = LoadOptions { accel: AccelKind::Bvh, ..LoadOptions::default() };
    let mut count = 0;
    for entry in std::fs::read_dir(folder).expect("scenes/ is there") {
        let path = entry.expect("scenes/ can be read").path();
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        // Scenes whose mesh the program writes first are tested where it is written.
        if path.extension().is_none_or(|e| e != "xml") || ["terrain.ply", "waves.ply"].iter().any(|f| text.contains(f))
        {
            continue;
        }
        let s = Scene::load(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        assert!(s.warnings.is_empty() && !s.lights.is_empty(), "{}: {:?}", path.display(), s.warnings);
        count += 1;
    }
    assert!(count >= 4, "{count}");
}

#[test]
fn a_test_of_all_passes_needs_their_statistics() {
    let parameters = r#"<boolean name="shared_statistics" value="false"/>
<boolean name="chi_squared_radius" value="true"/>"#;
    let e = error(&format!("<integrator type=\"sppm\">{parameters}</integrator>"));
    assert!(e.contains("t.xml:3") && e.contains("leave shared_statistics out"), "{e}");
    let e = error(r#"<integrator type="vcm"><boolean name="chi_squared_radius" value="true"/></integrator>"#);
    assert!(e.contains("chi_squared_radius"), "{e}");
}
