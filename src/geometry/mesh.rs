use glam::{Vec2, Vec3};

use crate::math::Bounds3;

/// Packed 12-byte positions with one element of padding behind the last, so that a 16-byte load of any element stays
/// inside the allocation (Embree reads vertex buffers that way).
#[derive(Clone, Debug, Default)]
pub struct PaddedVec3s {
    data: Vec<Vec3>,
}

impl PaddedVec3s {
    pub fn new(mut data: Vec<Vec3>) -> Self {
        data.push(Vec3::ZERO);
        Self { data }
    }

    /// The elements, without the padding.
    #[inline]
    pub fn as_slice(&self) -> &[Vec3] {
        match self.data.split_last() {
            Some((_, elements)) => elements,
            None => &[],
        }
    }

    #[inline]
    pub fn len(&self) -> usize {
        self.data.len().saturating_sub(1)
    }

    #[inline]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The elements with the padding element behind them.
    pub fn padded(&self) -> &[Vec3] {
        &self.data
    }
}

impl From<Vec<Vec3>> for PaddedVec3s {
    fn from(v: Vec<Vec3>) -> Self {
        Self::new(v)
    }
}

/// Named per-vertex or per-face values of a mesh, for example `vertex_color`.
#[derive(Clone, Debug)]
pub struct VertexAttribute {
    pub name: String,
    /// Values per element: 1 or 3.
    pub channels: usize,
    /// One element per vertex (true) or per face (false).
    pub per_vertex: bool,
    pub data: Vec<f32>,
}

/// An indexed triangle mesh in scene space. Every index is below the vertex count, every position finite.
#[derive(Clone, Debug, Default)]
pub struct TriangleMesh {
    pub positions: PaddedVec3s,
    pub indices: Vec<[u32; 3]>,
    /// Unit shading normals per vertex.
    pub normals: Option<Vec<Vec3>>,
    pub uvs: Option<Vec<Vec2>>,
    pub attributes: Vec<VertexAttribute>,
    /// Turns geometric and shading normals to the other side.
    pub flip_normals: bool,
}

impl TriangleMesh {
    #[inline]
    pub fn triangle(&self, prim: u32) -> [Vec3; 3] {
        let p = self.positions.as_slice();
        self.indices[prim as usize].map(|i| p[i as usize])
    }

    pub fn bounds(&self) -> Bounds3 {
        Bounds3::from_points(self.positions.as_slice().iter().copied())
    }

    /// Heap bytes of all buffers.
    pub fn memory(&self) -> usize {
        size_of_val(self.positions.padded())
            + size_of_val(&self.indices[..])
            + self.normals.as_ref().map_or(0, |n| size_of_val(&n[..]))
            + self.uvs.as_ref().map_or(0, |n| size_of_val(&n[..]))
            + self.attributes.iter().map(|a| size_of_val(&a.data[..])).sum::<usize>()
    }
}
