//! From a camera frame to the difference measurement of eq. 4.

mod patch;

pub use patch::{Patch, PatchPair};
