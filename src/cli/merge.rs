//! `caustica merge`.

use super::args::MergeArgs;
use super::render::clamp_line;
use super::{CliError, layers, print};
use crate::image::{Format, WriteOptions};
use crate::render::Checkpoint;

pub fn run(a: &MergeArgs) -> Result<u8, CliError> {
    for path in &a.output {
        super::check_folder(path)?;
        if Format::from_path(path) == Some(Format::Jpeg) {
            return Err(CliError::UnknownFormat(path.clone()));
        }
    }
    let parts = a.checkpoints.iter().map(|p| Checkpoint::read(p)).collect::<Result<Vec<_>, _>>()?;
    let merged = Checkpoint::merge(parts)?;
    let passes: Vec<String> = merged.ranges.iter().map(|r| format!("{}..{}", r.start, r.end)).collect();
    print(&format!("passes {}, {} samples per pixel", passes.join(", "), merged.spp));
    if let Some(clamp) = merged.clamp() {
        print(&clamp_line(&clamp));
    }
    for path in &a.output {
        if Format::from_path(path).is_some() {
            let options = WriteOptions { exposure: a.exposure, half: !a.float, ..WriteOptions::default() };
            let image = describe(&merged);
            crate::image::write(path, &image, &options).map_err(CliError::Output)?;
            for file in layers::write_beside(std::slice::from_ref(path), &image, &merged.layers(), &options)? {
                print(&format!("wrote {}", file.display()));
            }
        } else {
            merged.write(path)?;
        }
        print(&format!("wrote {}", path.display()));
    }
    Ok(0)
}

/// The picture with how it was made in its header.
fn describe(c: &Checkpoint) -> crate::image::Image {
    let mut image = c.image();
    let mut set = |key: &str, value: String| {
        image.metadata.insert(format!("caustica.{key}"), value);
    };
    set("version", c.version.clone());
    set("scene_hash", c.scene_hash.clone());
    set("integrator", c.integrator.clone());
    set("spp", c.spp.to_string());
    set("passes", c.passes().to_string());
    set("seed", c.seed.to_string());
    set("accel", c.accel.clone());
    image
}
