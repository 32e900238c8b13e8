//! Photons on diffuse surfaces, which most are: many of them packed and scattered at once.
//!
//! Field by field in arrays and with selections in place of branches, so that the compiler makes vectors of the loops. Each
//! photon sees the very operations that it would see alone: the bits are the same.

use arrayvec::ArrayVec;

use super::EnergyBalance;
use super::walk::{Flight, Stamp, WAVE, WalkSettings, rounding_bits, survival};
use crate::bsdf::{DiffuseBsdf, Mode};
use crate::color::Rgb;
use crate::geometry::{SurfaceInteraction, quick_normal, triangle_normal, triangle_point_error, unit_or};
use crate::math::{Vec2, Vec3, offset_ray_origin};
use crate::photon::{Level, Photon, PhotonClass, PhotonRecord, Simd, Task};
use crate::sample::{Key, Streams};

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
    path: [Key; WAVE],
    /// Random bits for packing.
    bits: [u64; WAVE],
    // The diffuse surface: both normals on the side that reflects.
    ns: Triples,
    ng: Triples,
    reflectance: Triples,
    /// 1 where the surface absorbs all and stores nothing.
    black: [u32; WAVE],
    // Random numbers: the direction and that of the roulette, and where they come from.
    streams: Streams<WAVE>,
    u: [Lane; 2],
    u_roulette: Lane,
}

impl Arrivals {
    /// What depends on the surface in lane `i`, which is not a face.
    fn surface(&self, i: usize) -> ([Vec3; 6], Rgb) {
        let vectors = [&self.p, &self.p_err, &self.normal, &self.wo, &self.ns, &self.ng];
        (vectors.map(|v| v.get(i)), self.reflectance.color(i))
    }

    #[inline(always)]
    fn set_surface(&mut self, i: usize, (vectors, reflectance): ([Vec3; 6], Rgb)) {
        let lanes = [&mut self.p, &mut self.p_err, &mut self.normal, &mut self.wo, &mut self.ns, &mut self.ng];
        for (lane, v) in lanes.into_iter().zip(vectors) {
            lane.set(i, v);
        }
        self.reflectance.set_color(i, reflectance);
        self.black[i] = 0;
    }
}

/// A triangle that was hit, of one colour on each side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    pub corners: [Vec3; 3],
    /// Of the second and the third corner.
    pub weights: [f32; 2],
    /// The ray's.
    pub d: Vec3,
    /// Whether the normal is turned.
    pub flipped: bool,
    /// Reflectances of the front and the back; a side without one absorbs all.
    pub colors: [Option<Rgb>; 2],
}

/// The lanes that came as a [`Face`].
#[derive(Debug)]
struct Faces {
    corners: [Triples; 3],
    weights: [Lane; 2],
    d: Triples,
    /// 1, or −1 where the normal is turned; 0 in the lanes of others.
    side: Lane,
    colors: [Triples; 2],
    /// By side: 1 where there is no colour.
    black: [[u32; WAVE]; 2],
    /// 1 where the normal that is computed quickly is good.
    good: [u32; WAVE],
    any: bool,
}

impl Faces {
    // Without `map`, which the compiler may leave a call.
    #[inline(always)]
    fn corners(&self, i: usize) -> [Vec3; 3] {
        [self.corners[0].get(i), self.corners[1].get(i), self.corners[2].get(i)]
    }
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
pub(super) struct Sums<const N: usize>([[f64; N]; 3]);

impl<const N: usize> Sums<N> {
    pub const ZERO: Self = Self([[0.0; N]; 3]);

    #[inline(always)]
    pub fn add(&mut self, i: usize, power: Rgb) {
        for (lanes, p) in self.0.iter_mut().zip(power.to_array()) {
            lanes[i] += p as f64;
        }
    }

