//! The program as a user meets it: exit codes, messages, files.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SCENE: &str = r#"<scene version="3.0.0">
  <default name="spp" value="4"/>
  <integrator type="path"/>
  <sensor type="perspective">
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film>
    <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
  </sensor>
  <shape type="sphere"><point name="center" x="0" y="0" z="4"/></shape>
  <emitter type="constant"/>
</scene>"#;

fn caustica(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_caustica")).args(args).output().expect("the program starts")
}

fn stderr(o: &Output) -> String {
    String::from_utf8_lossy(&o.stderr).into_owned()
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new(scene: &str) -> Self {
        let dir = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(dir.path().join("scene.xml"), scene).expect("a temporary file");
        Self(dir)
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn text(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }
}

fn assert_fails(o: &Output, code: i32, parts: &[&str]) {
    let text = stderr(o);
    assert_eq!(o.status.code(), Some(code), "{text}");
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
    assert!(!text.contains("panicked"), "{text}");
}

#[test]
fn renders_every_format_and_says_how() {
    let f = Folder::new(SCENE);
    let outputs: Vec<String> = ["a.exr", "a.png", "a.hdr", "a.pfm"].iter().map(|n| f.text(n)).collect();
    let mut args = vec!["render".to_owned(), f.text("scene.xml"), "--json".into(), "--seed".into(), "7".into()];
    for o in &outputs {
        args.extend(["-o".into(), o.clone()]);
    }
    let o = caustica(&args.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(o.status.success(), "{}", stderr(&o));
    let report: serde_json::Value = serde_json::from_slice(&o.stdout).expect("one JSON object");
    assert_eq!(report["integrator"], "path");
    assert_eq!(report["seed"], 7);
    assert_eq!(report["spp"], 4);
    assert_eq!(report["counters"]["samples"], 24 * 16 * 4);
    for o in &outputs {
        let image = caustica::image::read(Path::new(o)).expect("a readable image");
        assert_eq!((image.width(), image.height()), (24, 16), "{o}");
    }
    let exr = caustica::image::read(f.path("a.exr")).expect("a readable image");
    let header = |key: &str| exr.metadata.get(&format!("caustica.{key}")).cloned().unwrap_or_default();
    assert_eq!(header("integrator"), "path");
    assert_eq!(header("seed"), "7");
    assert_eq!(header("scene_hash"), report["scene_hash"].as_str().expect("a hash"));
    assert!(!header("accel").is_empty() && !header("seconds").is_empty());
}

#[test]
fn compare_and_info() {
    let f = Folder::new(SCENE);
    for (seed, name) in [("1", "a.exr"), ("2", "b.exr")] {
        let o = caustica(&["render", &f.text("scene.xml"), "-q", "--seed", seed, "-o", &f.text(name)]);
        assert!(o.status.success() && o.stdout.is_empty() && o.stderr.is_empty(), "{}", stderr(&o));
    }
    let o = caustica(&["compare", &f.text("a.exr"), &f.text("b.exr"), "--json"]);
    assert!(o.status.success(), "{}", stderr(&o));
    let o = caustica(&["compare", &f.text("a.exr"), &f.text("a.exr")]);
    assert!(o.status.success() && String::from_utf8_lossy(&o.stdout).contains("rmse"));
    let o = caustica(&["render", &f.text("scene.xml"), "-q", "--width", "8", "--height", "8", "-o", &f.text("c.exr")]);
    assert!(o.status.success(), "{}", stderr(&o));
    assert_fails(&caustica(&["compare", &f.text("a.exr"), &f.text("c.exr")]), 2, &["24", "8"]);
    let o = caustica(&["info", &f.text("scene.xml"), "--json"]);
    let info: serde_json::Value = serde_json::from_slice(&o.stdout).expect("one JSON object");
    assert_eq!(info["shapes"], 1);
    assert_eq!(info["lights"], 1);
    // Ten decisions, each with its reason.
    let needs = info["needs"].as_array().expect("a list");
    assert_eq!(needs.len(), 10);
    assert!(needs.iter().all(|n| n["reason"].as_str().is_some_and(|r| r.len() > 10)), "{info}");
    assert!(info["forecast"]["seconds"].as_f64() > Some(0.0), "{info}");
    let o = caustica(&["info", &f.text("scene.xml"), "--need", "caustics=on", "--need", "light=off"]);
    let text = String::from_utf8_lossy(&o.stdout).into_owned();
    assert!(text.contains("caustics    yes  as asked for; otherwise: there is no indirect light"), "{text}");
    let o = caustica(&["info", &f.text("scene.xml"), "--need", "caustic=on"]);
    assert_eq!(o.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&o.stderr).contains("known are light, direct"));
}

#[test]
fn mistakes_are_told_with_their_remedy() {
    let f = Folder::new(SCENE);
    let scene = f.text("scene.xml");
    assert_fails(&caustica(&["render", "no-such.xml"]), 2, &["no-such.xml"]);
    assert_fails(&caustica(&["render", &scene, "--integrator", "pth"]), 2, &["pth", "did you mean \"path\""]);
    assert_fails(&caustica(&["render", &scene, "-o", "x.tga"]), 2, &["x.tga", ".exr"]);
    assert_fails(&caustica(&["render", &scene, "-o", "no/such/folder/x.exr"]), 2, &["no/such/folder"]);
    assert_fails(&caustica(&["render", &scene, "-D", "spp"]), 2, &["KEY=VALUE"]);
    assert_fails(&caustica(&["render", &scene, "-D", "spp=many"]), 2, &["many"]);
    assert_fails(&caustica(&["render", &scene, "--time", "soon"]), 2, &["soon", "30s"]);
    assert_fails(&caustica(&["render", &scene, "--threads", "0"]), 2, &["threads"]);
    assert_fails(&caustica(&["compare", &scene, &scene]), 2, &["scene.xml"]);
    assert_fails(&caustica(&["frobnicate"]), 2, &["frobnicate"]);
    #[cfg(not(feature = "embree"))]
    assert_fails(&caustica(&["render", &scene, "--accel", "embree"]), 2, &["libembree-dev"]);
}

#[test]
fn time_ends_a_render_after_a_pass() {
    let f = Folder::new(SCENE);
    let started = std::time::Instant::now();
    let o = caustica(&["render", &f.text("scene.xml"), "--time", "300ms", "--json", "-o", &f.text("t.exr")]);
    assert!(o.status.success(), "{}", stderr(&o));
    assert!(started.elapsed().as_secs_f64() < 20.0);
    let report: serde_json::Value = serde_json::from_slice(&o.stdout).expect("one JSON object");
    assert!(report["spp"].as_u64().expect("a count") > 4, "{report}");
}

#[cfg(unix)]
#[test]
fn an_interrupt_finishes_the_pass_and_writes() {
    let f = Folder::new(SCENE);
    let out = f.path("i.exr");
    let child = Command::new(env!("CARGO_BIN_EXE_caustica"))
        .args(["render", &f.text("scene.xml"), "-q", "--time", "60s", "-o"])
        .arg(&out)
        .spawn()
        .expect("the program starts");
    std::thread::sleep(std::time::Duration::from_millis(1500));
    // The shell's own kill: a small system has no other.
    let kill = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().expect("a shell");
    assert!(kill.success());
    let o = child.wait_with_output().expect("the program ends");
    assert_eq!(o.status.code(), Some(130));
    assert!(caustica::image::read(&out).is_ok());
}

#[test]
fn bench_measures_every_class_of_a_scene_and_of_a_mesh() {
    let f = Folder::new(SCENE);
    let mesh = f.text("mesh.ply");
    assert!(caustica(&["scene", "terrain", "--triangles", "500", "-o", &mesh]).status.success());
    // Rays that leave a lone sphere meet nothing, so that it has no gather rays.
    for (target, classes) in [(f.text("scene.xml"), 4), (mesh, 5)] {
        let few = ["--count", "2000", "--rounds", "1", "--spp", "1", "--json"];
        let o = caustica(&[&["bench", &target], &few[..]].concat());
        assert!(o.status.success(), "{}", stderr(&o));
        let report: serde_json::Value = serde_json::from_slice(&o.stdout).expect("one JSON object");
        let builds = report["builds"].as_array().expect("a list").len();
        let rates = report["rates"].as_array().expect("a list");
        assert_eq!((rates.len(), report["renders"].as_array().map(Vec::len)), (classes * builds, Some(builds)));
        for r in rates {
            assert!(r["rays_per_second"].as_f64() > Some(0.0) && r["hits"].as_f64() <= Some(1.0), "{r}");
            assert!(r["differ"].as_u64() <= Some(1), "{r}");
        }
    }
    assert_fails(&caustica(&["bench", &f.text("scene.xml"), "--rays", "x"]), 2, &["unknown class \"x\"", "photon"]);
    assert_fails(&caustica(&["bench", &f.text("none.ply")]), 2, &["none.ply", "no such file"]);
}

const CAUSTIC: &str = r#"<scene version="3.0.0">
  <integrator type="photonmapper"><integer name="global_photons" value="3000"/><integer name="caustic_photons" value="2000"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0 -4 2" target="0 0 0" up="0 0 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/></transform></shape>
  <shape type="sphere"><point name="center" x="0" y="0" z="1"/><float name="radius" value="0.5"/><bsdf type="dielectric"/></shape>
  <emitter type="point"><point name="position" x="1" y="0" z="3"/></emitter>
</scene>"#;

#[test]
fn a_stored_photon_map_renders_the_same_picture() {
    let f = Folder::new(CAUSTIC);
    let (scene, map) = (f.text("scene.xml"), f.text("map.cpm"));
    let o = caustica(&["map", "build", &scene, "-o", &map, "--seed", "3"]);
    assert!(o.status.success(), "{}", stderr(&o));
    let render =
        |out: &str, more: &[&str]| caustica(&[&["render", &scene, "--seed", "3", "-q", "-o", out], more].concat());
    let (fresh, stored) = (f.text("fresh.pfm"), f.text("stored.pfm"));
    assert!(render(&fresh, &[]).status.success());
    let o = render(&stored, &["--photon-map", &map]);
    assert!(o.status.success(), "{}", stderr(&o));
    assert_eq!(std::fs::read(&fresh).expect("written"), std::fs::read(&stored).expect("written"));
    // Tell and export what is in it.
    let o = caustica(&["map", "info", &map, "--json"]);
    let info: serde_json::Value = serde_json::from_slice(&o.stdout).expect("one JSON object");
    assert!(info["maps"]["global"].as_u64() > Some(1000) && info["maps"]["caustic"].as_u64() > Some(500), "{info}");
    let points = f.text("points.ply");
    assert!(caustica(&["map", "export", &map, "--name", "caustic", "-o", &points]).status.success());
    let head = std::fs::read(&points).expect("written");
    assert!(head.starts_with(b"ply\nformat binary_little_endian"));
    // Refuse what does not fit.
    assert_fails(&render(&fresh, &["--photon-map", &map, "--integrator", "path"]), 2, &["path reads no photon map"]);
    assert_fails(&render(&fresh, &["--photon-map", &scene]), 2, &["not a photon map file"]);
    assert_fails(&caustica(&["map", "export", &map, "--name", "x", "-o", &points]), 2, &["caustic, global"]);
    let mut bytes = std::fs::read(&map).expect("written");
    bytes.truncate(bytes.len() - 100);
    std::fs::write(f.path("short.cpm"), bytes).expect("written");
    assert_fails(&render(&fresh, &["--photon-map", &f.text("short.cpm")]), 2, &["truncated"]);
    std::fs::write(f.path("scene.xml"), CAUSTIC.replace("0.5", "0.6")).expect("written");
    assert_fails(&render(&fresh, &["--photon-map", &map]), 2, &["another scene"]);
}

#[test]
fn layers_are_written_into_and_beside_the_picture() {
    let f = Folder::new(CAUSTIC);
    let (scene, exr, png) = (f.text("scene.xml"), f.text("a.exr"), f.text("a.png"));
    let o = caustica(&["render", &scene, "-q", "-o", &exr, "-o", &png, "--aov", "direct,caustic,density"]);
    assert!(o.status.success() && o.stdout.is_empty() && o.stderr.is_empty(), "{}", stderr(&o));
    let image = caustica::image::read(&exr).expect("written");
    assert!(image.layer("caustic").is_some() && image.layer("direct").is_some() && image.layer("global").is_none());
    let density = image.channel("density.Y").expect("a channel").iter().copied().fold(0.0, f32::max);
    assert!(density > 10.0 && density.is_finite(), "{density}");
    for (layer, height) in [("direct", 16), ("caustic", 16), ("density", 16 * 11 + 19)] {
        let picture = caustica::image::read(f.path(&format!("a.{layer}.png"))).expect("written");
        assert_eq!(picture.height(), height, "{layer}");
    }
    assert_fails(&caustica(&["render", &scene, "--aov", "cache"]), 2, &["irradiance_cache"]);
    let args = ["render", &scene, "--aov", "caustic", "--integrator", "path"];
    assert_fails(&caustica(&args), 2, &["caustic", "path", "--integrator photonmapper"]);
    assert_fails(&caustica(&["render", &scene, "--aov", "caustics"]), 2, &["caustics", "density"]);
    let checkpoint = f.text("c.cpt");
    let args = ["render", &scene, "--aov", "caustic", "--checkpoint", &checkpoint];
    assert_fails(&caustica(&args), 2, &["checkpoints do not keep the layers"]);
}
