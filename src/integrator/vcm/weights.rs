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
//!
//! The balance heuristic makes second moments small. Light paths fall on a pixel by chance, so that their second moment is
//! all variance; that of light sampling is mostly the square of its mean, which does no harm. For light straight from
//! a light, which both find, the light image counts for less than its density [Grittmann, Georgiev, Slusallek and
//! Křivánek 2019, "Variance-aware multiple importance sampling"], by one factor for the whole scene: [`light_image_share`].

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

/// Squared relative deviation of light sampling that is taken for granted: shadows, and how a light's distance and angle
/// change over it. One light gives a share of an eighth by it; from a tenth to a quarter it makes little difference
/// (`benches/RESULTS.md`).
const LIGHT_SAMPLING_VARIANCE: f64 = 1.0 / 7.0;

/// What the light image's density of direct light is multiplied by in weights: variance over second moment of light sampling,
/// which picks light `i` with the probability `pmf(i)`. It is an estimate; weights add up to one with any.
///
/// If each of `n` lights is all there is to see somewhere, picking one of them has the relative variance `n − 1`; `n` is
/// counted by `1 / Σ pmf²`, so that faint ones hardly count.
pub fn light_image_share(pmf: impl Iterator<Item = f64>) -> f64 {
    let lights = 1.0 / pmf.map(|p| p * p).sum::<f64>();
    let variance = lights - 1.0 + LIGHT_SAMPLING_VARIANCE;
    if variance.is_finite() { variance / (1.0 + variance) } else { 1.0 }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_sampling_of_many_lights_is_no_better_than_the_light_image() {
        let of = |pmf: &[f64]| light_image_share(pmf.iter().copied());
        assert!((of(&[1.0]) - 0.125).abs() < 1e-12);
        assert!((of(&[0.5, 0.5]) - 8.0 / 15.0).abs() < 1e-12);
        assert!((of(&[0.0, 1.0]) - 0.125).abs() < 1e-12, "a dark light does not count");
        assert!((0.125..0.25).contains(&of(&[0.95, 0.05])), "nor does a faint one, much: {}", of(&[0.95, 0.05]));
        assert!(of(&[0.001; 1000]) > 0.99);
        assert_eq!(of(&[]), 1.0);
    }
}
