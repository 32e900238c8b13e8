//! The traversal loop, written once for all instruction sets.

use std::mem::MaybeUninit;

use glam::Vec4;

use super::kernel::Kernel;
use super::parts::KIND_QUADRIC;
use super::wide::{Block, Child, LANES, Tree, WIDTH};
use super::{Bvh, simd};
use crate::geometry::{Hit, NO_INSTANCE, PreciseRay, Ray, ShearedRay};
use crate::math::{Vec3, gamma};

/// Entries of the traversal stack: seven siblings for each level of the deepest tree that the builder makes.
pub(super) const STACK: usize = 1024;

/// Widens the far side of a slab by the rounding of both sides [Ize 2013, "Robust BVH Ray Traversal"].
pub(super) const FAR_SCALE: f32 = 1.0 + 2.0 * gamma(3);

/// Narrows an upper limit by the rounding of a distance along the ray that is computed in f32.
const NEAR_SCALE: f32 = 1.0 - 8.0 * f32::EPSILON;

/// A ray prepared for slab tests.
#[derive(Clone, Copy)]
pub(super) struct SlabRay {
    pub o: Vec3,
    /// Reciprocal direction; finite, and so are its products with `o`.
    pub rcp: Vec3,
    /// Row of [`Node8::bounds`] with the near plane of each axis, and with the far plane.
    pub near: [usize; 3],
    pub far: [usize; 3],
}

impl SlabRay {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let most = 3e38 / (1.0 + ray.o.abs().max_element());
        let rcp = |d: f32| if (1.0 / d).abs() < most { 1.0 / d } else { most.copysign(d) };
        let rcp = Vec3::new(rcp(ray.d.x), rcp(ray.d.y), rcp(ray.d.z));
        let row = |r: f32, a: usize| if r < 0.0 { a + 3 } else { a };
        let near = [row(rcp.x, 0), row(rcp.y, 1), row(rcp.z, 2)];
        let far = [row(-rcp.x, 0), row(-rcp.y, 1), row(-rcp.z, 2)];
        Self { o: ray.o, rcp, near, far }
    }
}

/// The best hit so far, with the rule for equal distances.
#[derive(Clone, Copy)]
pub(super) struct Best {
    /// Upper end of the search; a hit at exactly this distance counts only if its rank is lower.
    pub t: f32,
    u: f32,
    v: f32,
    /// Instance + 1, or 0; then the id in the tree. Both 0 until something is found.
    rank: (u32, u32),
    pub found: bool,
}

impl Best {
    #[inline(always)]
    pub fn offer(&mut self, t: f32, u: f32, v: f32, rank: (u32, u32)) {
        if t < self.t || t == self.t && rank < self.rank {
            *self = Self { t, u, v, rank, found: true };
        }
    }
}

/// The nearest hit along a ray.
#[inline(always)]
pub(super) fn intersect(bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    let mut best = Best { t: ray.tmax, u: 0.0, v: 0.0, rank: (0, 0), found: false };
    simd::walk::<false>(bvh, &bvh.top, ray, 0, &mut best);
    best.found.then(|| {
        let instance = best.rank.0.wrapping_sub(1);
        let tree = if instance == NO_INSTANCE { &bvh.top } else { bvh.group_of(instance) };
        let (part, prim) = tree.parts.find(best.rank.1);
        Hit { t: best.t, u: best.u, v: best.v, shape: part.index, prim, instance }
    })
}

/// True when anything is hit.
#[inline(always)]
pub(super) fn occluded(bvh: &Bvh, ray: &Ray) -> bool {
    let mut best = Best { t: ray.tmax, u: 0.0, v: 0.0, rank: (0, 0), found: false };
    simd::walk::<true>(bvh, &bvh.top, ray, 0, &mut best);
    best.found
}

/// A stack entry: the entry distance in the upper half, so that integers order like distances.
#[inline(always)]
fn entry(near: f32, child: Child) -> u64 {
    (near.to_bits() as u64) << 32 | child.0 as u64
}

/// Searches the tree for the nearest hit, or for any hit when `ANY` is set.
///
/// `placed` is the instance that the tree belongs to, plus one.
#[inline(always)]
pub(super) fn walk<K: Kernel, const ANY: bool, const ROBUST: bool>(
    bvh: &Bvh,
    tree: &Tree,
    ray: &Ray,
    placed: u32,
    best: &mut Best,
) {
    let Some(sheared) = ShearedRay::new(ray) else { return };
    if tree.root == Child::NONE {
        return;
    }
    let kernel = K::new(&SlabRay::new(ray), &sheared);
    if ANY {
        walk_any::<K, ROBUST>(bvh, tree, ray, &kernel, &sheared, placed, best);
    } else {
        walk_nearest::<K, ROBUST>(bvh, tree, ray, &kernel, &sheared, placed, best);
    }
}

