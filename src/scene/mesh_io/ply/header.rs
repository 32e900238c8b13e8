use std::path::Path;

use super::super::error::quote;
use super::super::{MeshError, MeshErrorKind, Place};

/// A header longer than this is not a header.
const LONGEST_HEADER: usize = 1 << 20;

/// The type of one number in a PLY file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "long" | "int64" => Self::I64,
            "ulong" | "uint64" => Self::U64,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The largest value of an unsigned type, for colours that are fractions of it.
    pub(super) fn unit(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32767.0,
            Self::U16 => 65535.0,
            Self::I32 => f64::from(i32::MAX),
            Self::U32 => f64::from(u32::MAX),
            Self::I64 => i64::MAX as f64,
            Self::U64 => u64::MAX as f64,
            Self::F32 | Self::F64 => 1.0,
        }
    }

    /// Decodes one number; `b` holds at least [`size`](Self::size) bytes.
    #[inline]
    pub(super) fn read(self, big_endian: bool, b: &[u8]) -> f64 {
        macro_rules! read {
            ($t:ty) => {{
                let mut raw = [0; size_of::<$t>()];
                raw.copy_from_slice(&b[..size_of::<$t>()]);
                (if big_endian { <$t>::from_be_bytes(raw) } else { <$t>::from_le_bytes(raw) }) as f64
            }};
        }
        match self {
            Self::I8 => read!(i8),
            Self::U8 => read!(u8),
            Self::I16 => read!(i16),
            Self::U16 => read!(u16),
            Self::I32 => read!(i32),
            Self::U32 => read!(u32),
            Self::I64 => read!(i64),
            Self::U64 => read!(u64),
            Self::F32 => read!(f32),
            Self::F64 => read!(f64),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
}

impl Property {
    /// Bytes that every record spends on this property, whatever it holds.
    pub(super) fn least_size(&self) -> usize {
        match self.kind {
            Kind::Scalar(s) => s.size(),
            Kind::List { count, .. } => count.size(),
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
    /// The header line, for messages.
    pub line: u64,
}

impl Element {
    /// Bytes per record, the same for each because there are no lists.
    pub(super) fn stride(&self) -> Option<usize> {
        self.properties.iter().all(|p| matches!(p.kind, Kind::Scalar(_))).then(|| self.least_size())
    }

    pub(super) fn least_size(&self) -> usize {
        self.properties.iter().map(Property::least_size).sum()
    }

    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    Little,
    Big,
}

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub format: Format,
    pub elements: Vec<Element>,
    /// Offset of the first byte behind `end_header`.
    pub data: usize,
    /// Lines of the header.
    pub lines: u64,
}

/// Parses the text up to and with `end_header`, and refuses counts that the rest of the file cannot hold.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Header, MeshError> {
    let header = parse_text(bytes, path)?;
    check_sizes(&header, Some(bytes.len() - header.data), path)?;
    Ok(header)
}

/// Parses the text up to and with `end_header`, whatever follows it.
pub(super) fn parse_text(bytes: &[u8], path: &Path) -> Result<Header, MeshError> {
    let mut state = State { path, line: 0, format: None, elements: Vec::new() };
    let mut at = 0;
    loop {
        let rest = &bytes[at..bytes.len().min(LONGEST_HEADER)];
        state.line += 1;
        let Some(length) = rest.iter().position(|&b| b == b'\n') else {
            // Quote the first line only: a file that is no PLY may have no newline for long.
            return Err(state.error(quote(&rest[..rest.len().min(40)]), "a line of a PLY header, up to end_header"));
        };
        let line = rest[..length].strip_suffix(b"\r").unwrap_or(&rest[..length]);
        at += length + 1;
        if state.line(line)? {
            break;
        }
    }
    let Some(format) = state.format else {
        return Err(state.error("no \"format\" line", "ascii, binary_little_endian or binary_big_endian"));
    };
    Ok(Header { format, elements: state.elements, data: at, lines: state.line })
}

struct State<'a> {
    path: &'a Path,
    line: u64,
    format: Option<Format>,
    elements: Vec<Element>,
}

