use crate::geometry::Side;

/// One rectified square of floor in linear light: three planes (red, green, blue) of `size` x `size` pixels, row 0 at
/// the wall.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    size: usize,
    data: Vec<f32>,
}

impl Patch {
    /// A patch of zeros.
    pub fn zeros(size: usize) -> Self {
        Self { size, data: vec![0.0; 3 * size * size] }
    }

    /// Pixels along each side.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Pixels in the patch, M.
    pub fn pixels(&self) -> usize {
        self.size * self.size
    }

    /// One colour plane (0 red, 1 green, 2 blue), row by row from the wall.
    pub fn plane(&self, channel: usize) -> &[f32] {
        &self.data[channel * self.pixels()..(channel + 1) * self.pixels()]
    }

    /// Mutable version of [`Self::plane`].
    pub fn plane_mut(&mut self, channel: usize) -> &mut [f32] {
        let pixels = self.pixels();
        &mut self.data[channel * pixels..(channel + 1) * pixels]
    }

    /// All three planes, one after the other.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// Mutable version of [`Self::data`].
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }
}

/// The two patches of a doorway (the paper's FOV-L and FOV-R).
#[derive(Debug, Clone, PartialEq)]
pub struct PatchPair {
    /// The patch at the left edge.
    pub left: Patch,
    /// The patch at the right edge.
    pub right: Patch,
}

impl PatchPair {
    /// A pair of zeros.
    pub fn zeros(size: usize) -> Self {
        Self { left: Patch::zeros(size), right: Patch::zeros(size) }
    }

    /// The patch of one side.
    pub fn side(&self, side: Side) -> &Patch {
        match side {
            Side::Left => &self.left,
            Side::Right => &self.right,
        }
    }

    /// Mutable version of [`Self::side`].
    pub fn side_mut(&mut self, side: Side) -> &mut Patch {
        match side {
            Side::Left => &mut self.left,
            Side::Right => &mut self.right,
        }
    }

    /// Copies the values of `other`, which must have the same size, without allocating.
    pub fn copy_from(&mut self, other: &PatchPair) {
        for side in Side::BOTH {
            self.side_mut(side).data_mut().copy_from_slice(other.side(side).data());
        }
    }

    /// Writes `self` − `other` into `out`. All three must have the same size.
    pub fn subtract(&self, other: &PatchPair, out: &mut PatchPair) {
        for side in Side::BOTH {
            let values = self.side(side).data().iter().zip(other.side(side).data());
            out.side_mut(side).data_mut().iter_mut().zip(values).for_each(|(out, (a, b))| *out = a - b);
        }
    }
}
