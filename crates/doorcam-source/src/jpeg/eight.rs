//! Decoding to 8 bits a sample.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::outline::Outline;
use super::standard;
use crate::image_error::{ImageError, check_size, one_line};
use doorcam_core::image::Image;

/// Decodes JPEG after JPEG, reusing its buffer.
#[derive(Debug, Clone, Default)]
pub(super) struct EightBit {
    /// The JPEG as passed to the decoder, with Huffman tables and its end replaced.
    complete: Vec<u8>,
}

impl EightBit {
    /// Decodes into `image`, at 8 bits a sample; an error if anything of the image is missing. `outline` must be that
    /// of `bytes`.
    pub fn decode(
        &mut self,
        bytes: &[u8],
        outline: &Outline,
        expected: Option<(usize, usize)>,
        image: &mut Image,
    ) -> Result<(), ImageError> {
        if outline.finer_colours {
            return Err(ImageError::Jpeg("its chroma is sampled more finely than its luma".into()));
        }
        self.complete.clear();
        self.complete.extend_from_slice(&bytes[..2]);
        if !outline.huffman_tables {
            standard::append(&mut self.complete);
        }
        self.complete.extend_from_slice(&bytes[2..outline.end]);
        if outline.sequential {
            self.complete.extend_from_slice(&[0; READ_AHEAD]);
            self.complete.extend_from_slice(&[0xff, 0xc8]);
        }
        self.complete.extend_from_slice(&[0xff, 0xd9]);

        let broken = |e: zune_jpeg::errors::DecodeErrors| ImageError::Jpeg(one_line(&e));
        let options = DecoderOptions::default().set_strict_mode(true).jpeg_set_out_colorspace(ColorSpace::RGB);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&self.complete), options);
        decoder.decode_headers().map_err(broken)?;
        let size = decoder.dimensions().ok_or_else(|| ImageError::Jpeg("has no size".into()))?;
        check_size(size, expected)?;
        if decoder.output_buffer_size() != Some(3 * size.0 * size.1) {
            return Err(ImageError::Jpeg("not a colour or grey image".into()));
        }
        decoder.decode_into(image.eight_mut(size.0, size.1)).map_err(broken)
    }
}

/// Zero bytes before the reserved marker that replaces the end marker.
///
/// When data end early at an end marker, zune-jpeg silently fills the rest of the image with grey, but it refuses a
/// marker that does not exist. The zeros keep that marker out of its read-ahead past the last pixel, which is less than
/// 8 bytes.
const READ_AHEAD: usize = 16;
