//! OpenEXR through the crate `exr`: one part with dotted channel names to write; any flat file to read.

use std::collections::BTreeMap;
use std::io::Cursor;

use ::exr::meta::attribute::SampleType;
use ::exr::meta::header::Header;
use ::exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, Error, FlatSamples, LayerAttributes, MetaData, ReadChannels,
    ReadLayers, Text, Vec2, WritableImage, f16, read,
};

use super::error::Fault;
use super::{Channel, Image, ImageErrorKind, Limits};
use crate::color::Rgb;

/// Put before the names of our header attributes, so that they never meet a standard attribute of another type.
const PREFIX: &str = "caustica:";

/// Pixels that one byte of file can stand for at best, generously: constant blocks under the lossy compressions.
const PIXELS_PER_BYTE: u64 = 1 << 16;

/// Below this many values one thread is faster than starting several.
const PARALLEL_VALUES: usize = 1 << 20;

pub(super) fn encode(image: &Image, half: bool) -> Result<Vec<u8>, Fault> {
    let samples = |values: &mut dyn Iterator<Item = f32>, half: bool| match half {
        true => FlatSamples::F16(values.map(f16::from_f32).collect()),
        false => FlatSamples::F32(values.collect()),
    };
    // The colour, then the extra channels; the format wants them sorted by name.
    let mut list = ::exr::prelude::SmallVec::new();
    for (k, name) in ["R", "G", "B"].into_iter().enumerate() {
        list.push(AnyChannel::new(name, samples(&mut image.pixels().iter().map(|c| c[k]), half)));
    }
    for channel in image.channels() {
        let half = half && channel.data.iter().all(|&v| fits_half(v));
        list.push(AnyChannel::new(text(&channel.name), samples(&mut channel.data.iter().copied(), half)));
    }
    let mut attributes = LayerAttributes::default();
    for (key, value) in &image.metadata {
        attributes.other.insert(text(&format!("{PREFIX}{key}")), AttributeValue::Text(text(value)));
    }
    let size = Vec2(image.width() as usize, image.height() as usize);
    let small = image.pixels().len() * (3 + image.channels().len()) < PARALLEL_VALUES;
    let layer = ::exr::prelude::Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(list));
    let file = ::exr::prelude::Image::from_layer(layer);
    let mut out = Cursor::new(Vec::new());
    let writer = file.write();
    let writer = if small { writer.non_parallel() } else { writer };
    writer.to_buffered(&mut out).map_err(|e| fault(&e))?;
    let mut out = out.into_inner();
    sort_header(&mut out);
    Ok(out)
}

/// Whether 16 bits keep a value with all their digits: variances are often too small for them, depths too large.
fn fits_half(v: f32) -> bool {
    v == 0.0 || !v.is_finite() || (f16::MIN_POSITIVE.to_f32()..=f16::MAX.to_f32()).contains(&v.abs())
}

/// UTF-8 without NUL, as a header string.
fn text(s: &str) -> Text {
    Text::from_slice_unchecked(s.replace('\0', "").as_bytes())
}

/// Puts the attributes of the first header into the order of their names: the crate writes them in the order of a
/// randomly seeded hash map, and the same picture should be the same file. The length stays the same.
fn sort_header(file: &mut [u8]) {
    const MAGIC_AND_VERSION: usize = 8;
    let mut attributes = BTreeMap::new();
    let mut at = MAGIC_AND_VERSION;
    let zero = |from: usize| file[from..].iter().position(|&b| b == 0).map(|n| from + n + 1);
    while file.get(at).is_some_and(|&b| b != 0) {
        let Some(value) = zero(at).and_then(zero) else { return };
        let Some(&[a, b, c, d]) = file.get(value..value + 4) else { return };
        let end = value + 4 + u32::from_le_bytes([a, b, c, d]) as usize;
        let Some(bytes) = file.get(at..end) else { return };
        attributes.insert(bytes.to_vec(), ());
        at = end;
    }
    let sorted: Vec<u8> = attributes.into_keys().flatten().collect();
    // Two attributes never share a name, so nothing was merged.
    if sorted.len() == at - MAGIC_AND_VERSION {
        file[MAGIC_AND_VERSION..at].copy_from_slice(&sorted);
    }
}

