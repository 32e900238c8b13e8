//! Photon-map files: versioned, little-endian, tied to their scene, guarded by checksums.
//!
//! ```text
//! magic 8 | version u32 | table bytes u32 | file bytes u64 | scene hash 32      (56 bytes)
//! table: parameters u32, maps u32, then key and value strings, then (name, photons u64) of every map
//! BLAKE3 of all the above, 32
//! photons of every map in heap order, 20 bytes each
//! BLAKE3 of all the above, 32
//! ```
//! A string is its length as u32 and UTF-8. Reading trusts nothing: lengths are compared with the file's before memory is
//! taken, checksums before content, and the photons must be a left-balanced heap.

use super::map::PhotonMap;
use super::packed::{Flags, Photon};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// First bytes of every map file; the line ends and the control character reveal a transfer in text mode.
const MAGIC: [u8; 8] = *b"\x93CPM\r\n\x1a\n";
/// Version of the layout that this program writes and reads.
pub const VERSION: u32 = 1;
const PREFIX: usize = 56;
const HASH: usize = 32;
const RECORD: usize = size_of::<Photon>();
/// Limits of the table: bytes, parameters, maps.
const MAX_TABLE: u32 = 1 << 20;
const MAX_PARAMETERS: u32 = 4096;
const MAX_MAPS: u32 = 64;

/// Why a map file cannot be used, sorted by what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum MapFileError {
    #[error("{}: {source}", path.display())]
    Io { path: PathBuf, source: io::Error },
    #[error("{}: not a photon map file; `map build` makes one", path.display())]
    NotAMap { path: PathBuf },
    #[error("{}: photon map format {found}, this program reads format {VERSION}; build the map again", path.display())]
    Version { path: PathBuf, found: u32 },
    #[error("{}: truncated, {found} of {expected} bytes are there; copy or build it again", path.display())]
    Truncated { path: PathBuf, found: u64, expected: u64 },
    #[error("{}: damaged ({what}); copy or build it again", path.display())]
    Damaged { path: PathBuf, what: &'static str },
    #[error(
        "{}: made for another scene (or another state of it): its hash begins with {}, the scene's with {}; build the map again",
        path.display(), short(found), short(expected)
    )]
    WrongScene { path: PathBuf, found: [u8; 32], expected: [u8; 32] },
}

/// The first bytes of a hash, for people.
fn short(hash: &[u8; 32]) -> String {
    hash[..6].iter().map(|b| format!("{b:02x}")).collect()
}

/// What a map file holds.
#[derive(Debug, Default)]
pub struct MapFile {
    /// Hash of the scene the photons were traced in, as its maker computes it.
    pub scene_hash: [u8; 32],
    /// Whatever else the maker wants to find again: seed, emitted paths, settings.
    pub parameters: BTreeMap<String, String>,
    /// Maps by name.
    pub maps: Vec<(String, PhotonMap)>,
}

/// What [`MapFile::info`] tells without reading any photon.
#[derive(Clone, Debug, PartialEq)]
pub struct MapFileInfo {
    pub version: u32,
    pub scene_hash: [u8; 32],
    pub parameters: BTreeMap<String, String>,
    /// Names and numbers of photons.
    pub maps: Vec<(String, u64)>,
    /// Size of the file, bytes.
    pub bytes: u64,
}

impl MapFile {
    /// Writes the file beside its final place and renames it, so that a crash leaves no half of a map.
    pub fn write(&self, path: &Path) -> Result<(), MapFileError> {
        let io = |source| MapFileError::Io { path: path.to_owned(), source };
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut temporary = tempfile::NamedTempFile::new_in(folder).map_err(io)?;
        self.write_to(BufWriter::with_capacity(1 << 20, temporary.as_file_mut())).map_err(io)?;
        temporary.as_file().sync_all().map_err(io)?;
        temporary.persist(path).map_err(|e| io(e.error))?;
        Ok(())
    }

