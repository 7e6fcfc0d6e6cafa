//! Why bytes are not an image, for all decoders.

use doorcam_core::image::MOST_PIXELS;

use super::sensor::SensorPixels;

/// Why bytes are not an image, or an image cannot be encoded.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// Neither a JPEG nor a PNG by its first bytes.
    #[error("neither a JPEG nor a PNG image")]
    UnknownFormat,
    /// A broken or truncated JPEG.
    #[error("broken JPEG: {0}")]
    Jpeg(String),
    /// A broken or truncated PNG.
    #[error("broken PNG: {0}")]
    Png(String),
    /// The image does not have the expected size.
    #[error("the image has {} x {} pixels, expected {} x {}", got.0, got.1, expected.0, expected.1)]
    WrongSize {
        /// Its width and height.
        got: (usize, usize),
        /// The expected width and height.
        expected: (usize, usize),
    },
    /// The image has more pixels than are decoded.
    #[error("the image has {0} x {1} pixels, expected at most as many as 7680 x 4320")]
    TooLarge(usize, usize),
    /// A raw frame with too few bytes.
    #[error("the raw frame has {got} bytes, expected at least {expected}")]
    Short {
        /// Bytes of the frame.
        got: usize,
        /// Bytes that its format needs.
        expected: usize,
    },
    /// An impossible layout of raw frames.
    #[error("a raw frame of {width} x {height} pixels ({pixels:?}) cannot have rows of {stride} bytes")]
    SensorFormat {
        /// Pixels across.
        width: usize,
        /// Pixels down.
        height: usize,
        /// Bytes a row.
        stride: usize,
        /// Order and subsampling.
        pixels: SensorPixels,
    },
    /// An image that a JPEG cannot hold.
    #[error("an image of {0} x {1} pixels does not fit into a JPEG")]
    Encode(usize, usize),
}

/// An error if the sizes (width, height) differ, or if the image is too large to decode: a file of a few hundred bytes
/// may claim any size.
pub(crate) fn check_size(got: (usize, usize), expected: Option<(usize, usize)>) -> Result<(), ImageError> {
    match expected {
        Some(expected) if got != expected => Err(ImageError::WrongSize { got, expected }),
        _ if got.0.saturating_mul(got.1) > MOST_PIXELS => Err(ImageError::TooLarge(got.0, got.1)),
        _ => Ok(()),
    }
}

pub(crate) fn one_line(error: &dyn std::fmt::Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
