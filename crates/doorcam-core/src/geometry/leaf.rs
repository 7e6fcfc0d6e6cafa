use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::{Doorway, GeometryError, Point, Side};

/// The door itself, which stands open into the hidden room and hides a part of it from the floor.
///
/// It is taken for a thin upright panel from the floor to the lintel. It turns about the foot of one edge on the wall's
/// hidden face.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Leaf {
    /// The edge that it hangs on, for someone on the visible side who faces the door.
    pub hinge: Side,
    /// How far it is open, in degrees: 0 would be closed, 90 is straight into the room, 180 back against the wall.
    pub angle_deg: f64,
    /// From the hinge to its free edge, in metres.
    pub width_m: f64,
}

impl Leaf {
    /// Angles that a leaf can have, in degrees. A door that is closed shows nothing.
    pub const ANGLE_DEG: RangeInclusive<f64> = 5.0..=180.0;
    /// Widths that a leaf can have, in metres.
    pub const WIDTH_M: RangeInclusive<f64> = Doorway::WIDTH_M;

    /// Checks that a door can stand like this.
    ///
    /// # Errors
    ///
    /// If angle or width is not in the range of [`Self::ANGLE_DEG`] or [`Self::WIDTH_M`].
    pub fn validate(&self) -> Result<(), GeometryError> {
        super::doorway::length("doorway.leaf.width_m", self.width_m, Self::WIDTH_M)?;
        if Self::ANGLE_DEG.contains(&self.angle_deg) {
            return Ok(());
        }
        Err(GeometryError::OutOfRange {
            key: "doorway.leaf.angle_deg",
            value: self.angle_deg,
            expected: format!(
                "{} to {} degrees (0 would be closed, 90 is straight into the room, 180 back against the wall)",
                Self::ANGLE_DEG.start(),
                Self::ANGLE_DEG.end()
            ),
        })
    }

    /// Where it stands on the floor of a doorway: hinge and free edge, in metres in the door frame.
    pub fn ends(&self, doorway: &Doorway) -> [Point; 2] {
        let [x, y] = doorway.edge(self.hinge);
        let (sine, cosine) = self.angle_deg.to_radians().sin_cos();
        let closing = match self.hinge {
            Side::Left => 1.0,
            Side::Right => -1.0,
        };
        [[x, y], [x + closing * self.width_m * cosine, y + self.width_m * sine]]
    }
}

impl Doorway {
    /// Where the leaf stands, if there is one: hinge and free edge, in metres in the door frame.
    pub fn leaf_ends(&self) -> Option<[Point; 2]> {
        self.leaf.map(|leaf| leaf.ends(self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOOR: Doorway = Doorway { width_m: 0.9, wall_thickness_m: 0.1, height_m: None, leaf: None };

    #[test]
    fn a_leaf_turns_about_its_edge_into_the_room() {
        let free = |hinge, angle_deg| Leaf { hinge, angle_deg, width_m: 0.8 }.ends(&DOOR);
        let near = |[_, found]: [Point; 2], expected: Point| {
            assert!((found[0] - expected[0]).hypot(found[1] - expected[1]) < 1e-12, "{found:?} {expected:?}");
        };
        assert_eq!(free(Side::Left, 30.0)[0], [-0.45, 0.0]);
        near(free(Side::Left, 0.0), [0.35, 0.0]);
        near(free(Side::Left, 90.0), [-0.45, 0.8]);
        near(free(Side::Left, 180.0), [-1.25, 0.0]);
        near(free(Side::Right, 60.0), [0.05, 0.8 * 0.75_f64.sqrt()]);
        near(free(Side::Right, 120.0), [0.85, 0.8 * 0.75_f64.sqrt()]);
    }

    #[test]
    fn leaves_that_no_door_has_are_refused_in_one_line() {
        let refused = |angle_deg, width_m| {
            let leaf = Some(Leaf { hinge: Side::Left, angle_deg, width_m });
            Doorway { leaf, ..DOOR }.validate().expect_err("refused").to_string()
        };
        assert_eq!(
            refused(190.0, 0.8),
            "doorway.leaf.angle_deg is 190, expected 5 to 180 degrees (0 would be closed, 90 is straight into the \
             room, 180 back against the wall)"
        );
        assert!(refused(f64::NAN, 0.8).starts_with("doorway.leaf.angle_deg is NaN, expected 5 to 180 degrees"));
        assert!(refused(-98.0, 0.8).starts_with("doorway.leaf.angle_deg is -98"));
        assert_eq!(
            refused(98.0, 84.0),
            "doorway.leaf.width_m is 84, expected 0.05 to 10 metres (is it in centimetres or inches?)"
        );
    }

    #[test]
    fn doorways_without_a_leaf_are_read_and_written_as_ever() {
        let text = r#"{"width_m":0.9,"wall_thickness_m":0.1,"height_m":null}"#;
        let doorway: Doorway = serde_json::from_str(text).unwrap();
        assert_eq!((doorway, serde_json::to_string(&doorway).unwrap().as_str()), (DOOR, text));
        let with = r#"{"width_m": 0.9, "wall_thickness_m": 0.1, "height_m": null,
                       "leaf": {"hinge": "left", "angle_deg": 98, "width_m": 0.84}}"#;
        let doorway: Doorway = serde_json::from_str(with).unwrap();
        assert_eq!(doorway.leaf, Some(Leaf { hinge: Side::Left, angle_deg: 98.0, width_m: 0.84 }));
        assert_eq!(serde_json::from_str::<Doorway>(&serde_json::to_string(&doorway).unwrap()).unwrap(), doorway);
    }
}
