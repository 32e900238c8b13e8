//! Photons on diffuse surfaces.

use super::faces::Faces;
use super::records::Records;
use super::{Arrivals, Batch, Departures, Face, Lane, Triples};
use crate::bsdf::{DiffuseBsdf, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::{Vec2, Vec3, choose};
use crate::photon::{Level, Photon, Simd, Task};
use crate::sample::Streams;
use crate::shoot::flight::{Flight, WAVE};
use crate::shoot::walk::WalkSettings;

/// The photons of a wave that have met a diffuse surface.
#[derive(Debug)]
pub(in crate::shoot) struct DiffuseLanes {
    level: Level,
    pub batch: Batch,
    records: Records,
    surfaces: Surfaces,
    // Random numbers: the direction and that of the roulette, and where they come from.
    streams: Streams<WAVE>,
    u: [Lane; 2],
    u_roulette: Lane,
}

/// Diffuse surfaces.
#[derive(Debug)]
struct Surfaces {
    // Both normals on the side that reflects.
    ns: Triples,
    ng: Triples,
    reflectance: Triples,
    // Of faces, by side, the front first; 1 where a side absorbs all and stores nothing.
    colors: [Triples; 2],
    black: [[u32; WAVE]; 2],
    /// 1 where the side that is seen does.
    lost: [u32; WAVE],
}

impl DiffuseLanes {
    pub fn new(walk: &WalkSettings) -> Self {
        let zero = Triples::ZERO;
        Self {
            level: Level::best(),
            batch: Batch::new(walk.rr_depth),
            records: Records::new(),
            surfaces: Surfaces {
                ns: zero,
                ng: zero,
                reflectance: zero,
                colors: [zero; 2],
                black: [[0; WAVE]; 2],
                lost: [0; WAVE],
            },
            streams: Streams::new(walk.sequence),
            u: [[0.0; WAVE]; 2],
            u_roulette: [0.0; WAVE],
        }
    }

    #[cfg(test)]
    pub fn set_level(&mut self, level: Level) {
        self.level = level;
    }

    /// Takes the photon at `slot` of the wave, which has met a surface.
    #[inline(always)]
    pub fn push(&mut self, slot: usize, flight: &mut Flight, si: &SurfaceInteraction, bsdf: &DiffuseBsdf) {
        let i = self.push_photon(slot, flight);
        self.batch.set_surface(i, si);
        let s = &mut self.surfaces;
        s.ns.set(i, bsdf.ns());
        s.ng.set(i, bsdf.ng());
        s.reflectance.set_color(i, bsdf.reflectance());
    }

    /// Takes the photon at `slot` of the wave, which has met a face with the reflectances `colors` of the front and the back; a
    /// side without one absorbs all.
    #[inline(always)]
    pub fn push_face(&mut self, slot: usize, flight: &mut Flight, face: &Face, colors: &[Option<Rgb>; 2]) {
        let i = self.push_photon(slot, flight);
        self.batch.faces.set(i, face);
        for (side, color) in colors.iter().enumerate() {
            self.surfaces.colors[side].set_color(i, color.unwrap_or(Rgb::BLACK));
            self.surfaces.black[side][i] = color.is_none() as u32;
        }
    }

    /// Takes what does not depend on the surface; the lane. Moves the photon's stream to the number for the roulette: whether
    /// that will be used is not known yet.
    #[inline(always)]
    fn push_photon(&mut self, slot: usize, flight: &mut Flight) -> usize {
        let i = self.batch.push(slot, flight);
        self.records.set(i, flight);
        // There is one lobe: the number that chooses it is not needed.
        self.streams.set(i, &flight.sampler.skip(1));
        flight.sampler = flight.sampler.skip(2);
        i
    }

    /// Packs and scatters all of them.
    pub fn run(&mut self) {
        self.level.run(Step(self));
    }

    /// Photon `i` as it is stored, with its power in its largest channel; `None` if it cannot be.
    #[inline(always)]
    pub fn photon(&self, i: usize) -> Option<(Photon, f32)> {
        self.records.photon(i, &self.batch.arrivals)
    }
}

impl Surfaces {
    /// Chooses the side that is seen of faces, as their material does.
    #[inline(always)]
    fn choose_sides(&mut self, a: &Arrivals, faces: &Faces, lanes: usize) {
        assert!(lanes <= WAVE);
        for i in 0..lanes {
            let (mask, ng, ns) = (faces.mask(i), a.ng.get(i), a.ns.get(i));
            let front = a.wo.get(i).dot(ng) > 0.0;
            let turn = if front { 1.0 } else { -1.0 };
            self.ns.set_where(mask, i, ns * turn);
            self.ng.set_where(mask, i, ng * turn);
            let (a, b, front) = (self.colors[0].get(i), self.colors[1].get(i), u32::from(front).wrapping_neg());
            let color = Vec3::new(choose(front, a.x, b.x), choose(front, a.y, b.y), choose(front, a.z, b.z));
            self.reflectance.set_where(mask, i, color);
            self.lost[i] = mask & (front & self.black[0][i] | !front & self.black[1][i]);
        }
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
        let bsdf = DiffuseBsdf::new(s.ns.get(i), s.ng.get(i), s.reflectance.color(i));
        let sample = bsdf.sample(a.wo.get(i), Vec2::new(u[0][i], u[1][i]), Mode::Importance);
        let way = sample.map_or((Vec3::ZERO, Rgb::BLACK), |s| (s.wi, s.weight));
        out.leave(i, a, way, s.lost[i], u_roulette[i], rr_depth);
    }
}

/// [`DiffuseLanes::run`] for one instruction set.
struct Step<'a>(&'a mut DiffuseLanes);

impl Task for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let DiffuseLanes { batch, records, surfaces, streams, u, u_roulette, .. } = self.0;
        let lanes = batch.land();
        surfaces.choose_sides(&batch.arrivals, &batch.faces, lanes);
        streams.draw(lanes, u, u_roulette);
        records.pack(&batch.arrivals, lanes);
        let arrivals = (&batch.arrivals, &*surfaces);
        scatter(&mut batch.departures, arrivals, (u, u_roulette), batch.rr_depth, lanes);
        batch.account(lanes);
    }
}
