//! Many rays at once through groups that have no tree: sixteen rays side by side meet one triangle, or one sphere, after the
//! other. Hits are those of a ray alone, bit for bit: f32 only tells which triangles cannot be the nearest, and f64 decides
//! about the rest. By AVX-512 alone: with eight rays side by side, sixteen triangles beside one ray are faster.

use super::flat::{FLAT_LANES, Flat, FlatBlock, FlatRay, Row};
use super::simd::Task;
use super::traverse;
use super::wide::{Child, Tree};
use super::{Bvh, simd};
use crate::geometry::{Hit, NO_INSTANCE, PreciseRay, Ray, Shape, ShearedRay, Sphere, is_traceable};
use crate::math::Vec3;

/// Rays that are searched together.
const RAYS: usize = FLAT_LANES;

/// Room for the rounding of a few products and quotients, relative to 1.
const ROOM: f32 = 8.0 * f32::EPSILON;

/// One value for each ray.
type Words = [u32; RAYS];
type Rows3 = [Row; 3];

/// The nearest hit of each of `rays`, into `hits`.
#[inline(always)]
pub(super) fn intersect_all<'a>(
    bvh: &Bvh,
    flat: &Flat,
    mut rays: impl Iterator<Item = &'a Ray>,
    hits: &mut [Option<Hit>],
) {
    for hits in hits.chunks_mut(RAYS) {
        let mut wave = Wave::NONE;
        let mut len = 0;
        for ray in rays.by_ref().take(hits.len()) {
            wave.set(len, ray);
            len += 1;
        }
        simd::run(Search { bvh, flat, wave: &mut wave, hits: &mut hits[..len] });
    }
}

/// Sixteen rays, and the nearest hits of them so far.
#[repr(C, align(64))]
pub(super) struct Wave {
    pub o: Rows3,
    pub d: Rows3,
    /// As in [`FlatRay`].
    pub m: Rows3,
    pub reach: Row,
    pub size: Row,
    pub error: Row,
    pub tmax: Row,
    /// 1 for rays that are searched here, and for those that are searched alone.
    here: Words,
    alone: Words,
    /// The nearest hit: `t` is `tmax` where there is none.
    t: Row,
    u: Row,
    v: Row,
    /// Of equal distances the lowest wins.
    id: Words,
    shape: Words,
    prim: Words,
}

/// The triangles that may be the nearest, by ray.
#[repr(C, align(64))]
pub(super) struct Candidates {
    /// A bit for each: words of 32.
    pub bits: [Words; 2],
    /// None of them is met before, for certain.
    pub least: Row,
    /// Something is hit up to here, for certain.
    pub most: Row,
}

#[inline(always)]
fn column(rows: &Rows3, lane: usize) -> [f32; 3] {
    [rows[0][lane], rows[1][lane], rows[2][lane]]
}

impl Wave {
    const NONE: Self = Self {
        o: [[0.0; RAYS]; 3],
        d: [[0.0; RAYS]; 3],
        m: [[0.0; RAYS]; 3],
        reach: [0.0; RAYS],
        size: [0.0; RAYS],
        // Nothing is inside by a NaN.
        error: [f32::NAN; RAYS],
        tmax: [0.0; RAYS],
        here: [0; RAYS],
        alone: [0; RAYS],
        t: [0.0; RAYS],
        u: [0.0; RAYS],
        v: [0.0; RAYS],
        id: [0; RAYS],
        shape: [0; RAYS],
        prim: [0; RAYS],
    };

    /// Takes a ray.
    #[inline(always)]
    fn set(&mut self, lane: usize, ray: &Ray) {
        for axis in 0..3 {
            (self.o[axis][lane], self.d[axis][lane]) = (ray.o[axis], ray.d[axis]);
        }
        (self.tmax[lane], self.here[lane]) = (ray.tmax, 1);
    }

    /// Finds out what the search has to know of all rays. Those that start or reach too far for what is known of errors are
    /// left to be searched alone.
    #[inline(always)]
    fn prepare(&mut self, flat: &Flat) {
        for j in 0..RAYS {
            let (o, d) = self.vectors(j);
            let traceable = (self.here[j] != 0) & is_traceable(&Ray::segment(o, d, self.tmax[j]));
            let (FlatRay { m, reach, size, error, .. }, fits) = flat.measure(o, d);
            let here = traceable & fits;
            (self.m[0][j], self.m[1][j], self.m[2][j]) = (m[0], m[1], m[2]);
            (self.reach[j], self.size[j], self.error[j]) = (reach, size, if here { error } else { f32::NAN });
            (self.here[j], self.alone[j]) = (here as u32, (traceable & !fits) as u32);
            self.t[j] = if here { self.tmax[j] } else { 0.0 };
        }
    }

    #[inline(always)]
    fn vectors(&self, lane: usize) -> (Vec3, Vec3) {
        (column(&self.o, lane).into(), column(&self.d, lane).into())
    }

    /// Takes a hit if it is nearer than that of the ray so far.
    #[inline(always)]
    fn offer(&mut self, lane: usize, hit: (bool, f32, f32, f32), id: u32, shape: u32, prim: u32) {
        let (met, t, u, v) = hit;
        let nearer = (self.here[lane] != 0) & met & ((t < self.t[lane]) | ((t == self.t[lane]) & (id < self.id[lane])));
        self.t[lane] = if nearer { t } else { self.t[lane] };
        self.u[lane] = if nearer { u } else { self.u[lane] };
        self.v[lane] = if nearer { v } else { self.v[lane] };
        self.id[lane] = if nearer { id } else { self.id[lane] };
        self.shape[lane] = if nearer { shape } else { self.shape[lane] };
        self.prim[lane] = if nearer { prim } else { self.prim[lane] };
    }
}

