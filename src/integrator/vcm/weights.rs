//! Weights by the balance heuristic from partial sums carried along sub-paths [Georgiev 2012, "Implementing Vertex
//! Connection and Merging", §4].
//!
//! Of the report's three quantities two are kept. `dvcm` is its dVCM. `dvc` is its dVC; dVM is `dvc / eta` whenever
//! connections are on, and with merging alone the sum is the same one without the terms of connections. `eta` is
//! `n π r²`, the number of light paths times the merging area; the report writes `ηVCM`.
//!
//! Merging may be restricted to vertices that light reaches from a surface that can focus it. The camera's walk learns
//! only at the next vertex whether that is so; what the merge would add waits in `pending` until then.
//!
//! Densities of Russian roulette are left out of all weights alike: they sum to one all the same.

/// Partial sums of one end of a sub-path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mis {
    pub dvcm: f64,
    pub dvc: f64,
    pub pending: f64,
}

impl Mis {
    /// Takes the edge to the next vertex: `dist_sq` is 1 where the density of the vertex before is already one of parallel
    /// rays, `cos` that of the edge to the normal of the vertex reached.
    #[inline]
    pub fn arrive(&mut self, dist_sq: f64, cos: f64) {
        let inv = 1.0 / cos;
        self.dvcm *= dist_sq * inv;
        self.dvc *= inv;
        self.pending *= inv;
    }

    /// Decides about merging at the vertex before.
    #[inline]
    pub fn resolve(&mut self, merge: bool) {
        if merge {
            self.dvc += self.pending;
        }
        self.pending = 0.0;
    }

    /// Scatters with the densities `fwd` of the direction taken and `rev` of the way back. `connect` is 1 when vertices
    /// are connected; `now` is `eta` when this vertex can be merged, `later` when that depends on the next vertex.
    #[inline]
    pub fn scatter(&mut self, cos_out: f64, (fwd, rev): (f64, f64), connect: f64, (now, later): (f64, f64)) {
        let a = cos_out / fwd;
        self.dvc = a * (self.dvc * rev + connect * self.dvcm + now);
        self.pending = a * later;
        self.dvcm = 1.0 / fwd;
    }

    /// Scatters by a discrete choice; `ratio` is the density of the way back over that of the way taken, times the
    /// cosine of the direction taken: `cos θᵢₙ P(back) / (P(taken) η²)`.
    #[inline]
    pub fn scatter_delta(&mut self, ratio: f64) {
        self.dvc *= ratio;
        self.dvcm = 0.0;
    }
}

/// Weight of a path whose other techniques have `sum` times its density.
#[inline]
pub fn weight(sum: f64) -> f64 {
    1.0 / (1.0 + sum)
}

/// What the camera's side of a camera path that meets a light adds: `direct` is the density of light sampling per area
/// and `emit` that of emission, both with the probability of picking the light (per steradian on environments).
#[inline]
pub fn emitter_hit(camera: &Mis, direct: f64, emit: f64) -> f64 {
    direct * camera.dvcm + emit * camera.dvc
}

/// What one side of a connection adds: `pdf_a` is the density with which the other side would have sampled this vertex,
/// `rev` that of continuing to the vertex before it, `merge` is `eta` when this vertex can be merged. Next-event estimation
/// and connections to the camera are connections whose other end is given by its density.
#[inline]
pub fn side(this: &Mis, pdf_a: f64, rev: f64, merge: f64) -> f64 {
    pdf_a * (merge + this.dvcm + this.dvc * rev)
}

/// What one side of a merge adds: `rev` is the density of continuing to the vertex before the merged one.
#[inline]
pub fn merged_side(this: &Mis, rev: f64, connect: f64, eta: f64) -> f64 {
    (connect * this.dvcm + this.dvc * rev) / eta
}
