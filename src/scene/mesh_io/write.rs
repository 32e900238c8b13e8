use std::io::{self, BufWriter, Write};
use std::path::Path;

use glam::{Vec2, Vec3};

use super::MeshError;

/// Bytes that are gathered before they are written.
const BUFFER: usize = 1 << 20;

/// What a PLY file is written from. Normals and texture coordinates are per vertex; their slices are as long as
/// `positions`.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlyMesh<'a> {
    pub positions: &'a [Vec3],
    pub normals: Option<&'a [Vec3]>,
    pub uvs: Option<&'a [Vec2]>,
    pub indices: &'a [[u32; 3]],
    /// Lines for the header, without line ends.
    pub comments: &'a [&'a str],
}

/// Writes a little-endian binary PLY file under a temporary name and renames it when it is complete.
pub fn write_ply(path: &Path, mesh: &PlyMesh) -> Result<(), MeshError> {
    let error = |e: io::Error| MeshError::io(path, &e);
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::Builder::new().prefix(".caustica-").suffix(".ply").tempfile_in(folder).map_err(error)?;
    write_ply_to(file.as_file_mut(), mesh).map_err(error)?;
    file.persist(path).map_err(|e| error(e.error))?;
    Ok(())
}

/// Writes little-endian binary PLY. A slice whose length does not match the positions is an
/// [`io::ErrorKind::InvalidInput`].
pub fn write_ply_to(out: impl Write, mesh: &PlyMesh) -> io::Result<()> {
    let count = mesh.positions.len();
    if mesh.normals.is_some_and(|n| n.len() != count) || mesh.uvs.is_some_and(|u| u.len() != count) {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "one normal and one texture coordinate per vertex needed",
        ));
    }
    let mut out = BufWriter::with_capacity(BUFFER, out);

    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    for comment in mesh.comments {
        writeln!(out, "comment {}", comment.replace(['\n', '\r'], " "))?;
    }
    writeln!(out, "element vertex {count}\nproperty float x\nproperty float y\nproperty float z")?;
    if mesh.normals.is_some() {
        writeln!(out, "property float nx\nproperty float ny\nproperty float nz")?;
    }
    if mesh.uvs.is_some() {
        writeln!(out, "property float u\nproperty float v")?;
    }
    writeln!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header", mesh.indices.len())?;

    let mut record = Vec::with_capacity(32);
    for (i, p) in mesh.positions.iter().enumerate() {
        record.clear();
        let normal = mesh.normals.iter().flat_map(|n| n[i].to_array());
        let uv = mesh.uvs.iter().flat_map(|u| u[i].to_array());
        for number in p.to_array().into_iter().chain(normal).chain(uv) {
            record.extend_from_slice(&number.to_le_bytes());
        }
        out.write_all(&record)?;
    }
    for t in mesh.indices {
        let mut record = [3; 13];
        for (place, index) in record[1..].chunks_exact_mut(4).zip(t) {
            place.copy_from_slice(&index.to_le_bytes());
        }
        out.write_all(&record)?;
    }
    out.flush()
}
