use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use super::error::Fault;
use super::{Image, ImageError, ImageErrorKind, exr, hdr, ldr, pfm};

/// The file formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// OpenEXR, half or float, with extra channels and metadata.
    Exr,
    /// 8-bit sRGB to write; 1 to 16 bits, grey or colour, with or without alpha to read.
    Png,
    /// Only to read.
    Jpeg,
    /// Radiance RGBE.
    Hdr,
    /// Portable float map.
    Pfm,
}

impl Format {
    /// The format that a file name's extension stands for.
    pub fn from_path(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match &extension[..] {
            "exr" => Self::Exr,
            "png" => Self::Png,
            "jpg" | "jpeg" => Self::Jpeg,
            "hdr" | "rgbe" | "pic" => Self::Hdr,
            "pfm" => Self::Pfm,
            _ => return None,
        })
    }

    /// The format whose signature the bytes begin with.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        Some(match bytes {
            [0x76, 0x2f, 0x31, 0x01, ..] => Self::Exr,
            [0x89, b'P', b'N', b'G', ..] => Self::Png,
            [0xff, 0xd8, 0xff, ..] => Self::Jpeg,
            [b'#', b'?', ..] => Self::Hdr,
            [b'P', b'F' | b'f', b'\n' | b' ' | b'\r' | b'\t', ..] => Self::Pfm,
            _ => return None,
        })
    }
}

/// What a file may ask for before any memory is given to it.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Bytes of the file itself.
    pub file_bytes: u64,
    /// Pixels of a side.
    pub side: u64,
    /// Width × height.
    pub pixels: u64,
    /// Width × height × channels.
    pub values: u64,
}

impl Limits {
    /// Up to 16384 × 16384 pixels, 2³⁰ values, 4 GiB of file.
    pub const DEFAULT: Self = Self { file_bytes: 4 << 30, side: 1 << 17, pixels: 1 << 28, values: 1 << 30 };

    /// Refuses a size that is empty, above the limits, or more than `pixels_per_byte` (the format's best compression)
    /// times what `len` bytes can hold.
    pub(super) fn check(
        &self,
        (width, height): (u64, u64),
        channels: u64,
        len: usize,
        pixels_per_byte: u64,
    ) -> Result<(u32, u32), Fault> {
        let found = format!("an image of {width} × {height} pixels with {channels} channels");
        let pixels = width.saturating_mul(height);
        if pixels == 0 || channels == 0 {
            return Err(Fault::malformed(found, "at least one pixel and one channel"));
        }
        if width > self.side || height > self.side || pixels > self.pixels {
            let expected = format!("at most {} pixels, no side above {}", self.pixels, self.side);
            return Err(Fault::new(ImageErrorKind::TooLarge, found, expected, "Scale the image down."));
        }
        if pixels.saturating_mul(channels) > self.values {
            let expected = format!("at most {} values", self.values);
            return Err(Fault::new(ImageErrorKind::TooLarge, found, expected, "Leave out channels or scale it down."));
        }
        let room = (len as u64).saturating_mul(pixels_per_byte);
        if pixels > room {
            let found = format!("{found} in a file of {len} bytes");
            let expected = format!("no more than the {room} pixels that so few bytes can hold");
            let help = "The size in the header is wrong or the file is cut short: write it again from its source.";
            return Err(Fault::new(ImageErrorKind::TooLarge, found, expected, help));
        }
        Ok((width as u32, height as u32))
    }
}

/// How to read an image.
#[derive(Clone, Copy, Debug)]
pub struct ReadOptions {
    /// Takes the numbers of a PNG or JPEG as they stand (0 to 1) instead of undoing the sRGB curve.
    pub raw: bool,
    pub limits: Limits,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { raw: false, limits: Limits::DEFAULT }
    }
}

/// How to write an image.
#[derive(Clone, Copy, Debug)]
pub struct WriteOptions {
    /// Stops by which PNG output is brightened: pixel values are multiplied by 2^exposure.
    pub exposure: f32,
    /// EXR colour and extra channels as 16-bit instead of 32-bit floats.
    pub half: bool,
    /// PNG output is dithered by less than half a step, the same way every time; exact steps stay as they are.
    pub dither: bool,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self { exposure: 0.0, half: false, dither: true }
    }
}

