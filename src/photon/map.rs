//! The balanced photon map.

use super::build::{Balance, Block, Run};
use super::layout::Layout;
use super::packed::{Flags, MAX_COORDINATE, Photon, storable};
use super::simd::Level;
use super::simd_partition::{Extent, ordered, unordered};
use super::{direction, heap};
use crate::color::{Rgb, rgbe};
use crate::math::{Bounds3, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of a cache line.
const LINE: usize = 64;

/// The coordinates of every block: its x, then its y, then its z, on whole cache lines; infinite where no photon is.
///
/// Zeroed memory that asks for no alignment comes from the system as it is, and is not cleared again. On large pages the
/// nodes of a heap, whose places are powers of two apart, would compete for the same sets of the cache.
pub(crate) struct Positions {
    floats: Vec<f32>,
    /// The first on a line of its own.
    first: usize,
    len: usize,
}

impl Positions {
    fn new(layout: &Layout) -> Self {
        Self::zeroed(3 * layout.places())
    }

    fn zeroed(len: usize) -> Self {
        let floats = vec![0.0; len + LINE / size_of::<f32>() - 1];
        let first = floats.as_ptr().align_offset(LINE);
        assert!(first + len <= floats.len(), "a line has sixteen floats");
        Self { floats, first, len }
    }

    #[inline(always)]
    pub(crate) fn as_slice(&self) -> &[f32] {
        &self.floats[self.first..][..self.len]
    }

    fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.floats[self.first..][..self.len]
    }
}

impl Clone for Positions {
    fn clone(&self) -> Self {
        let mut other = Self::zeroed(self.len);
        other.as_mut_slice().copy_from_slice(self.as_slice());
        other
    }
}

/// The upper nodes' positions and axes, by slot, copied out of the streams so that the walk down touches one place; slot 0 is
/// unused.
#[derive(Clone, Default)]
pub(crate) struct Splits {
    positions: Vec<[f32; 3]>,
    axes: Vec<u8>,
}

impl Splits {
    /// Of as many nodes, less one, as there are buckets.
    fn new<'a>(buckets: usize, upper: impl Fn(usize) -> &'a Photon) -> Self {
        let mut splits = Self { positions: vec![[0.0; 3]; buckets], axes: vec![0; buckets] };
        for slot in 1..buckets {
            let photon = upper(slot);
            splits.positions[slot] = photon.position;
            splits.axes[slot] = photon.flags.axis() as u8;
        }
        splits
    }

    #[inline(always)]
    pub fn axis(&self, slot: usize) -> usize {
        self.axes[slot] as usize
    }

    #[inline(always)]
    pub fn position(&self, slot: usize) -> &[f32; 3] {
        &self.positions[slot]
    }

    fn memory(&self) -> usize {
        self.positions.capacity() * size_of::<[f32; 3]>() + self.axes.capacity()
    }
}

/// Photons in a left-balanced heap [Jensen 2001, section 6.1], their twenty bytes kept as separate streams.
///
/// Child indices are arithmetic; no pointer is stored. Photons are named by an index from 0 to `len() − 1`, which says
/// where a photon is kept and means nothing else.
#[derive(Clone)]
pub struct PhotonMap {
    pub(crate) layout: Layout,
    pub(crate) positions: Positions,
    // By place, less one.
    power: Vec<[u8; 4]>,
    /// The flags of all photons, then the bytes of their directions unless the map keeps none.
    tails: Vec<u16>,
    pub(crate) splits: Splits,
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
    pub fn build(photons: Vec<Photon>) -> Self {
        Self::build_with(photons, true)
    }

    /// As [`PhotonMap::build`] for a map that is read only where light from all directions scatters alike: with
    /// `directions` false it keeps none, which saves two bytes a photon.
    pub fn build_with(photons: Vec<Photon>, directions: bool) -> Self {
        Self::build_on(Level::best(), photons, directions)
    }

