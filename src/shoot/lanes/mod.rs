//! Photons on surfaces that are plain, which most are: many of them are scattered at once, and packed where they may be stored.
//!
//! Field by field in arrays and with selections in place of branches, so that the compiler makes vectors of the loops. Each
//! photon sees the very operations that it would see alone: the bits are the same.

mod diffuse;
mod faces;
mod interfaces;
mod metals;
mod records;
#[cfg(test)]
mod tests;

pub(super) use diffuse::DiffuseLanes;
pub(super) use faces::Face;
pub(super) use interfaces::InterfaceLanes;
pub(super) use metals::MetalLanes;

use self::faces::Faces;
use super::EnergyBalance;
use super::flight::{Flight, WAVE};
use super::walk::survival;
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::{Vec3, choose, offset_ray_origin};

/// Lanes that a loop does at once.
const WIDTH: usize = 16;

// Places in a wave are kept as bytes.
const _: () = assert!(WAVE <= 256);

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

    /// [`Triples::set`] where `mask` has all its bits set; where it has none, nothing changes.
    #[inline(always)]
    fn set_where(&mut self, mask: u32, i: usize, v: Vec3) {
        let (x, y, z) = (self.x[i], self.y[i], self.z[i]);
        self.set(i, Vec3::new(choose(mask, v.x, x), choose(mask, v.y, y), choose(mask, v.z, z)));
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

/// Photons of a wave at surfaces of one kind, in the order of the wave, and where they go on.
#[derive(Debug)]
pub(super) struct Batch {
    len: usize,
    rr_depth: u32,
    /// Where in its wave each is.
    slot: [u8; WAVE],
    faces: Faces,
    arrivals: Arrivals,
    departures: Departures,
    absorbed: Sums<WAVE>,
    roulette: Sums<WAVE>,
}

/// Where photons have landed.
#[derive(Debug)]
struct Arrivals {
    p: Triples,
    p_err: Triples,
    // The normals on the side that the shape calls outside.
    ng: Triples,
    ns: Triples,
    wo: Triples,
    flux: Triples,
    depth: [u32; WAVE],
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

impl Batch {
    fn new(rr_depth: u32) -> Self {
        let zero = Triples::ZERO;
        Self {
            len: 0,
            rr_depth,
            slot: [0; WAVE],
            faces: Faces::new(),
            arrivals: Arrivals { p: zero, p_err: zero, ng: zero, ns: zero, wo: zero, flux: zero, depth: [0; WAVE] },
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
        self.faces.clear();
    }

    /// Takes the photon at `slot` of the wave, all but the surface that it has met; its lane.
    #[inline(always)]
    fn push(&mut self, slot: usize, flight: &Flight) -> usize {
        let i = self.len;
        self.len += 1;
        self.slot[i] = slot as u8;
        self.arrivals.flux.set_color(i, flight.flux);
        self.arrivals.depth[i] = flight.depth;
        i
    }

    /// Gives the photon in lane `i` its surface.
    #[inline(always)]
    fn set_surface(&mut self, i: usize, si: &SurfaceInteraction) {
        self.faces.skip(i);
        let a = &mut self.arrivals;
        a.p.set(i, si.p);
        a.p_err.set(i, si.p_err);
        a.ng.set(i, si.ng);
        a.ns.set(i, si.ns);
        a.wo.set(i, si.wo);
    }

    /// Finds where on their faces those have landed that met one. Returns the number of lanes to do: no photon is left to the
    /// end of a loop that is not in vectors, and the lanes beyond carry nothing.
    #[inline(always)]
    fn land(&mut self) -> usize {
        let lanes = self.len.next_multiple_of(WIDTH).min(WAVE);
        for i in self.len..lanes {
            self.arrivals.flux.set_color(i, Rgb::BLACK);
        }
        if self.faces.any() {
            self.faces.meet(&mut self.arrivals, self.len, lanes);
        }
        lanes
    }

    /// Sums what the photons have lost.
    #[inline(always)]
    fn account(&mut self, lanes: usize) {
        let (before, Departures { scattered, flux, .. }) = (&self.arrivals.flux, &self.departures);
        add_losses(&mut self.absorbed, before, scattered, lanes);
        add_losses(&mut self.roulette, scattered, flux, lanes);
    }

    /// Moves what all photons together have lost.
    pub fn move_to(&mut self, balance: &mut EnergyBalance) {
        self.absorbed.move_to(&mut balance.absorbed);
        self.roulette.move_to(&mut balance.roulette);
    }

    /// Origin, direction and flux of photon `i`, if it goes on, and what becomes of it.
    #[inline(always)]
    pub fn leaving(&self, i: usize) -> Leaving {
        let d = &self.departures;
        let ray = (d.o.get(i), d.d.get(i));
        Leaving { slot: self.slot[i] as usize, ray, flux: d.flux.color(i), fate: Fate(d.fate[i]) }
    }
}

impl Departures {
    /// Sends the photon in lane `i` on along `d` with `weight` of its flux, unless the roulette ends it, as `Deposit::scatter`
    /// does. `lost` is 1 where it is absorbed and nothing stored.
    #[inline(always)]
    fn leave(&mut self, i: usize, a: &Arrivals, (d, weight): (Vec3, Rgb), lost: u32, u_roulette: f32, rr_depth: u32) {
        let before = a.flux.color(i);
        let scattered = before * weight;
        let finite = scattered.is_finite();
        let scattered = if finite { scattered } else { Rgb::BLACK };
        let survive = survival(scattered.max_channel() / before.max_channel(), a.depth[i], rr_depth);
        let alive = !scattered.is_black();
        let played = alive & (survive < 1.0);
        let goes_on = alive & (!played | (u_roulette < survive));
        let gained = if played { scattered / survive } else { scattered };
        let flux = if goes_on { gained } else { Rgb::BLACK };
        self.scattered.set_color(i, scattered);
        self.flux.set_color(i, flux);
        let ends = !finite as u32 * Fate::NOT_FINITE + lost * Fate::LOST;
        self.fate[i] = goes_on as u32 * Fate::GOES_ON + played as u32 * Fate::PLAYED + ends;
        self.d.set(i, d);
        self.o.set(i, offset_ray_origin(a.p.get(i), a.p_err.get(i), a.ng.get(i), d));
    }
}

/// What becomes of a photon of a batch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaving {
    /// Where in its wave it is.
    pub slot: usize,
    /// Origin, direction and flux, if it goes on.
    pub ray: (Vec3, Vec3),
    pub flux: Rgb,
    pub fate: Fate,
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

    /// Adds to `total`, and starts again at zero.
    pub fn move_to(&mut self, total: &mut [f64; 3]) {
        for (t, lanes) in total.iter_mut().zip(&mut self.0) {
            *t += lanes.iter().sum::<f64>();
            lanes.fill(0.0);
        }
    }
}

/// What becomes of a photon, as bits.
#[derive(Clone, Copy, Debug)]
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
