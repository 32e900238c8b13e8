use std::fmt;
use std::path::{Path, PathBuf};

/// What kind of thing went wrong, by what the caller can do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageErrorKind {
    /// The file system said no.
    Io,
    /// Neither the content nor the extension names a format that is known.
    UnknownFormat,
    /// The file asks for more memory than the limits allow, or than its own length can hold.
    TooLarge,
    /// The bytes contradict the format.
    Malformed,
    /// The file is valid but uses something that is not read here.
    Unsupported,
}

/// Why an image could not be read or written: the file, what was found, what was expected, what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageError {
    pub path: PathBuf,
    pub kind: ImageErrorKind,
    pub found: String,
    pub expected: String,
    /// The remedy, a whole sentence.
    pub help: String,
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: found {}, expected {}. {}", self.path.display(), self.found, self.expected, self.help)
    }
}

impl std::error::Error for ImageError {}

/// An error of a decoder, which knows bytes but no path.
#[derive(Debug)]
pub(super) struct Fault {
    kind: ImageErrorKind,
    found: String,
    expected: String,
    help: String,
}

impl Fault {
    pub(super) fn new(
        kind: ImageErrorKind,
        found: impl Into<String>,
        expected: impl Into<String>,
        help: impl Into<String>,
    ) -> Self {
        Self { kind, found: found.into(), expected: expected.into(), help: help.into() }
    }

    /// Bytes that contradict the format.
    pub(super) fn malformed(found: impl Into<String>, expected: impl Into<String>) -> Self {
        let help = "The file is damaged or cut short: write it again from its source.";
        Self::new(ImageErrorKind::Malformed, found, expected, help)
    }

    pub(super) fn at(self, path: &Path) -> ImageError {
        ImageError {
            path: path.to_owned(),
            kind: self.kind,
            found: self.found,
            expected: self.expected,
            help: self.help,
        }
    }
}
