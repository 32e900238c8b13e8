//! Damaged image files give errors, never panics and never memory beyond what the file's length allows.
//!
//! Valid files of every format are mutated (bytes overwritten, bits flipped, pieces removed, doubled or cut off; numbers
//! of four bytes set to extremes) and decoded. 300 cases per format by default, 30 000 with the feature `slow-tests`.

use std::io::Cursor;
use std::path::Path;

use caustica::color::Rgb;
use caustica::image::{Format, Image, ReadOptions, WriteOptions, decode, encode};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

const CASES: u32 = if cfg!(feature = "slow-tests") { 30_000 } else { 300 };

/// One change to a file; positions and lengths are taken modulo what is there.
#[derive(Clone, Debug)]
enum Mutation {
    Set(usize, u8),
    Flip(usize, u8),
    Number(usize, u32),
    Remove(usize, usize),
    Double(usize, usize),
    Cut(usize),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    // Half of the changes aim at the header, where the sizes are.
    let at = || prop_oneof![0usize..400, any::<u16>().prop_map(usize::from)];
    let extreme = || {
        prop_oneof![
            Just(0),
            Just(1),
            Just(0x7fff_ffff),
            Just(0xffff_ffff),
            Just(0x8000_0000),
            Just(0x0100_0000),
            0u32..70_000,
            any::<u32>()
        ]
    };
    prop_oneof![
        3 => (at(), any::<u8>()).prop_map(|(i, b)| Mutation::Set(i, b)),
        3 => (at(), 0u8..8).prop_map(|(i, b)| Mutation::Flip(i, b)),
        3 => (at(), extreme()).prop_map(|(i, n)| Mutation::Number(i, n)),
        1 => (at(), 1usize..40).prop_map(|(i, n)| Mutation::Remove(i, n)),
        1 => (at(), 1usize..40).prop_map(|(i, n)| Mutation::Double(i, n)),
        1 => at().prop_map(Mutation::Cut),
    ]
}

fn apply(file: &mut Vec<u8>, mutation: &Mutation) {
    if file.is_empty() {
        return;
    }
    let len = file.len();
    match *mutation {
        Mutation::Set(i, b) => file[i % len] = b,
        Mutation::Flip(i, b) => file[i % len] ^= 1 << b,
        Mutation::Number(i, n) => {
            let bytes = if i % 2 == 0 { n.to_le_bytes() } else { n.to_be_bytes() };
            for (slot, b) in file.iter_mut().skip(i % len).zip(bytes) {
                *slot = b;
            }
        }
        Mutation::Remove(i, n) => drop(file.drain(i % len..(i % len + n).min(len))),
        Mutation::Double(i, n) => {
            let piece = file[i % len..(i % len + n).min(len)].to_vec();
            file.splice(i % len..i % len, piece);
        }
        Mutation::Cut(i) => file.truncate(i % len),
    }
}

fn picture() -> Image {
    let mut image =
        Image::from_fn(37, 21, |x, y| Rgb::new(x as f32 / 8.0, 0.05 * y as f32, ((x * y) % 7) as f32 * 0.1));
    image.metadata.insert("scene".into(), "box".into());
    image
}

/// Decodes every mutated file; a panic fails the test with the smallest mutation that causes it.
fn check(format: Format, seeds: &[Vec<u8>], repair: impl Fn(&mut [u8])) {
    for seed in seeds {
        decode(seed, format, &ReadOptions::default(), Path::new("seed")).expect("the unchanged file is valid");
    }
    let config = Config { cases: CASES, failure_persistence: None, ..Config::default() };
    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    let mut runner = TestRunner::new_with_rng(config, rng);
    let strategy = (0..seeds.len(), prop::collection::vec(mutation(), 1..6), any::<bool>(), any::<bool>());
    runner
        .run(&strategy, |(seed, mutations, repaired, raw)| {
            let mut file = seeds[seed].clone();
            mutations.iter().for_each(|m| apply(&mut file, m));
            if repaired {
                repair(&mut file);
            }
            let options = ReadOptions { raw, ..Default::default() };
            match decode(&file, format, &options, Path::new("damaged")) {
                Ok(image) => assert_eq!(image.pixels().len(), image.width() as usize * image.height() as usize),
                Err(e) => assert!(!e.found.is_empty() && !e.expected.is_empty() && !e.help.is_empty()),
            }
            Ok(())
        })
        .unwrap_or_else(|e| panic!("{format:?}: {e}"));
}

