//! The background that frames are compared with: when it is learned, followed, extended by what stands still, and
//! learned anew.

mod absorb;
mod cover;
mod frame;
mod job;
mod keeper;
#[cfg(test)]
#[cfg(feature = "simulation")]
mod keeper_tests;
mod learning;
mod light;
mod spaced;
mod store;

pub(crate) use frame::FrameLight;
pub(crate) use job::Job;
pub use job::Work;
pub(crate) use keeper::{Keeper, KeeperError};
pub(crate) use spaced::Spaced;
pub(crate) use store::BackgroundStore;