    pub fn add_to(&self, total: &mut [f64; 3]) {
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
    const LOST: u32 = 8;

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

    /// Absorbed where nothing is stored.
    #[inline(always)]
    pub fn is_lost(self) -> bool {
        self.0 & Self::LOST != 0
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
    faces: Faces,
    arrivals: Arrivals,
    packed: Packed,
    departures: Departures,
    absorbed: Sums<WAVE>,
    roulette: Sums<WAVE>,
}

impl Lanes {
    pub fn new(walk: &WalkSettings) -> Self {
        let zero = Triples::ZERO;
        Self {
            level: Level::best(),
            len: 0,
            rr_depth: walk.rr_depth,
            slot: [0; WAVE],
            faces: Faces {
                corners: [zero; 3],
                weights: [[0.0; WAVE]; 2],
                d: zero,
                side: [0.0; WAVE],
                colors: [zero; 2],
                black: [[0; WAVE]; 2],
                good: [1; WAVE],
                any: false,
            },
            arrivals: Arrivals {
                p: zero,
                p_err: zero,
                normal: zero,
                wo: zero,
                flux: zero,
                depth: [0; WAVE],
                class: [PhotonClass::Global; WAVE],
                mark: [false; WAVE],
                path: [Key(0); WAVE],
                bits: [0; WAVE],
                ns: zero,
                ng: zero,
                reflectance: zero,
                black: [0; WAVE],
                streams: Streams::new(walk.sequence),
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
        self.faces.any = false;
    }

    /// Takes the photon at `slot` of the wave, which has met a surface.
    #[inline(always)]
    pub fn push(&mut self, slot: usize, flight: &mut Flight, si: &SurfaceInteraction, bsdf: &DiffuseBsdf) {
        let i = self.push_photon(slot, flight);
        self.faces.side[i] = 0.0;
        let vectors = [si.p, si.p_err, si.ng, si.wo, bsdf.ns(), bsdf.ng()];
        self.arrivals.set_surface(i, (vectors, bsdf.reflectance()));
    }

    /// Takes the photon at `slot` of the wave, which has met a face.
    #[inline(always)]
    pub fn push_face(&mut self, slot: usize, flight: &mut Flight, face: &Face) {
        let i = self.push_photon(slot, flight);
        let f = &mut self.faces;
        f.any = true;
        for (lanes, corner) in f.corners.iter_mut().zip(face.corners) {
            lanes.set(i, corner);
        }
        for (lanes, weight) in f.weights.iter_mut().zip(face.weights) {
            lanes[i] = weight;
        }
        f.d.set(i, face.d);
        f.side[i] = if face.flipped { -1.0 } else { 1.0 };
        for (side, color) in face.colors.into_iter().enumerate() {
            f.colors[side].set_color(i, color.unwrap_or(Rgb::BLACK));
            f.black[side][i] = color.is_none() as u32;
        }
    }

    /// Takes what does not depend on the surface; the place of the photon. Moves its stream to the number for the roulette:
    /// whether that will be used is not known yet.
    #[inline(always)]
    fn push_photon(&mut self, slot: usize, flight: &mut Flight) -> usize {
        let (i, a) = (self.len, &mut self.arrivals);
        self.len += 1;
        self.slot[i] = slot as u8;
        a.flux.set_color(i, flight.flux);
        let Stamp { class, mark } = flight.stamp();
        (a.depth[i], a.class[i], a.mark[i], a.path[i]) = (flight.depth, class, mark, flight.path);
        // There is one lobe: the number that chooses it is not needed.
        a.streams.set(i, &flight.sampler.skip(1));
        flight.sampler = flight.sampler.skip(2);
        i
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
        let Lanes { len, rr_depth, faces, arrivals, packed, departures, absorbed, roulette, .. } = self.0;
        // Let no photon be left to the end of a loop that is not in vectors; the lanes beyond carry nothing.
        let lanes = len.next_multiple_of(WIDTH).min(WAVE);
        for i in *len..lanes {
            arrivals.flux.set_color(i, Rgb::BLACK);
        }
        if faces.any {
            // Without conditions; what has not met a face is put back afterwards.
            let mut kept = ArrayVec::<_, WAVE>::new();
            for i in (0..*len).filter(|&i| faces.side[i] == 0.0) {
                kept.push((i, arrivals.surface(i)));
            }
            find_normals(faces, arrivals, *len, lanes);
            meet(faces, arrivals, lanes);
            for &(i, surface) in &kept {
                arrivals.set_surface(i, surface);
            }
        }
        draw(arrivals, lanes);
        pack(arrivals, packed, lanes);
        scatter(arrivals, departures, *rr_depth, lanes);
        add_losses(absorbed, &arrivals.flux, &departures.scattered, lanes);
        add_losses(roulette, &departures.scattered, &departures.flux, lanes);
    }
}

/// The random numbers.
#[inline(always)]
fn draw(a: &mut Arrivals, lanes: usize) {
    assert!(lanes <= WAVE);
    a.streams.draw(lanes, &mut a.u, &mut a.u_roulette);
    for i in 0..lanes {
        a.bits[i] = rounding_bits(a.path[i], a.depth[i]);
    }
}

/// The geometric normals of faces, as in the interaction with a mesh.
#[inline(always)]
fn find_normals(f: &mut Faces, a: &mut Arrivals, len: usize, lanes: usize) {
    assert!(lanes <= WAVE && len <= lanes);
    for i in 0..lanes {
        let (n, good) = quick_normal(f.corners(i));
        a.normal.set(i, f.side[i] * n);
        f.good[i] = good as u32;
    }
    // Needles, which are few.
    for i in (0..len).filter(|&i| f.good[i] == 0 && f.side[i] != 0.0) {
        let n = triangle_normal(f.corners(i));
        a.normal.set(i, f.side[i] * n.unwrap_or_else(|| -f.d.get(i).normalize_or(Vec3::Z)));
    }
}

/// The interactions with faces that have their normals, as with a mesh and its material.
#[inline(always)]
fn meet(f: &Faces, a: &mut Arrivals, lanes: usize) {
    assert!(lanes <= WAVE);
    for i in 0..lanes {
        let tri = f.corners(i);
        let [u, v] = [f.weights[0][i], f.weights[1][i]];
        let (colors, black) = ([f.colors[0].color(i), f.colors[1].color(i)], [f.black[0][i], f.black[1][i]]);
        let b0 = 1.0 - u - v;
        let p = b0 * tri[0] + u * tri[1] + v * tri[2];
        let ng = a.normal.get(i);
        let wo = unit_or(-f.d.get(i), ng);
        let front = wo.dot(ng) > 0.0;
        let facing = if front { ng } else { -ng };
        a.p.set(i, p);
        a.p_err.set(i, triangle_point_error(tri, [b0, u, v], p));
        a.wo.set(i, wo);
        a.ns.set(i, facing);
        a.ng.set(i, facing);
        a.reflectance.set_color(i, if front { colors[0] } else { colors[1] });
        a.black[i] = if front { black[0] } else { black[1] };
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
        let ends = !finite as u32 * Fate::NOT_FINITE + a.black[i] * Fate::LOST;
        out.fate[i] = goes_on as u32 * Fate::GOES_ON + played as u32 * Fate::PLAYED + ends;
        out.d.set(i, d);
        out.o.set(i, offset_ray_origin(a.p.get(i), a.p_err.get(i), a.normal.get(i), d));
    }
}

/// Adds `before − after`, subtracted in f64.
#[inline(always)]
fn add_losses(sums: &mut Sums<WAVE>, before: &Triples, after: &Triples, lanes: usize) {
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
    use crate::sample::{Purpose, Sampler, Sequence, warp};

    /// What becomes of photons with random surfaces, powers and numbers, all that is computed of them.
    fn run(level: Level, sequence: Sequence, len: usize) -> String {
        let mut lanes = Lanes::new(&WalkSettings { max_depth: None, rr_depth: 1, sequence });
        (lanes.level, lanes.len) = (level, len);
        for i in 0..len {
            let a = &mut lanes.arrivals;
            let mut s = Sampler::new(Sequence::Independent, Key::new(7, Purpose::Test, 0), i as u64);
            let [normal, bent, wo, p] = std::array::from_fn(|_| warp::uniform_sphere(s.next_2d()));
            let side = if wo.dot(normal) < 0.0 { -normal } else { normal };
            a.p.set(i, p);
            if i % 4 > 0 {
                // A face, some of them needles, some with a side that absorbs.
                let f = &mut lanes.faces;
                let thin = if i % 7 == 0 { 1e-4 } else { 1.0 };
                let corners = [p, p + bent, p + bent * 0.5 + side * thin];
                corners.iter().zip(&mut f.corners).for_each(|(c, lanes)| lanes.set(i, *c));
                (f.weights[0][i], f.weights[1][i]) = (s.next_1d() * 0.5, s.next_1d() * 0.5);
                f.d.set(i, -wo * if i % 3 == 0 { 2.0 } else { 1.0 });
                f.side[i] = if i % 8 > 3 { -1.0 } else { 1.0 };
                f.colors[0].set_color(i, Rgb::new(s.next_1d(), 1.0, 0.5));
                f.black[1][i] = (i % 5 == 0) as u32;
                f.any = true;
            }
            a.p_err.set(i, p.abs() * 1e-6);
            a.normal.set(i, normal);
            a.wo.set(i, wo);
            a.ng.set(i, side);
            a.ns.set(i, (side + 0.5 * bent).normalize());
            a.flux.set_color(i, Rgb::new(s.next_1d(), 1e-3 * s.next_1d(), if i % 3 == 0 { 0.0 } else { 1.0 }));
            a.reflectance.set_color(i, Rgb::new(s.next_1d(), s.next_1d(), if i % 5 == 0 { 1.0 } else { 0.0 }));
            (a.depth[i], a.mark[i]) = (i as u32 % 3, i % 2 == 0);
            a.path[i] = Key::new(8, Purpose::Test, i as u64);
            a.streams.set(i, &Sampler::new(sequence, a.path[i], 70 + i as u64));
        }
        // Powers that cannot be stored or scattered.
        let a = &mut lanes.arrivals;
        a.flux.set_color(0, Rgb::new(f32::MAX, 1.0, 1.0));
        a.reflectance.set_color(0, Rgb::splat(2.0));
        lanes.run();
        let kept: Vec<_> = (0..len).map(|i| (lanes.photon(i), lanes.departures.fate[i], lanes.next(i))).collect();
        format!("{kept:?} {:?} {:?}", lanes.absorbed, lanes.roulette)
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        for len in [1, 15, 16, 17, WAVE] {
            for sequence in [Sequence::Independent, Sequence::Sobol] {
                let results: Vec<String> =
                    Level::available().into_iter().map(|level| run(level, sequence, len)).collect();
                assert!(results.iter().all(|r| *r == results[0]), "{len} photons: {results:#?}");
                assert!(results[0].contains("None") && (len == 1 || results[0].contains("Some")));
            }
        }
    }
}
