//! Balancing: photons in emission order become a left-balanced heap.
//!
//! The median is found by rank, recursively, along the widest extent of the node's own points. Equal coordinates rank in
//! emission order, so that the tree does not depend on the number of threads, and a million photons at the same place are as
//! good as any others. Photons are columns of words; a node's columns lie in one run, and are divided from one array into
//! another and back, in order, so that no photon need remember its index.

use super::heap;
use super::layout::{BLOCK, Layout};
use super::packed::{Flags, Photon};
use super::simd::{Level, Simd, Task};
use super::simd_partition::{Columns, ColumnsMut, Extent, Pivot, Sides, ordered, unordered, widest};
use rayon::prelude::*;

/// Nodes of at least this many photons are balanced as two parallel halves.
const PARALLEL_FROM: usize = 1 << 14;

/// Buckets under a node whose photons, twice, stay in a core's own cache.
const CACHED: usize = 128;

/// Values of a node that bound the search for its median, and nodes from which on they are looked at.
const SAMPLE: usize = 1024;
const SAMPLED_FROM: usize = 4 * SAMPLE;

/// Nodes of at least so many pieces are divided by all threads, a piece at a time.
const PIECES: usize = 4;
/// Photons of a piece at least, and values of such a node that bound the search for its median.
const PIECE: usize = 1 << 17;
const LARGE_SAMPLE: usize = 1 << 13;

/// The photons of one node: x, then y, then z, and the bytes that are only carried along.
pub(crate) struct Run<'a> {
    pub xyz: &'a mut [i32],
    pub power: &'a mut [[u8; 4]],
    pub rest: &'a mut [[u8; 4]],
}

impl<'a> Run<'a> {
    fn new(words: &'a mut [i32]) -> Self {
        let n = words.len() / 5;
        let (xyz, rest) = words.split_at_mut(3 * n);
        let (power, rest) = bytemuck::cast_slice_mut(rest).split_at_mut(n);
        Self { xyz, power, rest }
    }

    fn len(&self) -> usize {
        self.power.len()
    }

    fn columns(&self) -> Columns<'_> {
        let n = self.len();
        let (x, yz) = self.xyz.split_at(n);
        let (y, z) = yz.split_at(n);
        Columns { xyz: [x, y, z], power: self.power, rest: self.rest }
    }

    fn columns_mut(&mut self) -> ColumnsMut<'_> {
        let n = self.len();
        let (x, yz) = self.xyz.split_at_mut(n);
        let (y, z) = yz.split_at_mut(n);
        ColumnsMut { xyz: [x, y, z], power: self.power, rest: self.rest }
    }

    /// The room of the first photons, and that after them.
    fn split(self, at: usize) -> (Run<'a>, Run<'a>) {
        let (xyz, xyz1) = self.xyz.split_at_mut(3 * at);
        let (power, power1) = self.power.split_at_mut(at);
        let (rest, rest1) = self.rest.split_at_mut(at);
        (Run { xyz, power, rest }, Run { xyz: xyz1, power: power1, rest: rest1 })
    }

    /// The rooms of the children of a node.
    fn children(self) -> (Run<'a>, Run<'a>) {
        let middle = heap::left_size(self.len());
        let (left, right) = self.split(middle);
        (left, right.split(1).1)
    }

    fn reborrow(&mut self) -> Run<'_> {
        Run { xyz: self.xyz, power: self.power, rest: self.rest }
    }
}

/// A photon of the columns, with its node's axis.
fn photon(from: &Columns, i: usize, axis: usize) -> Photon {
    let [d0, d1, f0, f1] = from.rest[i];
    Photon {
        position: from.xyz.map(|c| unordered(c[i])),
        power: from.power[i],
        direction: [d0, d1],
        flags: Flags(u16::from_ne_bytes([f0, f1])).with_axis(axis as u16),
    }
}

/// The places of a bucket's block that photons have, and the first of them.
pub(crate) struct Block<'a> {
    pub number: usize,
    /// Its x, y and z, 32 or 64 of each.
    pub positions: &'a mut [f32],
    pub power: &'a mut [[u8; 4]],
    /// Empty in a map that keeps none.
    pub direction: &'a mut [[u8; 2]],
    pub flags: &'a mut [Flags],
}

