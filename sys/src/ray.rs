use crate::raw;

/// A ray as Embree takes it: `origin + t·direction`, hits with `tnear < t ≤ tfar`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    pub tnear: f32,
    pub tfar: f32,
}

/// [`Hit::instance`] of geometry that is not instanced.
pub const NO_INSTANCE: u32 = raw::INVALID_ID;

/// The nearest hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    pub t: f32,
    /// Barycentric weights of the second and third vertex, or what a user geometry reported.
    pub u: f32,
    pub v: f32,
    /// Geometric normal, not normalised, in the space of the geometry.
    pub normal: [f32; 3],
    /// Id of the geometry within its scene.
    pub geometry: u32,
    /// Primitive of the geometry.
    pub prim: u32,
    /// Id of the instance in the scene that was asked, or [`NO_INSTANCE`].
    pub instance: u32,
}

impl Ray {
    #[inline(always)]
    pub(crate) fn to_raw(self) -> raw::RTCRay {
        let ([org_x, org_y, org_z], [dir_x, dir_y, dir_z]) = (self.origin, self.direction);
        let (tnear, time, tfar) = (self.tnear, 0.0, self.tfar);
        #[allow(unused_mut)]
        let mut ray = raw::RTCRay {
            org_x,
            org_y,
            org_z,
            tnear,
            dir_x,
            dir_y,
            dir_z,
            time,
            tfar,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        };
        // Embree begins by loading origin and direction sixteen bytes at a time. A load that spans several younger
        // stores waits until they have left the store buffer, so store them the way they will be loaded.
        #[cfg(target_arch = "x86_64")]
        {
            use core::arch::x86_64::{_mm_setr_ps, _mm_store_ps};
            // SAFETY: SSE is part of x86-64; RTCRay is aligned to 16 bytes and begins with org_x … tnear, dir_x … time,
            // eight floats, which bindgen's layout tests check.
            unsafe {
                let floats = (&raw mut ray).cast::<f32>();
                _mm_store_ps(floats, _mm_setr_ps(org_x, org_y, org_z, tnear));
                _mm_store_ps(floats.add(4), _mm_setr_ps(dir_x, dir_y, dir_z, time));
            }
        }
        ray
    }

    /// A query with nothing hit yet.
    #[inline(always)]
    pub(crate) fn to_raw_query(self) -> raw::RTCRayHit {
        // SAFETY: all fields are integers and floats, for which zero bytes are valid.
        let mut hit: raw::RTCHit = unsafe { core::mem::zeroed() };
        hit.geomID = raw::INVALID_ID;
        hit.instID = [raw::INVALID_ID; raw::RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
        raw::RTCRayHit { ray: self.to_raw(), hit }
    }
}

impl Hit {
    #[inline(always)]
    pub(crate) fn from_raw(query: &raw::RTCRayHit) -> Option<Self> {
        let hit = &query.hit;
        if hit.geomID == raw::INVALID_ID {
            return None;
        }
        Some(Self {
            t: query.ray.tfar,
            u: hit.u,
            v: hit.v,
            normal: [hit.Ng_x, hit.Ng_y, hit.Ng_z],
            geometry: hit.geomID,
            prim: hit.primID,
            instance: hit.instID[0],
        })
    }
}
