//! Light vertices in a hash grid, for all merges of one radius.

use crate::bsdf::{LobeMask, Mode};
use crate::color::Rgb;
use crate::math::{INV_PI, Vec3};

use super::Recipe;
use super::correlation::{self, Link, Trails};
use super::step::CameraVertex;
use super::weights::{Mis, merged_side, weight};

/// Vertices whose surface is turned further than this (60°) from the camera's vertex are not merged with it.
pub(super) const MIN_NORMAL_COS: f32 = 0.5;

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
    /// Where the links of its path begin among those of its batch.
    pub links: u32,
}

/// Photons sorted by the hash of their cell. A cell is two radii wide, so that a disc meets at most eight.
#[derive(Debug, Default)]
pub(super) struct Grid {
    /// Where each bucket starts; one more at the end.
    starts: Vec<u32>,
    /// Positions and depths apart from the rest: most of what a query looks at it rejects.
    positions: Vec<(Vec3, u32)>,
    photons: Vec<Photon>,
    /// Buckets of the photons, and where they come from, while they are sorted.
    keys: Vec<u32>,
    order: Vec<(u32, u32)>,
    inv_cell: f32,
    radius_sq: f32,
    /// The links of all batches, and where those of each begin.
    links: Vec<Link>,
    first_links: Vec<usize>,
}

