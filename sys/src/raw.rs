//! The bindings as bindgen makes them from the installed headers, and the few calls whose form differs between
//! Embree 3 and Embree 4, brought to one form.
#![allow(non_camel_case_types, non_snake_case, non_upper_case_globals, missing_docs)]
#![allow(clippy::all, clippy::pedantic)]

include!(concat!(env!("OUT_DIR"), "/embree.rs"));

/// `RTC_INVALID_GEOMETRY_ID`, whose cast bindgen does not follow.
pub const INVALID_ID: u32 = u32::MAX;

/// What a user-geometry callback learns about the query it serves.
#[cfg(embree3)]
pub type QueryContext = RTCIntersectContext;
/// What a user-geometry callback learns about the query it serves.
#[cfg(embree4)]
pub type QueryContext = RTCRayQueryContext;

/// How similar the rays of a query are.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Coherence {
    Incoherent,
    Coherent,
}

/// The context of a query that starts at the top of a scene.
#[cfg(embree3)]
#[inline(always)]
pub fn context(coherence: Coherence) -> RTCIntersectContext {
    // SAFETY: all fields are integers, floats and an optional function pointer, for which zero bytes are valid.
    let mut context: RTCIntersectContext = unsafe { core::mem::zeroed() };
    context.flags = match coherence {
        Coherence::Incoherent => RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT,
        Coherence::Coherent => RTC_INTERSECT_CONTEXT_FLAG_COHERENT,
    };
    context.instID = [INVALID_ID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    context
}

/// Query arguments that differ from the defaults in coherence alone.
#[cfg(embree4)]
macro_rules! arguments {
    ($type:ty, $coherence:expr) => {{
        // SAFETY: all fields are integers, floats and nullable pointers, for which zero bytes are valid.
        let mut arguments: $type = unsafe { core::mem::zeroed() };
        arguments.flags = match $coherence {
            Coherence::Incoherent => RTC_RAY_QUERY_FLAG_INCOHERENT,
            Coherence::Coherent => RTC_RAY_QUERY_FLAG_COHERENT,
        };
        arguments.feature_mask = RTC_FEATURE_FLAG_ALL;
        arguments
    }};
}

/// `rtcIntersect1` for incoherent rays.
///
/// # Safety
/// `scene` is a live, committed scene; `rayhit` is initialised with `geomID` and `instID` invalid.
#[inline(always)]
pub unsafe fn intersect1(scene: RTCScene, rayhit: &mut RTCRayHit) {
    #[cfg(embree3)]
    // SAFETY: the caller's contract, and the context lives through the call.
    unsafe {
        rtcIntersect1(scene, &mut context(Coherence::Incoherent), rayhit)
    }
    #[cfg(embree4)]
    // SAFETY: the caller's contract; null asks for the default arguments.
    unsafe {
        rtcIntersect1(scene, rayhit, core::ptr::null_mut())
    }
}

/// `rtcOccluded1` for incoherent rays.
///
/// # Safety
/// `scene` is a live, committed scene; `ray` is initialised.
#[inline(always)]
pub unsafe fn occluded1(scene: RTCScene, ray: &mut RTCRay) {
    #[cfg(embree3)]
    // SAFETY: the caller's contract, and the context lives through the call.
    unsafe {
        rtcOccluded1(scene, &mut context(Coherence::Incoherent), ray)
    }
    #[cfg(embree4)]
    // SAFETY: the caller's contract; null asks for the default arguments.
    unsafe {
        rtcOccluded1(scene, ray, core::ptr::null_mut())
    }
}

/// `rtcIntersect16`.
///
/// # Safety
/// `scene` is a live, committed scene; `valid` is aligned to 64 bytes and holds −1 or 0; the lanes in use of
/// `rayhit` are initialised with `geomID` and `instID` invalid.
#[inline(always)]
pub unsafe fn intersect16(valid: *const i32, scene: RTCScene, rayhit: &mut RTCRayHit16, coherence: Coherence) {
    #[cfg(embree3)]
    // SAFETY: the caller's contract, and the context lives through the call.
    unsafe {
        rtcIntersect16(valid, scene, &mut context(coherence), rayhit)
    }
    #[cfg(embree4)]
    let mut arguments = arguments!(RTCIntersectArguments, coherence);
    #[cfg(embree4)]
    // SAFETY: the caller's contract, and the arguments live through the call.
    unsafe {
        rtcIntersect16(valid, scene, rayhit, &mut arguments)
    }
}

/// `rtcOccluded16`.
///
/// # Safety
/// `scene` is a live, committed scene; `valid` is aligned to 64 bytes and holds −1 or 0; the lanes in use of `ray`
/// are initialised.
#[inline(always)]
pub unsafe fn occluded16(valid: *const i32, scene: RTCScene, ray: &mut RTCRay16, coherence: Coherence) {
    #[cfg(embree3)]
    // SAFETY: the caller's contract, and the context lives through the call.
    unsafe {
        rtcOccluded16(valid, scene, &mut context(coherence), ray)
    }
    #[cfg(embree4)]
    let mut arguments = arguments!(RTCOccludedArguments, coherence);
    #[cfg(embree4)]
    // SAFETY: the caller's contract, and the arguments live through the call.
    unsafe {
        rtcOccluded16(valid, scene, ray, &mut arguments)
    }
}
