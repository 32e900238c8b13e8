use std::ffi::{CStr, c_char};
use std::fmt;

use crate::raw;

/// Embree's classes of failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    InvalidArgument,
    InvalidOperation,
    OutOfMemory,
    UnsupportedCpu,
    Cancelled,
    Unknown,
}

impl ErrorKind {
    pub(crate) fn from_raw(code: raw::RTCError) -> Option<Self> {
        Some(match code {
            raw::RTC_ERROR_NONE => return None,
            raw::RTC_ERROR_INVALID_ARGUMENT => Self::InvalidArgument,
            raw::RTC_ERROR_INVALID_OPERATION => Self::InvalidOperation,
            raw::RTC_ERROR_OUT_OF_MEMORY => Self::OutOfMemory,
            raw::RTC_ERROR_UNSUPPORTED_CPU => Self::UnsupportedCpu,
            raw::RTC_ERROR_CANCELLED => Self::Cancelled,
            _ => Self::Unknown,
        })
    }

    fn words(self) -> &'static str {
        match self {
            Self::InvalidArgument => "invalid argument",
            Self::InvalidOperation => "invalid operation",
            Self::OutOfMemory => "out of memory",
            Self::UnsupportedCpu => "this processor is not supported",
            Self::Cancelled => "cancelled",
            Self::Unknown => "unknown error",
        }
    }
}

/// Why something could not be built. Queries on a built scene cannot fail.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Error {
    /// Embree refused; `text` is its own message, empty when it gave none.
    Embree { kind: ErrorKind, text: String },
    /// Embree loads 16 bytes at the last vertex; the buffer ends before that.
    Padding { vertices: usize, missing_bytes: usize },
    /// A triangle names a vertex that is not there.
    Index { triangle: usize, index: u32, vertices: usize },
    /// More elements than Embree's 32-bit ids can count.
    TooMany { what: &'static str, count: usize },
    /// A device was asked for with a configuration text that has a zero byte in it.
    Config,
}

impl Error {
    pub(crate) fn embree(kind: ErrorKind, text: impl Into<String>) -> Self {
        Self::Embree { kind, text: text.into() }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Embree { kind, text } if text.is_empty() => f.write_str(kind.words()),
            Self::Embree { kind, text } => write!(f, "{}: {text}", kind.words()),
            Self::Padding { vertices, missing_bytes } => write!(
                f,
                "the buffer of {vertices} vertices needs {missing_bytes} more readable bytes behind the last vertex"
            ),
            Self::Index { triangle, index, vertices } => {
                write!(f, "triangle {triangle} names vertex {index}, but there are {vertices} vertices")
            }
            Self::TooMany { what, count } => write!(f, "{count} {what} are more than 32 bits can count"),
            Self::Config => f.write_str("the device configuration contains a zero byte"),
        }
    }
}

impl std::error::Error for Error {}

/// Copies a text of Embree's; empty for null.
///
/// # Safety
/// `text` is null or a C string that lives through the call.
pub(crate) unsafe fn copy_text(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: not null, so by the caller's contract a live C string.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}
