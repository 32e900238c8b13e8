//! Portable traversal: the reference that the vector kernels are tested against.

use glam::Vec3;

use super::Bvh;
use super::parts::{KIND_QUADRIC, KIND_TRIANGLE};
use super::wide::{Child, Node8, Tree, WIDTH};
use crate::geometry::{Hit, NO_INSTANCE, Ray, Shape, ShearedRay, intersect_triangle};
use crate::math::gamma;

/// Entries of the traversal stack: seven siblings for each level of the deepest tree the builder makes.
const STACK: usize = 1024;

/// A ray prepared for slab tests.
pub(super) struct SlabRay {
    pub o: Vec3,
    /// Reciprocal direction; finite, so that no product with a finite number is NaN.
    pub rcp: Vec3,
    /// Row of [`Node8::bounds`] with the near plane of each axis; the far plane is in row `(near + 3) % 6`.
    pub near: [usize; 3],
}

impl SlabRay {
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        let rcp = ray.d.map(|d| if d.abs() < 1e-37 { 1e37f32.copysign(d) } else { 1.0 / d });
        let near = [0, 1, 2].map(|a| if rcp[a] < 0.0 { a + 3 } else { a });
        Self { o: ray.o, rcp, near }
    }
}

/// Widens the far side of a slab by the rounding of both sides [Ize 2013, "Robust BVH Ray Traversal"].
pub(super) const FAR_SCALE: f32 = 1.0 + 2.0 * gamma(3);

/// Entry distances of the boxes of a node, infinite where the ray misses.
#[inline]
fn entries(node: &Node8, ray: &SlabRay, tmax: f32) -> [f32; WIDTH] {
    std::array::from_fn(|i| {
        let (mut near, mut far) = (0f32, tmax * FAR_SCALE);
        for axis in 0..3 {
            let row = ray.near[axis];
            near = near.max((node.bounds[row][i] - ray.o[axis]) * ray.rcp[axis]);
            far = far.min((node.bounds[(row + 3) % 6][i] - ray.o[axis]) * ray.rcp[axis] * FAR_SCALE);
        }
        if near <= far { near } else { f32::INFINITY }
    })
}

/// The best hit so far, with the rule for equal distances.
#[derive(Clone, Copy)]
pub(super) struct Best {
    /// Upper end of the search; a hit at exactly this distance counts only if its ids are lower.
    pub t: f32,
    pub hit: Option<Hit>,
}

impl Best {
    #[inline]
    pub fn offer(&mut self, hit: Hit) {
        let rank = |h: &Hit| (h.instance.wrapping_add(1), h.shape, h.prim);
        let better = hit.t < self.t || hit.t == self.t && self.hit.is_some_and(|h| rank(&hit) < rank(&h));
        if better {
            *self = Self { t: hit.t, hit: Some(hit) };
        }
    }
}

/// The nearest hit along a ray.
pub(super) fn intersect(bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    let mut best = Best { t: ray.tmax, hit: None };
    walk(bvh, &bvh.top, ray, NO_INSTANCE, &mut best, false);
    best.hit
}

/// True when anything is hit.
pub(super) fn occluded(bvh: &Bvh, ray: &Ray) -> bool {
    let mut best = Best { t: ray.tmax, hit: None };
    walk(bvh, &bvh.top, ray, NO_INSTANCE, &mut best, true);
    best.hit.is_some()
}

/// Visits the tree front to back; stops at the first hit when `any` is set.
fn walk(bvh: &Bvh, tree: &Tree, ray: &Ray, instance: u32, best: &mut Best, any: bool) {
    let Some(sheared) = ShearedRay::new(ray) else { return };
    if tree.root == Child::NONE {
        return;
    }
    let slab = SlabRay::new(ray);
    let mut stack = arrayvec::ArrayVec::<(f32, Child), STACK>::new();
    stack.push((0.0, tree.root));
    while let Some((t, child)) = stack.pop() {
        if t > best.t * FAR_SCALE {
            continue;
        }
        if !child.is_node() {
            leaf(bvh, tree, ray, &sheared, child, instance, best, any);
            if any && best.hit.is_some() {
                return;
            }
            continue;
        }
        // Push the boxes that are hit, the nearest last.
        let node = &tree.nodes[child.0 as usize];
        let first = stack.len();
        for (i, t) in entries(node, &slab, best.t).into_iter().enumerate() {
            if t < f32::INFINITY {
                stack.push((t, node.child[i]));
            }
        }
        stack[first..].sort_by(|a, b| b.0.total_cmp(&a.0));
    }
}

#[allow(clippy::too_many_arguments)]
fn leaf(
    bvh: &Bvh,
    tree: &Tree,
    ray: &Ray,
    sheared: &ShearedRay,
    child: Child,
    instance: u32,
    best: &mut Best,
    any: bool,
) {
    if child.kind() == KIND_TRIANGLE {
        for block in &tree.blocks[child.blocks()] {
            for (lane, &id) in block.id.iter().enumerate() {
                if let Some((t, u, v)) = intersect_triangle(ray, sheared, block.triangle(lane)) {
                    let (part, prim) = tree.parts.find(id);
                    best.offer(Hit { t, u, v, shape: part.index, prim, instance });
                }
            }
        }
        return;
    }
    let (part, _) = tree.parts.find(child.id());
    if child.kind() == KIND_QUADRIC {
        let t = match &bvh.set.shapes[part.index as usize] {
            Shape::Mesh(_) => None,
            Shape::Sphere(s) => s.intersect(ray),
            Shape::Disk(s) => s.intersect(ray),
            Shape::Cylinder(s) => s.intersect(ray),
        };
        if let Some(t) = t {
            best.offer(Hit { t, u: 0.0, v: 0.0, shape: part.index, prim: 0, instance });
        }
        return;
    }
    let placed = &bvh.set.instances[part.index as usize];
    walk(bvh, &bvh.groups[placed.group as usize], &placed.local_ray(ray), part.index, best, any);
}