impl Block<'_> {
    /// Puts a photon into a lane; there is none in lane 0 of block 0.
    #[inline(always)]
    pub fn put(&mut self, lane: usize, photon: &Photon) {
        let lanes = self.positions.len() / 3;
        for a in 0..3 {
            self.positions[lane + a * lanes] = photon.position[a];
        }
        let i = lane - usize::from(self.number == 0);
        (self.power[i], self.flags[i]) = (photon.power, photon.flags);
        if let Some(direction) = self.direction.get_mut(i) {
            *direction = photon.direction;
        }
    }
}

/// What became of a node.
struct Divided {
    left: Extent,
    right: Extent,
    median: Photon,
}

/// Divides a node into two halves and its median.
struct Divide<'a, 'b> {
    from: &'a Columns<'a>,
    to: Run<'b>,
    extent: Extent,
}

impl Task for Divide<'_, '_> {
    type Output = Divided;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Divided {
        let Self { from, to, extent } = self;
        let middle = heap::left_size(from.len());
        let axis = extent.widest();
        let keys = from.xyz[axis];
        let bounds = (extent.lo[axis], extent.hi[axis]);
        let at = median(simd, keys, middle, bounds, to.xyz);
        let pivot = Pivot { axis, at, median: (middle - simd.count_less(keys, at)) as isize };
        let (mut left, mut right) = to.children();
        let Sides { left, right, median } =
            simd.partition(from, pivot, &mut left.columns_mut(), &mut right.columns_mut());
        let median = photon(from, median.expect("the median is in its node"), axis);
        Divided { left, right, median }
    }
}

/// The value of rank `rank`, counted from 0. `bounds` are the smallest and the largest value, `room` is overwritten.
#[inline(always)]
fn median<S: Simd>(simd: S, values: &[i32], rank: usize, bounds: (i32, i32), room: &mut [i32]) -> i32 {
    if values.len() >= SAMPLED_FROM {
        let (lo, hi) = around(simd, values, rank, bounds, &mut [0; SAMPLE]);
        let (below, inside) = simd.collect(values, lo, hi, room);
        if below <= rank && rank < below + inside {
            return ranked(simd, &room[..inside], rank - below, (lo, hi));
        }
    }
    ranked(simd, values, rank, bounds)
}

/// Two values between which that of rank `rank` very probably is, from a sample.
#[inline(always)]
fn around<S: Simd>(simd: S, values: &[i32], rank: usize, bounds: (i32, i32), sample: &mut [i32]) -> (i32, i32) {
    let (n, size) = (values.len(), sample.len());
    for (i, value) in sample.iter_mut().enumerate() {
        *value = values[i * n / size];
    }
    let place = rank * size / n;
    // Three standard deviations of the place are 1.5·√size at most.
    let spread = 3 * size.isqrt() / 2;
    let lo = ranked(simd, sample, place.saturating_sub(spread), bounds);
    (lo, ranked(simd, sample, (place + spread).min(size - 1), bounds))
}

/// The value of rank `rank`: a search between bounds on which counting decides, by interpolation and by halving in turns.
#[inline(always)]
fn ranked<S: Simd>(simd: S, values: &[i32], rank: usize, bounds: (i32, i32)) -> i32 {
    // At most `rank` values are below `lo`, more are below `hi`.
    let (mut lo, mut hi) = (bounds.0, bounds.1 + 1);
    let (mut below_lo, mut below_hi) = (0, values.len());
    for step in 0.. {
        if hi.abs_diff(lo) == 1 {
            break;
        }
        let (a, b) = (unordered(lo), unordered(hi));
        let share = (rank - below_lo) as f32 + 0.5;
        let guess = if step % 3 < 2 {
            ordered(a + (b - a) * (share / (below_hi - below_lo) as f32))
        } else {
            ((i64::from(lo) + i64::from(hi)) / 2) as i32
        };
        let t = guess.clamp(lo + 1, hi - 1);
        let below = simd.count_less(values, t);
        if below <= rank {
            (lo, below_lo) = (t, below);
            if below == rank {
                return simd.smallest_from(values, t);
            }
        } else {
            (hi, below_hi) = (t, below);
            if below == rank + 1 {
                return simd.largest_below(values, t);
            }
        }
    }
    lo
}

