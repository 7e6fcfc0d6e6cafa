use crate::light::PatchPair;

/// What the pixels of a camera can tell about a change: the still picture, and how exactly a difference from it is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensing {
    /// The empty room's picture, linear light.
    pub still: PatchPair,
    /// Per side and pixel, one over the standard deviation of a difference, in each colour; 0 for pixels that do not count.
    pub weights: [Vec<f64>; 2],
}
