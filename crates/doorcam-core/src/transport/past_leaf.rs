use super::{Body, FloorView, PatchGrid};
use crate::geometry::{Doorway, Point, Side};

/// Floor points along each side of a patch that stand for all of it.
const ALONG: usize = 4;
/// Somebody counts as seen by a patch if at least this share of their light passes the leaf.
const SEEN: f64 = 0.5;
/// The body for which it is decided: its radius and height, in metres.
const BODY_M: [f64; 2] = [0.2, 1.7];

/// From which patches a place in the hidden room can be seen past the door's leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct PastLeaf {
    doorway: Doorway,
    /// The same without the leaf.
    open: Doorway,
    /// Per side, the views of some floor points with the leaf and without it.
    views: [Vec<[FloorView; 2]>; 2],
}

impl PastLeaf {
    /// `None` for a doorway without a leaf.
    pub fn new(doorway: &Doorway, patch: &PatchGrid) -> Option<Self> {
        doorway.leaf?;
        let open = Doorway { leaf: None, ..*doorway };
        let some = PatchGrid { size: ALONG, fov_m: patch.fov_m, layout: super::PixelLayout::Cells };
        let views = Side::BOTH.map(|side| {
            let points = some.points(doorway, side).into_iter();
            points.map(|point| [doorway, &open].map(|doorway| FloorView::new(doorway, point))).collect()
        });
        Some(Self { doorway: *doorway, open, views })
    }

    /// Whether the left and the right patch see somebody at a place, as far as the leaf is concerned: whom the wall
    /// hides, the leaf does not.
    pub fn sees(&self, centre: Point) -> [bool; 2] {
        let [radius_m, height_m] = BODY_M;
        let body = Body { centre, radius_m, height_m };
        self.views.each_ref().map(|views| {
            let light =
                |k: usize, doorway: &Doorway| views.iter().map(|view| view[k].body(doorway, &body)).sum::<f64>();
            light(0, &self.doorway) >= SEEN * light(1, &self.open)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Leaf;
    use crate::transport::PixelLayout;

    const PATCH: PatchGrid = PatchGrid { size: 64, fov_m: 0.3, layout: PixelLayout::Cells };

    fn past(hinge: Side, angle_deg: f64) -> PastLeaf {
        let leaf = Some(Leaf { hinge, angle_deg, width_m: 0.84 });
        let doorway = Doorway { width_m: 0.86, wall_thickness_m: 0.11, height_m: Some(2.0), leaf };
        PastLeaf::new(&doorway, &PATCH).unwrap()
    }

    #[test]
    fn who_is_behind_the_leaf_is_seen_past_the_other_edge_only() {
        let [left, right] = [past(Side::Left, 98.0), past(Side::Right, 98.0)];
        // Beside the leaf's free edge; in front of it; far to the other side.
        for (place, expected) in [([-0.9, 2.2], [false, true]), ([0.0, 0.9], [true, true]), ([1.0, 2.0], [true, true])]
        {
            assert_eq!(left.sees(place), expected, "{place:?}");
            let [l, r] = expected;
            assert_eq!(right.sees([-place[0], place[1]]), [r, l], "{place:?}");
        }
        // Back against the wall it hides nobody.
        let back = past(Side::Left, 180.0);
        assert!([[-0.9, 2.2], [-1.2, 1.0], [0.3, 0.8]].iter().all(|&place| back.sees(place) == [true; 2]));
    }

    #[test]
    fn an_open_doorway_has_none() {
        let open = Doorway { width_m: 0.86, wall_thickness_m: 0.11, height_m: None, leaf: None };
        assert_eq!(PastLeaf::new(&open, &PATCH), None);
    }
}
