//! The 8-wide tree: 256-byte nodes, and leaf blocks with their triangles side by side.

use rayon::prelude::*;

use super::binned::{Node2, PrimRef};
use super::pages::Pages;
use super::parts::{KIND_QUADRIC, KIND_TRIANGLE, Parts};
use crate::math::Bounds3;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Triangles of a leaf block.
pub(super) const LANES: usize = 4;
/// Blocks that one leaf can refer to.
pub(super) const MAX_BLOCKS: usize = 8;
/// Subtrees over more references than this are filled by their own task.
const PARALLEL_FILL: usize = 8192;

/// What a child slot refers to, in 32 bits.
///
/// `0 | node:31`, `1 | 00 | blocks−1:3 | block:26` for triangles, `1 | kind:2 | id:29` for one quadric or instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(super) struct Child(pub u32);

impl Child {
    /// Not used by any node: the box of an empty slot is never entered.
    pub const NONE: Self = Self(u32::MAX);

    pub fn node(index: usize) -> Self {
        Self(index as u32)
    }

    pub fn triangles(block: usize, blocks: usize) -> Self {
        Self(1 << 31 | (blocks as u32 - 1) << 26 | block as u32)
    }

    pub fn single(kind: u32, id: u32) -> Self {
        Self(1 << 31 | kind << 29 | id)
    }

    #[inline(always)]
    pub fn is_node(self) -> bool {
        self.0 >> 31 == 0
    }

    #[inline(always)]
    pub fn kind(self) -> u32 {
        self.0 >> 29 & 3
    }

    /// The first block of a triangle leaf.
    #[inline(always)]
    pub fn first_block(self) -> usize {
        (self.0 & 0x03ff_ffff) as usize
    }

    /// The blocks of a triangle leaf.
    #[inline(always)]
    pub fn blocks(self) -> std::ops::Range<usize> {
        self.first_block()..self.first_block() + (self.0 >> 26 & 7) as usize + 1
    }

    #[inline]
    pub fn id(self) -> u32 {
        self.0 & 0x1fff_ffff
    }
}

/// Blocks that a tree can address.
pub(super) const BLOCK_LIMIT: usize = 1 << 26;
/// Ids that a tree can address.
pub(super) const ID_LIMIT: usize = 1 << 29;

/// Eight boxes and what is in them. Empty slots have inverted infinite boxes.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Node8 {
    /// Minimum x, y, z, then maximum x, y, z.
    pub bounds: [[f32; WIDTH]; 6],
    pub child: [Child; WIDTH],
    pad: [u32; WIDTH],
}

const _: () = assert!(size_of::<Node8>() == 256);

impl Node8 {
    pub const EMPTY: Self = Self {
        bounds: [
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
        ],
        child: [Child::NONE; WIDTH],
        pad: [0; WIDTH],
    };

    fn set(&mut self, slot: usize, b: &Bounds3, child: Child) {
        for axis in 0..3 {
            self.bounds[axis][slot] = b.min[axis];
            self.bounds[3 + axis][slot] = b.max[axis];
        }
        self.child[slot] = child;
    }

    /// The box of one slot.
    pub fn slot_bounds(&self, slot: usize) -> Bounds3 {
        let b = |k: usize| self.bounds[k][slot];
        Bounds3::new([b(0), b(1), b(2)].into(), [b(3), b(4), b(5)].into())
    }
}

/// Triangles side by side: `v[vertex][axis][lane]`. Unused lanes are NaN, which no ray hits.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Block {
    pub v: [[[f32; LANES]; 3]; 3],
    pub id: [u32; LANES],
}

const _: () = assert!(size_of::<Block>() == 40 * LANES);

impl Block {
    const EMPTY: Self = Self { v: [[[f32::NAN; LANES]; 3]; 3], id: [u32::MAX; LANES] };

    fn fill(&mut self, refs: &[PrimRef], parts: &Parts) {
        for (lane, r) in refs.iter().enumerate() {
            let triangle = parts.triangle(r.id());
            for (vertex, p) in triangle.iter().enumerate() {
                for axis in 0..3 {
                    self.v[vertex][axis][lane] = p[axis];
                }
            }
            self.id[lane] = r.id();
        }
    }

    /// One triangle.
    #[inline]
    pub fn triangle(&self, lane: usize) -> [glam::Vec3; 3] {
        self.v.map(|v| glam::Vec3::new(v[0][lane], v[1][lane], v[2][lane]))
    }
}

/// Triangles of a [`FlatBlock`].
pub(super) const FLAT_LANES: usize = 16;
/// Most triangles for which testing all of them is faster than walking a tree.
const FLAT_TRIANGLES: usize = 48;
/// Most analytic shapes beside them.
const FLAT_SINGLES: usize = 4;

/// Sixteen triangles side by side, as in [`Block`].
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(super) struct FlatBlock {
    pub v: [[[f32; FLAT_LANES]; 3]; 3],
    pub id: [u32; FLAT_LANES],
}

