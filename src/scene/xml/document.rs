use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::{Position, SceneError};
use super::parse::Parser;
use super::{Node, NodeId};

/// What comes from outside the scene file.
#[derive(Clone, Debug, Default)]
pub struct ParseOptions {
    /// `-D key=value` pairs; they win over `<default>`.
    pub defines: Vec<(String, String)>,
}

/// A scene file with everything it includes, as a tree of typed nodes.
#[derive(Debug)]
pub struct Document {
    pub(super) nodes: Vec<Node>,
    pub(super) root: NodeId,
    /// Folders of `<path>`, the last one first, then that of the main file.
    pub(super) search: Vec<PathBuf>,
    pub(super) hasher: RefCell<blake3::Hasher>,
    pub(super) warnings: RefCell<Vec<String>>,
}

/// Scene files larger than this are refused.
pub(super) const MAX_FILE_BYTES: u64 = 256 << 20;

impl Document {
    /// Reads a file and all it includes.
    pub fn read(path: &Path, options: &ParseOptions) -> Result<Self, SceneError> {
        Parser::new(path, options).run(None)
    }

    /// Parses `text` as if it were the content of `path`, next to which other files are looked for.
    pub fn parse(text: &str, path: &Path, options: &ParseOptions) -> Result<Self, SceneError> {
        Parser::new(path, options).run(Some(text))
    }

    pub fn root(&self) -> NodeId {
        self.root
    }

    pub fn node(&self, id: NodeId) -> &Node {
        &self.nodes[id.0 as usize]
    }

    /// Finds a file that is named at `pos`: beside that scene file, in the `<path>` folders, beside the main file.
    pub fn resolve(&self, name: &str, pos: &Position) -> Result<PathBuf, SceneError> {
        resolve(name, pos, &self.search)
    }

    /// Adds the bytes of a mesh, texture or spectrum file to the content hash.
    pub fn hash_bytes(&self, bytes: &[u8]) {
        hash_block(&mut self.hasher.borrow_mut(), bytes);
    }

    /// Streams a file into the content hash.
    pub fn hash_file(&self, path: &Path) -> std::io::Result<()> {
        let file = std::fs::File::open(path)?;
        let mut hasher = self.hasher.borrow_mut();
        hasher.update(&file.metadata()?.len().to_le_bytes());
        hasher.update_reader(file)?;
        Ok(())
    }

    /// Hash of all that was read so far: defines, scene files, and the files given to [`Document::hash_bytes`].
    pub fn hash(&self) -> blake3::Hash {
        self.hasher.borrow().finalize()
    }

    /// Records something that is ignored without harm.
    pub fn warn(&self, pos: &Position, message: impl std::fmt::Display) {
        self.warnings.borrow_mut().push(format!("{pos}: {message}"));
    }

    pub fn warnings(&self) -> Vec<String> {
        self.warnings.borrow().clone()
    }
}

/// Length first, so that two blocks never hash like one.
pub(super) fn hash_block(hasher: &mut blake3::Hasher, bytes: &[u8]) {
    hasher.update(&(bytes.len() as u64).to_le_bytes());
    hasher.update(bytes);
}

pub(super) fn resolve(name: &str, pos: &Position, search: &[PathBuf]) -> Result<PathBuf, SceneError> {
    let name_path = Path::new(name.trim());
    if name.trim().is_empty() || name.contains('\0') {
        return Err(SceneError::at(pos, "the file name is empty").help("give a path relative to the scene file"));
    }
    let beside = pos.file.parent().unwrap_or(Path::new("")).to_path_buf();
    std::iter::once(&beside).chain(search).map(|dir| dir.join(name_path)).find(|p| p.is_file()).ok_or_else(|| {
        let mut folders: Vec<String> = Vec::new();
        for dir in std::iter::once(&beside).chain(search) {
            let dir = if dir.as_os_str().is_empty() { ".".into() } else { dir.display().to_string() };
            if !folders.contains(&dir) {
                folders.push(dir);
            }
        }
        let help = if name_path.is_absolute() { String::new() } else { format!("looked in {}", folders.join(", ")) };
        SceneError::at(pos, format!("file \"{name}\" not found")).help(help)
    })
}

/// Reads at most `limit` bytes of a regular file.
pub(super) fn read_limited(path: &Path, limit: u64) -> Result<Vec<u8>, String> {
    let metadata = std::fs::metadata(path).map_err(|e| e.to_string())?;
    if !metadata.is_file() {
        return Err("it is not a regular file".into());
    }
    if metadata.len() > limit {
        return Err(format!("its {} bytes exceed the limit of {limit}", metadata.len()));
    }
    std::fs::read(path).map_err(|e| e.to_string())
}

/// Line starts of a file, to turn byte offsets into positions.
pub(super) struct SourceFile<'t> {
    pub path: Arc<Path>,
    pub text: &'t str,
    starts: Vec<usize>,
}

impl<'t> SourceFile<'t> {
    pub fn new(path: Arc<Path>, text: &'t str) -> Self {
        let starts = std::iter::once(0).chain(text.bytes().enumerate().filter(|b| b.1 == b'\n').map(|b| b.0 + 1));
        let starts = starts.collect();
        Self { path, text, starts }
    }

    pub fn position(&self, byte: usize) -> Position {
        let byte = byte.min(self.text.len());
        let line = self.starts.partition_point(|&s| s <= byte).max(1);
        let start = self.starts[line - 1];
        // Counting characters in a giant line would be quadratic.
        let col = match self.text.get(start..byte) {
            Some(before) if before.len() < 4096 => before.chars().count(),
            _ => byte - start,
        };
        Position { file: self.path.clone(), line: line as u32, col: col as u32 + 1 }
    }
}

/// A scene file that cannot be read; where there is none, the one beside it with the nearest name is suggested.
pub(super) fn unreadable(start: &Position, why: &str) -> SceneError {
    let e = SceneError::at(start, format!("cannot read the scene file: {why}"));
    let folder = start.file.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (Ok(entries), Some(name), false) = (folder.read_dir(), start.file.file_name(), start.file.exists()) else {
        return e;
    };
    let names = entries.flatten().map(|f| f.file_name().to_string_lossy().into_owned());
    let mut scenes: Vec<String> = names.filter(|n| n.ends_with(".xml")).collect();
    scenes.sort_unstable();
    match scenes.is_empty() {
        true => e.help(format!("there is no .xml file in {}", folder.display())),
        false => e.suggest(&name.to_string_lossy(), &scenes),
    }
}