/// [`around`] of a large node.
struct Around<'a>(&'a [i32], usize, (i32, i32));
impl Task for Around<'_> {
    type Output = (i32, i32);
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> (i32, i32) {
        around(simd, self.0, self.1, self.2, &mut vec![0; LARGE_SAMPLE])
    }
}

struct Ranked<'a>(&'a [i32], usize, (i32, i32));
impl Task for Ranked<'_> {
    type Output = i32;
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> i32 {
        ranked(simd, self.0, self.1, self.2)
    }
}

/// [`Partition::collect`](super::simd_partition::Partition::collect).
struct Collect<'a>(&'a [i32], (i32, i32), &'a mut [i32]);
impl Task for Collect<'_> {
    type Output = (usize, usize);
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> (usize, usize) {
        simd.collect(self.0, self.1.0, self.1.1, self.2)
    }
}

/// How many values are below the pivot, and how many are the same.
struct Count<'a>(&'a [i32], i32);
impl Task for Count<'_> {
    type Output = (usize, usize);
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> (usize, usize) {
        let below = simd.count_less(self.0, self.1);
        (below, simd.count_less(self.0, self.1 + 1) - below)
    }
}

/// A piece of a node and the room for what becomes of it.
struct Piece<'a> {
    from: Columns<'a>,
    pivot: Pivot,
    left: ColumnsMut<'a>,
    right: ColumnsMut<'a>,
}

impl Task for Piece<'_> {
    type Output = Sides;
    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) -> Sides {
        simd.partition(&self.from, self.pivot, &mut self.left, &mut self.right)
    }
}

/// [`Divide`] by all threads: every piece of the node is counted, then divided into its own parts of both halves.
fn divide_large(level: Level, from: &Columns, to: Run, extent: Extent) -> Divided {
    let n = from.len();
    let size = n.div_ceil(n / PIECE);
    let middle = heap::left_size(n);
    let axis = extent.widest();
    let keys = from.xyz[axis];
    let bounds = (extent.lo[axis], extent.hi[axis]);

    // The median, as in `median`; every piece has room for three times its values.
    let (lo, hi) = level.run(Around(keys, middle, bounds));
    let counts: Vec<(usize, usize)> = (keys.par_chunks(size))
        .zip(to.xyz.par_chunks_mut(3 * size))
        .map(|(keys, room)| level.run(Collect(keys, (lo, hi), room)))
        .collect();
    let (mut below, mut inside) = (0, 0);
    for (i, count) in counts.into_iter().enumerate() {
        to.xyz.copy_within(3 * size * i..3 * size * i + count.1, inside);
        (below, inside) = (below + count.0, inside + count.1);
    }
    let at = if below <= middle && middle < below + inside {
        level.run(Ranked(&to.xyz[..inside], middle - below, (lo, hi)))
    } else {
        level.run(Ranked(keys, middle, bounds))
    };

    let counts: Vec<(usize, usize)> = keys.par_chunks(size).map(|keys| level.run(Count(keys, at))).collect();
    let below: usize = counts.iter().map(|c| c.0).sum();
    let mut median = (middle - below) as isize;
    let (mut left, mut right) = to.children();
    let (mut lefts, mut rights) = (left.columns_mut(), right.columns_mut());
    let mut pieces = Vec::with_capacity(counts.len());
    for (i, (below, ties)) in counts.into_iter().enumerate() {
        let from = from.slice(size * i..n.min(size * (i + 1)));
        let here = median.clamp(0, ties as isize) as usize;
        let to_left = below + here;
        let to_right = from.len() - to_left - usize::from((0..ties as isize).contains(&median));
        let (left, right);
        (left, lefts) = lefts.split(to_left);
        (right, rights) = rights.split(to_right);
        pieces.push(Piece { from, pivot: Pivot { axis, at, median }, left, right });
        median -= ties as isize;
    }
    let sides: Vec<Sides> = pieces.into_par_iter().map(|piece| level.run(piece)).collect();
    let join = |side: fn(&Sides) -> Extent| sides.iter().map(side).fold(Extent::EMPTY, Extent::union);
    let place = sides.iter().enumerate().find_map(|(i, s)| Some(size * i + s.median?));
    let median = photon(from, place.expect("the median is in its node"), axis);
    Divided { left: join(|s| s.left), right: join(|s| s.right), median }
}

