use std::{fmt, io, path::Path, path::PathBuf};

/// Where in a mesh file something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    Whole,
    /// A line of a text file, counted from 1.
    Line(u64),
    /// A byte of a binary file, counted from 0.
    Byte(u64),
}

/// What kind of trouble it is, for callers that want to react rather than print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshErrorKind {
    /// The file cannot be opened or read.
    Io,
    /// The text or the header does not follow the format.
    Malformed,
    /// The file ends before the data that its header announces.
    Truncated,
    /// An index refers to something that is not there.
    OutOfRange,
    /// A coordinate is NaN or infinite, in the file or after its transform.
    NotFinite,
    /// More elements than can be addressed, or a size that the file cannot hold.
    TooLarge,
    /// No triangle is left.
    Empty,
    /// A legal file of a kind that is not read here.
    Unsupported,
}

#[derive(Debug)]
struct Details {
    path: PathBuf,
    place: Place,
    kind: MeshErrorKind,
    found: String,
    expected: String,
    fix: String,
}

/// A mesh file that cannot be used: which one, where, what was found, what was expected, and what to do about it.
#[derive(Debug)]
pub struct MeshError(Box<Details>);

impl MeshError {
    pub(crate) fn new(
        path: &Path,
        place: Place,
        kind: MeshErrorKind,
        found: impl Into<String>,
        expected: impl Into<String>,
        fix: impl Into<String>,
    ) -> Self {
        Self(Box::new(Details {
            path: path.to_path_buf(),
            place,
            kind,
            found: found.into(),
            expected: expected.into(),
            fix: fix.into(),
        }))
    }

    pub(crate) fn io(path: &Path, error: &io::Error) -> Self {
        let fix = match error.kind() {
            io::ErrorKind::NotFound => "check the name; relative names are looked up beside the scene file",
            io::ErrorKind::PermissionDenied => "make the file readable",
            _ => "check that it is an ordinary file",
        };
        Self::new(path, Place::Whole, MeshErrorKind::Io, format!("\"{error}\""), "a readable mesh file", fix)
    }

    /// The mesh file.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    pub fn place(&self) -> Place {
        self.0.place
    }

    pub fn kind(&self) -> MeshErrorKind {
        self.0.kind
    }

    /// What stands in the file.
    pub fn found(&self) -> &str {
        &self.0.found
    }

    /// What should stand there.
    pub fn expected(&self) -> &str {
        &self.0.expected
    }

    /// What to do about it.
    pub fn fix(&self) -> &str {
        &self.0.fix
    }
}

impl fmt::Display for MeshError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let d = &*self.0;
        write!(f, "mesh file {}", d.path.display())?;
        match d.place {
            Place::Whole => {}
            Place::Line(line) => write!(f, ", line {line}")?,
            Place::Byte(byte) => write!(f, ", byte {byte}")?,
        }
        write!(f, ": found {}, expected {}; {}", d.found, d.expected, d.fix)
    }
}

impl std::error::Error for MeshError {}

/// Quotes a piece of a file for a message: printable, on one line, not long.
pub(crate) fn quote(bytes: &[u8]) -> String {
    const LONGEST: usize = 40;
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(LONGEST)]);
    let dots = if bytes.len() > LONGEST { "…" } else { "" };
    format!("\"{}{dots}\"", text.escape_debug())
}
