//! Groups so small that a tree does not pay: every ray tests all triangles, by Plücker coordinates and planes that are
//! computed once. The tree is there for rays from far away. What f32 cannot tell is left to f64, as in the tree, so that
//! hits are the same bit for bit.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::Bvh;
use super::binned::PrimRef;
use super::kernel::Kernel;
use super::parts::{KIND_QUADRIC, KIND_TRIANGLE, Parts};
use super::traverse::{Best, single};
use super::wide::{Child, Tree};
use crate::geometry::{PreciseRay, Ray, ShearedRay};
use crate::math::Vec3;

/// Triangles of a [`FlatBlock`].
pub(super) const FLAT_LANES: usize = 16;
/// Most triangles for which testing all of them is faster than walking a tree.
const FLAT_TRIANGLES: usize = 48;
/// Most analytic shapes beside them.
const FLAT_SINGLES: usize = 4;

/// Whether everything in a group is tested in place of walking a tree.
pub(super) fn fits(triangles: u64, other_shapes: u64) -> bool {
    triangles <= FLAT_TRIANGLES as u64 && other_shapes <= FLAT_SINGLES as u64 && triangles + other_shapes > 0
}

/// Sizes of groups, and of directions, between which nothing below overflows, or is lost below the normal numbers.
const SIZES: std::ops::Range<f32> = 1e-9..1e9;
/// How far rays may start from the origin in units of the farthest corner; others walk the tree.
const FARTHEST: f32 = 16.0;

/// One value for each triangle of a block.
pub(super) type Row = [f32; FLAT_LANES];

/// Sixteen triangles side by side.
///
/// Beside a ray `o + t d` with `m = o × d`, an edge from p to q has the volume `d·(p × q) + m·(q − p)`; the volumes of all
/// three have the sign of `d·N` where the ray meets the triangle, N = (b − a) × (c − a), and `d·N` is their sum. The plane,
/// scaled so that the largest coordinate of its normal n is 1, is met at `t = (n·a − n·o) / n·d`.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(super) struct FlatBlock {
    /// `p × q` of the edges ab and bc.
    pub moment: [[Row; 3]; 2],
    /// `q − p` of the same.
    pub edge: [[Row; 3]; 2],
    /// The normal n, and `n·a`.
    pub normal: [Row; 3],
    pub offset: Row,
    /// What n was divided by: the largest coordinate of N.
    pub area: Row,
    /// Bounds on the error of `n·a − n·o`, without and in units of the largest coordinate of o, and of `n·d` in units of the
    /// largest coordinate of d.
    pub offset_error: Row,
    pub origin_error: Row,
    pub slope_error: Row,
    /// Corners as in [`Block`](super::wide::Block).
    v: [[Row; 3]; 3],
    pub id: [u32; FLAT_LANES],
    /// The shape, and the triangle of the mesh.
    pub shape: [u32; FLAT_LANES],
    pub prim: [u32; FLAT_LANES],
}

/// Everything in a group, and what bounds the errors of volumes.
#[derive(Debug)]
pub(super) struct Flat {
    pub blocks: Vec<FlatBlock>,
    pub singles: ArrayVec<Child, FLAT_SINGLES>,
    /// Triangles in all blocks.
    pub triangles: usize,
    /// Largest coordinate of a corner.
    size: f32,
    /// See [`Flat::prepare`].
    volume_error: f32,
    origin_error: f32,
}

/// A ray beside sixteen triangles at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct FlatRay {
    pub o: [f32; 3],
    pub d: [f32; 3],
    /// `o × d`.
    pub m: [f32; 3],
    /// Largest coordinates of o and d.
    pub reach: f32,
    pub size: f32,
    /// Bound on the error of a volume.
    pub error: f32,
}

/// Up to where a ray is searched.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Nothing is hit beyond, for certain.
    pub beyond: f32,
    /// What is hit before, for certain, is hit.
    pub within: f32,
}

