//! `caustica map build`, `map info` and `map export`.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use super::args::{MapArgs, MapBuildArgs, MapCommand, MapExportArgs, MapInfoArgs};
use super::{CliError, bytes, human, print};
use crate::integrator::PhotonMapperSettings;
use crate::math::{DVec3, Vec3};
use crate::photon::{MapFile, MapFileError, PhotonMap, write_ply};
use crate::render::{Method, Plan, PlanOverrides};
use crate::scene::Scene;
use crate::shoot::shoot;

/// Names in a map file.
const MAX_DEPTH: &str = "max_depth";
const CENTER: &str = "scene_center";
const SCALE: &str = "scene_scale";

pub fn run(a: &MapArgs) -> Result<u8, CliError> {
    match &a.command {
        MapCommand::Build(a) => build(a),
        MapCommand::Info(a) => info(a),
        MapCommand::Export(a) => export(a),
    }
}

fn file_error(e: MapFileError) -> CliError {
    CliError::Usage(e.to_string())
}

/// The hash of a scene as bytes.
fn scene_hash(scene: &Scene) -> Result<[u8; 32], CliError> {
    let hash = blake3::Hash::from_hex(&scene.hash).map_err(|e| CliError::Failed(format!("scene hash: {e}")))?;
    Ok(*hash.as_bytes())
}

fn depth_text(settings: &PhotonMapperSettings) -> String {
    settings.max_depth.map_or_else(|| "-1".to_owned(), |d| d.to_string())
}

/// Shoots the photon maps of a scene into a file.
fn build(a: &MapBuildArgs) -> Result<u8, CliError> {
    super::set_threads(a.scene.threads)?;
    let scene = super::load_scene(&a.scene)?;
    let plan = Plan::new(
        &scene,
        &PlanOverrides {
            integrator: Some("photonmapper".to_owned()),
            photons: a.photons,
            seed: a.seed,
            ..PlanOverrides::default()
        },
    )?;
    let Method::PhotonMapper(settings) = plan.method else {
        return Err(CliError::Failed("the plan is not one of photon maps".to_owned()));
    };
    let center = scene.to_scene.center;
    let mut parameters = BTreeMap::from([
        ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("seed".to_owned(), plan.seed.to_string()),
        (MAX_DEPTH.to_owned(), depth_text(&settings)),
        // Shortest decimal forms, which are read back as the same bits.
        (CENTER.to_owned(), format!("{:?} {:?} {:?}", center.x, center.y, center.z)),
        (SCALE.to_owned(), format!("{:?}", scene.to_scene.scale)),
    ]);
    let mut maps = Vec::new();
    for target in settings.targets() {
        let shot = shoot(&scene, &settings.shoot_settings(plan.seed, 0, target, scene.sampler.sequence));
        parameters.insert(format!("{}_paths", target.name()), shot.emitted.to_string());
        let map = PhotonMap::build(shot.photons);
        if !a.quiet {
            let (stored, paths) = (human(map.len() as f64), human(shot.emitted as f64));
            print(&format!("{:<10} {stored} photons of {paths} paths", target.name()));
        }
        maps.push((target.name().to_owned(), map));
    }
    let file = MapFile { scene_hash: scene_hash(&scene)?, parameters, maps };
    file.write(&a.output).map_err(|e| CliError::Failed(e.to_string()))?;
    if !a.quiet {
        print(&format!("wrote      {}", a.output.display()));
    }
    Ok(0)
}

/// Reads the maps that a render is to use, and makes sure that they are the ones it needs.
pub(super) fn load(path: &Path, scene: &Scene, plan: &mut Plan) -> Result<(), CliError> {
    let Method::PhotonMapper(settings) = plan.method else {
        let name = plan.method.name();
        return Err(CliError::Usage(format!(
            "--photon-map: {name} reads no photon map; use --integrator photonmapper"
        )));
    };
    let file = MapFile::read(path, Some(&scene_hash(scene)?)).map_err(file_error)?;
    let refuse = |what: String| Err(CliError::Usage(format!("{}: {what}; build the map again", path.display())));
    let (found, wanted) = (file.parameters.get(MAX_DEPTH), depth_text(&settings));
    if found != Some(&wanted) {
        let found = found.map_or("unknown", String::as_str);
        return refuse(format!("made for paths of max_depth {found}, the render wants {wanted}"));
    }
    for target in settings.targets() {
        if file.map(target.name()).is_none() {
            let names: Vec<&str> = file.maps.iter().map(|(name, _)| &name[..]).collect();
            return refuse(format!("holds the maps {}, the render needs {}", names.join(", "), target.name()));
        }
    }
    plan.stored_maps = Some(Arc::new(file));
    Ok(())
}

#[derive(Serialize)]
struct Info {
    version: u32,
    bytes: u64,
    scene_hash: String,
    maps: BTreeMap<String, u64>,
    parameters: BTreeMap<String, String>,
}

fn info(a: &MapInfoArgs) -> Result<u8, CliError> {
    let i = MapFile::info(&a.map).map_err(file_error)?;
    let info = Info {
        version: i.version,
        bytes: i.bytes,
        scene_hash: blake3::Hash::from_bytes(i.scene_hash).to_hex().to_string(),
        maps: i.maps.into_iter().collect(),
        parameters: i.parameters,
    };
    if a.json {
        let text = serde_json::to_string_pretty(&info).map_err(|e| CliError::Failed(e.to_string()))?;
        print(&text);
        return Ok(0);
    }
    print(&format!("format      {}, {}", info.version, bytes(info.bytes as usize)));
    print(&format!("scene       hash {}", &info.scene_hash[..16]));
    for (name, photons) in &info.maps {
        print(&format!("map         {name}, {} photons", human(*photons as f64)));
    }
    for (key, value) in &info.parameters {
        print(&format!("{key:<18} {value}"));
    }
    Ok(0)
}

/// Writes the photons as points in the coordinates of the scene file.
fn export(a: &MapExportArgs) -> Result<u8, CliError> {
    let file = MapFile::read(&a.map, None).map_err(file_error)?;
    let names = || file.maps.iter().map(|(name, _)| &name[..]).collect::<Vec<_>>().join(", ");
    let map = match &a.name {
        Some(name) => file.map(name),
        None => file.maps.first().map(|(_, map)| map),
    };
    let Some(map) = map else {
        let found = a.name.as_deref().unwrap_or("no map");
        return Err(CliError::Usage(format!("{}: found {found}, it holds: {}", a.map.display(), names())));
    };
    let number = |text: &str| text.parse::<f64>().ok().filter(|v| v.is_finite());
    let parameter = |key: &str| -> Option<Vec<f64>> { file.parameters.get(key)?.split(' ').map(number).collect() };
    let (center, scale) = match (parameter(CENTER).as_deref(), parameter(SCALE).as_deref()) {
        (Some(&[x, y, z]), Some(&[s])) if s > 0.0 => (DVec3::new(x, y, z), s),
        _ => return Err(CliError::Usage(format!("{}: does not say where its scene stands", a.map.display()))),
    };
    let to_world = |p: Vec3| (p.as_dvec3() / scale + center).as_vec3();
    let failed = |e: std::io::Error| CliError::Failed(format!("{}: {e}", a.output.display()));
    let folder = a.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut temporary = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
    write_ply(map, to_world, std::io::BufWriter::new(temporary.as_file_mut())).map_err(failed)?;
    temporary.persist(&a.output).map_err(|e| failed(e.error))?;
    print(&format!("wrote {} ({} photons)", a.output.display(), human(map.len() as f64)));
    Ok(0)
}
