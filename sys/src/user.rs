use crate::{Ray, raw};

/// Primitives whose bounds and intersections are computed in Rust. Called from many threads at once.
/// A panic in any of these functions ends the process, since it cannot pass through Embree.
pub trait UserGeometry: Send + Sync + 'static {
    /// Number of primitives; asked once.
    fn count(&self) -> usize;
    /// Lower and upper corner of a box around the primitive. One that is not finite leaves the primitive out.
    fn bounds(&self, prim: u32) -> ([f32; 3], [f32; 3]);
    /// The nearest hit with `ray.tnear < t ≤ ray.tfar`; anything else is ignored. The ray is in the space of the geometry.
    fn intersect(&self, prim: u32, ray: &Ray) -> Option<UserHit>;
    /// True when there is any hit with `ray.tnear < t ≤ ray.tfar`.
    fn occluded(&self, prim: u32, ray: &Ray) -> bool {
        self.intersect(prim, ray).is_some_and(|hit| in_range(hit.t, ray))
    }
}

/// A hit that a [`UserGeometry`] found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UserHit {
    pub t: f32,
    pub u: f32,
    pub v: f32,
    pub normal: [f32; 3],
    /// What to report as [`Hit::prim`](crate::Hit::prim): need not be the primitive's own number.
    pub prim: u32,
}

#[inline(always)]
fn in_range(t: f32, ray: &Ray) -> bool {
    ray.tnear < t && t <= ray.tfar
}

// Embree passes N rays as a structure of arrays; these are the rows of `RTCRayN` and `RTCHitN`, each of N words.
// For N = 1 they are the fields of `RTCRay` and `RTCHit` in order.
const ORG: usize = 0;
const TNEAR: usize = 3;
const DIR: usize = 4;
const TFAR: usize = 8;
const RAY_ROWS: usize = 12;
const NORMAL: usize = 0;
const U: usize = 3;
const V: usize = 4;
const PRIM_ID: usize = 5;
const GEOM_ID: usize = 6;
const INST_ID: usize = 7;

const _: () = {
    assert!(core::mem::offset_of!(raw::RTCRay, tnear) == 4 * TNEAR);
    assert!(core::mem::offset_of!(raw::RTCRay, dir_x) == 4 * DIR);
    assert!(core::mem::offset_of!(raw::RTCRay, tfar) == 4 * TFAR);
    assert!(core::mem::offset_of!(raw::RTCRayHit, hit) == 4 * RAY_ROWS);
    assert!(core::mem::offset_of!(raw::RTCHit, u) == 4 * U);
    assert!(core::mem::offset_of!(raw::RTCHit, v) == 4 * V);
    assert!(core::mem::offset_of!(raw::RTCHit, primID) == 4 * PRIM_ID);
    assert!(core::mem::offset_of!(raw::RTCHit, geomID) == 4 * GEOM_ID);
    assert!(core::mem::offset_of!(raw::RTCHit, instID) == 4 * INST_ID);
};

/// The words of a packet of rays, or of rays and hits.
#[derive(Clone, Copy)]
struct Rows {
    base: *mut f32,
    n: usize,
}

impl Rows {
    /// # Safety
    /// The packet has `row` and `lane`, and is live.
    #[inline(always)]
    unsafe fn get(self, row: usize, lane: usize) -> f32 {
        // SAFETY: the caller's contract.
        unsafe { *self.base.add(row * self.n + lane) }
    }

    /// # Safety
    /// As `get`, and nobody else uses the packet.
    #[inline(always)]
    unsafe fn set(self, row: usize, lane: usize, value: f32) {
        // SAFETY: the caller's contract.
        unsafe { *self.base.add(row * self.n + lane) = value }
    }

    /// # Safety
    /// As `set`.
    #[inline(always)]
    unsafe fn set_id(self, row: usize, lane: usize, value: u32) {
        // SAFETY: the caller's contract; ids and floats have the same size and alignment.
        unsafe { *self.base.add(row * self.n + lane).cast::<u32>() = value }
    }

