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
    #[inline(always)]
    pub fn as_slice(&self) -> &[Vec3] {
        match self.data.split_last() {
            Some((_, elements)) => elements,
            None => &[],
        }
    }

    #[inline(always)]
    pub fn len(&self) -> usize {
        self.data.len().saturating_sub(1)
    }

    #[inline(always)]
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
    #[inline(always)]
    pub fn triangle(&self, prim: u32) -> [Vec3; 3] {
        let p = self.positions.as_slice();
        let [a, b, c] = self.indices[prim as usize];
        [p[a as usize], p[b as usize], p[c as usize]]
    }

    /// Shading normals of the corners.
    #[inline(always)]
    pub fn corner_normals(&self, prim: u32) -> Option<[Vec3; 3]> {
        let n = self.normals.as_ref()?;
        let [a, b, c] = self.indices[prim as usize];
        Some([n[a as usize], n[b as usize], n[c as usize]])
    }

    pub fn bounds(&self) -> Bounds3 {
        Bounds3::from_points(self.positions.as_slice().iter().copied())
    }

    /// Drops vertex normals that are those of the triangles themselves, to 1e-6, and says whether.
    pub fn drop_flat_normals(&mut self) -> bool {
        let Some(normals) = &self.normals else { return false };
        let side = if self.flip_normals { -1.0 } else { 1.0 };
        let flat = (0..self.indices.len() as u32).all(|i| {
            let ng = super::triangle_normal(self.triangle(i)).map(|n| side * n);
            let close = |v: u32| ng.is_some_and(|ng| (normals[v as usize] - ng).length_squared() < 1e-12);
            self.indices[i as usize].into_iter().all(close)
        });
        if flat {
            self.normals = None;
        }
        flat
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
