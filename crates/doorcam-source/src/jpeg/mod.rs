//! Decodes JPEGs as webcams send them: some lack Huffman tables, are padded or cut short.

mod bits;
mod broken;
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

/// Where a JPEG's EXIF data are, without their name.
pub(crate) fn exif(bytes: &[u8]) -> Option<Range<usize>> {
    const NAME: &[u8] = b"Exif\0\0";
    let (_, found) = outline::header_segments(bytes)
        .find(|(marker, range)| *marker == 0xe1 && bytes[range.clone()].starts_with(NAME))?;
    Some(found.start + NAME.len()..found.end)
}

/// A JPEG's width and height, by its frame header.
pub(crate) fn size(bytes: &[u8]) -> Option<(usize, usize)> {
    let is_frame = |marker: u8| matches!(marker, 0xc0..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc));
    let (_, frame) = outline::header_segments(bytes).find(|(marker, _)| is_frame(*marker))?;
    let frame = &bytes[frame];
    Some((outline::big_endian(frame.get(3..5)?), outline::big_endian(frame.get(1..3)?)))
}

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
#[derive(Debug, Clone)]
pub(super) struct JpegReader {
    depth: JpegDepth,
    eight: EightBit,
    exact: Box<Exact>,
    lacked_end: bool,
    /// Where an image goes that is only decoded to see whether it is whole.
    checked: Image,
}

impl Default for JpegReader {
    fn default() -> Self {
        Self::new(JpegDepth::default())
    }
}

impl JpegReader {
    pub(super) fn new(depth: JpegDepth) -> Self {
        let (eight, exact, checked) = (EightBit::default(), Box::default(), Image::empty());
        Self { depth, eight, exact, lacked_end: false, checked }
    }

    /// Whether the JPEG that was decoded last lacked its end marker.
    pub(super) fn lacked_end(&self) -> bool {
        self.lacked_end
    }

    /// Decodes `rows` into `image`, whose other rows are undefined. An error if anything of these rows is missing, or
    /// if the markers show that anything else is: gaps in the restart markers, or no end marker, unless all data are
    /// there and only the marker is not.
    pub(super) fn decode_into(
        &mut self,
        bytes: &[u8],
        expected: Option<(usize, usize)>,
        rows: Range<usize>,
        image: &mut Image,
    ) -> Result<(), ImageError> {
        let outline = Outline::of(bytes)?;
        self.lacked_end = false;
        let decoded = self.decode_outlined(bytes, &outline, expected, rows, image);
        match decoded {
            Err(ImageError::Jpeg(_)) if !outline.ended => Err(outline::cut_off()),
            decoded => {
                self.lacked_end = decoded.is_ok() && !outline.ended;
                decoded
            }
        }
    }

    fn decode_outlined(
        &mut self,
        bytes: &[u8],
        outline: &Outline,
        expected: Option<(usize, usize)>,
        rows: Range<usize>,
        image: &mut Image,
    ) -> Result<(), ImageError> {
        outline.check_restarts()?;
        if self.depth == JpegDepth::Exact || !outline.ended {
            let bytes = &bytes[..outline.end];
            match self.exact.header(bytes, outline) {
                Some(header) if self.depth == JpegDepth::Exact => {
                    return self.exact.decode(bytes, &header, outline, expected, rows, image);
                }
                // The 8-bit decoder does not notice if the last few bytes are missing.
                Some(header) if !outline.ended => {
                    self.exact.decode(bytes, &header, outline, expected, 0..1, &mut self.checked)?;
                }
                // Of a JPEG in several scans, whole scans may be missing.
                None if !outline.ended => return Err(outline::cut_off()),
                _ => {}
            }
        }
        self.eight.decode(bytes, outline, expected, image)
    }
}
