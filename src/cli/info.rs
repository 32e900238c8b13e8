//! `caustica info`.

use serde::Serialize;

use super::args::InfoArgs;
use super::{CliError, MOST_AIMED, bytes, human, print};
use crate::integrator::vcm::TechniqueChoice;
use crate::render::{Forecast, Plan, PlanOverrides};
use crate::scene::{Item, Needs, PhotonShare, PhotonTarget};

#[derive(Serialize)]
struct Info {
    scene: String,
    scene_hash: String,
    accel: String,
    integrator: String,
    spp: u64,
    width: u32,
    height: u32,
    shapes: usize,
    instances: usize,
    triangles: u64,
    dropped_triangles: u64,
    lights: usize,
    materials: usize,
    textures: usize,
    geometry_memory: usize,
    accel_memory: usize,
    texture_memory: usize,
    /// What is declared and not used, and was not read.
    unused: u64,
    unplaced_groups: u64,
    /// Bytes of texture coordinates and vertex normals that nothing depends on.
    left_out_memory: u64,
    /// What the scene file says of photons.
    photon_shares: Vec<PhotonShare>,
    photon_targets: Vec<PhotonTarget>,
    /// What rendering it as planned will take.
    forecast: Option<Forecast>,
    /// What rendering it needs, and why.
    needs: Needs,
    /// Decisions that change nothing, because the integrator has no such part.
    idle_needs: Vec<Item>,
    /// Which techniques a pilot left in the recipe, where the scene file asks for one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    techniques: Vec<TechniqueChoice>,
    warnings: Vec<String>,
}

pub fn run(a: &InfoArgs) -> Result<u8, CliError> {
    super::set_threads(a.scene.threads)?;
    if a.predict {
        return super::predict::run(a);
    }
    let scene = super::load_scene(&a.scene)?;
    let overrides = PlanOverrides { needs: a.scene.needs.clone(), ..PlanOverrides::default() };
    // An integrator that is not known here does not keep the scene from being told about.
    let plan = Plan::new(&scene, &overrides).ok();
    let knows = |item: &Item| plan.as_ref().is_none_or(|p| p.method.knows(*item));
    let idle_needs = Item::ALL.into_iter().filter(|i| i.is_built() && !knows(i)).collect();
    let forecast = plan.as_ref().and_then(|p| Forecast::of(&scene, p));
    let techniques = plan.as_ref().map_or_else(Vec::new, |p| p.techniques.clone());
    let needs = plan.map_or_else(|| Needs::of(&scene, None, &overrides.needs), |p| p.needs);
    let info = Info {
        scene: a.scene.scene.display().to_string(),
        scene_hash: scene.hash.clone(),
        accel: scene.accel.description(),
        integrator: scene.integrator.name.clone(),
        spp: scene.sampler.spp,
        width: scene.film.width,
        height: scene.film.height,
        shapes: scene.geometry.shapes.len(),
        instances: scene.geometry.instances.len(),
        triangles: scene.stats.triangles,
        dropped_triangles: scene.stats.dropped_triangles,
        lights: scene.lights.len(),
        materials: scene.materials.len(),
        textures: scene.textures.len(),
        geometry_memory: scene.geometry.memory(),
        accel_memory: scene.accel.memory(),
        texture_memory: scene.textures.memory(),
        unused: scene.stats.unused,
        unplaced_groups: scene.stats.unplaced_groups,
        left_out_memory: scene.stats.left_out_bytes,
        photon_shares: scene.photon_aims.shares().to_vec(),
        photon_targets: scene.photon_aims.targets().to_vec(),
        forecast,
        needs,
        idle_needs,
        techniques,
        warnings: scene.warnings.iter().map(ToString::to_string).collect(),
    };
    if a.json {
        let text = serde_json::to_string_pretty(&info).map_err(|e| CliError::Failed(e.to_string()))?;
        print(&text);
        return Ok(0);
    }
    print(&format!("scene       {} (hash {})", info.scene, &info.scene_hash[..info.scene_hash.len().min(16)]));
    print(&format!("ray queries {}", info.accel));
    print(&format!("integrator  {}, {} samples per pixel", info.integrator, info.spp));
    print(&format!("film        {} x {}", info.width, info.height));
    print(&format!(
        "geometry    {} shapes, {} instances, {} triangles ({} without area dropped)",
        info.shapes,
        info.instances,
        human(info.triangles as f64),
        info.dropped_triangles
    ));
    print(&format!("content     {} lights, {} materials, {} textures", info.lights, info.materials, info.textures));
    print(&format!(
        "memory      {} geometry, {} ray queries, {} textures",
        bytes(info.geometry_memory),
        bytes(info.accel_memory),
        bytes(info.texture_memory)
    ));
    for s in info.photon_shares.iter().take(MOST_AIMED) {
        print(&format!("photons     share {} to the {}", s.share, s.label));
    }
    for t in info.photon_targets.iter().take(MOST_AIMED) {
        print(&format!("photons     importance {} to the {}", t.importance, t.label));
    }
    if info.unused + info.unplaced_groups + info.left_out_memory > 0 {
        print(&format!(
            "left out    {} materials and textures, {} groups, {} of mesh data without a use",
            info.unused,
            info.unplaced_groups,
            bytes(info.left_out_memory as usize)
        ));
    }
    if let Some(f) = &info.forecast {
        let time = f.seconds.map_or_else(|| "as long as asked for".to_owned(), |s| format!("about {s:.1} s"));
        print(&format!("render      {time}, {} photons", bytes(f.photon_memory)));
    }
    for n in info.needs.iter() {
        let decision = if n.wanted { "yes" } else { "no" };
        // A decision that changes nothing here says so.
        let idle = info.idle_needs.contains(&n.item).then(|| format!("; no part of {}", info.integrator));
        print(&format!("{:<13} {decision:<3}  {}{}", n.item, n.reason, idle.unwrap_or_default()));
    }
    for t in &info.techniques {
        print(&format!("{:<13} {:<3}  {}", t.technique.name(), if t.used { "yes" } else { "no" }, t.reason));
    }
    for w in &info.warnings {
        print(&format!("warning     {w}"));
    }
    Ok(0)
}
