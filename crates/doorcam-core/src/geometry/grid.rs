use serde::{Deserialize, Serialize};

use super::{Biangular, Doorway, GeometryError, Point};

/// The part of the hidden room that the map covers: |x| <= `half_width_m`, 0 <= y <= `depth_m`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Room {
    /// Half of the room's width, in metres.
    pub half_width_m: f64,
    /// The room's depth behind the wall, in metres.
    pub depth_m: f64,
}

/// Parameters of the reconstruction grid; [`GridSpec::published`] has the published ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridSpec {
    /// The part of the hidden side that the grid covers.
    pub room: Room,
    /// Number of equal intervals of π for each of α1 and α2; 45 makes 4°.
    pub intervals: usize,
    /// Smallest angle between a grid line and the wall beside the opening, in radians. Facets parallel to y close each
    /// ring between the last line and the wall.
    pub min_angle: f64,
    /// Smallest distance of a facet's ends from either edge, in metres.
    pub edge_clearance_m: f64,
    /// Facet midpoints lie outside the ellipse of points whose distances to the two edges sum to this, in metres.
    pub near_sum_m: f64,
}

impl Default for Room {
    fn default() -> Self {
        GridSpec::published().room
    }
}

impl GridSpec {
    /// The published grid: 4° facets in a room of 3 m by 3 m, N = 230 for the published doorway of 0.508 m.
    pub fn published() -> Self {
        Self {
            room: Room { half_width_m: 1.5, depth_m: 3.0 },
            intervals: 45,
            min_angle: std::f64::consts::PI / 8.0,
            edge_clearance_m: 0.1,
            near_sum_m: 1.3,
        }
    }

    fn validate(&self, doorway: &Doorway) -> Result<(), GeometryError> {
        doorway.validate()?;
        let within = |key, value: f64, low: f64, high: f64, unit: &str| {
            if value >= low && value <= high {
                Ok(())
            } else {
                Err(GeometryError::OutOfRange { key, value, expected: format!("{low} to {high} {unit}") })
            }
        };
        within("room.half_width_m", self.room.half_width_m, 0.1, 100.0, "metres")?;
        within("room.depth_m", self.room.depth_m, 0.1, 100.0, "metres")?;
        if doorway.width_m > 2.0 * self.room.half_width_m {
            return Err(GeometryError::WiderThanRoom {
                width_m: doorway.width_m,
                room_m: 2.0 * self.room.half_width_m,
                half_width_m: self.room.half_width_m,
            });
        }
        let step = 180.0 / self.intervals as f64;
        within("grid.angular_step_deg", step, 0.5, 20.0, "degrees")?;
        within("grid.min_angle_deg", self.min_angle.to_degrees(), 1.0, 80.0, "degrees")?;
        within("grid.edge_clearance_m", self.edge_clearance_m, 0.0, 10.0, "metres")?;
        within("grid.near_sum_m", self.near_sum_m, 0.0, 100.0, "metres")
    }
}

/// A vertical rectangle of the reconstruction grid, standing on the segment from `from` to `to` of the floor plan.
///
/// Seen from above, the doorway is on the right of the direction `from` → `to`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// One end of the segment, in metres in the door frame.
    pub from: Point,
    /// The other end.
    pub to: Point,
}

impl Facet {
    /// Middle of the segment.
    pub fn midpoint(&self) -> Point {
        [(self.from[0] + self.to[0]) / 2.0, (self.from[1] + self.to[1]) / 2.0]
    }

    /// Length of the segment, in metres.
    pub fn length(&self) -> f64 {
        (self.to[0] - self.from[0]).hypot(self.to[1] - self.from[1])
    }

    /// Unit normal that faces the doorway.
    pub fn normal(&self) -> Point {
        let length = self.length();
        [(self.to[1] - self.from[1]) / length, (self.from[0] - self.to[0]) / length]
    }
}

/// The facets of the map and which of them are foreground (paper, figure 6).
#[derive(Debug, Clone, PartialEq)]
pub struct FacetGrid {
    /// Facets in the published order: by increasing α1, then decreasing α2.
    pub facets: Vec<Facet>,
    /// Per facet: true where moving people are expected (red in figure 6), false for the scene's background (purple).
    pub foreground: Vec<bool>,
    /// The room that the grid covers.
    pub room: Room,
}

impl FacetGrid {
    /// Builds the grid: facets join diagonal corners of the biangular cells (the paper's "graph paper"), transverse to
    /// the doorway. Only facets that meet the spec are kept.
    ///
    /// # Errors
    ///
    /// If a value is out of range, the doorway is wider than the room, or no facet lies in the room.
    pub fn new(doorway: &Doorway, spec: &GridSpec) -> Result<Self, GeometryError> {
        spec.validate(doorway)?;
        let facets = rings(doorway, spec);
        if facets.is_empty() {
            return Err(GeometryError::EmptyGrid);
        }
        let foreground = facets.iter().map(|f| is_foreground(f, &spec.room)).collect();
        Ok(Self { facets, foreground, room: spec.room })
    }

    /// Number of facets, N.
    pub fn len(&self) -> usize {
        self.facets.len()
    }

