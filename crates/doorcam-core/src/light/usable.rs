use crate::geometry::Side;

/// Which pixels of a patch pair still show the floor in one frame, lit as the hidden room can light it: per side, row by
/// row from the wall. Pixels that the model does not count are never usable.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Usable {
    sides: [Vec<bool>; 2],
}

impl Usable {
    /// All pixels that count.
    pub fn all(counted: &[Vec<bool>; 2]) -> Self {
        Self { sides: counted.clone() }
    }

    /// No pixel.
    pub fn none(counted: &[Vec<bool>; 2]) -> Self {
        Self { sides: counted.each_ref().map(|counted| vec![false; counted.len()]) }
    }

    /// One side's pixels.
    pub fn side(&self, side: Side) -> &[bool] {
        &self.sides[side as usize]
    }

    /// Mutable version of [`Self::side`].
    pub fn side_mut(&mut self, side: Side) -> &mut [bool] {
        &mut self.sides[side as usize]
    }

    /// Copies `other`, which must have the same size, without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        for (own, others) in self.sides.iter_mut().zip(&other.sides) {
            own.copy_from_slice(others);
        }
    }

    /// Number of usable pixels of one side.
    pub fn count(&self, side: Side) -> usize {
        self.side(side).iter().filter(|&&usable| usable).count()
    }
}