    /// As [`PhotonMap::build_with`], by an instruction set's loops.
    pub(crate) fn build_on(level: Level, photons: Vec<Photon>, directions: bool) -> Self {
        let mut map = Self::empty(photons.len());
        // The map's arrays are room for the upper levels before they hold what they are for: pages that nobody has touched yet
        // cost a tenth of the time.
        let layout = map.layout;
        let room = Run {
            xyz: &mut bytemuck::cast_slice_mut(map.positions.as_mut_slice())[..3 * layout.n],
            power: &mut map.power,
            rest: bytemuck::cast_slice_mut(&mut map.tails),
        };
        let limits = (ordered(-MAX_COORDINATE), ordered(MAX_COORDINATE));
        let balance = match Balance::upper(level, photons, layout, limits, room) {
            Ok(balance) => balance,
            Err(mut photons) => {
                let given = photons.len();
                photons.retain(|p| storable(Vec3::from_array(p.position)));
                let rejected = given - photons.len();
                map = Self::build_on(level, photons, directions);
                map.rejected = rejected as u64;
                return map;
            }
        };
        let extent = balance.extent;
        if extent != Extent::EMPTY {
            let corner = |v: [i32; 3]| Vec3::from_array(v.map(unordered));
            map.bounds = Bounds3::new(corner(extent.lo), corner(extent.hi));
        }
        if !directions {
            map.tails.truncate(layout.n);
            map.tails.shrink_to_fit();
        }
        let mut blocks = map.blocks();
        let last = blocks.pop().expect("a block");
        blocks.insert(layout.bucket_of_block(layout.buckets - 1), last);
        let (uppers, garbage) = balance.lower(&mut blocks);
        let upper = |slot| &uppers[heap::rank(slot, layout.buckets - 1)];
        let finish = || {
            blocks.par_iter_mut().with_min_len(1 << 10).for_each(|block| {
                if block.number > 0 {
                    block.put(0, upper(block.number));
                }
            });
            Splits::new(layout.buckets, upper)
        };
        let (splits, ()) = rayon::join(finish, || drop(garbage));
        drop(blocks);
        map.splits = splits;
        map
    }

