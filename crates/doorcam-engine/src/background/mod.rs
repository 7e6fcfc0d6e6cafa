//! Which background frames are compared with, and when it is learned, followed, absorbed into and learned anew.

mod absorb;
mod job;
mod keeper;
mod light;
mod spaced;
mod store;

pub(crate) use job::Job;
pub use job::Work;
pub(crate) use keeper::{Keeper, KeeperError, Seen};
pub(crate) use spaced::Spaced;
pub(crate) use store::BackgroundStore;
