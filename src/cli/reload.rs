//! SIGHUP: reads the configuration file and the token files again without stopping the frame loop.

use std::sync::Arc;

use doorcam::config::{Change, Config, Takes};
use doorcam::feed::SourceKind;
use doorcam::history::{History, Kept};
use doorcam::server::Access;
use doorcam::watch::{Calibrator, Hub, ZoneKeeper};
use metrics::{describe_gauge, gauge};
use tokio::sync::watch;

/// Applies the changes that can be applied while doorcam runs.
pub(super) struct Reloader<Again> {
    /// Reads the configuration from the file and the command line again.
    pub(super) again: Again,
    /// The configuration in use.
    pub(super) in_use: watch::Sender<Config>,
    /// The kind of source that is watched.
    pub(super) kind: SourceKind,
    pub(super) access: Arc<Access>,
    pub(super) calibrator: Arc<Calibrator>,
    pub(super) zones: Arc<ZoneKeeper>,
    pub(super) history: History,
    pub(super) hub: Arc<Hub>,
}

impl<Again: Fn() -> anyhow::Result<Config>> Reloader<Again> {
    /// Reads everything again, applies what can be applied and logs what happened to the rest. A file that cannot be
    /// read changes nothing.
    pub(super) fn reload(&self) {
        let well = match (self.again)() {
            Ok(next) => self.take_over(&next),
            Err(e) => {
                tracing::error!("{e:#}: the configuration in use stays");
                false
            }
        };
        describe_gauge!(
            "doorcam_config_last_reload_successful",
            "1 if the last reload succeeded, 0 if a part of it failed"
        );
        gauge!("doorcam_config_last_reload_successful").set(if well { 1.0 } else { 0.0 });
    }

    fn take_over(&self, next: &Config) -> bool {
        let mut used = self.in_use.borrow().clone();
        let changes = used.changes(next);
        let keys = |takes: Takes| {
            let keys = changes.iter().filter(|change| change.takes == takes).map(|Change { key, .. }| key.as_str());
            keys.collect::<Vec<_>>().join(", ")
        };
        let mut well = true;
        // Tokens are in files of their own, so a changed token does not show in the configuration.
        match self.access.reload(&used.access, |name| std::env::var_os(name)) {
            Ok(true) => tracing::info!("reloaded: other tokens are in use; what those replaced had let in has ended"),
            Ok(false) => {}
            Err(e) => {
                tracing::error!("{e}: the tokens in use stay");
                well = false;
            }
        }
        let [now, learning, restart] = [Takes::Nothing, Takes::Learning, Takes::Restart].map(keys);
        if !now.is_empty() {
            used.adopt(next, Takes::Nothing);
            self.zones.reconfigure(&used.zones);
            self.history.limit(Kept::of(&used, self.kind).limits);
            tracing::info!("reloaded, in use now: {now}");
        }
        if !learning.is_empty() {
            // Leave out changes that need a restart: the camera's keys also affect the model.
            let mut learned = used.clone();
            learned.adopt(next, Takes::Learning);
            match self.calibrator.reconfigure(&learned) {
                Ok(()) => {
                    used = learned;
                    self.hub.keep_paths(used.tracker.history_s);
                    tracing::info!("reloaded, in use now, and the empty room is learned anew: {learning}");
                }
                Err(e) => {
                    tracing::error!("not reloaded: {learning}: {e}");
                    well = false;
                }
            }
        }
        if !restart.is_empty() {
            tracing::warn!("not reloaded, in use after a restart: {restart}");
        }
        if changes.is_empty() {
            tracing::info!("reloaded: the configuration is the same");
        }
        self.in_use.send_replace(used);
        well
    }
}
