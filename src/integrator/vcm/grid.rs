//! Light vertices in a hash grid, for all merges of one radius.

use rayon::prelude::*;

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
    /// Batch of each photon, and its number there.
    order: Vec<(u32, u32)>,
    /// The batches while they are sorted.
    pieces: Vec<Piece>,
    /// The number of buckets less one.
    mask: u32,
    inv_cell: f32,
    radius_sq: f32,
    /// The links of all batches, and where those of each begin.
    links: Vec<Link>,
    first_links: Vec<usize>,
}

/// Ranges of buckets that photons are sorted in: two to this power at most.
const RANGE_BITS: u32 = 8;

/// The photons of a batch in order of the ranges that their buckets are in.
#[derive(Debug, Default)]
struct Piece {
    /// Bucket, and number in the batch.
    photons: Vec<(u32, u32)>,
    /// Where each range ends.
    ends: Vec<u32>,
}

impl Piece {
    /// Takes the buckets of a batch; a range has two to the power of `bits` of them.
    fn fill(&mut self, buckets: impl ExactSizeIterator<Item = u32> + Clone, bits: u32, ranges: usize) {
        let mut next = [0; 1 << RANGE_BITS];
        for bucket in buckets.clone() {
            next[(bucket >> bits) as usize] += 1;
        }
        let mut sum = 0;
        for n in &mut next[..ranges] {
            sum += std::mem::replace(n, sum);
        }
        self.photons.resize(buckets.len(), (0, 0));
        for (i, bucket) in buckets.enumerate() {
            let place = &mut next[(bucket >> bits) as usize];
            self.photons[*place as usize] = (bucket, i as u32);
            *place += 1;
        }
        // Placing has moved each start to the range's end.
        self.ends.clear();
        self.ends.extend_from_slice(&next[..ranges]);
    }

    fn range(&self, range: usize) -> &[(u32, u32)] {
        let first = if range == 0 { 0 } else { self.ends[range - 1] };
        &self.photons[first as usize..self.ends[range] as usize]
    }
}

/// A range of buckets with its place in each array of the grid.
struct Part<'a> {
    /// Photons before those of the range.
    first: u32,
    starts: &'a mut [u32],
    order: &'a mut [(u32, u32)],
    photons: &'a mut [Photon],
    positions: &'a mut [(Vec3, u32)],
}

impl Part<'_> {
    /// Brings together what all pieces have of a range: counts, sums and places.
    fn fill(self, pieces: &[Piece], range: usize, batches: &[&[Photon]]) {
        let Self { first, starts, order, photons, positions } = self;
        let mask = starts.len() as u32 - 1;
        starts.fill(0);
        for &(bucket, _) in pieces.iter().flat_map(|p| p.range(range)) {
            starts[(bucket & mask) as usize] += 1;
        }
        let mut sum = first;
        for n in &mut *starts {
            sum += std::mem::replace(n, sum);
        }
        for (batch, piece) in pieces.iter().enumerate() {
            for &(bucket, i) in piece.range(range) {
                let place = &mut starts[(bucket & mask) as usize];
                order[(*place - first) as usize] = (batch as u32, i);
                *place += 1;
            }
        }
        // Placing has moved each start to the next one's place.
        let last = starts.len() - 1;
        starts.copy_within(..last, 1);
        starts[0] = first;
        for ((&(batch, i), photon), position) in order.iter().zip(photons).zip(positions) {
            *photon = batches[batch as usize][i as usize];
            *position = (photon.p, photon.depth);
        }
    }
}

