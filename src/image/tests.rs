//! Files of every format, written and read back, and files that must be refused.

use std::path::Path;

use super::*;

fn sample() -> Image {
    // 37 wide: not a multiple of any block, above the 8 that Radiance's run-length code needs.
    let mut image =
        Image::from_fn(37, 21, |x, y| Rgb::new(x as f32 / 8.0, 0.25 * y as f32, ((x * y) % 7) as f32 * 1e3));
    image.metadata.insert("scene hash".into(), "änderung 7f".into());
    image.metadata.insert("exposure".into(), "not a number".into());
    image.metadata.insert("channels".into(), "three".into());
    image
}

fn round_trip(format: Format, image: &Image, options: &WriteOptions) -> Image {
    let bytes = encode(image, format, options, Path::new("test")).expect("a storable picture");
    assert_eq!(Format::from_bytes(&bytes), Some(format));
    decode(&bytes, format, &ReadOptions::default(), Path::new("test")).expect("a file of this format")
}

fn refusal(bytes: &[u8], format: Format) -> ImageError {
    decode(bytes, format, &ReadOptions::default(), Path::new("dir/bad.img")).unwrap_err()
}

#[test]
fn float_formats_come_back_exactly() {
    let mut image = sample();
    image.set_channel("A", vec![0.5; 37 * 21]);
    image.set_layer("variance", &vec![Rgb::new(1.0, 2.0, 3.0); 37 * 21]);
    let back = round_trip(Format::Exr, &image, &WriteOptions::default());
    assert_eq!(back.pixels(), image.pixels());
    assert_eq!(back.metadata, image.metadata);
    assert_eq!(back.layer("variance"), image.layer("variance"));
    assert_eq!(back.channel("A"), image.channel("A"));
    // Every value above is a multiple of 1/8 below 2^11 with few digits, or n·1000: exact in half precision too.
    let half = WriteOptions { half: true, ..Default::default() };
    assert_eq!(round_trip(Format::Exr, &image, &half).pixels(), image.pixels());
    assert_eq!(round_trip(Format::Pfm, &image, &half).pixels(), image.pixels());
}

/// Variances of 1e-8 would all be zero in half precision.
#[test]
fn small_numbers_beside_the_colour_keep_their_digits() {
    let mut image = sample();
    let variance: Vec<Rgb> = (0..37 * 21).map(|i| Rgb::splat(1e-8 + 1e-10 * i as f32)).collect();
    image.set_layer("variance", &variance);
    let back = round_trip(Format::Exr, &image, &WriteOptions { half: true, ..Default::default() });
    assert_eq!(back.layer("variance"), Some(variance));
}

#[test]
fn non_finite_values_survive_in_exr() {
    let image = Image::rgb(2, 1, vec![Rgb::splat(f32::NAN), Rgb::new(f32::INFINITY, f32::MIN_POSITIVE, -1.0)]);
    let back = round_trip(Format::Exr, &image, &WriteOptions::default());
    assert!(back.pixel(0, 0).r.is_nan());
    assert_eq!(back.pixel(1, 0), image.pixel(1, 0));
}

#[test]
fn the_same_image_is_the_same_file() {
    let image = sample();
    for format in [Format::Exr, Format::Png, Format::Hdr, Format::Pfm] {
        let once = || encode(&image, format, &WriteOptions::default(), Path::new("x")).expect("a storable picture");
        assert_eq!(once(), once(), "{format:?}");
    }
}

/// RGBE keeps each channel to half a step of the largest one: 1/256 of it.
#[test]
fn hdr_comes_back_within_half_a_step() {
    for width in [5, 37, 300] {
        let image = Image::from_fn(width, 9, |x, y| Rgb::new(x as f32, y as f32 * 1e-3, 0.01 * (x / 40) as f32));
        let back = round_trip(Format::Hdr, &image, &WriteOptions::default());
        for (a, b) in image.pixels().iter().zip(back.pixels()) {
            let error = (*a - *b).map(f32::abs).max_channel();
            assert!(error <= a.max_channel() / 256.0 + 1e-30, "{a:?} came back as {b:?}");
        }
    }
}

