use super::{Grid, Pose};
use crate::geometry::{Doorway, Point};
use crate::tracking::Covariance;

/// Places are tried this far apart, in metres.
const STEP_M: f64 = 0.1;
/// How far from the edges, and on both sides of the wall's hidden face, places are tried, in metres.
const BESIDE_M: f64 = 0.9;
const BEFORE_M: f64 = 1.9;
const BEHIND_M: f64 = 1.0;
/// Heights that are tried, in metres.
const HEIGHTS_M: [f64; 3] = [1.2, 1.55, 1.8];
/// A body of height 1: height and radius of some of its cross-sections. Legs and arms that swing are not in it.
const BODY: [[f64; 2]; 9] = [
    [0.03, 0.075],
    [0.15, 0.075],
    [0.29, 0.08],
    [0.44, 0.095],
    [0.55, 0.105],
    [0.67, 0.12],
    [0.78, 0.13],
    [0.87, 0.09],
    [0.94, 0.07],
];
/// Cross-sections between two of these.
const BETWEEN: usize = 3;
/// Fewest cells of a silhouette that says anything.
const FEWEST: usize = 10;
/// What a cell of the silhouette that is not covered costs, in cells that are.
const UNCOVERED: f64 = 0.6;
/// Least score of a body, in cells, and as a share of its silhouette.
const LEAST: f64 = 10.0;
const LEAST_SHARE: f64 = 0.2;
/// Cells of a silhouette from which its absence says something, and the share of them that may be covered by chance.
const TELLING: usize = 40;
const ABSENT: f64 = 0.12;
/// Smallest error of a place, in metres: bodies differ, and their limbs swing.
const ERROR_M: f64 = 0.1;
/// Two bodies are at least this far apart, in metres.
const APART_M: f64 = 0.45;

/// A set of a picture's cells.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Cells {
    words: Vec<u64>,
}

impl Cells {
    /// None of `cells` cells.
    pub fn new(cells: usize) -> Self {
        Self { words: vec![0; cells.div_ceil(64)] }
    }

    /// Removes all.
    pub fn clear(&mut self) {
        self.words.fill(0);
    }

    /// Adds a cell.
    pub fn set(&mut self, cell: usize) {
        self.words[cell / 64] |= 1 << (cell % 64);
    }

    /// Whether a cell is in it.
    pub fn has(&self, cell: usize) -> bool {
        self.words[cell / 64] >> (cell % 64) & 1 == 1
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Copies `other`, which must have as many cells, without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        self.words.copy_from_slice(&other.words);
    }

    /// Number of cells that are in only one of two sets.
    pub fn different(&self, other: &Self) -> usize {
        self.words.iter().zip(&other.words).map(|(a, b)| (a ^ b).count_ones() as usize).sum()
    }

    fn shared(&self, other: &Self) -> usize {
        self.words.iter().zip(&other.words).map(|(a, b)| (a & b).count_ones() as usize).sum()
    }

    fn add(&mut self, other: &Self) {
        self.words.iter_mut().zip(&other.words).for_each(|(own, other)| *own |= other);
    }
}

/// A body at one place.
#[derive(Debug, Clone)]
struct Silhouette {
    place: Point,
    cells: Cells,
    area: usize,
}

/// Where a body is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The body's axis, in metres in the door frame.
    pub position: Point,
    /// Its covariance, in m².
    pub covariance: Covariance,
    /// How many cells of the picture it explains.
    pub cells: usize,
}

/// What bodies at all places near the threshold cover in the picture.
#[derive(Debug, Clone)]
pub struct Silhouettes {
    all: Vec<Silhouette>,
    scores: Vec<f64>,
    /// Cells that belong to somebody found already.
    taken: Cells,
}

impl Silhouettes {
    /// The silhouettes in pictures with this grid, of a camera with this pose.
    pub fn new(pose: &Pose, grid: Grid, doorway: &Doorway) -> Self {
        let steps = |from: f64, to: f64| {
            let count = ((to - from) / STEP_M).round() as usize;
            (0..=count).map(move |k| from + k as f64 * STEP_M)
        };
        let (half, face) = (doorway.half_width() + BESIDE_M, -doorway.wall_thickness_m);
        let mut all = Vec::new();
        for y in steps(face - BEFORE_M, BEHIND_M) {
            for x in steps(-half, half) {
                // Nobody stands in the wall, and nobody is seen through it.
                if y > face - 0.1 && x.abs() > doorway.half_width() {
                    continue;
                }
                for height in HEIGHTS_M {
                    let cells = silhouette(pose, grid, [x, y], height);
                    let area = cells.count();
                    if area >= FEWEST {
                        all.push(Silhouette { place: [x, y], cells, area });
                    }
                }
            }
        }
        Self { scores: vec![0.0; all.len()], taken: Cells::new(grid.len()), all }
    }

