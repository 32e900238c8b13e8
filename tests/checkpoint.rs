//! Checkpoints as a user meets them: killed renders, pass ranges, merging, refusals.

mod common;

use std::time::{Duration, Instant};

use common::program::Folder;

const SCENE: &str = r#"<scene version="3.0.0">
  <default name="albedo" value="0.5"/>
  <integrator type="ppm"/>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/>
    <translate y="-1"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="$albedo"/></bsdf></shape>
  <shape type="sphere"><bsdf type="dielectric"/></shape>
  <emitter type="point"><point name="position" x="1" y="3" z="1"/></emitter>
</scene>"#;

const RENDER: &str = "render scene.xml -q --passes 60 --photons 2000 --threads 2";

/// Starts the program and waits for a new checkpoint, or for its end, then a little longer, so that a kill falls anywhere in a
/// pass or a write.
fn until_a_checkpoint(f: &Folder, args: &str, longer: Duration) -> std::process::Child {
    let written = || std::fs::metadata(f.path("c.ckpt")).and_then(|m| m.modified()).ok();
    let before = written();
    let mut child = f.command(args).spawn().expect("the program starts");
    let deadline = Instant::now() + Duration::from_secs(60);
    while written() == before && child.try_wait().expect("a child").is_none() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_micros(200));
    }
    std::thread::sleep(longer);
    child
}

/// Kills the render again and again, at once after a checkpoint has appeared or at any time later, until it comes
/// through: every checkpoint found is whole, and the picture has the bits of a run that nobody disturbed.
#[test]
fn kill_9_loses_nothing_but_the_passes_since_the_last_checkpoint() {
    let f = Folder::new(SCENE);
    f.succeeds(&format!("{RENDER} -o whole.pfm"));
    let mut kills = 0;
    let mut args = format!("{RENDER} -o broken.pfm --checkpoint c.ckpt --every 0s");
    let mut passes = 0;
    for attempt in 0..200u64 {
        let mut child = until_a_checkpoint(&f, &args, Duration::from_micros(attempt * 1733 % 20_000));
        if child.try_wait().expect("a child").is_some() {
            break;
        }
        child.kill().expect("a running child");
        let status = child.wait().expect("a child");
        kills += u32::from(status.code().is_none());
        let c = caustica::render::Checkpoint::read(&f.path("c.ckpt")).expect("a whole checkpoint after a kill");
        assert!(c.passes() >= passes, "passes went from {passes} back to {}", c.passes());
        passes = c.passes();
        args = format!("{RENDER} -o broken.pfm --checkpoint c.ckpt --every 0s --resume c.ckpt");
        if passes >= 50 {
            break;
        }
    }
    assert!(kills > 2, "{kills} kills");
    f.succeeds(&format!("{RENDER} -o broken.pfm --resume c.ckpt"));
    assert_eq!(f.bytes("whole.pfm"), f.bytes("broken.pfm"));
}

/// As above with layers of the photon maps beside the picture, every channel of the file alike.
#[test]
fn layers_survive_kill_9_and_merge() {
    let mapper = "<integrator type=\"photonmapper\"><boolean name=\"final_gather\" value=\"false\"/></integrator>";
    let f = Folder::new(&SCENE.replace("<integrator type=\"ppm\"/>", mapper));
    let render =
        "render scene.xml -q --float --passes 8 --spp 8 --photons 2000 --threads 2 --aov caustic,direct,density";
    f.succeeds(&format!("{render} -o whole.exr"));
    let mut args = format!("{render} -o broken.exr --checkpoint c.ckpt --every 0s");
    for attempt in 0..6u64 {
        let mut child = until_a_checkpoint(&f, &args, Duration::from_micros(attempt * 1733 % 7000));
        let _ = child.kill();
        child.wait().expect("a child");
        caustica::render::Checkpoint::read(&f.path("c.ckpt")).expect("a whole checkpoint after a kill");
        args = format!("{render} -o broken.exr --checkpoint c.ckpt --every 0s --resume c.ckpt");
    }
    f.succeeds(&args);
    let channels = |name: &str| {
        let image = f.image(name);
        let names: Vec<String> = image.channels().iter().map(|c| c.name.clone()).collect();
        names.into_iter().map(|n| (image.channel(&n).expect("a channel").to_vec(), n)).collect::<Vec<_>>()
    };
    assert_eq!(f.image("whole.exr").pixels(), f.image("broken.exr").pixels());
    assert_eq!(channels("whole.exr"), channels("broken.exr"));
    assert!(channels("whole.exr").iter().any(|(_, name)| name == "density.Y"), "no layers");
    // Parts merge, layers included, into pictures of either kind.
    for (range, name) in [("0..3", "a"), ("3..8", "b")] {
        f.succeeds(&format!("{render} --pass-range {range} -o part.exr --checkpoint {name}.ckpt"));
    }
    f.succeeds("merge b.ckpt a.ckpt --float -o merged.exr -o merged.png");
    for ((a, name), (b, other)) in channels("whole.exr").iter().zip(&channels("merged.exr")) {
        assert_eq!(name, other);
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * a.abs()), "{name}");
    }
    assert!(f.path("merged.density.png").exists());
    // Other layers do not go on and do not merge.
    f.fails(&format!("{} -o x.exr --resume a.ckpt", render.replace(",density", "")), 2, &["density", "--aov"]);
    f.succeeds(&format!("{} -o x.exr --pass-range 3..4 --checkpoint d.ckpt", render.replace(",density", "")));
    f.fails("merge a.ckpt d.ckpt -o x.exr", 2, &["caustic, direct, density"]);
}