/// Visits the tree in any order up to the first hit.
#[inline(always)]
fn walk_any<K: Kernel, const ROBUST: bool>(
    bvh: &Bvh,
    tree: &Tree,
    ray: &Ray,
    kernel: &K,
    sheared: &ShearedRay,
    placed: u32,
    best: &mut Best,
) {
    let (nodes, blocks) = (&tree.nodes[..], &tree.blocks[..]);
    let plain = PlainRay::new(ray);
    // A node is pushed as a whole, so the last one needs room for eight.
    let mut stack = [const { MaybeUninit::<Child>::uninit() }; STACK + WIDTH];
    let mut size = 0;
    let limit = best.t * FAR_SCALE;
    let within = best.t * NEAR_SCALE;
    let mut current = tree.root;
    loop {
        if current.is_node() {
            let node = simd::node_of(nodes, current);
            let mask = kernel.node_any(node, limit);
            if mask != 0 {
                current = node.child[mask.trailing_zeros() as usize & 7];
                let rest = mask & (mask - 1);
                K::prefetch(nodes, blocks, node.child[rest.trailing_zeros() as usize & 7]);
                let top = (&mut stack[size..size + WIDTH]).try_into().expect("eight entries");
                K::push(node, rest, top);
                size += rest.count_ones() as usize;
                continue;
            }
        } else {
            if current.kind() == 0 {
                for block in simd::blocks_of(blocks, current) {
                    if !ROBUST {
                        plain.test(block, placed, best);
                        continue;
                    }
                    let Some(mask) = kernel.block_any(block, within, limit) else {
                        best.found = true;
                        return;
                    };
                    if mask != 0 {
                        decide(mask, block, ray, sheared, placed, best);
                    }
                }
            } else {
                single::<true>(bvh, tree, ray, current, placed, best);
            }
            if best.found {
                return;
            }
        }
        if size == 0 {
            return;
        }
        size -= 1;
        current = simd::read(&stack, size);
    }
}

/// Visits the tree front to back.
#[inline(always)]
fn walk_nearest<K: Kernel, const ROBUST: bool>(
    bvh: &Bvh,
    tree: &Tree,
    ray: &Ray,
    kernel: &K,
    sheared: &ShearedRay,
    placed: u32,
    best: &mut Best,
) {
    let (nodes, blocks) = (&tree.nodes[..], &tree.blocks[..]);
    let plain = PlainRay::new(ray);
    let mut stack = [const { MaybeUninit::<u64>::uninit() }; STACK];
    let mut size = 0;
    let mut near = [0f32; WIDTH];
    let mut limit = best.t * FAR_SCALE;
    let mut current = tree.root;
    loop {
        // Descend to a leaf.
        let mut missed = false;
        while current.is_node() {
            let node = simd::node_of(nodes, current);
            let mut mask = kernel.node(node, limit, &mut near);
            if mask == 0 {
                missed = true;
                break;
            }
            let first = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if mask == 0 {
                current = node.child[first & 7];
                continue;
            }
            let mut a = entry(near[first & 7], node.child[first & 7]);
            let i = mask.trailing_zeros() as usize & 7;
            let mut b = entry(near[i], node.child[i]);
            mask &= mask - 1;
            if mask == 0 {
                (a, b) = (a.min(b), a.max(b));
                K::prefetch(nodes, blocks, Child(b as u32));
                stack[size].write(b);
                size += 1;
                current = Child(a as u32);
                continue;
            }
            // Three or more: sort the new entries, the nearest goes on.
            let base = size;
            K::prefetch(nodes, blocks, Child(a as u32));
            K::prefetch(nodes, blocks, Child(b as u32));
            (a, b) = (a.min(b), a.max(b));
            stack[size].write(b);
            stack[size + 1].write(a);
            size += 2;
            while mask != 0 {
                let i = mask.trailing_zeros() as usize & 7;
                mask &= mask - 1;
                let e = entry(near[i], node.child[i]);
                K::prefetch(nodes, blocks, node.child[i]);
                let mut at = size;
                while at > base {
                    let below = simd::read(&stack, at - 1);
                    if below >= e {
                        break;
                    }
                    stack[at].write(below);
                    at -= 1;
                }
                stack[at].write(e);
                size += 1;
            }
            size -= 1;
            current = Child(simd::read(&stack, size) as u32);
        }
        // Try the leaf.
        if !missed {
            if current.kind() == 0 {
                for block in simd::blocks_of(blocks, current) {
                    if !ROBUST {
                        plain.test(block, placed, best);
                        continue;
                    }
                    let mask = kernel.block(block, best.t * FAR_SCALE);
                    if mask != 0 {
                        decide(mask, block, ray, sheared, placed, best);
                    }
                }
            } else {
                single::<false>(bvh, tree, ray, current, placed, best);
            }
            limit = best.t * FAR_SCALE;
        }
        // Take the next subtree that begins before the best hit.
        let bound = (limit.to_bits() as u64) << 32 | u32::MAX as u64;
        loop {
            if size == 0 {
                return;
            }
            size -= 1;
            let e = simd::read(&stack, size);
            if e <= bound {
                current = Child(e as u32);
                break;
            }
        }
    }
}

