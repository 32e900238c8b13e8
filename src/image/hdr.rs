//! Radiance RGBE pictures: a text header, then scan lines of four run-length coded bytes per pixel [Ward 1991].
//!
//! A pixel (r, g, b, e) stands for (r, g, b)·2^(e−136); e = 0 is black. Writing rounds to the nearest mantissa.

use super::error::Fault;
use super::{Image, ImageErrorKind, Limits};
use crate::color::Rgb;

/// The new run-length code is allowed for these widths.
const RLE_WIDTHS: std::ops::Range<u32> = 8..32768;
/// Pixels that one byte of file can stand for at best (the old code repeats by up to 2²⁴ per four bytes; real files
/// stay far below this).
const PIXELS_PER_BYTE: u64 = 1 << 16;

pub(super) fn encode(image: &Image) -> Vec<u8> {
    let mut out = b"#?RADIANCE\n".to_vec();
    for (key, value) in &image.metadata {
        let line = format!("# {key}: {value}");
        out.extend(line.replace(['\n', '\r'], " ").bytes());
        out.push(b'\n');
    }
    out.extend(format!("FORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n", image.height(), image.width()).bytes());
    for row in image.pixels().chunks(image.width() as usize) {
        let row: Vec<[u8; 4]> = row.iter().map(|&c| to_rgbe(c)).collect();
        if RLE_WIDTHS.contains(&image.width()) {
            let [high, low] = (image.width() as u16).to_be_bytes();
            out.extend([2, 2, high, low]);
            for k in 0..4 {
                let plane: Vec<u8> = row.iter().map(|p| p[k]).collect();
                encode_runs(&plane, &mut out);
            }
        } else {
            out.extend(row.iter().flatten());
        }
    }
    out
}

/// The nearest RGBE to a colour. Negative and NaN components become 0; above 1.7e38 they saturate.
fn to_rgbe(c: Rgb) -> [u8; 4] {
    let c = c.map(|v| if v > 0.0 { v.min(1.69e38) } else { 0.0 });
    let max = c.max_channel();
    if max < 1e-38 {
        return [0; 4];
    }
    // Take 2^e with max = m·2^e, 1/2 ≤ m < 1, straight from the bits of the normal number.
    let mut e = ((max.to_bits() >> 23) as i32) - 126;
    let mantissa = |v: f32, e: i32| (f64::from(v) * f64::from(8 - e).exp2()).round();
    if mantissa(max, e) > 255.0 {
        e += 1;
    }
    let [r, g, b] = c.to_array().map(|v| mantissa(v, e).min(255.0) as u8);
    [r, g, b, (e + 128).clamp(1, 255) as u8]
}

fn from_rgbe([r, g, b, e]: [u8; 4]) -> Rgb {
    if e == 0 {
        return Rgb::BLACK;
    }
    let scale = (f64::from(e) - 136.0).exp2();
    Rgb::from([r, g, b].map(|v| (f64::from(v) * scale) as f32))
}

/// Appends one plane of a scan line: (128 + n, value) repeats, (n, n bytes) copies.
fn encode_runs(plane: &[u8], out: &mut Vec<u8>) {
    const SHORTEST: usize = 4;
    let run_at = |i: usize| plane[i..].iter().take(127).take_while(|&&b| b == plane[i]).count();
    let mut i = 0;
    while i < plane.len() {
        let run = run_at(i);
        if run >= SHORTEST {
            out.extend([128 + run as u8, plane[i]]);
            i += run;
            continue;
        }
        // Copy up to the next run that is worth it.
        let mut end = i + run;
        while end < plane.len() && end - i < 128 {
            let next = run_at(end);
            if next >= SHORTEST {
                break;
            }
            end += next;
        }
        let end = end.min(i + 128);
        out.push((end - i) as u8);
        out.extend(&plane[i..end]);
        i = end;
    }
}

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<Image, Fault> {
    let mut input = Input { bytes };
    let (metadata, (width, height, flip_x, flip_y)) = header(&mut input)?;
    let (width, height) = limits.check((width, height), 4, bytes.len(), PIXELS_PER_BYTE)?;

    let mut rows: Vec<Rgb> = Vec::with_capacity(width as usize * height as usize);
    let mut row = vec![[0; 4]; width as usize];
    for y in 0..height {
        decode_row(&mut input, &mut row).ok_or_else(|| {
            Fault::malformed(format!("a broken or missing scan line {y}"), format!("{height} whole scan lines"))
        })?;
        rows.extend(row.iter().map(|&p| from_rgbe(p)));
    }
    if flip_x {
        rows.chunks_mut(width as usize).for_each(<[Rgb]>::reverse);
    }
    if flip_y {
        rows = rows.chunks(width as usize).rev().flatten().copied().collect();
    }
    let mut image = Image::rgb(width, height, rows);
    image.metadata = metadata;
    Ok(image)
}

