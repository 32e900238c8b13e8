//! Triangles that photons have hit, and the points on them.

use super::{Arrivals, Lane, Triples};
use crate::geometry::{TriangleMesh, quick_normal, triangle_normal, triangle_point_error, unit_or};
use crate::math::Vec3;
use crate::shoot::flight::WAVE;

/// A triangle of a mesh that was hit.
#[derive(Clone, Copy, Debug)]
pub(in crate::shoot) struct Face<'a> {
    pub mesh: &'a TriangleMesh,
    pub prim: u32,
    /// Of the second and the third corner.
    pub weights: [f32; 2],
    /// The ray's.
    pub d: Vec3,
}

/// The lanes that came as a [`Face`].
#[derive(Debug)]
pub(super) struct Faces {
    corners: [Triples; 3],
    normals: [Triples; 3],
    weights: [Lane; 2],
    d: Triples,
    /// 1, or −1 where the normal is turned.
    side: Lane,
    /// All bits in the lanes of faces, none in those of others.
    mask: [u32; WAVE],
    /// All bits where there are normals of the corners.
    smooth: [u32; WAVE],
    /// 1 where the normal that is computed quickly is good.
    good: [u32; WAVE],
    any: bool,
    any_smooth: bool,
}

impl Faces {
    pub fn new() -> Self {
        let zero = Triples::ZERO;
        Self {
            corners: [zero; 3],
            normals: [zero; 3],
            weights: [[0.0; WAVE]; 2],
            d: zero,
            side: [1.0; WAVE],
            mask: [0; WAVE],
            smooth: [0; WAVE],
            good: [1; WAVE],
            any: false,
            any_smooth: false,
        }
    }

    #[inline(always)]
    pub fn clear(&mut self) {
        (self.any, self.any_smooth) = (false, false);
    }

    /// Whether there is one.
    #[inline(always)]
    pub fn any(&self) -> bool {
        self.any
    }

    /// Lane `i` has none.
    #[inline(always)]
    pub fn skip(&mut self, i: usize) {
        self.mask[i] = 0;
    }

    /// All bits where lane `i` has a face, else none.
    #[inline(always)]
    pub fn mask(&self, i: usize) -> u32 {
        self.mask[i]
    }

    #[inline(always)]
    pub fn set(&mut self, i: usize, face: &Face) {
        self.any = true;
        for (lanes, corner) in self.corners.iter_mut().zip(face.mesh.triangle(face.prim)) {
            lanes.set(i, corner);
        }
        let normals = face.mesh.corner_normals(face.prim);
        (self.mask[i], self.smooth[i]) = (u32::MAX, u32::from(normals.is_some()).wrapping_neg());
        if let Some(normals) = normals {
            self.any_smooth = true;
            for (lanes, normal) in self.normals.iter_mut().zip(normals) {
                lanes.set(i, normal);
            }
        }
        for (lanes, weight) in self.weights.iter_mut().zip(face.weights) {
            lanes[i] = weight;
        }
        self.d.set(i, face.d);
        self.side[i] = if face.mesh.flip_normals { -1.0 } else { 1.0 };
    }

    // Without `map`, which the compiler may leave a call.
    #[inline(always)]
    fn corners(&self, i: usize) -> [Vec3; 3] {
        [self.corners[0].get(i), self.corners[1].get(i), self.corners[2].get(i)]
    }

    /// Lets photons land on the faces, as on a mesh, in `lanes` lanes, in the first `len` of which there is something.
    #[inline(always)]
    pub fn meet(&mut self, out: &mut Arrivals, len: usize, lanes: usize) {
        assert!(lanes <= WAVE && len <= lanes);
        let Arrivals { p, p_err, ng, ns, wo, .. } = out;
        for i in 0..lanes {
            let (n, good) = quick_normal(self.corners(i));
            ng.set_where(self.mask[i], i, self.side[i] * n);
            self.good[i] = good as u32;
        }
        // Needles, which are few.
        for i in (0..len).filter(|&i| self.good[i] == 0 && self.mask[i] != 0) {
            let n = triangle_normal(self.corners(i));
            ng.set(i, self.side[i] * n.unwrap_or_else(|| -self.d.get(i).normalize_or(Vec3::Z)));
        }
        for i in 0..lanes {
            let (mask, tri, [b0, u, v]) = (self.mask[i], self.corners(i), self.weights(i));
            let at = b0 * tri[0] + u * tri[1] + v * tri[2];
            p.set_where(mask, i, at);
            p_err.set_where(mask, i, triangle_point_error(tri, [b0, u, v], at));
            wo.set_where(mask, i, unit_or(-self.d.get(i), ng.get(i)));
            ns.set_where(mask, i, ng.get(i));
        }
        if !self.any_smooth {
            return;
        }
        for i in 0..lanes {
            let [b0, u, v] = self.weights(i);
            let n = b0 * self.normals[0].get(i) + u * self.normals[1].get(i) + v * self.normals[2].get(i);
            let n = n.normalize_or_zero();
            let cos = n.dot(ng.get(i));
            let sides = (cos > 0.0) | (cos < 0.0);
            let mask = self.mask[i] & self.smooth[i] & u32::from(sides).wrapping_neg();
            ns.set_where(mask, i, if cos < 0.0 { -n } else { n });
        }
    }

    /// Of the corners.
    #[inline(always)]
    fn weights(&self, i: usize) -> [f32; 3] {
        let [u, v] = [self.weights[0][i], self.weights[1][i]];
        [1.0 - u - v, u, v]
    }
}
