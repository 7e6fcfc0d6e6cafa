use std::path::PathBuf;

use super::super::Model;
use super::job::{Job, Work};
use crate::measurement::{Fingerprint, LoadError, Snapshot};

/// Where the background is kept from one run to the next.
pub struct BackgroundStore {
    path: PathBuf,
    settings: Box<dyn Fn() -> String + Send>,
    more: String,
    saving: Option<Job<()>>,
}

impl BackgroundStore {
    /// A file, and in any words all that makes a background of this camera worthless when it changes and that the model of
    /// the doorway does not know: the image's size, the calibration, exposure, gain and white balance. It is asked for anew each
    /// time, because some of it is found while frames come.
    pub fn new(path: impl Into<PathBuf>, settings: impl Fn() -> String + Send + 'static) -> Self {
        Self { path: path.into(), settings: Box::new(settings), more: String::new(), saving: None }
    }

    /// Adds to the settings.
    pub(in crate::pipeline) fn add(&mut self, setting: &str) {
        self.more.push_str("; ");
        self.more.push_str(setting);
    }

    /// What was saved, if it is of this doorway, camera and exposure and at most `keep_s` seconds old; says what it does not
    /// use, and why.
    pub(super) fn load(&mut self, model: &Model, keep_s: f64) -> Option<Snapshot> {
        let name = self.path.display();
        match Snapshot::load(&self.path, &self.fingerprint(model), model.patch.size, keep_s) {
            Ok(snapshot) => {
                tracing::info!("{name}: the background of the last run is used");
                Some(snapshot)
            }
            Err(LoadError::Missing) => None,
            Err(e) => {
                tracing::warn!("{name}: the saved background is not used, {e}");
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
            if let Err(e) = snapshot.save(&path, &fingerprint) {
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
        let (settings, more) = ((self.settings)(), &self.more);
        Fingerprint::new(format!("{:?}; {:?}; {runs}; {settings}{more}", model.doorway, model.patch))
    }
}
