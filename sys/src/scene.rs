use std::any::Any;
use std::ffi::c_void;
use std::sync::Arc;

use crate::user::{UserGeometry, bounds_callback, intersect_callback, occluded_callback};
use crate::{CommittedScene, Device, Error, raw};

/// The buffers of a triangle mesh.
#[derive(Clone, Copy, Debug)]
pub struct TriangleBuffers<'a> {
    /// Positions; longer than `vertex_count`, so that 16 bytes can be read from the last vertex on.
    pub positions: &'a [[f32; 3]],
    /// How many of the positions are vertices.
    pub vertex_count: usize,
    pub indices: &'a [[u32; 3]],
}

/// A scene's handle and all that Embree reads through it.
pub(crate) struct Handle {
    pub(crate) raw: raw::RTCScene,
    pub(crate) device: Device,
    /// Owners of shared buffers and user data, and instanced scenes. Never read; dropped after the scene.
    keep: Vec<Arc<dyn Any + Send + Sync>>,
}

// SAFETY: a scene may be used from any thread. Changing it takes `&mut Scene` or the scene itself; the shared
// functions of `CommittedScene` are queries, which Embree allows from many threads at once. What it reads is
// `Send + Sync` too.
unsafe impl Send for Handle {}
// SAFETY: as above.
unsafe impl Sync for Handle {}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: the handle is live and this reference is ours; `keep` and `device` are dropped after it.
        unsafe { raw::rtcReleaseScene(self.raw) }
    }
}

/// A geometry before it belongs to a scene.
struct Geometry(raw::RTCGeometry);

impl Geometry {
    fn new(device: &Device, kind: raw::RTCGeometryType) -> Result<Self, Error> {
        // SAFETY: the device is live.
        let handle = unsafe { raw::rtcNewGeometry(device.raw(), kind) };
        if handle.is_null() { Err(device.failure()) } else { Ok(Self(handle)) }
    }

    /// Shares `items` with Embree.
    ///
    /// # Safety
    /// `items` stays where it is, unchanged, as long as the geometry lives; `T` has the layout of `format`.
    unsafe fn share<T>(&self, buffer: raw::RTCBufferType, format: raw::RTCFormat, items: &[T], count: usize) {
        debug_assert!(count <= items.len());
        // SAFETY: the geometry is live, the pointer is aligned to 4 bytes and holds `count` items of this stride.
        unsafe {
            raw::rtcSetSharedGeometryBuffer(self.0, buffer, 0, format, items.as_ptr().cast(), 0, size_of::<T>(), count);
        }
    }
}

impl Drop for Geometry {
    fn drop(&mut self) {
        // SAFETY: the handle is live and this reference is ours; a scene it was attached to holds its own.
        unsafe { raw::rtcReleaseGeometry(self.0) }
    }
}

/// How much time a build may take for the sake of the queries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    Low,
    Medium,
    /// Not deterministic: the tree may differ from run to run.
    High,
}

impl Quality {
    fn raw(self) -> raw::RTCBuildQuality {
        match self {
            Self::Low => raw::RTC_BUILD_QUALITY_LOW,
            Self::Medium => raw::RTC_BUILD_QUALITY_MEDIUM,
            Self::High => raw::RTC_BUILD_QUALITY_HIGH,
        }
    }
}

/// A scene under construction. Geometry ids are the caller's choice; Embree keeps tables up to the largest.
pub struct Scene {
    handle: Handle,
    quality: Quality,
}

impl Scene {
    /// An empty scene, to be built at MEDIUM quality with the ROBUST flag.
    pub fn new(device: &Device) -> Result<Self, Error> {
        Self::with(device, Quality::Medium, true)
    }

    /// An empty scene; `robust` sets the ROBUST flag, which makes queries watertight.
    pub fn with(device: &Device, quality: Quality, robust: bool) -> Result<Self, Error> {
        // SAFETY: the device is live.
        let raw = unsafe { raw::rtcNewScene(device.raw()) };
        if raw.is_null() {
            return Err(device.failure());
        }
        let handle = Handle { raw, device: device.clone(), keep: Vec::new() };
        // SAFETY: the scene is live and not committed.
        unsafe {
            raw::rtcSetSceneFlags(raw, if robust { raw::RTC_SCENE_FLAG_ROBUST } else { raw::RTC_SCENE_FLAG_NONE });
            raw::rtcSetSceneBuildQuality(raw, quality.raw());
        }
        device.check()?;
        Ok(Self { handle, quality })
    }