impl Grid {
    /// Sorts photons for merges within `radius`, in place of those it held. The order within a bucket is that of `photons`.
    pub fn fill<'a>(&mut self, batches: impl Iterator<Item = &'a [Photon]> + Clone, radius: f32) {
        let count: usize = batches.clone().map(<[Photon]>::len).sum();
        let buckets = count.next_power_of_two().max(1);
        (self.inv_cell, self.radius_sq) = (0.5 / radius, radius * radius);
        self.starts.clear();
        self.starts.resize(buckets + 1, 0);
        // Count, sum and place.
        let mut keys = std::mem::take(&mut self.keys);
        keys.clear();
        keys.extend(batches.clone().flatten().map(|p| self.bucket((p.p * self.inv_cell).floor().as_ivec3())));
        for &k in &keys {
            self.starts[k as usize + 1] += 1;
        }
        for i in 0..buckets {
            self.starts[i + 1] += self.starts[i];
        }
        self.order.clear();
        self.order.resize(count, (0, 0));
        let places =
            batches.clone().enumerate().flat_map(|(b, batch)| (0..batch.len()).map(move |i| (b as u32, i as u32)));
        for (&k, place) in keys.iter().zip(places) {
            self.order[self.starts[k as usize] as usize] = place;
            self.starts[k as usize] += 1;
        }
        // Placing has moved each start to the next one's place.
        self.starts.copy_within(0..buckets, 1);
        self.starts[0] = 0;
        self.keys = keys;
        let slices: Vec<&[Photon]> = batches.collect();
        self.photons.clear();
        self.photons.extend(self.order.iter().map(|&(b, i)| slices[b as usize][i as usize]));
        self.positions.clear();
        self.positions.extend(self.photons.iter().map(|p| (p.p, p.depth)));
    }

    /// Keeps the links of all batches, for weights that are aware of correlation.
    pub fn keep_links<'a>(&mut self, batches: impl Iterator<Item = &'a [Link]>) {
        self.links.clear();
        self.first_links.clear();
        for links in batches {
            self.first_links.push(self.links.len());
            self.links.extend_from_slice(links);
        }
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

    /// Calls `f` with the numbers of the photons within the radius around `p`.
    #[inline]
    fn within(&self, p: Vec3, max_depth: u32, mut f: impl FnMut(usize, f32)) {
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
                    f(j, d_sq);
                }
            }
        }
    }

    /// Weighted flux density of all merges at a camera vertex, to be divided by the number of light paths:
    /// `Σ w f Φ K` with the Epanechnikov kernel `K = 2 (1 − d²/r²) / (π r²)`, W·m⁻²·sr⁻¹.
    ///
    /// Photons count up to `max_depth` edges from the light.
    pub fn merge(&self, recipe: &Recipe, v: &CameraVertex, max_depth: u32) -> Rgb {
        let connect = recipe.connect;
        if let Some(trails) = &v.trails {
            return self.merge_correlated(recipe, v, trails, max_depth);
        }
        if let Some(albedo) = v.bsdf.lambertian(LobeMask::ALL) {
            return self.merge_lambertian(v, albedo, max_depth, connect);
        }
        let mut sum = Rgb::BLACK;
        self.within(v.si.p, max_depth, |j, d_sq| {
            let photon = &self.photons[j];
            if photon.ng.dot(v.si.ng) < MIN_NORMAL_COS {
                return;
            }
            let f = v.bsdf.eval(v.si.wo, photon.wi, Mode::Radiance, LobeMask::ALL);
            if f.is_black() {
                return;
            }
            // The flux came in over the geometric surface that the photon met: the query's may be another facet.
            let cos = photon.wi.dot(photon.ng).abs();
            let fwd = v.bsdf.pdf(v.si.wo, photon.wi, Mode::Radiance, LobeMask::ALL) as f64;
            let rev = v.bsdf.pdf(photon.wi, v.si.wo, Mode::Importance, LobeMask::ALL) as f64;
            let others = merged_side(&photon.mis, fwd, connect, v.merge) + merged_side(v.mis, rev, connect, v.merge);
            let kernel = 1.0 - d_sq / self.radius_sq;
            sum += f * photon.beta * (kernel / cos * weight(others) as f32);
        });
        sum * (2.0 / (std::f32::consts::PI * self.radius_sq))
    }

    /// [`Grid::merge`] with weights that are aware of correlation.
    fn merge_correlated(&self, recipe: &Recipe, v: &CameraVertex, trails: &Trails, max_depth: u32) -> Rgb {
        let mut sum = Rgb::BLACK;
        self.within(v.si.p, max_depth, |j, d_sq| {
            let photon = &self.photons[j];
            let f = v.bsdf.eval(v.si.wo, photon.wi, Mode::Radiance, LobeMask::ALL);
            if photon.ng.dot(v.si.ng) < MIN_NORMAL_COS || f.is_black() {
                return;
            }
            let first = self.first_links[self.order[j].0 as usize] + photon.links as usize;
            let light = &self.links[first..][..photon.depth as usize + 1];
            let others = correlation::merge_sums(recipe, v, trails.camera, light, photon.wi);
            let kernel = (1.0 - d_sq / self.radius_sq) / photon.wi.dot(photon.ng).abs();
            sum += f * photon.beta * (kernel * weight(others) as f32);
        });
        sum * (2.0 / (std::f32::consts::PI * self.radius_sq))
    }

    /// [`Grid::merge`] on a flat Lambertian surface, whose density back to the camera is the same for all photons.
    fn merge_lambertian(&self, v: &CameraVertex, albedo: Rgb, max_depth: u32, connect: f64) -> Rgb {
        let n = if v.si.wo.dot(v.si.ng) < 0.0 { -v.si.ng } else { v.si.ng };
        let camera = merged_side(v.mis, (v.si.wo.dot(n) * INV_PI) as f64, connect, v.merge);
        let mut sum = Rgb::BLACK;
        self.within(v.si.p, max_depth, |j, d_sq| {
            let photon = &self.photons[j];
            let cos = photon.wi.dot(n);
            if cos > 0.0 && photon.ng.dot(v.si.ng) >= MIN_NORMAL_COS {
                let others = merged_side(&photon.mis, (cos * INV_PI) as f64, connect, v.merge) + camera;
                sum += photon.beta * ((1.0 - d_sq / self.radius_sq) * weight(others) as f32);
            }
        });
        sum * albedo * (INV_PI * 2.0 * INV_PI / self.radius_sq)
    }
}