/// Width and height from the headers alone, and whether there is a single channel.
pub(super) fn size(file: impl std::io::Read) -> Result<((u64, u64), bool), Fault> {
    let meta = MetaData::read_from_unbuffered(file, false).map_err(|e| fault(&e))?;
    let Some(first) = meta.headers.first() else { return Err(Fault::malformed("no part", "at least one")) };
    let Vec2(width, height) = first.layer_size;
    Ok(((width as u64, height as u64), first.channels.list.len() == 1))
}

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<Image, Fault> {
    // Read the headers alone and check their sizes before anything of that size exists.
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| fault(&e))?;
    let mut values = 0usize;
    for header in &meta.headers {
        values = values.saturating_add(check(header, bytes.len(), limits)?);
    }
    if values as u64 > limits.values {
        let (found, expected) = (format!("{values} values in all parts"), format!("at most {}", limits.values));
        return Err(Fault::new(ImageErrorKind::TooLarge, found, expected, "Split the parts into files."));
    }
    let file = read_flat(bytes)?;

    let mut channels = Vec::new();
    let mut metadata = BTreeMap::new();
    let shared = file.attributes.other.iter();
    collect_text(shared, &mut metadata);
    let mut size = None;
    for (index, part) in file.layer_data.into_iter().enumerate() {
        let first = *size.get_or_insert(part.size);
        if index == 0 {
            collect_text(part.attributes.other.iter(), &mut metadata);
        }
        if part.size != first {
            continue; // a part with another window cannot be a layer of this image
        }
        let prefix = match &part.attributes.layer_name {
            Some(name) if index > 0 => format!("{}.", String::from_utf8_lossy(name.as_slice())),
            _ => String::new(),
        };
        for channel in part.channel_data.list {
            let mut name = String::from_utf8_lossy(channel.name.as_slice()).into_owned();
            if !name.starts_with(&prefix) {
                name.insert_str(0, &prefix);
            }
            let data = match channel.sample_data {
                FlatSamples::F32(v) => v,
                FlatSamples::F16(v) => v.into_iter().map(f16::to_f32).collect(),
                FlatSamples::U32(v) => v.into_iter().map(|v| v as f32).collect(),
            };
            if channels.iter().all(|c: &Channel| c.name != name) {
                channels.push(Channel { name, data });
            }
        }
    }
    let Vec2(width, height) = size.unwrap_or(Vec2(0, 0));
    assemble(width as u32, height as u32, channels, metadata)
}

/// All flat channels of all parts. The crate's decoder of B44 blocks panics on some damaged ones (an overflow in
/// `unpack14` of exr 1.74.2, found by mutation), so panics become errors here; and it runs on this thread, because a panic
/// in one of the crate's own threads would end the program.
fn read_flat(bytes: &[u8]) -> Result<::exr::prelude::FlatImage, Fault> {
    let reader = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let decode = || reader.non_parallel().from_buffered(Cursor::new(bytes));
    match std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode)) {
        Ok(result) => result.map_err(|e| fault(&e)),
        Err(_) => Err(Fault::malformed("compressed pixels that make the decoder fail", "a readable OpenEXR file")),
    }
}

/// Checks one part's header; the number of values it holds.
fn check(header: &Header, len: usize, limits: &Limits) -> Result<usize, Fault> {
    let Vec2(width, height) = header.layer_size;
    let unsupported =
        |found: &str, expected: &str, help: &str| Err(Fault::new(ImageErrorKind::Unsupported, found, expected, help));
    if header.deep {
        return unsupported("deep pixels", "flat pixels", "Flatten the deep image first.");
    }
    let channels = &header.channels.list;
    limits.check((width as u64, height as u64), channels.len() as u64, len, PIXELS_PER_BYTE)?;
    // Every chunk takes eight bytes in the table of offsets alone.
    if header.chunk_count.saturating_mul(8) > len {
        let found = format!("a header of {} chunks in a file of {len} bytes", header.chunk_count);
        return Err(Fault::malformed(found, "a file that holds its chunks"));
    }
    if channels.iter().any(|c| c.sampling != Vec2(1, 1)) {
        let help = "Save it as RGB channels without chroma subsampling.";
        return unsupported("subsampled channels", "all channels at full resolution", help);
    }
    // Widths count in f32 here; a 32-bit unsigned channel loses digits but not its place.
    debug_assert!(
        channels.iter().all(|c| matches!(c.sample_type, SampleType::F16 | SampleType::F32 | SampleType::U32))
    );
    Ok(width.saturating_mul(height).saturating_mul(channels.len()))
}

