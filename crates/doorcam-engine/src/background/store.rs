use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::job::{Job, Work};
use crate::Model;
use doorcam_core::light::{Fingerprint, Snapshot};
use doorcam_source::files::replace;

/// Where the background is kept from one run to the next.
pub struct BackgroundStore {
    path: PathBuf,
    settings: Box<dyn Fn() -> String + Send>,
    saving: Option<Job<()>>,
}

impl BackgroundStore {
    /// A file, and in any words all that makes a background of this camera worthless when it changes and that the model of
    /// the doorway does not know: the image's size, the calibration, exposure, gain and white balance. It is asked for anew each
    /// time, because some of it is found while frames come.
    pub fn new(path: impl Into<PathBuf>, settings: impl Fn() -> String + Send + 'static) -> Self {
        Self { path: path.into(), settings: Box::new(settings), saving: None }
    }

    /// What was saved, if it is of this doorway, camera and exposure and at most `keep_s` seconds old; says what it does not
    /// use, and why.
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

    /// Saves it; not if the last saving is still under way.
    pub(super) fn save(&mut self, model: &Model, snapshot: Snapshot, work: Work) {
        match self.saving.take().map(Job::poll) {
            Some(Err(running)) if work == Work::Aside => {
                self.saving = Some(running);
                return;
            }
            // The last saving of all waits, so that an older one does not come after it.
            Some(Err(Job::Running(handle))) => drop(handle.join()),
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
        // Runs of pixels that count and do not, side after side: what the camera sees of the floor.
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

/// The file's bytes, one more than `longest` at most; none if there is no such file.
fn read(path: &Path, longest: usize) -> Result<Option<Vec<u8>>, String> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(format!("it cannot be read: {e}")),
    };
    let mut bytes = Vec::new();
    let read = file.take(longest as u64 + 1).read_to_end(&mut bytes);
    read.map_err(|e| format!("it cannot be read: {e}"))?;
    Ok(Some(bytes))
}
