//! How much of a density estimate's disc is surface.
//!
//! An estimate divides the photons within its radius by the area of the disc. Where the surface ends inside of the disc,
//! photons can lie in a part of it only, and the estimate is too dark: down to a half at an edge and a quarter in a corner.
//! Probes find that part: short rays straight down on the disc, each of which asks whether a photon could lie there that the
//! estimate would take, by the estimate's own rules (distance, normal, material).

use crate::bsdf::LobeMask;
use crate::geometry::{Ray, SurfaceInteraction};
use crate::math::{Frame, Vec2, Vec3};
use crate::photon::Kernel;
use crate::sample::{Purpose, Sampler};
use crate::scene::Scene;
use crate::tally::Counters;

use super::photons::MIN_NORMAL_COS;

/// Probes for the share of a disc that is surface.
const PROBES: u32 = 8;

/// A share below which there are twice as many.
const LITTLE: f32 = 0.4;

/// Surfaces above each other that a probe looks at.
const LAYERS: u32 = 4;

/// Height over the surface at which one looks for what stands on it, as a share of the distance looked over.
const LIFT: f32 = 1.0 / 16.0;

/// Directions in which [`Patch::clearing`] looks, with every second one at half the distance too.
const DIRECTIONS: u32 = 8;

/// Slope, seen from the middle, up to which a surface goes on smoothly.
const SLOPE: f32 = 0.25;

/// Halvings of the distance between surface and none.
const HALVINGS: u32 = 4;

/// What the distance to an edge may be over that found in one of the directions: cos 22.5°, less what halving leaves.
const BETWEEN_DIRECTIONS: f32 = 0.9;

/// What a surface may count for so that nobody looks below it.
const ENOUGH: f32 = 0.9;

/// Beyond this share of the radius a straight edge leaves less than 1 % of the weight of Epanechnikov's kernel.
const RIM: f32 = 0.85;

/// The least share of a disc that an estimate is divided by.
const LEAST_SHARE: f32 = 0.125;

/// How far a surface goes on around a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearing {
    pub p: Vec3,
    /// No disc of this radius reaches beyond the surface, scene units.
    pub radius: f32,
    /// Something solid stands on the surface nearby: what it covers is not lit.
    pub solids: bool,
}

impl Clearing {
    /// Where nothing is known.
    pub const UNKNOWN: Self = Self { p: Vec3::INFINITY, radius: 0.0, solids: true };

    /// Whether a disc around `p` is surface all over, but for the rim.
    #[inline]
    pub fn holds(&self, p: Vec3, radius: f32) -> bool {
        // What one steps aside, the edge may come nearer.
        RIM * radius + p.distance(self.p) <= self.radius
    }
}

/// The surroundings of a point at which photons are gathered.
pub struct Patch<'a> {
    scene: &'a Scene,
    si: &'a SurfaceInteraction,
    /// Around the normal of the side that photons come from.
    frame: Frame,
    /// Look for solids that stand on the surface.
    solids: bool,
}

impl<'a> Patch<'a> {
    /// Around `si`, on the side that `si.wo` sees. With `solids`, surface under closed opaque things counts as none.
    pub fn new(scene: &'a Scene, si: &'a SurfaceInteraction, solids: bool) -> Self {
        let n = if si.wo.dot(si.ng) < 0.0 { -si.ng } else { si.ng };
        Self { scene, si, frame: Frame::from_normal(n), solids }
    }

    /// The share of the disc of squared radius `r_sq`, weighted by `kernel`, where photons can lie; at most 1.
    ///
    /// `∫ K dA` over the surface is estimated by eight probes, twice as many where little of the disc is left: where one
    /// meets the surface at distance d and tilted by θ, it counts `K(d) / (K(ρ) cos θ)`, with ρ the distance in the tangent
    /// plane, so that curved surfaces have the share that they have. Dividing by it is biased as every quotient of estimates,
    /// by the probes' relative variance, on discs that reach over an edge; with the radius these become few. The numbers are
    /// taken aside from `sampler`.
    pub fn share(&self, kernel: Kernel, r_sq: f32, sampler: &Sampler, counters: &mut Counters) -> f32 {
        let (mut on, mut all) = (0.0, 0.0);
        for (i, mut sampler) in sampler.aside(Purpose::Boundary, 2 * PROBES).enumerate() {
            if i == PROBES as usize && on > LITTLE * all {
                break;
            }
            // Place the probe where the kernel has its weight.
            let u = sampler.next_2d();
            let (s, weight) = kernel.radial(u.x);
            let flat_sq = s * r_sq;
            let at = flat_sq.sqrt() * Vec2::from_angle(std::f32::consts::TAU * u.y);
            all += weight;
            // Take the surface that counts most of those on the way through the ball.
            let half = (r_sq - flat_sq).max(LIFT * LIFT * r_sq).sqrt();
            let flat = kernel.weight(flat_sq, r_sq);
            let mut best = 0.0f32;
            self.probe(at, half, counters, |hit, cosine| {
                let d_sq = hit.p.distance_squared(self.si.p);
                best = best.max(kernel.weight(d_sq, r_sq) / (flat * cosine));
                best > ENOUGH
            });
            on += weight * best;
        }
        if all > 0.0 { (on / all).clamp(LEAST_SHARE, 1.0) } else { 1.0 }
    }

