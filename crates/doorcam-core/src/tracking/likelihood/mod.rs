//! Finds people in a difference measurement, at continuous positions between the facets of the grid, with their errors.
//!
//! A person is a vertical cylinder that is brighter or darker than what is behind it, by one radiance per edge. The
//! difference also contains nuisance from exposure, lamps and drift (of any strength), smooth changes of the walls'
//! light from people's shadows and reflections (of roughly known strength), and noise. All unknowns except the people's
//! places and radii are linear with Gaussian priors, and are integrated out. In a room with a window or a lamp that the
//! floor sees, a person also takes away the light that is behind them, with a strength that is roughly known.

mod body_table;
#[cfg(test)]
mod bright_room_tests;
mod columns;
mod hidden_light;
mod linear;
mod measured;
mod model_error;
mod place;
mod refine;
mod search;
#[cfg(test)]
mod tests;
mod whitened;

pub use body_table::BodyTable;
pub use measured::{Likelihood, LikelihoodSpec, Measured};
pub use search::Finder;

/// Most people found at once.
pub const MOST_PEOPLE: usize = 6;
