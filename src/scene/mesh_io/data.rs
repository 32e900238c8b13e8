use std::path::PathBuf;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::geometry::VertexAttribute;
use crate::math::Transform;

/// Positions as precise as the file gives them.
#[derive(Clone, Debug)]
pub enum Positions {
    F32(Vec<Vec3>),
    F64(Vec<DVec3>),
}

impl Default for Positions {
    fn default() -> Self {
        Self::F32(Vec::new())
    }
}

impl Positions {
    pub fn len(&self) -> usize {
        match self {
            Self::F32(p) => p.len(),
            Self::F64(p) => p.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    #[inline]
    pub fn get(&self, i: usize) -> DVec3 {
        match self {
            Self::F32(p) => p[i].as_dvec3(),
            Self::F64(p) => p[i],
        }
    }
}

/// A triangle mesh as a file gives it, in the file's own space. Indices are in range and positions finite when a reader
/// made it; [`finish`](super::finish) checks again.
#[derive(Clone, Debug, Default)]
pub struct MeshData {
    /// The file, for messages.
    pub path: PathBuf,
    pub positions: Positions,
    pub indices: Vec<[u32; 3]>,
    /// Per vertex, of any length.
    pub normals: Option<Vec<Vec3>>,
    pub uvs: Option<Vec<Vec2>>,
    pub attributes: Vec<VertexAttribute>,
    /// For each vertex the surface point that it stands on, when vertices were split for the sake of texture coordinates:
    /// smooth normals are computed per point. Without it every vertex is its own point.
    pub points: Option<Vec<u32>>,
    /// Faces with fewer than three corners, left out.
    pub skipped_faces: u64,
    /// The file itself asks for flat shading (serialized format).
    pub face_normals: bool,
}

impl MeshData {
    /// The smallest box around the transformed vertices, in f64; `None` without vertices.
    pub fn bounds(&self, transform: &Transform) -> Option<(DVec3, DVec3)> {
        let empty = || (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let grow = |(lo, hi): (DVec3, DVec3), p: DVec3| (lo.min(p), hi.max(p));
        let join = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        if self.positions.is_empty() {
            return None;
        }
        Some(match &self.positions {
            Positions::F32(p) => {
                p.par_iter().map(|p| transform.point_f64(p.as_dvec3())).fold(empty, grow).reduce(empty, join)
            }
            Positions::F64(p) => p.par_iter().map(|&p| transform.point_f64(p)).fold(empty, grow).reduce(empty, join),
        })
    }
}
