//! Light vertices in a hash grid, for all merges of one radius.

use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::{INV_PI, Vec3};

use super::weights::{Mis, merged_side, weight};

/// Vertices whose surface is turned further than this (60°) from the camera's vertex are not merged with it.
const MIN_NORMAL_COS: f32 = 0.5;

/// A light vertex as merging sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Photon {
    pub p: Vec3,
    /// Edges from the light.
    pub depth: u32,
    /// Towards where the light came from.
    pub wi: Vec3,
    pub ng: Vec3,
    /// Flux of the light path, W.
    pub beta: Rgb,
    pub mis: Mis,
}

/// Photons sorted by the hash of their cell. A cell is two radii wide, so that a disc meets at most eight.
#[derive(Debug, Default)]
pub(super) struct Grid {
    /// Where each bucket starts; one more at the end.
    starts: Vec<u32>,
    /// Positions and depths apart from the rest: most of what a query looks at it rejects.
    positions: Vec<(Vec3, u32)>,
    photons: Vec<Photon>,
    inv_cell: f32,
    radius_sq: f32,
}

/// A merge at a camera vertex.
pub(super) struct Query<'a> {
    pub si: &'a SurfaceInteraction,
    pub bsdf: &'a Bsdf,
    pub mis: &'a Mis,
    /// Most edges from the light that fit into the longest path.
    pub max_depth: u32,
    /// 1 when vertices are connected too.
    pub connect: f64,
    pub eta: f64,
}

impl Grid {
    /// Sorts photons for merges within `radius`. The order within a bucket is that of `photons`.
    pub fn build<'a>(batches: impl Iterator<Item = &'a [Photon]> + Clone, radius: f32) -> Self {
        let count: usize = batches.clone().map(<[Photon]>::len).sum();
        let buckets = count.next_power_of_two().max(1);
        let mut grid = Self {
            starts: vec![0; buckets + 1],
            positions: Vec::new(),
            photons: Vec::new(),
            inv_cell: 0.5 / radius,
            radius_sq: radius * radius,
        };
        // Count, sum and place.
        let keys: Vec<u32> =
            batches.clone().flatten().map(|p| grid.bucket((p.p * grid.inv_cell).floor().as_ivec3())).collect();
        for &k in &keys {
            grid.starts[k as usize + 1] += 1;
        }
        for i in 0..buckets {
            grid.starts[i + 1] += grid.starts[i];
        }
        let mut next = grid.starts.clone();
        let mut order = vec![(0u32, 0u32); count];
        let places =
            batches.clone().enumerate().flat_map(|(b, batch)| (0..batch.len()).map(move |i| (b as u32, i as u32)));
        for (&k, place) in keys.iter().zip(places) {
            order[next[k as usize] as usize] = place;
            next[k as usize] += 1;
        }
        let slices: Vec<&[Photon]> = batches.collect();
        grid.photons.extend(order.iter().map(|&(b, i)| slices[b as usize][i as usize]));
        grid.positions.extend(grid.photons.iter().map(|p| (p.p, p.depth)));
        grid
    }

    pub fn is_empty(&self) -> bool {
        self.photons.is_empty()
    }

    #[inline]
    fn bucket(&self, cell: glam::IVec3) -> u32 {
        let h = (cell.x as u32).wrapping_mul(0x8da6_b343)
            ^ (cell.y as u32).wrapping_mul(0xd816_3841)
            ^ (cell.z as u32).wrapping_mul(0xcb1a_b31f);
        // The product leaves the low bits poor.
        let h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
        (h ^ (h >> 12)) & (self.starts.len() as u32 - 2)
    }

    /// Calls `f` with the photons within the radius around `p`.
    #[inline]
    fn within(&self, p: Vec3, max_depth: u32, mut f: impl FnMut(&Photon, f32)) {
        // The eight cells nearest to p; two of them may share a bucket, which counts once.
        let low = (p * self.inv_cell - 0.5).floor().as_ivec3();
        let mut seen = [u32::MAX; 8];
        for i in 0..8usize {
            let corner = glam::IVec3::new((i & 1) as i32, (i >> 1 & 1) as i32, (i >> 2) as i32);
            let bucket = self.bucket(low + corner);
            if seen[..i].contains(&bucket) {
                continue;
            }
            seen[i] = bucket;
            let (first, last) = (self.starts[bucket as usize] as usize, self.starts[bucket as usize + 1] as usize);
            for (j, &(q, depth)) in (first..last).zip(&self.positions[first..last]) {
                let d_sq = p.distance_squared(q);
                if d_sq < self.radius_sq && depth <= max_depth {
                    f(&self.photons[j], d_sq);
                }
            }
        }
    }

    /// Weighted flux density of all merges at a camera vertex, to be divided by the number of light paths:
    /// `Σ w f Φ K` with the Epanechnikov kernel `K = 2 (1 − d²/r²) / (π r²)`, W·m⁻²·sr⁻¹.
    pub fn merge(&self, q: &Query) -> Rgb {
        if let Some(albedo) = q.bsdf.lambertian(LobeMask::ALL) {
            return self.merge_lambertian(q, albedo);
        }
        let mut sum = Rgb::BLACK;
        self.within(q.si.p, q.max_depth, |photon, d_sq| {
            if photon.ng.dot(q.si.ng) < MIN_NORMAL_COS {
                return;
            }
            let f = q.bsdf.eval(q.si.wo, photon.wi, Mode::Radiance, LobeMask::ALL);
            if f.is_black() {
                return;
            }
            // The flux came in over the geometric surface that the photon met: the query's may be another facet.
            let cos = photon.wi.dot(photon.ng).abs();
            let fwd = q.bsdf.pdf(q.si.wo, photon.wi, Mode::Radiance, LobeMask::ALL) as f64;
            let rev = q.bsdf.pdf(photon.wi, q.si.wo, Mode::Importance, LobeMask::ALL) as f64;
            let others = merged_side(&photon.mis, fwd, q.connect, q.eta) + merged_side(q.mis, rev, q.connect, q.eta);
            let kernel = 1.0 - d_sq / self.radius_sq;
            sum += f * photon.beta * (kernel / cos * weight(others) as f32);
        });
        sum * (2.0 / (std::f32::consts::PI * self.radius_sq))
    }

    /// [`Grid::merge`] on a flat Lambertian surface, whose density back to the camera is the same for all photons.
    fn merge_lambertian(&self, q: &Query, albedo: Rgb) -> Rgb {
        let n = if q.si.wo.dot(q.si.ng) < 0.0 { -q.si.ng } else { q.si.ng };
        let camera = merged_side(q.mis, (q.si.wo.dot(n) * INV_PI) as f64, q.connect, q.eta);
        let mut sum = Rgb::BLACK;
        self.within(q.si.p, q.max_depth, |photon, d_sq| {
            let cos = photon.wi.dot(n);
            if cos > 0.0 && photon.ng.dot(q.si.ng) >= MIN_NORMAL_COS {
                let others = merged_side(&photon.mis, (cos * INV_PI) as f64, q.connect, q.eta) + camera;
                sum += photon.beta * ((1.0 - d_sq / self.radius_sq) * weight(others) as f32);
            }
        });
        sum * albedo * (INV_PI * 2.0 * INV_PI / self.radius_sq)
    }
}