fn written(format: Format) -> Vec<Vec<u8>> {
    let half = WriteOptions { half: true, ..Default::default() };
    [WriteOptions::default(), half]
        .map(|o| encode(&picture(), format, &o, Path::new("seed")).expect("it can be written"))
        .into()
}

#[test]
fn damaged_pfm() {
    check(Format::Pfm, &written(Format::Pfm), |_| ());
}

#[test]
fn damaged_hdr() {
    let mut seeds = written(Format::Hdr);
    let mut old = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 260\n".to_vec();
    old.extend([128, 128, 128, 129, 1, 1, 1, 3, 1, 1, 1, 1]);
    seeds.push(old);
    check(Format::Hdr, &seeds, |_| ());
}

#[test]
fn damaged_exr() {
    use exr::prelude::*;
    let mut seeds = written(Format::Exr);
    // Every compression, scan lines and tiles, mip maps are left to the crate's own tests.
    let compressions = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
        Compression::B44A,
    ];
    for compression in compressions {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 8))] {
            let data = |k: usize| FlatSamples::F16((0..37 * 21).map(|i| f16::from_f32((i * k % 17) as f32)).collect());
            let list = ["A", "depth.Z", "left.B", "left.G", "left.R"].into_iter().enumerate();
            let channels = AnyChannels::sort(list.map(|(k, name)| AnyChannel::new(name, data(k))).collect());
            let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
            let layer = Layer::new((37, 21), LayerAttributes::named("main"), encoding, channels);
            let mut file = Cursor::new(Vec::new());
            let image = exr::prelude::Image::from_layer(layer);
            image.write().non_parallel().to_buffered(&mut file).expect("it can be written");
            seeds.push(file.into_inner());
        }
    }
    check(Format::Exr, &seeds, |_| ());
}

fn by_crate(format: image::ImageFormat) -> Vec<Vec<u8>> {
    let picture = image::RgbaImage::from_fn(37, 21, |x, y| image::Rgba([x as u8 * 6, y as u8 * 9, (x ^ y) as u8, 200]));
    let picture = image::DynamicImage::from(picture);
    let mut variants =
        vec![image::DynamicImage::from(picture.to_rgb8()), image::DynamicImage::from(picture.to_luma8())];
    if format == image::ImageFormat::Png {
        variants.push(image::DynamicImage::from(picture.to_rgba16()));
        variants.push(image::DynamicImage::from(picture.to_luma_alpha8()));
    }
    let write = |image: image::DynamicImage| {
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, format).expect("it can be written");
        file.into_inner()
    };
    variants.into_iter().map(write).collect()
}

/// Half of the files get correct checksums again, so that the damage reaches the code behind them.
#[test]
fn damaged_png() {
    let mut seeds = written(Format::Png);
    seeds.extend(by_crate(image::ImageFormat::Png));
    check(Format::Png, &seeds, |file| {
        let mut at = 8;
        while let Some(&[a, b, c, d]) = file.get(at..at + 4) {
            let end = at.saturating_add(8).saturating_add(u32::from_be_bytes([a, b, c, d]) as usize);
            if end.saturating_add(4) > file.len() {
                break;
            }
            let crc = crc32(&file[at + 4..end]);
            file[end..end + 4].copy_from_slice(&crc.to_be_bytes());
            at = end + 4;
        }
    });
}

#[test]
fn damaged_jpeg() {
    check(Format::Jpeg, &by_crate(image::ImageFormat::Jpeg), |_| ());
}

/// The checksum of a PNG chunk (CRC-32, polynomial 0xEDB88320), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
    })
}
