//! Floor lines around the doorway, to be drawn over the camera's image.

use serde::Serialize;

use crate::calibration::Camera;
use crate::geometry::{Doorway, Point, Side};
use crate::transport::PatchGrid;

/// Floor lines as the camera sees them, lens distortion included: image positions in pixels, (0, 0) the centre of the
/// top-left pixel. Parts that are not in front of the camera, or far outside its image, are left out.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Overlay {
    /// Feet of the left and the right edge, on the wall's visible face; none if not in front of the camera.
    #[cfg_attr(feature = "schema", schema(value_type = Vec<Option<crate::schema::Pixel>>, min_items = 2, max_items = 2))]
    pub edges: [Option<Point>; 2],
    /// The line between them.
    #[cfg_attr(feature = "schema", schema(value_type = Vec<crate::schema::Pixel>))]
    pub door_line: Vec<Point>,
    /// Outlines of the patches, closed, starting at the corner at the wall with the smallest x.
    pub patches: Outlines,
    /// Grid lines every 0.1 m: those along x start at the wall, those along y at the middle of the door.
    #[cfg_attr(feature = "schema", schema(value_type = Vec<Vec<crate::schema::Pixel>>))]
    pub grid: Vec<Vec<Point>>,
}

/// An outline for each patch.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Outlines {
    /// At the left edge.
    #[cfg_attr(feature = "schema", schema(value_type = Vec<crate::schema::Pixel>))]
    pub left: Vec<Point>,
    /// At the right edge.
    #[cfg_attr(feature = "schema", schema(value_type = Vec<crate::schema::Pixel>))]
    pub right: Vec<Point>,
}

/// Spacing of the grid lines, in metres.
const GRID_M: f64 = 0.1;

/// Spacing of the points along a line, in metres on the floor. Lines need intermediate points because the lens may bend
/// them and they may leave the image.
const STEP_M: f64 = 0.02;

/// How far the grid extends beyond the patches, in metres.
const BEYOND_M: f64 = 0.4;

impl Overlay {
    /// The overlay for images of `size` (width, height) in pixels.
    pub fn new(camera: &Camera, size: [usize; 2], doorway: &Doorway, patch: &PatchGrid) -> Self {
        let sight = Sight { camera, size: size.map(|n| n as f64) };
        let wall = -doorway.wall_thickness_m;
        let feet = Side::BOTH.map(|side| [doorway.edge(side)[0], wall]);
        let outline = |foot: Point| {
            let (near, far) = (foot[0] - patch.fov_m / 2.0, foot[0] + patch.fov_m / 2.0);
            let end = wall - patch.fov_m;
            let corners = [[near, wall], [far, wall], [far, end], [near, end]];
            let side = |k: usize| sight.points(corners[k], corners[(k + 1) % 4]);
            // The last point of each side is the first of the next.
            (0..4).flat_map(|k| side(k).into_iter().rev().skip(1).rev().flatten().collect::<Vec<_>>()).collect()
        };
        let (half, depth) = (doorway.half_width() + patch.fov_m / 2.0 + BEYOND_M, patch.fov_m + BEYOND_M);
        let count = |length: f64| (length / GRID_M).ceil() as i64;
        let x = |k: i64| k as f64 * GRID_M;
        let y = |k: i64| wall - k as f64 * GRID_M;
        let (across, down) = (count(half), count(depth));
        let along_x = (0..=down).map(|k| ([x(-across), y(k)], [x(across), y(k)]));
        let along_y = (-across..=across).map(|k| ([x(k), y(0)], [x(k), y(down)]));
        Self {
            edges: feet.map(|foot| camera.project(foot)),
            door_line: sight.points(feet[0], feet[1]).into_iter().flatten().collect(),
            patches: Outlines { left: outline(feet[0]), right: outline(feet[1]) },
            grid: along_x.chain(along_y).flat_map(|(from, to)| sight.lines(from, to)).collect(),
        }
    }
}

/// Projects floor lines into the image.
struct Sight<'a> {
    camera: &'a Camera,
    size: [f64; 2],
}

