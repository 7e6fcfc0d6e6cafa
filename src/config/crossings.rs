//! `[crossings]`: people who walk through the doorway.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use doorcam_engine::Settings;

/// `[crossings]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CrossingsConfig {
    /// Whether people who walk through the doorway are told and counted.
    pub enabled: bool,
}

impl Default for CrossingsConfig {
    fn default() -> Self {
        Self { enabled: Settings::default().crossings }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Change, Config, Takes};

    #[test]
    fn crossings_are_told_unless_they_are_turned_off() {
        assert!(Config::default().settings().crossings);
        let off = Config::parse("[crossings]\nenabled = false\n").unwrap();
        assert!(!off.settings().crossings);
        let error = Config::parse("[crossings]\nenabled = 1\n").unwrap_err().to_string();
        assert!(error.starts_with("line 2: invalid type: integer `1`, expected a boolean"), "{error}");
    }

    #[test]
    fn turning_them_on_or_off_takes_a_restart() {
        let off = Config::parse("[crossings]\nenabled = false\n").unwrap();
        let change = Change { key: "crossings.enabled".into(), takes: Takes::Restart };
        assert_eq!(Config::default().changes(&off), [change]);
    }
}