/// Width and height; `start` is the file or the beginning of it.
pub(super) fn size(start: &[u8]) -> Result<(u64, u64), Fault> {
    header(&mut Input { bytes: start }).map(|(_, (width, height, ..))| (width, height))
}

/// Text of the header, then width, height, mirrored in x, mirrored in y.
type Header = (std::collections::BTreeMap<String, String>, (u64, u64, bool, bool));

fn header(input: &mut Input) -> Result<Header, Fault> {
    let mut metadata = std::collections::BTreeMap::new();
    // Read header lines up to the empty one.
    let magic = input.line()?;
    if !magic.starts_with("#?") {
        return Err(Fault::malformed(format!("the first line '{}'", shorten(&magic)), "#?RADIANCE"));
    }
    loop {
        let line = input.line()?;
        if line.is_empty() {
            break;
        }
        if let Some((key, value)) = line.strip_prefix("# ").and_then(|l| l.split_once(": ")) {
            metadata.insert(key.to_owned(), value.to_owned());
        } else if let Some(format) = line.strip_prefix("FORMAT=")
            && format.trim() != "32-bit_rle_rgbe"
        {
            let found = format!("the pixel format '{}'", shorten(format));
            let help = "Convert it to RGBE, for example with ra_xyze -r.";
            return Err(Fault::new(ImageErrorKind::Unsupported, found, "32-bit_rle_rgbe", help));
        }
    }
    Ok((metadata, parse_resolution(&input.line()?)?))
}

/// Width, height, mirrored in x, mirrored in y, from a line such as `-Y 480 +X 640`.
fn parse_resolution(line: &str) -> Result<(u64, u64, bool, bool), Fault> {
    let words: Vec<&str> = line.split_whitespace().collect();
    if let [y @ ("-Y" | "+Y"), height, x @ ("-X" | "+X"), width] = words[..]
        && let (Ok(height), Ok(width)) = (height.parse(), width.parse())
    {
        return Ok((width, height, x == "-X", y == "+Y"));
    }
    if matches!(words.first(), Some(&("+X" | "-X"))) {
        let found = format!("columns stored first ('{}')", shorten(line));
        let help = "Turn the picture by 90° with pflip or any editor.";
        return Err(Fault::new(ImageErrorKind::Unsupported, found, "rows stored first (-Y height +X width)", help));
    }
    Err(Fault::malformed(format!("the resolution '{}'", shorten(line)), "-Y height +X width"))
}

struct Input<'a> {
    bytes: &'a [u8],
}

impl Input<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (&first, rest) = self.bytes.split_first()?;
        self.bytes = rest;
        Some(first)
    }

    fn pixel(&mut self) -> Option<[u8; 4]> {
        let (pixel, rest) = self.bytes.split_first_chunk()?;
        self.bytes = rest;
        Some(*pixel)
    }

    fn line(&mut self) -> Result<String, Fault> {
        let Some(end) = self.bytes.iter().position(|&b| b == b'\n') else {
            return Err(Fault::malformed("a header that never ends", "an empty line and the resolution"));
        };
        let line = String::from_utf8_lossy(&self.bytes[..end]).trim_end().to_owned();
        self.bytes = &self.bytes[end + 1..];
        Ok(line)
    }
}

/// One scan line in any of the three codes; `None` when it is broken.
fn decode_row(input: &mut Input, row: &mut [[u8; 4]]) -> Option<()> {
    let first = input.pixel()?;
    if first[..2] != [2, 2] || first[2] & 0x80 != 0 || !RLE_WIDTHS.contains(&(row.len() as u32)) {
        return decode_old_row(first, input, row);
    }
    if usize::from(u16::from_be_bytes([first[2], first[3]])) != row.len() {
        return None;
    }
    for k in 0..4 {
        let mut x = 0;
        while x < row.len() {
            let count = input.byte()?;
            let (n, repeat) = if count > 128 { (usize::from(count - 128), true) } else { (usize::from(count), false) };
            if n == 0 || n > row.len() - x {
                return None;
            }
            let value = if repeat { Some(input.byte()?) } else { None };
            for p in &mut row[x..x + n] {
                p[k] = match value {
                    Some(v) => v,
                    None => input.byte()?,
                };
            }
            x += n;
        }
    }
    Some(())
}

