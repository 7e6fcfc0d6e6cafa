//! doorcam sees who moves in the room behind a doorway, from the light that falls on the floor in front of it.
//!
//! It implements "Double Your Corners, Double Your Fun: The Doorway Camera" (Krska et al., ICCP 2022); equations are cited
//! by their numbers there. The way of a frame reads off the modules:
//! [`geometry`], [`transport`], [`scene`]; [`render`] draws what came out.

pub mod geometry;
pub mod measurement;
pub mod render;
pub mod scene;
pub mod solver;
pub mod source;
pub mod transport;
