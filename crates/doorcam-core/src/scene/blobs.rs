use super::Intensity;
use crate::geometry::{Biangular, Doorway, FacetGrid, Point};
use crate::transport::PastLeaf;

/// Facets are neighbours if both of their angles differ by less than this many steps of the grid. That takes in the
/// cells around a facet, corners included, with a margin for the half cells at the walls.
const NEIGHBOURS: f64 = 1.6;

/// A connected part of the unified map, which shows one change. Where the door's leaf hides a facet from one edge, what
/// the other shows counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blob {
    /// Its centre, in metres in the door frame: the mean of its facets' biangular coordinates, weighted by strength.
    pub position: Point,
    /// The sum of min(|c_L|, |c_R|) over its facets, or of that of the only edge that sees a facet past the leaf.
    pub strength: f64,
}

/// Which facets of a grid are neighbours.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighbourhood {
    doorway: Doorway,
    angles: Vec<Biangular>,
    neighbours: Vec<Vec<usize>>,
    /// Per facet, whether the left and the right patch see it past the leaf; empty without a leaf.
    sees: Vec<[bool; 2]>,
}

/// Workspace for finding blobs.
#[derive(Debug, Clone, Default)]
pub struct BlobWorkspace {
    strengths: Vec<f64>,
    stack: Vec<usize>,
    blobs: Vec<Blob>,
}

impl Neighbourhood {
    /// The neighbours in a grid with steps of `step` radians. `leaf` tells what is seen past the door's leaf.
    pub fn new(doorway: &Doorway, grid: &FacetGrid, step: f64, leaf: Option<&PastLeaf>) -> Self {
        let angles: Vec<Biangular> = grid.facets.iter().map(|f| Biangular::from_point(doorway, f.midpoint())).collect();
        let near = |a: &Biangular, b: &Biangular| {
            (a.alpha1 - b.alpha1).abs().max((a.alpha2 - b.alpha2).abs()) < NEIGHBOURS * step
        };
        let neighbours = (angles.iter().enumerate())
            .map(|(n, a)| (0..angles.len()).filter(|&m| m != n && near(a, &angles[m])).collect())
            .collect();
        let sees = |leaf: &PastLeaf| grid.facets.iter().map(|facet| leaf.sees(facet.midpoint())).collect();
        Self { doorway: *doorway, angles, neighbours, sees: leaf.map_or_else(Vec::new, sees) }
    }

    /// The blobs of a map, strongest first: sets of connected facets that are brighter in both views, or darker in
    /// both; behind the leaf, in the view that sees them.
    pub fn blobs<'a>(&self, intensities: &[Intensity], workspace: &'a mut BlobWorkspace) -> &'a [Blob] {
        let BlobWorkspace { strengths, stack, blobs } = workspace;
        strengths.clear();
        strengths.extend(intensities.iter().map(signed_strength));
        for ((strength, seen), i) in strengths.iter_mut().zip(&self.sees).zip(intensities) {
            match seen {
                [true, false] => *strength = i.left,
                [false, true] => *strength = i.right,
                _ => {}
            }
        }
        blobs.clear();
        for start in 0..strengths.len() {
            let sign = strengths[start].signum();
            if strengths[start] == 0.0 {
                continue;
            }
            let (mut weight, mut alpha1, mut alpha2) = (0.0, 0.0, 0.0);
            stack.push(start);
            while let Some(n) = stack.pop() {
                let strength = std::mem::take(&mut strengths[n]).abs();
                weight += strength;
                alpha1 += strength * self.angles[n].alpha1;
                alpha2 += strength * self.angles[n].alpha2;
                stack.extend(self.neighbours[n].iter().copied().filter(|&m| strengths[m] * sign > 0.0));
            }
            if weight > 0.0 {
                let middle = Biangular { alpha1: alpha1 / weight, alpha2: alpha2 / weight };
                blobs.push(Blob { position: middle.to_point(&self.doorway), strength: weight });
            }
        }
        blobs.sort_by(|a, b| b.strength.total_cmp(&a.strength));
        blobs
    }
}