struct ExtentOf<'a>(&'a Columns<'a>);
impl Task for ExtentOf<'_> {
    type Output = Extent;
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Extent {
        simd.extent(self.0)
    }
}

/// The upper levels: nodes of `buckets` buckets until they are of `down_to`. `to` has the result of the last level if the
/// number of levels is odd, else `from`.
fn upper(level: Level, from: Run, mut to: Run, extent: Extent, uppers: &mut [Photon], down_to: usize) {
    let buckets = uppers.len() + 1;
    if buckets <= down_to {
        return;
    }
    let n = from.len();
    let Divided { left, right, median } = if n >= PIECES * PIECE {
        divide_large(level, &from.columns(), to.reborrow(), extent)
    } else {
        level.run(Divide { from: &from.columns(), to: to.reborrow(), extent })
    };
    let (left_uppers, right_uppers) = uppers.split_at_mut(buckets / 2 - 1);
    let (top, right_uppers) = right_uppers.split_first_mut().expect("a node above buckets");
    *top = median;
    let ((l, r), (lt, rt)) = (to.children(), from.children());
    let go_left = || upper(level, l, lt, left, left_uppers, down_to);
    let go_right = || upper(level, r, rt, right, right_uppers, down_to);
    if n >= PARALLEL_FROM {
        rayon::join(go_left, go_right);
    } else {
        go_left();
        go_right();
    }
}

/// The levels below, down to the blocks.
fn lower(level: Level, from: Run, mut to: Run, extent: Extent, uppers: &mut [Photon], blocks: &mut [Block]) {
    if let [block] = blocks {
        level.run(Bucket { from: from.columns(), block });
        return;
    }
    let Divided { left, right, median } = level.run(Divide { from: &from.columns(), to: to.reborrow(), extent });
    let half = blocks.len() / 2;
    let (left_uppers, right_uppers) = uppers.split_at_mut(half - 1);
    let (left_blocks, right_blocks) = blocks.split_at_mut(half);
    right_uppers[0] = median;
    let ((l, r), (lt, rt)) = (to.children(), from.children());
    lower(level, l, lt, left, left_uppers, left_blocks);
    lower(level, r, rt, right, &mut right_uppers[1..], right_blocks);
}

/// Photons as columns.
struct Transpose<'a>(&'a [Photon], ColumnsMut<'a>);
impl Task for Transpose<'_> {
    type Output = Extent;
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Extent {
        let Self(photons, ColumnsMut { xyz: [x, y, z], power, rest }) = self;
        let to = x.iter_mut().zip(&mut *y).zip(&mut *z).zip(&mut *power).zip(&mut *rest);
        for (photon, ((((x, y), z), power), rest)) in photons.iter().zip(to) {
            [*x, *y, *z] = photon.position.map(ordered);
            *power = photon.power;
            let ([d0, d1], [f0, f1]) = (photon.direction, photon.flags.0.to_ne_bytes());
            *rest = [d0, d1, f0, f1];
        }
        simd.extent(&Columns { xyz: [x, y, z], power, rest })
    }
}

/// All photons as columns; returns their box.
fn columns(level: Level, photons: &[Photon], to: &mut Run) -> Extent {
    const CHUNK: usize = 1 << 13;
    let ColumnsMut { xyz: [x, y, z], power, rest } = to.columns_mut();
    (photons.par_chunks(CHUNK))
        .zip(x.par_chunks_mut(CHUNK).zip(y.par_chunks_mut(CHUNK)).zip(z.par_chunks_mut(CHUNK)))
        .zip(power.par_chunks_mut(CHUNK).zip(rest.par_chunks_mut(CHUNK)))
        .map(|((photons, ((x, y), z)), (power, rest))| {
            level.run(Transpose(photons, ColumnsMut { xyz: [x, y, z], power, rest }))
        })
        .reduce(|| Extent::EMPTY, Extent::union)
}