    /// The share of places within the opening's width, from a metre before the wall to its hidden face, at which a body
    /// is seen.
    pub fn coverage(&self, doorway: &Doorway) -> f64 {
        let near = |[x, y]: Point| x.abs() <= doorway.half_width() && y <= 0.05 && y >= -doorway.wall_thickness_m - 0.6;
        let seen = self.all.iter().filter(|s| near(s.place)).count() as f64;
        let across = (2.0 * doorway.half_width() / STEP_M).floor().max(1.0);
        let along = ((doorway.wall_thickness_m + 0.65) / STEP_M).floor();
        seen / (across * along * HEIGHTS_M.len() as f64)
    }

    /// Whether somebody at a place (m, door frame) would be seen, and is not: of the silhouettes of a body there, none is
    /// covered by more than a small part.
    pub fn is_absent(&self, [x, y]: Point, covered: &Cells) -> bool {
        let near = |s: &&Silhouette| (s.place[0] - x).abs() <= STEP_M && (s.place[1] - y).abs() <= STEP_M;
        let mut large = self.all.iter().filter(near).filter(|s| s.area >= TELLING).peekable();
        let free = |s: &Silhouette| (s.cells.shared(covered) as f64) < ABSENT * s.area as f64;
        large.peek().is_some() && large.all(free)
    }

    /// Finds the bodies that explain best what is covered, and adds them to `found`: at most `most`.
    pub fn find(&mut self, covered: &Cells, most: usize, found: &mut Vec<Sighting>) {
        found.clear();
        self.taken.clear();
        let all_covered = covered.count();
        if all_covered < FEWEST {
            return;
        }
        while found.len() < most {
            for (score, silhouette) in self.scores.iter_mut().zip(&self.all) {
                let taken = silhouette.cells.shared(&self.taken);
                let both = if found.is_empty() { 0 } else { both(&silhouette.cells, covered, &self.taken) };
                let hit = silhouette.cells.shared(covered) - both;
                let area = silhouette.area - taken;
                *score = hit as f64 - UNCOVERED * (area - hit) as f64;
            }
            let best = (0..self.all.len()).max_by(|&a, &b| self.scores[a].total_cmp(&self.scores[b]));
            let Some(best) = best else { return };
            let score = self.scores[best];
            let Silhouette { area, .. } = self.all[best];
            if score < LEAST || score < LEAST_SHARE * area as f64 {
                return;
            }
            let sighting = self.around(best, score, covered.shared(&self.all[best].cells));
            self.taken.add(&self.all[best].cells);
            let apart = |other: &Sighting| {
                (other.position[0] - sighting.position[0]).hypot(other.position[1] - sighting.position[1]) > APART_M
            };
            if !found.iter().all(apart) {
                return;
            }
            found.push(sighting);
        }
    }

    /// Mean and covariance of the places around the best one, weighted by how well they explain the picture.
    fn around(&self, centre: usize, best: f64, cells: usize) -> Sighting {
        let [cx, cy] = self.all[centre].place;
        // Neighbouring cells say the same.
        let scale = (0.03 * best).max(4.0);
        let (mut sum, mut mean, mut squares) = (0.0, [0.0; 2], [0.0; 3]);
        for (score, silhouette) in self.scores.iter().zip(&self.all) {
            let weight = ((score - best) / scale).exp();
            let [x, y] = silhouette.place;
            // Farther away it would be another body.
            if weight < 1e-3 || (x - cx).hypot(y - cy) > APART_M {
                continue;
            }
            sum += weight;
            (mean[0], mean[1]) = (mean[0] + weight * x, mean[1] + weight * y);
            squares = [squares[0] + weight * x * x, squares[1] + weight * x * y, squares[2] + weight * y * y];
        }
        let [x, y] = mean.map(|v| v / sum);
        let [xx, xy, yy] = squares.map(|v| v / sum);
        let floor = ERROR_M * ERROR_M;
        let xy = xy - x * y;
        let covariance = [[(xx - x * x).max(0.0) + floor, xy], [xy, (yy - y * y).max(0.0) + floor]];
        Sighting { position: [x, y], covariance, cells }
    }
}

