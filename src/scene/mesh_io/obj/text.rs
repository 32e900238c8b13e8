use std::borrow::Cow;
use std::path::Path;

use super::super::error::quote;
use super::super::{MeshError, MeshErrorKind, Place};

/// An index that a corner does not have.
pub(super) const NONE: u32 = u32::MAX;

/// Iterates over the lines of a piece of text. Lines that end in a backslash are joined with the next.
pub(super) struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Lines seen so far, so that the number of the next one is one more.
    pub seen: u64,
}

impl<'a> Lines<'a> {
    /// `before` is the number of lines before the piece.
    pub(super) fn new(bytes: &'a [u8], before: u64) -> Self {
        Self { bytes, at: 0, seen: before }
    }

    fn single(&mut self) -> Option<&'a [u8]> {
        let rest = self.bytes.get(self.at..).filter(|r| !r.is_empty())?;
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.at += length + 1;
        self.seen += 1;
        Some(rest[..length].trim_ascii())
    }
}

impl<'a> Iterator for Lines<'a> {
    /// The number of the line (the first of joined ones) and its text without blanks around it.
    type Item = (u64, Cow<'a, [u8]>);

    fn next(&mut self) -> Option<Self::Item> {
        let line = self.single()?;
        let number = self.seen;
        let Some(start) = line.strip_suffix(b"\\") else {
            return Some((number, Cow::Borrowed(line)));
        };
        let mut joined = start.to_vec();
        while let Some(next) = self.single() {
            joined.push(b' ');
            let more = next.strip_suffix(b"\\");
            joined.extend_from_slice(more.unwrap_or(next));
            if more.is_none() {
                break;
            }
        }
        Some((number, Cow::Owned(joined)))
    }
}

/// What a line says; everything but surfaces is `Other`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keyword {
    Position,
    Uv,
    Normal,
    Face,
    Other,
}

/// Splits a line into its keyword and the rest.
#[inline]
pub(super) fn keyword(line: &[u8]) -> (Keyword, &[u8]) {
    let split = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
    let (word, rest) = line.split_at(split);
    let keyword = match word {
        b"v" => Keyword::Position,
        b"vt" => Keyword::Uv,
        b"vn" => Keyword::Normal,
        b"f" => Keyword::Face,
        _ => Keyword::Other,
    };
    (keyword, rest)
}

#[inline]
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty())
}

/// What is wrong with a line; the caller adds where.
pub(super) struct Fault {
    kind: MeshErrorKind,
    found: String,
    expected: String,
}

impl Fault {
    fn new(kind: MeshErrorKind, found: &[u8], expected: impl Into<String>) -> Self {
        Self { kind, found: quote(found), expected: expected.into() }
    }

    pub(super) fn at(self, path: &Path, line: u64) -> MeshError {
        let fix = "correct the line or export the mesh again";
        MeshError::new(path, Place::Line(line), self.kind, self.found, self.expected, fix)
    }
}

/// The first `N` numbers of a line, of which `least` must be there; the others are 0. Weights and colours behind them are
/// left out, as in Mitsuba.
#[inline]
pub(super) fn numbers<const N: usize>(rest: &[u8], least: usize) -> Result<[f32; N], Fault> {
    let mut out = [0.0; N];
    let mut count = 0;
    for (out, word) in out.iter_mut().zip(words(rest)) {
        let number = std::str::from_utf8(word).ok().and_then(|w| w.parse::<f32>().ok());
        *out = match number {
            Some(x) if x.is_finite() => x,
            Some(_) => return Err(Fault::new(MeshErrorKind::NotFinite, rest, "finite numbers")),
            None => return Err(Fault::new(MeshErrorKind::Malformed, rest, format!("{least} numbers"))),
        };
        count += 1;
    }
    if count < least {
        return Err(Fault::new(MeshErrorKind::Malformed, rest, format!("{least} numbers")));
    }
    Ok(out)
}

/// `v`, `v/vt`, `v//vn` or `v/vt/vn` as indices from 0, [`NONE`] where there is none. `counts` are the numbers of
/// positions, texture coordinates and normals so far; negative indices count back from there.
#[inline]
pub(super) fn corner(word: &[u8], counts: &[u32; 3]) -> Result<[u32; 3], Fault> {
    let mut indices = [NONE; 3];
    for (i, part) in word.split(|&b| b == b'/').enumerate() {
        if part.is_empty() && i > 0 {
            continue;
        }
        let (Some(index), Some(&count)) = (integer(part), counts.get(i)) else {
            return Err(Fault::new(MeshErrorKind::Malformed, word, "a corner v, v/vt, v//vn or v/vt/vn"));
        };
        let absolute = if index < 0 { index + i64::from(count) + 1 } else { index };
        if index == 0 && i > 0 {
            continue;
        }
        if absolute < 1 || absolute > i64::from(count) {
            let name = ["vertex", "texture coordinate", "normal"][i];
            let expected = format!("the index of one of the {count} {name} lines before it");
            return Err(Fault::new(MeshErrorKind::OutOfRange, word, expected));
        }
        indices[i] = (absolute - 1) as u32;
    }
    Ok(indices)
}

/// A decimal integer of at most 18 digits.
#[inline]
fn integer(word: &[u8]) -> Option<i64> {
    let (sign, digits) = match word {
        [b'-', digits @ ..] => (-1, digits),
        [b'+', digits @ ..] => (1, digits),
        digits => (1, digits),
    };
    if digits.is_empty() || digits.len() > 18 {
        return None;
    }
    let mut value = 0;
    for &d in digits {
        if !d.is_ascii_digit() {
            return None;
        }
        value = value * 10 + i64::from(d - b'0');
    }
    Some(sign * value)
}
