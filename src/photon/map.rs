//! The balanced photon map.

use super::build::{self, Key};
use super::packed::{Flags, Photon, storable};
use super::{direction, heap};
use crate::color::{Rgb, rgbe};
use crate::math::{Bounds3, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Slots after the last photon, at infinity, so that a vector load never leaves the arrays.
const PADDING: usize = 64;
/// Levels of the heap's bottom subtrees that queries scan as runs instead of walking down.
const BUCKET_LEVELS: u32 = 6;

/// Sixteen coordinates on one cache line.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
struct Line([f32; 16]);

/// One coordinate of every slot; slot 0 is unused, so that the runs of the heap are aligned.
pub(crate) struct Stream(Vec<Line>);

impl Stream {
    fn new(slots: usize) -> Self {
        Self(vec![Line([f32::INFINITY; 16]); (slots + 1 + PADDING).div_ceil(16)])
    }

    #[inline]
    pub(crate) fn as_slice(&self) -> &[f32] {
        bytemuck::cast_slice(&self.0)
    }

    fn as_mut_slice(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.0)
    }

    fn memory(&self) -> usize {
        self.0.capacity() * size_of::<Line>()
    }
}

/// The plane of an upper node, copied out of the streams so that the walk down touches one place.
#[derive(Clone, Copy)]
pub(crate) struct Split {
    pub at: f32,
    pub axis: u32,
}

/// Photons in the order of a left-balanced heap [Jensen 2001, section 6.1], their twenty bytes kept as separate streams.
///
/// Photons are named by an index from 0 to `len() − 1`, their place in the heap. Child indices are arithmetic; no pointer
/// is stored.
pub struct PhotonMap {
    pub(crate) x: Stream,
    pub(crate) y: Stream,
    pub(crate) z: Stream,
    power: Vec<[u8; 4]>,
    direction: Vec<[u8; 2]>,
    flags: Vec<Flags>,
    pub(crate) splits: Vec<Split>,
    bounds: Bounds3,
    rejected: u64,
    /// Tells a scratch's memory of one map from that of another; never part of a result.
    pub(crate) identity: u64,
}

impl PhotonMap {
    /// Balances photons given in emission order, on rayon's current pool; the result is the same for any thread count.
    ///
    /// Photons whose position is not finite, or beyond 1e18, are left out and counted by [`PhotonMap::rejected`].
    ///
    /// # Panics
    /// With 2³² photons or more: indices are 32 bits wide.
    pub fn build(mut photons: Vec<Photon>) -> Self {
        let given = photons.len();
        photons.retain(|p| storable(Vec3::from_array(p.position)));
        let rejected = (given - photons.len()) as u64;
        assert!(u32::try_from(photons.len()).is_ok(), "a photon map holds at most 2^32 - 1 photons");
        let (keys, axes) = build::balance(&photons);
        let mut map = Self::lay_out(&photons, &keys, &axes);
        map.rejected = rejected;
        map
    }

    /// Copies photons from left-to-right order into the streams' heap order.
    fn lay_out(photons: &[Photon], keys: &[Key], axes: &[u8]) -> Self {
        const CHUNK: usize = 4096;
        let n = photons.len();
        let (mut x, mut y, mut z) = (Stream::new(n), Stream::new(n), Stream::new(n));
        let mut power = vec![[0; 4]; n];
        let mut direction = vec![[0; 2]; n];
        let mut flags = vec![Flags(0); n];
        (x.as_mut_slice()[1..=n].par_chunks_mut(CHUNK))
            .zip(y.as_mut_slice()[1..=n].par_chunks_mut(CHUNK))
            .zip(z.as_mut_slice()[1..=n].par_chunks_mut(CHUNK))
            .zip(power.par_chunks_mut(CHUNK).zip(direction.par_chunks_mut(CHUNK)).zip(flags.par_chunks_mut(CHUNK)))
            .enumerate()
            .for_each(|(chunk, (((x, y), z), ((power, direction), flags)))| {
                for i in 0..x.len() {
                    let rank = heap::rank(chunk * CHUNK + i + 1, n);
                    let photon = &photons[keys[rank].id as usize];
                    [x[i], y[i], z[i]] = keys[rank].p;
                    power[i] = photon.power;
                    direction[i] = photon.direction;
                    flags[i] = photon.flags.with_axis(u16::from(axes[rank]));
                }
            });
        Self::from_streams([x, y, z], power, direction, flags)
    }

