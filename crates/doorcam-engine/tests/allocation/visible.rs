//! Looking at the camera's own side allocates nothing while the same people are in the picture.

use crate::allocations;
use doorcam_core::calibration::{Camera, Homography};
use doorcam_core::geometry::Doorway;
use doorcam_core::visible::{Cells, Grid, Pose, Silhouettes, StillScene, Thumbnail, Walkers};

pub fn check() {
    let doorway = Doorway { width_m: 0.9, wall_thickness_m: 0.1, height_m: None, leaf: None };
    // Straight from above, 220 pixels a metre, the wall's hidden face at row 180: some 2.6 m high.
    let floor = [[-0.5, -0.1], [0.5, -0.1], [0.5, -0.5], [-0.5, -0.5]];
    let points = floor.map(|[x, y]| ([x, y], [320.0 + 220.0 * x, 180.0 - 220.0 * y]));
    let camera = Camera::new(Homography::fit(&points).expect("four points"), None);
    let grid = Grid::new([640, 360]);
    let pose = Pose::of(&camera, [640, 360]).expect("above the floor");
    let mut silhouettes = Silhouettes::new(&pose, grid, &doorway);
    let (mut scene, mut walkers) = (StillScene::new(grid), Walkers::new(&doorway));
    let (mut covered, mut found) = (Cells::new(grid.len()), Vec::with_capacity(3));
    let empty = {
        let mut empty = Thumbnail::new(grid);
        empty.cells_mut().fill([0.3; 3]);
        empty
    };
    scene.learn(&empty);
    let mut somebody = empty;
    // In blue, in the middle of the threshold.
    for row in 12..34 {
        somebody.cells_mut()[row * grid.width + 29..row * grid.width + 51].fill([0.02, 0.03, 0.15]);
    }
    let mut seconds = 0.0;
    let mut look = || {
        seconds += 0.2;
        scene.compare(&somebody, 0.01, false, &mut covered);
        silhouettes.find(&covered, 3, &mut found);
        walkers.step(seconds, &found);
    };
    (0..5).for_each(|_| look());
    assert_eq!(allocations(|| (0..10).for_each(|_| look())), 0);
    assert!(walkers.all().iter().any(doorcam_core::visible::Walker::is_somebody), "{found:?}");
}
