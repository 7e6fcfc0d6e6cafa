//! The calibration file: replaced atomically, with the previous version kept beside it.

use std::io;
use std::path::{Path, PathBuf};

use doorcam_core::calibration::Calibration;
use doorcam_source::files::{self, FileKind, replace};

/// A calibration file that cannot be read or written. Displays as one line with the path and the reason.
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
    /// A store in `file`. Its directory is created by the first [`save`](Self::save).
    pub fn new(file: PathBuf) -> Self {
        Self { file }
    }

    /// The file.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The stored calibration, or `None` if nothing has been saved.
    ///
    /// # Errors
    /// If the file exists but cannot be read or is not a calibration.
    pub fn load(&self) -> Result<Option<Calibration>, StoreError> {
        read(&self.file)
    }

    /// Whether a previous calibration is stored.
    pub fn has_previous(&self) -> bool {
        self.before().exists()
    }

    /// The previous calibration, or `None` if there is none.
    ///
    /// # Errors
    /// If its file exists but cannot be read or is not a calibration.
    pub fn previous(&self) -> Result<Option<Calibration>, StoreError> {
        read(&self.before())
    }

    /// Saves a calibration and keeps the one it replaces as the previous one. A crash at any moment leaves either the
    /// old or the new one.
    ///
    /// # Errors
    /// If a file cannot be read or written.
    pub fn save(&self, calibration: &Calibration) -> Result<(), StoreError> {
        let failed = |path: &Path, e: &io::Error| StoreError {
            path: path.display().to_string(),
            reason: format!("cannot be written: {e}"),
        };
        let kept = match files::read(&self.file, FileKind::CALIBRATION) {
            Ok(bytes) => Some(bytes),
            Err(e) if e.is_missing() => None,
            Err(e) => return Err(failed(&self.file, &io::Error::other(e))),
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
    let text = match files::read_text(file, FileKind::CALIBRATION) {
        Ok(text) => text,
        Err(e) if e.is_missing() => return Ok(None),
        Err(e) => return Err(failed(format!("cannot be read: {e}"))),
    };
    serde_json::from_str(&text).map(Some).map_err(|e| failed(format!("is not a calibration: {e}")))
}