impl Limits {
    #[inline(always)]
    fn new(t: f32) -> Self {
        Self { beyond: t * (1.0 + 8.0 * f32::EPSILON), within: t * (1.0 - 8.0 * f32::EPSILON) }
    }
}

/// A triangle is met no sooner than at `near` / `slope`.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Depths {
    pub near: Row,
    pub slope: Row,
}

/// What the f64 test may itself be wrong by, in units of powers of the size over the area of the triangle. With u = 2⁻⁵³ and
/// R the distance of a corner from the origin of the ray, its edge functions are good to 64 u R² D, and the distance times the
/// determinant to 270 u R³, where both are divided by what scales them there.
const F64_DISTANCE: f64 = 4e-14 * (1.0 + FARTHEST as f64) * (1.0 + FARTHEST as f64) * (1.0 + FARTHEST as f64);
const F64_SLOPE: f64 = 3e-14 * (1.0 + FARTHEST as f64) * (1.0 + FARTHEST as f64);

impl FlatBlock {
    /// No triangle: NaN fails every comparison.
    const EMPTY: Self = Self {
        moment: [[[0.0; FLAT_LANES]; 3]; 2],
        edge: [[[0.0; FLAT_LANES]; 3]; 2],
        normal: [[0.0; FLAT_LANES]; 3],
        offset: [f32::NAN; FLAT_LANES],
        area: [0.0; FLAT_LANES],
        offset_error: [0.0; FLAT_LANES],
        origin_error: [0.0; FLAT_LANES],
        slope_error: [0.0; FLAT_LANES],
        v: [[[f32::NAN; FLAT_LANES]; 3]; 3],
        id: [u32::MAX; FLAT_LANES],
        shape: [0; FLAT_LANES],
        prim: [0; FLAT_LANES],
    };

    fn set(&mut self, lane: usize, id: u32, corners: [Vec3; 3], size: f64) {
        self.id[lane] = id;
        for (row, p) in self.v.iter_mut().zip(corners) {
            set(row, lane, p);
        }
        // Compute in f64, round once.
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        for (k, (p, q)) in [(a, b), (b, c)].into_iter().enumerate() {
            set(&mut self.moment[k], lane, p.cross(q).as_vec3());
            set(&mut self.edge[k], lane, (q - p).as_vec3());
        }
        let n = (b - a).cross(c - a);
        let area = n.abs().max_element();
        // What has no plane is left to f64 always.
        let n = n / area;
        let rounded = n.as_vec3();
        if !(area > 1e-12 * size * size && rounded.is_finite()) {
            self.offset[lane] = 0.0;
            (self.offset_error[lane], self.slope_error[lane]) = (f32::INFINITY, f32::INFINITY);
            return;
        }
        let offset = n.dot(a);
        set(&mut self.normal, lane, rounded);
        self.offset[lane] = offset as f32;
        self.area[lane] = area as f32;
        // Planes across an axis are computed without error but for the last, relative one. Others have three products and as
        // many sums, in units of half of `f32::EPSILON` each.
        let half = f64::from(f32::EPSILON) * 0.5;
        let across = rounded.to_array().into_iter().filter(|&x| x != 0.0).count() == 1;
        let of_normal = (n - rounded.as_dvec3()).abs().element_sum();
        let (sums, products) = if across { (0.0, 0.0) } else { (3.0 * half, 4.0 * half * n.abs().element_sum()) };
        let of_offset = (offset - f64::from(offset as f32)).abs() + sums * offset.abs();
        self.offset_error[lane] = up(of_offset + F64_DISTANCE * size * size * size / area);
        self.origin_error[lane] = up(of_normal + products);
        self.slope_error[lane] = up(of_normal + products + F64_SLOPE * size * size / area);
    }

    #[inline(always)]
    pub fn corner(&self, vertex: usize, lane: usize, [x, y, z]: [usize; 3]) -> [f32; 3] {
        let v = &self.v[vertex];
        [v[x][lane], v[y][lane], v[z][lane]]
    }
}