fn collect_text<'a>(
    attributes: impl Iterator<Item = (&'a Text, &'a AttributeValue)>,
    metadata: &mut BTreeMap<String, String>,
) {
    for (name, value) in attributes {
        let name = String::from_utf8_lossy(name.as_slice());
        let name = name.strip_prefix(PREFIX).unwrap_or(&name).to_owned();
        let value = match value {
            AttributeValue::Text(t) => String::from_utf8_lossy(t.as_slice()).into_owned(),
            AttributeValue::F32(v) => v.to_string(),
            AttributeValue::F64(v) => v.to_string(),
            AttributeValue::I32(v) => v.to_string(),
            _ => continue,
        };
        metadata.insert(name, value);
    }
}

/// Takes the colour out of the channels, however they are named; the rest stays extra.
fn assemble(
    width: u32,
    height: u32,
    mut channels: Vec<Channel>,
    metadata: BTreeMap<String, String>,
) -> Result<Image, Fault> {
    let Some([r, g, b]) = colour_channels(&channels) else {
        return Err(Fault::malformed("no channel", "at least one channel"));
    };
    let (red, green, blue) = (&channels[r].data, &channels[g].data, &channels[b].data);
    let pixels = red.iter().zip(green).zip(blue).map(|((&r, &g), &b)| Rgb::new(r, g, b)).collect();
    let mut image = Image::rgb(width, height, pixels);
    image.metadata = metadata;
    let mut index = 0;
    channels.retain(|c| {
        index += 1;
        ![r, g, b].contains(&(index - 1)) && !c.name.is_empty()
    });
    // A stray single component (a file with R alone beside Y, say) has no place of its own: name it as a layer.
    for c in &mut channels {
        if ["R", "G", "B"].contains(&&c.name[..]) {
            c.name = format!("stray.{}", c.name);
        }
    }
    image.extra = channels;
    Ok(image)
}

/// The indices of red, green and blue: `R G B` first, then `Y`, then the first layer that has either, then the first
/// channel that is not alpha, as grey.
fn colour_channels(channels: &[Channel]) -> Option<[usize; 3]> {
    let find = |layer: &str, names: &[&str]| {
        let named = |c: &Channel| {
            let (l, n) = c.name.rsplit_once('.').unwrap_or(("", &c.name));
            l == layer && names.iter().any(|name| n.eq_ignore_ascii_case(name))
        };
        channels.iter().position(named)
    };
    let rgb = |layer: &str| {
        let (r, g, b) = (find(layer, &["R", "red"]), find(layer, &["G", "green"]), find(layer, &["B", "blue"]));
        Some([r?, g?, b?])
    };
    let grey = |layer: &str| find(layer, &["Y", "L", "luminance", "V"]).map(|y| [y; 3]);
    let layers = || channels.iter().filter_map(|c| c.name.rsplit_once('.')).map(|(layer, _)| layer);
    rgb("")
        .or_else(|| grey(""))
        .or_else(|| layers().find_map(rgb))
        .or_else(|| layers().find_map(grey))
        .or_else(|| channels.iter().position(|c| !c.name.ends_with('A')).map(|i| [i; 3]))
        .or(if channels.is_empty() { None } else { Some([0; 3]) })
}

fn fault(error: &Error) -> Fault {
    match error {
        Error::NotSupported(what) => {
            let help = "Save it with ZIP, PIZ, RLE or no compression, full-resolution flat channels.";
            Fault::new(ImageErrorKind::Unsupported, format!("'{what}'"), "a common OpenEXR file", help)
        }
        e => Fault::malformed(format!("'{e}'"), "a readable OpenEXR file"),
    }
}