/// The sizes of the nodes so many levels below one of n photons.
fn sizes(n: usize, levels: u32, out: &mut Vec<usize>) {
    if levels == 0 {
        out.push(n);
        return;
    }
    let left = heap::left_size(n);
    sizes(left, levels - 1, out);
    sizes(n - 1 - left, levels - 1, out);
}

/// Balances photons in two steps, between which their memory changes its use.
pub(crate) struct Balance {
    level: Level,
    photons: Vec<Photon>,
    layout: Layout,
    levels: u32,
    /// The photons of the nodes above the buckets, from left to right, and one more.
    uppers: Vec<Photon>,
    pub extent: Extent,
}

impl Balance {
    /// The upper levels. `room` is for so many photons; what it holds afterwards means nothing. Gives the photons back when a
    /// position is out of `limits`.
    pub fn upper(
        level: Level,
        mut photons: Vec<Photon>,
        layout: Layout,
        limits: (i32, i32),
        mut room: Run,
    ) -> Result<Self, Vec<Photon>> {
        // An odd number of levels, so that the last one brings the photons back into their own memory.
        let levels = (layout.buckets / CACHED).max(1).ilog2();
        let levels = if levels == 0 { 0 } else { levels | 1 };
        let down_to = layout.buckets >> levels;
        let mut uppers = vec![Photon::default(); layout.buckets];
        let extent = columns(level, &photons, &mut room);
        if !(extent.lo.iter().all(|&v| v >= limits.0) && extent.hi.iter().all(|&v| v <= limits.1)) {
            return Err(photons);
        }
        let to = Run::new(bytemuck::cast_slice_mut(&mut photons));
        if levels == 0 {
            to.xyz.copy_from_slice(room.xyz);
            to.power.copy_from_slice(room.power);
            to.rest.copy_from_slice(room.rest);
        }
        upper(level, room, to, extent, &mut uppers[..layout.buckets - 1], down_to);
        Ok(Self { level, photons, layout, levels, uppers, extent })
    }

    /// The other levels, into the blocks in the order of buckets; returns the photons of the upper nodes from left to right,
    /// and memory that may be freed.
    pub fn lower(mut self, blocks: &mut [Block]) -> (Vec<Photon>, Vec<Photon>) {
        let level = self.level;
        let buckets = self.layout.buckets >> self.levels;
        let mut all = Vec::new();
        sizes(self.photons.len(), self.levels, &mut all);
        let mut nodes = Vec::with_capacity(all.len());
        let mut rest = Run::new(bytemuck::cast_slice_mut(&mut self.photons));
        for n in all {
            let (node, after) = rest.split(n);
            nodes.push(node);
            let gap = after.len().min(1);
            rest = after.split(gap).1;
        }
        (nodes.into_par_iter())
            .zip(blocks.par_chunks_mut(buckets))
            .zip(self.uppers.par_chunks_mut(buckets))
            .for_each_init(Vec::new, |room, ((node, blocks), uppers)| {
                room.resize(5 * node.len(), 0i32);
                let extent = level.run(ExtentOf(&node.columns()));
                lower(level, node, Run::new(room), extent, &mut uppers[..buckets - 1], blocks);
            });
        (self.uppers, self.photons)
    }
}

/// The bottom of the tree. The photons are sorted along every axis once; a node is then a set of bits in each of the three
/// orders, its extents are at the first and the last bit, and its lower half are its lowest bits.
struct Bucket<'a, 'b> {
    from: Columns<'a>,
    block: &'a mut Block<'b>,
}

struct Small {
    /// Along each axis: the coordinates in order, which photon has which rank, and which rank has which photon.
    sorted: [[f32; BLOCK]; 3],
    label: [[u8; BLOCK]; 3],
    rank: [[u8; BLOCK]; 3],
    /// The result in the heap's order, from 1 on.
    order: [u8; BLOCK],
    axes: [u8; BLOCK],
}

