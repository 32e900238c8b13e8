//! What leaves a render while it is running: checkpoints and the image so far, into files and into a viewer.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::CliError;
use super::args::RenderArgs;
use super::serve::Viewer;
use crate::image::WriteOptions;
use crate::render::{Checkpoint, Session};

/// Writes what is due after each pass.
///
/// A file that cannot be written does not end the render: it is told at once, tried again when it is due again, and makes
/// the run fail at its end unless it worked then.
pub struct Keeper {
    checkpoint: Option<(PathBuf, Duration)>,
    images: Option<(Vec<PathBuf>, Duration, WriteOptions)>,
    viewer: Option<Viewer>,
    last_checkpoint: Instant,
    last_image: Instant,
    failed: Option<CliError>,
}

impl Keeper {
    pub fn new(a: &RenderArgs, outputs: &[PathBuf]) -> Result<Self, CliError> {
        let now = Instant::now();
        if let Some(path) = &a.checkpoint {
            super::check_folder(path)?;
        }
        let name = || outputs.first().map_or_else(|| "caustica".to_owned(), |p| p.display().to_string());
        let viewer = a.serve.as_deref().map(|address| Viewer::connect(address, name())).transpose()?;
        let options = WriteOptions { exposure: a.exposure, half: !a.float, ..WriteOptions::default() };
        Ok(Self {
            checkpoint: a.checkpoint.clone().map(|path| (path, a.every)),
            images: a.write_every.map(|every| (outputs.to_vec(), every, options)),
            viewer,
            last_checkpoint: now,
            last_image: now,
            failed: None,
        })
    }

    /// Writes what is due; the last pass always leaves a checkpoint.
    pub fn after_pass(&mut self, session: &Session, last: bool) {
        if let Some(viewer) = &mut self.viewer {
            viewer.after_pass(session, last);
        }
        if let Some((path, every)) = &self.checkpoint
            && (last || self.last_checkpoint.elapsed() >= *every)
        {
            self.failed = Checkpoint::of(session).write(path).err().map(CliError::from);
            if let Some(e) = &self.failed {
                eprintln!("caustica: warning: {e}");
            }
            self.last_checkpoint = Instant::now();
        }
        if let Some((paths, every, options)) = &self.images
            && !last
            && self.last_image.elapsed() >= *every
        {
            let image = session.image();
            for path in paths {
                if let Err(e) = crate::image::write(path, &image, options) {
                    eprintln!("caustica: warning: {e}");
                }
            }
            self.last_image = Instant::now();
        }
    }

    /// Whether the last checkpoint could be written.
    pub fn result(self) -> Result<(), CliError> {
        self.failed.map_or(Ok(()), Err)
    }
}
