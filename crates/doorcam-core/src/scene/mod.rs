//! What the solution shows of the hidden room: the left and right views and the unified map (paper, section 4.4).

mod blobs;
mod brightness;
mod unified;
mod views;

pub use blobs::{Blob, BlobWorkspace, Neighbourhood};
pub use brightness::Brightness;
pub use unified::unify;
pub use views::{Intensity, Scene, Sign};

/// Red, green and blue, linear light.
pub type Rgb = [f64; 3];