/// The search of one [`Wave`] for one instruction set.
struct Search<'a> {
    bvh: &'a Bvh,
    flat: &'a Flat,
    wave: &'a mut Wave,
    hits: &'a mut [Option<Hit>],
}

impl Task for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { bvh, flat, wave, hits } = self;
        wave.prepare(flat);
        if flat.triangles > 0 {
            let mut c = Candidates { bits: [[0; RAYS]; 2], least: [f32::INFINITY; RAYS], most: [0.0; RAYS] };
            for lane in 0..RAYS {
                c.most[lane] = wave.t[lane] * (1.0 + ROOM);
            }
            simd::meet_triangles(bvh.isa, wave, &mut c, flat);
            decide(wave, &c, flat);
        }
        for &child in &flat.singles {
            meet_quadric(bvh, &bvh.top, wave, child);
        }
        for (lane, hit) in hits.iter_mut().enumerate() {
            if wave.alone[lane] != 0 {
                let (o, d) = wave.vectors(lane);
                *hit = traverse::intersect(bvh, &Ray::segment(o, d, wave.tmax[lane]));
                continue;
            }
            let met = (wave.here[lane] != 0) & (wave.t[lane] < wave.tmax[lane]);
            *hit = met.then(|| Hit {
                t: wave.t[lane],
                u: wave.u[lane],
                v: wave.v[lane],
                shape: wave.shape[lane],
                prim: wave.prim[lane],
                instance: NO_INSTANCE,
            });
        }
    }
}

/// Lets f64 decide about what is left: of each ray one triangle together with those of the others, the few further ones alone.
#[inline(always)]
fn decide(w: &mut Wave, c: &Candidates, flat: &Flat) {
    let mut corners = [[[0.0; RAYS]; 3]; 3];
    let (mut o, mut d) = ([[0.0; RAYS]; 3], [[0.0; RAYS]; 3]);
    let (mut id, mut shape, mut prim) = ([u32::MAX; RAYS], [0; RAYS], [0; RAYS]);
    let mut further = [0u64; RAYS];
    for j in 0..RAYS {
        let bits = u64::from(c.bits[0][j]) | u64::from(c.bits[1][j]) << 32;
        if bits == 0 {
            continue;
        }
        let (block, lane) = place(flat, bits);
        further[j] = bits & (bits - 1);
        let axes = ShearedRay::axes(w.vectors(j).1);
        for (vertex, rows) in corners.iter_mut().enumerate() {
            let [x, y, z] = block.corner(vertex, lane, axes);
            (rows[0][j], rows[1][j], rows[2][j]) = (x, y, z);
        }
        for (k, axis) in axes.into_iter().enumerate() {
            (o[k][j], d[k][j]) = (w.o[axis][j], w.d[axis][j]);
        }
        (id[j], shape[j], prim[j]) = (block.id[lane], block.shape[lane], block.prim[lane]);
    }
    for j in 0..RAYS {
        let ray = PreciseRay::permuted(column(&o, j), column(&d, j));
        let tri = [column(&corners[0], j), column(&corners[1], j), column(&corners[2], j)];
        let (met, t, u, v) = ray.meet(tri, w.tmax[j]);
        w.offer(j, (met & (id[j] != u32::MAX), t, u, v), id[j], shape[j], prim[j]);
    }
    for (j, mut bits) in further.into_iter().enumerate() {
        while bits != 0 {
            let (block, lane) = place(flat, bits);
            bits &= bits - 1;
            let (o, d) = w.vectors(j);
            let axes = ShearedRay::axes(d);
            let corner = |v: usize| block.corner(v, lane, axes);
            let ray = PreciseRay::new(&Ray::new(o, d), axes);
            let hit = ray.meet([corner(0), corner(1), corner(2)], w.tmax[j]);
            w.offer(j, hit, block.id[lane], block.shape[lane], block.prim[lane]);
        }
    }
}

/// The block and the lane of the first triangle of `bits`.
#[inline(always)]
fn place(flat: &Flat, bits: u64) -> (&FlatBlock, usize) {
    let i = bits.trailing_zeros() as usize;
    (&flat.blocks[i / FLAT_LANES], i % FLAT_LANES)
}

#[inline(always)]
fn meet_quadric(bvh: &Bvh, tree: &Tree, w: &mut Wave, child: Child) {
    let (part, _) = tree.parts.find(child.id());
    match &bvh.set.shapes[part.index as usize] {
        Shape::Sphere(sphere) => meet_sphere(w, sphere, child.id(), part.index),
        shape => {
            for j in 0..RAYS {
                if w.here[j] == 0 {
                    continue;
                }
                let (o, d) = w.vectors(j);
                if let Some(t) = shape.intersect_quadric(&Ray::segment(o, d, w.tmax[j])) {
                    w.offer(j, (true, t, 0.0, 0.0), child.id(), part.index, 0);
                }
            }
        }
    }
}

#[inline(always)]
fn meet_sphere(w: &mut Wave, sphere: &Sphere, id: u32, shape: u32) {
    let sphere = *sphere;
    for j in 0..RAYS {
        let (o, d) = w.vectors(j);
        let (met, t) = sphere.meet(o, d, w.tmax[j]);
        w.offer(j, (met, t, 0.0, 0.0), id, shape, 0);
    }
}
