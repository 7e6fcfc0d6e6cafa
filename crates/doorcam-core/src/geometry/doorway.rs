use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::{GeometryError, Leaf, Point};

/// One of the two vertical edges of the doorway, left and right for someone on the visible side who faces the door.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The edge at x = -W/2.
    Left,
    /// The edge at x = +W/2.
    Right,
}

impl Side {
    /// Both edges, left first: the order of every pair in this program.
    pub const BOTH: [Side; 2] = [Side::Left, Side::Right];

    /// The word used in file names and messages.
    pub fn name(self) -> &'static str {
        match self {
            Side::Left => "left",
            Side::Right => "right",
        }
    }
}

/// The doorway: the wall fills -T <= y <= 0, the opening is |x| < W/2 (door frame).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Doorway {
    /// Width W of the opening, in metres.
    pub width_m: f64,
    /// Thickness T of the wall, in metres; 0 for a thin wall.
    #[serde(default)]
    pub wall_thickness_m: f64,
    /// Height of the lintel, in metres; none if the opening has no top.
    #[serde(default)]
    pub height_m: Option<f64>,
    /// The door, if it stands open into the room and is not taken for a part of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leaf: Option<Leaf>,
}

impl Doorway {
    /// Widths that an opening can have, from that of a scale model to that of a gate, in metres.
    pub const WIDTH_M: RangeInclusive<f64> = 0.05..=10.0;
    /// Thicknesses that a wall can have, in metres.
    pub const THICKNESS_M: RangeInclusive<f64> = 0.0..=2.0;
    /// Heights that a lintel can have, in metres.
    pub const HEIGHT_M: RangeInclusive<f64> = 0.05..=20.0;

    const USUAL_WIDTH_M: f64 = 2.0;
    const USUAL_HEIGHT_M: f64 = 3.5;

    /// Checks that the dimensions are possible.
    ///
    /// # Errors
    ///
    /// If a dimension is not a number in the range of [`Self::WIDTH_M`], [`Self::THICKNESS_M`] or [`Self::HEIGHT_M`],
    /// or not one of a [`Leaf`].
    pub fn validate(&self) -> Result<(), GeometryError> {
        length("doorway.width_m", self.width_m, Self::WIDTH_M)?;
        length("doorway.wall_thickness_m", self.wall_thickness_m, Self::THICKNESS_M)?;
        self.height_m.map_or(Ok(()), |height| length("doorway.height_m", height, Self::HEIGHT_M))?;
        self.leaf.map_or(Ok(()), |leaf| leaf.validate())
    }

    /// What is possible but unusual, in one line that names the key.
    pub fn doubt(&self) -> Option<String> {
        let unusual = |key: &str, value: f64, usual: f64| {
            (value > usual).then(|| format!("{key} is {value}, more than the usual {usual} metres: is it in feet?"))
        };
        let height = || unusual("doorway.height_m", self.height_m?, Self::USUAL_HEIGHT_M);
        unusual("doorway.width_m", self.width_m, Self::USUAL_WIDTH_M).or_else(height)
    }

    /// Half the width, in metres: the edges are at x = ±this.
    pub fn half_width(&self) -> f64 {
        self.width_m / 2.0
    }

    /// The foot of an edge on the wall's hidden face, in metres in the door frame.
    pub fn edge(&self, side: Side) -> Point {
        match side {
            Side::Left => [-self.half_width(), 0.0],
            Side::Right => [self.half_width(), 0.0],
        }
    }
}

/// Checks a length in metres. A length that would fit in another unit is answered with that unit.
pub(super) fn length(key: &'static str, value: f64, range: RangeInclusive<f64>) -> Result<(), GeometryError> {
    if range.contains(&value) {
        return Ok(());
    }
    let expected = format!("{} to {} metres{}", range.start(), range.end(), unit_hint(value, *range.end()));
    Err(GeometryError::OutOfRange { key, value, expected })
}

/// Asks for the unit that `value` is probably in, if it is too large for `most` metres.
pub(crate) fn unit_hint(value: f64, most: f64) -> &'static str {
    match value.abs() / most {
        over if !(over > 1.0 && over <= 1e3) => "",
        over if over <= 35.0 => " (is it in centimetres or inches?)",
        _ => " (is it in millimetres?)",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(width_m: f64, wall_thickness_m: f64, height_m: Option<f64>) -> String {
        Doorway { width_m, wall_thickness_m, height_m, leaf: None }.validate().expect_err("refused").to_string()
    }

    #[test]
    fn lengths_that_no_doorway_has_are_refused_with_the_unit_they_may_be_in() {
        assert_eq!(
            refused(80.0, 0.1, None),
            "doorway.width_m is 80, expected 0.05 to 10 metres (is it in centimetres or inches?)"
        );
        assert_eq!(
            refused(800.0, 0.1, None),
            "doorway.width_m is 800, expected 0.05 to 10 metres (is it in millimetres?)"
        );
        assert!(refused(0.8, 12.0, None).contains("thickness_m is 12, expected 0 to 2 metres (is it in centimetres"));
        assert!(
            refused(0.8, 0.1, Some(2100.0)).contains("height_m is 2100, expected 0.05 to 20 metres (is it in mill")
        );
        for width_m in [0.0, -0.0, -0.8, 1e-9, f64::MIN_POSITIVE / 2.0, 1e9, f64::MAX, f64::INFINITY, f64::NAN] {
            assert!(refused(width_m, 0.1, None).ends_with("expected 0.05 to 10 metres"), "{width_m}");
        }
    }

    #[test]
    fn feet_are_doubted_and_metres_are_not() {
        let doubt = |width_m, height_m| Doorway { width_m, wall_thickness_m: 0.1, height_m, leaf: None }.doubt();
        assert_eq!(doubt(0.9, Some(2.1)), None);
        assert!(doubt(2.95, None).unwrap().starts_with("doorway.width_m is 2.95, more than the usual 2 metres"));
        assert!(doubt(0.9, Some(6.9)).unwrap().starts_with("doorway.height_m is 6.9"));
    }
}
