//! The figures for print: the reconstruction as SVG and PNG, and the colour-magnified difference (paper: figures 7 to
//! 10, 13, 14).
//!
//! The same input gives the same bytes. A value that is not finite is drawn as no change and never reaches the SVG.

mod axes;
mod bound;
mod colour;
mod crossings;
mod curves;
mod difference;
mod evaluation;
mod evaluation_picture;
mod figure;
mod frame;
mod legend;
mod panel;
mod plan;
mod raster;
mod text;
mod timeline;

#[cfg(test)]
mod tests;

pub use bound::{BoundPanel, BoundPicture, Region, bound_svg};
pub use curves::{Curve, CurvesPanel, CurvesPicture, curves_svg};
pub use difference::{difference_png, patches_png};
pub use evaluation::evaluation_svg;
pub use evaluation_picture::EvaluationPicture;
pub use figure::{ReconstructionPicture, reconstruction_svg};
pub use raster::png;

/// Why a picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The text is not an SVG that can be drawn.
    #[error("the SVG cannot be drawn: {0}")]
    Svg(#[from] resvg::usvg::Error),
    /// The picture would be empty or too large to hold in memory.
    #[error(
        "a picture of {width} x {height} pixels cannot be made: expected 1 to {max_side} pixels a side and at most {max_pixels} in all"
    )]
    Size {
        /// Wanted width, in pixels.
        width: u64,
        /// Height that follows from it, in pixels.
        height: u64,
        /// Maximum width and height.
        max_side: u64,
        /// Maximum product of both.
        max_pixels: u64,
    },
    /// The PNG could not be written.
    #[error("the PNG cannot be written: {0}")]
    Encode(#[from] image::ImageError),
}
