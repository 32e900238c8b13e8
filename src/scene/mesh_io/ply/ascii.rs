use std::path::Path;

use super::super::error::quote;
use super::super::{MeshError, MeshErrorKind, Place};
use super::header::{Element, Header, Kind, Scalar};

/// Rewrites the numbers of a text file as little-endian records, so that one decoder serves both. Values that the
/// decoder would refuse are refused here, where the line is known.
pub(super) fn to_binary(text: &[u8], header: &Header, path: &Path) -> Result<Vec<u8>, MeshError> {
    let vertices = header.elements.iter().find(|e| e.name == "vertex").map_or(0, |e| e.count);
    let mut words = Words { path, text, at: 0, out: Vec::with_capacity(text.len() / 2), header_lines: header.lines };
    for element in header.elements.iter().filter(|e| !e.properties.is_empty()) {
        let rules: Vec<Rule> = element.properties.iter().map(|p| Rule::of(element, &p.name, vertices)).collect();
        for _ in 0..element.count {
            for (property, rule) in element.properties.iter().zip(&rules) {
                match property.kind {
                    Kind::Scalar(s) => {
                        words.number(s, *rule, &property.name)?;
                    }
                    Kind::List { count, item } => {
                        let n = words.number(count, Rule::Length, &property.name)?;
                        for _ in 0..n as u64 {
                            words.number(item, *rule, &property.name)?;
                        }
                    }
                }
            }
        }
    }
    Ok(words.out)
}

/// What a number must satisfy beyond its type.
#[derive(Clone, Copy)]
enum Rule {
    Any,
    Finite,
    Length,
    Below(u64),
}

impl Rule {
    fn of(element: &Element, property: &str, vertices: u64) -> Self {
        match (&element.name[..], property) {
            ("vertex", "x" | "y" | "z") => Self::Finite,
            ("face", "vertex_indices" | "vertex_index") => Self::Below(vertices),
            _ => Self::Any,
        }
    }
}

struct Words<'a> {
    path: &'a Path,
    text: &'a [u8],
    at: usize,
    out: Vec<u8>,
    header_lines: u64,
}

impl Words<'_> {
    /// Appends the next number as `scalar` and gives its value.
    fn number(&mut self, scalar: Scalar, rule: Rule, property: &str) -> Result<f64, MeshError> {
        let start = self.at + self.text[self.at..].iter().take_while(|b| b.is_ascii_whitespace()).count();
        let length = self.text[start..].iter().take_while(|b| !b.is_ascii_whitespace()).count();
        let word = &self.text[start..start + length];
        self.at = start;
        let Some(value) = write(scalar, word, &mut self.out) else {
            let kind = if word.is_empty() { MeshErrorKind::Truncated } else { MeshErrorKind::Malformed };
            return Err(self.error(word, kind, property, format!("a number of type {scalar:?}")));
        };
        let fail = |kind, expected: String| Err(self.error(word, kind, property, expected));
        match rule {
            Rule::Finite if !value.is_finite() => {
                return fail(MeshErrorKind::NotFinite, "a finite coordinate".into());
            }
            Rule::Length if value < 0.0 => return fail(MeshErrorKind::Malformed, "a length of at least 0".into()),
            Rule::Below(n) if !(value >= 0.0 && value < n as f64) => {
                return fail(MeshErrorKind::OutOfRange, format!("an index below the vertex count {n}"));
            }
            _ => {}
        }
        self.at = start + length;
        Ok(value)
    }

    fn error(&self, word: &[u8], kind: MeshErrorKind, property: &str, expected: String) -> MeshError {
        let newlines = self.text[..self.at].iter().filter(|&&b| b == b'\n').count() as u64;
        let found = match word {
            [] => "the end of the file".to_owned(),
            _ => quote(word),
        };
        let expected = format!("{expected} for \"{}\"", property.escape_debug());
        let fix = "correct the number, or the counts in the header";
        MeshError::new(self.path, Place::Line(self.header_lines + 1 + newlines), kind, found, expected, fix)
    }
}

/// Appends a number in little-endian form; `None` when it is not one or does not fit its type.
fn write(scalar: Scalar, word: &[u8], out: &mut Vec<u8>) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    macro_rules! write {
        ($t:ty) => {{
            let value: $t = text.parse().ok()?;
            out.extend_from_slice(&value.to_le_bytes());
            Some(value as f64)
        }};
    }
    match scalar {
        Scalar::I8 => write!(i8),
        Scalar::U8 => write!(u8),
        Scalar::I16 => write!(i16),
        Scalar::U16 => write!(u16),
        Scalar::I32 => write!(i32),
        Scalar::U32 => write!(u32),
        Scalar::I64 => write!(i64),
        Scalar::U64 => write!(u64),
        Scalar::F32 => write!(f32),
        Scalar::F64 => write!(f64),
    }
}
