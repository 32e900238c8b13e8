use crate::scene::Handle;
use crate::{Coherence, Device, Hit, Packet16, Ray, raw};

/// A built scene: immutable, and open to queries from many threads.
pub struct CommittedScene {
    handle: Handle,
}

impl CommittedScene {
    pub(crate) fn new(handle: Handle) -> Self {
        Self { handle }
    }

    /// Lower and upper corner of a box around everything; the lower above the upper when the scene is empty.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        // SAFETY: all fields are floats, for which zero bytes are valid.
        let mut b: raw::RTCBounds = unsafe { core::mem::zeroed() };
        // SAFETY: the scene is live and committed.
        unsafe { raw::rtcGetSceneBounds(self.handle.raw, &mut b) };
        ([b.lower_x, b.lower_y, b.lower_z], [b.upper_x, b.upper_y, b.upper_z])
    }

    /// The nearest hit of one ray.
    #[inline]
    pub fn intersect1(&self, ray: Ray) -> Option<Hit> {
        let mut query = ray.to_raw_query();
        // SAFETY: the scene is live and committed, the query initialised with nothing hit.
        unsafe { raw::intersect1(self.handle.raw, &mut query) };
        Hit::from_raw(&query)
    }

    /// True when anything lies on the ray.
    #[inline]
    pub fn occluded1(&self, ray: Ray) -> bool {
        let mut query = ray.to_raw();
        // SAFETY: the scene is live and committed, the ray initialised.
        unsafe { raw::occluded1(self.handle.raw, &mut query) };
        query.tfar < 0.0
    }

    /// The nearest hits of up to sixteen rays; read them with [`Packet16::hit`]. What is said of their coherence decides how
    /// the tree is walked, not what is found.
    #[inline]
    pub fn intersect16(&self, packet: &mut Packet16, coherence: Coherence) {
        packet.clear_hits();
        // SAFETY: the scene is live and committed; the type aligns the mask, and lanes in use are initialised with
        // nothing hit.
        unsafe {
            raw::intersect16(packet.valid.as_ptr(), self.handle.raw, &mut packet.query, coherence);
        }
    }

    /// Which of up to sixteen similar rays meet anything; read it with [`Packet16::is_occluded`].
    #[inline]
    pub fn occluded16(&self, packet: &mut Packet16) {
        // SAFETY: the scene is live and committed; the type aligns the mask, and lanes in use are initialised.
        unsafe {
            raw::occluded16(packet.valid.as_ptr(), self.handle.raw, &mut packet.query.ray, raw::Coherence::Coherent);
        }
    }

    /// The device that made this scene.
    pub fn device(&self) -> &Device {
        &self.handle.device
    }

    /// Embree's own handle, live as long as `self`; for measurements against the bare library.
    pub fn raw(&self) -> raw::RTCScene {
        self.handle.raw
    }
}