    fn write_to(&self, out: impl Write) -> io::Result<()> {
        let table = self.table()?;
        let photons: usize = self.maps.iter().map(|(_, map)| map.len()).sum();
        let bytes = PREFIX + table.len() + HASH + photons * RECORD + HASH;
        let mut out = Hashing { inner: out, hasher: blake3::Hasher::new() };
        // The header and its checksum.
        out.write_all(&MAGIC)?;
        out.write_all(&VERSION.to_le_bytes())?;
        out.write_all(&(table.len() as u32).to_le_bytes())?;
        out.write_all(&(bytes as u64).to_le_bytes())?;
        out.write_all(&self.scene_hash)?;
        out.write_all(&table)?;
        out.write_checksum()?;
        // The photons, and the checksum of everything.
        for (_, map) in &self.maps {
            for photon in map.heap_order() {
                out.write_all(&to_bytes(&photon))?;
            }
        }
        out.write_checksum()?;
        out.inner.flush()
    }

    /// The table's bytes.
    fn table(&self) -> io::Result<Vec<u8>> {
        let mut table = Vec::new();
        table.extend((self.parameters.len() as u32).to_le_bytes());
        table.extend((self.maps.len() as u32).to_le_bytes());
        let mut string = |s: &str| {
            table.extend((s.len() as u32).to_le_bytes());
            table.extend(s.as_bytes());
        };
        for (key, value) in &self.parameters {
            string(key);
            string(value);
        }
        for (name, map) in &self.maps {
            table.extend((name.len() as u32).to_le_bytes());
            table.extend(name.as_bytes());
            table.extend((map.len() as u64).to_le_bytes());
        }
        let fits = table.len() <= MAX_TABLE as usize
            && self.parameters.len() <= MAX_PARAMETERS as usize
            && self.maps.len() <= MAX_MAPS as usize;
        fits.then_some(table).ok_or_else(|| io::Error::other("more parameters or maps than a map file may have"))
    }

    /// Reads the header only.
    pub fn info(path: &Path) -> Result<MapFileInfo, MapFileError> {
        Reader::open(path)?.info()
    }

    /// Reads a whole file made for the scene of hash `scene_hash`; `None` takes any scene.
    pub fn read(path: &Path, scene_hash: Option<&[u8; 32]>) -> Result<Self, MapFileError> {
        let mut reader = Reader::open(path)?;
        let info = reader.info()?;
        if let Some(expected) = scene_hash.filter(|&h| *h != info.scene_hash) {
            return Err(MapFileError::WrongScene { path: path.into(), found: info.scene_hash, expected: *expected });
        }
        // The checksum tells about damage before the heap does, so keep what the photons look like until it is known.
        let mut maps = Vec::new();
        for (name, count) in info.maps {
            maps.push((name, reader.photons(count as usize)?));
        }
        reader.checksum("the photons' checksum does not match")?;
        let maps = (maps.into_iter())
            .map(|(name, map)| Some((name, map?)))
            .collect::<Option<Vec<_>>>()
            .ok_or_else(|| reader.damaged("the photons are not in the order of a balanced map"))?;
        Ok(Self { scene_hash: info.scene_hash, parameters: info.parameters, maps })
    }

    /// The map of a name.
    pub fn map(&self, name: &str) -> Option<&PhotonMap> {
        self.maps.iter().find(|(n, _)| n == name).map(|(_, map)| map)
    }
}

/// A photon's twenty bytes, little-endian on every machine.
fn to_bytes(p: &Photon) -> [u8; RECORD] {
    let mut out = [0; RECORD];
    for (bytes, v) in out.chunks_exact_mut(4).zip(p.position) {
        bytes.copy_from_slice(&v.to_le_bytes());
    }
    out[12..16].copy_from_slice(&p.power);
    out[16..18].copy_from_slice(&p.direction);
    out[18..].copy_from_slice(&p.flags.0.to_le_bytes());
    out
}

/// The inverse of [`to_bytes`].
fn from_bytes(b: &[u8; RECORD]) -> Photon {
    let float = |i: usize| f32::from_le_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]]);
    Photon {
        position: [float(0), float(4), float(8)],
        power: [b[12], b[13], b[14], b[15]],
        direction: [b[16], b[17]],
        flags: Flags(u16::from_le_bytes([b[18], b[19]])),
    }
}

/// A reader or writer that hashes what passes.
struct Hashing<T> {
    inner: T,
    hasher: blake3::Hasher,
}