/// min(|c_L|, |c_R|), negative if both are negative; 0 if their signs differ.
fn signed_strength(i: &Intensity) -> f64 {
    if i.left * i.right > 0.0 { i.left.abs().min(i.right.abs()).copysign(i.left) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::GridSpec;

    const DOOR: Doorway = Doorway { width_m: 0.5, wall_thickness_m: 0.0, height_m: None, leaf: None };

    fn grid() -> (FacetGrid, Neighbourhood) {
        let grid = FacetGrid::new(&DOOR, &GridSpec::published()).unwrap();
        let neighbourhood = Neighbourhood::new(&DOOR, &grid, 4.0_f64.to_radians(), None);
        (grid, neighbourhood)
    }

    fn nearest(grid: &FacetGrid, point: Point) -> usize {
        let distance = |n: &usize| {
            let [x, y] = grid.facets[*n].midpoint();
            (x - point[0]).hypot(y - point[1])
        };
        (0..grid.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap()
    }

    #[test]
    fn what_is_connected_is_one_blob_and_what_is_apart_are_several() {
        let (grid, neighbourhood) = grid();
        let mut intensities = vec![Intensity::default(); grid.len()];
        let colour = [1.0, 0.0, 0.0];
        let middle = nearest(&grid, [0.0, 1.0]);
        for &n in neighbourhood.neighbours[middle].iter().chain([&middle]) {
            intensities[n] = Intensity { left: -1.0, right: -2.0, colour };
        }
        intensities[nearest(&grid, [0.8, 1.5])] = Intensity { left: 0.5, right: 0.4, colour };
        intensities[nearest(&grid, [-0.8, 1.5])] = Intensity { left: 0.5, right: -0.4, colour };
        let mut workspace = BlobWorkspace::default();
        let blobs = neighbourhood.blobs(&intensities, &mut workspace);
        assert_eq!(blobs.len(), 2, "{blobs:?}");
        assert_eq!(blobs[0].strength, 1.0 + neighbourhood.neighbours[middle].len() as f64);
        let [x, y] = grid.facets[middle].midpoint();
        assert!((blobs[0].position[0] - x).hypot(blobs[0].position[1] - y) < 0.15, "{blobs:?}");
        assert_eq!(blobs[1].strength, 0.4);
        // A brighter facet beside darker ones is a blob of its own.
        intensities[middle].left = 1.0;
        intensities[middle].right = 2.0;
        assert_eq!(neighbourhood.blobs(&intensities, &mut workspace).len(), 3);
    }

    #[test]
    fn behind_the_leaf_the_edge_that_sees_counts() {
        let leaf = Some(crate::geometry::Leaf { hinge: crate::geometry::Side::Left, angle_deg: 95.0, width_m: 0.5 });
        let door = Doorway { width_m: 0.8, wall_thickness_m: 0.1, leaf, ..DOOR };
        let grid = FacetGrid::new(&door, &GridSpec::published()).unwrap();
        let patch = crate::transport::PatchGrid { size: 32, fov_m: 0.3, layout: crate::transport::PixelLayout::Cells };
        let past = PastLeaf::new(&door, &patch).unwrap();
        let step = 4.0_f64.to_radians();
        let [with, without] = [Some(&past), None].map(|leaf| Neighbourhood::new(&door, &grid, step, leaf));
        let hidden = nearest(&grid, [-0.9, 2.2]);
        assert_eq!(past.sees(grid.facets[hidden].midpoint()), [false, true]);
        let mut intensities = vec![Intensity::default(); grid.len()];
        intensities[hidden] = Intensity { left: 0.0, right: -0.7, colour: [1.0, 0.0, 0.0] };
        let mut workspace = BlobWorkspace::default();
        assert_eq!(with.blobs(&intensities, &mut workspace)[0].strength, 0.7);
        assert!(without.blobs(&intensities, &mut workspace).is_empty());
    }

    #[test]
    fn every_facet_has_neighbours() {
        let (grid, neighbourhood) = grid();
        assert!((0..grid.len()).all(|n| !neighbourhood.neighbours[n].is_empty()));
    }
}
