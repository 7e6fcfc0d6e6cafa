use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};

use crate::files::{self, FileKind};

/// The values that a camera's automatics had found when they were switched off, by control name. They are set again
/// after a replug and, if there is a file for them, after a restart, so that the background stays valid.
#[derive(Debug, Default)]
pub struct Locked {
    file: Option<PathBuf>,
    kept: Mutex<Kept>,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Kept {
    card: String,
    controls: BTreeMap<String, i64>,
}

impl Locked {
    /// Values are kept in `file`, if given, and read from it if it exists.
    pub fn new(file: Option<PathBuf>) -> Self {
        let kept = file.as_deref().and_then(|file| {
            let unread = |e: &dyn std::fmt::Display| {
                tracing::warn!("{}: locked controls cannot be read and will be found anew: {e}", file.display());
            };
            match files::read_text(file, FileKind::CONTROLS) {
                Ok(text) => serde_json::from_str(&text).inspect_err(|e| unread(e)).ok(),
                Err(e) if e.is_missing() => None,
                Err(e) => {
                    unread(&e);
                    None
                }
            }
        });
        Self { file, kept: Mutex::new(kept.unwrap_or_default()) }
    }

    /// Lets `work` read and change the values of the camera called `card`. Another camera's values are discarded.
    pub fn with<T>(&self, card: &str, work: impl FnOnce(&mut BTreeMap<String, i64>) -> T) -> T {
        let mut kept = self.lock();
        let before = kept.clone();
        if kept.card != card {
            *kept = Kept { card: card.to_owned(), controls: BTreeMap::new() };
        }
        let result = work(&mut kept.controls);
        if let Some(file) = self.file.as_deref().filter(|_| *kept != before && !kept.controls.is_empty())
            && let Err(e) = write(file, &kept)
        {
            tracing::warn!("{}: locked controls cannot be saved: {e}", file.display());
        }
        result
    }

    /// The values as text, to tell whether they have changed.
    pub fn words(&self) -> String {
        format!("{:?}", *self.lock())
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn write(file: &Path, kept: &Kept) -> std::io::Result<()> {
    crate::files::replace(file, &serde_json::to_vec_pretty(kept)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_outlive_a_run_but_not_a_change_of_camera() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("deep/controls.json");
        let locked = Locked::new(Some(file.clone()));
        locked.with("Cam", |values| values.insert("exposure".into(), 312));
        let again = Locked::new(Some(file.clone()));
        assert_eq!(again.with("Cam", |values| values.get("exposure").copied()), Some(312));
        assert_eq!(again.with("Other", |values| values.len()), 0);
        std::fs::write(&file, "{").unwrap();
        assert_eq!(Locked::new(Some(file)).with("Cam", |values| values.len()), 0);
    }
}
