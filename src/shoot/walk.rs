//! One photon path: emission, scattering with Russian roulette, deposits.

use std::mem::take;
use std::ops::Range;

use arrayvec::ArrayVec;

use super::flight::{Flight, Stamp, WAVE, rounding_bits};
use super::lanes::{DiffuseLanes, Face, InterfaceLanes, Leaving, MetalLanes, Sums};
use super::launch::{Departure, Launch};
use super::{AimCounts, EnergyBalance, Guide, Shot};
use crate::accel::{self, Task};
use crate::bsdf::{Bsdf, LobeMask, Mode, Plain};
use crate::color::Rgb;
use crate::geometry::{Hit, Ray, SurfaceInteraction};
use crate::math::{Vec2, Vec3};
use crate::photon::{Photon, PhotonRecord};
use crate::sample::{Key, Numbers, Purpose, Sampler, Sequence};
use crate::scene::Scene;
use crate::tally::Counters;

/// Which photons are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// L S⁺ D: light that reached its first diffuse surface through specular ones only.
    Caustic,
    /// Every photon at a diffuse or glossy surface.
    Global,
    /// As `Global`, without those that have not met a diffuse or glossy surface before (direct light and caustics). Those
    /// bear a [mark](crate::photon::Flags::mark) that left the last such surface by a [narrow](LobeMask::NARROW) lobe.
    Indirect,
}

impl Target {
    /// Its name in files and reports.
    pub fn name(self) -> &'static str {
        match self {
            Target::Caustic => "caustic",
            Target::Global => "global",
            Target::Indirect => "indirect",
        }
    }

    /// The random stream of this kind of photon path.
    pub fn purpose(self) -> Purpose {
        match self {
            Target::Caustic => Purpose::CausticPhoton,
            Target::Global | Target::Indirect => Purpose::Photon,
        }
    }
}

/// Limits of a photon path.
#[derive(Clone, Copy, Debug)]
pub struct WalkSettings {
    /// Longest path in edges from the light; `None` is unlimited.
    pub max_depth: Option<u32>,
    /// Edges after which Russian roulette may end a path.
    pub rr_depth: u32,
    pub sequence: Sequence,
}

/// Edges after which roulette also ends paths that lose nothing, so that light trapped for ever ends too.
pub const MANY_EDGES: u32 = 4096;

/// Probability of survival of such paths at each edge.
const CERTAIN_SURVIVAL: f32 = 1.0 - 1.0 / 65536.0;

/// What rounding leaves of 1. Above it nothing is lost.
const LOSSLESS: f32 = 1.0 - 4.0 * f32::EPSILON;

/// Probability with which Russian roulette lets a path go on that keeps the share `kept` of its power, after `depth` edges.
///
/// Equal to `kept`, so that weights stay as they are. A path that is trapped without loss would never end: it is let go at
/// most 65 536 edges on average after its first 4096. That must not happen to one that loses a little: ended more often than
/// it loses, its weight would grow without bound, and with it the variance where albedos exceed 1 − 2⁻¹⁷.
#[inline(always)]
pub fn survival(kept: f32, depth: u32, rr_depth: u32) -> f32 {
    if depth >= MANY_EDGES && kept >= LOSSLESS {
        CERTAIN_SURVIVAL
    } else if depth >= rr_depth {
        kept.min(1.0)
    } else {
        1.0
    }
}

/// Where a path starts: a light, the numbers it is given, and their density relative to uniform ones, with the
/// probability of the light.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    pub light: usize,
    pub u_pos: Vec2,
    pub u_dir: Vec2,
    pub pdf: f32,
}

/// Triangles that fit into the caches with all that is known about them.
const NEAR_TRIANGLES: u64 = 1 << 15;

/// The photons and tallies of one batch of paths.
#[derive(Debug)]
pub struct Deposit {
    pub photons: Vec<Photon>,
    pub balance: EnergyBalance,
    pub rejected: u64,
    pub counters: Counters,
    /// What the scene file asks to aim at, counted.
    pub aimed: AimCounts,
    /// The number within its batch of the path of each photon stored by [`Deposit::trace_waves`].
    owners: Vec<u32>,
    /// What the photons of each path of a batch sum up to, where that is wanted: their largest channels, W, times the
    /// importance of the shape that the path met first.
    powers: Vec<f64>,
    lanes: Option<Box<Lanes>>,
    target: Target,
    walk: WalkSettings,
    inv_emitted: f32,
}

