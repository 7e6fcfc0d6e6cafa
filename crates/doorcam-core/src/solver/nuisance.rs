use crate::geometry::Side;
use crate::light::{Patch, PatchPair};

/// What may be in a patch at any strength without telling anything about the hidden room.
#[derive(Debug, Clone, PartialEq)]
pub struct Nuisance {
    patterns: [Vec<Vec<f64>>; 2],
    own: Option<PatchPair>,
}

impl Nuisance {
    /// Nuisance patterns per side, over the pixels of a patch, row by row from the wall.
    pub fn new(patterns: [Vec<Vec<f64>>; 2]) -> Self {
        Self { patterns, own: None }
    }

    /// Adds, in each colour, that colour's own picture of the empty room. The patterns may be present in every colour.
    pub fn with_own_pictures(self, empty: PatchPair) -> Self {
        Self { own: Some(empty), ..self }
    }

    /// Only the constant, for patches of `pixels` pixels: distant light of the visible side, b of eq. 12.
    pub fn constant(pixels: usize) -> Self {
        let constant = || vec![vec![1.0; pixels]];
        Self::new([constant(), constant()])
    }

    /// The patterns of one side: 0 is left, 1 is right.
    pub(super) fn side(&self, s: usize) -> &[Vec<f64>] {
        &self.patterns[s]
    }

    /// The own pictures of one side, if any.
    pub(super) fn own(&self, side: Side) -> Option<&Patch> {
        self.own.as_ref().map(|pair| pair.side(side))
    }
}
