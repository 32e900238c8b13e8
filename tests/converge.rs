//! `converge`, `reference` and `compare` as a user meets them.

mod common;

use caustica::color::Rgb;
use caustica::image::Image;
use common::program::Folder;

/// A ball over a floor under a lamp, `size` pixels wide and high.
fn scene(size: u32, light: bool) -> String {
    let emitter = if light { r#"<emitter type="area"><rgb name="radiance" value="8"/></emitter>"# } else { "" };
    format!(
        r#"<scene version="3.0.0">
  <default name="albedo" value="0.5"/>
  <integrator type="photonmapper">
    <integer name="global_photons" value="2000"/><integer name="caustic_photons" value="0"/>
  </integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 1.2, 4" target="0, 0.4, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="{size}"/><integer name="height" value="{size}"/>
      <rfilter type="box"/></film>
    <sampler type="independent"><integer name="sample_count" value="8"/></sampler>
  </sensor>
  <shape type="rectangle">
    <transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="$albedo"/></bsdf>
  </shape>
  <shape type="sphere"><point name="center" x="0" y="0.5" z="0"/><float name="radius" value="0.5"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/><translate y="2"/></transform>{emitter}
  </shape>
</scene>"#
    )
}

/// A file of a report.
fn report(f: &Folder, name: &str) -> serde_json::Value {
    serde_json::from_str(&f.text(name)).expect("valid JSON")
}

/// The rows of a table without the columns of times.
fn rows(f: &Folder, name: &str) -> Vec<Vec<String>> {
    let text = f.text(name);
    let names: Vec<&str> = text.lines().next().expect("a header").split(',').collect();
    let keep = |k: &usize| !["seconds", "cpu_seconds"].contains(&names[*k]);
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), names.len(), "{line}");
        (0..cells.len()).filter(keep).map(|k| cells[k].to_owned()).collect()
    };
    text.lines().skip(1).map(row).collect()
}

#[test]
fn a_report_holds_everything_and_repeats_to_the_bit() {
    let f = Folder::new(&scene(32, true));
    let converge = "converge scene.xml --passes 6 --seeds 2 -q --integrators path,photonmapper";
    f.succeeds(&format!("{converge} --reference-time 1s -o a"));
    f.succeeds(&format!("{converge} --reference a/reference.exr -o b"));
    // Errors against passes do not depend on the clock; passes 1 to 6 for two methods and two seeds.
    let made = rows(&f, "a/convergence.csv");
    assert_eq!(made.len(), 24);
    assert_eq!(made, rows(&f, "b/convergence.csv"));
    // The page needs nothing from elsewhere.
    let page = f.text("a/report.html");
    for outside in ["src=\"http", "href=\"http", "<script", "<link rel=\"stylesheet", "@import", "url("] {
        assert!(!page.contains(outside), "the page has {outside}");
    }
    for part in
        ["<svg", "data:image/png;base64,", "At equal time", "At equal error", "Noise and bias", "Slopes", "viewport"]
    {
        assert!(page.contains(part), "the page lacks {part}");
    }
    let report = report(&f, "a/report.json");
    assert_eq!(report["finished"], true);
    assert_eq!(report["series"][1]["method"], "photonmapper");
    assert_eq!(report["series"][0]["runs"][1]["snapshots"].as_array().map(Vec::len), Some(6));
    assert!(report["series"][0]["outcome"]["split"]["variance"].as_f64().is_some_and(|v| v > 0.0));
    assert!(report["reference"]["relmse"].as_f64().is_some_and(|v| v > 0.0));
    assert!(f.path("a/error-time.svg").is_file() && f.path("a/error-rays.svg").is_file());
}

#[test]
fn odd_scenes_and_references_are_explained() {
    let f = Folder::new(&scene(1, true));
    let converge = "converge scene.xml --passes 2 --seeds 2 -q --integrators path";
    f.succeeds(&format!("{converge} --reference-time 100ms -o one"));
    assert!(f.text("one/report.html").contains("one pixel"));
    // A reference of another size, of another scene, of no kind.
    let with = format!("{converge} --reference one/reference.exr");
    f.fails(&format!("{with} --width 8 --height 8"), 2, &["1 x 1", "8 x 8"]);
    f.fails(&format!("{with} -D albedo=0.9"), 2, &["another scene", "--trust-reference"]);
    f.succeeds(&format!("{with} -D albedo=0.9 --trust-reference"));
    f.fails(&format!("{converge} --reference none.exr"), 2, &["none.exr"]);
    f.fails("converge scene.xml --integrators pth", 2, &["pth", "did you mean"]);
    let dark = Folder::new(&scene(4, false));
    dark.fails("converge scene.xml --passes 2", 2, &["no light"]);
}

/// Killed after a second of many: the report of the runs before is whole.
#[test]
fn a_killed_run_leaves_a_report() {
    let f = Folder::new(&scene(8, true));
    f.succeeds("reference scene.xml -o r.exr --passes 64 --methods path -q");
    let mut child = f
        .command("converge scene.xml --reference r.exr --time 100ms --seeds 1000 -q -o k --integrators path")
        .spawn()
        .expect("the program starts");
    let started = std::time::Instant::now();
    while !f.path("k/report.html").is_file() && started.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    child.kill().and_then(|()| child.wait()).expect("the program can be killed");
    let report = report(&f, "k/report.json");
    assert_eq!(report["finished"], false);
    assert!(report["series"][0]["runs"].as_array().is_some_and(|r| !r.is_empty()));
    assert!(f.text("k/report.html").contains("Not finished"));
    assert!(!rows(&f, "k/convergence.csv").is_empty());
}