impl Deposit {
    /// A batch of a shoot that emits `emitted` paths in all.
    pub fn new(target: Target, walk: WalkSettings, emitted: u64) -> Self {
        Self {
            photons: Vec::new(),
            balance: EnergyBalance::default(),
            rejected: 0,
            counters: Counters::default(),
            aimed: AimCounts::default(),
            owners: Vec::new(),
            powers: Vec::new(),
            lanes: None,
            target,
            walk,
            inv_emitted: (1.0 / emitted as f64) as f32,
        }
    }

    /// Takes everything out, as one batch of a shoot; `emitted` is for all batches to say together.
    pub(super) fn take(&mut self) -> Shot {
        Shot {
            photons: take(&mut self.photons),
            emitted: 0,
            balance: take(&mut self.balance),
            rejected: take(&mut self.rejected),
            counters: take(&mut self.counters),
            aimed: take(&mut self.aimed),
        }
    }

    /// Follows photon path `index` from its light to its end. Returns where it started, if it did.
    pub fn trace(&mut self, scene: &Scene, guide: Option<&Guide>, key: Key, index: u64) -> Option<Start> {
        self.trace_with(scene, guide, Sampler::new(self.walk.sequence, key, index), key, index)
    }

    /// As [`Deposit::trace`] by other numbers than the path's own; those that round powers stay the path's.
    pub(super) fn trace_with<N: Numbers>(
        &mut self,
        scene: &Scene,
        guide: Option<&Guide>,
        numbers: N,
        key: Key,
        index: u64,
    ) -> Option<Start> {
        let mut flight = Flight::none(numbers, key);
        let (start, mut flies) = self.emit(scene, guide, key, index, &mut flight)?;
        while flies {
            let hit = scene.hit(&mut flight.ray);
            flies = self.land(scene, &mut flight, hit);
        }
        self.owners.clear();
        Some(start)
    }

    /// Follows the photon paths `indices`, many at a time, with the photons that [`Deposit::trace`] of one after the other
    /// stores, in the same order. Returns how many of all photons here each path and those before it have stored.
    ///
    /// A photon's way from hit to hit is one long chain of steps that depend on each other, and on a large mesh half of their
    /// time is waiting for the triangle that was hit. Many under way at a time wait together.
    pub fn trace_all(&mut self, scene: &Scene, guide: Option<&Guide>, key: Key, indices: Range<u64>) -> Vec<u32> {
        let (before, paths) = (self.photons.len(), (indices.end - indices.start) as usize);
        self.trace_unordered(scene, guide, key, indices);
        let (order, mut ends) = self.order(paths);
        let unordered = self.photons.split_off(before);
        self.photons.extend(order.into_iter().map(|i| unordered[i as usize]));
        ends.iter_mut().for_each(|end| *end += before as u32);
        ends
    }

    /// As [`Deposit::trace_all`], but leaves the photons as they come.
    pub(super) fn trace_unordered(&mut self, scene: &Scene, guide: Option<&Guide>, key: Key, indices: Range<u64>) {
        accel::run(TraceAll { deposit: self, scene, guide, key, indices });
    }

    /// The numbers of the photons that [`Deposit::trace_unordered`] has left of so many `paths`, in the order of these, and where
    /// each path's end.
    pub(super) fn order(&self, paths: usize) -> (Vec<u32>, Vec<u32>) {
        order_by_owner(&self.owners, paths)
    }

    /// As [`Deposit::trace_unordered`]; returns what each path has stored instead: the sum of the largest channels of its photons,
    /// W, times the importance of the shape that it met first.
    pub(super) fn measure_all(&mut self, scene: &Scene, guide: &Guide, key: Key, indices: Range<u64>) -> Vec<f64> {
        self.powers = vec![0.0; (indices.end - indices.start) as usize];
        self.trace_unordered(scene, Some(guide), key, indices);
        take(&mut self.powers)
    }