/// Plain pixels, where (1, 1, 1, n) repeats the one before n times, n·256 times if it follows another repeat, and so on.
fn decode_old_row(first: [u8; 4], input: &mut Input, row: &mut [[u8; 4]]) -> Option<()> {
    let (mut x, mut shift, mut pixel) = (0, 0, first);
    loop {
        if pixel[..3] == [1, 1, 1] {
            let n = usize::from(pixel[3]) << shift;
            if x == 0 || n > row.len() - x {
                return None;
            }
            let before = row[x - 1];
            row[x..x + n].fill(before);
            x += n;
            shift += 8;
            if shift > 24 {
                return None;
            }
        } else {
            row[x] = pixel;
            x += 1;
            shift = 0;
        }
        if x == row.len() {
            return Some(());
        }
        pixel = input.pixel()?;
    }
}

fn shorten(text: &str) -> String {
    text.chars().take(40).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 = 128·2^(129−136); (1, ½, ¼) has mantissas 128, 64, 32.
    #[test]
    fn rgbe_of_powers_of_two() {
        assert_eq!(to_rgbe(Rgb::new(1.0, 0.5, 0.25)), [128, 64, 32, 129]);
        assert_eq!(from_rgbe([128, 64, 32, 129]), Rgb::new(1.0, 0.5, 0.25));
        // 0.999 rounds up to mantissa 256, which moves the exponent.
        assert_eq!(to_rgbe(Rgb::splat(0.999)), [128, 128, 128, 129]);
        assert_eq!(to_rgbe(Rgb::new(-1.0, f32::NAN, 0.0)), [0; 4]);
    }

    /// Half a step of an 8-bit mantissa that is at least 128: relative error of the largest channel ≤ 1/256.
    #[test]
    fn rgbe_keeps_the_largest_channel_to_half_a_step() {
        for i in 0..4000 {
            let v = 10f32.powf(-30.0 + 60.0 * i as f32 / 4000.0);
            let back = from_rgbe(to_rgbe(Rgb::new(v, 0.3 * v, 0.0)));
            assert!((back.r / v - 1.0).abs() <= 1.0 / 256.0, "{v} came back as {}", back.r);
            assert!((back.g - 0.3 * v).abs() <= v / 256.0);
        }
    }

    #[test]
    fn runs_come_back() {
        let mut plane = vec![7u8; 300];
        plane.extend((0..200).map(|i| i as u8));
        plane.extend([1, 1, 1, 2, 2, 2, 2, 2]);
        let mut coded = Vec::new();
        encode_runs(&plane, &mut coded);
        let (mut i, mut back) = (0, Vec::new());
        while i < coded.len() {
            let n = usize::from(coded[i]);
            if n > 128 {
                back.extend(vec![coded[i + 1]; n - 128]);
                i += 2;
            } else {
                back.extend(&coded[i + 1..=i + n]);
                i += n + 1;
            }
        }
        assert_eq!(back, plane);
        assert!(coded.len() < 230);
    }

    #[test]
    fn the_old_repeat_code_is_read() {
        let mut file = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 260\n".to_vec();
        file.extend([128, 128, 128, 129, 1, 1, 1, 3, 1, 1, 1, 1]); // 1 + 3 + 256 pixels
        let image = decode(&file, &Limits::DEFAULT).expect("a well-formed file");
        assert!(image.pixels().iter().all(|&p| p == Rgb::WHITE));
    }

    #[test]
    fn mirrored_rows_are_turned_back() {
        let mut file = b"#?RGBE\n\n+Y 2 -X 2\n".to_vec();
        file.extend([1u8, 2, 3, 4].iter().flat_map(|&v| [v * 10, 0, 0, 136]));
        let image = decode(&file, &Limits::DEFAULT).expect("a well-formed file");
        let red: Vec<f32> = image.pixels().iter().map(|p| p.r).collect();
        assert_eq!(red, [40.0, 30.0, 20.0, 10.0]);
    }
}
