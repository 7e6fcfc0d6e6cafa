//! The background that frames are compared with: when it is learned, followed, extended by what stands still, and
//! learned anew.

mod absorb;
mod job;
mod keeper;
mod light;
mod spaced;
mod store;

pub(crate) use job::Job;
pub use job::Work;
pub(crate) use keeper::{FrameLight, Keeper, KeeperError};
pub(crate) use spaced::Spaced;
pub(crate) use store::BackgroundStore;
