//! The program as a user meets it: exit codes, messages, files.

mod common;

use std::process::Command;

use common::program::Folder;

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

#[test]
fn renders_every_format_and_says_how() {
    let f = Folder::new(SCENE);
    let outputs = ["a.exr", "a.png", "a.hdr", "a.pfm"];
    let report = f.json("render scene.xml --json --seed 7 -o a.exr -o a.png -o a.hdr -o a.pfm");
    assert_eq!(report["integrator"], "path");
    assert_eq!(report["seed"], 7);
    assert_eq!(report["spp"], 4);
    assert_eq!(report["counters"]["samples"], 24 * 16 * 4);
    for o in outputs {
        let image = f.image(o);
        assert_eq!((image.width(), image.height()), (24, 16), "{o}");
    }
    let exr = f.image("a.exr");
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
        let o = f.run(&format!("render scene.xml -q --seed {seed} -o {name}"));
        assert!(o.status.success() && o.stdout.is_empty() && o.stderr.is_empty(), "{o:?}");
    }
    f.json("compare a.exr b.exr --json");
    assert!(f.succeeds("compare a.exr a.exr").contains("rmse"));
    f.succeeds("render scene.xml -q --width 8 --height 8 -o c.exr");
    f.fails("compare a.exr c.exr", 2, &["24", "8"]);
    let info = f.json("info scene.xml --json");
    assert_eq!(info["shapes"], 1);
    assert_eq!(info["lights"], 1);
    // Each decision with its reason, and those that change nothing for a path tracer.
    let needs = info["needs"].as_array().expect("a list");
    assert_eq!(needs.len(), 17);
    assert!(info["idle_needs"].as_array().is_some_and(|l| l.contains(&"caustics".into()) && !l.contains(&"uv".into())));
    assert!(needs.iter().all(|n| n["reason"].as_str().is_some_and(|r| r.len() > 10)), "{info}");
    assert!(info["forecast"]["seconds"].as_f64() > Some(0.0), "{info}");
    let text = f.succeeds("info scene.xml --need caustics=on --need light=off");
    let line = "caustics      yes  as asked for; otherwise: there is no indirect light; no part of path";
    assert!(text.contains(line), "{text}");
    f.fails("info scene.xml --need spectral=on", 2, &["spectral=on", "cannot make"]);
    f.fails("info scene.xml --need caustic=on", 2, &["known are light, direct"]);
}

#[test]
fn trees_of_every_quality_and_both_modes_give_the_same_picture() {
    let sphere = r#"<shape type="sphere"><point name="center" x="0" y="0" z="4"/></shape>"#;
    assert!(SCENE.contains(sphere));
    let mesh = r#"<shape type="ply"><string name="filename" value="t.ply"/>
        <transform name="to_world"><rotate x="1" angle="-60"/><translate z="4"/></transform></shape>"#;
    let f = Folder::new(&SCENE.replace(sphere, mesh));
    f.succeeds("scene terrain --triangles 5000 -o t.ply");
    f.succeeds("render scene.xml -q --accel bvh -o default.exr");
    let expected = f.image("default.exr");
    for quality in ["fast", "quality"] {
        for mode in ["robust", "fast"] {
            let options = format!("--accel bvh --accel-quality {quality} --accel-mode {mode}");
            f.succeeds(&format!("render scene.xml -q {options} -o a.exr"));
            let image = f.image("a.exr");
            let accel = image.metadata.get("caustica.accel").expect("named in the header");
            assert!(accel.contains("built") && accel.ends_with("fast mode") == (mode == "fast"), "{accel}");
            let differ = image.pixels().iter().zip(expected.pixels()).filter(|(a, b)| a != b).count();
            // Single precision moves hits by rounding, after which some paths go elsewhere.
            let far = |a: f32, b: f32| (a - b).abs() > 1e-3 * b.max(0.1);
            let moved = image.pixels().iter().zip(expected.pixels()).filter(|(a, b)| far(a.g, b.g)).count();
            assert!(if mode == "robust" { differ == 0 } else { moved < 8 }, "{options}: {differ}, {moved}");
        }
    }
    f.fails("render scene.xml --accel-quality best -o a.exr", 2, &["best", "quality"]);
}

#[test]
fn mistakes_are_told_with_their_remedy() {
    let f = Folder::new(SCENE);
    f.fails("render no-such.xml", 2, &["no-such.xml"]);
    f.fails("render scene.xml --integrator pth", 2, &["pth", "did you mean \"path\""]);
    f.fails("render scene.xml -o x.tga", 2, &["x.tga", ".exr"]);
    f.fails("render scene.xml -o no/such/folder/x.exr", 2, &["no/such/folder"]);
    f.fails("render scene.xml -D spp", 2, &["KEY=VALUE"]);
    f.fails("render scene.xml -D spp=many", 2, &["many"]);
    f.fails("render scene.xml --time soon", 2, &["soon", "30s"]);
    f.fails("render scene.xml --threads 0", 2, &["threads"]);
    f.fails("compare scene.xml scene.xml", 2, &["scene.xml"]);
    f.fails("frobnicate", 2, &["frobnicate"]);
    #[cfg(not(feature = "embree"))]
    f.fails("render scene.xml --accel embree", 2, &["libembree-dev"]);
}

