use glam::{Vec2, Vec3};

use super::super::{MeshData, Positions};
use super::text::NONE;

/// Corners of triangles with separate indices, three corners after each other, and what the indices refer to.
#[derive(Default)]
pub(super) struct Corners {
    pub positions: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub normals: Vec<Vec3>,
    pub position_of: Vec<[u32; 3]>,
    /// Empty when no corner has a texture coordinate; otherwise [`NONE`] where one has none. So are normals.
    pub uv_of: Vec<[u32; 3]>,
    pub normal_of: Vec<[u32; 3]>,
}

/// One index for position, texture coordinate and normal together: splits a position where corners differ. A missing
/// texture coordinate or normal becomes zero.
pub(super) fn join(c: Corners, data: &mut MeshData) {
    let (has_uv, has_normal) = (!c.uv_of.is_empty(), !c.normal_of.is_empty());

    // Nothing to split when all indices of each corner are the same, as in files exported from indexed meshes.
    let same = |of: &[[u32; 3]], pool: usize| of.is_empty() || (pool == c.positions.len() && of == c.position_of);
    if same(&c.uv_of, c.uvs.len()) && same(&c.normal_of, c.normals.len()) {
        data.positions = Positions::F32(c.positions);
        data.indices = c.position_of;
        data.uvs = has_uv.then_some(c.uvs);
        data.normals = has_normal.then_some(c.normals);
        return;
    }

    // The vertices of one point form a list: (texture coordinate, normal, next).
    let mut heads = vec![NONE; c.positions.len()];
    let mut vertices: Vec<(u32, u32, u32)> = Vec::with_capacity(c.positions.len());
    let mut points: Vec<u32> = Vec::with_capacity(c.positions.len());
    let mut indices = vec![[0; 3]; c.position_of.len()];
    for (triangle, out) in indices.iter_mut().enumerate() {
        for (k, out) in out.iter_mut().enumerate() {
            let point = c.position_of[triangle][k];
            let key = |of: &[[u32; 3]]| of.get(triangle).map_or(NONE, |t| t[k]);
            let (uv, normal) = (key(&c.uv_of), key(&c.normal_of));
            let mut vertex = heads[point as usize];
            while vertex != NONE && (vertices[vertex as usize].0, vertices[vertex as usize].1) != (uv, normal) {
                vertex = vertices[vertex as usize].2;
            }
            if vertex == NONE {
                vertex = vertices.len() as u32;
                vertices.push((uv, normal, heads[point as usize]));
                points.push(point);
                heads[point as usize] = vertex;
            }
            *out = vertex;
        }
    }

    data.positions = Positions::F32(points.iter().map(|&p| c.positions[p as usize]).collect());
    data.indices = indices;
    data.uvs = has_uv.then(|| vertices.iter().map(|v| c.uvs.get(v.0 as usize).copied().unwrap_or_default()).collect());
    data.normals =
        has_normal.then(|| vertices.iter().map(|v| c.normals.get(v.1 as usize).copied().unwrap_or_default()).collect());

    // Name each point by the first vertex on it; vertices that were not split need no names.
    let mut first = vec![NONE; c.positions.len()];
    let mut split = false;
    for (vertex, point) in points.iter_mut().enumerate() {
        let name = &mut first[*point as usize];
        split |= *name != NONE;
        if *name == NONE {
            *name = vertex as u32;
        }
        *point = *name;
    }
    data.points = split.then_some(points);
}
