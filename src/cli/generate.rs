//! `caustica scene`: meshes of any size, made rather than downloaded.

use super::args::{GenerateArgs, GeneratedMesh};
use super::{CliError, human, print};
use crate::geometry::generate;
use crate::geometry::lathe::{Snifter, snifter};
use crate::scene::mesh_io::{PlyMesh, write_ply};

pub fn run(a: &GenerateArgs) -> Result<u8, CliError> {
    if a.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        return Err(CliError::Usage(format!(
            "{}: meshes are written as .ply; use a name that ends so",
            a.output.display()
        )));
    }
    let triangles = a.triangles as usize;
    let mesh = match a.mesh {
        GeneratedMesh::Terrain => generate::terrain(triangles, a.seed),
        GeneratedMesh::DisplacedSphere => generate::displaced_sphere(triangles, a.seed),
        GeneratedMesh::Sphereflake => generate::sphereflake(triangles),
        GeneratedMesh::Mountain => generate::mountain(triangles, a.seed),
        GeneratedMesh::Snifter => snifter(Snifter::Glass, triangles),
        GeneratedMesh::SnifterWet => snifter(Snifter::Wet, triangles),
        GeneratedMesh::SnifterDrink => snifter(Snifter::Drink, triangles),
    };
    let ply = PlyMesh {
        positions: mesh.positions.as_slice(),
        normals: mesh.normals.as_deref(),
        uvs: mesh.uvs.as_deref(),
        indices: &mesh.indices,
        comments: &["made by caustica scene"],
    };
    write_ply(&a.output, &ply).map_err(|e| CliError::Failed(e.to_string()))?;
    print(&format!("wrote {} ({} triangles)", a.output.display(), human(mesh.indices.len() as f64)));
    Ok(0)
}