impl Grid {
    /// Sorts photons for merges within `radius`, in place of those it held. The order within a bucket is that of `photons`.
    ///
    /// Each batch is first put in order of ranges of buckets, then each range is brought together from all batches: both on
    /// all threads, and within what a cache holds.
    pub fn fill(&mut self, batches: &[&[Photon]], radius: f32) {
        let count: usize = batches.iter().map(|b| b.len()).sum();
        let buckets = count.next_power_of_two().max(1);
        (self.inv_cell, self.radius_sq) = (0.5 / radius, radius * radius);
        self.mask = buckets as u32 - 1;
        let bits = buckets.trailing_zeros().saturating_sub(RANGE_BITS);
        let (size, ranges) = (1usize << bits, buckets >> bits);
        let mut pieces = std::mem::take(&mut self.pieces);
        pieces.resize_with(batches.len(), Piece::default);
        pieces.par_iter_mut().zip(batches).for_each(|(piece, photons)| {
            let buckets = photons.iter().map(|p| self.bucket((p.p * self.inv_cell).floor().as_ivec3()));
            piece.fill(buckets, bits, ranges);
        });
        // What is there already is written over.
        self.starts.resize(buckets + 1, 0);
        self.starts[buckets] = count as u32;
        self.order.resize(count, (0, 0));
        if let Some(&photon) = batches.iter().find_map(|b| b.first()) {
            self.photons.resize(count, photon);
            self.positions.resize(count, (photon.p, photon.depth));
        } else {
            self.photons.clear();
            self.positions.clear();
        }
        let (mut order, mut photons, mut positions) =
            (&mut self.order[..], &mut self.photons[..], &mut self.positions[..]);
        let mut first = 0;
        let mut parts = Vec::with_capacity(ranges);
        for (range, starts) in self.starts[..buckets].chunks_mut(size).enumerate() {
            let n = pieces.iter().map(|p| p.range(range).len()).sum();
            let part = Part {
                first: first as u32,
                starts,
                order: order.split_off_mut(..n).expect("all pieces together are as long"),
                photons: photons.split_off_mut(..n).expect("as long"),
                positions: positions.split_off_mut(..n).expect("as long"),
            };
            parts.push((range, part));
            first += n;
        }
        parts.into_par_iter().for_each(|(range, part)| part.fill(&pieces, range, batches));
        self.pieces = pieces;
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
        (h ^ (h >> 12)) & self.mask
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Key, Purpose, Sampler, Sequence};

    /// Photons in order of their buckets, and in a bucket of batches and numbers, for grids of one range and of many, empty
    /// batches, and a grid that was larger before.
    #[test]
    fn photons_are_sorted_by_bucket_and_number() {
        let mut grid = Grid::default();
        for (seed, sizes) in [(1u64, &[3000, 0, 5000, 1][..]), (2, &[40, 7]), (3, &[]), (4, &[0, 0]), (5, &[1, 1000])] {
            let mut sampler = Sampler::new(Sequence::default(), Key::new(seed, Purpose::LightPath, 0), 0);
            let mut photon = |i| Photon {
                p: Vec3::new(sampler.next_1d(), sampler.next_1d(), sampler.next_1d()),
                depth: i as u32,
                wi: Vec3::Z,
                ng: Vec3::Z,
                beta: Rgb::WHITE,
                mis: Mis::default(),
                links: 0,
            };
            let batches: Vec<Vec<Photon>> = sizes.iter().map(|&n| (0..n).map(&mut photon).collect()).collect();
            let slices: Vec<&[Photon]> = batches.iter().map(|b| &b[..]).collect();
            grid.fill(&slices, 0.05);
            let mut expected: Vec<(u32, u32, u32)> = Vec::new();
            for (b, batch) in batches.iter().enumerate() {
                let bucket = |p: &Photon| grid.bucket((p.p * grid.inv_cell).floor().as_ivec3());
                expected.extend(batch.iter().enumerate().map(|(i, p)| (bucket(p), b as u32, i as u32)));
            }
            expected.sort_unstable();
            assert_eq!(grid.order, expected.iter().map(|&(_, b, i)| (b, i)).collect::<Vec<_>>());
            for (bucket, ends) in grid.starts.windows(2).enumerate() {
                let inside = &expected[ends[0] as usize..ends[1] as usize];
                assert!(inside.iter().all(|e| e.0 as usize == bucket));
            }
            assert_eq!(*grid.starts.last().unwrap() as usize, expected.len());
            assert_eq!((grid.photons.len(), grid.positions.len()), (expected.len(), expected.len()));
            for ((&(_, b, i), photon), position) in expected.iter().zip(&grid.photons).zip(&grid.positions) {
                let from = &batches[b as usize][i as usize];
                assert_eq!((photon.p, photon.depth, *position), (from.p, from.depth, (from.p, from.depth)));
            }
        }
    }
}