impl State<'_> {
    fn error(&self, found: impl Into<String>, expected: impl Into<String>) -> MeshError {
        let fix = "correct the header or export the mesh again";
        MeshError::new(self.path, Place::Line(self.line), MeshErrorKind::Malformed, found, expected, fix)
    }

    /// Takes one header line; true at the end of the header.
    fn line(&mut self, line: &[u8]) -> Result<bool, MeshError> {
        let text = match std::str::from_utf8(line) {
            Ok(text) => text,
            // Comments may be in any encoding; the first line says whether it is a PLY file at all.
            Err(_) if self.line > 1 && (line.starts_with(b"comment") || line.starts_with(b"obj_info")) => {
                return Ok(false);
            }
            Err(_) => return Err(self.error(quote(line), "a PLY header, which begins with the line \"ply\"")),
        };
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        if self.line == 1 {
            return match words[..] {
                ["ply"] => Ok(false),
                _ => Err(self.error(quote(line), "the line \"ply\" at the start of a PLY file")),
            };
        }
        match words[..] {
            [] | ["comment" | "obj_info", ..] => {}
            ["format", format, version] => self.format(format, version)?,
            ["element", name, count] => {
                let count = count
                    .parse()
                    .map_err(|_| self.error(quote(count.as_bytes()), "the number of elements, a whole number"))?;
                let properties = Vec::new();
                self.elements.push(Element { name: name.to_owned(), count, properties, line: self.line });
            }
            ["property", "list", count, item, name] => {
                let (count, item) = (self.scalar(count)?, self.scalar(item)?);
                if !count.is_integer() {
                    return Err(self.error(quote(line), "an integer type for the length of a list"));
                }
                self.property(name, Kind::List { count, item })?;
            }
            ["property", scalar, name] => {
                let kind = Kind::Scalar(self.scalar(scalar)?);
                self.property(name, kind)?;
            }
            ["end_header"] => return Ok(true),
            _ => {
                return Err(
                    self.error(quote(line), "\"format\", \"element\", \"property\", \"comment\" or \"end_header\"")
                );
            }
        }
        Ok(false)
    }

    fn format(&mut self, format: &str, version: &str) -> Result<(), MeshError> {
        if self.format.is_some() {
            return Err(self.error("a second \"format\" line", "one"));
        }
        if version != "1.0" {
            return Err(self.error(format!("version {}", quote(version.as_bytes())), "version 1.0"));
        }
        self.format = Some(match format {
            "ascii" => Format::Ascii,
            "binary_little_endian" => Format::Little,
            "binary_big_endian" => Format::Big,
            _ => return Err(self.error(quote(format.as_bytes()), "ascii, binary_little_endian or binary_big_endian")),
        });
        Ok(())
    }

    fn scalar(&self, name: &str) -> Result<Scalar, MeshError> {
        let known = "a type: char, uchar, short, ushort, int, uint, long, ulong, float or double";
        Scalar::parse(name).ok_or_else(|| self.error(quote(name.as_bytes()), known))
    }

    fn property(&mut self, name: &str, kind: Kind) -> Result<(), MeshError> {
        match self.elements.last() {
            None => Err(self.error("a property before any element", "\"element\" first")),
            Some(e) if e.find(name).is_some() => {
                Err(self.error(format!("a second property {}", quote(name.as_bytes())), "names that differ"))
            }
            Some(_) => {
                let element = self.elements.last_mut().expect("just seen");
                element.properties.push(Property { name: name.to_owned(), kind });
                Ok(())
            }
        }
    }
}

/// Compares the announced counts with what can be addressed, and with the bytes that are left if they are given, before
/// anything is allocated.
pub(super) fn check_sizes(header: &Header, left: Option<usize>, path: &Path) -> Result<(), MeshError> {
    let mut total = 0_u128;
    for e in &header.elements {
        let least = match header.format {
            // A digit and a separator for every number.
            Format::Ascii => 2 * e.properties.len(),
            _ => e.least_size(),
        };
        total += least as u128 * u128::from(e.count);
        // The last number of a text file needs no separator.
        if let Some(left) = left.filter(|&left| total > left as u128 + 1) {
            return Err(MeshError::new(
                path,
                Place::Line(e.line),
                MeshErrorKind::TooLarge,
                format!("{} elements \"{}\", at least {total} bytes", e.count, e.name.escape_debug()),
                format!("no more than the {left} bytes that follow the header"),
                "the file is cut off or its header is wrong: export it again",
            ));
        }
        if e.count > u64::from(u32::MAX) && !e.properties.is_empty() {
            return Err(MeshError::new(
                path,
                Place::Line(e.line),
                MeshErrorKind::TooLarge,
                format!("{} elements \"{}\"", e.count, e.name.escape_debug()),
                "fewer than 2³² of them",
                "split the mesh into several shapes",
            ));
        }
    }
    Ok(())
}