impl Task for Bucket<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { from, block } = self;
        let n = from.len();
        let none = [[0; BLOCK]; 3];
        let mut small =
            Small { sorted: [[0.0; BLOCK]; 3], label: none, rank: none, order: [0; BLOCK], axes: [0; BLOCK] };
        for a in 0..3 {
            small.sort(a, from.xyz[a]);
        }
        if n > 0 {
            small.node([(1 << n) - 1; 3], 1);
        }
        block.positions.fill(f32::INFINITY);
        for lane in 1..=n {
            block.put(lane, &photon(&from, small.order[lane] as usize, small.axes[lane] as usize));
        }
    }
}

impl Small {
    /// Sorts along one axis, ties in emission order.
    #[inline(always)]
    fn sort(&mut self, axis: usize, keys: &[i32]) {
        let n = keys.len();
        let mut values = [i32::MAX; BLOCK];
        values[..n].copy_from_slice(keys);
        if keys.iter().all(|v| *v == values[0]) {
            // All on one plane, as on a wall.
            for (i, &value) in keys.iter().enumerate() {
                self.place(axis, i, i, value);
            }
            return;
        }
        let mut ranks = ranks(&values);
        // Ties lower the sum.
        if ranks[..n].iter().sum::<u32>() as usize != n * (n - 1) / 2 {
            ranks = ranks_with_ties(&values);
        }
        for (i, (&value, &rank)) in keys.iter().zip(&ranks).enumerate() {
            self.place(axis, rank as usize % BLOCK, i, value);
        }
    }

    /// The photon `label` has this rank along the axis.
    #[inline(always)]
    fn place(&mut self, axis: usize, rank: usize, label: usize, value: i32) {
        self.sorted[axis][rank] = unordered(value);
        self.label[axis][rank] = label as u8;
        self.rank[axis][label] = rank as u8;
    }

    /// Balances the photons whose ranks along the axes are the bits of `sets`, at least one, as the subtree of a node.
    fn node(&mut self, sets: [u64; 3], slot: usize) {
        let n = sets[0].count_ones() as usize;
        if n == 1 {
            self.order[slot % BLOCK] = self.label[0][sets[0].trailing_zeros() as usize % BLOCK];
            return;
        }
        // The axis of the widest extent.
        let axis = widest(std::array::from_fn(|a| {
            let (lo, hi) = (sets[a].trailing_zeros(), 63 - sets[a].leading_zeros());
            self.sorted[a][hi as usize % BLOCK] - self.sorted[a][lo as usize % BLOCK]
        }));
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);

        // Collect the lower half in the orders of all axes.
        let middle = heap::left_size(n);
        let mut rest = sets[axis];
        let mut left = [0; 3];
        for _ in 0..middle {
            let label = self.label[axis][rest.trailing_zeros() as usize % BLOCK] as usize % BLOCK;
            left[b] |= 1 << (self.rank[b][label] % 64);
            left[c] |= 1 << (self.rank[c][label] % 64);
            rest &= rest - 1;
        }
        left[axis] = sets[axis] ^ rest;

        // Place the median, and balance what is left on both sides of it.
        let label = self.label[axis][rest.trailing_zeros() as usize % BLOCK];
        self.order[slot % BLOCK] = label;
        self.axes[slot % BLOCK] = axis as u8;
        let right = std::array::from_fn(|a| sets[a] & !left[a] & !(1 << (self.rank[a][label as usize % BLOCK] % 64)));
        self.node(left, 2 * slot);
        if n > 2 {
            self.node(right, 2 * slot + 1);
        }
    }
}

/// How many values are less than each. Every pair is compared: with vectors that is a fraction of a sort's time.
#[inline(always)]
fn ranks(values: &[i32; BLOCK]) -> [u32; BLOCK] {
    let mut ranks = [0; BLOCK];
    for v in values {
        for (rank, w) in ranks.iter_mut().zip(values) {
            *rank += u32::from(v < w);
        }
    }
    ranks
}

/// [`ranks`] where equal values rank in their order.
#[inline(always)]
fn ranks_with_ties(values: &[i32; BLOCK]) -> [u32; BLOCK] {
    let mut ranks = [0; BLOCK];
    for (i, v) in values.iter().enumerate() {
        for (j, (rank, w)) in ranks.iter_mut().zip(values).enumerate() {
            *rank += u32::from((v < w) | ((v == w) & (i < j)));
        }
    }
    ranks
}
