//! The PLY reader: text, little-endian and big-endian binary.

mod ascii;
mod attributes;
mod count;
mod faces;
mod header;
mod vertices;

#[cfg(test)]
mod tests;

use std::path::Path;

use super::mapped::FileBytes;
use super::{MeshData, MeshError, MeshErrorKind, Place};
pub use count::count_ply;
use header::{Element, Format, Header, Kind};

/// Reads a PLY file. `flip_v` turns texture coordinates upside down (Mitsuba's `flip_tex_coords`, off by default for
/// PLY).
pub fn read_ply(path: &Path, flip_v: bool) -> Result<MeshData, MeshError> {
    let bytes = FileBytes::open(path)?;
    parse_ply(&bytes, path, flip_v)
}

/// Reads a PLY file from memory; `path` is for messages.
pub fn parse_ply(bytes: &[u8], path: &Path, flip_v: bool) -> Result<MeshData, MeshError> {
    let header = header::parse(bytes, path)?;
    let body = &bytes[header.data..];
    match header.format {
        Format::Ascii => {
            let binary = ascii::to_binary(body, &header, path)?;
            decode(&Body { path, bytes: &binary, offset: 0, big: false }, &header, flip_v)
        }
        Format::Little => decode(&Body { path, bytes: body, offset: header.data, big: false }, &header, flip_v),
        Format::Big => decode(&Body { path, bytes: body, offset: header.data, big: true }, &header, flip_v),
    }
}

/// The binary records behind the header.
struct Body<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    /// Where `bytes` begins in the file.
    offset: usize,
    big: bool,
}

impl Body<'_> {
    fn error(
        &self,
        at: usize,
        kind: MeshErrorKind,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> MeshError {
        let place = Place::Byte((self.offset + at) as u64);
        MeshError::new(
            self.path,
            place,
            kind,
            found,
            expected,
            "the file is damaged or its header is wrong: export it again",
        )
    }

    /// The `length` bytes at `at`, if they are there.
    fn get(&self, at: usize, length: usize) -> Result<&[u8], MeshError> {
        at.checked_add(length).and_then(|end| self.bytes.get(at..end)).ok_or_else(|| {
            let found = format!("the end of the file after {} bytes", self.offset + self.bytes.len());
            self.error(at, MeshErrorKind::Truncated, found, format!("{length} more bytes"))
        })
    }

    /// The length of the list at `at`, and its first item's offset; the items are there.
    #[inline]
    fn list(&self, at: usize, count: header::Scalar, item: header::Scalar) -> Result<(usize, usize), MeshError> {
        let n = count.read(self.big, self.get(at, count.size())?);
        let first = at + count.size();
        if n < 0.0 {
            return Err(self.error(
                at,
                MeshErrorKind::Malformed,
                format!("a list of {n} items"),
                "a length of at least 0",
            ));
        }
        // A float beyond usize saturates, and the product with it.
        let n = n as usize;
        self.get(first, n.saturating_mul(item.size()))?;
        Ok((n, first))
    }

    /// The offset behind the record of `element` at `at`.
    fn skip(&self, element: &Element, mut at: usize) -> Result<usize, MeshError> {
        for p in &element.properties {
            at = match p.kind {
                Kind::Scalar(s) => {
                    self.get(at, s.size())?;
                    at + s.size()
                }
                Kind::List { count, item } => {
                    let (n, first) = self.list(at, count, item)?;
                    first + n * item.size()
                }
            };
        }
        Ok(at)
    }

    /// The offset behind all records of `element`.
    fn skip_all(&self, element: &Element, at: usize) -> Result<usize, MeshError> {
        if let Some(stride) = element.stride() {
            let length = stride.saturating_mul(element.count as usize);
            self.get(at, length)?;
            return Ok(at + length);
        }
        (0..element.count).try_fold(at, |at, _| self.skip(element, at))
    }
}

/// Decodes the records of all elements.
fn decode(body: &Body, header: &Header, flip_v: bool) -> Result<MeshData, MeshError> {
    let mut data = MeshData { path: body.path.to_path_buf(), ..MeshData::default() };
    let (vertex, face) = (the_one(body, header, "vertex")?, the_one(body, header, "face")?);
    let mut at = 0;
    for element in &header.elements {
        at = if std::ptr::eq(element, vertex) {
            vertices::decode(body, element, at, flip_v, &mut data)?
        } else if std::ptr::eq(element, face) {
            faces::decode(body, element, at, vertex.count, &mut data)?
        } else {
            body.skip_all(element, at)?
        };
    }
    Ok(data)
}

/// The element of a name that stands in a header once.
fn the_one<'h>(body: &Body, header: &'h Header, name: &str) -> Result<&'h Element, MeshError> {
    let mut of_name = header.elements.iter().filter(|e| e.name == name);
    match (of_name.next(), of_name.next()) {
        (Some(e), None) => Ok(e),
        (None, _) => Err(header_error(body, header.lines, format!("no element \"{name}\""))),
        (_, Some(second)) => Err(header_error(body, second.line, format!("a second element \"{name}\""))),
    }
}

fn header_error(body: &Body, line: u64, found: String) -> MeshError {
    let expected = "one element \"vertex\" with x, y, z and one element \"face\" with a list vertex_indices";
    MeshError::new(body.path, Place::Line(line), MeshErrorKind::Unsupported, found, expected, "export a polygon mesh")
}
