use std::io;
use std::path::{Path, PathBuf};

use super::job::{Job, Work};
use crate::Model;
use doorcam_core::light::{Fingerprint, Snapshot};
use doorcam_source::files::{self, FileKind, ReadError, replace};

/// Keeps the background in a file from one run to the next.
pub struct BackgroundStore {
    path: PathBuf,
    settings: Box<dyn Fn() -> String + Send>,
    saving: Option<Job<()>>,
}

impl BackgroundStore {
    /// Uses the file at `path`. `settings` describes, in any form, what the model of the doorway does not know and what
    /// invalidates this camera's background when it changes: image size, calibration, exposure, gain and white balance.
    /// It is called each time, because some of this is only found once frames arrive.
    pub fn new(path: impl Into<PathBuf>, settings: impl Fn() -> String + Send + 'static) -> Self {
        Self { path: path.into(), settings: Box::new(settings), saving: None }
    }

    /// Loads the saved background if it belongs to this doorway, camera and exposure and is at most `keep_s` seconds
    /// old. Logs why if it cannot be used.
    pub(super) fn load(&mut self, model: &Model, keep_s: f64) -> Option<Snapshot> {
        let name = self.path.display();
        let loaded = read(&self.path, Snapshot::longest(model.patch.size)).and_then(|bytes| match bytes {
            Some(bytes) => Snapshot::decode(&bytes, &self.fingerprint(model), model.patch.size, keep_s)
                .map(Some)
                .map_err(|e| e.to_string()),
            None => Ok(None),
        });
        match loaded {
            Ok(Some(snapshot)) => {
                tracing::info!("{name}: the background of the last run is used");
                Some(snapshot)
            }
            Ok(None) => None,
            Err(e) => {
                tracing::warn!("{name}: the saved background is not used: {e}");
                None
            }
        }
    }

    /// Saves a snapshot, unless the previous save is still running.
    pub(super) fn save(&mut self, model: &Model, snapshot: Snapshot, work: Work) {
        match self.saving.take().map(Job::poll) {
            Some(Err(running)) if work == Work::Aside => {
                self.saving = Some(running);
                return;
            }
            // A save in place is the last one: it waits, so that an older one cannot overwrite it.
            Some(Err(running)) => drop(running.wait()),
            _ => {}
        }
        let (path, fingerprint) = (self.path.clone(), self.fingerprint(model));
        self.saving = Some(Job::start(work, "save", move || {
            let saved = snapshot.encode(&fingerprint).map_err(io::Error::other);
            if let Err(e) = saved.and_then(|bytes| replace(&path, &bytes)) {
                tracing::warn!("{}: the background cannot be saved: {e}", path.display());
            }
        }));
    }

    fn fingerprint(&self, model: &Model) -> Fingerprint {
        // Run lengths of counted and uncounted pixels, side after side: what the camera sees of the floor.
        let mut runs = String::new();
        for side in &model.counted {
            for run in side.chunk_by(|a, b| a == b) {
                runs.push_str(&format!("{}{},", if run[0] { '+' } else { '-' }, run.len()));
            }
        }
        let settings = (self.settings)();
        Fingerprint::new(format!("{:?}; {:?}; {runs}; {settings}", model.doorway, model.patch))
    }
}

/// Reads the file, which has at most `longest` bytes; `None` if it does not exist.
fn read(path: &Path, longest: usize) -> Result<Option<Vec<u8>>, String> {
    match files::read(path, FileKind::new("a saved background", longest as u64)) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(e) if e.is_missing() => Ok(None),
        Err(ReadError::Io(e)) => Err(format!("it cannot be read: {e}")),
        Err(e) => Err(format!("it {e}")),
    }
}