/// Everything in a group so small that a tree does not pay: every ray tests all of it.
#[derive(Debug)]
pub(super) struct Flat {
    pub blocks: Vec<FlatBlock>,
    pub singles: arrayvec::ArrayVec<Child, FLAT_SINGLES>,
}

impl Flat {
    /// `None` when there is too much, or an instance, or nothing.
    fn new(refs: &[PrimRef], parts: &Parts) -> Option<Self> {
        let count = |kind| refs.iter().filter(|r| r.kind() == kind).count();
        let (triangles, quadrics) = (count(KIND_TRIANGLE), count(KIND_QUADRIC));
        let fits = triangles <= FLAT_TRIANGLES && quadrics <= FLAT_SINGLES && triangles + quadrics == refs.len();
        if !fits || refs.is_empty() {
            return None;
        }
        let empty = FlatBlock { v: [[[f32::NAN; FLAT_LANES]; 3]; 3], id: [u32::MAX; FLAT_LANES] };
        let mut flat = Self { blocks: vec![empty; triangles.div_ceil(FLAT_LANES)], singles: Default::default() };
        for (i, r) in refs.iter().filter(|r| r.kind() == KIND_TRIANGLE).enumerate() {
            let (block, lane) = (&mut flat.blocks[i / FLAT_LANES], i % FLAT_LANES);
            for (corner, p) in block.v.iter_mut().zip(parts.triangle(r.id())) {
                for axis in 0..3 {
                    corner[axis][lane] = p[axis];
                }
            }
            block.id[lane] = r.id();
        }
        let singles = refs.iter().filter(|r| r.kind() != KIND_TRIANGLE);
        flat.singles.extend(singles.map(|r| Child::single(r.kind(), r.id())));
        Some(flat)
    }
}

/// The finished tree over one group of shapes.
#[derive(Debug)]
pub(super) struct Tree {
    pub nodes: Pages<Node8>,
    pub blocks: Pages<Block>,
    pub root: Child,
    pub bounds: Bounds3,
    pub parts: Parts,
    /// What is searched in place of the tree where there is next to nothing in it.
    pub flat: Option<Flat>,
}

/// Counts of what a subtree needs, stored at its root until the tree is filled.
#[derive(Clone, Copy, Default)]
struct Size {
    /// Wide nodes below the root of the subtree.
    nodes: u32,
    blocks: u32,
}

/// The binary subtrees that become the children of one wide node, in memory order.
fn open(nodes2: &[Node2]) -> arrayvec::ArrayVec<usize, WIDTH> {
    let mut children = arrayvec::ArrayVec::new();
    children.push(0);
    // Open the largest inner child until the node is full.
    while children.len() < WIDTH {
        let mut largest: Option<(f32, usize)> = None;
        for (slot, &c) in children.iter().enumerate() {
            let area = nodes2[c].half_area();
            if nodes2[c].count() == 0 && largest.is_none_or(|l| area > l.0) {
                largest = Some((area, slot));
            }
        }
        let Some((_, slot)) = largest else { break };
        let c = children[slot];
        children[slot] = c + 1;
        children.insert(slot + 1, c + nodes2[c].offset());
    }
    children
}

/// A range of sizes that runs parallel to a range of binary nodes.
fn measure(nodes2: &[Node2], refs: &[PrimRef], sizes: &mut [Size]) -> Size {
    let mut total = Size::default();
    if nodes2[0].count() > 0 {
        let triangles = refs[nodes2[0].offset()].kind() == KIND_TRIANGLE;
        total.blocks = if triangles { nodes2[0].count().div_ceil(LANES) as u32 } else { 0 };
    } else {
        let children = open(nodes2);
        let job = |(nodes2, sizes): (&[Node2], &mut [Size])| {
            let inner = u32::from(nodes2[0].count() == 0);
            let s = measure(nodes2, refs, sizes);
            Size { nodes: s.nodes + inner, blocks: s.blocks }
        };
        let pieces = cut(nodes2, sizes, &children);
        let add = |a: Size, b: Size| Size { nodes: a.nodes + b.nodes, blocks: a.blocks + b.blocks };
        total = if nodes2.len() > PARALLEL_FILL {
            pieces.into_par_iter().map(job).reduce(Size::default, add)
        } else {
            pieces.into_iter().map(job).fold(Size::default(), add)
        };
    }
    sizes[0] = total;
    total
}

/// Cuts both slices into the subtrees of the children.
fn cut<'a, 'b>(
    nodes2: &'a [Node2],
    mut sizes: &'b mut [Size],
    children: &[usize],
) -> Vec<(&'a [Node2], &'b mut [Size])> {
    let mut pieces = Vec::with_capacity(WIDTH);
    let mut at = 0;
    for (i, &c) in children.iter().enumerate() {
        let end = children.get(i + 1).copied().unwrap_or(nodes2.len());
        let (piece, rest) = std::mem::take(&mut sizes)[c - at..].split_at_mut(end - c);
        pieces.push((&nodes2[c..end], piece));
        (sizes, at) = (rest, end);
    }
    pieces
}

