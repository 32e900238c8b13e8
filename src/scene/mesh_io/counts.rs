use std::path::PathBuf;

use super::MeshData;

/// What a mesh file holds, told without reading its arrays.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshCounts {
    pub path: PathBuf,
    pub vertices: u64,
    /// Those without area included, which loading drops.
    pub triangles: u64,
    /// The file has normals of its own.
    pub normals: bool,
    pub uvs: bool,
    /// Numbers of attributes per vertex and per triangle.
    pub vertex_values: u64,
    pub face_values: u64,
    /// The file asks for flat shading.
    pub face_normals: bool,
    /// Loading will find these numbers; otherwise they are an estimate.
    pub exact: bool,
    /// Where the numbers come from, for people.
    pub how: &'static str,
    /// The file is shorter than its header announces for faces of three corners.
    pub cut_short: bool,
}

impl MeshCounts {
    /// Where the numbers of a mesh come from that is in no file.
    pub const BUILT_IN: &'static str = "built in";

    /// Of a mesh that is there.
    pub fn of(data: &MeshData) -> Self {
        let values =
            |per_vertex| data.attributes.iter().filter(|a| a.per_vertex == per_vertex).map(|a| a.channels as u64).sum();
        Self {
            path: data.path.clone(),
            vertices: data.positions.len() as u64,
            triangles: data.indices.len() as u64,
            normals: data.normals.is_some(),
            uvs: data.uvs.is_some(),
            vertex_values: values(true),
            face_values: values(false),
            face_normals: data.face_normals,
            exact: true,
            how: Self::BUILT_IN,
            cut_short: false,
        }
    }
}