    /// Never true for a grid that [`FacetGrid::new`] made.
    pub fn is_empty(&self) -> bool {
        self.facets.is_empty()
    }
}

fn rings(doorway: &Doorway, spec: &GridSpec) -> Vec<Facet> {
    use std::f64::consts::PI;

    let line = |k: usize| PI * k as f64 / spec.intervals as f64;
    // If min_angle is a whole number of steps, rounding must not drop the line on one side only.
    let slack = 1e-9;
    // Lines of constant α1 and of constant π − α2: both angles are measured from +x.
    let left: Vec<f64> = (0..=spec.intervals).map(line).filter(|&a| a <= PI - spec.min_angle + slack).collect();
    let right: Vec<f64> = (0..=spec.intervals).map(line).filter(|&a| a >= spec.min_angle - slack).collect();
    let corner = |a_left: f64, a_right: f64| Biangular { alpha1: a_left, alpha2: PI - a_right }.to_point(doorway);
    let mut facets = Vec::new();
    for (i, l) in left.windows(2).enumerate() {
        for (j, r) in right.windows(2).enumerate() {
            if r[0] <= l[0] {
                continue;
            }
            let facet = Facet { from: corner(l[1], r[1]), to: corner(l[0], r[0]) };
            if !keep(&facet, doorway, spec) {
                continue;
            }
            facets.push(facet);
            if j == 0 {
                facets.push(Facet { from: facet.to, to: [facet.to[0], 0.0] });
            }
            if i == left.len() - 2 {
                facets.push(Facet { from: [facet.from[0], 0.0], to: facet.from });
            }
        }
    }
    facets
}

fn keep(facet: &Facet, doorway: &Doorway, spec: &GridSpec) -> bool {
    let distance = |p: Point, q: Point| (p[0] - q[0]).hypot(p[1] - q[1]);
    let edges = super::Side::BOTH.map(|side| doorway.edge(side));
    let mid = facet.midpoint();
    let in_room = mid[0].abs() <= spec.room.half_width_m && (0.0..=spec.room.depth_m).contains(&mid[1]);
    let clear =
        [facet.from, facet.to].iter().all(|&end| edges.iter().all(|&e| distance(end, e) >= spec.edge_clearance_m));
    in_room && clear && edges.iter().map(|&e| distance(mid, e)).sum::<f64>() > spec.near_sum_m
}

/// The published rule: a facet in the middle two thirds of the width and the nearer 5/8 of the depth, or within a fifth
/// of the room's width of the doorway's centre.
fn is_foreground(facet: &Facet, room: &Room) -> bool {
    let ends = [facet.from, facet.to];
    let min_over = |f: fn(&Point) -> f64| ends.iter().map(f).fold(f64::INFINITY, f64::min);
    let width = 2.0 * room.half_width_m;
    (min_over(|p| p[0].abs()) < width / 3.0 && min_over(|p| p[1]) < room.depth_m * 15.0 / 24.0)
        || min_over(|p| p[0].hypot(p[1])) < 0.2 * width
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn doorway(width_m: f64) -> Doorway {
        Doorway { width_m, wall_thickness_m: 0.0, height_m: None, leaf: None }
    }

    #[test]
    fn the_published_grid_has_230_facets_of_which_194_are_foreground() {
        let grid = FacetGrid::new(&doorway(0.508), &GridSpec::published()).expect("grid");
        assert_eq!(grid.len(), 230);
        assert_eq!(grid.foreground.iter().filter(|&&f| f).count(), 194);
    }

    #[test]
    fn a_doorway_wider_than_the_room_is_refused() {
        let error = FacetGrid::new(&doorway(3.2), &GridSpec::published()).expect_err("refused");
        assert_eq!(error.to_string(), "doorway.width_m is 3.2, wider than the room (3 m, room.half_width_m = 1.5)");
    }

    proptest! {
        #[test]
        fn grids_of_any_doorway_are_mirror_symmetric_face_the_door_and_keep_their_rules(
            width in 0.3..2.5f64, half in 1.3..4.0f64, depth in 1.0..6.0f64, intervals in 20..120usize,
        ) {
            let door = doorway(width);
            let spec = GridSpec {
                room: Room { half_width_m: half, depth_m: depth },
                intervals,
                ..GridSpec::published()
            };
            let Ok(grid) = FacetGrid::new(&door, &spec) else { return Ok(()) };
            for f in &grid.facets {
                prop_assert!(f.length() > 0.0);
                prop_assert!(f.from[1] > -1e-12 && f.to[1] > -1e-12);
                // The normal points to the side of the doorway's centre.
                let (m, n) = (f.midpoint(), f.normal());
                prop_assert!(-(m[0] * n[0] + m[1] * n[1]) > 0.0, "{f:?}");
                let close = |p: Point, q: Point| (p[0] + q[0]).abs() < 1e-9 && (p[1] - q[1]).abs() < 1e-9;
                prop_assert!(
                    grid.facets.iter().any(|g| close(g.from, f.to) && close(g.to, f.from)),
                    "no mirror image of {f:?}"
                );
            }
        }
    }
}
