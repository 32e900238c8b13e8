//! Checkpoint files.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::codec::{Decoder, Encoder};
use super::{Checkpoint, CheckpointError};
use crate::film::{FilmState, ReconstructionFilter};
use crate::image::FilmWindow;
use crate::tally::Counters;

const MAGIC: [u8; 8] = *b"CAUSTCHK";
/// Raised with every change of what the body holds.
const VERSION: u32 = 4;
const HEADER: usize = 8 + 4 + 32;

impl Checkpoint {
    /// The bytes of a checkpoint file.
    pub fn encode(&self) -> Vec<u8> {
        let mut body = Encoder { bytes: vec![0; HEADER] };
        self.clone().visit(&mut body).expect("writing to memory does not fail");
        let mut bytes = body.bytes;
        let hash = blake3::hash(&bytes[HEADER..]);
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..12].copy_from_slice(&VERSION.to_le_bytes());
        bytes[12..HEADER].copy_from_slice(hash.as_bytes());
        bytes
    }

    /// Reads the bytes of a checkpoint file; `path` is for messages.
    pub fn decode(bytes: &[u8], path: &Path) -> Result<Self, CheckpointError> {
        let damaged = |what| CheckpointError::Damaged { path: path.to_owned(), what };
        if bytes.len() < MAGIC.len() || bytes[..8] != MAGIC {
            return Err(CheckpointError::NotACheckpoint(path.to_owned()));
        }
        if bytes.len() < HEADER {
            return Err(damaged("it is cut short"));
        }
        let found = u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]);
        if found != VERSION {
            return Err(CheckpointError::Version { path: path.to_owned(), found, expected: VERSION });
        }
        let body = &bytes[HEADER..];
        if blake3::hash(body).as_bytes()[..] != bytes[12..HEADER] {
            return Err(damaged("its checksum does not match"));
        }
        let mut checkpoint = Self::blank();
        let mut decoder = Decoder { rest: body };
        checkpoint.visit(&mut decoder).map_err(|_| damaged("its contents make no sense"))?;
        if !decoder.rest.is_empty() || !checkpoint.is_consistent() {
            return Err(damaged("its parts do not fit each other"));
        }
        Ok(checkpoint)
    }

    /// Reads a checkpoint file.
    pub fn read(path: &Path) -> Result<Self, CheckpointError> {
        let io = |error| CheckpointError::Io { path: path.to_owned(), action: "read", error };
        Self::decode(&std::fs::read(path).map_err(io)?, path)
    }

    /// Writes a checkpoint file in place of what may be there. Whatever happens on the way, power cuts included, either
    /// the old file or the new one is there afterwards, whole.
    pub fn write(&self, path: &Path) -> Result<(), CheckpointError> {
        let io = |error| CheckpointError::Io { path: path.to_owned(), action: "write", error };
        replace(path, &self.encode()).map_err(io)
    }

    fn blank() -> Self {
        Self {
            scene_hash: String::new(),
            plan: String::new(),
            accel: String::new(),
            integrator: String::new(),
            seed: 0,
            window: FilmWindow::full(1, 1),
            filter: ReconstructionFilter::default(),
            ranges: Vec::new(),
            spp: 0,
            version: String::new(),
            independent: true,
            film: FilmState::default(),
            layers: Vec::new(),
            doubt: None,
            counters: Counters::default(),
            maps: Vec::new(),
            photon_memory: 0,
            shared: Vec::new(),
            evenness: Vec::new(),
        }
    }
}

/// Writes to a file beside, brings it to the disk, then gives it the name; one fixed name, so that a killed program leaves
/// at most one such file, which the next one reuses.
fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    let part = PathBuf::from(name);
    let mut file = File::create(&part)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    drop(file);
    std::fs::rename(&part, path)?;
    // Bring the new name to the disk too, where folders can be opened.
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    Ok(())
}