/// Reads an image as linear colour.
pub fn read(path: impl AsRef<Path>) -> Result<Image, ImageError> {
    read_with(path, &ReadOptions::default())
}

/// Reads an image; the content decides the format, and the extension where the content is silent.
pub fn read_with(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Image, ImageError> {
    let path = path.as_ref();
    let bytes = read_bytes(path, &options.limits).map_err(|f| f.at(path))?;
    let format = Format::from_bytes(&bytes).or_else(|| Format::from_path(path));
    let Some(format) = format else { return Err(unknown_format().at(path)) };
    decode_bytes(&bytes, format, options).map_err(|f| f.at(path))
}

/// Looks at an image file without decoding it: at its signature, and at the header of PNG and JPEG.
pub fn check_header(path: impl AsRef<Path>) -> Result<(), ImageError> {
    let path = path.as_ref();
    let check = || {
        let mut file = std::io::BufReader::new(File::open(path).map_err(|e| io_fault("read", &e))?);
        let start = std::io::BufRead::fill_buf(&mut file).map_err(|e| io_fault("read", &e))?;
        match Format::from_bytes(start).or_else(|| Format::from_path(path)) {
            Some(format @ (Format::Png | Format::Jpeg)) => ldr::check_header(file, format),
            Some(_) => Ok(()),
            None => Err(unknown_format()),
        }
    };
    check().map_err(|f: Fault| f.at(path))
}

/// What a header says about an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageSize {
    pub width: u32,
    pub height: u32,
    /// It has one channel of greys.
    pub grey: bool,
}

/// Reads the size of an image from its header.
pub fn size(path: impl AsRef<Path>) -> Result<ImageSize, ImageError> {
    /// Headers that are text end before this many bytes.
    const TEXT: u64 = 1 << 16;
    let path = path.as_ref();
    let size = || {
        let fault = |e: std::io::Error| io_fault("read", &e);
        let mut file = std::io::BufReader::new(File::open(path).map_err(fault)?);
        let length = file.get_ref().metadata().map_err(fault)?.len();
        let start = std::io::BufRead::fill_buf(&mut file).map_err(fault)?;
        let format = Format::from_bytes(start).or_else(|| Format::from_path(path)).ok_or_else(unknown_format)?;
        let text = |file: std::io::BufReader<File>| {
            let mut start = Vec::new();
            file.take(TEXT).read_to_end(&mut start).map_err(fault).map(|_| start)
        };
        let (size, grey) = match format {
            Format::Png | Format::Jpeg => ldr::size(file, format)?,
            Format::Exr => exr::size(file)?,
            Format::Hdr => (hdr::size(&text(file)?)?, false),
            Format::Pfm => pfm::size(&text(file)?).map(|(size, channels)| (size, channels == 1))?,
        };
        // Whether the file is long enough for its pixels, reading them tells.
        let (width, height) = Limits::DEFAULT.check(size, 1, length as usize, u64::MAX)?;
        Ok(ImageSize { width, height, grey })
    };
    size().map_err(|f: Fault| f.at(path))
}

fn unknown_format() -> Fault {
    let found = "content and extension of no known image format";
    Fault::new(ImageErrorKind::UnknownFormat, found, KNOWN, "Convert the file to one of these.")
}

/// Decodes an image from memory. `path` appears in errors only.
pub fn decode(bytes: &[u8], format: Format, options: &ReadOptions, path: &Path) -> Result<Image, ImageError> {
    decode_bytes(bytes, format, options).map_err(|f| f.at(path))
}

/// Encodes an image into memory. `path` appears in errors only.
pub fn encode(image: &Image, format: Format, options: &WriteOptions, path: &Path) -> Result<Vec<u8>, ImageError> {
    encode_bytes(image, format, options).map_err(|f| f.at(path))
}

