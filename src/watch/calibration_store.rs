//! A calibration's file: replaced whole or not at all, with the one before kept beside it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use doorcam_core::calibration::Calibration;
use doorcam_source::files::replace;

/// A file that cannot be read or written: one line that names it.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
pub struct StoreError {
    path: String,
    reason: String,
}

/// Where a calibration is kept.
#[derive(Debug, Clone)]
pub struct CalibrationStore {
    file: PathBuf,
}

impl CalibrationStore {
    /// In `file`; its directory is made when something is kept.
    pub fn new(file: PathBuf) -> Self {
        Self { file }
    }

    /// The file.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// What is kept; none if nothing was.
    pub fn load(&self) -> Result<Option<Calibration>, StoreError> {
        read(&self.file)
    }

    /// Whether there is one before the one kept.
    pub fn has_previous(&self) -> bool {
        self.before().exists()
    }

    /// The one before the one kept.
    pub fn previous(&self) -> Result<Option<Calibration>, StoreError> {
        read(&self.before())
    }

    /// Keeps a calibration, and the one that was kept as the previous one. After a crash at any moment there is either the old
    /// or the new one.
    pub fn save(&self, calibration: &Calibration) -> Result<(), StoreError> {
        let failed = |path: &Path, e: &io::Error| StoreError {
            path: path.display().to_string(),
            reason: format!("cannot be written: {e}"),
        };
        let kept = match fs::read(&self.file) {
            Ok(bytes) => Some(bytes),
            Err(e) if e.kind() == io::ErrorKind::NotFound => None,
            Err(e) => return Err(failed(&self.file, &e)),
        };
        let mut text = serde_json::to_vec_pretty(calibration).map_err(|e| failed(&self.file, &io::Error::other(e)))?;
        text.push(b'\n');
        if let Some(kept) = kept.filter(|kept| *kept != text) {
            replace(&self.before(), &kept).map_err(|e| failed(&self.before(), &e))?;
        }
        replace(&self.file, &text).map_err(|e| failed(&self.file, &e))
    }

    fn before(&self) -> PathBuf {
        let mut name = self.file.file_stem().unwrap_or_default().to_owned();
        name.push(".previous.json");
        self.file.with_file_name(name)
    }
}

fn read(file: &Path) -> Result<Option<Calibration>, StoreError> {
    let failed = |reason: String| StoreError { path: file.display().to_string(), reason };
    let text = match fs::read_to_string(file) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(failed(format!("cannot be read: {e}"))),
    };
    serde_json::from_str(&text).map(Some).map_err(|e| failed(format!("is no calibration: {e}")))
}