    /// A map of streams that are in heap order already.
    fn from_streams([x, y, z]: [Stream; 3], power: Vec<[u8; 4]>, direction: Vec<[u8; 2]>, flags: Vec<Flags>) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let n = flags.len();
        let [xs, ys, zs] = [&x, &y, &z].map(|s| &s.as_slice()[..=n]);
        let upper = 1..Self::first_bucket_of(n);
        let splits = std::iter::once(Split { at: 0.0, axis: 0 })
            .chain(upper.map(|slot| {
                let axis = flags[slot - 1].axis();
                Split { at: [xs, ys, zs][axis][slot], axis: axis as u32 }
            }))
            .collect();
        let bounds = (1..=n).into_par_iter().fold_with(Bounds3::EMPTY, |b, i| b.extend(Vec3::new(xs[i], ys[i], zs[i])));
        let bounds = bounds.reduce(|| Bounds3::EMPTY, Bounds3::union);
        let identity = NEXT.fetch_add(1, Ordering::Relaxed);
        Self { x, y, z, power, direction, flags, splits, bounds, rejected: 0, identity }
    }

    /// A map from photons that are in heap order already, as [`PhotonMap::photon`] gives them; `None` when the order is
    /// not that of a left-balanced heap.
    pub fn from_heap_order(photons: impl ExactSizeIterator<Item = Photon>) -> Option<Self> {
        let n = photons.len();
        let (mut x, mut y, mut z) = (Stream::new(n), Stream::new(n), Stream::new(n));
        let (mut power, mut direction, mut flags) =
            (Vec::with_capacity(n), Vec::with_capacity(n), Vec::with_capacity(n));
        for (i, p) in photons.enumerate().take(n) {
            if !storable(Vec3::from_array(p.position)) || p.flags.axis() > 2 {
                return None;
            }
            [x.as_mut_slice()[i + 1], y.as_mut_slice()[i + 1], z.as_mut_slice()[i + 1]] = p.position;
            power.push(p.power);
            direction.push(p.direction);
            flags.push(p.flags);
        }
        let map = Self::from_streams([x, y, z], power, direction, flags);
        map.is_heap().then_some(map)
    }

    /// True when every photon lies on its side of every plane above it.
    pub(crate) fn is_heap(&self) -> bool {
        // Walk down with the box that the planes above allow; 32 levels at most.
        fn check(map: &PhotonMap, slot: usize, cell: Bounds3) -> bool {
            if slot > map.len() {
                return true;
            }
            let p = map.position((slot - 1) as u32);
            if !cell.contains(p) {
                return false;
            }
            let axis = map.flags[slot - 1].axis();
            let (mut left, mut right) = (cell, cell);
            left.max[axis] = p[axis];
            right.min[axis] = p[axis];
            check(map, 2 * slot, left) && check(map, 2 * slot + 1, right)
        }
        check(self, 1, Bounds3::new(Vec3::NEG_INFINITY, Vec3::INFINITY))
    }

    /// The first slot whose subtree queries scan whole.
    fn first_bucket_of(n: usize) -> usize {
        if n == 0 { 1 } else { 1 << (heap::level(n) + 1).saturating_sub(BUCKET_LEVELS) }
    }

    #[inline]
    pub(crate) fn first_bucket(&self) -> usize {
        self.splits.len()
    }

    /// Number of photons.
    #[inline]
    pub fn len(&self) -> usize {
        self.flags.len()
    }

    #[inline]
    pub fn is_empty(&self) -> bool {
        self.flags.is_empty()
    }

    /// Photons that [`PhotonMap::build`] left out because of their position.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Bytes held, at most 20.5 a photon for maps of more than a few hundred photons.
    pub fn memory(&self) -> usize {
        self.x.memory()
            + self.y.memory()
            + self.z.memory()
            + self.power.capacity() * 4
            + self.direction.capacity() * 2
            + self.flags.capacity() * 2
            + self.splits.capacity() * size_of::<Split>()
    }

    /// Box around all photons.
    pub fn bounds(&self) -> Bounds3 {
        self.bounds
    }

    /// Position of a photon, scene space.
    #[inline]
    pub fn position(&self, index: u32) -> Vec3 {
        let slot = index as usize + 1;
        Vec3::new(self.x.as_slice()[slot], self.y.as_slice()[slot], self.z.as_slice()[slot])
    }

    /// Power of a photon, W (W·m⁻² for [`PhotonClass::Irradiance`](super::PhotonClass::Irradiance)).
    #[inline]
    pub fn power(&self, index: u32) -> Rgb {
        rgbe::unpack(self.power[index as usize])
    }

    /// Unit direction towards where the photon came from.
    #[inline]
    pub fn direction(&self, index: u32) -> Vec3 {
        direction::decode(self.direction[index as usize])
    }

    #[inline]
    pub fn flags(&self, index: u32) -> Flags {
        self.flags[index as usize]
    }

    /// Geometric normal where the photon landed, 3° rms off.
    #[inline]
    pub fn normal(&self, index: u32) -> Vec3 {
        self.flags(index).normal()
    }

    /// True when the photon arrived on the normal's side.
    #[inline]
    pub fn side(&self, index: u32) -> bool {
        self.flags(index).side()
    }

    /// The stored photon.
    #[inline]
    pub fn photon(&self, index: u32) -> Photon {
        let i = index as usize;
        Photon {
            position: self.position(index).to_array(),
            power: self.power[i],
            direction: self.direction[i],
            flags: self.flags[i],
        }
    }

    /// Gives every photon another power, W or W·m⁻²; `power` is called with its index and returns packed bytes.
    pub fn set_power(&mut self, power: impl Fn(u32) -> [u8; 4] + Sync) {
        self.power.par_iter_mut().enumerate().for_each(|(i, p)| *p = power(i as u32));
    }
}

impl std::fmt::Debug for PhotonMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PhotonMap").field("len", &self.len()).field("bounds", &self.bounds).finish_non_exhaustive()
    }
}
