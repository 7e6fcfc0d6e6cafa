use crate::geometry::Side;
use crate::light::{Patch, PatchPair};

/// What may be in a patch at any strength without saying anything about the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Nuisance {
    patterns: [Vec<Vec<f64>>; 2],
    own: Option<PatchPair>,
}

impl Nuisance {
    /// Per side, patterns over the pixels of a patch, row by row from the wall.
    pub fn new(patterns: [Vec<Vec<f64>>; 2]) -> Self {
        Self { patterns, own: None }
    }

    /// Besides the patterns, which any colour may hold: in each colour, that colour's own picture of the empty room.
    pub fn with_own_pictures(self, empty: PatchPair) -> Self {
        Self { own: Some(empty), ..self }
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

    /// The colours' own pictures at one side, if there are any.
    pub(super) fn own(&self, side: Side) -> Option<&Patch> {
        self.own.as_ref().map(|pair| pair.side(side))
    }
}
