//! Photons on diffuse surfaces, which most are: many of them packed and scattered at once.
//!
//! Field by field in arrays and with selections in place of branches, so that the compiler makes vectors of the loops. Each
//! photon sees the very operations that it would see alone: the bits are the same.

use super::EnergyBalance;
use super::walk::{Flight, Stamp, WAVE, survival};
use crate::bsdf::{DiffuseBsdf, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::{Vec2, Vec3, offset_ray_origin};
use crate::photon::{Level, Photon, PhotonClass, PhotonRecord, Simd, Task};

/// Lanes that a loop does at once.
const WIDTH: usize = 16;

type Lane = [f32; WAVE];

/// A vector or a colour of each lane.
#[derive(Clone, Copy, Debug)]
struct Triples {
    x: Lane,
    y: Lane,
    z: Lane,
}

impl Triples {
    const ZERO: Self = Self { x: [0.0; WAVE], y: [0.0; WAVE], z: [0.0; WAVE] };

    #[inline(always)]
    fn get(&self, i: usize) -> Vec3 {
        Vec3::new(self.x[i], self.y[i], self.z[i])
    }

    #[inline(always)]
    fn set(&mut self, i: usize, v: Vec3) {
        (self.x[i], self.y[i], self.z[i]) = (v.x, v.y, v.z);
    }

    #[inline(always)]
    fn color(&self, i: usize) -> Rgb {
        Rgb::new(self.x[i], self.y[i], self.z[i])
    }

    #[inline(always)]
    fn set_color(&mut self, i: usize, c: Rgb) {
        (self.x[i], self.y[i], self.z[i]) = (c.r, c.g, c.b);
    }
}

/// What is known where a photon has landed.
#[derive(Debug)]
struct Arrivals {
    p: Triples,
    p_err: Triples,
    normal: Triples,
    wo: Triples,
    flux: Triples,
    depth: [u32; WAVE],
    class: [PhotonClass; WAVE],
    mark: [bool; WAVE],
    /// Random bits for packing.
    bits: [u64; WAVE],
    // The diffuse surface: both normals on the side that reflects.
    ns: Triples,
    ng: Triples,
    reflectance: Triples,
    // Random numbers: the direction, and that of the roulette.
    u: [Lane; 2],
    u_roulette: Lane,
}

/// Photons as they are stored, but for their places.
#[derive(Debug)]
struct Packed {
    power: [u32; WAVE],
    /// Direction and flags.
    tail: [u32; WAVE],
    /// 1 if it can be stored.
    fits: [u32; WAVE],
}

/// Where photons go on.
#[derive(Debug)]
struct Departures {
    o: Triples,
    d: Triples,
    /// Flux after scattering, and after Russian roulette.
    scattered: Triples,
    flux: Triples,
    fate: [u32; WAVE],
}

/// Sums of each lane, apart from each other.
#[derive(Debug)]
struct Sums([[f64; WAVE]; 3]);

impl Sums {
    const ZERO: Self = Self([[0.0; WAVE]; 3]);

    fn add_to(&self, total: &mut [f64; 3]) {
        for (t, lanes) in total.iter_mut().zip(&self.0) {
            *t += lanes.iter().sum::<f64>();
        }
    }
}

/// What becomes of a photon, as bits.
#[derive(Clone, Copy)]
pub(super) struct Fate(u32);

impl Fate {
    const GOES_ON: u32 = 1;
    const PLAYED: u32 = 2;
    const NOT_FINITE: u32 = 4;

    /// Survives.
    #[inline(always)]
    pub fn goes_on(self) -> bool {
        self.0 & Self::GOES_ON != 0
    }

    /// Has used its number for the roulette.
    #[inline(always)]
    pub fn played(self) -> bool {
        self.0 & Self::PLAYED != 0
    }

    /// Its flux has left the range of numbers.
    #[inline(always)]
    pub fn is_not_finite(self) -> bool {
        self.0 & Self::NOT_FINITE != 0
    }
}

/// The photons of a wave that have met a diffuse surface, in the order of the wave.
#[derive(Debug)]
pub(super) struct Lanes {
    level: Level,
    len: usize,
    rr_depth: u32,
    /// Where in its wave each is.
    slot: [u8; WAVE],
    arrivals: Arrivals,
    packed: Packed,
    departures: Departures,
    absorbed: Sums,
    roulette: Sums,
}

impl Lanes {
    pub fn new(rr_depth: u32) -> Self {
        let zero = Triples::ZERO;
        Self {
            level: Level::best(),
            len: 0,
            rr_depth,
            slot: [0; WAVE],
            arrivals: Arrivals {
                p: zero,
                p_err: zero,
                normal: zero,
                wo: zero,
                flux: zero,
                depth: [0; WAVE],
                class: [PhotonClass::Global; WAVE],
                mark: [false; WAVE],
                bits: [0; WAVE],
                ns: zero,
                ng: zero,
                reflectance: zero,
                u: [[0.0; WAVE]; 2],
                u_roulette: [0.0; WAVE],
            },
            packed: Packed { power: [0; WAVE], tail: [0; WAVE], fits: [0; WAVE] },
            departures: Departures { o: zero, d: zero, scattered: zero, flux: zero, fate: [0; WAVE] },
            absorbed: Sums::ZERO,
            roulette: Sums::ZERO,
        }
    }

    #[inline(always)]
    pub fn len(&self) -> usize {
        self.len
    }

    #[inline(always)]
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Takes the photon at `slot` of the wave, which has met a surface. Draws its random numbers but for that of the
    /// roulette: whether it will be used is not known yet.
    #[inline(always)]
    pub fn push(&mut self, slot: usize, flight: &mut Flight, si: &SurfaceInteraction, bsdf: &DiffuseBsdf) {
        let (i, a) = (self.len, &mut self.arrivals);
        self.len += 1;
        self.slot[i] = slot as u8;
        a.p.set(i, si.p);
        a.p_err.set(i, si.p_err);
        a.normal.set(i, si.ng);
        a.wo.set(i, si.wo);
        a.flux.set_color(i, flight.flux);
        let Stamp { class, mark, bits } = flight.stamp();
        (a.depth[i], a.class[i], a.mark[i], a.bits[i]) = (flight.depth, class, mark, bits);
        a.ns.set(i, bsdf.ns());
        a.ng.set(i, bsdf.ng());
        a.reflectance.set_color(i, bsdf.reflectance());
        let (_, u) = (flight.sampler.next_1d(), flight.sampler.next_2d());
        let mut ahead = flight.sampler;
        (a.u[0][i], a.u[1][i], a.u_roulette[i]) = (u.x, u.y, ahead.next_1d());
    }

    /// Packs and scatters all of them.
    pub fn run(&mut self) {
        self.level.run(Step(self));
    }

    /// Where in the wave photon `i` is.
    #[inline(always)]
    pub fn slot(&self, i: usize) -> usize {
        self.slot[i] as usize
    }

    /// Photon `i` as it is stored, with its power in its largest channel; `None` if it cannot be.
    #[inline(always)]
    pub fn photon(&self, i: usize) -> Option<(Photon, f32)> {
        let (packed, a) = (&self.packed, &self.arrivals);
        let photon = Photon::from_words(a.p.get(i), [packed.power[i], packed.tail[i]]);
        (packed.fits[i] != 0).then(|| (photon, a.flux.color(i).max_channel()))
    }

    #[inline(always)]
    pub fn fate(&self, i: usize) -> Fate {
        Fate(self.departures.fate[i])
    }

    /// Origin, direction and flux of photon `i`, if it goes on.
    #[inline(always)]
    pub fn next(&self, i: usize) -> (Vec3, Vec3, Rgb) {
        (self.departures.o.get(i), self.departures.d.get(i), self.departures.flux.color(i))
    }

    /// Adds what all photons together have lost.
    pub fn add_to(&self, balance: &mut EnergyBalance) {
        self.absorbed.add_to(&mut balance.absorbed);
        self.roulette.add_to(&mut balance.roulette);
    }
}

/// [`Lanes::run`] for one instruction set.
struct Step<'a>(&'a mut Lanes);

