//! Portable float maps: `PF` (colour) or `Pf` (grey), size, scale whose sign tells the byte order, rows from the bottom.

use super::error::Fault;
use super::{Image, Limits};
use crate::color::Rgb;

pub(super) fn encode(image: &Image) -> Vec<u8> {
    let mut out = format!("PF\n{} {}\n-1.0\n", image.width(), image.height()).into_bytes();
    for row in image.pixels().chunks(image.width() as usize).rev() {
        out.extend(row.iter().flat_map(|c| c.to_array()).flat_map(f32::to_le_bytes));
    }
    out
}

/// What stands before the pixels.
struct Header<'a> {
    channels: u64,
    size: (u64, u64),
    scale: String,
    rest: &'a [u8],
}

fn header(bytes: &[u8]) -> Result<Header<'_>, Fault> {
    // Four words separated by white space; a single white-space byte ends the last.
    let mut rest = bytes;
    let mut word = || {
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let end = rest[start..].iter().position(u8::is_ascii_whitespace).map_or(rest.len(), |n| start + n);
        let text = String::from_utf8_lossy(&rest[start..end.min(start + 64)]).into_owned();
        rest = &rest[(end + 1).min(rest.len())..];
        text
    };
    let (magic, width, height, scale) = (word(), word(), word(), word());
    let channels = match &magic[..] {
        "PF" => 3,
        "Pf" => 1,
        _ => return Err(Fault::malformed(format!("the signature '{magic}'"), "PF or Pf")),
    };
    let number =
        |text: &str| text.parse::<u64>().map_err(|_| Fault::malformed(format!("the size '{text}'"), "a whole number"));
    Ok(Header { channels, size: (number(&width)?, number(&height)?), scale, rest })
}

/// Width, height and channels; `start` is the file or the beginning of it.
pub(super) fn size(start: &[u8]) -> Result<((u64, u64), u64), Fault> {
    header(start).map(|h| (h.size, h.channels))
}

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<Image, Fault> {
    let Header { channels, size, scale, rest } = header(bytes)?;
    let (width, height) = limits.check(size, channels, bytes.len(), 1)?;
    let scale: f32 = match scale.parse() {
        Ok(s) if s != 0.0 && f32::is_finite(s) => s,
        _ => return Err(Fault::malformed(format!("the scale '{scale}'"), "a number that is not zero")),
    };
    let row_bytes = width as usize * channels as usize * 4;
    if rest.len() < row_bytes * height as usize {
        let expected = format!("{} bytes", row_bytes * height as usize);
        return Err(Fault::malformed(format!("{} bytes of pixels", rest.len()), expected));
    }
    let value = |b: &[u8]| {
        let b = [b[0], b[1], b[2], b[3]];
        if scale < 0.0 { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) }
    };
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for row in
        rest.chunks_exact(row_bytes).take(height as usize).rev().flat_map(|r| r.chunks_exact(4 * channels as usize))
    {
        pixels.push(match channels {
            1 => Rgb::splat(value(row)),
            _ => Rgb::new(value(row), value(&row[4..]), value(&row[8..])),
        });
    }
    Ok(Image::rgb(width, height, pixels))
}
