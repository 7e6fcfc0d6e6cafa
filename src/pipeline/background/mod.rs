//! Which background frames are compared with, and when it is learned, followed, absorbed into and learned anew.

mod absorb;
mod job;
mod keeper;
mod light;
mod spaced;
mod store;

pub(super) use job::Job;
pub use job::Work;
pub(super) use keeper::{Keeper, KeeperError, Seen};
pub(super) use spaced::Spaced;
pub use store::BackgroundStore;
