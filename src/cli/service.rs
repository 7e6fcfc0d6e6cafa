//! Notifications to the service manager, if there is one: systemd, with Type=notify and WatchdogSec.

use std::sync::Arc;
use std::time::Duration;

use doorcam::watch::Hub;
use sd_notify::NotifyState;

/// Tells the service manager that the page and the API are up.
pub(super) fn ready(status: &str) {
    say(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Tells the service manager that doorcam is stopping.
pub(super) fn stopping() {
    say(&[NotifyState::Stopping]);
}

/// Feeds the watchdog as long as frames advance; returns at once if there is no watchdog. After a hung driver, a stuck
/// thread or a camera that stays away, the service manager restarts doorcam.
pub(super) async fn feed_watchdog(hub: Arc<Hub>) {
    let Some(limit) = sd_notify::watchdog_enabled() else { return };
    let mut last = None;
    let mut look = tokio::time::interval((limit / 4).max(Duration::from_millis(1)));
    loop {
        look.tick().await;
        let status = hub.status(0);
        // Without a calibration there are frames, but no updates.
        let now = if status.calibrated { status.frames.solved } else { status.frames.captured };
        if last != Some(now) {
            last = Some(now);
            say(&[NotifyState::Watchdog]);
        }
    }
}

fn say(states: &[NotifyState]) {
    if let Err(e) = sd_notify::notify(states) {
        tracing::warn!("cannot notify the service manager: {e}");
    }
}
