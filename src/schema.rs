//! Shapes of plain arrays in JSON, for the API's description: the program's own types for them are aliases, which have no
//! name to be described by.
#![expect(dead_code, reason = "only their shapes matter")]

use serde::Serialize;
use serde::de::{Deserialize, Deserializer, Error, Unexpected};
use utoipa::ToSchema;

/// A place on the floor plan: `[x, y]` in the door frame, in metres. The origin is on the floor in the middle of the opening,
/// in the wall's hidden face; x to the right for who faces the door from the visible side, y into the hidden room.
#[derive(ToSchema)]
pub(crate) struct Point(f64, f64);

/// A position in the camera's image: `[u, v]` in pixels, `[0, 0]` the centre of the top-left pixel.
#[derive(ToSchema)]
pub(crate) struct Pixel(f64, f64);

/// Two numbers, one for each axis.
#[derive(ToSchema)]
pub(crate) struct Pair(f64, f64);

/// Width and height, in pixels.
#[derive(ToSchema)]
pub(crate) struct Size(usize, usize);

/// Reads two whole numbers; 640.0 is one, too, as JSON has it.
pub(crate) fn whole<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[usize; 2], D::Error> {
    let numbers = <[f64; 2]>::deserialize(deserializer)?;
    // What is too large for anything is for others to refuse: they know what it is.
    let is_whole = |number: f64| number >= 0.0 && number.fract() == 0.0;
    match numbers.into_iter().find(|&number| !is_whole(number)) {
        Some(number) => Err(D::Error::invalid_value(Unexpected::Float(number), &"a whole number")),
        None => Ok(numbers.map(|number| number as usize)),
    }
}

/// `[red, green, blue]`, linear light relative to full scale.
#[derive(ToSchema)]
pub(crate) struct Rgb(f64, f64, f64);

/// A row of a 2 x 2 matrix, in m².
#[derive(ToSchema)]
pub(crate) struct Row(f64, f64);

/// A symmetric matrix `[[xx, xy], [xy, yy]]`, in m².
#[derive(ToSchema)]
#[schema(min_items = 2, max_items = 2)]
pub(crate) struct Covariance(Vec<Row>);

/// The ends of a facet on the floor plan.
#[derive(ToSchema)]
#[schema(min_items = 2, max_items = 2)]
pub(crate) struct Segment(Vec<Point>);

/// A number, or a word that stands for one.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
pub(crate) enum NumberOrWord {
    /// The number.
    Number(f64),
    /// The word.
    Word(String),
}
