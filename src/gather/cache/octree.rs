//! Where records are valid: an octree whose nodes list the records of about their size.

use crate::math::{Bounds3, Vec3};

/// Depth at which nodes are no longer divided.
const MAX_DEPTH: u32 = 24;

#[derive(Clone, Debug, Default)]
struct Node {
    /// Index of the first of eight children; 0 for none.
    children: u32,
    records: Vec<u32>,
}

/// An octree over a cube; a record stands in every node of its size that its sphere may reach into.
#[derive(Clone, Debug)]
pub(super) struct Octree {
    nodes: Vec<Node>,
    centre: Vec3,
    half: f32,
}

impl Octree {
    pub fn new(bounds: &Bounds3) -> Self {
        let half = 0.5 * (bounds.max - bounds.min).max_element();
        Self { nodes: vec![Node::default()], centre: 0.5 * (bounds.min + bounds.max), half: half * 1.001 + 1e-6 }
    }

    /// Adds a record that is valid within `radius` of `p`.
    pub fn insert(&mut self, record: u32, p: Vec3, radius: f32) {
        self.insert_below(0, self.centre, self.half, 0, (record, p, radius));
    }

    fn insert_below(&mut self, node: usize, centre: Vec3, half: f32, depth: u32, record: (u32, Vec3, f32)) {
        let (id, p, radius) = record;
        // Nodes twice as wide as the sphere: it reaches into eight of them at most.
        if half <= 2.0 * radius || depth == MAX_DEPTH {
            self.nodes[node].records.push(id);
            return;
        }
        if self.nodes[node].children == 0 {
            self.nodes[node].children = self.nodes.len() as u32;
            self.nodes.resize(self.nodes.len() + 8, Node::default());
        }
        let first = self.nodes[node].children as usize;
        for child in 0..8 {
            let middle = child_centre(centre, half, child);
            if (p - middle).abs().max_element() <= 0.5 * half + radius {
                self.insert_below(first + child, middle, 0.5 * half, depth + 1, record);
            }
        }
    }

    /// Calls `visit` with every record that may be valid at `p`, always in the same order.
    #[inline]
    pub fn visit(&self, p: Vec3, mut visit: impl FnMut(u32)) {
        let (mut node, mut centre, mut half) = (0usize, self.centre, self.half);
        loop {
            self.nodes[node].records.iter().for_each(|&r| visit(r));
            let first = self.nodes[node].children as usize;
            if first == 0 {
                return;
            }
            let child =
                usize::from(p.x > centre.x) | usize::from(p.y > centre.y) << 1 | usize::from(p.z > centre.z) << 2;
            centre = child_centre(centre, half, child);
            half *= 0.5;
            node = first + child;
        }
    }

    pub fn memory(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.nodes.iter().map(|n| n.records.capacity() * 4).sum::<usize>()
    }
}

/// The middle of a child: bit 0 of its number is the upper half in x, bit 1 in y, bit 2 in z.
#[inline]
fn child_centre(centre: Vec3, half: f32, child: usize) -> Vec3 {
    let side = |bit: usize| if child >> bit & 1 == 1 { 0.5 * half } else { -0.5 * half };
    centre + Vec3::new(side(0), side(1), side(2))
}
