//! doorcam maps who moves in the hidden room behind a doorway, from the light on the floor in front of it.
//!
//! This crate is the program `doorcam` as a library: a daemon that watches one doorway and publishes what it sees.
//! The mathematics is in `doorcam-core`, frames come from `doorcam-source`, and `doorcam-engine` turns a frame's
//! images into an update. Each of them works without this crate.
//!
//! # Modules
//!
//! In the order in which a frame passes through them:
//!
//! | Module | What it does |
//! |---|---|
//! | [`config`] | the configuration file: every key, its default and its range |
//! | [`feed`] | opens a source of frames by its name: a camera, a recording or a simulation |
//! | [`watch`] | the frame loop: capture, solve, and hand each update to everyone ([`watch::Hub`]) |
//! | [`history`] | keeps events and occupancy in an SQLite file |
//! | [`publish`] | notifies other systems: MQTT, Home Assistant, webhooks |
//! | [`server`] | the page, the REST API and the live socket, with access control and TLS |
//! | [`text`] | text from outside, made safe for a line of the log |
//!
//! # Conventions
//!
//! - **Door frame.** The origin is on the floor at the middle of the opening, in the plane of the wall's hidden face.
//!   For someone on the visible side who faces the door, x points to the right, y into the hidden room and z up.
//! - **Units.** API keys end in their unit: `_m` metres, `_m_s` metres per second, `_s` seconds, `_ms` milliseconds,
//!   `_px` pixels, `_deg` degrees.
//! - **Light** is linear, and 1 is the camera's full scale.
//! - **Nothing waits for a client.** Queues are bounded and count what does not fit; a slow reader gets the newest
//!   update.
//!
//! # Features
//!
//! - `v4l2` (on by default): webcams. Needs Linux, and libclang to build. Without it, doorcam can only replay
//!   recordings and simulate.
//!
//! # Example
//!
//! Runs the frame loop without a server until a simulated doorway yields an update:
//!
//! ```
//! use std::sync::Arc;
//!
//! use doorcam::config::Config;
//! use doorcam::feed::{Feed, SourceSpec};
//! use doorcam::watch::{Hub, start};
//! use doorcam_engine::Assembly;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let config = Config::parse("[room]\nhalf_width_m = 1.5\ndepth_m = 3.0\n")?;
//! let spec: SourceSpec = "simulate:one-person".parse()?;
//! let feed = Feed::open(&spec, &config)?;
//! let manifest = feed.manifest().ok_or("a camera has to be calibrated first")?;
//! let engine = Assembly::new(config.settings()).for_recording(manifest)?;
//!
//! let hub = Arc::new(Hub::new(Some(engine.watched()), None, feed.info()).configured(&config));
//! let running = start(feed.start(), Some(engine), Arc::clone(&hub))?;
//! let published = loop {
//!     match hub.latest() {
//!         Some(published) => break published,
//!         None => std::thread::sleep(std::time::Duration::from_millis(10)),
//!     }
//! };
//! println!("{}", published.json);
//! running.end();
//! # Ok(())
//! # }
//! ```

// Input from a user, a file or a device must never cause a panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

pub mod config;
pub mod feed;
pub mod history;
pub mod publish;
pub mod server;
pub mod text;
pub mod watch;