struct Job<'a> {
    nodes2: &'a [Node2],
    sizes: &'a [Size],
    /// The node to fill and the nodes below it.
    node: Option<&'a mut Node8>,
    below: &'a mut [Node8],
    below_first: usize,
    blocks: &'a mut [Block],
    blocks_first: usize,
}

/// Builds the wide tree from the binary one.
pub(super) fn collapse(nodes2: &[Node2], refs: &[PrimRef], parts: Parts) -> Option<Tree> {
    let Some(top) = nodes2.first() else {
        return Some(Tree {
            nodes: Pages::zeroed(0),
            blocks: Pages::zeroed(0),
            root: Child::NONE,
            bounds: Bounds3::EMPTY,
            parts,
            flat: None,
        });
    };
    let mut sizes = vec![Size::default(); nodes2.len()];
    let size = measure(nodes2, refs, &mut sizes);
    if size.blocks as usize > BLOCK_LIMIT || parts.len() > ID_LIMIT {
        return None;
    }
    let inner = usize::from(top.count() == 0);
    let mut nodes = Pages::<Node8>::zeroed(size.nodes as usize + inner);
    let mut blocks = Pages::<Block>::zeroed(size.blocks as usize);
    let bounds = top.bounds();
    let (node, below) = nodes.split_at_mut(inner);
    let job = Job {
        nodes2,
        sizes: &sizes,
        node: node.first_mut(),
        below,
        below_first: inner,
        blocks: &mut blocks,
        blocks_first: 0,
    };
    let root = if inner == 1 { Child::node(0) } else { leaf(top, refs, &parts, job.blocks, 0) };
    if inner == 1 {
        fill(job, refs, &parts);
    }
    let flat = Flat::new(refs, &parts);
    Some(Tree { nodes, blocks, root, bounds, parts, flat })
}

/// Fills the blocks of one leaf.
fn leaf(n: &Node2, refs: &[PrimRef], parts: &Parts, blocks: &mut [Block], first: usize) -> Child {
    let refs = &refs[n.offset()..n.offset() + n.count()];
    if refs[0].kind() != KIND_TRIANGLE {
        return Child::single(refs[0].kind(), refs[0].id());
    }
    for (block, refs) in blocks.iter_mut().zip(refs.chunks(LANES)) {
        *block = Block::EMPTY;
        block.fill(refs, parts);
    }
    Child::triangles(first, refs.len().div_ceil(LANES))
}

/// The slot of each child: any-hit queries enter the first slot that is hit, so the largest box comes first.
fn slots_by_area(nodes2: &[Node2], children: &[usize]) -> [usize; WIDTH] {
    let mut order: arrayvec::ArrayVec<usize, WIDTH> = (0..children.len()).collect();
    order.sort_by(|&a, &b| nodes2[children[b]].half_area().total_cmp(&nodes2[children[a]].half_area()));
    let mut slots = [0; WIDTH];
    for (slot, &i) in order.iter().enumerate() {
        slots[i] = slot;
    }
    slots
}

fn fill(job: Job, refs: &[PrimRef], parts: &Parts) {
    let Some(node) = job.node else { return };
    *node = Node8::EMPTY;
    let children = open(job.nodes2);
    let n_inner = children.iter().filter(|&&c| job.nodes2[c].count() == 0).count();
    // The inner children stand side by side, then follow their subtrees.
    let (mut side, mut below) = job.below.split_at_mut(n_inner);
    let (mut side_first, mut below_first) = (job.below_first, job.below_first + n_inner);
    let (mut blocks, mut blocks_first) = (job.blocks, job.blocks_first);
    let mut jobs = Vec::with_capacity(n_inner);
    let slots = slots_by_area(job.nodes2, &children);
    for (i, &c) in children.iter().enumerate() {
        let slot = slots[i];
        let end = children.get(i + 1).copied().unwrap_or(job.nodes2.len());
        let (n, size) = (&job.nodes2[c], job.sizes[c]);
        let (size_nodes, size_blocks) = (size.nodes as usize, size.blocks as usize);
        let (my_blocks, rest) = blocks.split_at_mut(size_blocks);
        if n.count() > 0 {
            node.set(slot, &n.bounds(), leaf(n, refs, parts, my_blocks, blocks_first));
        } else {
            node.set(slot, &n.bounds(), Child::node(side_first));
            let (child, rest_side) = side.split_at_mut(1);
            let (my_below, rest_below) = below.split_at_mut(size_nodes);
            jobs.push(Job {
                nodes2: &job.nodes2[c..end],
                sizes: &job.sizes[c..end],
                node: child.first_mut(),
                below: my_below,
                below_first,
                blocks: my_blocks,
                blocks_first,
            });
            (side, below) = (rest_side, rest_below);
            side_first += 1;
            below_first += size_nodes;
        }
        blocks = rest;
        blocks_first += size_blocks;
    }
    if job.nodes2.len() > PARALLEL_FILL {
        jobs.into_par_iter().for_each(|j| fill(j, refs, parts));
    } else {
        jobs.into_iter().for_each(|j| fill(j, refs, parts));
    }
}