/// Number of cells in all three sets.
fn both(a: &Cells, b: &Cells, c: &Cells) -> usize {
    a.words.iter().zip(&b.words).zip(&c.words).map(|((a, b), c)| (a & b & c).count_ones() as usize).sum()
}

/// The cells whose centres a body of this height covers: the union of its cross-sections as discs.
fn silhouette(pose: &Pose, grid: Grid, [x, y]: Point, height: f64) -> Cells {
    let mut cells = Cells::new(grid.len());
    let side = grid.cell_px as f64;
    for pair in BODY.windows(2) {
        for step in 0..BETWEEN {
            let share = step as f64 / BETWEEN as f64;
            let [z, radius] = [0, 1].map(|k| height * (pair[0][k] + share * (pair[1][k] - pair[0][k])));
            let Some(([u, v], scale)) = pose.project([x, y, z]) else { continue };
            let radius_px = radius * scale;
            let range = |centre: f64, cells: usize| {
                let first = ((centre - radius_px) / side - 1.0).max(0.0) as usize;
                let last = ((centre + radius_px) / side + 1.0).clamp(0.0, cells as f64) as usize;
                first.min(cells)..last
            };
            for row in range(v, grid.height) {
                for column in range(u, grid.width) {
                    let cell = row * grid.width + column;
                    let [cu, cv] = grid.centre(cell);
                    if (cu - u).powi(2) + (cv - v).powi(2) <= radius_px * radius_px {
                        cells.set(cell);
                    }
                }
            }
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::pinhole::Pinhole;
    use crate::calibration::{Camera, Homography};

    const DOORWAY: Doorway = Doorway { width_m: 0.9, wall_thickness_m: 0.1, height_m: None, leaf: None };

    fn pose() -> Pose {
        let pinhole =
            Pinhole { at: [0.1, -1.5, 2.2], tilt: 1.0, turn: 0.0, roll: 0.02, focal: 480.0, centre: [319.5, 179.5] };
        let floor = [[-0.5, -0.1], [0.5, -0.1], [0.6, -0.6], [-0.6, -0.6]];
        let points = floor.map(|p| (p, pinhole.see(p).unwrap()));
        Pose::of(&Camera::new(Homography::fit(&points).unwrap(), None), [640, 360]).unwrap()
    }

    #[test]
    fn bodies_are_found_where_they_cover_the_picture_and_missed_where_they_do_not() {
        let (pose, grid) = (pose(), Grid::new([640, 360]));
        let mut silhouettes = Silhouettes::new(&pose, grid, &DOORWAY);
        assert!(silhouettes.coverage(&DOORWAY) > 0.8, "{}", silhouettes.coverage(&DOORWAY));
        let mut found = Vec::new();
        for place in [[0.03, -0.41], [-0.22, 0.04], [0.31, -0.77]] {
            // A body of another height, between the places that are tried.
            let covered = silhouette(&pose, grid, place, 1.68);
            silhouettes.find(&covered, 3, &mut found);
            assert_eq!(found.len(), 1, "{place:?}: {found:?}");
            let [x, y] = found[0].position;
            assert!((x - place[0]).hypot(y - place[1]) < 0.15, "{place:?}: {found:?}");
            assert!(!silhouettes.is_absent(place, &covered), "{place:?}");
            assert!(silhouettes.is_absent(place, &Cells::new(grid.len())), "{place:?}");
        }
        // The picture does not show this place.
        assert!(!silhouettes.is_absent([0.0, 2.0], &Cells::new(grid.len())));
        silhouettes.find(&Cells::new(grid.len()), 3, &mut found);
        assert_eq!(found, []);
    }

    #[test]
    fn two_people_are_two() {
        let (pose, grid) = (pose(), Grid::new([640, 360]));
        let mut silhouettes = Silhouettes::new(&pose, grid, &DOORWAY);
        let places = [[-0.5, -0.5], [0.6, -0.6]];
        let mut covered = silhouette(&pose, grid, places[0], 1.7);
        covered.add(&silhouette(&pose, grid, places[1], 1.6));
        let mut found = Vec::new();
        silhouettes.find(&covered, 3, &mut found);
        assert_eq!(found.len(), 2, "{found:?}");
        for place in places {
            let away = |s: &Sighting| (s.position[0] - place[0]).hypot(s.position[1] - place[1]);
            assert!(found.iter().any(|s| away(s) < 0.2), "{place:?} {found:?}");
        }
    }
}
