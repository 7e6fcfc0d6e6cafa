//! doorcam sees who moves in the room behind a doorway, from the light that falls on the floor in front of it.
//!
//! It implements "Double Your Corners, Double Your Fun: The Doorway Camera" (Krska et al., ICCP 2022); equations are cited
//! by their numbers there. The way of a frame reads off the modules: [`source`] gives frames, [`measurement`] makes them
//! the difference of eq. 4, [`solver`] inverts eq. 13 with the light transport of [`transport`] over the facets of
//! [`geometry`], [`scene`] forms the views and the unified map. [`pipeline`] runs these stages frame after frame,
//! [`render`] draws the result for print, [`server`] shows it live, [`history`] keeps what happened, and [`publish`]
//! tells other systems. [`analysis`] measures all of it.

// What a user, a file or a device gives must never panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

pub mod analysis;
pub mod config;
mod files;
pub mod geometry;
pub mod history;
pub mod import;
pub mod measurement;
pub mod pipeline;
pub mod publish;
pub mod render;
pub mod scene;
mod schema;
pub mod server;
pub mod simulation;
pub mod solver;
pub mod source;
pub mod tracking;
pub mod transport;
