//! `[history]`: what is kept of events and occupancy.

use std::path::PathBuf;

use jiff::SignedDuration;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Config, ConfigError, within};
use crate::history::{Kept, Limits};

/// `[history]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct HistoryConfig {
    /// Whether there is a file at all.
    pub enabled: bool,
    /// The file; empty for the usual place.
    #[schema(value_type = String)]
    pub file: PathBuf,
    /// Days after which what happened is forgotten.
    pub keep_days: f64,
    /// Bytes on disk at most.
    pub max_bytes: u64,
}

impl Default for HistoryConfig {
    fn default() -> Self {
        Self { enabled: true, file: PathBuf::new(), keep_days: 30.0, max_bytes: 100_000_000 }
    }
}

impl HistoryConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        within("history.keep_days", self.keep_days, 0.01, 36_500.0, "days")?;
        within("history.max_bytes", self.max_bytes as f64, 2e6, 1e12, "bytes")
    }
}

impl Config {
    /// What is kept, and where. Of what is no camera, only where a file is named: a recording's people come again and again.
    pub fn kept_history(&self, camera: bool) -> Kept {
        let HistoryConfig { enabled, file, keep_days, max_bytes } = &self.history;
        let file = match self.storage.directory() {
            _ if !enabled => Err("history.enabled is false"),
            _ if !file.as_os_str().is_empty() => Ok(file.clone()),
            _ if !camera => {
                Err("of recordings and simulations, a history is kept only in a file that history.file names")
            }
            Some(directory) => Ok(directory.join("history.sqlite")),
            None => Err("there is no place for it: no history.file, no storage.directory, no $HOME"),
        };
        let age = SignedDuration::try_from_secs_f64(86_400.0 * keep_days).unwrap_or(SignedDuration::MAX);
        Kept { file: file.map_err(String::from), limits: Limits { age, bytes: *max_bytes } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_is_the_configured_one_or_a_cameras_in_the_storage_directory() {
        let kept = |text: &str, camera| Config::parse(text).unwrap().kept_history(camera).file;
        let storage = "[storage]\ndirectory = \"/srv/door\"\n";
        assert_eq!(kept(storage, true), Ok("/srv/door/history.sqlite".into()));
        assert!(kept(storage, false).is_err());
        assert_eq!(kept("[history]\nfile = \"x.sqlite\"\n", false), Ok("x.sqlite".into()));
        assert!(kept("[history]\nenabled = false\nfile = \"x.sqlite\"\n", true).is_err());
    }

    #[test]
    fn values_out_of_range_name_their_key() {
        let error = |text: &str| Config::parse(text).expect_err("refused").to_string();
        let few = error("[history]\nmax_bytes = 1000\n");
        assert_eq!(few, "history.max_bytes is 1000, expected 2000000 to 1000000000000 bytes");
        assert!(error("[history]\nkeep_days = 0\n").starts_with("history.keep_days is 0, expected 0.01 to 36500 days"));
        assert!(error("[history]\nkeep_days = nan\n").starts_with("history.keep_days is NaN"));
    }
}
