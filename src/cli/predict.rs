//! `caustica info --predict`: memory before anything is loaded.

use std::path::Path;

use serde::Serialize;

use super::args::{AccelArg, InfoArgs};
use super::{CliError, bytes, human, load_options, print};
use crate::accel::{Bvh, embree_available};
use crate::scene::{MeshPrediction, Prediction};

/// Meshes that are told one by one.
const MOST_MESHES: usize = 12;

#[derive(Serialize)]
struct Report {
    scene: String,
    /// The back end that would be used.
    accel_used: &'static str,
    /// Bytes that the machine can give; none where the system does not tell.
    available_memory: Option<u64>,
    /// The peak of the back end used is above that.
    too_large: bool,
    #[serde(flatten)]
    prediction: Prediction,
}

pub fn run(a: &InfoArgs) -> Result<u8, CliError> {
    let options = load_options(&a.scene);
    let prediction = match super::scene_of_mesh(&a.scene.scene, "")? {
        Some(text) => Prediction::from_text(&text, Path::new("mesh.xml"), &options)?,
        None => Prediction::read(&a.scene.scene, &options)?,
    };
    let others = prediction.shapes - prediction.meshes.len() as u64;
    let embree = match a.scene.accel {
        AccelArg::Auto => embree_available() && !Bvh::suits(prediction.triangles, others, prediction.instances),
        chosen => chosen == AccelArg::Embree,
    };
    let used = prediction.accel[usize::from(!embree)];
    let available_memory = available_memory();
    let report = Report {
        scene: a.scene.scene.display().to_string(),
        accel_used: used.name,
        available_memory,
        too_large: available_memory.is_some_and(|m| used.peak > m),
        prediction,
    };
    if a.json {
        let text = serde_json::to_string_pretty(&report).map_err(|e| CliError::Failed(e.to_string()))?;
        print(&text);
    } else {
        tell(&report);
    }
    Ok(0)
}

fn tell(report: &Report) {
    let size = |n: u64| bytes(n as usize);
    let p = &report.prediction;
    print(&format!("scene       {}, not loaded: predicted from headers", report.scene));
    let mut meshes: Vec<&MeshPrediction> = p.meshes.iter().filter(|m| m.is_file()).collect();
    meshes.sort_by_key(|m| std::cmp::Reverse(m.triangles));
    for m in meshes.iter().take(MOST_MESHES) {
        let sure = if m.exact { "exact" } else { "estimate" };
        let name = m.file.file_name().unwrap_or(m.file.as_os_str()).display();
        let counts = format!("{} triangles, {} vertices", human(m.triangles as f64), human(m.vertices as f64));
        print(&format!("mesh        {name}: {counts} ({sure}: {})", m.counted_by));
        let parts = [
            ("vertices", m.vertex_memory),
            ("indices", m.index_memory),
            ("normals", m.normal_memory),
            ("uv", m.uv_memory),
            ("attributes", m.attribute_memory),
        ];
        let parts = parts.iter().filter(|part| part.1 > 0).map(|(name, n)| format!("{} {name}", size(*n)));
        print(&format!("            {}", parts.collect::<Vec<_>>().join(", ")));
    }
    if let Some(more) = meshes.len().checked_sub(MOST_MESHES).filter(|&n| n > 0) {
        print(&format!("            and {more} smaller ones"));
    }
    print(&format!(
        "geometry    {} shapes, {} instances, {} triangles{}: {}",
        p.shapes,
        p.instances,
        human(p.triangles as f64),
        if p.exact { "" } else { " (estimate)" },
        size(p.geometry_memory)
    ));
    if !p.pictures.is_empty() {
        print(&format!("pictures    {}: at most {}", p.pictures.len(), size(p.picture_memory)));
    }
    print(&format!("film        {} x {}: {}", p.width, p.height, size(p.film_memory)));
    for (accel, name) in p.accel.iter().zip(["Embree", "Rust BVH"]) {
        let used = if accel.name == report.accel_used { ", used here" } else { "" };
        let (memory, peak) = (size(accel.memory), size(accel.peak));
        print(&format!("{name:<11} {memory}; {peak} of all memory at the peak of loading{used}"));
    }
    if let Some(available) = report.available_memory {
        print(&format!("machine     {} available", size(available)));
    }
    for w in &p.warnings {
        print(&format!("warning     {w}"));
    }
    if report.too_large {
        print("warning     loading needs more memory than the machine has available");
    }
}

/// `MemAvailable` of proc(5), in bytes.
fn available_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}
