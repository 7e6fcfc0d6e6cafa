//! The path of a frame, in rooms whose truth is known.

mod live_room;
#[path = "../../../../tests/reference/mod.rs"]
mod reference;

mod averaging;
mod background;
mod background_saved;
mod light_change;
mod model;
mod moved;
mod never_blind;
mod rendered_floor;
