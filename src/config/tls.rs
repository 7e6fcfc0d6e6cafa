//! `[tls]`: HTTPS without a proxy in front.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ConfigError;

/// `[tls]`
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TlsConfig {
    /// PEM file with the certificate and its chain; empty: no TLS.
    #[schema(value_type = String)]
    pub certificate_file: PathBuf,
    /// PEM file with the certificate's private key.
    #[schema(value_type = String)]
    pub key_file: PathBuf,
}

impl TlsConfig {
    /// Whether TLS is configured.
    pub fn is_on(&self) -> bool {
        !self.certificate_file.as_os_str().is_empty()
    }

    pub(super) fn check(&self) -> Result<(), ConfigError> {
        let missing = match (self.is_on(), self.key_file.as_os_str().is_empty()) {
            (true, true) => "tls.key_file is empty, expected the key of tls.certificate_file",
            (false, false) => "tls.certificate_file is empty, expected the certificate of tls.key_file",
            _ => return Ok(()),
        };
        Err(ConfigError(missing.into()))
    }
}
