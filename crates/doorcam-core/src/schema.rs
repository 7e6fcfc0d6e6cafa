//! Shapes of plain JSON arrays for the API description: the program's own types for them are aliases, which have no
//! name in the schema.
#![expect(dead_code, reason = "only their shapes matter")]

use serde::Serialize;
use utoipa::ToSchema;

/// A place on the floor plan: `[x, y]` in the door frame, in metres. The origin is on the floor in the middle of the
/// opening, in the plane of the wall's hidden face; x points to the right for someone on the visible side who faces the
/// door, y into the hidden room.
#[derive(ToSchema)]
pub struct Point(f64, f64);

/// A position in the camera's image: `[u, v]` in pixels; `[0, 0]` is the centre of the top-left pixel.
#[derive(ToSchema)]
pub struct Pixel(f64, f64);

/// Two numbers, one per axis.
#[derive(ToSchema)]
pub struct Pair(f64, f64);

/// Width and height, in pixels.
#[derive(ToSchema)]
pub struct Size(usize, usize);

/// `[red, green, blue]`, linear light relative to full scale.
#[derive(ToSchema)]
pub struct Rgb(f64, f64, f64);

/// A row of a 2 x 2 matrix, in m².
#[derive(ToSchema)]
pub struct Row(f64, f64);

/// A symmetric matrix `[[xx, xy], [xy, yy]]`, in m².
#[derive(ToSchema)]
#[schema(min_items = 2, max_items = 2)]
pub struct Covariance(Vec<Row>);

/// The two ends of a facet on the floor plan.
#[derive(ToSchema)]
#[schema(min_items = 2, max_items = 2)]
pub struct Segment(Vec<Point>);

/// A number, or a word that stands for one.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
pub enum NumberOrWord {
    /// The number.
    Number(f64),
    /// The word.
    Word(String),
}
