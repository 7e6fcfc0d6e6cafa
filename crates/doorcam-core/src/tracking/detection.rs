use super::Covariance;
use crate::geometry::Point;
use crate::scene::Rgb;

/// Somebody seen in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// The body's axis, in metres in the door frame.
    pub position: Point,
    /// Covariance of the position, in m².
    pub covariance: Covariance,
    /// Radiance against what is behind, relative to full scale: negative where the body is darker.
    pub rgb: Rgb,
    /// By how much the measurement is explained better with this person than without, in units of noise variance: twice
    /// the log of the likelihood ratio.
    pub significance: f64,
}
