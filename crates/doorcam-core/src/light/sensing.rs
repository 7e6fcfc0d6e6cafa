use crate::light::PatchPair;

/// Measurement precision of a camera's pixels: the empty room's picture, and how precisely a difference from it is
/// measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensing {
    /// The empty room's picture, linear light.
    pub still: PatchPair,
    /// Per side and pixel, the inverse standard deviation of a difference in any one colour; 0 for pixels that do not
    /// count.
    pub weights: [Vec<f64>; 2],
}
