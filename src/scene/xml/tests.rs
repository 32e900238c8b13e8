use std::path::Path;

use glam::DVec3;

use super::*;

fn parse(text: &str) -> Result<Document, super::super::SceneError> {
    parse_with(text, &[])
}

fn parse_with(text: &str, defines: &[(&str, &str)]) -> Result<Document, super::super::SceneError> {
    let defines = defines.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
    Document::parse(text, Path::new("t.xml"), &ParseOptions { defines })
}

fn scene(body: &str) -> String {
    format!("<scene version=\"3.0.0\">\n{body}\n</scene>")
}

/// The only object of a scene with one object.
fn only(doc: &Document) -> Query<'_> {
    Query::new(doc, doc.node(doc.root()).children[0].node)
}

#[test]
fn values_have_types_and_places() {
    let doc = parse(&scene(
        "  <shape type=\"sphere\" id=\"s\"><float name=\"radius\" value=\"2\"/><boolean name=\"flip_normals\" value=\"true\"/>
         <point name=\"center\" x=\"1\" y=\"2\" z=\"3\"/><string name=\"x\" value=\"a b\"/><integer name=\"n\" value=\"-3\"/></shape>",
    ))
    .expect("valid");
    let q = only(&doc);
    assert_eq!((q.node().pos.line, q.node().pos.col), (2, 3));
    assert_eq!(q.float("radius"), Ok(Some(2.0)));
    assert_eq!(q.bool("flip_normals", false), Ok(true));
    assert_eq!(q.vector("center"), Ok(Some(DVec3::new(1.0, 2.0, 3.0))));
    assert_eq!(q.string("x"), Ok(Some("a b")));
    assert!(q.int_in("n", 0..=5).is_err());
    assert!(q.finish().is_ok());
}

#[test]
fn unasked_parameter_is_an_error() {
    let doc = parse(&scene("<shape type=\"sphere\">\n <float name=\"radios\" value=\"2\"/></shape>")).expect("valid");
    let q = only(&doc);
    assert_eq!(q.float("radius"), Ok(None));
    let e = q.finish().expect_err("radios was not asked for");
    let expected = "t.xml:3:2: the shape plugin \"sphere\" has no parameter \"radios\"; did you mean \"radius\"?";
    assert_eq!(e.to_string(), expected);
}

#[test]
fn defines_win_over_defaults_and_reach_everywhere() {
    let text = scene(
        "<default name=\"r\" value=\"1\"/><default name=\"kind\" value=\"sphere\"/>
         <shape type=\"$kind\"><float name=\"$kind\" value=\"1$r.5\"/><string name=\"s\" value=\"${r}0 $rest\"/></shape>",
    );
    let doc = parse_with(&text, &[("r", "2")]).expect("valid");
    let q = only(&doc);
    assert_eq!(q.plugin(), "sphere");
    assert_eq!(q.float("sphere"), Ok(Some(12.5)));
    // "$rest" is "$r" followed by "est", as in Mitsuba.
    assert_eq!(q.string("s"), Ok(Some("20 2est")));

    let e = parse_with(&text, &[("kinds", "disk")]).expect_err("unused").to_string();
    assert!(e.contains("no parameter \"kinds\"") && e.contains("did you mean \"kind\"?"), "{e}");
    let e = parse(&scene("<shape type=\"$what\"/>")).expect_err("undefined").to_string();
    assert!(e.starts_with("t.xml:2:8: the parameter \"$what\" is not defined"), "{e}");
}

#[test]
fn exponential_substitution_is_refused() {
    let mut body = "<default name=\"a0\" value=\"0123456789\"/>".to_owned();
    for i in 1..40 {
        let p = i - 1;
        body += &format!("<default name=\"a{i}\" value=\"${{a{p}}}${{a{p}}}${{a{p}}}${{a{p}}}\"/>");
    }
    assert!(parse(&scene(&body)).expect_err("too long").to_string().contains("substituted text exceeds"));
}

#[test]
fn references_forward_aliased_and_shared() {
    let doc = parse(&scene(
        "<shape type=\"a\"><ref id=\"late\"/></shape><shape type=\"b\"><ref name=\"n\" id=\"other\"/></shape>
         <bsdf type=\"diffuse\" id=\"late\"/><alias id=\"late\" as=\"other\"/>",
    ))
    .expect("valid");
    let scene = doc.node(doc.root());
    let of = |i: usize| &doc.node(scene.children[i].node).children[0];
    assert_eq!(of(0).node, of(1).node);
    assert_eq!(of(1).name.as_deref(), Some("n"));
    assert_eq!(doc.node(of(0).node).plugin, "diffuse");
}

