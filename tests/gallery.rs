//! Every scene of the gallery loads and renders.

mod common;

use std::path::{Path, PathBuf};

use caustica::image::Image;
use caustica::render::PlanOverrides;
use caustica::scene::{LoadOptions, Scene};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/gallery")
}

/// The picture of a scene file, 16 pixels wide and high.
fn small(name: &str, defines: &[(&str, &str)], photons: u64) -> Image {
    let defines = defines.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let options = LoadOptions { width: Some(16), height: Some(16), defines, ..LoadOptions::default() };
    let scene = match Scene::load(&folder().join(name), &options) {
        Ok(scene) => scene,
        Err(e) => panic!("{name}: {e}"),
    };
    assert!(scene.warnings.is_empty(), "{name}: {:?}", scene.warnings);
    let integrator = Some("photonmapper".to_owned());
    let o = PlanOverrides { integrator, spp: Some(2), photons: Some(photons), ..PlanOverrides::default() };
    let rendering = common::run(&scene, o);
    assert_eq!(rendering.summary.counters.non_finite(), 0, "{name}");
    rendering.image
}

#[test]
fn every_scene_loads_and_renders() {
    let mut names: Vec<String> = std::fs::read_dir(folder())
        .expect("the gallery")
        .map(|entry| entry.expect("a file").file_name().to_string_lossy().into_owned())
        .filter(|name| name.ends_with(".xml"))
        .collect();
    names.sort();
    assert!(names.len() >= 8, "{names:?}");
    names.extend(["../ring.xml", "../environment.xml", "../cornell-spheres.xml"].map(str::to_owned));
    for name in &names {
        let mean = common::mean(&small(name, &[], 3000));
        // Exposed so that it shows at --exposure 0.
        assert!(mean > 0.01 && mean < 2.0, "{name}: mean radiance {mean}");
    }
}

#[test]
fn the_defines_of_the_gallery_change_the_picture() {
    let noon = small("poolhouse.xml", &[], 2000);
    let evening = [("sun", "0.9, 0.3, -0.22"), ("sunlight", "2.2, 1.0, 0.38"), ("sky", "0.15, 0.17, 0.28")];
    let evening = small("poolhouse.xml", &evening, 2000);
    let redness = |image: &Image| {
        let [r, _, b] = caustica::image::metrics::mean_rgb(image).expect("a picture");
        r / b
    };
    assert!(redness(&evening) > 1.2 * redness(&noon), "{} and {}", redness(&evening), redness(&noon));
    let [smooth, rough] = ["0.08", "0.6"].map(|alpha| small("glossy.xml", &[("alpha", alpha)], 2000));
    assert_ne!(smooth.pixels(), rough.pixels());
}

/// Each has a picture in README.md, small enough for a repository.
#[test]
fn every_scene_has_its_picture() {
    let readme = std::fs::read_to_string(folder().join("../README.md")).expect("a README");
    for entry in std::fs::read_dir(folder()).expect("the gallery") {
        let path = entry.expect("a file").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        match path.extension().and_then(|e| e.to_str()) {
            Some("xml") => assert!(readme.contains(&format!("gallery/{name}")), "{name} is not in the README"),
            Some("png") => {
                assert!(readme.contains(&format!("gallery/{name}")), "{name} is not in the README");
                let bytes = std::fs::metadata(&path).expect("a file").len();
                assert!(bytes < 60_000, "{name}: {bytes} bytes");
            }
            Some("ply") => {}
            _ => panic!("{name} does not belong here"),
        }
    }
}