    /// A map of zeros, with directions.
    fn empty(n: usize) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        assert!(u32::try_from(n).is_ok(), "a photon map holds at most 2^32 - 1 photons");
        let layout = Layout::new(n);
        Self {
            layout,
            positions: Positions::new(&layout),
            power: bytemuck::zeroed_vec(n),
            tails: bytemuck::zeroed_vec(2 * n),
            splits: Splits::default(),
            bounds: Bounds3::EMPTY,
            rejected: 0,
            identity: NEXT.fetch_add(1, Ordering::Relaxed),
        }
    }

    /// The blocks in their order.
    fn blocks(&mut self) -> Vec<Block<'_>> {
        let mut blocks = Vec::with_capacity(self.layout.buckets);
        let (flags, directions) = self.tails.split_at_mut(self.layout.n);
        let (mut f, mut d): (&mut [Flags], &mut [[u8; 2]]) =
            (bytemuck::cast_slice_mut(flags), bytemuck::cast_slice_mut(directions));
        let (mut p, mut c) = (self.positions.as_mut_slice(), &mut self.power[..]);
        for number in 0..self.layout.buckets {
            let (start, lanes) = self.layout.block(number);
            let used = lanes.min(self.layout.n + 1 - start) - usize::from(number == 0);
            let (positions, power, direction, flags);
            (positions, p) = p.split_at_mut(3 * lanes);
            (power, c) = c.split_at_mut(used);
            (direction, d) = d.split_at_mut(used.min(d.len()));
            (flags, f) = f.split_at_mut(used);
            blocks.push(Block { number, positions, power, direction, flags });
        }
        blocks
    }

    /// A map from photons in the heap's order, as [`PhotonMap::heap_order`] gives them; `None` when they are not a
    /// left-balanced heap.
    pub fn from_heap_order(photons: &[Photon]) -> Option<Self> {
        if !photons.iter().all(|p| storable(Vec3::from_array(p.position)) && p.flags.axis() < 3) {
            return None;
        }
        let mut map = Self::empty(photons.len());
        let layout = map.layout;
        map.blocks().into_par_iter().with_min_len(64).for_each(|mut block| {
            block.positions.fill(f32::INFINITY);
            let first = usize::from(block.number == 0);
            for lane in first..first + block.power.len() {
                block.put(lane, &photons[layout.slot(block.number, lane) - 1]);
            }
        });
        map.bounds = Bounds3::from_points(photons.iter().map(|p| Vec3::from_array(p.position)));
        map.splits = Splits::new(layout.buckets, |slot| &photons[slot - 1]);
        map.is_heap().then_some(map)
    }

    /// The photons from slot 1 to slot n.
    pub fn heap_order(&self) -> impl Iterator<Item = Photon> + '_ {
        (1..=self.len()).map(|slot| self.photon(self.index_of_slot(slot)))
    }

    /// The index of a slot's photon.
    #[inline]
    pub(crate) fn index_of_slot(&self, slot: usize) -> u32 {
        (self.layout.place(slot) - 1) as u32
    }

    /// The index of a block's lane 0, one below 0 in block 0, which has no photon there, and its coordinates.
    #[inline(always)]
    pub(crate) fn block_positions(&self, block: usize) -> (u32, &[f32]) {
        let (start, lanes) = self.layout.block(block);
        ((start as u32).wrapping_sub(1), &self.positions.as_slice()[3 * start..3 * (start + lanes)])
    }

    /// True when every photon lies on its side of every plane above it.
    pub(crate) fn is_heap(&self) -> bool {
        // Walk down with the box that the planes above allow; 32 levels at most.
        fn check(map: &PhotonMap, slot: usize, cell: Bounds3) -> bool {
            if slot > map.len() {
                return true;
            }
            let index = map.index_of_slot(slot);
            let p = map.position(index);
            if !cell.contains(p) {
                return false;
            }
            let axis = map.flags(index).axis();
            let (mut left, mut right) = (cell, cell);
            left.max[axis] = p[axis];
            right.min[axis] = p[axis];
            check(map, 2 * slot, left) && check(map, 2 * slot + 1, right)
        }
        check(self, 1, Bounds3::new(Vec3::NEG_INFINITY, Vec3::INFINITY))
    }

    /// Number of photons.
    #[inline]
    pub fn len(&self) -> usize {
        self.layout.n
    }

    #[inline]
    pub fn is_empty(&self) -> bool {
        self.layout.n == 0
    }

    /// Photons that [`PhotonMap::build`] left out because of their position.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Bytes held, at most 20.5 a photon for maps of more than a few hundred photons.
    pub fn memory(&self) -> usize {
        size_of_val(self.positions.as_slice())
            + self.power.capacity() * 4
            + self.tails.capacity() * 2
            + self.splits.memory()
    }

    /// Box around all photons.
    pub fn bounds(&self) -> Bounds3 {
        self.bounds
    }

    /// Position of a photon, scene space.
    #[inline]
    pub fn position(&self, index: u32) -> Vec3 {
        let (block, lane) = self.layout.block_and_lane(index as usize + 1);
        let (start, lanes) = self.layout.block(block);
        let at = 3 * start + lane;
        let p = self.positions.as_slice();
        Vec3::new(p[at], p[at + lanes], p[at + 2 * lanes])
    }

    /// Power of a photon, W (W·m⁻² for [`PhotonClass::Irradiance`](super::PhotonClass::Irradiance)).
    #[inline]
    pub fn power(&self, index: u32) -> Rgb {
        rgbe::unpack(self.power[index as usize])
    }

    /// Unit direction towards where the photon came from; the normal on that side in a map that keeps no directions.
    #[inline]
    pub fn direction(&self, index: u32) -> Vec3 {
        match self.tails.get(self.layout.n + index as usize) {
            Some(&bytes) => direction::decode(bytes.to_ne_bytes()),
            None if self.side(index) => self.normal(index),
            None => -self.normal(index),
        }
    }

    #[inline]
    pub fn flags(&self, index: u32) -> Flags {
        Flags(self.tails[index as usize])
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
            direction: self.tails.get(self.layout.n + i).copied().unwrap_or_default().to_ne_bytes(),
            flags: self.flags(index),
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