    /// Follows many paths at a time for one instruction set, and notes the owner of each photon.
    #[inline(always)]
    fn trace_waves(&mut self, scene: &Scene, guide: Option<&Guide>, key: Key, indices: Range<u64>) {
        self.owners.clear();
        let first = indices.start;
        let mut launch = Launch::new(indices);
        let (mut wave, mut len) = ([Flight::none(Sampler::new(self.walk.sequence, key, 0), key); WAVE], WAVE);
        let mut hits = [None; WAVE];
        // Of one batch for the next: what they hold need not be cleared each time.
        let mut lanes = self.lanes.take().unwrap_or_else(|| Box::new(Lanes::new(&self.walk)));
        let far = scene.stats.triangles > NEAR_TRIANGLES;
        let mut ended: ArrayVec<usize, WAVE> = (0..WAVE).rev().collect();
        loop {
            // Let a photon start in the place of each that has ended; close the gaps when there are no more.
            while let Some(&slot) = ended.last() {
                let stream = (self.walk.sequence, key);
                let Some(departure) = launch.next(scene, guide, stream, self.inv_emitted) else { break };
                wave[slot].depart(scene, &departure, (departure.index - first) as u32);
                // Emission has used the first number and the two points behind it.
                wave[slot].sampler = Sampler::new(self.walk.sequence, key, departure.index).skip(3);
                ended.pop();
            }
            ended.sort_unstable();
            while let Some(slot) = ended.pop() {
                len -= 1;
                wave[slot] = wave[len];
            }
            if len == 0 {
                break;
            }
            scene.hit_all(wave[..len].iter_mut().map(|flight| &mut flight.ray), &mut hits[..len]);
            if far {
                scene.geometry.touch(&hits[..len]);
            }
            self.counters.photon_rays += len as u64;
            for (slot, (flight, hit)) in wave[..len].iter_mut().zip(&hits).enumerate() {
                if !self.land_in(scene, flight, hit.as_ref(), slot, &mut lanes) {
                    ended.push(slot);
                }
            }
            let Lanes { diffuse, interfaces, metals, .. } = &mut *lanes;
            diffuse.run();
            for i in 0..diffuse.batch.len() {
                let leaving = diffuse.batch.leaving(i);
                if !self.take_off(scene, &mut wave[leaving.slot], diffuse, i) {
                    ended.push(leaving.slot);
                }
            }
            diffuse.batch.clear();
            if interfaces.batch.len() > 0 {
                interfaces.run();
                for i in 0..interfaces.batch.len() {
                    let leaving = interfaces.batch.leaving(i);
                    if !self.go_on(&mut wave[leaving.slot], &leaving) {
                        ended.push(leaving.slot);
                    }
                }
                interfaces.batch.clear();
            }
            if metals.batch.len() > 0 {
                metals.run();
                for i in 0..metals.batch.len() {
                    let slot = metals.batch.leaving(i).slot;
                    if !self.reflect(scene, &mut wave[slot], metals, i) {
                        ended.push(slot);
                    }
                }
                metals.clear();
            }
        }
        launch.add_to(self);
        lanes.move_to(&mut self.balance);
        self.lanes = Some(lanes);
    }

    /// Starts photon path `index` by the numbers of `flight`, into it: where, and whether its photon is on its way, which one
    /// that carries nothing is not.
    #[inline(always)]
    fn emit<N: Numbers>(
        &mut self,
        scene: &Scene,
        guide: Option<&Guide>,
        key: Key,
        index: u64,
        flight: &mut Flight<N>,
    ) -> Option<(Start, bool)> {
        let sampler = &mut flight.sampler;
        // Emit from a light chosen at random.
        let (u_light, u_pos, u_dir) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
        let start = match guide {
            Some(guide) => guide.start(u_light, u_pos, u_dir)?,
            None => {
                let (light, pdf) = scene.photon_selector.sample(u_light)?;
                Start { light, u_pos, u_dir, pdf }
            }
        };
        let le = scene.lights[start.light].sample_le(&scene.light_context(), start.u_pos, start.u_dir);
        let (o, d, weight) = le.map_or((Vec3::ZERO, Vec3::Z, Rgb::BLACK), |le| (le.ray.o, le.ray.d, le.weight));
        let flux = weight * (self.inv_emitted / start.pdf);
        self.aimed.add_path(&scene.photon_aims, start.light);
        if flux.is_black() {
            return Some((start, false));
        }
        if !flux.is_finite() {
            self.rejected += 1;
            return Some((start, false));
        }
        EnergyBalance::add(&mut self.balance.emitted, flux);
        flight.depart(scene, &Departure { index, path: key.with(index), o, d, flux }, 0);
        Some((start, true))
    }

