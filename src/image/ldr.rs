//! PNG and JPEG through the crate `image`.

use std::io::Cursor;

use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ColorType, DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageReader};

use super::error::Fault;
use super::{Format, Image, ImageErrorKind, ReadOptions, WriteOptions};
use crate::color::{Rgb, linear_to_srgb, srgb_to_linear};

/// Pixels that one byte of file can stand for at best: deflate's 1032 bytes of eight 1-bit pixels each; a JPEG whose
/// 8 × 8 blocks take one bit.
const PNG_PIXELS_PER_BYTE: u64 = 8 * 1032;
const JPEG_PIXELS_PER_BYTE: u64 = 8 * 64 * 4;

pub(super) fn decode(bytes: &[u8], format: Format, options: &ReadOptions) -> Result<Image, Fault> {
    let (kind, per_byte) = match format {
        Format::Png => (::image::ImageFormat::Png, PNG_PIXELS_PER_BYTE),
        _ => (::image::ImageFormat::Jpeg, JPEG_PIXELS_PER_BYTE),
    };
    // Read the header alone and check its size before anything of that size exists.
    let decoder = ImageReader::with_format(Cursor::new(bytes), kind).into_decoder().map_err(|e| fault(&e))?;
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let size = (u64::from(width), u64::from(height));
    let (width, height) = options.limits.check(size, u64::from(color.channel_count()), bytes.len(), per_byte)?;

    // 8 bits widen to 16 exactly: v / 255 = 257 v / 65535.
    let eight_bit = matches!(color, ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8);
    let data = DynamicImage::from_decoder(decoder).map_err(|e| fault(&e))?.into_rgba16().into_raw();
    let linear = |v: u16| {
        let v = f32::from(v) / 65535.0;
        if options.raw { v } else { srgb_to_linear(v) }
    };
    let table: Vec<f32> = if eight_bit { (0..=255u16).map(|v| linear(v * 257)).collect() } else { Vec::new() };
    let value = |v: u16| if eight_bit { table[usize::from(v >> 8)] } else { linear(v) };
    let pixels = data.chunks_exact(4).map(|p| Rgb::new(value(p[0]), value(p[1]), value(p[2]))).collect();
    let mut image = Image::rgb(width, height, pixels);
    if color.has_alpha() {
        image.set_channel("A", data.chunks_exact(4).map(|p| f32::from(p[3]) / 65535.0).collect());
    }
    Ok(image)
}

/// Reads the header alone.
pub(super) fn check_header(file: impl std::io::BufRead + std::io::Seek, format: Format) -> Result<(), Fault> {
    let kind = if format == Format::Png { ::image::ImageFormat::Png } else { ::image::ImageFormat::Jpeg };
    ImageReader::with_format(file, kind).into_decoder().map(|_| ()).map_err(|e| fault(&e))
}

/// Width and height from the header alone, and whether it is of greys.
pub(super) fn size(file: impl std::io::BufRead + std::io::Seek, format: Format) -> Result<((u64, u64), bool), Fault> {
    let kind = if format == Format::Png { ::image::ImageFormat::Png } else { ::image::ImageFormat::Jpeg };
    let decoder = ImageReader::with_format(file, kind).into_decoder().map_err(|e| fault(&e))?;
    let (width, height) = decoder.dimensions();
    Ok(((width.into(), height.into()), !decoder.color_type().has_color()))
}

pub(super) fn encode_png(image: &Image, options: &WriteOptions) -> Result<Vec<u8>, Fault> {
    let bytes = to_srgb8(image, options);
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
        .write_image(&bytes, image.width(), image.height(), ExtendedColorType::Rgb8)
        .map_err(|e| fault(&e))?;
    Ok(out)
}

/// 8-bit sRGB after exposure; values outside 0…1 and NaN end at the nearest end (NaN at 0).
fn to_srgb8(image: &Image, options: &WriteOptions) -> Vec<u8> {
    let gain = options.exposure.exp2();
    let quantise = |v: f32, index: u32| {
        let v = 255.0 * linear_to_srgb((v * gain).clamp(0.0, 1.0));
        let noise = if options.dither { 0.998 * (hash_unit(index) - 0.5) } else { 0.0 };
        (v + noise).round().clamp(0.0, 255.0) as u8
    };
    let pixels = image.pixels().iter().enumerate();
    pixels.flat_map(|(i, c)| [0, 1, 2].map(|k| quantise(c[k], 3 * i as u32 + k as u32))).collect()
}

/// A fixed pseudo-random number in [0, 1) for an index: the 32-bit finaliser of MurmurHash3.
fn hash_unit(mut h: u32) -> f32 {
    h ^= h >> 16;
    h = h.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^= h >> 16;
    (h >> 8) as f32 / 16_777_216.0
}

fn fault(error: &::image::ImageError) -> Fault {
    use ::image::ImageError::{Limits, Unsupported};
    match error {
        Unsupported(e) => {
            let help = "Save the file as plain 8-bit or 16-bit PNG or baseline JPEG.";
            Fault::new(ImageErrorKind::Unsupported, format!("'{e}'"), "a common PNG or JPEG", help)
        }
        Limits(e) => {
            let help = "Scale the image down.";
            Fault::new(ImageErrorKind::TooLarge, format!("'{e}'"), "an image within the limits", help)
        }
        e => Fault::malformed(format!("'{e}'"), "a readable PNG or JPEG"),
    }
}