fn set(rows: &mut [Row; 3], lane: usize, v: Vec3) {
    for (row, x) in rows.iter_mut().zip(v.to_array()) {
        row[lane] = x;
    }
}

/// A bound in f32, with room for the rounding of its products and sums.
fn up(x: f64) -> f32 {
    (x * (1.0 + 8.0 * f64::from(f32::EPSILON))) as f32
}

impl Flat {
    /// `None` when there is too much, or an instance, or nothing, or where sizes are beyond f32.
    pub fn new(refs: &[PrimRef], parts: &Parts) -> Option<Self> {
        // Of many, nothing has to be counted.
        if refs.len() > FLAT_TRIANGLES + FLAT_SINGLES {
            return None;
        }
        let count = |kind| refs.iter().filter(|r| r.kind() == kind).count();
        let (triangles, quadrics) = (count(KIND_TRIANGLE), count(KIND_QUADRIC));
        if !fits(triangles as u64, quadrics as u64) || triangles + quadrics < refs.len() {
            return None;
        }
        let corners: Vec<(u32, [Vec3; 3])> =
            refs.iter().filter(|r| r.kind() == KIND_TRIANGLE).map(|r| (r.id(), parts.triangle(r.id()))).collect();
        let size = corners.iter().flat_map(|(_, t)| t).fold(0f32, |m, p| m.max(p.abs().max_element()));
        // Where there are shapes alone, nothing below is asked.
        let size = if corners.is_empty() { 1.0 } else { size };
        if !SIZES.contains(&size) {
            return None;
        }
        let mut blocks = vec![FlatBlock::EMPTY; triangles.div_ceil(FLAT_LANES)];
        let (mut moment, mut edge, mut area) = (0f64, 0f64, 0f64);
        for (i, &(id, t)) in corners.iter().enumerate() {
            let (block, lane) = (&mut blocks[i / FLAT_LANES], i % FLAT_LANES);
            block.set(lane, id, t, f64::from(size));
            let (part, prim) = parts.find(id);
            (block.shape[lane], block.prim[lane]) = (part.index, prim);
            let [a, b, c] = t.map(|p| p.as_dvec3());
            let sum = |v: DVec3| v.abs().element_sum();
            moment = moment.max(sum(a.cross(b))).max(sum(b.cross(c)));
            edge = edge.max(sum(b - a)).max(sum(c - b));
            area = area.max(sum((b - a).cross(c - a)));
        }
        let singles = refs.iter().filter(|r| r.kind() != KIND_TRIANGLE).map(|r| Child::single(r.kind(), r.id()));
        let of_f64 = f64::from(size) * f64::from(size) / 1024.0;
        let epsilon = f64::from(f32::EPSILON);
        Some(Self {
            blocks,
            singles: singles.collect(),
            triangles,
            size,
            volume_error: up(epsilon * (12.0 * moment + 8.0 * area + of_f64)),
            origin_error: up(epsilon * 36.0 * edge),
        })
    }

    /// `None` for rays that start or reach too far for what is known of errors.
    ///
    /// With ε half of `f32::EPSILON`, D and W the largest coordinates of d and o, and sums of absolute coordinates M of
    /// moments, E of edges and A of N, a volume is good to 9 ε D (M + 3 W E), whether products are fused or not: m is good
    /// to 4 ε W D, the rows to ε, and there are six products and as many sums. The third volume is the difference of
    /// `d·N`, good to 7 ε D A, and the two others: 22 ε D (M + 3 W E) + 9 ε D A. Where `d·N` has the wrong sign all
    /// volumes of a hit are below 5 ε D A.
    #[inline(always)]
    pub fn prepare(&self, ray: &Ray) -> Option<FlatRay> {
        let (ray, fits) = self.measure(ray.o, ray.d);
        fits.then_some(ray)
    }