    /// Stores and scatters a photon where its ray has ended. False when its path ends there.
    #[inline(always)]
    fn land<N: Numbers>(&mut self, scene: &Scene, flight: &mut Flight<N>, hit: Option<Hit>) -> bool {
        self.counters.photon_rays += 1;
        let Some(hit) = hit else {
            EnergyBalance::add(&mut self.balance.escaped, flight.flux);
            return false;
        };
        let si = scene.interaction(&flight.ray, &hit);
        flight.meet(si.shape);
        self.scatter(scene, flight, &si, &scene.bsdf(&si))
    }

    /// As [`Deposit::land`], but leaves plain surfaces to `lanes`, and to [`Deposit::take_off`], [`Deposit::reflect`] and
    /// [`Deposit::go_on`] after them.
    #[inline(always)]
    fn land_in(
        &mut self,
        scene: &Scene,
        flight: &mut Flight,
        hit: Option<&Hit>,
        slot: usize,
        lanes: &mut Lanes,
    ) -> bool {
        let Some(hit) = hit else {
            lanes.escaped.add(slot, flight.flux);
            return false;
        };
        flight.meet(hit.shape);
        let goes_on = !self.is_cut(flight);
        let diffuse_goes_on = goes_on && self.target != Target::Caustic;
        // Caustic photons end on what is not specular.
        let plain = if goes_on { scene.plain_material(hit.shape) } else { None };
        let plain = plain.filter(|plain| match plain {
            Plain::Interface(_) => true,
            Plain::Metal((metal, _)) => diffuse_goes_on || metal.class().intersects(LobeMask::SPECULAR),
            Plain::Diffuse(_) => diffuse_goes_on,
        });
        if let (Some(plain), Some(mesh)) = (plain, scene.geometry.own_mesh(hit)) {
            let face = Face { mesh, prim: hit.prim, weights: [hit.u, hit.v], d: flight.ray.d };
            match plain {
                Plain::Diffuse(colors) => lanes.diffuse.push_face(slot, flight, &face, colors),
                Plain::Interface(interface) => lanes.interfaces.push_face(slot, flight, &face, interface),
                Plain::Metal(metal) => lanes.metals.push_face(slot, flight, &face, metal),
            }
            return true;
        }
        let si = scene.interaction(&flight.ray, hit);
        match plain {
            Some(Plain::Interface(interface)) => {
                lanes.interfaces.push(slot, flight, &si, interface);
                return true;
            }
            Some(Plain::Metal(metal)) => {
                lanes.metals.push(slot, flight, &si, metal);
                return true;
            }
            _ => {}
        }
        let bsdf = scene.bsdf(&si);
        match bsdf {
            Bsdf::Diffuse(diffuse) if diffuse_goes_on => {
                flight.ray.inside = si.near;
                lanes.diffuse.push(slot, flight, &si, &diffuse);
                true
            }
            // A copy, so that the other case needs nothing in memory.
            _ => self.scatter(scene, flight, &{ si }, &bsdf),
        }
    }

    /// Stores and sends on a photon from a diffuse surface. False when its path ends there.
    #[inline(always)]
    fn take_off(&mut self, scene: &Scene, flight: &mut Flight, lanes: &DiffuseLanes, i: usize) -> bool {
        let leaving = lanes.batch.leaving(i);
        if self.wants(flight) && !leaving.fate.is_lost() {
            match lanes.photon(i) {
                Some((photon, power)) => self.keep(scene, photon, power, flight),
                None => self.rejected += 1,
            }
        }
        (flight.specular_chain, flight.scattered, flight.narrow) = (false, true, false);
        self.go_on(flight, &leaving)
    }

