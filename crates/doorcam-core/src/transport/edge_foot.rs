use crate::transport::{PatchGrid, PixelLayout};

/// Mask of the pixels of a patch that count, row by row from the wall: all but those at the foot of the edge, where the
/// model of a thin, straight edge does not hold.
///
/// With the published pixel layout this is the published rule, which leaves out pixels within size / 16 pixels of the
/// foot, in the first rows. Otherwise, pixels within fov / 16 of the foot are left out.
pub fn edge_foot_mask(patch: &PatchGrid) -> Vec<bool> {
    let size = patch.size;
    (0..patch.pixels())
        .map(|k| {
            let (row, column) = (k / size, k % size);
            match patch.layout {
                PixelLayout::EndsIncluded => {
                    let radius = (size / 16) as f64;
                    let (i, j) = ((row + 1) as f64, (column + 1) as f64);
                    i > radius || (j - size as f64 / 2.0).hypot(i) > radius
                }
                PixelLayout::Cells => {
                    let (i, j) = (row as f64 + 0.5, column as f64 + 0.5 - size as f64 / 2.0);
                    j.hypot(i) > size as f64 / 16.0
                }
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_mask_zeroes_pixels_within_four_of_column_32() {
        let mask = edge_foot_mask(&PatchGrid { size: 64, fov_m: 0.15, layout: PixelLayout::EndsIncluded });
        // Rows 1..4 (1-based) with sqrt((j - 32)² + i²) <= 4: columns 32 ± 3, ± 3, ± 2, ± 0.
        for (row, reach) in [(0usize, 3usize), (1, 3), (2, 2), (3, 0)] {
            for column in 0..64usize {
                assert_eq!(!mask[row * 64 + column], (column + 1).abs_diff(32) <= reach, "row {row}, column {column}");
            }
        }
        assert!(mask[4 * 64..].iter().all(|&m| m));
    }

    #[test]
    fn the_mask_of_cells_is_symmetric() {
        let mask = edge_foot_mask(&PatchGrid { size: 64, fov_m: 0.3, layout: PixelLayout::Cells });
        assert_eq!(mask.iter().filter(|&&m| !m).count(), 26);
        for row in 0..64 {
            for column in 0..64 {
                assert_eq!(mask[row * 64 + column], mask[row * 64 + 63 - column]);
            }
        }
    }
}
