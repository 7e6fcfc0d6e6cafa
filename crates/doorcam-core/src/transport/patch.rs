use crate::geometry::{Doorway, Point, Side};

/// Where the pixel centres of a patch lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelLayout {
    /// As in the published matrices: the square's edges are included, so neighbours are fov / (size - 1) apart and the
    /// first row lies on the wall.
    EndsIncluded,
    /// Centres of `size` x `size` equal cells that tile the square, as for a camera that averages over areas.
    Cells,
}

/// The floor patch at each edge: a square of side `fov_m` that touches the wall's visible face, centred in x on its
/// edge. Row 0 is at the wall, column 0 at the smallest x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchGrid {
    /// Pixels along each side of the square.
    pub size: usize,
    /// Side of the square, in metres.
    pub fov_m: f64,
    /// Where the centres lie.
    pub layout: PixelLayout,
}

impl PatchGrid {
    /// Pixels in one patch, M.
    pub fn pixels(&self) -> usize {
        self.size * self.size
    }

    /// Position of a pixel's centre on the floor, in metres in the door frame.
    pub fn point(&self, doorway: &Doorway, side: Side, row: usize, column: usize) -> Point {
        let fraction = |k: usize| match self.layout {
            PixelLayout::EndsIncluded => k as f64 / (self.size - 1) as f64,
            PixelLayout::Cells => (k as f64 + 0.5) / self.size as f64,
        };
        [
            doorway.edge(side)[0] + (fraction(column) - 0.5) * self.fov_m,
            -doorway.wall_thickness_m - fraction(row) * self.fov_m,
        ]
    }

    /// Centres of all pixels, row by row from the wall, in metres in the door frame.
    pub fn points(&self, doorway: &Doorway, side: Side) -> Vec<Point> {
        (0..self.pixels()).map(|k| self.point(doorway, side, k / self.size, k % self.size)).collect()
    }
}
