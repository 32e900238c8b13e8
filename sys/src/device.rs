use std::ffi::{CString, c_char, c_void};
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::copy_text;
use crate::{Error, ErrorKind, raw};

/// What Embree's callbacks write to. Its address is given to Embree, so it sits behind the `Arc` of the device.
#[derive(Default)]
struct Monitor {
    /// The first failure since it was last taken.
    error: Mutex<Option<Error>>,
    /// Bytes that Embree holds.
    bytes: AtomicIsize,
}

struct Inner {
    raw: raw::RTCDevice,
    monitor: Monitor,
}

// SAFETY: Embree's device functions may be called from any thread; the monitor is synchronised by itself.
unsafe impl Send for Inner {}
// SAFETY: as above.
unsafe impl Sync for Inner {}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: the handle is live and this is the one reference we own. Scenes hold an `Arc` of this device, so all
        // of them are gone; the monitor outlives this call.
        unsafe { raw::rtcReleaseDevice(self.raw) }
    }
}

/// Embree's device: makes scenes, counts their memory, collects their errors.
#[derive(Clone)]
pub struct Device {
    inner: Arc<Inner>,
}

impl Device {
    /// Makes a device. `config` is Embree's own configuration text, for example `threads=2`; empty for the defaults.
    pub fn new(config: &str) -> Result<Self, Error> {
        let config = CString::new(config).map_err(|_| Error::Config)?;
        // SAFETY: the text is a C string and lives through the call.
        let handle = unsafe { raw::rtcNewDevice(config.as_ptr()) };
        if handle.is_null() {
            return Err(creation_error());
        }
        let device = Self { inner: Arc::new(Inner { raw: handle, monitor: Monitor::default() }) };
        let monitor = (&raw const device.inner.monitor) as *mut c_void;
        // SAFETY: the monitor sits in the `Arc`, so its address is fixed, and it is dropped after the device is
        // released; the callbacks touch it through shared references only.
        unsafe {
            raw::rtcSetDeviceErrorFunction(handle, Some(on_error), monitor);
            raw::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), monitor);
        }
        device.check()?;
        Ok(device)
    }

    /// Bytes that Embree holds for everything made by this device, without shared buffers.
    pub fn memory(&self) -> usize {
        self.inner.monitor.bytes.load(Ordering::Relaxed).max(0) as usize
    }

    /// Version of the library that is running, for example `4.3.3`.
    pub fn version(&self) -> String {
        let part = |p| self.property(p);
        let (major, minor) =
            (part(raw::RTC_DEVICE_PROPERTY_VERSION_MAJOR), part(raw::RTC_DEVICE_PROPERTY_VERSION_MINOR));
        format!("{major}.{minor}.{}", part(raw::RTC_DEVICE_PROPERTY_VERSION_PATCH))
    }

    /// The widest instruction set that both the library and this processor have. Embree does not name it;
    /// it is told by the widest packet that it traces natively, and AVX from AVX2 by the processor.
    pub fn isa(&self) -> &'static str {
        if self.property(raw::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0 {
            "AVX-512"
        } else if self.property(raw::RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) != 0 {
            if cpu_has_avx2() { "AVX2" } else { "AVX" }
        } else if cfg!(target_arch = "aarch64") {
            "NEON"
        } else {
            "SSE"
        }
    }

    fn property(&self, property: raw::RTCDeviceProperty) -> isize {
        // SAFETY: the handle is live.
        unsafe { raw::rtcGetDeviceProperty(self.inner.raw, property) }
    }

    pub(crate) fn raw(&self) -> raw::RTCDevice {
        self.inner.raw
    }

    /// The first failure since the last check. Embree reports to the device, so when two threads build with one
    /// device a failure may be seen by the other of them, but it is never lost.
    pub(crate) fn check(&self) -> Result<(), Error> {
        match self.inner.monitor.error.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// The failure behind a null handle.
    pub(crate) fn failure(&self) -> Error {
        self.check().err().unwrap_or_else(|| Error::embree(ErrorKind::Unknown, ""))
    }
}

/// Why `rtcNewDevice` gave nothing: there is no device yet to report to, so Embree keeps it per thread.
fn creation_error() -> Error {
    #[cfg(embree_error_text)]
    // SAFETY: a null device asks for this thread's last message, which lives until the next failure in this thread.
    let text = unsafe { copy_text(raw::rtcGetDeviceLastErrorMessage(std::ptr::null_mut())) };
    #[cfg(not(embree_error_text))]
    let text = "no device could be made";
    // SAFETY: a null device asks for this thread's last error code.
    let code = unsafe { raw::rtcGetDeviceError(std::ptr::null_mut()) };
    Error::embree(ErrorKind::from_raw(code).unwrap_or(ErrorKind::Unknown), text)
}

/// Keeps the first failure.
unsafe extern "C" fn on_error(monitor: *mut c_void, code: raw::RTCError, text: *const c_char) {
    let Some(kind) = ErrorKind::from_raw(code) else { return };
    // SAFETY: `monitor` is what `Device::new` registered, and it outlives the device that calls.
    let monitor = unsafe { &*monitor.cast_const().cast::<Monitor>() };
    // SAFETY: Embree passes null or a C string that lives through this call.
    let text = unsafe { copy_text(text) };
    monitor.error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(Error::Embree { kind, text });
}

/// Adds up what Embree allocates and frees.
unsafe extern "C" fn on_memory(monitor: *mut c_void, bytes: raw::ssize_t, _post: bool) -> bool {
    // SAFETY: as in `on_error`.
    let monitor = unsafe { &*monitor.cast_const().cast::<Monitor>() };
    monitor.bytes.fetch_add(bytes, Ordering::Relaxed);
    true
}

#[cfg(target_arch = "x86_64")]
fn cpu_has_avx2() -> bool {
    std::arch::is_x86_feature_detected!("avx2")
}

#[cfg(not(target_arch = "x86_64"))]
fn cpu_has_avx2() -> bool {
    false
}
