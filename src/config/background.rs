//! `[background]` and `[averaging]`: how the background is learned and kept up to date, and how frames are averaged in
//! time.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ConfigError, within};
use doorcam_core::light::Averaging;
use doorcam_engine::{AveragingSettings, BackgroundSettings, Settings};

/// `[background]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BackgroundConfig {
    /// Seconds for which the room must be still before the background is first learned.
    pub learn_s: f64,
    /// Seconds after which learning, at the start or after a change of light, no longer waits for the room to be still.
    pub learn_max_s: f64,
    /// Seconds for which the room must be still before the background is learned again.
    pub relearn_s: f64,
    /// Time constant, in seconds, with which the background follows frames in which nothing is detected.
    pub adapt_s: f64,
    /// Seconds after which something that has not moved becomes part of the background; 0 for never.
    pub absorb_s: f64,
    /// Seconds after which something that lies still on a patch, such as a bag, becomes part of its floor. Until then
    /// the pixels that it covers are left out.
    pub cover_s: f64,
    /// Longest time, in seconds, between two rebuilds of the inverse problem while the background drifts.
    pub rebuild_s: f64,
    /// Sudden change of light, as a share of the light, after which the background is learned again.
    pub light_step: f64,
    /// Seconds between two saves of the background.
    pub save_s: f64,
    /// Age in seconds up to which a saved background is used.
    pub keep_s: f64,
}

impl Default for BackgroundConfig {
    fn default() -> Self {
        let settings = BackgroundSettings::default();
        Self {
            learn_s: settings.learn_s,
            learn_max_s: settings.learn_max_s,
            relearn_s: settings.relearn_s,
            adapt_s: settings.adapt_s,
            absorb_s: settings.absorb_s,
            cover_s: settings.cover_s,
            rebuild_s: settings.rebuild_s,
            light_step: settings.light_step,
            save_s: settings.save_s,
            keep_s: settings.keep_s,
        }
    }
}

impl BackgroundConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        within("background.learn_s", self.learn_s, 0.5, 600.0, "seconds")?;
        within("background.learn_max_s", self.learn_max_s, self.learn_s, 3600.0, "seconds (not below learn_s)")?;
        within("background.relearn_s", self.relearn_s, 0.5, self.learn_max_s, "seconds (not above learn_max_s)")?;
        within("background.adapt_s", self.adapt_s, 1.0, 86_400.0, "seconds")?;
        if self.absorb_s != 0.0 {
            within("background.absorb_s", self.absorb_s, 10.0, 1e7, "seconds, or 0 for never")?;
        }
        within("background.cover_s", self.cover_s, 1.0, 3600.0, "seconds")?;
        within("background.rebuild_s", self.rebuild_s, 1.0, 86_400.0, "seconds")?;
        within("background.light_step", self.light_step, 0.005, 1.0, "(a share of the light)")?;
        within("background.save_s", self.save_s, 10.0, 86_400.0, "seconds")?;
        within("background.keep_s", self.keep_s, 0.0, 1e7, "seconds")
    }
}

/// `[averaging]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AveragingConfig {
    /// The kind of average.
    pub mode: Averaging,
    /// Time constant of the exponential, or length of the boxcar, in seconds.
    pub time_s: f64,
}

impl Default for AveragingConfig {
    fn default() -> Self {
        let AveragingSettings { mode, time_s } = Settings::default().averaging;
        Self { mode, time_s }
    }
}

impl AveragingConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        within("averaging.time_s", self.time_s, 0.02, 10.0, "seconds")
    }
}

#[cfg(test)]
mod tests {
    use super::super::Config;

    #[test]
    fn values_out_of_range_name_their_key() {
        let error = |text: &str| Config::parse(text).expect_err("refused").to_string();
        let learn = error("[background]\nlearn_s = 40\n");
        assert_eq!(learn, "background.learn_max_s is 30, expected 40 to 3600 seconds (not below learn_s)");
        assert!(error("[background]\nabsorb_s = 1\n").ends_with("expected 10 to 10000000 seconds, or 0 for never"));
        assert!(Config::parse("[background]\nabsorb_s = 0\n").is_ok());
        assert_eq!(error("[background]\ncover_s = 0\n"), "background.cover_s is 0, expected 1 to 3600 seconds");
        assert!(error("[background]\nadapt_s = nan\n").starts_with("background.adapt_s is NaN"));
        assert!(error("[averaging]\ntime_s = 0\n").starts_with("averaging.time_s is 0, expected 0.02"));
        assert!(error("[averaging]\nmode = \"mean\"\n").contains("expected one of `none`, `exponential`, `boxcar`"));
    }
}