/// A ray for the triangle test of [`Mode::Fast`](crate::accel::Mode::Fast)
/// [Möller, Trumbore 1997, "Fast, Minimum Storage Ray-Triangle Intersection"].
#[derive(Clone, Copy)]
struct PlainRay {
    o: [Vec4; 3],
    d: [Vec4; 3],
}

impl PlainRay {
    #[inline(always)]
    fn new(ray: &Ray) -> Self {
        let splat = |v: Vec3| [Vec4::splat(v.x), Vec4::splat(v.y), Vec4::splat(v.z)];
        Self { o: splat(ray.o), d: splat(ray.d) }
    }

    /// Tests four triangles at once in f32, all instruction sets by the same operations.
    #[inline(always)]
    fn test(&self, block: &Block, placed: u32, best: &mut Best) {
        // Written out, as in the kernels: closures handed to `map` are calls.
        let [a, b, c] = &block.v;
        let (ax, ay, az) = (Vec4::from_array(a[0]), Vec4::from_array(a[1]), Vec4::from_array(a[2]));
        let (bx, by, bz) = (Vec4::from_array(b[0]) - ax, Vec4::from_array(b[1]) - ay, Vec4::from_array(b[2]) - az);
        let (cx, cy, cz) = (Vec4::from_array(c[0]) - ax, Vec4::from_array(c[1]) - ay, Vec4::from_array(c[2]) - az);
        let ([ox, oy, oz], [dx, dy, dz]) = (self.o, self.d);
        let (sx, sy, sz) = (ox - ax, oy - ay, oz - az);
        let (px, py, pz) = (dy * cz - dz * cy, dz * cx - dx * cz, dx * cy - dy * cx);
        let (qx, qy, qz) = (sy * bz - sz * by, sz * bx - sx * bz, sx * by - sy * bx);
        // Divide only where there is a hit: compare times the determinant, made positive.
        let det = bx * px + by * py + bz * pz;
        let sign = Vec4::ONE.copysign(det);
        let u = (sx * px + sy * py + sz * pz) * sign;
        let v = (dx * qx + dy * qy + dz * qz) * sign;
        let t = (cx * qx + cy * qy + cz * qz) * sign;
        let det = det * sign;
        let inside = u.cmpge(Vec4::ZERO) & v.cmpge(Vec4::ZERO) & (u + v).cmple(det);
        let mut mask = (inside & t.cmpgt(Vec4::ZERO) & t.cmple(det * best.t)).bitmask();
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            let rcp = 1.0 / det.to_array()[lane];
            let [t, u, v] = [t.to_array()[lane] * rcp, u.to_array()[lane] * rcp, v.to_array()[lane] * rcp];
            best.offer(t, u, v, (placed, block.id[lane]));
        }
    }
}

/// Decides in f64 about the few triangles of a block that may be hit as far as f32 can tell.
#[inline(never)]
fn decide(mut mask: u32, block: &Block, ray: &Ray, sheared: &ShearedRay, placed: u32, best: &mut Best) {
    let precise = PreciseRay::new(ray, sheared.k);
    let [x, y, z] = sheared.k;
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize % LANES;
        mask &= mask - 1;
        let corner = |v: usize| [block.v[v][x][lane], block.v[v][y][lane], block.v[v][z][lane]];
        if let Some((t, u, v)) = precise.intersect([corner(0), corner(1), corner(2)], ray.tmax) {
            best.offer(t, u, v, (placed, block.id[lane]));
        }
    }
}

/// Tests an analytic shape or enters an instance.
#[inline(never)]
pub(super) fn single<const ANY: bool>(bvh: &Bvh, tree: &Tree, ray: &Ray, child: Child, placed: u32, best: &mut Best) {
    let (part, _) = tree.parts.find(child.id());
    if child.kind() == KIND_QUADRIC {
        if let Some(t) = bvh.set.shapes[part.index as usize].intersect_quadric(ray) {
            best.offer(t, 0.0, 0.0, (placed, child.id()));
        }
        return;
    }
    let local = bvh.set.instances[part.index as usize].local_ray(ray);
    simd::walk::<ANY>(bvh, bvh.group_of(part.index), &local, part.index + 1, best);
}