impl Task for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Lanes { len, rr_depth, arrivals, packed, departures, absorbed, roulette, .. } = self.0;
        // Let no photon be left to the end of a loop that is not in vectors; the lanes beyond carry nothing.
        let lanes = len.next_multiple_of(WIDTH).min(WAVE);
        for i in *len..lanes {
            arrivals.flux.set_color(i, Rgb::BLACK);
        }
        pack(arrivals, packed, lanes);
        scatter(arrivals, departures, *rr_depth, lanes);
        add_losses(absorbed, &arrivals.flux, &departures.scattered, lanes);
        add_losses(roulette, &departures.scattered, &departures.flux, lanes);
    }
}

#[inline(always)]
fn pack(a: &Arrivals, out: &mut Packed, lanes: usize) {
    assert!(lanes <= WAVE);
    for i in 0..lanes {
        let (wi, normal) = (a.wo.get(i), a.normal.get(i));
        let record = PhotonRecord {
            p: a.p.get(i),
            power: a.flux.color(i),
            wi,
            normal,
            side: wi.dot(normal) > 0.0,
            class: a.class[i],
            mark: a.mark[i],
        };
        let (words, fits) = match Photon::pack_words(&record, a.bits[i]) {
            Ok(words) => (words, 1),
            Err(_) => ([0; 2], 0),
        };
        (out.power[i], out.tail[i], out.fits[i]) = (words[0], words[1], fits);
    }
}

