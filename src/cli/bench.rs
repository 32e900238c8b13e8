//! `caustica bench`.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use serde::Serialize;

use super::args::{BenchAccel, BenchArgs};
use super::{CliError, bytes, human, print};
use crate::accel::{AccelKind, AccelOptions, embree_available};
use crate::bench::{Build, Class, Contender, Rate, collect, contender, measure};
use crate::render::{Control, Plan, PlanOverrides, Silent, render};
use crate::scene::{LoadOptions, Scene};

/// Rounds of a build, of which the median counts.
const BUILDS: usize = 3;

/// A whole render with one back end.
#[derive(Clone, Debug, Serialize)]
struct WholeRender {
    accel: &'static str,
    integrator: &'static str,
    spp: u64,
    /// Wall-clock seconds without loading and building.
    seconds: f64,
    rays: u64,
}

#[derive(Serialize)]
struct Report {
    scene: String,
    triangles: u64,
    threads: usize,
    builds: Vec<Build>,
    rates: Vec<Rate>,
    renders: Vec<WholeRender>,
}

pub fn run(a: &BenchArgs) -> Result<u8, CliError> {
    super::set_threads(a.threads)?;
    let classes = classes(&a.rays)?;
    let mut scene = load(a)?;
    let contenders = contenders(&scene, a.accel, a.tree.into())?;
    let mut report = Report {
        scene: a.scene.display().to_string(),
        triangles: scene.stats.triangles,
        threads: rayon::current_num_threads(),
        builds: contenders.iter().map(|c| c.build.clone()).collect(),
        rates: Vec::new(),
        renders: Vec::new(),
    };
    if !a.json {
        print(&format!("{}: {} triangles, {} threads", report.scene, human(report.triangles as f64), report.threads));
        for b in &report.builds {
            print(&format!("  {:28} built in {:.3} s, {}", b.description, b.seconds, bytes(b.memory)));
        }
    }
    for class in collect(&scene, &classes, a.count as usize, a.seed) {
        let rates = measure(&contenders, &class, a.rounds as usize);
        if !a.json {
            if rates.is_empty() {
                print(&format!("  {:8} none in this scene", class.class.name()));
            }
            rates.iter().for_each(print_rate);
        }
        report.rates.extend(rates);
    }
    if a.spp > 0 {
        for c in contenders {
            let whole = whole_render(&mut scene, c, a)?;
            if !a.json {
                let (rate, spp) = (human(whole.rays as f64 / whole.seconds), whole.spp);
                let name = format!("{} render, {spp} spp", whole.integrator);
                print(&format!("  {name:28} {:8} {:9.3} s, {rate} rays/s", whole.accel, whole.seconds));
            }
            report.renders.push(whole);
        }
    }
    if a.json {
        let text = serde_json::to_string_pretty(&report).map_err(|e| CliError::Failed(e.to_string()))?;
        print(&text);
    }
    Ok(0)
}

fn print_rate(r: &Rate) {
    let rate = format!("{} rays/s", human(r.rays_per_second));
    let hits = 100.0 * r.hits;
    print(&format!(
        "  {:8} {:8} {rate:>16}  ratio {:.3}, {hits:.1} % hit, {} differ",
        r.rays, r.accel, r.ratio, r.differ
    ));
}

fn classes(names: &[String]) -> Result<Vec<Class>, CliError> {
    let known = || Class::ALL.map(Class::name).join(", ");
    let one = |name: &String| {
        Class::ALL
            .into_iter()
            .find(|c| c.name() == name)
            .ok_or_else(|| CliError::Usage(format!("--rays: unknown class {name:?}; known are {}", known())))
    };
    if names.is_empty() { Ok(Class::ALL.to_vec()) } else { names.iter().map(one).collect() }
}

fn contenders(scene: &Scene, wanted: BenchAccel, options: AccelOptions) -> Result<Vec<Contender>, CliError> {
    let kinds: &[AccelKind] = match wanted {
        BenchAccel::All if embree_available() => &[AccelKind::Embree, AccelKind::Bvh],
        BenchAccel::All | BenchAccel::Bvh => &[AccelKind::Bvh],
        BenchAccel::Embree => &[AccelKind::Embree],
    };
    let build = |&kind| contender(scene, kind, options, BUILDS).map_err(|e| CliError::Usage(e.to_string()));
    kinds.iter().map(build).collect()
}

/// Loads a scene, or a mesh by itself under a white sky.
fn load(a: &BenchArgs) -> Result<Scene, CliError> {
    let options = LoadOptions { accel: AccelKind::Bvh, defines: a.defines.clone(), ..LoadOptions::default() };
    let Some(text) = super::scene_of_mesh(&a.scene, "")? else { return Ok(Scene::load(&a.scene, &options)?) };
    // Look at the mesh from outside; its place and size are known only once it is read.
    let beside = Path::new("mesh.xml");
    let plain = Scene::from_text(&text, beside, &options)?;
    let (center, radius) = plain.bounding_sphere();
    let at = plain.to_scene.to_world(center);
    let eye = at + glam::DVec3::new(1.1, -1.5, 0.9) * (radius as f64 / plain.to_scene.scale);
    drop(plain);
    let camera = format!(
        "<sensor type=\"perspective\"><float name=\"fov\" value=\"45\"/><transform name=\"to_world\">\
         <lookat origin=\"{} {} {}\" target=\"{} {} {}\" up=\"0 0 1\"/></transform></sensor>",
        eye.x, eye.y, eye.z, at.x, at.y, at.z
    );
    let text = super::scene_of_mesh(&a.scene, &camera)?.unwrap_or(text);
    Ok(Scene::from_text(&text, beside, &options)?)
}

fn whole_render(scene: &mut Scene, contender: Contender, a: &BenchArgs) -> Result<WholeRender, CliError> {
    scene.accel = contender.accel;
    let overrides = PlanOverrides { integrator: a.integrator.clone(), spp: Some(a.spp), ..PlanOverrides::default() };
    let plan = Plan::new(scene, &overrides)?;
    let started = Instant::now();
    let never = AtomicBool::new(false);
    let rendering = render(scene, &plan, &Control { stop: &never, time: None, started, progress: &Silent });
    let seconds = started.elapsed().as_secs_f64();
    let (integrator, rays) = (rendering.summary.integrator, rendering.summary.counters.rays());
    Ok(WholeRender { accel: contender.build.accel, integrator, spp: rendering.summary.spp, seconds, rays })
}
