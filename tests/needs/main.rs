//! What is left out is not missed: renders as planned and renders with everything made agree, and what is left out takes
//! no memory.

mod scenes;

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use caustica::accel::AccelKind;
use caustica::image::Image;
use caustica::render::{Control, Plan, PlanOverrides, Rendering, Silent, render};
use caustica::scene::{Item, LoadOptions, NeedOverride, Scene};
use scenes::{Case, deceiving, everything, lacking, write_images};

/// The system's allocator, counting what is held and the most that was held.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is handed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        MOST.fetch_max(held, Ordering::Relaxed);
        // SAFETY: as for this function.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as for this function.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test at a time, so that none counts another's bytes.
static ALONE: Mutex<()> = Mutex::new(());

fn try_load(dir: &Path, xml: &str, needs: &[NeedOverride]) -> Result<Scene, String> {
    let options = LoadOptions { accel: AccelKind::Bvh, needs: needs.to_vec(), ..LoadOptions::default() };
    Scene::from_text(xml, &dir.join("scene.xml"), &options).map_err(|e| e.to_string())
}

fn load(dir: &Path, xml: &str, needs: &[NeedOverride]) -> Scene {
    match try_load(dir, xml, needs) {
        Ok(scene) => scene,
        Err(e) => panic!("{e}\n{xml}"),
    }
}

fn run(scene: &Scene, needs: &[NeedOverride], seed: u64) -> Rendering {
    let overrides = PlanOverrides {
        spp: Some(4),
        photons: Some(3000),
        seed: Some(seed),
        needs: needs.to_vec(),
        ..PlanOverrides::default()
    };
    let plan = Plan::new(scene, &overrides).expect("a known integrator");
    let stop = AtomicBool::new(false);
    render(scene, &plan, &Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent })
}

/// Means of the four quarters and the whole.
fn means(image: &Image) -> [f64; 5] {
    let (w, h) = (image.width() as usize, image.height() as usize);
    let mut sums = [0.0; 5];
    for (i, p) in image.pixels().iter().enumerate() {
        let quarter = usize::from(i % w >= w / 2) + 2 * usize::from(i / w >= h / 2);
        for k in [quarter, 4] {
            sums[k] += f64::from(p.mean()) / (w * h) as f64;
        }
    }
    sums
}

/// Mean and squared standard error.
fn estimate(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0) / n)
}

/// 25 scenes of 5 means, Student's t with about 14 degrees of freedom: P(|t| > 6) = 3·10⁻⁵, 0.4 % for all.
const MOST_Z: f64 = 6.0;

fn assert_agrees(dir: &Path, case: &Case) {
    let xml = case.xml(16);
    let planned = load(dir, &xml, &[]);
    let forced = load(dir, &xml, &everything());
    let pictures = |scene: &Scene, needs: &[NeedOverride], first: u64| -> Vec<[f64; 5]> {
        (0..8).map(|i| means(&run(scene, needs, first + i).image)).collect()
    };
    let (a, b) = (pictures(&planned, &[], 1), pictures(&forced, &everything(), 101));
    for k in 0..5 {
        let column = |p: &[[f64; 5]]| estimate(&p.iter().map(|m| m[k]).collect::<Vec<_>>());
        let ((ma, va), (mb, vb)) = (column(&a), column(&b));
        let z = (ma - mb).abs() / (va + vb).sqrt().max(1e-5 * mb.abs()).max(1e-12);
        assert!(z < MOST_Z, "{}: part {k} is {ma} as planned and {mb} with everything, z = {z:.1}", case.name);
    }
}

#[test]
fn what_a_scene_lacks_is_left_out_and_not_missed() {
    let _alone = ALONE.lock();
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_images(dir.path());
    assert_eq!(lacking().len(), 12);
    for case in lacking() {
        let scene = load(dir.path(), &case.xml(16), &[]);
        let plan = Plan::new(&scene, &PlanOverrides::default()).expect("a known integrator");
        assert_eq!(plan.needs.wants(case.item), case.needed, "{}: {:?}", case.name, plan.needs);
        assert_agrees(dir.path(), &case);
    }
}

#[test]
fn what_a_scene_seems_to_lack_is_made() {
    let _alone = ALONE.lock();
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_images(dir.path());
    assert!(deceiving().len() >= 10);
    for case in deceiving() {
        let scene = load(dir.path(), &case.xml(16), &[]);
        let plan = Plan::new(&scene, &PlanOverrides::default()).expect("a known integrator");
        assert_eq!(plan.needs.wants(case.item), case.needed, "{}: {:?}", case.name, plan.needs);
        assert_agrees(dir.path(), &case);
        // There is light in the picture to be missed.
        assert!(means(&run(&scene, &[], 1).image)[4] > 1e-4, "{} is black", case.name);
    }
}

