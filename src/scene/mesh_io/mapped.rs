use std::fs::File;
use std::io::Read;
use std::ops::Deref;
use std::path::Path;

use super::MeshError;

/// The bytes of a file: mapped when it is an ordinary file, read when it is not (a pipe, for example).
pub(crate) enum FileBytes {
    Mapped(memmap2::Mmap),
    Read(Vec<u8>),
}

impl FileBytes {
    /// The whole file. Nobody may write to or shorten a mapped file before it is loaded; see below for what happens then.
    pub(crate) fn open(path: &Path) -> Result<Self, MeshError> {
        let io = |e: &std::io::Error| MeshError::io(path, e);
        let mut file = File::open(path).map_err(|e| io(&e))?;
        let meta = file.metadata().map_err(|e| io(&e))?;
        if meta.is_file() && meta.len() > 0 {
            // SAFETY: the map is private to this value, read-only, and only ever seen as bytes, for which every bit
            // pattern is valid; all sizes are checked against the mapped length. What cannot be checked is memmap2's
            // condition that no process changes the file while it is mapped, since no system keeps others from doing so.
            // That is left to the user: where a file is cut short meanwhile, touching a page behind its new end stops
            // the program (SIGBUS on Unix); where bytes are overwritten, the mesh may be old, new or mixed. Programs that
            // write a new file and rename it over the old one, as this one does, disturb nobody: the map keeps the old.
            let map = unsafe { memmap2::Mmap::map(&file) }.map_err(|e| io(&e))?;
            return Ok(Self::Mapped(map));
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(|e| io(&e))?;
        Ok(Self::Read(bytes))
    }
}

impl Deref for FileBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Mapped(map) => map,
            Self::Read(bytes) => bytes,
        }
    }
}
