//! Photons on smooth interfaces between dielectrics.

use super::{Arrivals, Batch, Departures, Face, Lane, Triples};
use crate::bsdf::{Dielectric, Ior, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::Vec3;
use crate::photon::{Level, Simd, Task};
use crate::sample::Streams;
use crate::shoot::flight::{Flight, WAVE};
use crate::shoot::walk::WalkSettings;

/// The photons of a wave that have met a smooth interface.
#[derive(Debug)]
pub(in crate::shoot) struct InterfaceLanes {
    level: Level,
    pub batch: Batch,
    surfaces: Surfaces,
    // Random numbers: that of the lobe and that of the roulette, and where they come from.
    streams: Streams<WAVE>,
    u_lobe: Lane,
    u_roulette: Lane,
}

/// Interfaces as [`Dielectric`] has them.
#[derive(Debug)]
struct Surfaces {
    eta: Lane,
    m: Lane,
    reflectance: Triples,
    transmittance: Triples,
}

impl InterfaceLanes {
    pub fn new(walk: &WalkSettings) -> Self {
        Self {
            level: Level::best(),
            batch: Batch::new(walk.rr_depth),
            surfaces: Surfaces {
                eta: [1.0; WAVE],
                m: [0.0; WAVE],
                reflectance: Triples::ZERO,
                transmittance: Triples::ZERO,
            },
            streams: Streams::new(walk.sequence),
            u_lobe: [0.0; WAVE],
            u_roulette: [0.0; WAVE],
        }
    }

    #[cfg(test)]
    pub fn set_level(&mut self, level: Level) {
        self.level = level;
    }

    /// Takes the photon at `slot` of the wave, which has met a surface.
    #[inline(always)]
    pub fn push(&mut self, slot: usize, flight: &mut Flight, si: &SurfaceInteraction, interface: &Dielectric) {
        let i = self.push_photon(slot, flight, interface);
        self.batch.set_surface(i, si);
    }

    /// Takes the photon at `slot` of the wave, which has met a face.
    #[inline(always)]
    pub fn push_face(&mut self, slot: usize, flight: &mut Flight, face: &Face, interface: &Dielectric) {
        let i = self.push_photon(slot, flight, interface);
        self.batch.faces.set(i, face);
    }

    /// Takes what does not depend on the surface; the lane. Moves the photon's stream to the number for the roulette: whether
    /// that will be used is not known yet.
    #[inline(always)]
    fn push_photon(&mut self, slot: usize, flight: &mut Flight, interface: &Dielectric) -> usize {
        let i = self.batch.push(slot, flight);
        let s = &mut self.surfaces;
        (s.eta[i], s.m[i]) = (interface.ior.eta, interface.ior.m);
        s.reflectance.set_color(i, interface.reflectance);
        s.transmittance.set_color(i, interface.transmittance);
        // The point that lobes with a density take is not needed.
        self.streams.set_numbers(i, &flight.sampler, 1);
        flight.sampler = flight.sampler.skip(2);
        i
    }

    /// Scatters all of them.
    pub fn run(&mut self) {
        self.level.run(Step(self));
    }
}

/// Scatters photons on `surfaces` by the numbers `u_lobe`, and `u_roulette` for the roulette.
#[inline(always)]
fn scatter(
    out: &mut Departures,
    (a, surfaces): (&Arrivals, &Surfaces),
    (u_lobe, u_roulette): (&Lane, &Lane),
    rr_depth: u32,
    lanes: usize,
) {
    assert!(lanes <= WAVE);
    for i in 0..lanes {
        let interface = Dielectric {
            ior: Ior { eta: surfaces.eta[i], m: surfaces.m[i] },
            reflectance: surfaces.reflectance.color(i),
            transmittance: surfaces.transmittance.color(i),
        };
        let sample = interface.sample(a.ns.get(i), a.ng.get(i), a.wo.get(i), u_lobe[i], Mode::Importance);
        let way = sample.map_or((Vec3::ZERO, Rgb::BLACK), |s| (s.wi, s.weight));
        out.leave(i, a, way, 0, u_roulette[i], rr_depth);
    }
}

/// [`InterfaceLanes::run`] for one instruction set.
struct Step<'a>(&'a mut InterfaceLanes);

impl Task for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let InterfaceLanes { batch, surfaces, streams, u_lobe, u_roulette, .. } = self.0;
        let lanes = batch.land();
        streams.draw_numbers(lanes, [u_lobe, u_roulette]);
        let arrivals = (&batch.arrivals, &*surfaces);
        scatter(&mut batch.departures, arrivals, (u_lobe, u_roulette), batch.rr_depth, lanes);
        batch.account(lanes);
    }
}