#[test]
fn references_know_their_noise_and_refuse_to_disagree() {
    let f = Folder::new(&scene(64, true));
    let reference = "reference scene.xml --passes 16 -q";
    f.succeeds(&format!("{reference} -o r.exr --methods path,bdpt"));
    let r = f.image("r.exr");
    let note = |key: &str| r.metadata.get(&format!("caustica.reference.{key}")).expect("a note").clone();
    assert_eq!((note("methods"), note("passes")), ("path,bdpt".to_owned(), "16,16".to_owned()));
    // The difference of the halves tells the same noise as the passes do: over 14 seeds 0.95 ± 0.05 of it, so that the bound is
    // four standard deviations away (of 32 x 32 pixels it was two).
    let variance = r.layer("variance").expect("a layer");
    let mean = variance.iter().map(|v| f64::from(v.r + v.g + v.b) / 3.0).sum::<f64>() / variance.len() as f64;
    let halves: f64 = note("mse").parse().expect("a number");
    assert!((halves / mean).ln().abs() < 1.3f64.ln(), "{halves} from halves, {mean} from passes");
    // Direct light alone is another picture.
    f.fails(&format!("{reference} -o w.exr --methods path,direct"), 1, &["do not agree", "standard errors"]);
    assert!(!f.path("w.exr").exists());
    f.fails("reference scene.xml -o w.png", 2, &[".exr"]);
    // compare uses the layers: another render agrees, a brighter one does not.
    let render = "render scene.xml -q --integrator path --float --spp 64 --aov variance";
    f.succeeds(&format!("{render} -o x.exr"));
    f.succeeds(&format!("{render} -o y.exr -D albedo=0.55"));
    let test = |image: &str| {
        f.json(&format!("compare {image} r.exr --json --heatmap h.png"))["same_light"]["rejected"].clone()
    };
    assert_eq!((test("x.exr"), test("y.exr")), (false.into(), true.into()));
    assert!(f.image("h.png").width() >= 256);
    assert!(f.succeeds("compare x.exr r.exr").contains("flip"));
}

/// A reference that is known rather than rendered.
fn write_truth(f: &Folder, size: u32, truth: impl Fn(u32, u32) -> f64) {
    let image = Image::from_fn(size, size, |x, y| Rgb::splat(truth(x, y) as f32));
    caustica::image::write(f.path("truth.exr"), &image, &Default::default()).expect("the folder can be written to");
}

/// The slope against passes that the program finds with `seeds` seeds, and half its 95 % interval.
fn slope(xml: &str, size: u32, truth: impl Fn(u32, u32) -> f64, args: &str) -> (f64, f64) {
    let f = Folder::new(xml);
    write_truth(&f, size, truth);
    f.succeeds(&format!("converge scene.xml --reference truth.exr --passes 512 -q -o out {args}"));
    let slope = report(&f, "out/report.json")["series"][0]["outcome"]["slope"].clone();
    let number = |key: &str| slope[key].as_f64().expect("a slope");
    println!("{args}: {slope}");
    (number("mean"), number("half_width"))
}

/// The radiance in a sphere of albedo ½ that emits ½ is 1; samples are independent, so that the error is 1/N on average.
#[test]
fn the_slope_of_path_tracing_is_minus_one() {
    let wall = r#"<emitter type="area"><rgb name="radiance" value="0.5"/></emitter>"#;
    let xml = common::closed_sphere("", "independent", 0.5, wall, "");
    let (mean, half_width) = slope(&xml, 16, |_, _| 1.0, "--integrators path --seeds 16");
    assert!((mean + 1.0).abs() < half_width && half_width < 0.05, "{mean} ± {half_width}");
}

/// −2/3 for α = 2/3 and, where blur dominates, −0.6 for 0.7, over the last decade of 512 passes.
#[cfg(feature = "slow-tests")]
#[test]
fn the_slopes_of_progressive_photon_mapping_are_those_of_its_theory() {
    for (alpha, radius, photons, seeds) in [(2.0 / 3.0, 0.25, 2000, 16), (0.7, 0.6, 10_000, 6)] {
        let settings = format!(
            r#"<float name="initial_radius" value="{radius}"/><float name="alpha" value="{alpha}"/>
            <integer name="photon_count" value="{photons}"/>"#
        );
        let xml = common::floor_under_a_pane(&settings);
        let (mean, half_width) = slope(&xml, 12, common::floor_truth, &format!("--integrators sppm --seeds {seeds}"));
        let expected = -f64::min(alpha, 2.0 * (1.0 - alpha));
        assert!((mean - expected).abs() < half_width && half_width < 0.07, "α = {alpha}: {mean} ± {half_width}");
    }
}

/// Snapshots of 128 × 128 pixels must not lengthen the method's own time by 1 %.
#[cfg(feature = "slow-tests")]
#[test]
fn snapshots_hardly_slow_down_what_they_measure() {
    let f = Folder::new(&scene(128, true));
    write_truth(&f, 128, |_, _| 1.0);
    f.succeeds("converge scene.xml --reference truth.exr --passes 1500 --seeds 2 -q -o out --integrators path");
    let added = report(&f, "out/report.json")["series"][0]["outcome"]["overhead"]["added"].clone();
    let number = |key: &str| added[key].as_f64().expect("enough passes");
    println!("{added}");
    assert!(number("mean") + number("half_width") < 0.01, "{added}");
}
