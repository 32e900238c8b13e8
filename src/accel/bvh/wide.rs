//! The 8-wide tree: 256-byte nodes, and leaf blocks with their triangles side by side.

use arrayvec::ArrayVec;
use rayon::prelude::*;

use super::binned::{Bins, Box8, Piece, PrimRef, Recipe, open};
use super::flat::Flat;
use super::parts::{KIND_TRIANGLE, Parts};
use super::{Quality, presplit};
use crate::math::Bounds3;
use crate::pages::Pages;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Triangles of a leaf block.
pub(super) const LANES: usize = 4;
/// Blocks that one leaf can refer to.
pub(super) const MAX_BLOCKS: usize = 8;
/// Subtrees over this many references are built by one task; fewer in small trees, so that there are enough tasks.
const TASK: std::ops::RangeInclusive<usize> = 1024..=8192;
/// Tasks for each thread before their results are collected.
const ROUND: usize = 16;

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

    /// The same child of a subtree whose nodes and blocks were given higher numbers.
    #[inline(always)]
    fn shifted(self, nodes: u32, blocks: u32) -> Self {
        let shift = if self.is_node() { nodes } else { blocks };
        // `NONE` looks like a kind that does not exist.
        Self(self.0 + if self.is_node() || self.kind() == KIND_TRIANGLE { shift } else { 0 })
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

impl Tree {
    /// What a ray that meets its box is expected to cost, by the surface area heuristic, times half the area of the box.
    fn cost(&self) -> f64 {
        let node = |node: &Node8| {
            let slot = |i: usize| {
                let e = node.slot_bounds(i).extent().as_dvec3();
                let child = node.child[i];
                let blocks = if child.is_node() || child.kind() != KIND_TRIANGLE { 1 } else { child.blocks().len() };
                (e.x * e.y + e.y * e.z + e.z * e.x) * blocks as f64
            };
            (0..WIDTH).filter(|&i| node.child[i] != Child::NONE).map(slot).sum::<f64>()
        };
        // Summed in order, so that the choice does not depend on the number of threads.
        self.nodes.iter().map(node).sum()
    }
}

impl Recipe {
    /// One node with eight children costs as much as one block, and a binary step as much again.
    const DEFAULT: Self =
        Self { block: 1.0, step: 1.0, max_leaf: LANES * MAX_BLOCKS, least_bins: 6, refs_per_bin: 16, one_axis: false };

    /// What a quality asks for.
    fn of(quality: Quality) -> Self {
        match quality {
            Quality::Fast => Self { one_axis: true, refs_per_bin: 64, ..Self::DEFAULT },
            Quality::Default => Self::DEFAULT,
            Quality::High => Self { least_bins: 16, refs_per_bin: 4, ..Self::DEFAULT },
        }
    }
}

/// Nodes and blocks of one subtree, numbered from 0.
struct Subtree {
    nodes: Vec<Node8>,
    blocks: Vec<Block>,
    root: Child,
    /// Room to part ranges of references in.
    spare: Vec<PrimRef>,
    bins: Bins,
    recipe: Recipe,
}

impl Subtree {
    fn new(recipe: Recipe) -> Self {
        Self { nodes: Vec::new(), blocks: Vec::new(), root: Child::NONE, spare: Vec::new(), bins: Bins::EMPTY, recipe }
    }

    /// Replaces the contents by the tree over `refs`.
    fn build(&mut self, refs: &mut [PrimRef], task: &Task, parts: &Parts) {
        self.nodes.clear();
        self.blocks.clear();
        let mut spare = std::mem::take(&mut self.spare);
        spare.resize(spare.len().max(refs.len()), PrimRef::default());
        let piece = Piece::new(refs, &mut spare[..task.len], task.bounds, task.depth);
        self.root = self.root(piece, parts);
        self.spare = spare;
    }

    fn root(&mut self, piece: Piece, parts: &Parts) -> Child {
        let children = open(piece, &self.recipe, &mut self.bins);
        if let [leaf] = &children[..] {
            return self.leaf(leaf, parts);
        }
        self.nodes.push(Node8::EMPTY);
        self.fill(0, children, parts);
        Child::node(0)
    }

    /// Fills a node. Its inner children stand side by side, then follow their subtrees.
    fn fill(&mut self, node: usize, children: ArrayVec<Piece, WIDTH>, parts: &Parts) {
        let slots = slots_by_area(&children.iter().map(|c| c.area).collect::<ArrayVec<f32, WIDTH>>());
        let mut inner = ArrayVec::<_, WIDTH>::new();
        for (piece, slot) in children.into_iter().zip(slots) {
            let bounds = piece.bounds.bounds();
            let opened = open(piece, &self.recipe, &mut self.bins);
            let child = if let [leaf] = &opened[..] {
                self.leaf(leaf, parts)
            } else {
                let index = self.nodes.len();
                self.nodes.push(Node8::EMPTY);
                inner.push((index, opened));
                Child::node(index)
            };
            self.nodes[node].set(slot, &bounds, child);
        }
        for (index, opened) in inner {
            self.fill(index, opened, parts);
        }
    }

    fn leaf(&mut self, piece: &Piece, parts: &Parts) -> Child {
        let refs = &*piece.refs;
        if refs[0].kind() != KIND_TRIANGLE {
            return Child::single(refs[0].kind(), refs[0].id());
        }
        let first = self.blocks.len();
        for refs in refs.chunks(LANES) {
            let mut block = Block::EMPTY;
            block.fill(refs, parts);
            self.blocks.push(block);
        }
        Child::triangles(first, self.blocks.len() - first)
    }

    /// Copies the subtree to its place in the whole tree; returns what its root is called there.
    fn place(&self, nodes: &mut [Node8], blocks: &mut [Block], first_node: u32, first_block: u32) -> Child {
        for (to, from) in nodes.iter_mut().zip(&self.nodes) {
            *to = *from;
            for child in &mut to.child {
                *child = child.shifted(first_node, first_block);
            }
        }
        blocks.copy_from_slice(&self.blocks);
        self.root.shifted(first_node, first_block)
    }
}

/// The slot of each child: any-hit queries enter the first slot that is hit, so the largest box comes first.
fn slots_by_area(areas: &[f32]) -> [usize; WIDTH] {
    let mut order: ArrayVec<usize, WIDTH> = (0..areas.len()).collect();
    order.sort_by(|&a, &b| areas[b].total_cmp(&areas[a]));
    let mut slots = [0; WIDTH];
    for (slot, &i) in order.iter().enumerate() {
        slots[i] = slot;
    }
    slots
}

/// The upper end of the tree, parted until a task can take what is left. The references of tasks lie in the first array.
enum Top<'a> {
    Task(Piece<'a>),
    Node(Vec<(Box8, Self)>),
}

impl<'a> Top<'a> {
    fn new(piece: Piece<'a>, task: usize, recipe: &Recipe) -> Self {
        if piece.refs.len() <= task {
            if piece.moved {
                piece.spare.copy_from_slice(piece.refs);
            }
            return Self::Task(piece);
        }
        let mut bins = Bins::EMPTY;
        let children = Vec::from_iter(open(piece, recipe, &mut bins));
        Self::Node(children.into_par_iter().map(|c| (c.bounds, Self::new(c, task, recipe))).collect())
    }
}

/// A subtree to be built, over the references that follow those of the task before.
struct Task {
    len: usize,
    bounds: Box8,
    depth: u32,
    /// The node and the slot that it belongs to.
    parent: Option<(usize, usize)>,
}

/// Numbers the nodes of the upper end, and lists what hangs below.
fn flatten(top: Top, parent: Option<(usize, usize)>, nodes: &mut Vec<Node8>, tasks: &mut Vec<Task>) {
    match top {
        Top::Task(p) => {
            tasks.push(Task { len: p.refs.len(), bounds: p.bounds, depth: p.depth, parent });
        }
        Top::Node(children) => {
            let index = nodes.len();
            nodes.push(Node8::EMPTY);
            if let Some((node, slot)) = parent {
                nodes[node].child[slot] = Child::node(index);
            }
            let slots = slots_by_area(&children.iter().map(|(b, _)| b.half_area()).collect::<ArrayVec<f32, WIDTH>>());
            for ((bounds, child), slot) in children.into_iter().zip(slots) {
                nodes[index].set(slot, &bounds.bounds(), Child::NONE);
                flatten(child, Some((index, slot)), nodes, tasks);
            }
        }
    }
}

/// Builds the tree over `refs`, which lie in `bounds`; `None` when it would have more blocks than it can number.
pub(super) fn build(refs: Pages<PrimRef>, bounds: Box8, parts: Parts, quality: Quality) -> Option<Tree> {
    let cut = if quality == Quality::High { presplit::split(&refs, &bounds, &parts) } else { None };
    let tree = build_over(refs, bounds, parts, quality)?;
    let Some(cut) = cut.filter(|_| tree.flat.is_none()) else { return Some(tree) };
    // Whether cuts pay depends on what lies around a triangle, so both trees are weighed.
    match build_over(cut, bounds, tree.parts.clone(), quality) {
        Some(other) if other.cost() < tree.cost() => Some(other),
        _ => Some(tree),
    }
}

fn build_over(mut refs: Pages<PrimRef>, bounds: Box8, parts: Parts, quality: Quality) -> Option<Tree> {
    let recipe = Recipe::of(quality);
    let flat = Flat::new(&refs, &parts);
    let n = refs.len();
    let mut tree = Tree {
        nodes: Pages::with_capacity(n),
        blocks: Pages::with_capacity(n),
        root: Child::NONE,
        bounds: bounds.bounds(),
        flat,
        parts,
    };
    if n == 0 {
        tree.bounds = Bounds3::EMPTY;
        return Some(tree);
    }
    if tree.parts.len() > ID_LIMIT {
        return None;
    }
    let (mut top, mut tasks) = (Vec::new(), Vec::new());
    let task = (n / 32).clamp(*TASK.start(), *TASK.end());
    if n <= task {
        tasks.push(Task { len: n, bounds, depth: 0, parent: None });
    } else {
        let mut spare = Pages::<PrimRef>::zeroed(n);
        flatten(Top::new(Piece::new(&mut refs, &mut spare, bounds, 0), task, &recipe), None, &mut top, &mut tasks);
    }
    tree.nodes.extend_zeroed(top.len()).copy_from_slice(&top);
    let mut rest = &mut refs[..];
    let mut subtrees = Vec::new();
    let mut tasks = &tasks[..];
    while !tasks.is_empty() {
        // As many tasks as make a round. What is in it changes nothing in the tree.
        let mut left = (ROUND * rayon::current_num_threads() * task) as isize;
        let more = |t: &&Task| {
            let more = left > 0;
            left -= t.len as isize;
            more
        };
        let (round, later) = tasks.split_at(tasks.iter().take_while(more).count());
        tasks = later;
        subtrees.resize_with(subtrees.len().max(round.len()), || Subtree::new(recipe));
        let subtrees = &mut subtrees[..round.len()];
        let mut jobs = Vec::with_capacity(round.len());
        for (task, subtree) in round.iter().zip(subtrees.iter_mut()) {
            let (mine, others) = std::mem::take(&mut rest).split_at_mut(task.len);
            rest = others;
            jobs.push((mine, task, subtree));
        }
        jobs.into_par_iter().for_each(|(refs, task, subtree)| subtree.build(refs, task, &tree.parts));
        collect(&mut tree, round, subtrees)?;
    }
    tree.nodes.shrink();
    tree.blocks.shrink();
    Some(tree)
}

/// Appends the subtrees of a round.
fn collect(tree: &mut Tree, round: &[Task], subtrees: &[Subtree]) -> Option<()> {
    let (mut first_node, mut first_block) = (tree.nodes.len(), tree.blocks.len());
    let mut nodes = tree.nodes.extend_zeroed(subtrees.iter().map(|s| s.nodes.len()).sum());
    let mut blocks = tree.blocks.extend_zeroed(subtrees.iter().map(|s| s.blocks.len()).sum());
    if first_block + blocks.len() > BLOCK_LIMIT {
        return None;
    }
    let mut jobs = Vec::with_capacity(round.len());
    for s in subtrees {
        let (my_nodes, other_nodes) = nodes.split_at_mut(s.nodes.len());
        let (my_blocks, other_blocks) = blocks.split_at_mut(s.blocks.len());
        (nodes, blocks) = (other_nodes, other_blocks);
        jobs.push((s, my_nodes, my_blocks, first_node as u32, first_block as u32));
        first_node += s.nodes.len();
        first_block += s.blocks.len();
    }
    let roots: Vec<Child> = jobs.into_par_iter().map(|(s, nodes, blocks, n, b)| s.place(nodes, blocks, n, b)).collect();
    for (task, root) in round.iter().zip(roots) {
        match task.parent {
            Some((node, slot)) => tree.nodes[node].child[slot] = root,
            None => tree.root = root,
        }
    }
    if round.iter().all(|t| t.parent.is_some()) {
        tree.root = Child::node(0);
    }
    Some(())
}