#[test]
fn cycles_and_depth_are_refused() {
    let e = parse(&scene("<bsdf type=\"twosided\" id=\"m\"><ref id=\"m\"/></bsdf>")).expect_err("cycle").to_string();
    assert!(e.contains("contain itself"), "{e}");
    let deep = "<bsdf type=\"twosided\">".repeat(5000) + &"</bsdf>".repeat(5000);
    assert!(parse(&scene(&deep)).expect_err("deep").to_string().contains("nested deeper"));
    let chain: String = (0..2000)
        .map(|i| format!("<bsdf type=\"twosided\" id=\"b{i}\"><ref id=\"b{}\"/></bsdf>", i + 1))
        .chain(["<bsdf type=\"diffuse\" id=\"b2000\"/>".into()])
        .collect();
    assert!(parse(&scene(&chain)).expect_err("long").to_string().contains("chain of references"));
}

#[test]
fn entity_bombs_are_refused() {
    let bomb = "<!DOCTYPE s [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;&a;\">]><scene version=\"3.0.0\">&b;</scene>";
    let e = parse(bomb).expect_err("doctype").to_string();
    assert!(e.contains("not well-formed") && e.contains("DOCTYPE"), "{e}");
}

#[test]
fn transforms_compose_in_order() {
    let doc = parse(&scene(
        "<shape type=\"s\"><transform name=\"to_world\"><scale value=\"2\"/><rotate z=\"1\" angle=\"90\"/>
         <translate x=\"1\" y=\"10\"/></transform></shape>",
    ))
    .expect("valid");
    let m = only(&doc).transform("to_world").expect("a transform");
    assert_eq!(m.transform_point3(DVec3::X), DVec3::new(1.0, 12.0, 0.0));
}

#[test]
fn old_files_are_upgraded() {
    let doc = parse(
        "<scene version=\"0.6.0\"><shape type=\"obj\"><transform name=\"toWorld\"><lookAt origin=\"0,0,0\" target=\"0,0,1\"
         up=\"0,1,0\"/></transform><bsdf type=\"diffuse\"><texture type=\"bitmap\" name=\"diffuseReflectance\">
         <float name=\"uscale\" value=\"3\"/><float name=\"voffset\" value=\"4\"/></texture></bsdf></shape></scene>",
    )
    .expect("valid");
    let q = only(&doc);
    assert!(q.node().legacy && q.has("to_world"));
    let bsdf = Query::new(&doc, q.child(Tag::Bsdf).expect("one").expect("one").node);
    let texture = Query::new(&doc, bsdf.named_child("reflectance").expect("renamed").node);
    let m = texture.transform("to_uv").expect("made of uscale and voffset");
    assert_eq!(m.transform_point3(DVec3::new(1.0, 1.0, 0.0)), DVec3::new(3.0, 5.0, 0.0));
}

#[test]
fn colours_depend_on_their_use() {
    let doc = parse(&scene(
        "<emitter type=\"area\"><spectrum name=\"a\" value=\"300:0.5 900:0.5\"/><rgb name=\"b\" value=\"2\"/>
         <spectrum type=\"blackbody\" name=\"c\"><float name=\"temperature\" value=\"6504\"/></spectrum>
         <blackbody name=\"d\" temperature=\"6504K\"/><rgb name=\"e\" value=\"#ff0000\"/></emitter>",
    ))
    .expect("valid");
    let q = only(&doc);
    let a = q.color("a", ColorUse::Reflectance).expect("valid").expect("there");
    assert!((a.r - 0.5).abs() < 1e-6 && (a.b - 0.5).abs() < 1e-6);
    let a = q.color("a", ColorUse::Emission).expect("valid").expect("there");
    assert!(a.r > a.b);
    assert!(q.color("b", ColorUse::Reflectance).is_err());
    assert!(q.color("b", ColorUse::Emission).is_ok());
    assert_eq!(q.color("c", ColorUse::Emission), q.color("d", ColorUse::Emission));
    assert_eq!(q.color("e", ColorUse::Reflectance), Ok(Some(crate::color::Rgb::new(1.0, 0.0, 0.0))));
}

#[test]
fn includes_paths_and_hash() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    std::fs::create_dir(dir.path().join("sub")).expect("can create");
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).expect("can write");
    write("main.xml", "<scene version=\"3.0.0\"><path value=\"sub\"/><include filename=\"part.xml\"/></scene>");
    write(
        "sub/part.xml",
        "<scene version=\"0.6.0\"><shape type=\"obj\"><float name=\"maxAngle\" value=\"1\"/></shape></scene>",
    );
    let read = || Document::read(&dir.path().join("main.xml"), &ParseOptions::default());
    let doc = read().expect("valid");
    assert!(only(&doc).has("max_angle"));
    let hash = doc.hash();
    write("sub/part.xml", "<shape version=\"3.0.0\" type=\"obj\"/>");
    let doc = read().expect("valid");
    assert_eq!(only(&doc).plugin(), "obj");
    assert_ne!(doc.hash(), hash);
    write("sub/part.xml", "<scene version=\"3.0.0\"><include filename=\"part.xml\"/></scene>");
    assert!(read().expect_err("cycle").to_string().contains("includes itself"));
    write("sub/part.xml", "<scene version=\"3.0.0\"><include filename=\"none.xml\"/></scene>");
    let e = read().expect_err("missing").to_string();
    assert!(e.contains("part.xml:1:33: file \"none.xml\" not found; looked in"), "{e}");
}