    /// Stores, where its lobe is wide, and sends on a photon from a conductor. False when its path ends there.
    #[inline(always)]
    fn reflect(&mut self, scene: &Scene, flight: &mut Flight, lanes: &MetalLanes, i: usize) -> bool {
        let (leaving, class) = (lanes.batch.leaving(i), lanes.class(i));
        if class.intersects(LobeMask::SMOOTH_WIDE) {
            if self.wants(flight) && !leaving.fate.is_lost() {
                match lanes.photon(i) {
                    Some((photon, power)) => self.keep(scene, photon, power, flight),
                    None => self.rejected += 1,
                }
            }
            (flight.specular_chain, flight.scattered) = (false, true);
            flight.narrow = self.target == Target::Indirect && class.intersects(LobeMask::NARROW);
        }
        self.go_on(flight, &leaving)
    }

    /// Sends on a photon that `lanes` have scattered. False when its path ends there.
    #[inline(always)]
    fn go_on(&mut self, flight: &mut Flight, &Leaving { ray: (o, d), flux, fate, .. }: &Leaving) -> bool {
        self.rejected += fate.is_not_finite() as u64;
        if fate.played() {
            flight.sampler.next_1d();
        }
        flight.ray = Ray { inside: flight.ray.inside, ..Ray::new(o, d) };
        flight.flux = flux;
        fate.goes_on()
    }

    /// Whether a path has its full length.
    #[inline(always)]
    fn is_cut<N>(&self, flight: &Flight<N>) -> bool {
        self.walk.max_depth.is_some_and(|d| flight.depth >= d)
    }

    /// Stores and scatters a photon at a surface. False when its path ends there.
    #[inline(never)]
    fn scatter<N: Numbers>(
        &mut self,
        scene: &Scene,
        flight: &mut Flight<N>,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
    ) -> bool {
        let before = flight.flux;
        // Store it where the surface has lobes that photons estimate.
        let lobes = bsdf.lobes();
        if lobes.intersects(LobeMask::SMOOTH_WIDE) && self.wants(flight) {
            self.store(scene, si, flight);
        }
        if self.target == Target::Caustic && !lobes.intersects(LobeMask::SPECULAR) {
            EnergyBalance::add(&mut self.balance.absorbed, before);
            return false;
        }
        if self.is_cut(flight) {
            EnergyBalance::add(&mut self.balance.cut, before);
            return false;
        }
        // Scatter; what a caustic photon loses to diffuse lobes ends there.
        let (mut u_lobe, u) = (flight.sampler.next_1d(), flight.sampler.next_2d());
        let (mask, p) = match self.target {
            Target::Caustic => (LobeMask::SPECULAR, 1.0),
            Target::Global => (LobeMask::ALL, 1.0),
            Target::Indirect => choose_class(bsdf, si.wo, &mut u_lobe),
        };
        let Some(s) = bsdf.sample(si.wo, u_lobe, u, Mode::Importance, mask) else {
            EnergyBalance::add(&mut self.balance.absorbed, before);
            return false;
        };
        let mut flux = before * (s.weight / p);
        if !flux.is_finite() {
            self.rejected += 1;
            EnergyBalance::add(&mut self.balance.absorbed, before);
            return false;
        }
        EnergyBalance::add_loss(&mut self.balance.absorbed, before, flux);
        if flux.is_black() {
            return false;
        }
        if s.lobe.intersects(LobeMask::SMOOTH_WIDE) {
            (flight.specular_chain, flight.scattered) = (false, true);
            flight.narrow = self.target == Target::Indirect && s.lobe.intersects(LobeMask::NARROW);
        }
        // Russian roulette on the largest channel keeps the powers of stored photons alike [Jensen 2001, §5.2].
        let survive = survival(flux.max_channel() / before.max_channel(), flight.depth, self.walk.rr_depth);
        if survive < 1.0 {
            let unlucky = flight.sampler.next_1d() >= survive;
            let after = if unlucky { Rgb::BLACK } else { flux / survive };
            EnergyBalance::add_loss(&mut self.balance.roulette, flux, after);
            if unlucky {
                return false;
            }
            flux = after;
        }
        flight.flux = flux;
        flight.ray = si.spawn_ray(s.wi);
        true
    }

    /// Whether the kind of map being made wants a photon with this history.
    #[inline]
    fn wants<N>(&self, flight: &Flight<N>) -> bool {
        match self.target {
            Target::Caustic => flight.specular_chain && flight.depth > 1,
            Target::Global => true,
            Target::Indirect => flight.scattered,
        }
    }