    /// # Safety
    /// As `get`.
    #[inline(always)]
    unsafe fn ray(self, lane: usize) -> Ray {
        // SAFETY: the caller's contract; every packet begins with the rows of the ray.
        unsafe {
            let three = |row| [self.get(row, lane), self.get(row + 1, lane), self.get(row + 2, lane)];
            Ray { origin: three(ORG), direction: three(DIR), tnear: self.get(TNEAR, lane), tfar: self.get(TFAR, lane) }
        }
    }
}

/// Embree's callback for bounds.
pub(crate) unsafe extern "C" fn bounds_callback<G: UserGeometry>(args: *const raw::RTCBoundsFunctionArguments) {
    // SAFETY: Embree passes live arguments; the user data is the `G` that the scene keeps.
    let (args, geometry) = unsafe { (&*args, &*(*args).geometryUserPtr.cast_const().cast::<G>()) };
    let (lower, upper) = geometry.bounds(args.primID);
    // SAFETY: Embree passes a live place for the result, which only this call writes to.
    let out = unsafe { &mut *args.bounds_o };
    (out.lower_x, out.lower_y, out.lower_z) = lower.into();
    (out.upper_x, out.upper_y, out.upper_z) = upper.into();
}

/// Embree's callback for the nearest hit.
pub(crate) unsafe extern "C" fn intersect_callback<G: UserGeometry>(args: *const raw::RTCIntersectFunctionNArguments) {
    // SAFETY: Embree passes live arguments; the user data is the `G` that the scene keeps.
    let (args, geometry) = unsafe { (&*args, &*(*args).geometryUserPtr.cast_const().cast::<G>()) };
    let n = args.N as usize;
    let rays = Rows { base: args.rayhit.cast(), n };
    // SAFETY: behind the rows of the ray stand the rows of the hit.
    let hits = Rows { base: unsafe { rays.base.add(RAY_ROWS * n) }, n };
    for lane in 0..n {
        // SAFETY: `valid` has N entries, and the packet N lanes, which are this call's to read and write.
        unsafe {
            if *args.valid.add(lane) == 0 {
                continue;
            }
            let ray = rays.ray(lane);
            let Some(hit) = geometry.intersect(args.primID, &ray).filter(|hit| in_range(hit.t, &ray)) else { continue };
            rays.set(TFAR, lane, hit.t);
            hits.set(NORMAL, lane, hit.normal[0]);
            hits.set(NORMAL + 1, lane, hit.normal[1]);
            hits.set(NORMAL + 2, lane, hit.normal[2]);
            hits.set(U, lane, hit.u);
            hits.set(V, lane, hit.v);
            hits.set_id(PRIM_ID, lane, hit.prim);
            hits.set_id(GEOM_ID, lane, args.geomID);
            let context: &raw::QueryContext = &*args.context;
            for (level, &id) in context.instID.iter().enumerate() {
                hits.set_id(INST_ID + level, lane, id);
            }
        }
    }
}

/// Embree's callback for any hit; a hit is told by a negative infinite end of the ray.
pub(crate) unsafe extern "C" fn occluded_callback<G: UserGeometry>(args: *const raw::RTCOccludedFunctionNArguments) {
    // SAFETY: Embree passes live arguments; the user data is the `G` that the scene keeps.
    let (args, geometry) = unsafe { (&*args, &*(*args).geometryUserPtr.cast_const().cast::<G>()) };
    let rays = Rows { base: args.ray.cast(), n: args.N as usize };
    for lane in 0..rays.n {
        // SAFETY: `valid` has N entries, and the packet N lanes, which are this call's to read and write.
        unsafe {
            if *args.valid.add(lane) != 0 && geometry.occluded(args.primID, &rays.ray(lane)) {
                rays.set(TFAR, lane, f32::NEG_INFINITY);
            }
        }
    }
}