impl Sight<'_> {
    /// Image positions of points from one floor position to another, ends included; `None` where they are not seen.
    fn points(&self, from: Point, to: Point) -> Vec<Option<Point>> {
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        // The tolerance keeps a rounding error from adding a step.
        let steps = (length / STEP_M - 1e-6).ceil().clamp(1.0, 10_000.0) as usize;
        let at = |k: usize| [0, 1].map(|c| from[c] + (to[c] - from[c]) * k as f64 / steps as f64);
        (0..=steps).map(|k| self.camera.project(at(k)).filter(|&p| self.near_image(p))).collect()
    }

    /// The visible parts of a line.
    fn lines(&self, from: Point, to: Point) -> Vec<Vec<Point>> {
        let points = self.points(from, to);
        let seen = points.split(Option::is_none).map(|run| run.iter().copied().flatten().collect::<Vec<_>>());
        seen.filter(|line| line.len() > 1).collect()
    }

    /// Whether a position is in the image or within one image size of it. Further out, near the horizon, lines run off
    /// to infinity.
    fn near_image(&self, p: Point) -> bool {
        p.iter().zip(self.size).all(|(&at, size)| (-size..2.0 * size).contains(&at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::pinhole::Pinhole;
    use crate::calibration::{FloorFit, LensMap};
    use crate::optics::{FloorPoint, Lens};
    use crate::transport::PixelLayout;

    const DOORWAY: Doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.12, height_m: None, leaf: None };
    const PATCH: PatchGrid = PatchGrid { size: 64, fov_m: 0.3, layout: PixelLayout::Cells };
    const SIZE: [usize; 2] = [640, 360];

    /// A camera 1.2 m in front of the wall, with or without a lens.
    fn camera(lens: Option<LensMap>) -> Camera {
        let pinhole =
            Pinhole { at: [0.1, -1.3, 1.1], tilt: 0.8, turn: -0.1, roll: 0.05, focal: 480.0, centre: [319.5, 179.5] };
        let floor: [Point; 4] = [[-0.5, -0.1], [0.5, -0.1], [0.5, -0.5], [-0.5, -0.5]];
        let see = |floor_m| FloorPoint { pixel: pinhole.see(floor_m).unwrap(), floor_m };
        let straight = FloorFit::new(&floor.map(see), None).unwrap();
        Camera::new(straight.camera().homography().clone(), lens)
    }

    #[test]
    fn lines_are_where_the_camera_sees_the_floor() {
        let lens = LensMap::new(&Lens { k1: -0.15, k2: 0.02, focal_px: Some(480.0) }, SIZE).unwrap();
        for camera in [camera(None), camera(Some(lens))] {
            let overlay = Overlay::new(&camera, SIZE, &DOORWAY, &PATCH);
            assert_eq!(overlay.edges, [camera.project([-0.4, -0.12]), camera.project([0.4, -0.12])]);
            assert_eq!(overlay.door_line.first().copied(), overlay.edges[0]);
            assert_eq!(overlay.door_line.last().copied(), overlay.edges[1]);
            for (outline, x) in [(&overlay.patches.left, -0.4), (&overlay.patches.right, 0.4)] {
                assert_eq!(outline.len(), 60, "15 steps of 2 cm a side");
                for point in outline {
                    let floor = camera.floor(*point).unwrap();
                    let beside = [(floor[0] - x).abs() - 0.15, (floor[1] + 0.27).abs() - 0.15];
                    assert!(beside[0].max(beside[1]).abs() < 1e-9, "{floor:?} is on the outline");
                }
            }
            for line in &overlay.grid {
                let floor: Vec<_> = line.iter().map(|&p| camera.floor(p).unwrap()).collect();
                let on = |c: usize, zero: f64| {
                    let k = (floor[0][c] - zero) / GRID_M;
                    (k - k.round()).abs() < 1e-6 && floor.iter().all(|f| (f[c] - floor[0][c]).abs() < 1e-9)
                };
                assert!(on(0, 0.0) || on(1, -0.12), "{floor:?}");
                assert!(floor.iter().all(|f| f[1] < -0.12 + 1e-9), "on the visible side");
            }
            assert!(overlay.grid.len() > 15);
        }
    }

    #[test]
    fn what_is_behind_the_camera_is_left_out() {
        // The camera is above the patches and looks away to the right.
        let pinhole =
            Pinhole { at: [0.2, -0.4, 0.3], tilt: 0.5, turn: 1.4, roll: 0.0, focal: 480.0, centre: [319.5, 179.5] };
        let floor: [Point; 4] = [[0.6, -0.2], [1.2, -0.1], [1.3, -0.6], [0.7, -0.5]];
        let see = |floor_m| FloorPoint { pixel: pinhole.see(floor_m).unwrap(), floor_m };
        let fit = FloorFit::new(&floor.map(see), None).unwrap();
        let overlay = Overlay::new(fit.camera(), SIZE, &DOORWAY, &PATCH);
        assert_eq!(overlay.edges[0], None);
        assert!(overlay.patches.left.is_empty() && !overlay.grid.is_empty());
        let all = overlay.grid.iter().flatten().chain(&overlay.door_line).chain(&overlay.patches.right);
        assert!(all.flatten().all(|v| v.is_finite() && v.abs() < 1300.0));
    }
}