#[test]
fn pass_ranges_merge_to_the_whole() {
    let f = Folder::new(SCENE);
    f.succeeds(&format!("{RENDER} -o whole.pfm"));
    for (range, name) in [("0..20", "a"), ("20..25", "b"), ("25..60", "c")] {
        f.succeeds(&format!("{RENDER} --pass-range {range} -o part.pfm --checkpoint {name}.ckpt"));
    }
    f.succeeds("merge c.ckpt a.ckpt b.ckpt -o merged.pfm -o merged.ckpt -o merged.exr");
    let (whole, merged) = (f.image("whole.pfm"), f.image("merged.pfm"));
    for (a, b) in whole.pixels().iter().zip(merged.pixels()) {
        for (a, b) in a.to_array().into_iter().zip(b.to_array()) {
            assert!((a - b).abs() <= 1e-6 * a.abs(), "{a} against {b}");
        }
    }
    assert_eq!(f.image("merged.exr").metadata["caustica.passes"], "60");
    // A gap is no reason not to look at what is there; what was merged goes on like any checkpoint.
    f.succeeds("merge a.ckpt c.ckpt -o gap.pfm");
    f.succeeds("merge a.ckpt b.ckpt -o ab.ckpt");
    f.succeeds(&format!("{RENDER} --resume ab.ckpt -o resumed.pfm"));
    for (a, b) in whole.pixels().iter().zip(f.image("resumed.pfm").pixels()) {
        assert!((a.g - b.g).abs() <= 1e-6 * a.g.abs());
    }
    // Refusals.
    f.fails("merge a.ckpt a.ckpt -o x.pfm", 2, &["overlap"]);
    f.succeeds(&format!("{RENDER} -D albedo=0.6 --pass-range 20..21 -o part.pfm --checkpoint other.ckpt"));
    f.fails("merge a.ckpt other.ckpt -o x.pfm", 2, &["another scene"]);
    f.succeeds(&format!("{RENDER} --seed 5 --pass-range 20..21 -o part.pfm --checkpoint seed.ckpt"));
    f.fails("merge a.ckpt seed.ckpt -o x.pfm", 2, &["another plan"]);
    f.fails(&format!("{RENDER} --resume b.ckpt -o x.pfm"), 2, &["20..25"]);
    f.fails(&format!("{RENDER} --resume other.ckpt -o x.pfm"), 2, &["another scene"]);
    f.fails(&format!("{RENDER} --resume seed.ckpt -o x.pfm"), 2, &["another plan"]);
    f.fails(&format!("{RENDER} --pass-range 50..70 -o x.pfm"), 2, &["--passes"]);
    f.fails(&format!("{RENDER} --resume none.ckpt -o x.pfm"), 2, &["none.ckpt"]);
    f.fails(&format!("{RENDER} --resume scene.xml -o x.pfm"), 2, &["not a checkpoint"]);
    let mut bytes = f.bytes("a.ckpt");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(f.path("a.ckpt"), bytes).expect("a temporary file");
    f.fails(&format!("{RENDER} --resume a.ckpt -o x.pfm"), 2, &["damaged"]);
}

/// Chains of photon paths begin anew in every pass, tuned by the first pass's view whichever passes a machine makes: a
/// resumed run has the bits of an unbroken one, and ranges of passes merge.
#[test]
fn chains_of_photon_paths_resume_and_merge() {
    let chains = "<integrator type=\"ppm\"><string name=\"photon_sampling\" value=\"visibility\"/></integrator>";
    let f = Folder::new(&SCENE.replace("<integrator type=\"ppm\"/>", chains));
    let render = "render scene.xml -q --passes 8 --photons 2000 --threads 2";
    f.succeeds(&format!("{render} -o whole.pfm"));
    for (range, name) in [("0..3", "a"), ("3..8", "b")] {
        f.succeeds(&format!("{render} --pass-range {range} -o part.pfm --checkpoint {name}.ckpt"));
    }
    f.succeeds(&format!("{render} --resume a.ckpt -o resumed.pfm"));
    assert_eq!(f.bytes("whole.pfm"), f.bytes("resumed.pfm"));
    f.succeeds("merge b.ckpt a.ckpt -o merged.pfm");
    for (a, b) in f.image("whole.pfm").pixels().iter().zip(f.image("merged.pfm").pixels()) {
        for (a, b) in a.to_array().into_iter().zip(b.to_array()) {
            assert!((a - b).abs() <= 1e-6 * a.abs(), "{a} against {b}");
        }
    }
    // Photons that are sampled in another way are another plan.
    std::fs::write(f.path("scene.xml"), SCENE).expect("a temporary file");
    f.fails(&format!("{render} --resume a.ckpt -o x.pfm"), 2, &["another scene"]);
}

#[test]
fn the_image_so_far_is_written_meanwhile() {
    let f = Folder::new(SCENE);
    let mut child = f
        .command("render scene.xml -q --passes 1000000 --photons 2000 --write-every 0s -o live.pfm")
        .spawn()
        .expect("the program starts");
    let deadline = Instant::now() + Duration::from_secs(60);
    while !f.path("live.pfm").exists() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(5));
    }
    // Whenever one looks, the file is whole.
    for _ in 0..20 {
        let image = f.image("live.pfm");
        assert_eq!((image.width(), image.height()), (24, 16));
        std::thread::sleep(Duration::from_millis(3));
    }
    child.kill().expect("a running child");
    child.wait().expect("a child");
}
