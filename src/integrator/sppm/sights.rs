//! The points of a pass where photons are read, found before its photons are shot, and which photons they take in.

use rayon::prelude::*;

use super::{KINDS, Sppm};
use crate::bsdf::LobeMask;
use crate::color::Rgb;
use crate::gather::takes_in;
use crate::integrator::CameraSample;
use crate::integrator::lobe_walk::LobeWalk;
use crate::math::{Bounds3, Vec3};
use crate::photon::{Photon, morton_order};
use crate::sample::Sampler;
use crate::scene::Scene;
use crate::tally::Counters;

/// A point where a camera path reads photons.
#[derive(Clone, Copy, Debug)]
pub struct Sighting {
    pub p: Vec3,
    /// Geometric normal.
    pub ng: Vec3,
    /// The side that photons must have arrived on; `None` takes both.
    pub side: Option<bool>,
    /// By kind of photons, scene units.
    pub radius_sq: [f32; KINDS],
}

impl Sppm<'_> {
    /// Adds the points where [`Integrator::li`](crate::integrator::Integrator::li) will read photons for the same sample.
    pub fn sightings(
        &self,
        scene: &Scene,
        sample: &CameraSample,
        sampler: &mut Sampler,
        counters: &mut Counters,
        found: &mut Vec<Sighting>,
    ) {
        let pixel = self.radii.index(sample.pixel);
        let radius_sq = std::array::from_fn(|kind| self.radius_sq(pixel, kind));
        // Lights are of no interest here.
        let walk = LobeWalk { least: None, ..self.settings.walk() };
        walk.radiance(scene, &sample.camera_ray, sampler, counters, |at, sampler, counters| {
            let si = at.si;
            let both = at.bsdf.transmits(LobeMask::SMOOTH_WIDE);
            let side = (!both).then(|| si.wo.dot(si.ng) > 0.0);
            found.push(Sighting { p: si.p, ng: si.ng, side, radius_sq });
            // Where the path goes on, use up the numbers that direct light takes, so that it goes the same way.
            if at.bsdf.lobes().intersects(at.followed) {
                self.direct(scene, at, sampler, counters);
            }
            Rgb::BLACK
        });
    }
}

/// Points of one leaf.
const LEAF: usize = 8;

/// The points of a pass for one kind of photons, in a tree of boxes around the balls in which they read.
///
/// Points are sorted along the Morton curve and cut into leaves of eight; the tree above is complete and has no pointers:
/// node `i` has the children `2i` and `2i + 1`, and the leaves come last.
pub struct Sightings {
    points: Vec<Point>,
    boxes: Vec<Bounds3>,
    leaves: usize,
}

#[derive(Clone, Copy, Debug)]
struct Point {
    p: Vec3,
    radius_sq: f32,
    ng: Vec3,
    side: Option<bool>,
}

impl Sightings {
    /// Those of `sightings` for one kind of photons.
    pub fn new(sightings: &[Sighting], kind: usize) -> Self {
        let places: Vec<Vec3> = sightings.iter().map(|s| s.p).collect();
        let order = morton_order(&places, &Bounds3::from_points(places.iter().copied()));
        let point = |&i: &u32| {
            let s = &sightings[i as usize];
            Point { p: s.p, radius_sq: s.radius_sq[kind], ng: s.ng, side: s.side }
        };
        let points: Vec<Point> = order.par_iter().map(point).collect();
        let leaves = points.len().div_ceil(LEAF).next_power_of_two();
        let mut boxes = vec![Bounds3::EMPTY; 2 * leaves];
        boxes[leaves..].par_iter_mut().zip(points.par_chunks(LEAF)).for_each(|(bounds, points)| {
            *bounds = points.iter().fold(Bounds3::EMPTY, |b, point| {
                let r = Vec3::splat(point.radius_sq.sqrt());
                b.extend(point.p - r).extend(point.p + r)
            });
        });
        for node in (1..leaves).rev() {
            boxes[node] = boxes[2 * node].union(boxes[2 * node + 1]);
        }
        Self { points, boxes, leaves }
    }

    /// Whether a photon adds to the estimate at one of the points at least: it is within the radius, and of the same side of
    /// the same surface.
    pub fn see(&self, photon: &Photon) -> bool {
        let p = Vec3::from_array(photon.position);
        let mut node = 1;
        // Depth first, without a stack: go down to the left, or on to the next node in that order.
        loop {
            let inside = self.boxes[node].contains(p);
            if inside && node < self.leaves {
                node *= 2;
                continue;
            }
            if inside {
                let first = (node - self.leaves) * LEAF;
                let leaf = &self.points[first..(first + LEAF).min(self.points.len())];
                let near = |point: &Point| point.p.distance_squared(p) <= point.radius_sq;
                if leaf.iter().any(|point| near(point) && takes_in(photon.flags, point.side, point.ng)) {
                    return true;
                }
            }
            node += 1;
            node >>= node.trailing_zeros();
            if node == 1 {
                return false;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::photon::{PhotonClass, PhotonRecord};
    use crate::sample::{Key, Purpose, Sequence};

    /// Balls of very different sizes, and photons around them: the tree says what asking every ball says.
    #[test]
    fn the_tree_sees_what_the_points_see() {
        for count in [0, 1, 7, 8, 9, 64, 1000] {
            let mut s = Sampler::new(Sequence::Independent, Key::new(1, Purpose::Test, 0), count);
            let mut place = || Vec3::new(s.next_1d(), s.next_1d(), 0.1 * s.next_1d());
            let sightings: Vec<Sighting> = (0..count)
                .map(|i| {
                    let r = 0.1 * place().x.powi(4);
                    let side = [Some(true), Some(false), None][i as usize % 3];
                    Sighting {
                        p: place(),
                        ng: if i % 2 == 0 { Vec3::Z } else { Vec3::X },
                        side,
                        radius_sq: [r * r, 0.0],
                    }
                })
                .collect();
            let tree = Sightings::new(&sightings, 0);
            let mut seen = 0;
            for i in 0..4000 {
                let (side, normal) = (i % 4 < 2, if i % 2 == 0 { Vec3::Z } else { Vec3::X });
                let class = PhotonClass::Global;
                let power = Rgb::splat(1.0);
                let record = PhotonRecord { p: place(), power, wi: normal, normal, side, class, mark: false };
                let photon = Photon::pack(&record, 0).expect("a good record");
                let expected = sightings
                    .iter()
                    .any(|s| s.p.distance_squared(record.p) <= s.radius_sq[0] && takes_in(photon.flags, s.side, s.ng));
                assert_eq!(tree.see(&photon), expected, "{count} points, photon {i}");
                seen += u32::from(expected);
            }
            assert!(count < 1000 || (200..3800).contains(&seen), "{seen} of 4000 seen");
        }
    }
}