/// As `Deposit::scatter`.
#[inline(always)]
fn scatter(a: &Arrivals, out: &mut Departures, rr_depth: u32, lanes: usize) {
    assert!(lanes <= WAVE);
    for i in 0..lanes {
        let bsdf = DiffuseBsdf::new(a.ns.get(i), a.ng.get(i), a.reflectance.color(i));
        let before = a.flux.color(i);
        let sample = bsdf.sample(a.wo.get(i), Vec2::new(a.u[0][i], a.u[1][i]), Mode::Importance);
        let (d, weight) = sample.map_or((Vec3::ZERO, Rgb::BLACK), |s| (s.wi, s.weight));
        let scattered = before * weight;
        let finite = scattered.is_finite();
        let scattered = if finite { scattered } else { Rgb::BLACK };
        // Russian roulette.
        let survive = survival(scattered.max_channel() / before.max_channel(), a.depth[i], rr_depth);
        let alive = !scattered.is_black();
        let played = alive & (survive < 1.0);
        let goes_on = alive & (!played | (a.u_roulette[i] < survive));
        let gained = if played { scattered / survive } else { scattered };
        let flux = if goes_on { gained } else { Rgb::BLACK };
        out.scattered.set_color(i, scattered);
        out.flux.set_color(i, flux);
        out.fate[i] = goes_on as u32 * Fate::GOES_ON + played as u32 * Fate::PLAYED + !finite as u32 * Fate::NOT_FINITE;
        out.d.set(i, d);
        out.o.set(i, offset_ray_origin(a.p.get(i), a.p_err.get(i), a.normal.get(i), d));
    }
}

/// Adds `before − after`, subtracted in f64.
#[inline(always)]
fn add_losses(sums: &mut Sums, before: &Triples, after: &Triples, lanes: usize) {
    let channels = [(&before.x, &after.x), (&before.y, &after.y), (&before.z, &after.z)];
    for (sum, (before, after)) in sums.0.iter_mut().zip(channels) {
        for ((s, b), a) in sum[..lanes].iter_mut().zip(&before[..lanes]).zip(&after[..lanes]) {
            *s += *b as f64 - *a as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Key, Purpose, Sampler, Sequence, warp};

    /// What becomes of photons with random surfaces, powers and numbers, all that is computed of them.
    fn run(level: Level, len: usize) -> String {
        let mut lanes = Lanes::new(1);
        (lanes.level, lanes.len) = (level, len);
        let a = &mut lanes.arrivals;
        for i in 0..len {
            let mut s = Sampler::new(Sequence::Independent, Key::new(7, Purpose::Test, 0), i as u64);
            let mut direction = || warp::uniform_sphere(s.next_2d());
            let (normal, bent, wo, p) = (direction(), direction(), direction(), direction());
            let side = if wo.dot(normal) < 0.0 { -normal } else { normal };
            a.p.set(i, p);
            a.p_err.set(i, p.abs() * 1e-6);
            a.normal.set(i, normal);
            a.wo.set(i, wo);
            a.ng.set(i, side);
            a.ns.set(i, (side + 0.5 * bent).normalize());
            a.flux.set_color(i, Rgb::new(s.next_1d(), 1e-3 * s.next_1d(), if i % 3 == 0 { 0.0 } else { 1.0 }));
            a.reflectance.set_color(i, Rgb::new(s.next_1d(), s.next_1d(), if i % 5 == 0 { 1.0 } else { 0.0 }));
            (a.depth[i], a.mark[i]) = (i as u32 % 3, i % 2 == 0);
            a.bits[i] = crate::sample::mix64(s.next_1d().to_bits() as u64);
            (a.u[0][i], a.u[1][i], a.u_roulette[i]) = (s.next_1d(), s.next_1d(), s.next_1d());
        }
        // Powers that cannot be stored or scattered.
        a.flux.set_color(0, Rgb::new(f32::MAX, 1.0, 1.0));
        a.reflectance.set_color(0, Rgb::splat(2.0));
        lanes.run();
        let kept: Vec<_> = (0..len).map(|i| (lanes.photon(i), lanes.departures.fate[i], lanes.next(i))).collect();
        format!("{kept:?} {:?} {:?}", lanes.absorbed, lanes.roulette)
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        for len in [1, 15, 16, 17, WAVE] {
            let results: Vec<String> = Level::available().into_iter().map(|level| run(level, len)).collect();
            assert!(results.iter().all(|r| *r == results[0]), "{len} photons: {results:#?}");
            assert!(results[0].contains("None") && (len == 1 || results[0].contains("Some")));
        }
    }
}