    /// How far the surface certainly goes on, looking as far as `reach`.
    pub fn clearing(&mut self, reach: f32, counters: &mut Counters) -> Clearing {
        let mut clearing = Clearing { p: self.si.p, radius: reach, solids: false };
        // Something may stand on the surface only if one cannot look over all of it.
        self.solids = (0..DIRECTIONS / 2).any(|i| {
            let end = reach * direction(i as f32);
            self.blocked(self.foot(-end), self.foot(end), reach, counters)
        });
        for i in 0..DIRECTIONS {
            self.close_in(reach, direction(i as f32), &mut clearing, counters);
        }
        for i in 0..DIRECTIONS / 2 {
            self.close_in(0.5 * reach, direction(2.0 * i as f32 + 0.5), &mut clearing, counters);
        }
        if clearing.radius < reach {
            clearing.radius *= BETWEEN_DIRECTIONS;
        }
        clearing
    }

    /// Looks for an end of the surface at the distance `far`, and then how near it comes.
    fn close_in(&self, far: f32, towards: Vec2, clearing: &mut Clearing, counters: &mut Counters) {
        let ground = self.ground(far * towards, counters);
        clearing.solids |= ground == Ground::Covered;
        if ground == Ground::Open {
            return;
        }
        // What is no nearer than another end does not matter.
        let (mut near, mut beyond) = (0.0, far.min(clearing.radius));
        if beyond < far && self.ground(beyond * towards, counters) == Ground::Open {
            return;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (near + beyond);
            if self.ground(middle * towards, counters) == Ground::Open { near = middle } else { beyond = middle }
        }
        clearing.radius = clearing.radius.min(near);
    }

    /// What is at a point of the tangent plane.
    fn ground(&self, at: Vec2, counters: &mut Counters) -> Ground {
        let mut ground = Ground::None;
        let half = SLOPE * at.length();
        let covered = self.probe(at, half, counters, |_, _| {
            ground = Ground::Open;
            true
        });
        // The underside of what stands here may have been met before the surface that it touches.
        if ground == Ground::None
            && (covered || self.solids && self.under_a_solid(self.foot(at), at.length(), counters))
        {
            return Ground::Covered;
        }
        ground
    }

    /// Shows to `take` the surfaces that gather photons as the patch does, within `half` of the point `at` of the tangent
    /// plane, with the cosine of their tilt, from above until it is true. Returns whether something solid covers one, which
    /// then is not shown.
    #[inline]
    fn probe(
        &self,
        at: Vec2,
        half: f32,
        counters: &mut Counters,
        mut take: impl FnMut(&SurfaceInteraction, f32) -> bool,
    ) -> bool {
        let n = self.frame.n;
        let foot = self.foot(at);
        let mut ray = Ray { inside: self.si.inside(n), ..Ray::segment(foot + half * n, -n, 2.0 * half) };
        let mut covered = false;
        for _ in 0..LAYERS {
            counters.camera_rays += 1;
            let Some(hit) = self.scene.hit(&mut ray) else { break };
            let hit = self.scene.interaction(&ray, &hit);
            let cosine = hit.ng.dot(self.si.ng);
            if cosine > MIN_NORMAL_COS && self.scene.bsdf(&hit).lobes().intersects(LobeMask::SMOOTH_WIDE) {
                if self.solids && self.under_a_solid(hit.p, at.length(), counters) {
                    covered = true;
                } else if take(&hit, cosine) {
                    break;
                }
            }
            let left = (hit.p - foot).dot(n) + half;
            ray = Ray { tmax: left, ..hit.spawn_ray(-n) };
        }
        covered
    }

    /// A point of the tangent plane.
    #[inline]
    fn foot(&self, at: Vec2) -> Vec3 {
        self.si.p + at.x * self.frame.s + at.y * self.frame.t
    }

    /// Whether something rises between two points that are about `distance` from the middle.
    fn blocked(&self, from: Vec3, to: Vec3, distance: f32, counters: &mut Counters) -> bool {
        counters.shadow_rays += 1;
        self.scene.accel.occluded(&Ray::segment(from + LIFT * distance * self.frame.n, to - from, 1.0))
    }

    /// Whether a closed opaque thing stands between the middle of the patch and the point `p`, about `distance` from it, and
    /// covers `p`: seen from there, its back is overhead, and black.
    fn under_a_solid(&self, p: Vec3, distance: f32, counters: &mut Counters) -> bool {
        let n = self.frame.n;
        if !self.blocked(self.si.p, p, distance, counters) {
            return false;
        }
        counters.camera_rays += 1;
        let mut up = Ray { inside: self.si.inside(n), ..Ray::new(p + LIFT * distance * n, n) };
        self.scene
            .intersect(&mut up)
            .is_some_and(|above| above.wo.dot(above.ng) < 0.0 && self.scene.bsdf(&above).lobes() == LobeMask::NONE)
    }
}

/// One of [`DIRECTIONS`].
fn direction(i: f32) -> Vec2 {
    Vec2::from_angle(i * (std::f32::consts::TAU / DIRECTIONS as f32))
}

/// See [`Patch::ground`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ground {
    /// Photons can lie here.
    Open,
    /// No surface that gathers photons.
    None,
    /// One that a solid stands on.
    Covered,
}

#[cfg(test)]
mod tests;
