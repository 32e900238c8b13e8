//! Photons on conductors, smooth and rough.

use super::records::Records;
use super::{Arrivals, Batch, Departures, Face, Lane, Triples};
use crate::bsdf::{LobeMask, Metal, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::{Vec2, Vec3};
use crate::photon::{Level, Photon, Simd, Task};
use crate::sample::Streams;
use crate::shoot::flight::{Flight, WAVE};
use crate::shoot::walk::WalkSettings;

/// The photons of a wave that have met a conductor.
#[derive(Debug)]
pub(in crate::shoot) struct MetalLanes {
    level: Level,
    pub batch: Batch,
    records: Records,
    surfaces: Surfaces,
    class: [LobeMask; WAVE],
    /// Whether one of them may be stored.
    any_wide: bool,
    // Random numbers: the direction and that of the roulette, and where they come from.
    streams: Streams<WAVE>,
    u: [Lane; 2],
    u_roulette: Lane,
}

/// Conductors as [`Metal`] has them.
#[derive(Debug)]
struct Surfaces {
    alpha: Lane,
    eta: Triples,
    k: Triples,
    specular: Triples,
    /// 1 where both sides reflect.
    two_sided: [u32; WAVE],
}

impl MetalLanes {
    pub fn new(walk: &WalkSettings) -> Self {
        let zero = Triples::ZERO;
        Self {
            level: Level::best(),
            batch: Batch::new(walk.rr_depth),
            records: Records::new(),
            surfaces: Surfaces { alpha: [0.0; WAVE], eta: zero, k: zero, specular: zero, two_sided: [0; WAVE] },
            class: [LobeMask::NONE; WAVE],
            any_wide: false,
            streams: Streams::new(walk.sequence),
            u: [[0.0; WAVE]; 2],
            u_roulette: [0.0; WAVE],
        }
    }

    #[cfg(test)]
    pub fn set_level(&mut self, level: Level) {
        self.level = level;
    }

    #[inline(always)]
    pub fn clear(&mut self) {
        self.batch.clear();
        self.any_wide = false;
    }

    /// Takes the photon at `slot` of the wave, which has met a surface.
    #[inline(always)]
    pub fn push(&mut self, slot: usize, flight: &mut Flight, si: &SurfaceInteraction, metal: &(Metal, bool)) {
        let i = self.push_photon(slot, flight, metal);
        self.batch.set_surface(i, si);
    }

    /// Takes the photon at `slot` of the wave, which has met a face.
    #[inline(always)]
    pub fn push_face(&mut self, slot: usize, flight: &mut Flight, face: &Face, metal: &(Metal, bool)) {
        let i = self.push_photon(slot, flight, metal);
        self.batch.faces.set(i, face);
    }

    /// Takes what does not depend on the surface; the lane. Moves the photon's stream to the number for the roulette: whether
    /// that will be used is not known yet.
    #[inline(always)]
    fn push_photon(&mut self, slot: usize, flight: &mut Flight, (metal, two_sided): &(Metal, bool)) -> usize {
        let i = self.batch.push(slot, flight);
        let s = &mut self.surfaces;
        s.alpha[i] = metal.alpha;
        s.eta.set_color(i, metal.eta);
        s.k.set_color(i, metal.k);
        s.specular.set_color(i, metal.specular);
        s.two_sided[i] = *two_sided as u32;
        self.class[i] = metal.class();
        if self.class[i].intersects(LobeMask::SMOOTH_WIDE) {
            self.any_wide = true;
            self.records.set(i, flight);
        }
        // There is one lobe: the number that chooses it is not needed.
        self.streams.set(i, &flight.sampler.skip(1));
        flight.sampler = flight.sampler.skip(2);
        i
    }

    /// Packs those that may be stored, and scatters all of them.
    pub fn run(&mut self) {
        self.level.run(Step(self));
    }

    /// The class of the lobe that photon `i` has met.
    #[inline(always)]
    pub fn class(&self, i: usize) -> LobeMask {
        self.class[i]
    }

    /// Photon `i`, of a lobe that is wide, as it is stored, with its power in its largest channel; `None` if it cannot be.
    #[inline(always)]
    pub fn photon(&self, i: usize) -> Option<(Photon, f32)> {
        self.records.photon(i, &self.batch.arrivals)
    }
}

/// Scatters photons on `surfaces` by the numbers `u`, and `u_roulette` for the roulette.
#[inline(always)]
fn scatter(
    out: &mut Departures,
    (a, surfaces): (&Arrivals, &Surfaces),
    (u, u_roulette): (&[Lane; 2], &Lane),
    rr_depth: u32,
    lanes: usize,
) {
    assert!(lanes <= WAVE);
    for i in 0..lanes {
        let s = surfaces;
        let (alpha, eta, k, specular) = (s.alpha[i], s.eta.color(i), s.k.color(i), s.specular.color(i));
        let (ns, ng, wo) = (a.ns.get(i), a.ng.get(i), a.wo.get(i));
        // Towards the viewer, if the side that is seen reflects at all.
        let back = wo.dot(ng) <= 0.0;
        let lost = back & (s.two_sided[i] == 0);
        let ns = if back { -ns } else { ns };
        let sample =
            Metal { alpha, eta, k, specular }.sample(ns, ng, wo, Vec2::new(u[0][i], u[1][i]), Mode::Importance);
        let (d, weight) = sample.map_or((Vec3::ZERO, Rgb::BLACK), |s| (s.wi, s.weight));
        let weight = if lost { Rgb::BLACK } else { weight };
        out.leave(i, a, (d, weight), lost as u32, u_roulette[i], rr_depth);
    }
}

/// [`MetalLanes::run`] for one instruction set.
struct Step<'a>(&'a mut MetalLanes);

impl Task for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let MetalLanes { batch, records, surfaces, streams, u, u_roulette, any_wide, .. } = self.0;
        let lanes = batch.land();
        streams.draw(lanes, u, u_roulette);
        if *any_wide {
            records.pack(&batch.arrivals, lanes);
        }
        let arrivals = (&batch.arrivals, &*surfaces);
        scatter(&mut batch.departures, arrivals, (u, u_roulette), batch.rr_depth, lanes);
        batch.account(lanes);
    }
}
