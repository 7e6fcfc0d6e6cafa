use serde::{Deserialize, Serialize};

use super::{GeometryError, Point};

/// One of the two vertical edges of the doorway, left and right for someone on the visible side who faces the door.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
}

impl Doorway {
    /// Checks that the dimensions are possible.
    ///
    /// # Errors
    ///
    /// If a dimension is not finite, the width or height is not positive, or the wall thickness is negative.
    pub fn validate(&self) -> Result<(), GeometryError> {
        let positive = |key, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(GeometryError::OutOfRange { key, value, expected: "a length in metres above 0".into() })
            }
        };
        positive("doorway.width_m", self.width_m)?;
        if !(self.wall_thickness_m.is_finite() && self.wall_thickness_m >= 0.0) {
            return Err(GeometryError::OutOfRange {
                key: "doorway.wall_thickness_m",
                value: self.wall_thickness_m,
                expected: "a length in metres, 0 or above".into(),
            });
        }
        self.height_m.map_or(Ok(()), |h| positive("doorway.height_m", h))
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
