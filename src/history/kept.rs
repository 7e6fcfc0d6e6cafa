//! What is kept, and where.

use std::path::PathBuf;

use jiff::SignedDuration;

use super::Retention;
use crate::config::{Config, HistoryConfig};
use crate::feed::SourceKind;

/// What to keep, and where.
#[derive(Debug, Clone)]
pub struct Kept {
    /// The file, or why there is none.
    pub file: Result<PathBuf, String>,
    /// How much to keep.
    pub limits: Retention,
}

impl Kept {
    /// As configured. Without `history.file`, only a camera's history is in a file: people in a recording come again in
    /// every run.
    pub fn of(config: &Config, source: SourceKind) -> Self {
        let HistoryConfig { enabled, file, keep_days, max_bytes } = &config.history;
        let file = match config.storage.directory() {
            _ if !enabled => Err("history.enabled is false"),
            _ if !file.as_os_str().is_empty() => Ok(file.clone()),
            _ if source != SourceKind::V4l2 => {
                Err("for recordings and simulations, the history is kept only in a file that history.file names")
            }
            Some(directory) => Ok(directory.join("history.sqlite")),
            None => Err("there is nowhere to keep it: no history.file, no storage.directory, no $HOME"),
        };
        let age = SignedDuration::try_from_secs_f64(86_400.0 * keep_days).unwrap_or(SignedDuration::MAX);
        Self { file: file.map_err(String::from), limits: Retention { age, bytes: *max_bytes } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_is_the_configured_one_or_a_cameras_in_the_storage_directory() {
        let kept = |text: &str, source| Kept::of(&Config::parse(text).unwrap(), source).file;
        let storage = "[storage]\ndirectory = \"/srv/door\"\n";
        assert_eq!(kept(storage, SourceKind::V4l2), Ok("/srv/door/history.sqlite".into()));
        assert!(kept(storage, SourceKind::Replay).is_err());
        assert_eq!(kept("[history]\nfile = \"x.sqlite\"\n", SourceKind::Replay), Ok("x.sqlite".into()));
        assert!(kept("[history]\nenabled = false\nfile = \"x.sqlite\"\n", SourceKind::V4l2).is_err());
    }
}