/// 0.21404114 is sRGB 127.5/255, so one stop more than its half shows as 127 or 128; 8-bit steps come back as they are.
#[test]
fn png_is_srgb_with_exposure() {
    let image = Image::from_fn(64, 64, |_, _| Rgb::splat(0.107_020_57));
    let options = WriteOptions { exposure: 1.0, ..Default::default() };
    let bytes = encode(&image, Format::Png, &options, Path::new("x.png")).expect("a storable picture");
    let raw = ReadOptions { raw: true, ..Default::default() };
    let back = decode(&bytes, Format::Png, &raw, Path::new("x.png")).expect("a file of this format");
    let steps: Vec<f32> = back.pixels().iter().map(|p| p.r * 255.0).collect();
    assert!(steps.iter().all(|s| (126.9..128.1).contains(s)));
    // Dithering by a fixed hash: half of 4096 pixels go up, standard error 0.5/√4096 = 0.0078; five of them allowed.
    let mean = steps.iter().sum::<f32>() / steps.len() as f32;
    assert!((mean - 127.5).abs() < 0.04, "mean step {mean}");

    let ramp = Image::from_fn(256, 1, |x, _| Rgb::splat(crate::color::srgb_to_linear(x as f32 / 255.0)));
    let bytes = encode(&ramp, Format::Png, &WriteOptions::default(), Path::new("x.png")).expect("a storable picture");
    let back = decode(&bytes, Format::Png, &raw, Path::new("x.png")).expect("a file of this format");
    for (x, p) in back.pixels().iter().enumerate() {
        assert_eq!((p.r * 255.0).round() as usize, x);
    }
    // Out of range ends at the ends.
    let wild = Image::rgb(3, 1, vec![Rgb::splat(f32::NAN), Rgb::splat(-1.0), Rgb::splat(1e30)]);
    let back = round_trip(Format::Png, &wild, &WriteOptions::default());
    assert_eq!(back.pixels(), [Rgb::BLACK, Rgb::BLACK, Rgb::WHITE]);
}

/// 8-bit and 16-bit, grey and colour, with alpha and without, PNG and JPEG: as the crate `image` writes them.
#[test]
fn texture_files_of_every_depth_are_read() {
    use ::image::{DynamicImage, ImageFormat};
    let raw = ReadOptions { raw: true, ..Default::default() };
    let mut images = vec![
        DynamicImage::new_luma8(9, 5),
        DynamicImage::new_luma_a8(9, 5),
        DynamicImage::new_rgb8(9, 5),
        DynamicImage::new_rgba8(9, 5),
        DynamicImage::new_luma16(9, 5),
        DynamicImage::new_rgb16(9, 5),
        DynamicImage::new_rgba16(9, 5),
    ];
    for image in &mut images {
        image.invert(); // all white; alpha stays 0
        let mut file = std::io::Cursor::new(Vec::new());
        image.write_to(&mut file, ImageFormat::Png).expect("memory takes all that is written");
        let back = decode(file.get_ref(), Format::Png, &raw, Path::new("x")).expect("a file of this format");
        assert!(back.pixels().iter().all(|&p| p == Rgb::WHITE), "{:?}", image.color());
        assert_eq!(back.channel("A").is_some(), image.color().has_alpha());
    }
    let grey = ::image::GrayImage::from_pixel(16, 16, ::image::Luma([188]));
    let mut file = std::io::Cursor::new(Vec::new());
    DynamicImage::from(grey).write_to(&mut file, ImageFormat::Jpeg).expect("memory takes all that is written");
    let back =
        decode(file.get_ref(), Format::Jpeg, &ReadOptions::default(), Path::new("x")).expect("a file of this format");
    // sRGB 188 is 0.50289 linear; JPEG may be one step off, which is 0.006 there.
    assert!(back.pixels().iter().all(|p| (p.r - 0.502_89).abs() < 0.007 && p.r == p.b));
}

