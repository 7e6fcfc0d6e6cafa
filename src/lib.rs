//! doorcam sees who moves in the room behind a doorway, from the light that falls on the floor in front of it.
//!
//! This is the daemon around the engine: [`watch`] runs the frame loop and hands its updates to everyone who asks, [`feed`] opens its
//! source, [`server`] shows them, [`history`] keeps what happened, [`publish`] tells other systems, [`config`] reads the file that steers it all.
//! The optics, the inverse problem and the tracking are in `doorcam-core`, the sources of frames in `doorcam-source`, the way
//! of a frame from images to an update in `doorcam-engine`; each works without this crate.

// What a user, a file or a device gives must never panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

pub mod config;
pub mod feed;
pub mod history;
pub mod publish;
pub mod server;
pub mod watch;
