//! Decodes JPEGs as webcams send them: some lack Huffman tables, are padded or cut short.

mod bits;
mod colour;
mod eight;
mod exact;
mod header;
mod huffman;
mod idct;
mod outline;
#[cfg(test)]
mod reference;
mod standard;
#[cfg(test)]
mod tests;

use std::ops::Range;

use eight::EightBit;
use exact::Exact;
use outline::Outline;

use crate::image_error::ImageError;
use doorcam_core::image::Image;

/// Precision to which JPEGs are decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JpegDepth {
    /// 8 bits a sample, as other decoders do: for people, and to reproduce published measurements.
    #[default]
    Eight,
    /// 16 bits a sample, without intermediate rounding: for measuring. Only for sequential JPEGs with a single scan;
    /// others, which no camera makes, are decoded to 8 bits.
    Exact,
}

/// Decodes JPEG after JPEG, reusing its buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct JpegReader {
    depth: JpegDepth,
    eight: EightBit,
    exact: Box<Exact>,
}

impl JpegReader {
    pub(super) fn new(depth: JpegDepth) -> Self {
        Self { depth, ..Self::default() }
    }

    /// Decodes `rows` into `image`, whose other rows are undefined. An error if anything of these rows is missing, or
    /// if the markers show that anything else is: no end marker, gaps in the restart markers.
    pub(super) fn decode_into(
        &mut self,
        bytes: &[u8],
        expected: Option<(usize, usize)>,
        rows: Range<usize>,
        image: &mut Image,
    ) -> Result<(), ImageError> {
        let outline = Outline::of(bytes)?;
        outline.check_restarts()?;
        if self.depth == JpegDepth::Exact {
            let bytes = &bytes[..outline.end];
            if let Some(header) = self.exact.header(bytes, &outline) {
                return self.exact.decode(bytes, &header, expected, rows, image);
            }
        }
        self.eight.decode(bytes, &outline, expected, image)
    }
}