/// Writes an image in the format of the extension, under a temporary name in the same directory that is then renamed:
/// whoever looks sees the old file or the whole new one.
pub fn write(path: impl AsRef<Path>, image: &Image, options: &WriteOptions) -> Result<(), ImageError> {
    let path = path.as_ref();
    let Some(format) = Format::from_path(path) else {
        let found = match path.extension() {
            Some(e) => format!("the extension .{}", e.display()),
            None => "no extension".to_owned(),
        };
        let help = "Give the output file one of these extensions.";
        return Err(Fault::new(ImageErrorKind::UnknownFormat, found, ".exr, .png, .hdr or .pfm", help).at(path));
    };
    let bytes = encode(image, format, options, path)?;
    replace_file(path, &bytes).map_err(|e| io_fault("write", &e).at(path))
}

const KNOWN: &str = "EXR, PNG, JPEG, HDR or PFM";

fn decode_bytes(bytes: &[u8], format: Format, options: &ReadOptions) -> Result<Image, Fault> {
    match format {
        Format::Exr => exr::decode(bytes, &options.limits),
        Format::Png | Format::Jpeg => ldr::decode(bytes, format, options),
        Format::Hdr => hdr::decode(bytes, &options.limits),
        Format::Pfm => pfm::decode(bytes, &options.limits),
    }
}

fn encode_bytes(image: &Image, format: Format, options: &WriteOptions) -> Result<Vec<u8>, Fault> {
    if image.pixels().is_empty() {
        let found = format!("an image of {} × {} pixels", image.width(), image.height());
        let help = "Render at least one pixel.";
        return Err(Fault::new(ImageErrorKind::Unsupported, found, "at least one pixel", help));
    }
    match format {
        Format::Exr => exr::encode(image, options.half),
        Format::Png => ldr::encode_png(image, options),
        Format::Hdr => Ok(hdr::encode(image)),
        Format::Pfm => Ok(pfm::encode(image)),
        Format::Jpeg => Err(Fault::new(
            ImageErrorKind::Unsupported,
            "JPEG as the output format",
            ".exr, .png, .hdr or .pfm",
            "JPEG is lossy and only read: choose .png for viewing or .exr for keeping.",
        )),
    }
}

fn read_bytes(path: &Path, limits: &Limits) -> Result<Vec<u8>, Fault> {
    let fault = |e: std::io::Error| io_fault("read", &e);
    let file = File::open(path).map_err(fault)?;
    let metadata = file.metadata().map_err(fault)?;
    if metadata.is_dir() {
        let help = "Name a file inside it.";
        return Err(Fault::new(ImageErrorKind::Io, "a directory", "an image file", help));
    }
    let too_long = |len: u64| {
        let expected = format!("at most {} bytes", limits.file_bytes);
        Fault::new(ImageErrorKind::TooLarge, format!("a file of {len} bytes"), expected, "Scale the image down.")
    };
    if metadata.len() > limits.file_bytes {
        return Err(too_long(metadata.len()));
    }
    // Read with the limit too: the length of a pipe or a growing file is not known beforehand.
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    let read = file.take(limits.file_bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(fault)?;
    if read as u64 > limits.file_bytes {
        return Err(too_long(read as u64));
    }
    Ok(bytes)
}

/// Writes a file under a temporary name in its folder and renames it: whoever looks sees the old file or the whole new one.
pub fn replace_file(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let directory = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".caustica-").suffix(".part");
    // Give the file the permissions of any new file, less the umask, instead of a temporary file's 0600.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.tempfile_in(directory)?;
    file.write_all(bytes)?;
    file.persist(path)?;
    Ok(())
}

fn io_fault(action: &str, error: &std::io::Error) -> Fault {
    use std::io::ErrorKind::{NotFound, PermissionDenied, StorageFull};
    let help = match error.kind() {
        NotFound => "Check the spelling of the path and that its directory exists.",
        PermissionDenied => "Check the permissions of the file and of its directory.",
        StorageFull => "Free some space or choose another disk.",
        _ => "Check that the path names an ordinary file on a working disk.",
    };
    Fault::new(ImageErrorKind::Io, format!("'{error}'"), format!("a file to {action}"), help)
}