impl<W: Write> Hashing<W> {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hasher.update(bytes);
        self.inner.write_all(bytes)
    }

    /// Writes the hash of everything so far; it becomes part of what the next one covers.
    fn write_checksum(&mut self) -> io::Result<()> {
        let hash = *self.hasher.finalize().as_bytes();
        self.write_all(&hash)
    }
}

/// A map file being read, with its name for messages.
struct Reader<'a> {
    path: &'a Path,
    file: Hashing<BufReader<File>>,
    bytes: u64,
}

impl<'a> Reader<'a> {
    fn open(path: &'a Path) -> Result<Self, MapFileError> {
        let io = |source| MapFileError::Io { path: path.to_owned(), source };
        let file = File::open(path).map_err(io)?;
        let bytes = file.metadata().map_err(io)?.len();
        let file = Hashing { inner: BufReader::with_capacity(1 << 20, file), hasher: blake3::Hasher::new() };
        Ok(Self { path, file, bytes })
    }

    fn damaged(&self, what: &'static str) -> MapFileError {
        MapFileError::Damaged { path: self.path.to_owned(), what }
    }

    fn fill(&mut self, out: &mut [u8]) -> Result<(), MapFileError> {
        self.file.inner.read_exact(out).map_err(|source| MapFileError::Io { path: self.path.to_owned(), source })?;
        self.file.hasher.update(out);
        Ok(())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], MapFileError> {
        let mut out = [0; N];
        self.fill(&mut out)?;
        Ok(out)
    }

    /// Compares the next bytes with the hash of all before them.
    fn checksum(&mut self, otherwise: &'static str) -> Result<(), MapFileError> {
        let expected = *self.file.hasher.finalize().as_bytes();
        if self.array::<HASH>()? == expected { Ok(()) } else { Err(self.damaged(otherwise)) }
    }

    /// Reads and checks everything before the photons.
    fn info(&mut self) -> Result<MapFileInfo, MapFileError> {
        let path = || self.path.to_owned();
        let truncated = |expected| MapFileError::Truncated { path: path(), found: self.bytes, expected };
        // What kind of file is it?
        let smallest = (PREFIX + 2 * HASH) as u64;
        if self.bytes < MAGIC.len() as u64 {
            return Err(MapFileError::NotAMap { path: path() });
        }
        let too_short = (self.bytes < smallest).then(|| truncated(smallest));
        if self.array()? != MAGIC {
            return Err(MapFileError::NotAMap { path: self.path.to_owned() });
        }
        if let Some(error) = too_short {
            return Err(error);
        }
        let version = u32::from_le_bytes(self.array()?);
        if version != VERSION {
            return Err(MapFileError::Version { path: self.path.to_owned(), found: version });
        }
        // Is all of it there?
        let table_bytes = u32::from_le_bytes(self.array()?);
        let bytes = u64::from_le_bytes(self.array()?);
        if self.bytes < bytes {
            return Err(MapFileError::Truncated { path: self.path.to_owned(), found: self.bytes, expected: bytes });
        }
        if self.bytes > bytes {
            return Err(self.damaged("it is longer than its header says"));
        }
        if table_bytes > MAX_TABLE || smallest + u64::from(table_bytes) > bytes {
            return Err(self.damaged("its table is too long"));
        }
        // Is the header as it was written?
        let scene_hash = self.array()?;
        let mut table = vec![0; table_bytes as usize];
        self.fill(&mut table)?;
        self.checksum("the header's checksum does not match")?;
        let (parameters, maps) = parse_table(&table).ok_or_else(|| self.damaged("its table makes no sense"))?;
        // Do the photons fill what is left?
        let left = bytes - smallest - u64::from(table_bytes);
        let needed = maps.iter().try_fold(0u64, |sum, (_, n)| sum.checked_add(n.checked_mul(RECORD as u64)?));
        if needed != Some(left) {
            return Err(self.damaged("its photon counts do not match its length"));
        }
        Ok(MapFileInfo { version, scene_hash, parameters, maps, bytes })
    }

