/// Patterns that may be in a patch at any strength without saying anything about the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Nuisance {
    patterns: [Vec<Vec<f64>>; 2],
}

impl Nuisance {
    /// Per side, patterns over the pixels of a patch, row by row from the wall.
    pub fn new(patterns: [Vec<Vec<f64>>; 2]) -> Self {
        Self { patterns }
    }

    /// The constant alone, for patches of `pixels` pixels: far light of the visible side, b of eq. 12.
    pub fn constant(pixels: usize) -> Self {
        let constant = || vec![vec![1.0; pixels]];
        Self::new([constant(), constant()])
    }

    /// The patterns of one side: 0 left, 1 right.
    pub(super) fn side(&self, s: usize) -> &[Vec<f64>] {
        &self.patterns[s]
    }
}
