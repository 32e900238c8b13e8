//! Scenes with a mistake: each gives an error that names the place, what was found and what to do, and none panics.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use caustica::accel::AccelKind;
use caustica::scene::{LoadOptions, Scene, SceneError};

/// A folder with a mesh, a damaged mesh, an image and includes for the scenes below.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, bytes: &[u8]| fs::write(dir.path().join(name), bytes).expect("a temporary file");
    write("good.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    write("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    write("nan.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n");
    write("empty.obj", b"v 0 0 0\n");
    write("flat.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    write(
        "huge.ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 900000000\nproperty float x\nproperty float y\n\
          property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n",
    );
    write("cut.serialized", b"\x1c\x04\x04\x00\xff\xff\xff\xff");
    write("bad.png", b"\x89PNG\r\n\x1a\nnonsense");
    write("loop.xml", b"<scene version=\"3.0.0\"><include filename=\"loop.xml\"/></scene>");
    write("rising.spd", b"400 1\n300 2\n");
    dir
}

/// (what stands between `<scene …>` on line 1 and `</scene>`, line, column, parts of the message)
type Case = (&'static str, u32, u32, &'static [&'static str]);

const CASES: &[Case] = &[
    ("<shape type=\"sphere\">", 3, 1, &["not well-formed", "expected 'shape' tag"]),
    ("<bsdf type=\"difuse\"/>", 2, 1, &["unknown bsdf plugin \"difuse\"", "did you mean \"diffuse\"?"]),
    ("<shap type=\"sphere\"/>", 2, 1, &["unknown element <shap>", "did you mean \"shape\"?"]),
    ("<shape kind=\"sphere\"/>", 2, 8, &["unknown attribute \"kind\" of <shape>", "known are type"]),
    ("<shape/>", 2, 1, &["<shape> has no attribute \"type\"", "write <shape type="]),
    (
        "<shape type=\"sphere\">\n  <float name=\"radius\" value=\"1,5\"/></shape>",
        3,
        24,
        &["\"1,5\" is not a number", "write a number"],
    ),
    (
        "<shape type=\"sphere\">\n <float name=\"radius\" value=\"-1\"/></shape>",
        3,
        2,
        &["\"radius\" is -1", "must be above zero"],
    ),
    (
        "<shape type=\"sphere\"><float name=\"radus\" value=\"1\"/></shape>",
        2,
        22,
        &["the shape plugin \"sphere\" has no parameter \"radus\"", "did you mean \"radius\"?"],
    ),
    (
        "<shape type=\"sphere\"><string name=\"radius\" value=\"1\"/></shape>",
        2,
        22,
        &["\"radius\" is a string", "needs a number"],
    ),
    ("<shape type=\"obj\"/>", 2, 1, &["has no \"filename\"", "add <string name=\"filename\""]),
    (
        "<shape type=\"obj\"><string name=\"filename\" value=\"none.obj\"/></shape>",
        2,
        19,
        &["file \"none.obj\" not found", "looked in"],
    ),
    (
        "<shape type=\"obj\"><string name=\"filename\" value=\"index.obj\"/></shape>",
        2,
        19,
        &["index.obj, line 4", "9", "expected"],
    ),
    (
        "<shape type=\"obj\"><string name=\"filename\" value=\"nan.obj\"/></shape>",
        2,
        19,
        &["nan.obj, line 2", "nan", "expected"],
    ),
    ("<shape type=\"obj\"><string name=\"filename\" value=\"empty.obj\"/></shape>", 2, 1, &["empty.obj", "no faces"]),
    (
        "<shape type=\"obj\"><string name=\"filename\" value=\"flat.obj\"/></shape>",
        2,
        1,
        &["flat.obj", "only triangles without area (1 of them)"],
    ),
    ("<shape type=\"ply\"><string name=\"filename\" value=\"huge.ply\"/></shape>", 2, 19, &["huge.ply", "900000000"]),
    (
        "<shape type=\"serialized\"><string name=\"filename\" value=\"cut.serialized\"/></shape>",
        2,
        26,
        &["cut.serialized", "expected"],
    ),
    (
        "<shape type=\"cube\"><transform name=\"to_world\"><scale x=\"0\"/></transform></shape>",
        2,
        20,
        &["\"to_world\" cannot be inverted", "a scale factor is zero"],
    ),
    (
        "<shape type=\"sphere\"><transform name=\"to_world\"><scale x=\"2\"/></transform></shape>",
        2,
        22,
        &["stretches a sphere into an ellipsoid", "scale all axes alike"],
    ),
    (
        "<shape type=\"cube\"><transform name=\"to_world\"><lookat origin=\"1,1,1\" target=\"1,1,1\"/></transform></shape>",
        2,
        47,
        &["origin and target coincide"],
    ),
    (
        "<shape type=\"cube\"><transform name=\"to_world\"><matrix value=\"1 2 3\"/></transform></shape>",
        2,
        47,
        &["a matrix has 16 or 9 numbers, not 3"],
    ),
    (
        "<sensor type=\"perspective\"><film type=\"hdrfilm\"><integer name=\"width\" value=\"0\"/></film></sensor>",
        2,
        49,
        &["\"width\" is 0", "between 1 and"],
    ),
    (
        "<sensor type=\"perspective\"><float name=\"fov\" value=\"180\"/></sensor>",
        2,
        28,
        &["field of view is 180 degrees", "between 0 and 180"],
    ),
    ("<sensor type=\"fisheye\"/>", 2, 1, &["unknown sensor plugin \"fisheye\"", "known are perspective"]),
    (
        "<shape type=\"cube\"><ref id=\"read\"/></shape>\n<bsdf type=\"diffuse\" id=\"red\"/>",
        2,
        25,
        &["no object has the id \"read\"", "did you mean \"red\"?"],
    ),
    (
        "<bsdf type=\"diffuse\" id=\"a\"/>\n<bsdf type=\"diffuse\" id=\"a\"/>",
        3,
        1,
        &["duplicate id \"a\"", "used first at", ":2:1"],
    ),
    ("<bsdf type=\"twosided\" id=\"a\"><ref id=\"a\"/></bsdf>", 2, 35, &["contain itself", "outside of this one"]),
    ("<bsdf type=\"twosided\"/>", 2, 1, &["holds too few materials", "put 1 <bsdf>"]),
    (
        "<bsdf type=\"twosided\"><bsdf type=\"dielectric\"/></bsdf>",
        2,
        1,
        &["only materials without transmission can be nested in a two-sided one"],
    ),
    (
        "<bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"2\"/></bsdf>",
        2,
        22,
        &["reflectance (2, 2, 2) is out of range", "between 0 and 1"],
    ),
    (
        "<bsdf type=\"dielectric\"><string name=\"int_ior\" value=\"diamant\"/></bsdf>",
        2,
        25,
        &["unknown medium \"diamant\"", "did you mean \"diamond\"?"],
    ),
    (
        "<bsdf type=\"diffuse\"><spectrum name=\"reflectance\" value=\"400:1, 300:2\"/></bsdf>",
        2,
        51,
        &["wavelengths of a spectrum must increase"],
    ),
    (
        "<bsdf type=\"diffuse\"><spectrum name=\"reflectance\" filename=\"rising.spd\"/></bsdf>",
        2,
        51,
        &["\"rising.spd\": the wavelengths", "lines of wavelength and value"],
    ),
    (
        "<bsdf type=\"diffuse\"><texture type=\"bitmap\" name=\"reflectance\"><string name=\"filename\" value=\"bad.png\"/>\
         </texture></bsdf>",
        2,
        64,
        &["bad.png"],
    ),
    (
        "<bsdf type=\"diffuse\"><texture type=\"bitmap\" name=\"colour\"><string name=\"filename\" value=\"bad.png\"/>\
         </texture></bsdf>",
        2,
        22,
        &["has no parameter \"colour\"", "known are reflectance"],
    ),
    (
        "<shape type=\"cube\"><bsdf type=\"diffuse\"><texture type=\"mesh_attribute\" name=\"reflectance\">\
         <string name=\"name\" value=\"vertex_color\"/></texture></bsdf></shape>",
        2,
        41,
        &["has no attribute \"vertex_color\"", "come from a ply file"],
    ),
    (
        "<bsdf type=\"roughconductor\"><string name=\"material\" value=\"Gold\"/></bsdf>",
        2,
        29,
        &["unknown metal \"Gold\""],
    ),
    (
        "<bsdf type=\"roughconductor\"><string name=\"distribution\" value=\"gxx\"/></bsdf>",
        2,
        29,
        &["unknown distribution \"gxx\"", "did you mean \"ggx\"?"],
    ),
    ("<bsdf type=\"bumpmap\"/>", 2, 1, &["the bumpmap has no texture", "put a <texture>"]),
    ("<emitter type=\"area\"/>", 2, 1, &["an area emitter outside of a shape", "move it into the <shape>"]),
    (
        "<emitter type=\"constant\"/>\n<emitter type=\"constant\"/>",
        3,
        1,
        &["a second environment light", "at most one"],
    ),
    (
        "<emitter type=\"point\"><float name=\"photon_share\" value=\"-0.1\"/></emitter>",
        2,
        23,
        &["\"photon_share\" is -0.1", "between 0 and 1"],
    ),
    (
        "<emitter type=\"point\"><float name=\"photon_share\" value=\"0.6\"/></emitter>\n\
         <emitter type=\"point\"><float name=\"photon_share\" value=\"0.5\"/></emitter>",
        1,
        1,
        &["a \"photon_share\" of 1.1 together", "must add up to 1 at most"],
    ),
    (
        "<emitter type=\"point\"><float name=\"photon_share\" value=\"1\"/></emitter>\n<emitter type=\"constant\"/>",
        1,
        1,
        &["leaves no photons for 1 other lights", "of 0"],
    ),
    (
        "<emitter type=\"point\"><float name=\"photon_part\" value=\"1\"/></emitter>",
        2,
        23,
        &["has no parameter \"photon_part\"", "photon_share"],
    ),
    (
        "<shape type=\"cube\"><float name=\"photon_target\" value=\"-1\"/></shape>",
        2,
        20,
        &["\"photon_target\" is -1", "between 0 (no photons are aimed at the shape) and 1e6"],
    ),
    (
        "<shape type=\"cube\"><string name=\"photon_target\" value=\"much\"/></shape>",
        2,
        20,
        &["\"photon_target\" is a string", "needs a number"],
    ),
    ("<emitter type=\"sunsky\"/>", 2, 1, &["the emitter plugin \"sunsky\" is not yet supported", "supported are"]),
    (
        "<shape type=\"cube\">\n <medium type=\"homogeneous\" name=\"interior\"/></shape>",
        3,
        2,
        &["<medium type=\"homogeneous\"> is not yet supported", "remove the element"],
    ),
    (
        "<integrator type=\"photonmaper\"/>",
        2,
        1,
        &["unknown integrator plugin \"photonmaper\"", "did you mean \"photonmapper\"?"],
    ),
    (
        "<integrator type=\"path\"><integer name=\"max_depth\" value=\"3.5\"/></integrator>",
        2,
        51,
        &["\"3.5\" is not an integer", "whole number"],
    ),
    (
        "<integrator type=\"photonmapper\"><string name=\"cache_metric\" value=\"hesian\"/></integrator>",
        2,
        33,
        &["unknown cache_metric \"hesian\"", "did you mean \"hessian\"?"],
    ),
    (
        "<integrator type=\"sppm\"><string name=\"photon_sampling\" value=\"visibilty\"/></integrator>",
        2,
        25,
        &["unknown photon_sampling \"visibilty\"", "did you mean \"visibility\"?"],
    ),
    (
        "<integrator type=\"vcm\"><string name=\"photon_sampling\" value=\"visibility\"/></integrator>",
        2,
        24,
        &["the integrator plugin \"vcm\" has no parameter \"photon_sampling\""],
    ),
    (
        "<integrator type=\"sppm\"><string name=\"photon_sampling\" value=\"visibility\"/>\n\
         <boolean name=\"chi_squared_radius\" value=\"true\"/></integrator>",
        3,
        1,
        &["\"chi_squared_radius\" with photon_sampling", "not independent"],
    ),
    ("<integrator type=\"path\"/>\n<integrator type=\"path\"/>", 3, 1, &["a second <integrator>", "only one"]),
    ("<include filename=\"loop.xml\"/>", 1, 33, &["loop.xml", "\"loop.xml\" includes itself", "remove one"]),
    ("<include filename=\"none.xml\"/>", 2, 10, &["file \"none.xml\" not found", "looked in"]),
    ("<shape type=\"$kind\"/>", 2, 8, &["the parameter \"$kind\" is not defined", "<default name=\"kind\""]),
    ("<scale x=\"2\"/>", 2, 1, &["<scale> outside of a <transform>", "write it inside of"]),
    ("some text", 2, 1, &["stray text \"some text\"", "comments"]),
    (
        "<shape type=\"instance\"><shape type=\"cube\"/></shape>",
        2,
        24,
        &["the instance holds a cube", "to a shapegroup"],
    ),
];

fn write_scene(dir: &Path, text: &str) -> PathBuf {
    let path = dir.join("scene.xml");
    fs::write(&path, text).expect("a temporary file");
    path
}

fn load(path: &Path) -> Result<Scene, SceneError> {
    Scene::load(path, &LoadOptions { accel: AccelKind::Bvh, ..LoadOptions::default() })
}

#[test]
fn mistakes_are_told_with_place_and_remedy() {
    let dir = folder();
    assert!(CASES.len() >= 30);
    let mut wrong = Vec::new();
    for (i, (body, line, col, parts)) in CASES.iter().enumerate() {
        let path = write_scene(dir.path(), &format!("<scene version=\"3.0.0\">\n{body}\n</scene>\n"));
        match load(&path) {
            Ok(_) => wrong.push(format!("{i}: no error: {body}")),
            Err(e) => {
                let text = e.to_string();
                let placed = (e.line, e.col) == (*line, *col)
                    && text.starts_with(&format!("{}:{line}:{col}: ", e.file.display()));
                if !placed || parts.iter().any(|p| !text.contains(p)) {
                    wrong.push(format!("{i}: {body}\n   at {line}:{col} expected {parts:?}\n   {text}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), CASES.len(), wrong.join("\n"));
}

/// The program gives the same message and exit code 2, and never panics.
#[test]
fn the_program_exits_with_2() {
    let dir = folder();
    for (body, ..) in CASES {
        let path = write_scene(dir.path(), &format!("<scene version=\"3.0.0\">\n{body}\n</scene>\n"));
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_caustica"))
            .args(["render", "--accel", "bvh", "-q", "-o"])
            .arg(dir.path().join("out.exr"))
            .arg(&path)
            .output()
            .expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        let message = load(&path).err().expect("an error").to_string();
        assert_eq!(output.status.code(), Some(2), "{body}: {said}");
        assert!(said.contains(&message) && !said.contains("panicked"), "{body}: {said}");
    }
    assert!(!dir.path().join("out.exr").exists());
}

#[test]
fn whole_files_can_be_wrong() {
    let dir = folder();
    for (text, part) in [
        ("", "not well-formed"),
        ("<scene>\n</scene>", "has no version"),
        ("<scene version=\"three\"/>", "\"three\" is not a version"),
        ("<shape version=\"3.0.0\" type=\"sphere\"/>", "the root element is <shape>"),
        ("<!DOCTYPE x [<!ENTITY a \"b\">]><scene version=\"3.0.0\"/>", "remove the <!DOCTYPE"),
        ("<scene version=\"3.0.0\"><shape type=\"sphere\"></scene>", "not well-formed"),
    ] {
        let e = load(&write_scene(dir.path(), text)).err().unwrap_or_else(|| panic!("no error: {text}")).to_string();
        assert!(e.contains(part) && e.contains("scene.xml:1:"), "{text}: {e}");
    }
    // Not text, not there, not a file.
    let path = dir.path().join("binary.xml");
    fs::write(&path, [0xff, 0xfe, 0x00]).expect("a temporary file");
    for (path, part) in [(path, "UTF-8"), (dir.path().join("none.xml"), "cannot read"), (dir.path().into(), "regular")]
    {
        let e = load(&path).err().expect("an error").to_string();
        assert!(e.contains(part), "{e}");
    }
}

#[test]
fn defines_are_checked() {
    let dir = folder();
    let path = write_scene(dir.path(), "<scene version=\"3.0.0\"><default name=\"spp\" value=\"4\"/></scene>");
    let with = |key: &str| {
        let defines = vec![(key.to_owned(), "8".to_owned())];
        Scene::load(&path, &LoadOptions { defines, accel: AccelKind::Bvh, ..LoadOptions::default() })
    };
    assert!(with("spp").is_ok());
    let e = with("ssp").err().expect("an error").to_string();
    assert!(e.contains("no parameter \"ssp\"") && e.contains("did you mean \"spp\"?"), "{e}");
}

#[test]
fn a_misspelt_scene_is_told_its_name() {
    let f = common::program::Folder::new("<scene version=\"3.0.0\"/>");
    f.fails("render scen.xml", 2, &["scen.xml", "cannot read the scene file", "did you mean \"scene.xml\"?"]);
    f.fails("info sub/scene.xml", 2, &["cannot read the scene file"]);
}