    /// Adds a triangle mesh without copying it. `buffers` is asked once; the scene keeps `owner`.
    pub fn add_triangles<O: Send + Sync + 'static>(
        &mut self,
        id: u32,
        owner: Arc<O>,
        buffers: impl for<'a> FnOnce(&'a O) -> TriangleBuffers<'a>,
    ) -> Result<(), Error> {
        let TriangleBuffers { positions, vertex_count, indices } = buffers(&owner);
        check_padding(positions, vertex_count)?;
        check_indices(indices, vertex_count)?;
        let geometry = Geometry::new(&self.handle.device, raw::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        // SAFETY: the slices borrow from `*owner` for any lifetime, so they are valid and unchanged as long as nobody
        // can have `&mut` to it, that is as long as the scene keeps its `Arc`. The formats match the element types.
        unsafe {
            geometry.share(raw::RTC_BUFFER_TYPE_VERTEX, raw::RTC_FORMAT_FLOAT3, positions, vertex_count);
            geometry.share(raw::RTC_BUFFER_TYPE_INDEX, raw::RTC_FORMAT_UINT3, indices, indices.len());
        }
        self.attach(id, geometry, owner)
    }

    /// Adds spheres without copying them: centre and radius of each. Embree's own test, in single precision.
    pub fn add_spheres<O: Send + Sync + 'static>(
        &mut self,
        id: u32,
        owner: Arc<O>,
        spheres: impl for<'a> FnOnce(&'a O) -> &'a [[f32; 4]],
    ) -> Result<(), Error> {
        let spheres = spheres(&owner);
        check_count("spheres", spheres.len())?;
        let geometry = Geometry::new(&self.handle.device, raw::RTC_GEOMETRY_TYPE_SPHERE_POINT)?;
        // SAFETY: as in `add_triangles`; an element is 16 bytes, so nothing behind the last one is read.
        unsafe { geometry.share(raw::RTC_BUFFER_TYPE_VERTEX, raw::RTC_FORMAT_FLOAT4, spheres, spheres.len()) };
        self.attach(id, geometry, owner)
    }

    /// Adds primitives whose bounds and intersections Rust computes.
    pub fn add_user<G: UserGeometry>(&mut self, id: u32, user: Arc<G>) -> Result<(), Error> {
        check_count("user primitives", user.count())?;
        let geometry = Geometry::new(&self.handle.device, raw::RTC_GEOMETRY_TYPE_USER)?;
        let data = Arc::as_ptr(&user).cast_mut().cast::<c_void>();
        // SAFETY: the geometry is live. The callbacks take the user data for `&G`: it is one, and the scene keeps its
        // `Arc`; `G` is `Sync`, so Embree may call them from its threads.
        unsafe {
            raw::rtcSetGeometryUserData(geometry.0, data);
            raw::rtcSetGeometryUserPrimitiveCount(geometry.0, user.count() as u32);
            raw::rtcSetGeometryBoundsFunction(geometry.0, Some(bounds_callback::<G>), data);
            raw::rtcSetGeometryIntersectFunction(geometry.0, Some(intersect_callback::<G>));
            raw::rtcSetGeometryOccludedFunction(geometry.0, Some(occluded_callback::<G>));
        }
        self.attach(id, geometry, user)
    }

    /// Places `scene` under an affine map: the columns of its linear part, then its translation.
    /// One level of instances is all that Debian's Embree has.
    pub fn add_instance(&mut self, id: u32, scene: Arc<CommittedScene>, columns: [[f32; 3]; 4]) -> Result<(), Error> {
        let geometry = Geometry::new(&self.handle.device, raw::RTC_GEOMETRY_TYPE_INSTANCE)?;
        // SAFETY: both handles are live, the matrix is 12 floats as the format says and is copied in the call; the
        // instanced scene is kept by ours.
        unsafe {
            raw::rtcSetGeometryInstancedScene(geometry.0, scene.raw());
            let format = raw::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR;
            raw::rtcSetGeometryTransform(geometry.0, 0, format, columns.as_ptr().cast());
        }
        self.attach(id, geometry, scene)
    }

    /// Builds the tree, with Embree's threads.
    pub fn commit(self) -> Result<CommittedScene, Error> {
        // SAFETY: the scene is live, and nobody else has it.
        unsafe { raw::rtcCommitScene(self.handle.raw) };
        self.handle.device.check()?;
        Ok(CommittedScene::new(self.handle))
    }

    fn attach(&mut self, id: u32, geometry: Geometry, owner: Arc<dyn Any + Send + Sync>) -> Result<(), Error> {
        // Keep the owner first: from the attachment on the scene reads its memory.
        self.handle.keep.push(owner);
        // SAFETY: both handles are live, and the scene is not committed.
        unsafe {
            raw::rtcSetGeometryBuildQuality(geometry.0, self.quality.raw());
            raw::rtcCommitGeometry(geometry.0);
            raw::rtcAttachGeometryByID(self.handle.raw, geometry.0, id);
        }
        self.handle.device.check()
    }
}

/// Embree reads vertices with 16-byte loads, 4 bytes more than a vertex has.
fn check_padding(positions: &[[f32; 3]], vertex_count: usize) -> Result<(), Error> {
    check_count("vertices", vertex_count)?;
    let needed = if vertex_count == 0 { 0 } else { vertex_count * size_of::<[f32; 3]>() + 4 };
    match needed.saturating_sub(size_of_val(positions)) {
        0 => Ok(()),
        missing_bytes => Err(Error::Padding { vertices: vertex_count, missing_bytes }),
    }
}

fn check_indices(indices: &[[u32; 3]], vertices: usize) -> Result<(), Error> {
    check_count("triangles", indices.len())?;
    // The largest index of all decides; only a failure looks for the culprit.
    let largest = indices.iter().flatten().copied().max();
    if largest.is_none_or(|i| (i as usize) < vertices) {
        return Ok(());
    }
    let out = |t: &[u32; 3]| t.iter().copied().find(|&i| i as usize >= vertices);
    let (triangle, index) =
        indices.iter().enumerate().find_map(|(n, t)| Some((n, out(t)?))).expect("the largest index is out of range");
    Err(Error::Index { triangle, index, vertices })
}

fn check_count(what: &'static str, count: usize) -> Result<(), Error> {
    if count < u32::MAX as usize { Ok(()) } else { Err(Error::TooMany { what, count }) }
}
