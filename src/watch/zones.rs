//! The zones in use: replaced and saved while frames keep coming.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::config::{ConfigError, check_zones};
use crate::watch::{Command, Control, Hub, ZoneIds};
use doorcam_core::tracking::Zone;
use doorcam_source::files::{self, FileKind, replace};

/// Where the zones in use come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum ZoneOrigin {
    /// The configuration file.
    Config,
    /// Drawn by a user and saved for later runs.
    Saved,
    /// Drawn by a user for this run only, because no storage is configured.
    Run,
}

/// Why zones were not put into use.
#[derive(Debug, thiserror::Error)]
pub enum ZonesRefused {
    /// They are not valid.
    #[error(transparent)]
    Unfit(#[from] ConfigError),
    /// Those in use are not the ones that the client knows.
    #[error("the zones in use are not those that If-Match names: read them again")]
    Stale,
    /// Their file cannot be read or written.
    #[error("{}: {reason}", .file.display())]
    Store {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

/// Replaces the zones in use and saves them.
pub struct ZoneKeeper {
    file: Option<PathBuf>,
    hub: Arc<Hub>,
    control: Control,
    /// Held while files are written, so that the last change is the one that is kept.
    changing: Mutex<ZoneIds>,
    /// Held only for moments, because requests read it on threads that must not wait for a disk.
    state: Mutex<State>,
}

struct State {
    configured: Vec<Zone>,
    origin: ZoneOrigin,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    zones: Vec<Zone>,
}

impl ZoneKeeper {
    /// For the run that `control` commands. `configured` are the configuration's zones, with the `ids` that they and
    /// others were given; `origin` says where those in use come from.
    pub fn new(
        (configured, ids): (Vec<Zone>, ZoneIds),
        file: Option<PathBuf>,
        origin: ZoneOrigin,
        hub: Arc<Hub>,
        control: Control,
    ) -> Self {
        Self { file, hub, control, changing: Mutex::new(ids), state: Mutex::new(State { configured, origin }) }
    }

    /// The zones saved in a file, or `None` if it does not exist.
    ///
    /// # Errors
    /// If the file cannot be read or holds no valid zones.
    pub fn load(file: &Path) -> Result<Option<Vec<Zone>>, ZonesRefused> {
        let failed = |reason: String| ZonesRefused::Store { file: file.to_owned(), reason };
        let text = match files::read_text(file, FileKind::ZONES) {
            Ok(text) => text,
            Err(e) if e.is_missing() => return Ok(None),
            Err(e) => return Err(failed(format!("cannot be read: {e}"))),
        };
        let Kept { zones } = serde_json::from_str(&text).map_err(|e| failed(format!("has no zones: {e}")))?;
        check_zones(&zones).map_err(|e| failed(e.to_string()))?;
        Ok(Some(zones))
    }

    /// Where the zones in use come from.
    pub fn origin(&self) -> ZoneOrigin {
        self.state().origin
    }

    /// Takes over the zones of a reloaded configuration. Drawn zones stay in use.
    pub fn reconfigure(&self, zones: &[Zone]) {
        let mut ids = lock(&self.changing);
        let zones = ids.identified(zones);
        if let Err(e) = ids.save() {
            tracing::warn!("{e}: ids of zones are kept for this run only");
        }
        let mut state = self.state();
        state.configured.clone_from(&zones);
        if state.origin == ZoneOrigin::Config {
            self.go_on_with(zones);
        }
    }

    /// Uses other zones from the next frame on and saves them if storage is configured. A zone without an id keeps that
    /// of the zone of its name, or gets one of its own.
    ///
    /// Nothing changes unless `only_if` holds for the revision of the zones in use ([`Hub::zones_revision`]).
    ///
    /// # Errors
    /// If they are not valid or cannot be saved, or `only_if` does not hold.
    pub fn replace(&self, zones: Vec<Zone>, only_if: &dyn Fn(u32) -> bool) -> Result<(), ZonesRefused> {
        check_zones(&zones)?;
        let mut changing = lock(&self.changing);
        self.must(only_if)?;
        let mut ids = changing.clone();
        let zones = ids.drawn(zones, &self.hub.zones())?;
        // Before the zones: an id that is in use must never be forgotten.
        ids.save()?;
        *changing = ids;
        let next = match &self.file {
            Some(file) => {
                let mut text = serde_json::to_vec_pretty(&Kept { zones: zones.clone() }).unwrap_or_default();
                text.push(b'\n');
                replace(file, &text).map_err(|e| self.failed(&format!("cannot be written: {e}")))?;
                ZoneOrigin::Saved
            }
            None => ZoneOrigin::Run,
        };
        self.go_on_with(zones);
        self.state().origin = next;
        Ok(())
    }

    /// Returns to the configuration's zones and deletes the saved ones.
    ///
    /// # Errors
    /// If the file cannot be removed, or `only_if` does not hold, as for [`Self::replace`].
    pub fn forget(&self, only_if: &dyn Fn(u32) -> bool) -> Result<(), ZonesRefused> {
        let _changing = lock(&self.changing);
        self.must(only_if)?;
        if let Some(file) = &self.file {
            match std::fs::remove_file(file) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    return Err(self.failed(&format!("cannot be removed: {e}")));
                }
                _ => {}
            }
        }
        let mut state = self.state();
        self.go_on_with(state.configured.clone());
        state.origin = ZoneOrigin::Config;
        Ok(())
    }

    fn must(&self, only_if: &dyn Fn(u32) -> bool) -> Result<(), ZonesRefused> {
        if only_if(self.hub.zones_revision()) { Ok(()) } else { Err(ZonesRefused::Stale) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    /// Readers see the new zones at once, tracks with the next frame. Without further frames nobody is in a zone
    /// anyway.
    fn go_on_with(&self, zones: Vec<Zone>) {
        self.hub.use_zones(zones.clone());
        self.control.tell(Command::UseZones(zones));
    }

    fn failed(&self, reason: &str) -> ZonesRefused {
        ZonesRefused::Store { file: self.file.clone().unwrap_or_default(), reason: reason.into() }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
