//! `[access]`: who may see, and who may change.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::ConfigError;

/// `[access]`. Tokens themselves never stand in a configuration, so that it can be shown to anybody.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AccessConfig {
    /// File with the token that lets its holder see and change everything; empty: none.
    pub token_file: PathBuf,
    /// File with the token that lets its holder see everything; empty: none.
    pub read_token_file: PathBuf,
    /// Whether to listen on an address that others can reach without any token.
    pub allow_unauthenticated: bool,
}

impl AccessConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        let files = (&self.token_file, &self.read_token_file);
        if files.0 == files.1 && !files.0.as_os_str().is_empty() {
            return Err(ConfigError(format!(
                "access.read_token_file is \"{}\" as access.token_file is, expected another file",
                files.0.display()
            )));
        }
        Ok(())
    }
}