/// Bytes held more after loading, and the most held while loading and rendering.
fn cost(dir: &Path, xml: &str, needs: &[NeedOverride]) -> (isize, isize) {
    let held = || HELD.load(Ordering::Relaxed) as isize;
    let before = held();
    MOST.store(before as usize, Ordering::Relaxed);
    let scene = load(dir, xml, needs);
    let loaded = held() - before;
    let rendering = run(&scene, needs, 1);
    drop(rendering);
    (loaded, MOST.load(Ordering::Relaxed) as isize - before)
}

#[test]
fn what_is_left_out_takes_no_memory() {
    let _alone = ALONE.lock();
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_images(dir.path());
    let warm = lacking().into_iter().find(|c| c.name == "direct light only").expect("the scene is there");
    cost(dir.path(), &warm.xml(16), &[]);
    // Unused textures and dark skies: with and without them in the file.
    for name in ["a texture not used", "a group not placed"] {
        let case = lacking().into_iter().find(|c| c.name == name).expect("the scene is there");
        let xml = case.xml(16);
        let bare = match xml.find("<bsdf type=\"diffuse\" id=\"unused\">").or(xml.find("<shape type=\"shapegroup\"")) {
            Some(start) if name == "a texture not used" => {
                let end = start + xml[start..].find("</bsdf>").expect("its end") + "</bsdf>".len();
                format!("{}{}", &xml[..start], &xml[end..])
            }
            Some(start) => {
                let end = xml.find("</emitter>").expect("the sky's end") + "</emitter>".len();
                format!("{}{}", &xml[..start], &xml[end..])
            }
            None => panic!("{name} has changed"),
        };
        let (with, without) = (cost(dir.path(), &xml, &[]), cost(dir.path(), &bare, &[]));
        // The harness itself may take or free a little; the texture has 4 MiB.
        assert!(
            with.0 < without.0 + (64 << 10) && with.1 < without.1 + (256 << 10),
            "{name}: {with:?}, without {without:?}"
        );
    }
    // Maps that are not made: no photon is held.
    for case in lacking() {
        let scene = load(dir.path(), &case.xml(16), &[]);
        let summary = run(&scene, &[], 1).summary;
        let plan = Plan::new(&scene, &PlanOverrides::default()).expect("a known integrator");
        let made = |name: &str| summary.maps.iter().any(|m| m.name == name);
        assert!(plan.needs.wants(Item::Caustics) || !made("caustic"), "{}", case.name);
        assert!(plan.needs.wants(Item::Global) || (!made("global") && !made("indirect")), "{}", case.name);
        if !plan.needs.wants(Item::Caustics) && !plan.needs.wants(Item::Global) {
            assert_eq!((summary.photon_memory, summary.counters.photon_rays), (0, 0), "{}", case.name);
        }
    }
    // Texture coordinates and normals of meshes.
    let room = lacking().into_iter().find(|c| c.name == "a room of flat walls").expect("the scene is there");
    let (planned, forced) = (load(dir.path(), &room.xml(16), &[]), load(dir.path(), &room.xml(16), &everything()));
    let saved = forced.geometry.memory() - planned.geometry.memory();
    // The cube's 24 corners with normals, and its and the lamp's four with uv.
    assert_eq!(saved, 24 * 12 + 28 * 8);
    assert_eq!(planned.stats.left_out_bytes as usize, saved);
    // Two bytes a photon where no estimate reads directions.
    let kept = run(&planned, &[(Item::Directions, true)], 1).summary;
    let stored: u64 = kept.maps.iter().map(|m| m.stored).sum();
    assert!(stored > 1000, "{stored} photons");
    assert_eq!(kept.photon_memory - run(&planned, &[], 1).summary.photon_memory, 2 * stored as usize);
}

