//! `info --predict`: memory told before loading, against what loading finds.

mod common;

use common::program::Folder;
use serde_json::Value;

const SCENE: &str = r#"<scene version="3.0.0">
  <default name="mesh" value="mesh.ply"/>
  <default name="type" value="ply"/>
  <shape type="$type"><string name="filename" value="$mesh"/></shape>
  <emitter type="constant"/>
</scene>"#;

/// The prediction and what loading finds, both for the Rust BVH.
#[track_caller]
fn both(f: &Folder, scene: &str) -> (Value, Value) {
    let args = format!("info {scene} --json --accel bvh");
    (f.json(&format!("{args} --predict")), f.json(&args))
}

#[track_caller]
fn within(predicted: &Value, found: &Value, share: f64) {
    let (p, f) = (predicted.as_f64().expect("a number"), found.as_f64().expect("a number"));
    assert!((p / f - 1.0).abs() <= share, "predicted {p}, found {f}");
}

fn bvh(prediction: &Value) -> &Value {
    assert_eq!(prediction["accel"][1]["name"], "bvh");
    &prediction["accel"][1]["memory"]
}

#[test]
fn a_large_mesh_takes_what_was_predicted() {
    let f = Folder::new(SCENE);
    f.succeeds("scene terrain --triangles 300000 -o mesh.ply");
    let (p, found) = both(&f, "scene.xml");
    assert_eq!(p["triangles"], found["triangles"]);
    assert_eq!((&p["exact"], &p["too_large"], &p["accel_used"]), (&true.into(), &false.into(), &"bvh".into()));
    assert_eq!(p["geometry_memory"], found["geometry_memory"]);
    within(bvh(&p), &found["accel_memory"], 0.1);
    let embree = p["accel"][0]["memory"].as_f64().expect("a number");
    if caustica::accel::embree_available() {
        within(&embree.into(), &f.json("info scene.xml --json --accel embree")["accel_memory"], 0.1);
    }
    // The peak is above all that stays.
    let stays = p["geometry_memory"].as_f64().unwrap() + bvh(&p).as_f64().unwrap();
    assert!(p["accel"][1]["peak"].as_f64().unwrap() > 1.4 * stays);
    // The mesh by itself, and for people.
    assert_eq!(f.json("info mesh.ply --predict --json")["geometry_memory"], p["geometry_memory"]);
    let text = f.succeeds("info mesh.ply --predict");
    for part in ["mesh.ply", "exact", "Rust BVH", "Embree", "peak", "film"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn a_small_scene_with_a_group_and_pictures() {
    let f = Folder::new(
        r#"<scene version="3.0.0">
  <shape type="shapegroup" id="g"><shape type="ply"><string name="filename" value="mesh.ply"/></shape></shape>
  <shape type="instance"><ref id="g"/></shape>
  <shape type="instance"><transform name="to_world"><translate x="3"/></transform><ref id="g"/></shape>
  <shape type="obj"><string name="filename" value="grid.obj"/>
    <bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="t.pfm"/></texture></bsdf>
  </shape>
  <shape type="sphere"/>
  <emitter type="envmap"><string name="filename" value="t.hdr"/></emitter>
  <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="30"/><integer name="height" value="20"/></film></sensor>
</scene>"#,
    );
    f.succeeds("scene displaced-sphere --triangles 5000 -o mesh.ply");
    let mut obj = String::new();
    for i in 0..21 * 21 {
        let (x, y) = (i % 21, i / 21);
        obj += &format!("v {x} {y} {}\nvt {x} {y}\n", (x * y) % 3);
    }
    for i in (0..20 * 21).filter(|i| i % 21 < 20) {
        let corners = [i + 1, i + 2, i + 23, i + 22].map(|c| format!(" {c}/{c}"));
        obj += &format!("f{}\n", corners.concat());
    }
    std::fs::write(f.path("grid.obj"), obj).expect("a file");
    let pixels = (0..12).map(|i| caustica::color::Rgb::new(i as f32, 1.0, 0.5)).collect();
    let picture = caustica::image::Image::rgb(4, 3, pixels);
    for name in ["t.pfm", "t.hdr"] {
        caustica::image::write(f.path(name), &picture, &Default::default()).expect("a file");
    }
    let (p, found) = both(&f, "scene.xml");
    for key in ["triangles", "shapes", "instances", "width", "height"] {
        assert_eq!(p[key], found[key], "{key}");
    }
    assert_eq!(p["film_memory"], 30 * 20 * 32);
    within(&p["geometry_memory"], &found["geometry_memory"], 0.25);
    within(bvh(&p), &found["accel_memory"], 0.25);
    let pictures = p["pictures"].as_array().expect("a list");
    assert!(pictures.len() == 2 && pictures.iter().all(|p| p["width"] == 4 && p["height"] == 3), "{p}");
    assert_eq!(p["picture_memory"].as_u64().unwrap() - found["texture_memory"].as_u64().unwrap(), 4 * 3 * 16);
    // Lines tell how many triangles, but not how many vertices texture seams make.
    let obj = p["meshes"].as_array().unwrap().iter().find(|m| m["exact"] == false).expect("the OBJ file");
    assert_eq!((&obj["triangles"], &obj["vertices"]), (&800.into(), &441.into()));
}

/// A binary PLY of `faces` polygons with `corners` corners each over the vertices of a circle.
fn polygons(format: &str, faces: usize, corners: u8) -> Vec<u8> {
    let mut out = format!(
        "ply\nformat {format} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for i in 0..8 {
        let a = i as f32 * std::f32::consts::FRAC_PI_4;
        match format {
            "ascii" => out.extend(format!("{} {} 0\n", a.cos(), a.sin()).bytes()),
            _ => [a.cos(), a.sin(), 0.0].iter().for_each(|v| out.extend(v.to_le_bytes())),
        }
    }
    for _ in 0..faces {
        match format {
            "ascii" => {
                let indices: Vec<String> = (0..corners).map(|c| c.to_string()).collect();
                out.extend(format!("{corners} {}\n", indices.join(" ")).bytes());
            }
            _ => {
                out.push(corners);
                (0..i32::from(corners)).for_each(|c| out.extend(c.to_le_bytes()));
            }
        }
    }
    out
}

#[test]
fn the_length_of_a_file_tells_how_many_corners_faces_have() {
    let f = Folder::new(SCENE);
    std::fs::write(f.path("mesh.ply"), polygons("binary_little_endian", 50, 6)).expect("a file");
    let (p, found) = both(&f, "scene.xml");
    assert_eq!((&p["triangles"], &p["exact"]), (&found["triangles"], &true.into()));
    // Text does not.
    std::fs::write(f.path("mesh.ply"), polygons("ascii", 50, 6)).expect("a file");
    let (p, _) = both(&f, "scene.xml");
    assert_eq!((&p["triangles"], &p["exact"]), (&50.into(), &false.into()));
}

#[test]
fn a_file_without_its_body_is_predicted_with_a_warning() {
    let f = Folder::new(SCENE);
    f.succeeds("scene terrain --triangles 20000 -o mesh.ply");
    let whole = f.json("info scene.xml --predict --json");
    let bytes = f.bytes("mesh.ply");
    let header = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
    for length in [header, header + 100, bytes.len() - 1] {
        std::fs::write(f.path("mesh.ply"), &bytes[..length]).expect("a file");
        let short = f.json("info scene.xml --predict --json");
        for key in ["triangles", "geometry_memory"] {
            assert_eq!(short[key], whole[key], "{key}");
        }
        assert_eq!((&short["exact"], &short["meshes"][0]["cut_short"]), (&false.into(), &true.into()));
        f.fails("info scene.xml", 2, &["mesh.ply"]);
    }
    assert!(f.succeeds("info mesh.ply --predict").contains("shorter than its header"));
    // More than any machine has, in two hundred bytes.
    let text = String::from_utf8(bytes[..header].to_vec()).expect("a text");
    let count = format!("element face {}", whole["triangles"]);
    assert!(text.contains(&count), "{text}");
    std::fs::write(f.path("mesh.ply"), text.replace(&count, "element face 4294967295")).expect("a file");
    let huge = f.json("info scene.xml --predict --json");
    assert_eq!(huge["triangles"], u32::MAX);
    if huge["available_memory"].as_u64().is_some_and(|m| m < 300 << 30) {
        assert_eq!(huge["too_large"], true);
        assert!(f.succeeds("info mesh.ply --predict").contains("more memory than"));
    }
}

#[test]
fn malformed_headers_are_told_as_by_loading() {
    let f = Folder::new(SCENE);
    let good = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let ply = [
        "".to_owned(),
        "plx\n".into(),
        "ply\nformat ascii 1.0\n".into(),
        good.replace("ascii", "asci"),
        good.replace("vertex 3", "vertex three"),
        good.replace("vertex 3", "vertex 99999999999"),
        good.replace("float y", "float b"),
        good.replace("element face", "element fase"),
        good.replace("list uchar int", "list uchar float"),
        good.replace("property float x", "property list uchar float x"),
    ];
    // Enough bytes behind the header to let all but it be right.
    let cases = ply.into_iter().map(|t| ("ply", t.into_bytes()));
    let others =
        [("serialized", b"\x1c\x04".to_vec()), ("serialized", vec![0x1c, 4, 9, 0, 1, 2]), ("serialized", vec![1; 9])];
    for (kind, mut bytes) in cases.chain(others) {
        if bytes.ends_with(b"end_header\n") {
            bytes.extend(b"0 ".repeat(200));
        }
        std::fs::write(f.path("mesh"), &bytes).expect("a file");
        let args = format!("info scene.xml -D mesh=mesh -D type={kind}");
        let (loading, predicting) = (f.run(&args), f.run(&format!("{args} --predict")));
        let text = |o: &std::process::Output| String::from_utf8_lossy(&o.stderr).into_owned();
        let shown = String::from_utf8_lossy(&bytes);
        assert_eq!(predicting.status.code(), Some(2), "{shown}: {}", text(&predicting));
        let told = text(&predicting);
        assert!(told.contains("found") && told.contains("expected") && !told.contains("panicked"), "{told}");
        if !shown.contains("99999999999") {
            assert_eq!(text(&loading), told, "{shown}");
        }
    }
    f.fails("info missing.ply --predict", 2, &["missing.ply"]);
    f.fails("info scene.xml --predict", 2, &["mesh.ply"]);
}