    #[inline]
    fn store<N>(&mut self, scene: &Scene, si: &SurfaceInteraction, flight: &Flight<N>) {
        let (power, Stamp { class, mark }) = (flight.flux, flight.stamp());
        let side = si.wo.dot(si.ng) > 0.0;
        let record = PhotonRecord { p: si.p, power, wi: si.wo, side, normal: si.ng, class, mark };
        match Photon::pack(&record, rounding_bits(flight.path, flight.depth)) {
            Ok(photon) => self.keep(scene, photon, power.max_channel(), flight),
            Err(_) => self.rejected += 1,
        }
    }

    /// Takes a photon of `flight` whose largest channel is `power`.
    #[inline(always)]
    fn keep<N>(&mut self, scene: &Scene, photon: Photon, power: f32, flight: &Flight<N>) {
        let importance = self.aimed.add_photon(&scene.photon_aims, flight.first);
        if let Some(sum) = self.powers.get_mut(flight.number as usize) {
            *sum += (importance * power) as f64;
        }
        self.photons.push(photon);
        self.owners.push(flight.number);
    }
}

/// The photons of a wave that have met plain surfaces.
#[derive(Debug)]
struct Lanes {
    diffuse: DiffuseLanes,
    interfaces: InterfaceLanes,
    metals: MetalLanes,
    /// What left the scene, by the place in the wave: sums that need not wait for each other.
    escaped: Sums<WAVE>,
}

impl Lanes {
    fn new(walk: &WalkSettings) -> Self {
        Self {
            diffuse: DiffuseLanes::new(walk),
            interfaces: InterfaceLanes::new(walk),
            metals: MetalLanes::new(walk),
            escaped: Sums::ZERO,
        }
    }

    /// Moves what all photons together have lost.
    fn move_to(&mut self, balance: &mut EnergyBalance) {
        for batch in [&mut self.diffuse.batch, &mut self.interfaces.batch, &mut self.metals.batch] {
            batch.move_to(balance);
        }
        self.escaped.move_to(&mut balance.escaped);
    }
}

/// Chooses between the narrow lobes of a surface and its others, where it has both, by their albedos; the probability. Drawn
/// together they would share directions, and nobody could tell which of them a photon left by. What is left of the number
/// is stretched to the whole.
fn choose_class(bsdf: &Bsdf, wo: Vec3, u_lobe: &mut f32) -> (LobeMask, f32) {
    let lobes = bsdf.lobes();
    if !lobes.intersects(LobeMask::NARROW) || !lobes.intersects(!LobeMask::NARROW) {
        return (LobeMask::ALL, 1.0);
    }
    let [narrow, others] = [LobeMask::NARROW, !LobeMask::NARROW].map(|mask| bsdf.albedo(wo, mask).mean());
    let p = narrow / (narrow + others);
    if !(p > 0.0 && p < 1.0) {
        return (LobeMask::ALL, 1.0);
    }
    let (mask, from, p) = if *u_lobe < p { (LobeMask::NARROW, 0.0, p) } else { (!LobeMask::NARROW, p, 1.0 - p) };
    *u_lobe = ((*u_lobe - from) / p).clamp(0.0, 1.0f32.next_down());
    (mask, p)
}

/// [`Deposit::trace_waves`] as work that is compiled for each instruction set.
struct TraceAll<'a> {
    deposit: &'a mut Deposit,
    scene: &'a Scene,
    guide: Option<&'a Guide>,
    key: Key,
    indices: Range<u64>,
}

impl Task for TraceAll<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.deposit.trace_waves(self.scene, self.guide, self.key, self.indices)
    }
}

/// The numbers of photons in the order of the paths that own them, those of one path as they are, and where each path's end.
fn order_by_owner(owners: &[u32], paths: usize) -> (Vec<u32>, Vec<u32>) {
    let mut next = vec![0u32; paths + 1];
    for &o in owners {
        next[o as usize + 1] += 1;
    }
    for i in 1..next.len() {
        next[i] += next[i - 1];
    }
    let mut order = vec![0u32; owners.len()];
    for (i, &o) in owners.iter().enumerate() {
        order[next[o as usize] as usize] = i as u32;
        next[o as usize] += 1;
    }
    next.truncate(paths);
    (order, next)
}