    /// [`Flat::prepare`] without a branch: whether it is a ray of which enough is known.
    #[inline(always)]
    pub fn measure(&self, o: Vec3, d: Vec3) -> (FlatRay, bool) {
        let (reach, size) = (o.abs().max_element(), d.abs().max_element());
        let fits = (reach <= FARTHEST * self.size) & SIZES.contains(&size);
        let error = size * (self.volume_error + reach * self.origin_error);
        (FlatRay { o: o.to_array(), d: d.to_array(), m: o.cross(d).to_array(), reach, size, error }, fits)
    }
}

/// [`Kernel::flat`] in plain arrays.
#[inline(always)]
pub(super) fn flat_portable<const ANY: bool>(
    block: &FlatBlock,
    ray: &FlatRay,
    limits: Limits,
    depths: &mut Depths,
) -> Option<u32> {
    let dot = |v: &[Row; 3], [x, y, z]: [f32; 3], i: usize| v[0][i] * x + v[1][i] * y + v[2][i] * z;
    let (mut pass, mut hit) = (0, 0);
    for i in 0..FLAT_LANES {
        let slope = dot(&block.normal, ray.d, i);
        let sign = 1f32.copysign(slope);
        let slope = slope * sign;
        let u = (dot(&block.moment[0], ray.d, i) + dot(&block.edge[0], ray.m, i)) * sign;
        let v = (dot(&block.moment[1], ray.d, i) + dot(&block.edge[1], ray.m, i)) * sign;
        let least = (block.area[i] * slope - u - v).min(u.min(v));
        let distance = (block.offset[i] - dot(&block.normal, ray.o, i)) * sign;
        let error = block.offset_error[i] + block.origin_error[i] * ray.reach;
        let slope_error = block.slope_error[i] * ray.size;
        let near = distance - error;
        let ahead = distance >= -error || slope <= slope_error;
        let passes = least >= -ray.error && ahead && near <= (slope + slope_error) * limits.beyond;
        depths.near[i] = near;
        depths.slope[i] = slope + slope_error;
        pass |= u32::from(passes) << i;
        if ANY {
            let far = distance + error;
            let hits = least > ray.error && near > 0.0 && far < (slope - slope_error) * limits.within;
            hit |= u32::from(hits) << i;
        }
    }
    if hit != 0 { None } else { Some(pass) }
}

/// Tests everything.
#[inline(always)]
pub(super) fn test_all<K: Kernel, const ANY: bool>(
    bvh: &Bvh,
    tree: &Tree,
    (flat, flat_ray): (&Flat, &FlatRay),
    ray: &Ray,
    placed: u32,
    best: &mut Best,
) {
    let mut depths = Depths { near: [0.0; FLAT_LANES], slope: [0.0; FLAT_LANES] };
    for block in &flat.blocks {
        let Some(mut mask) = K::flat::<ANY>(block, flat_ray, Limits::new(best.t), &mut depths) else {
            best.found = true;
            return;
        };
        if mask == 0 {
            continue;
        }
        // Let f64 decide about the few that are left.
        let axes = ShearedRay::axes(ray.d);
        let precise = PreciseRay::new(ray, axes);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize % FLAT_LANES;
            mask &= mask - 1;
            // A triangle may lie beyond a hit that was found since the mask was made.
            if !ANY && depths.near[lane] > depths.slope[lane] * Limits::new(best.t).beyond {
                continue;
            }
            let corner = |v: usize| block.corner(v, lane, axes);
            if let Some((t, u, v)) = precise.intersect([corner(0), corner(1), corner(2)], ray.tmax) {
                best.offer(t, u, v, (placed, block.id[lane]));
                if ANY && best.found {
                    return;
                }
            }
        }
    }
    for &child in &flat.singles {
        single::<ANY>(bvh, tree, ray, child, placed, best);
        if ANY && best.found {
            return;
        }
    }
}

#[cfg(test)]
impl Flat {
    /// Forgets all bounds on errors.
    pub fn trust_f32(&mut self) {
        (self.volume_error, self.origin_error) = (0.0, 0.0);
        for b in &mut self.blocks {
            for row in [&mut b.offset_error, &mut b.origin_error, &mut b.slope_error] {
                *row = [0.0; FLAT_LANES];
            }
        }
    }
}
