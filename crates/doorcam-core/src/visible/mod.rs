//! The camera's own side: who walks there, and who goes through the doorway.
//!
//! The camera sees more than the two patches. A small picture of all it sees ([`Thumbnail`]) is compared with the still
//! scene ([`StillScene`]): what has another colour, or is far darker or brighter than a shadow or a lamp could make it,
//! covers the floor. Bodies of the usual size at every place near the threshold are projected into the picture
//! ([`Silhouettes`]) with the camera's [`Pose`], and those that explain best what is covered are followed
//! ([`Walkers`]): whose axis passes y = 0 has gone through the doorway ([`Crossing`]).

mod pose;
mod silhouette;
mod still_scene;
mod thumbnail;
mod walkers;

pub use pose::Pose;
pub use silhouette::{Cells, Sighting, Silhouettes};
pub use still_scene::StillScene;
pub use thumbnail::{Grid, Thumbnail};
pub use walkers::{Crossing, Walker, Walkers};
