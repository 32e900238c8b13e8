use crate::{Hit, Ray, raw};

/// Up to sixteen rays that are traced together, and their hits.
#[repr(C, align(64))]
#[derive(Clone)]
pub struct Packet16 {
    /// −1 for lanes in use, 0 for the rest.
    pub(crate) valid: [i32; 16],
    pub(crate) query: raw::RTCRayHit16,
    len: usize,
}

// Embree asks for a mask and a packet that are aligned to 64 bytes.
const _: () = assert!(core::mem::offset_of!(Packet16, query) % 64 == 0 && align_of::<Packet16>() >= 64);

impl Default for Packet16 {
    fn default() -> Self {
        // SAFETY: all fields are integers and floats, for which zero bytes are valid.
        Self { valid: [0; 16], query: unsafe { core::mem::zeroed() }, len: 0 }
    }
}

impl Packet16 {
    /// Rays in the packet.
    #[inline]
    pub fn len(&self) -> usize {
        self.len
    }

    #[inline]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Replaces the rays by the first sixteen of `rays`.
    #[inline]
    pub fn set(&mut self, rays: impl IntoIterator<Item = Ray>) {
        self.valid = [0; 16];
        self.len = 0;
        for (lane, ray) in rays.into_iter().take(16).enumerate() {
            let r = &mut self.query.ray;
            [r.org_x[lane], r.org_y[lane], r.org_z[lane]] = ray.origin;
            [r.dir_x[lane], r.dir_y[lane], r.dir_z[lane]] = ray.direction;
            (r.tnear[lane], r.tfar[lane]) = (ray.tnear, ray.tfar);
            (r.time[lane], r.mask[lane], r.id[lane], r.flags[lane]) = (0.0, u32::MAX, 0, 0);
            self.valid[lane] = -1;
            self.len = lane + 1;
        }
    }

    pub(crate) fn clear_hits(&mut self) {
        self.query.hit.geomID = [raw::INVALID_ID; 16];
        self.query.hit.instID = [[raw::INVALID_ID; 16]; raw::RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    }

    /// What [`intersect16`](crate::CommittedScene::intersect16) found for a ray.
    ///
    /// # Panics
    /// When there is no such ray.
    #[inline]
    pub fn hit(&self, lane: usize) -> Option<Hit> {
        assert!(lane < self.len, "the packet has {} rays, asked for {lane}", self.len);
        let hit = &self.query.hit;
        if hit.geomID[lane] == raw::INVALID_ID {
            return None;
        }
        Some(Hit {
            t: self.query.ray.tfar[lane],
            u: hit.u[lane],
            v: hit.v[lane],
            normal: [hit.Ng_x[lane], hit.Ng_y[lane], hit.Ng_z[lane]],
            geometry: hit.geomID[lane],
            prim: hit.primID[lane],
            instance: hit.instID[0][lane],
        })
    }

    /// What [`occluded16`](crate::CommittedScene::occluded16) found for a ray.
    ///
    /// # Panics
    /// When there is no such ray.
    #[inline]
    pub fn is_occluded(&self, lane: usize) -> bool {
        assert!(lane < self.len, "the packet has {} rays, asked for {lane}", self.len);
        self.query.ray.tfar[lane] < 0.0
    }
}