/// Any naming of the channels, scan lines or tiles.
#[test]
fn exr_channels_are_found_whatever_their_names() {
    use ::exr::prelude::*;
    let write = |names: &[&str], encoding: Encoding| {
        let channel =
            |(i, name): (usize, &&str)| AnyChannel::new(*name, FlatSamples::F32(vec![i as f32 + 1.0; 70 * 50]));
        let list = names.iter().enumerate().map(channel).collect();
        let layer = Layer::new((70, 50), LayerAttributes::default(), encoding, AnyChannels::sort(list));
        let mut out = std::io::Cursor::new(Vec::new());
        ::exr::prelude::Image::from_layer(layer)
            .write()
            .to_buffered(&mut out)
            .expect("memory takes all that is written");
        super::decode(out.get_ref(), Format::Exr, &ReadOptions::default(), Path::new("x"))
            .expect("a file of this format")
    };
    let cases: [(&[&str], [f32; 3], usize); 8] = [
        (&["R", "G", "B"], [1.0, 2.0, 3.0], 0),
        (&["r", "g", "b", "a"], [1.0, 2.0, 3.0], 1),
        (&["Y"], [1.0; 3], 0),
        (&["Y", "A"], [1.0; 3], 1),
        (&["depth.Z", "view.left.R", "view.left.G", "view.left.B"], [2.0, 3.0, 4.0], 1),
        (&["albedo.Y", "normal.X"], [1.0; 3], 1),
        (&["A", "Z"], [2.0; 3], 1),
        (&["R", "Y"], [2.0; 3], 1),
    ];
    let tiled = Encoding { blocks: Blocks::Tiles(Vec2(32, 16)), ..Encoding::SMALL_LOSSLESS };
    for encoding in [Encoding::UNCOMPRESSED, Encoding::FAST_LOSSLESS, Encoding::SMALL_FAST_LOSSLESS, tiled] {
        for (names, expected, extra) in cases {
            let image = write(names, encoding);
            assert!(image.pixels().iter().all(|p| p.to_array() == expected), "{names:?} gave {:?}", image.pixel(0, 0));
            assert_eq!(image.channels().len(), extra, "{names:?}");
        }
    }
}

#[test]
fn parts_of_a_file_become_layers() {
    use ::exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Layer, LayerAttributes, WritableImage};
    let layer = |name: &str, size: (usize, usize), value: f32| {
        let channel = |n: &str| AnyChannel::new(n, FlatSamples::F32(vec![value; size.0 * size.1]));
        let list = ["R", "G", "B"].map(channel).into_iter().collect();
        Layer::new(size, LayerAttributes::named(name), Encoding::default(), AnyChannels::sort(list))
    };
    let layers = vec![layer("main", (4, 4), 1.0), layer("albedo", (4, 4), 0.5), layer("small", (2, 2), 0.1)];
    let attributes = ::exr::prelude::ImageAttributes::with_size((4, 4));
    let mut out = std::io::Cursor::new(Vec::new());
    ::exr::prelude::Image::from_layers(attributes, layers)
        .write()
        .to_buffered(&mut out)
        .expect("memory takes all that is written");
    let image =
        decode(out.get_ref(), Format::Exr, &ReadOptions::default(), Path::new("x")).expect("a file of this format");
    assert_eq!(image.pixel(3, 3), Rgb::WHITE);
    assert_eq!(image.layer("albedo"), Some(vec![Rgb::splat(0.5); 16]));
    assert_eq!(image.layer("small"), None);
}

