use crate::geometry::{Doorway, Point, Side};
use crate::light::{Patch, PatchPair};
use crate::transport::PatchGrid;

/// Sectors of a fan. Each spans at most half the angle of a person 2 m away.
const SECTORS: usize = 48;
/// Rings of a fan.
const RINGS: usize = 3;

/// The pixels of a patch grouped into cells by angle and distance around the foot of their edge. A penumbra depends
/// mainly on the angle, so a cell's mean keeps nearly all the information of its pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Fan {
    /// Cell of each pixel; `None` for pixels that do not count.
    cells: Vec<Option<u16>>,
    /// Number of pixels in each cell, at least one.
    counts: Vec<u32>,
}

impl Fan {
    /// The fan of the pixels of one patch that count.
    pub fn new(doorway: &Doorway, patch: &PatchGrid, side: Side, counted: &[bool]) -> Self {
        let [foot, _] = doorway.edge(side);
        let polar = |k: usize| {
            let [x, y] = patch.point(doorway, side, k / patch.size, k % patch.size);
            let (x, y) = (x - foot, -doorway.wall_thickness_m - y);
            (y.atan2(x), x.hypot(y))
        };
        // Rings of equal area: half a disc of radius r has an area of π r² / 2.
        let ring = |r: f64| (RINGS as f64 * (2.0 * r / patch.fov_m).powi(2) / 2.0) as usize;
        let sector = |angle: f64| (SECTORS as f64 * angle / std::f64::consts::PI) as usize;
        let raw: Vec<Option<usize>> = (0..patch.pixels())
            .map(|k| {
                let (angle, distance) = polar(k);
                counted[k].then(|| sector(angle).min(SECTORS - 1) * RINGS + ring(distance).min(RINGS - 1))
            })
            .collect();
        let mut numbers = [None; SECTORS * RINGS];
        let mut counts = Vec::new();
        let cells = raw.into_iter().map(|cell| {
            let number = numbers[cell?].get_or_insert_with(|| {
                counts.push(0);
                counts.len() - 1
            });
            counts[*number] += 1;
            u16::try_from(*number).ok()
        });
        Self { cells: cells.collect(), counts }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.counts.len()
    }

    /// Whether no pixel counts.
    pub fn is_empty(&self) -> bool {
        self.counts.is_empty()
    }

    /// Number of pixels in each cell.
    pub fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// Index and cell of each pixel that counts.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.cells.iter().enumerate().filter_map(|(k, cell)| Some((k, usize::from((*cell)?))))
    }

    /// Mean of `values` (by pixel index) in each cell.
    pub fn means(&self, values: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut means = vec![0.0; self.len()];
        self.pixels().for_each(|(k, cell)| means[cell] += values(k));
        means.iter_mut().zip(&self.counts).for_each(|(mean, &n)| *mean /= f64::from(n));
        means
    }

    /// Writes the mean of a patch's plane in each cell into `means`.
    pub fn means_into(&self, plane: &[f32], means: &mut [f32]) {
        means.fill(0.0);
        for (cell, &value) in self.cells.iter().zip(plane) {
            if let Some(cell) = cell {
                means[usize::from(*cell)] += value;
            }
        }
        means.iter_mut().zip(&self.counts).for_each(|(mean, &n)| *mean /= n as f32);
    }

    /// Splits each cell's pixels into groups of at most `most` and returns the centroid and size of each group: fewer
    /// points that stand for all of them. `points` are the positions of all pixels.
    pub fn groups(&self, points: &[Point], most: usize) -> Vec<Vec<(Point, f64)>> {
        let mut members: Vec<Vec<Point>> = self.counts.iter().map(|&n| Vec::with_capacity(n as usize)).collect();
        self.pixels().for_each(|(k, cell)| members[cell].push(points[k]));
        let middle = |group: &[Point]| {
            let n = group.len() as f64;
            let sum = group.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
            ([sum[0] / n, sum[1] / n], n)
        };
        members.iter().map(|cell| cell.chunks(most).map(middle).collect()).collect()
    }
}

/// The fans of both patches.
#[derive(Debug, Clone, PartialEq)]
pub struct FanPair([Fan; 2]);

impl FanPair {
    /// The fans of the pixels that count.
    pub fn new(doorway: &Doorway, patch: &PatchGrid, counted: &[Vec<bool>; 2]) -> Self {
        let [left, right] = Side::BOTH;
        Self([Fan::new(doorway, patch, left, &counted[0]), Fan::new(doorway, patch, right, &counted[1])])
    }

    /// The left and the right fan.
    pub fn sides(&self) -> [&Fan; 2] {
        self.0.each_ref()
    }

    /// Each side's fan with its patch.
    pub fn with<'a>(&'a self, pair: &'a PatchPair) -> [(&'a Fan, &'a Patch); 2] {
        [(&self.0[0], &pair.left), (&self.0[1], &pair.right)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::PixelLayout;

    const DOOR: Doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: None, leaf: None };
    const PATCH: PatchGrid = PatchGrid { size: 64, fov_m: 0.3, layout: PixelLayout::Cells };

    #[test]
    fn every_pixel_that_counts_is_in_one_cell_of_its_angle() {
        let counted: Vec<bool> = (0..PATCH.pixels()).map(|k| k % 7 != 0).collect();
        let fan = Fan::new(&DOOR, &PATCH, Side::Right, &counted);
        assert_eq!(fan.pixels().count(), counted.iter().filter(|&&c| c).count());
        assert_eq!(fan.counts().iter().sum::<u32>() as usize, fan.pixels().count());
        assert!(fan.len() > SECTORS && fan.len() <= SECTORS * RINGS && fan.counts().iter().all(|&n| n > 0));
        let angle = |k: usize| {
            let [x, y] = PATCH.point(&DOOR, Side::Right, k / 64, k % 64);
            (-0.1 - y).atan2(x - 0.4)
        };
        let means = fan.means(angle);
        let width = std::f64::consts::PI / SECTORS as f64;
        assert!(fan.pixels().all(|(k, cell)| (angle(k) - means[cell]).abs() < width));
    }

    #[test]
    fn means_and_groups_are_of_the_cells_pixels() {
        let fan = Fan::new(&DOOR, &PATCH, Side::Left, &[true; 64 * 64]);
        let points = PATCH.points(&DOOR, Side::Left);
        let plane: Vec<f32> = points.iter().map(|p| (2.0 * p[0] - p[1]) as f32).collect();
        let mut means = vec![f32::NAN; fan.len()];
        fan.means_into(&plane, &mut means);
        for (group, mean) in fan.groups(&points, 5).iter().zip(&means) {
            let n: f64 = group.iter().map(|g| g.1).sum();
            let of_groups = group.iter().map(|(p, n)| (2.0 * p[0] - p[1]) * n).sum::<f64>() / n;
            assert!((of_groups - f64::from(*mean)).abs() < 1e-6, "{of_groups} {mean}");
        }
    }
}
