//! `[access]`: who may read, and who may change things.

use std::net::IpAddr;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ConfigError, within};

/// `[access]`. It names token files and never contains a token, so a configuration can be shown to anybody.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AccessConfig {
    /// File with the token that lets its holder read and change everything; empty: none.
    #[schema(value_type = String)]
    pub token_file: PathBuf,
    /// File with the token that lets its holder read everything; empty: none.
    #[schema(value_type = String)]
    pub read_token_file: PathBuf,
    /// Whether to listen without a token on an address that other machines can reach.
    pub allow_unauthenticated: bool,
    /// How long a login on the page lasts, in seconds.
    pub session_s: f64,
    /// Whether pictures of the visible side are shown.
    pub images: bool,
    /// Host names accepted in requests, in addition to doorcam's addresses and the names of loopback.
    pub allowed_hosts: Vec<String>,
    /// Origins whose pages may use the API (CORS).
    pub allowed_origins: Vec<String>,
    /// Addresses of proxies whose X-Forwarded-For is believed.
    #[schema(value_type = Vec<String>)]
    pub trusted_proxies: Vec<IpAddr>,
}

impl Default for AccessConfig {
    fn default() -> Self {
        Self {
            token_file: PathBuf::new(),
            read_token_file: PathBuf::new(),
            allow_unauthenticated: false,
            session_s: 43_200.0,
            images: true,
            allowed_hosts: Vec::new(),
            allowed_origins: Vec::new(),
            trusted_proxies: Vec::new(),
        }
    }
}

impl AccessConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        let files = (&self.token_file, &self.read_token_file);
        if files.0 == files.1 && !files.0.as_os_str().is_empty() {
            return Err(ConfigError(format!(
                "access.read_token_file is \"{}\", the same as access.token_file, expected another file",
                files.0.display()
            )));
        }
        within("access.session_s", self.session_s, 1.0, 1e8, "seconds")?;
        for host in &self.allowed_hosts {
            let plain = |c: char| c.is_ascii_alphanumeric() || "-._".contains(c);
            if host.parse::<IpAddr>().is_err() && (host.is_empty() || !host.chars().all(plain)) {
                return Err(ConfigError(format!(
                    "access.allowed_hosts has \"{host}\", expected a name or an address without port, such as \
                     \"door.lan\""
                )));
            }
        }
        for origin in &self.allowed_origins {
            let host = origin.strip_prefix("https://").or_else(|| origin.strip_prefix("http://"));
            let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-._:[]".contains(c);
            if !host.is_some_and(|host| !host.is_empty() && host.chars().all(plain)) {
                return Err(ConfigError(format!(
                    "access.allowed_origins has \"{origin}\", expected scheme and host in lower case, such as \
                     \"https://door.lan\" or \"http://door.lan:3000\""
                )));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_and_origins_that_would_never_match_are_refused() {
        let hosts =
            |host: &str| AccessConfig { allowed_hosts: vec![host.into()], ..AccessConfig::default() }.check().is_ok();
        assert!(hosts("door.lan") && hosts("192.168.1.2") && hosts("fe80::1") && hosts("Door"));
        assert!(!hosts("") && !hosts("door.lan:8080") && !hosts("http://door.lan") && !hosts("*"));
        let origins = |origin: &str| {
            AccessConfig { allowed_origins: vec![origin.into()], ..AccessConfig::default() }.check().is_ok()
        };
        assert!(origins("https://door.lan") && origins("http://127.0.0.1:3000") && origins("http://[::1]:3000"));
        for origin in
            ["", "*", "null", "door.lan", "https://", "https://door.lan/", "https://Door.lan", "ftp://door.lan"]
        {
            assert!(!origins(origin), "{origin}");
        }
    }
}
