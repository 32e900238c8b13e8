//! The OBJ reader. Ordinary files go through tobj; large ones, for which tobj is ten times slower than the rest of
//! loading, are cut into pieces and parsed in parallel. Both follow the same rules (`text.rs`) and are tested against
//! each other.

mod feed;
mod join;
mod parallel;
mod text;

#[cfg(test)]
mod tests;

use std::path::Path;

use super::mapped::FileBytes;
use super::{MeshCounts, MeshData, MeshError};

/// Files of more bytes than this are parsed in parallel.
const LARGE: usize = 1 << 20;

/// Bytes of a piece of a large file.
const PIECE: usize = 1 << 19;

/// Reads an OBJ file as one mesh: groups, objects, materials, points and lines are left out, as in Mitsuba. `flip_v`
/// turns texture coordinates upside down (Mitsuba's `flip_tex_coords`, on by default for OBJ).
pub fn read_obj(path: &Path, flip_v: bool) -> Result<MeshData, MeshError> {
    let bytes = FileBytes::open(path)?;
    parse_obj(&bytes, path, flip_v)
}

/// Counts the lines of an OBJ file, which has no header. Numbers are not read.
pub fn count_obj(path: &Path) -> Result<MeshCounts, MeshError> {
    let bytes = FileBytes::open(path)?;
    let ([positions, uvs, normals], triangles) = parallel::tally(&bytes, PIECE);
    // Which corners share a vertex, only their numbers tell.
    let exact = uvs + normals == 0;
    Ok(MeshCounts {
        path: path.to_path_buf(),
        vertices: positions.max(uvs).max(normals),
        triangles,
        normals: normals > 0,
        uvs: uvs > 0,
        vertex_values: 0,
        face_values: 0,
        face_normals: false,
        exact,
        how: if exact { "lines counted" } else { "lines counted; vertices that texture seams split are not" },
        cut_short: false,
    })
}

/// Reads an OBJ file from memory; `path` is for messages.
pub fn parse_obj(bytes: &[u8], path: &Path, flip_v: bool) -> Result<MeshData, MeshError> {
    if bytes.len() > LARGE { parallel::parse(bytes, path, flip_v, PIECE) } else { feed::parse(bytes, path, flip_v) }
}
