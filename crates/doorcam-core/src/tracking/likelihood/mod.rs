//! Whom a difference measurement shows, anywhere in the room: positions between the facets of the grid, with their errors.
//!
//! A person is a vertical cylinder that is brighter or darker than what is behind it by one radiance at each edge. Besides
//! people, the difference has what exposure, lamps and drift do (of any strength), smooth changes of the walls' light that
//! a person's shadows and reflections make (of a strength known in advance, roughly), and noise. All of these but the
//! people's places are linear with Gaussian priors, and are integrated out.

mod body_table;
mod columns;
mod measured;
mod place;
mod refine;
mod search;
#[cfg(test)]
mod tests;
mod whitened;

pub use body_table::BodyTable;
pub use measured::{Likelihood, LikelihoodSpec, Measured};
pub use search::Finder;

/// People that are looked for at once at most.
pub const MOST_PEOPLE: usize = 6;
