//! Cameras through Linux's V4L2.
//!
//! The v4l crate panics on unexpected answers of a driver: cameras run under
//! [`Supervisor`](super::camera::Supervisor), which turns a panic into a fault of the camera.

mod find;
mod inventory;
mod session;

use std::sync::Arc;

pub use find::Identity;
pub use inventory::{CameraReport, ControlReport, FormatReport, SizeReport, cameras};
pub use session::V4l2Session;

use super::camera::{CameraOptions, Fault, Locked, Opener};

/// A camera by its node, its stable name or its card's name.
pub struct V4l2Camera {
    name: String,
    options: CameraOptions,
    /// Identity of the camera that was opened first, to find it again under another number.
    identity: Option<Identity>,
    locked: Arc<Locked>,
}

impl V4l2Camera {
    /// `name` is a path (`/dev/video0`, `/dev/v4l/by-id/...`), a name below `/dev/v4l/by-id`, or the card's name.
    pub fn new(name: impl Into<String>, options: CameraOptions, locked: Arc<Locked>) -> Self {
        Self { name: name.into(), options, identity: None, locked }
    }
}

impl Opener for V4l2Camera {
    type Session = V4l2Session;

    fn open(&mut self) -> Result<V4l2Session, Fault> {
        let node = find::node(&self.name, self.identity.as_ref())?;
        let identity = Identity::of(&node);
        let session = V4l2Session::open(&node, &self.options, &self.locked)?;
        if let (None, Some(identity)) = (&self.identity, identity) {
            self.identity = Some(identity);
        }
        Ok(session)
    }

    fn name(&self) -> &str {
        &self.name
    }
}
