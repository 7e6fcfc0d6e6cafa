use super::Covariance;
use crate::geometry::Point;
use crate::scene::Rgb;

/// A person as seen in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Position of the body's axis, in metres in the door frame.
    pub position: Point,
    /// Covariance of the position, in m².
    pub covariance: Covariance,
    /// Radiance relative to what is behind the body, as a share of full scale; negative where the body is darker.
    pub rgb: Rgb,
    /// Twice the log likelihood ratio of the measurement with and without this person, in units of noise variance.
    pub significance: f64,
}
