//! JPEGs as webcams send them: without Huffman tables, padded, cut short.

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

use super::image::ImageError;
use doorcam_core::image::Image;

/// How exactly JPEGs are decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JpegDepth {
    /// To 8 bits a sample, as everybody does: for people, and to have what others measured.
    #[default]
    Eight,
    /// To 16 bits a sample, without rounding on the way: for measuring. Only sequential JPEGs with a single scan; others,
    /// which no camera makes, come with 8 bits.
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

    /// Decodes `rows` into `image`, the other rows of which are undefined; an error if anything of these rows is missing,
    /// or can be seen to be missing without decoding the others: the end, restart markers.
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