    /// Reads `count` photons; the map is `None` when they are not in heap order.
    fn photons(&mut self, count: usize) -> Result<Option<PhotonMap>, MapFileError> {
        let mut photons = Vec::with_capacity(count);
        let mut bytes = vec![0; RECORD * count.min(1 << 14)];
        while photons.len() < count {
            let wanted = RECORD * (count - photons.len()).min(1 << 14);
            self.fill(&mut bytes[..wanted])?;
            photons.extend(bytes[..wanted].as_chunks::<RECORD>().0.iter().map(from_bytes));
        }
        Ok(PhotonMap::from_heap_order(&photons))
    }
}

type Table = (BTreeMap<String, String>, Vec<(String, u64)>);

/// Parses the table; `None` when anything is missing, too much, or not text.
fn parse_table(mut bytes: &[u8]) -> Option<Table> {
    fn number(bytes: &mut &[u8]) -> Option<u32> {
        let (head, rest) = bytes.split_first_chunk()?;
        *bytes = rest;
        Some(u32::from_le_bytes(*head))
    }
    fn string(bytes: &mut &[u8]) -> Option<String> {
        let len = number(bytes)? as usize;
        let (head, rest) = bytes.split_at_checked(len)?;
        *bytes = rest;
        std::str::from_utf8(head).ok().map(str::to_owned)
    }
    let (parameter_count, map_count) = (number(&mut bytes)?, number(&mut bytes)?);
    if parameter_count > MAX_PARAMETERS || map_count > MAX_MAPS {
        return None;
    }
    let mut parameters = BTreeMap::new();
    for _ in 0..parameter_count {
        parameters.insert(string(&mut bytes)?, string(&mut bytes)?);
    }
    let mut maps = Vec::new();
    for _ in 0..map_count {
        let name = string(&mut bytes)?;
        let (count, rest) = bytes.split_first_chunk()?;
        bytes = rest;
        maps.push((name, u64::from_le_bytes(*count)));
    }
    bytes.is_empty().then_some((parameters, maps))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::math::Vec3;
    use crate::photon::{PhotonClass, PhotonRecord};
    use crate::sample::mix64;
    use proptest::prelude::*;

    fn photon(i: u64) -> Photon {
        let u = |j: u64| (mix64(3 * i + j) >> 40) as f32 / (1u64 << 24) as f32;
        let record = PhotonRecord {
            p: Vec3::new(u(0), u(1), u(2)),
            power: Rgb::new(u(1), 0.5, u(2)),
            wi: Vec3::Z,
            normal: Vec3::Z,
            side: true,
            class: PhotonClass::Global,
            mark: false,
        };
        Photon::pack(&record, mix64(i)).expect("a good record")
    }

    fn map(n: u64) -> PhotonMap {
        PhotonMap::build((0..n).map(photon).collect())
    }

    fn sample() -> MapFile {
        MapFile {
            scene_hash: std::array::from_fn(|i| i as u8),
            parameters: [("seed", "1"), ("emitted", "4096")].map(|(k, v)| (k.to_owned(), v.to_owned())).into(),
            maps: vec![("global".into(), map(150)), ("caustic".into(), map(0)), ("volume".into(), map(7))],
        }
    }

    fn bytes_of(file: &MapFile) -> Vec<u8> {
        let mut bytes = Vec::new();
        file.write_to(&mut bytes).expect("memory takes everything");
        bytes
    }

    fn read_bytes(bytes: &[u8], hash: Option<&[u8; 32]>) -> Result<MapFile, MapFileError> {
        let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
        file.write_all(bytes).expect("room for a small file");
        MapFile::read(file.path(), hash)
    }

    #[test]
    fn a_file_gives_back_what_was_written() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.cpm");
        let file = sample();
        file.write(&path).expect("the folder is writable");
        file.write(&path).expect("and again over it");
        assert_eq!(std::fs::read_dir(folder.path()).expect("it is there").count(), 1, "no temporary file is left");
        let copy = MapFile::read(&path, Some(&file.scene_hash)).expect("it was just written");
        assert_eq!((&copy.parameters, copy.scene_hash), (&file.parameters, file.scene_hash));
        for ((name, map), (copy_name, copy)) in file.maps.iter().zip(&copy.maps) {
            assert_eq!((name, map.len()), (copy_name, copy.len()));
            assert!((0..map.len() as u32).all(|i| map.photon(i) == copy.photon(i)));
        }
        let info = MapFile::info(&path).expect("it was just written");
        assert_eq!(info.maps, [("global".into(), 150), ("caustic".into(), 0), ("volume".into(), 7)]);
        assert_eq!(info.bytes, bytes_of(&file).len() as u64);
        assert_eq!(copy.map("volume").map(PhotonMap::len), Some(7));
    }

    #[test]
    fn refusals_say_why() {
        let file = sample();
        let bytes = bytes_of(&file);
        let message = |r: Result<MapFile, MapFileError>| r.expect_err("it must be refused").to_string();
        assert!(message(read_bytes(&bytes, Some(&[9; 32]))).contains("another scene"));
        assert!(message(read_bytes(b"ply\nformat ascii 1.0\n", None)).contains("not a photon map"));
        assert!(message(read_bytes(b"", None)).contains("not a photon map"));
        assert!(message(read_bytes(&bytes[..bytes.len() - 1], None)).contains("truncated"));
        assert!(message(read_bytes(&bytes[..20], None)).contains("truncated"));
        assert!(message(read_bytes(&[&bytes[..], &[0]].concat(), None)).contains("longer"));
        let mut other = bytes.clone();
        other[8] = 2;
        assert!(message(read_bytes(&other, None)).contains("format 2"));
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert!(message(MapFile::read(&folder.path().join("none.cpm"), None)).contains("none.cpm"));
        assert!(file.write(&folder.path().join("no/such/folder.cpm")).is_err());
    }

    #[test]
    fn absurd_counts_take_no_memory() {
        // A header with a right checksum that promises 2^60 photons.
        let mut file = sample();
        file.maps.clear();
        let mut table = file.table().expect("a small table");
        table[4..8].copy_from_slice(&1u32.to_le_bytes());
        table.extend(0u32.to_le_bytes());
        table.extend((1u64 << 60).to_le_bytes());
        let mut bytes = [&MAGIC[..], &VERSION.to_le_bytes(), &(table.len() as u32).to_le_bytes()].concat();
        bytes.extend(((PREFIX + table.len() + 2 * HASH) as u64).to_le_bytes());
        bytes.extend(file.scene_hash);
        bytes.extend(&table);
        for _ in 0..2 {
            let hash = blake3::hash(&bytes);
            bytes.extend(hash.as_bytes());
        }
        let error = read_bytes(&bytes, None).expect_err("there are no photons");
        assert!(error.to_string().contains("counts"), "{error}");
    }

    #[test]
    fn photons_out_of_order_are_refused_even_with_a_right_checksum() {
        let mut bytes = bytes_of(&sample());
        let first = bytes.len() - HASH - 157 * RECORD;
        let (a, b) = (first + RECORD, first + 2 * RECORD);
        for i in 0..RECORD {
            bytes.swap(a + i, b + i);
        }
        let end = bytes.len() - HASH;
        let hash = blake3::hash(&bytes[..end]);
        bytes[end..].copy_from_slice(hash.as_bytes());
        let error = read_bytes(&bytes, None).expect_err("not a heap");
        assert!(error.to_string().contains("balanced"), "{error}");
    }

    proptest! {
        #[test]
        fn no_damaged_byte_is_accepted(place in 0usize..4000, flip in 1u8..=255) {
            let mut bytes = bytes_of(&sample());
            let place = place % bytes.len();
            bytes[place] ^= flip;
            prop_assert!(read_bytes(&bytes, None).is_err());
        }

        #[test]
        fn no_truncated_file_is_accepted(keep in 0usize..4000) {
            let bytes = bytes_of(&sample());
            let keep = keep % bytes.len();
            prop_assert!(read_bytes(&bytes[..keep], None).is_err());
        }

        #[test]
        fn noise_is_refused(noise in proptest::collection::vec(any::<u8>(), 0..300), magic: bool) {
            let mut bytes = if magic { [&MAGIC[..], &VERSION.to_le_bytes()].concat() } else { Vec::new() };
            bytes.extend(noise);
            prop_assert!(read_bytes(&bytes, None).is_err());
        }
    }
}
