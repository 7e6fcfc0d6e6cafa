//! `[history]`: how events and occupancy are recorded.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ConfigError, within};

/// `[history]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct HistoryConfig {
    /// Whether a history file is written.
    pub enabled: bool,
    /// The file; empty for the default.
    #[schema(value_type = String)]
    pub file: PathBuf,
    /// Days after which history is deleted.
    pub keep_days: f64,
    /// Most bytes on disk.
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

#[cfg(test)]
mod tests {
    use super::super::Config;

    #[test]
    fn values_out_of_range_name_their_key() {
        let error = |text: &str| Config::parse(text).expect_err("refused").to_string();
        let few = error("[history]\nmax_bytes = 1000\n");
        assert_eq!(few, "history.max_bytes is 1000, expected 2000000 to 1000000000000 bytes");
        assert!(error("[history]\nkeep_days = 0\n").starts_with("history.keep_days is 0, expected 0.01 to 36500 days"));
        assert!(error("[history]\nkeep_days = nan\n").starts_with("history.keep_days is NaN"));
    }
}
