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
        raw::RTCRay {
            org_x: self.origin[0],
            org_y: self.origin[1],
            org_z: self.origin[2],
            tnear: self.tnear,
            dir_x: self.direction[0],
            dir_y: self.direction[1],
            dir_z: self.direction[2],
            time: 0.0,
            tfar: self.tfar,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        }
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