/// Files that cannot be read are named where they are used, and not noticed where nothing depends on them.
#[test]
fn what_is_not_used_is_not_read() {
    let _alone = ALONE.lock();
    let dir = tempfile::tempdir().expect("a temporary folder");
    for name in ["broken.exr", "broken.ply"] {
        std::fs::write(dir.path().join(name), "nothing of use").expect("a temporary file");
    }
    let broken = r#"<string name="filename" value="broken.exr"/>"#;
    let bsdf =
        format!(r#"<bsdf type="diffuse" id="x"><texture type="bitmap" name="reflectance">{broken}</texture></bsdf>"#);
    let texture = format!(r#"<texture type="bitmap" id="x">{broken}</texture>"#);
    let group = r#"<shape type="shapegroup" id="x"><shape type="ply"><string name="filename" value="broken.ply"/></shape></shape>"#;
    let sky = format!(r#"<emitter type="envmap">{broken}<float name="scale" value="SCALE"/></emitter>"#);
    let slide = format!(r#"<texture type="bitmap" name="SLIDE">{broken}</texture>"#);
    let spot = format!(
        r#"<emitter type="spot"><rgb name="intensity" value="SCALE"/>{}</emitter>"#,
        slide.replace("SLIDE", "texture")
    );
    let projector = format!(
        r#"<emitter type="projector"><float name="scale" value="SCALE"/>{}</emitter>"#,
        slide.replace("SLIDE", "irradiance")
    );
    let dark = |emitter: &str| (emitter.replace("SCALE", "0"), emitter.replace("SCALE", "1"));
    let used = |unused: &str, user: &str| (unused.to_owned(), format!("{unused}{user}"));
    let cases = [
        used(&bsdf, r#"<shape type="sphere"><ref id="x"/></shape>"#),
        used(&texture, r#"<shape type="sphere"><bsdf type="diffuse"><ref name="reflectance" id="x"/></bsdf></shape>"#),
        used(group, r#"<shape type="instance"><ref id="x"/></shape>"#),
        dark(&sky),
        dark(&spot),
        dark(&projector),
    ];
    let scene = |body: &str| format!(r#"<scene version="3.0.0"><shape type="rectangle"/>{body}</scene>"#);
    for (without, with) in cases {
        let loaded = load(dir.path(), &scene(&without), &[]);
        assert_eq!((loaded.lights.len(), loaded.textures.len(), loaded.geometry.shapes.len()), (0, 0, 1), "{without}");
        let error = try_load(dir.path(), &scene(&with), &[]).err();
        assert!(error.as_ref().is_some_and(|e| e.contains("broken")), "{error:?} of {with}");
    }
    // What the camera does not see may still be seen by light: it stays.
    let behind = r#"<shape type="sphere"><point name="center" x="0" y="0" z="-500"/></shape>"#;
    assert_eq!(load(dir.path(), &scene(behind), &[]).geometry.shapes.len(), 2);
}

/// No line of the plan is idle: deciding otherwise changes the recipe, the geometry or the maps.
#[test]
fn every_decision_changes_something() {
    let _alone = ALONE.lock();
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_images(dir.path());
    let all = deceiving();
    let case = all.iter().find(|c| c.name == "a chequered mirror").expect("the scene is there");
    let normals = r#"<shape type="obj"><string name="filename" value="bent.obj"/>
        <bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf></shape></scene>"#;
    let bent = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0.1 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1/1 2/2/2 3/3/1\n";
    std::fs::write(dir.path().join("bent.obj"), bent).expect("a temporary file");
    let xml = case.xml(16).replace("</scene>", normals);
    let state = |needs: &[NeedOverride], name: &str| {
        let scene = load(dir.path(), &xml, needs);
        let overrides = PlanOverrides {
            integrator: Some(name.to_owned()),
            needs: needs.to_vec(),
            photons: Some(1000),
            ..PlanOverrides::default()
        };
        let plan = Plan::new(&scene, &overrides).expect("a known integrator");
        let maps = if name == "photonmapper" { run(&scene, needs, 1).summary.photon_memory } else { 0 };
        (format!("{:?}", plan.method), scene.geometry.memory(), maps, plan)
    };
    for name in ["photonmapper", "sppm", "path", "direct", "vcm"] {
        let (method, geometry, maps, plan) = state(&[], name);
        for item in Item::ALL.into_iter().filter(|i| i.is_built() && plan.method.knows(*i)) {
            if name == "sppm" && item == Item::Directions {
                continue; // Seen in the maps alone, which photonmapper shares.
            }
            let other = state(&[(item, !plan.needs.wants(item))], name);
            assert!(
                (method.clone(), geometry, maps) != (other.0, other.1, other.2),
                "{item} changes nothing of {name}"
            );
        }
        // What cannot be made is not, whatever is asked for.
        let motion = state(&[(Item::Motion, true)], name).3.needs;
        assert!(!motion.wants(Item::Motion) && motion.iter().all(|n| !n.forced));
    }
}
