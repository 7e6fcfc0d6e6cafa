//! What the service manager is told, where one asks: systemd, with Type=notify and WatchdogSec.

use std::sync::Arc;
use std::time::Duration;

use doorcam::watch::Hub;
use sd_notify::NotifyState;

/// Says that the page and the API are there.
pub(super) fn ready(status: &str) {
    say(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Says that it is over soon.
pub(super) fn stopping() {
    say(&[NotifyState::Stopping]);
}

/// Feeds the watchdog for as long as frames advance; at once without one. A hung driver, a thread that never comes back or a
/// camera that stays away is then the service manager's: it starts doorcam anew.
pub(super) async fn feed_watchdog(hub: Arc<Hub>) {
    let Some(limit) = sd_notify::watchdog_enabled() else { return };
    let mut last = None;
    let mut look = tokio::time::interval((limit / 4).max(Duration::from_millis(1)));
    loop {
        look.tick().await;
        let status = hub.status(0);
        // What has no calibration yet has frames, but no updates.
        let now = if status.calibrated { status.frames.solved } else { status.frames.captured };
        if last != Some(now) {
            last = Some(now);
            say(&[NotifyState::Watchdog]);
        }
    }
}

fn say(states: &[NotifyState]) {
    if let Err(e) = sd_notify::notify(states) {
        tracing::warn!("the service manager cannot be told how we are: {e}");
    }
}