/// About a hundred bytes that claim gigabytes: refused by arithmetic, before memory is asked for.
#[test]
fn a_size_that_the_file_cannot_hold_is_refused() {
    let pfm = refusal(b"PF\n60000 60000\n-1.0\n0123456789", Format::Pfm);
    assert_eq!(pfm.kind, ImageErrorKind::TooLarge);
    let message = pfm.to_string();
    for part in ["dir/bad.img: found", "60000 × 60000", "expected", "pixels"] {
        assert!(message.contains(part), "{message}");
    }
    assert_eq!(refusal(b"PF\n16000 16000\n-1.0\n0123456789", Format::Pfm).kind, ImageErrorKind::TooLarge);
    assert_eq!(refusal(b"#?RADIANCE\n\n-Y 16000 +X 16000\n0123", Format::Hdr).kind, ImageErrorKind::TooLarge);

    let image = Image::constant(4, 4, Rgb::WHITE);
    let mut png = encode(&image, Format::Png, &WriteOptions::default(), Path::new("x")).expect("a storable picture");
    png[16..24].copy_from_slice(&[0, 0, 0x3f, 0, 0, 0, 0x3f, 0]); // 16128 × 16128
    let crc = png_crc(&png[12..29]);
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    assert_eq!(refusal(&png, Format::Png).kind, ImageErrorKind::TooLarge);

    let mut exr = encode(&image, Format::Exr, &WriteOptions::default(), Path::new("x")).expect("a storable picture");
    let name = b"dataWindow\0box2i\0\x10\0\0\0";
    let at = exr.windows(name.len()).position(|w| w == name).expect("the header names the attribute") + name.len();
    for (max, kind) in [(16_000i32, ImageErrorKind::TooLarge), (i32::MAX, ImageErrorKind::Malformed)] {
        exr[at + 8..at + 12].copy_from_slice(&max.to_le_bytes());
        exr[at + 12..at + 16].copy_from_slice(&max.to_le_bytes());
        assert_eq!(refusal(&exr, Format::Exr).kind, kind);
    }
}

/// The checksum of a PNG chunk (CRC-32, polynomial 0xEDB88320), bit by bit.
fn png_crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
    })
}

#[test]
fn damaged_files_say_what_is_wrong() {
    let image = sample();
    for format in [Format::Exr, Format::Png, Format::Hdr, Format::Pfm] {
        let bytes = encode(&image, format, &WriteOptions::default(), Path::new("x")).expect("a storable picture");
        for len in [0, 3, 20, bytes.len() / 2, bytes.len() - 9] {
            let error = refusal(&bytes[..len], format);
            assert!(error.kind != ImageErrorKind::Io, "{format:?} cut to {len}: {error}");
        }
    }
    assert!(refusal(b"PF\n2 x\n-1\n", Format::Pfm).to_string().contains("the size 'x'"));
    assert!(refusal(b"PF\n2 2\n0\n0000000000000000000000", Format::Pfm).to_string().contains("the scale '0'"));
    assert!(refusal(b"PF\n0 2\n-1\n", Format::Pfm).to_string().contains("0 × 2"));
    let xyze = refusal(b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n0000", Format::Hdr);
    assert_eq!(xyze.kind, ImageErrorKind::Unsupported);
}

#[test]
fn files_are_replaced_whole() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let image = sample();
    for name in ["a.exr", "a.png", "a.hdr", "a.pfm", "A.EXR"] {
        let path = dir.path().join(name);
        std::fs::write(&path, "old").expect("a temporary file");
        write(&path, &image, &WriteOptions::default()).expect("the folder can be written to");
        let back = read(&path).expect("the file that was just written");
        assert_eq!((back.width(), back.height()), (37, 21));
    }
    // Nothing temporary stays behind, also after failures.
    let error = write(dir.path().join("a.jpg"), &image, &WriteOptions::default()).unwrap_err();
    assert_eq!(error.kind, ImageErrorKind::Unsupported);
    let error = write(dir.path().join("a.tiff"), &image, &WriteOptions::default()).unwrap_err();
    assert_eq!(error.kind, ImageErrorKind::UnknownFormat);
    assert!(error.to_string().contains(".tiff"));
    assert!(write(dir.path().join("none/a.exr"), &image, &WriteOptions::default()).is_err());
    assert_eq!(std::fs::read_dir(dir.path()).expect("the folder is still there").count(), 5);

    let error = read(dir.path().join("missing.exr")).unwrap_err();
    assert!(error.kind == ImageErrorKind::Io && error.to_string().contains("missing.exr"));
    assert_eq!(read(dir.path()).unwrap_err().expected, "an image file");
    // The content decides, not the name.
    std::fs::copy(dir.path().join("a.hdr"), dir.path().join("b.png")).expect("a temporary file");
    assert_eq!(read(dir.path().join("b.png")).expect("the file that was just written").width(), 37);
}
