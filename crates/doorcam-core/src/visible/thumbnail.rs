use crate::image::Image;
use crate::light::LightTable;

/// Cells across a picture: small enough to be cheap, and fine enough to see a leg.
const ACROSS: usize = 80;
/// Pixels of a cell that are read, along each side: a sample of them is enough.
const SAMPLED: usize = 4;

/// How a camera's picture is divided into square cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Cells across.
    pub width: usize,
    /// Cells down.
    pub height: usize,
    /// Pixels along a cell's side.
    pub cell_px: usize,
}

impl Grid {
    /// The grid of a picture of `size` (width, height) in pixels. A cell that is not whole at the right or lower border
    /// is left out.
    pub fn new([width, height]: [usize; 2]) -> Self {
        let cell_px = width.div_ceil(ACROSS).max(1);
        Self { width: width / cell_px, height: height / cell_px, cell_px }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// Whether it has no cells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Position of a cell's centre in the picture, in pixels.
    pub fn centre(&self, cell: usize) -> [f64; 2] {
        let (half, side) = (0.5 * (self.cell_px as f64 - 1.0), self.cell_px as f64);
        [(cell % self.width) as f64 * side + half, (cell / self.width) as f64 * side + half]
    }

    /// The cell at a position in the picture, in pixels; none outside.
    pub fn at(&self, [u, v]: [f64; 2]) -> Option<usize> {
        let along = |p: f64, cells: usize| {
            let k = ((p + 0.5) / self.cell_px as f64).floor();
            (k >= 0.0 && k < cells as f64).then_some(k as usize)
        };
        Some(along(v, self.height)? * self.width + along(u, self.width)?)
    }
}

/// A small picture of all that the camera sees, in linear light: per cell of the grid, row by row, its mean colour.
#[derive(Debug, Clone, PartialEq)]
pub struct Thumbnail {
    grid: Grid,
    cells: Vec<[f32; 3]>,
}

impl Thumbnail {
    /// A black picture.
    pub fn new(grid: Grid) -> Self {
        Self { grid, cells: vec![[0.0; 3]; grid.len()] }
    }

    /// Its grid.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// The cells' colours.
    pub fn cells(&self) -> &[[f32; 3]] {
        &self.cells
    }

    /// The same for writing.
    pub fn cells_mut(&mut self) -> &mut [[f32; 3]] {
        &mut self.cells
    }

    /// Reads an image of the grid's size: each cell is the mean of some of its pixels. Allocates nothing. Cells of rows
    /// that the image does not have stay as they are.
    pub fn fill(&mut self, image: &Image, table: &LightTable) {
        let Grid { width, cell_px, .. } = self.grid;
        let step = (cell_px / SAMPLED).max(1);
        let offset = step / 2;
        let per_side = (offset..cell_px).step_by(step).count();
        let weight = [1.0 / (per_side * per_side) as f32];
        for (k, cell) in self.cells.iter_mut().enumerate() {
            let (left, top) = (k % width * cell_px, k / width * cell_px);
            if top + cell_px > image.height || left + cell_px > image.width {
                continue;
            }
            let mut sum = [0.0; 3];
            for row in (top + offset..top + cell_px).step_by(step) {
                for column in (left + offset..left + cell_px).step_by(step) {
                    table.add_weighted(image, row * image.width + column, &weight, &mut sum);
                }
            }
            *cell = sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Samples;
    use crate::light::Decoding;
    use crate::optics::Transfer;

    #[test]
    fn a_cell_is_found_at_its_centre_and_has_the_mean_of_its_pixels() {
        let grid = Grid::new([640, 363]);
        assert_eq!(grid, Grid { width: 80, height: 45, cell_px: 8 });
        assert!((0..grid.len()).all(|cell| grid.at(grid.centre(cell)) == Some(cell)));
        assert_eq!((grid.at([-0.6, 0.0]), grid.at([0.0, 360.0]), grid.at([639.4, 359.4])), (None, None, Some(3599)));
        // A plane of light: the mean over the sampled pixels is the value at the cell's centre.
        let code = |u: usize, v: usize| [(10 * u) as u16, (20 * v) as u16, 5];
        let samples = (0..363).flat_map(|v| (0..640).flat_map(move |u| code(u, v))).collect();
        let image = Image { width: 640, height: 363, samples: Samples::Sixteen(samples) };
        let mut thumbnail = Thumbnail::new(grid);
        thumbnail.fill(&image, &LightTable::new(&Decoding::Light(Transfer::Linear)));
        for cell in [0, 79, 1234, 3599] {
            let [u, v] = grid.centre(cell);
            let [red, green, _] = thumbnail.cells()[cell].map(|light| f64::from(light) * 65535.0);
            assert!((red - 10.0 * u).abs() < 6.0 && (green - 20.0 * v).abs() < 11.0, "{cell}: {red} {green}");
        }
        assert_eq!(Grid::new([5, 4]).len(), 20);
    }
}
