use std::ops::Range;
use std::path::PathBuf;

use crate::integrator::Layer;

/// A checkpoint that cannot be written, read, resumed or merged.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    #[error("{}: cannot {action} the checkpoint: {error}", .path.display())]
    Io { path: PathBuf, action: &'static str, error: std::io::Error },
    #[error("{}: not a checkpoint of caustica", .0.display())]
    NotACheckpoint(PathBuf),
    #[error("{}: a checkpoint of format {found}; this program reads format {expected}: finish it with the program that wrote it", .path.display())]
    Version { path: PathBuf, found: u32, expected: u32 },
    #[error("{}: the checkpoint is damaged ({what}); go back to an older one or start again", .path.display())]
    Damaged { path: PathBuf, what: &'static str },
    #[error("the checkpoint is of another scene (or other -D defines): its hash is {found}, not {expected}")]
    Scene { found: String, expected: String },
    #[error("the checkpoint is of another plan; it has\n  {found}\nwhere this render has\n  {expected}")]
    Plan { found: String, expected: String },
    #[error(
        "the checkpoint holds the layers {}, where {} are asked for: render with the same --aov as before",
        layers(.found), layers(.expected)
    )]
    Layers { found: Vec<Layer>, expected: Vec<Layer> },
    #[error("the checkpoint was made with {found}, not {expected}: it can be merged, but not go on bit by bit")]
    Accel { found: String, expected: String },
    #[error("the checkpoint holds the passes {}, which are not the first of {expected:?}", list(.found))]
    Passes { found: Vec<Range<u64>>, expected: Range<u64> },
    #[error("the passes {first:?} and {second:?} overlap: merge each pass once")]
    Overlap { first: Range<u64>, second: Range<u64> },
    #[error(
        "passes that share statistics depend on those before them and cannot be merged; leave out \
         shared_statistics and chi_squared_radius"
    )]
    Dependent,
    #[error("nothing to merge")]
    Nothing,
}

fn layers(layers: &[Layer]) -> String {
    let names: Vec<&str> = layers.iter().map(|l| l.name()).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

fn list(ranges: &[Range<u64>]) -> String {
    ranges.iter().map(|r| format!("{r:?}")).collect::<Vec<_>>().join(", ")
}
