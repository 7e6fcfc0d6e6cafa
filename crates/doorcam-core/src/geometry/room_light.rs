use serde::{Deserialize, Serialize};

use super::Point;
use crate::scene::Rgb;

/// What a light of the room is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum LightKind {
    /// A window or a glass door, with the light of the day.
    Window,
    /// A lamp, or a lit panel.
    Lamp,
    /// A television or another screen.
    Screen,
}

/// Something bright in the hidden room that people may stand in front of: an upright strip of even light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct RoomLight {
    /// What it is.
    pub kind: LightKind,
    /// One end of it on the floor plan, in metres in the door frame; of a panel under the ceiling, an end of its middle.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Point))]
    pub from_m: Point,
    /// The other end.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Point))]
    pub to_m: Point,
    /// Its lower and its upper edge, in metres above the floor.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Pair))]
    pub height_m: [f64; 2],
    /// Whether it is lit.
    #[serde(default = "lit")]
    pub on: bool,
}

/// Something bright in the hidden room that was found in the picture of the empty floor. Its direction is known; its
/// distance and height are what explains the floor, and may be others.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct FoundLight {
    /// One end of it on the floor plan, in metres in the door frame.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Point))]
    pub from_m: Point,
    /// The other end.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Point))]
    pub to_m: Point,
    /// Its lower and its upper edge, in metres above the floor.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Pair))]
    pub height_m: [f64; 2],
    /// Its radiance beyond what is usual in the room: light on the floor per steradian, relative to full scale.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Rgb))]
    pub rgb: Rgb,
}

fn lit() -> bool {
    true
}

/// Why a light cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LightError {
    /// An end that is far away, or not behind the wall.
    #[error("has {key} {value:?}, expected x from -{FARTHEST_M} to {FARTHEST_M} and y from 0 to {FARTHEST_M} metres")]
    Place {
        /// `from_m` or `to_m`.
        key: &'static str,
        /// The place given.
        value: Point,
    },
    /// Two ends in one place, or nearly so.
    #[error("is {0} m wide from from_m to to_m, expected at least {NARROWEST_M} m")]
    Width(f64),
    /// Heights in the wrong order or where no room is.
    #[error("has height_m {0:?}, expected its lower and its upper edge, from 0 to {HIGHEST_M} metres")]
    Height([f64; 2]),
}

/// Lights farther away than this do not matter, in metres.
const FARTHEST_M: f64 = 20.0;
/// Nor do lights above this, in metres.
const HIGHEST_M: f64 = 10.0;
/// Least width of a light, in metres.
const NARROWEST_M: f64 = 0.01;

impl RoomLight {
    /// Checks that a room can have such a light.
    ///
    /// # Errors
    ///
    /// If an end is far away or not in the hidden room, both ends are in one place, or the upper edge is not above the
    /// lower one.
    pub fn check(&self) -> Result<(), LightError> {
        for (key, value) in [("from_m", self.from_m), ("to_m", self.to_m)] {
            if !(value[0].abs() <= FARTHEST_M && (0.0..=FARTHEST_M).contains(&value[1])) {
                return Err(LightError::Place { key, value });
            }
        }
        let width = (self.to_m[0] - self.from_m[0]).hypot(self.to_m[1] - self.from_m[1]);
        if width < NARROWEST_M {
            return Err(LightError::Width(width));
        }
        let [lower, upper] = self.height_m;
        if !(0.0 <= lower && lower < upper && upper <= HIGHEST_M) {
            return Err(LightError::Height(self.height_m));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: RoomLight =
        RoomLight { kind: LightKind::Window, from_m: [-0.2, 4.5], to_m: [1.0, 4.5], height_m: [0.9, 2.1], on: true };

    #[test]
    fn lights_are_behind_the_wall_and_have_a_size() {
        assert_eq!(WINDOW.check(), Ok(()));
        let refused = |light: RoomLight| light.check().unwrap_err().to_string();
        assert_eq!(
            refused(RoomLight { to_m: [1.0, -4.5], ..WINDOW }),
            "has to_m [1.0, -4.5], expected x from -20 to 20 and y from 0 to 20 metres"
        );
        assert!(refused(RoomLight { from_m: [f64::NAN, 4.5], ..WINDOW }).starts_with("has from_m [NaN, 4.5]"));
        assert_eq!(
            refused(RoomLight { to_m: WINDOW.from_m, ..WINDOW }),
            "is 0 m wide from from_m to to_m, expected at least 0.01 m"
        );
        for height_m in [[2.1, 0.9], [1.0, 1.0], [-0.1, 2.0], [90.0, 210.0], [0.0, f64::NAN]] {
            assert!(refused(RoomLight { height_m, ..WINDOW }).starts_with("has height_m"), "{height_m:?}");
        }
    }

    #[test]
    fn a_light_is_on_unless_it_is_said_to_be_off() {
        let text = r#"{"kind": "window", "from_m": [-0.2, 4.5], "to_m": [1, 4.5], "height_m": [0.9, 2.1]"#;
        let parse = |text: String| serde_json::from_str::<RoomLight>(&text).unwrap();
        assert_eq!(parse(format!("{text}}}")), WINDOW);
        assert_eq!(parse(format!("{text}, \"on\": false}}")), RoomLight { on: false, ..WINDOW });
    }
}