#[test]
fn time_ends_a_render_after_a_pass() {
    let f = Folder::new(SCENE);
    let started = std::time::Instant::now();
    let report = f.json("render scene.xml --time 300ms --json -o t.exr");
    assert!(started.elapsed().as_secs_f64() < 20.0);
    assert!(report["spp"].as_u64().expect("a count") > 4, "{report}");
}

#[cfg(unix)]
#[test]
fn an_interrupt_finishes_the_pass_and_writes() {
    let f = Folder::new(SCENE);
    let child = f.command("render scene.xml -q --time 60s -o i.exr").spawn().expect("the program starts");
    std::thread::sleep(std::time::Duration::from_millis(1500));
    // The shell's own kill: a small system has no other.
    let kill = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().expect("a shell");
    assert!(kill.success());
    let o = child.wait_with_output().expect("the program ends");
    assert_eq!(o.status.code(), Some(130));
    assert!(caustica::image::read(f.path("i.exr")).is_ok());
}

#[test]
fn bench_measures_every_class_of_a_scene_and_of_a_mesh() {
    let f = Folder::new(SCENE);
    f.succeeds("scene terrain --triangles 500 -o mesh.ply");
    // Rays that leave a lone sphere meet nothing, so that it has no gather rays.
    for (target, classes) in [("scene.xml", 4), ("mesh.ply", 5)] {
        let report = f.json(&format!("bench {target} --count 2000 --rounds 1 --spp 1 --json"));
        let builds = report["builds"].as_array().expect("a list").len();
        let rates = report["rates"].as_array().expect("a list");
        assert_eq!((rates.len(), report["renders"].as_array().map(Vec::len)), (classes * builds, Some(builds)));
        for r in rates {
            assert!(r["rays_per_second"].as_f64() > Some(0.0) && r["hits"].as_f64() <= Some(1.0), "{r}");
            assert!(r["differ"].as_u64() <= Some(1), "{r}");
        }
    }
    f.fails("bench scene.xml --rays x", 2, &["unknown class \"x\"", "photon"]);
    f.fails("bench none.ply", 2, &["none.ply", "no such file"]);
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
    f.succeeds("map build scene.xml -o map.cpm --seed 3");
    let render = "render scene.xml --seed 3 -q";
    f.succeeds(&format!("{render} -o fresh.pfm"));
    f.succeeds(&format!("{render} -o stored.pfm --photon-map map.cpm"));
    assert_eq!(f.bytes("fresh.pfm"), f.bytes("stored.pfm"));
    // Tell and export what is in it.
    let info = f.json("map info map.cpm --json");
    assert!(info["maps"]["global"].as_u64() > Some(1000) && info["maps"]["caustic"].as_u64() > Some(500), "{info}");
    f.succeeds("map export map.cpm --name caustic -o points.ply");
    assert!(f.bytes("points.ply").starts_with(b"ply\nformat binary_little_endian"));
    // Refuse what does not fit.
    let render = format!("{render} -o fresh.pfm --photon-map");
    f.fails(&format!("{render} map.cpm --integrator path"), 2, &["path reads no photon map"]);
    f.fails(&format!("{render} scene.xml"), 2, &["not a photon map file"]);
    f.fails("map export map.cpm --name x -o points.ply", 2, &["caustic, global"]);
    let mut bytes = f.bytes("map.cpm");
    bytes.truncate(bytes.len() - 100);
    std::fs::write(f.path("short.cpm"), bytes).expect("a temporary file");
    f.fails(&format!("{render} short.cpm"), 2, &["truncated"]);
    std::fs::write(f.path("scene.xml"), CAUSTIC.replace("0.5", "0.6")).expect("a temporary file");
    f.fails(&format!("{render} map.cpm"), 2, &["another scene"]);
}

#[test]
fn layers_are_written_into_and_beside_the_picture() {
    let f = Folder::new(CAUSTIC);
    let o = f.run("render scene.xml -q -o a.exr -o a.png --aov direct,caustic,density");
    assert!(o.status.success() && o.stdout.is_empty() && o.stderr.is_empty(), "{o:?}");
    let image = f.image("a.exr");
    assert!(image.layer("caustic").is_some() && image.layer("direct").is_some() && image.layer("global").is_none());
    let density = image.channel("density.Y").expect("a channel").iter().copied().fold(0.0, f32::max);
    assert!(density > 10.0 && density.is_finite(), "{density}");
    for (layer, height) in [("direct", 16), ("caustic", 16), ("density", 16 * 11 + 19)] {
        let picture = f.image(&format!("a.{layer}.png"));
        assert_eq!(picture.height(), height, "{layer}");
    }
    f.fails("render scene.xml --aov cache", 2, &["irradiance_cache"]);
    f.fails("render scene.xml --aov caustic --integrator path", 2, &["caustic", "path", "--integrator photonmapper"]);
    f.fails("render scene.xml --aov caustics", 2, &["caustics", "density"]);
}
