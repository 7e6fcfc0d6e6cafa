//! JPEGs as webcams send them: without Huffman tables, padded, cut short.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::image::{Image, ImageError, one_line, same_size};

/// Decodes JPEG after JPEG, reusing its buffer.
#[derive(Debug, Clone, Default)]
pub(super) struct JpegReader {
    /// The JPEG as the decoder is to see it.
    complete: Vec<u8>,
}

impl JpegReader {
    /// Decodes into `image`, which gets 8 bits a sample; an error if anything of the image is missing.
    pub(super) fn decode_into(
        &mut self,
        bytes: &[u8],
        expected: Option<(usize, usize)>,
        image: &mut Image,
    ) -> Result<(), ImageError> {
        let outline = Outline::of(bytes)?;
        outline.check_restarts()?;
        self.complete.clear();
        self.complete.extend_from_slice(&bytes[..2]);
        if !outline.huffman_tables {
            append_standard_tables(&mut self.complete);
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
        same_size(size, expected)?;
        if decoder.output_buffer_size() != Some(3 * size.0 * size.1) {
            return Err(ImageError::Jpeg("not a colour or grey image".into()));
        }
        decoder.decode_into(image.eight_mut(size.0, size.1)).map_err(broken)
    }
}

/// The decoder takes data that end early, at an end marker in its place, for an image with a grey lower part. It does
/// refuse a marker that does not exist: so one is put in place of the end marker, behind as many bytes as the decoder
/// may read ahead of the last pixel (it does so by less than 8).
const READ_AHEAD: usize = 16;

/// What the markers of a JPEG tell.
#[derive(Debug, Default)]
struct Outline {
    /// Where its end marker is.
    end: usize,
    /// Whether it brings Huffman tables.
    huffman_tables: bool,
    /// Whether it is one that is coded from top to bottom: baseline or extended sequential.
    sequential: bool,
    /// Blocks or groups of blocks (MCU) of the image, if it has a single scan.
    units: usize,
    /// Of these, how many there are between restart markers; 0 if there are no such markers.
    restart_interval: usize,
    scans: usize,
    /// Restart markers; none if their numbers have a gap.
    restarts: Option<usize>,
}

impl Outline {
    /// Walks from marker to marker. Whatever follows the end marker is padding.
    fn of(bytes: &[u8]) -> Result<Self, ImageError> {
        let mut outline = Outline { restarts: Some(0), ..Outline::default() };
        let mut at = 2;
        loop {
            let (marker, after) = next_marker(bytes, at).ok_or_else(cut_off)?;
            at = after;
            match marker {
                0xd9 if outline.scans > 0 => {
                    outline.end = after - 2;
                    return Ok(outline);
                }
                0xd0..=0xd7 => {
                    let number = usize::from(marker - 0xd0);
                    outline.restarts = outline.restarts.filter(|n| n % 8 == number).map(|n| n + 1);
                }
                // Markers without a segment.
                0x01 | 0xd8 | 0xd9 => {}
                _ => {
                    let segment = segment(bytes, at).ok_or_else(cut_off)?;
                    at += segment.len() + 2;
                    match marker {
                        0xc4 => outline.huffman_tables = true,
                        0xc0 | 0xc1 => {
                            outline.sequential = true;
                            outline.units = units(segment).unwrap_or(0);
                        }
                        0xdd => outline.restart_interval = segment.get(..2).map_or(0, big_endian),
                        0xda => outline.scans += 1,
                        _ => {}
                    }
                }
            }
        }
    }

    /// Lost data between two restart markers leave a gap in the markers' numbers: the decoder does not look at them.
    fn check_restarts(&self) -> Result<(), ImageError> {
        if !self.sequential || self.scans != 1 || self.restart_interval == 0 {
            return Ok(());
        }
        let expected = self.units.div_ceil(self.restart_interval).saturating_sub(1);
        match self.restarts {
            Some(found) if found >= expected => Ok(()),
            _ => Err(ImageError::Jpeg("a part between its restart markers is missing".into())),
        }
    }
}

fn cut_off() -> ImageError {
    ImageError::Jpeg("cut off before its end marker".into())
}

/// The next marker's code, and where what follows it begins.
fn next_marker(bytes: &[u8], from: usize) -> Option<(u8, usize)> {
    let mut at = from;
    loop {
        at += bytes.get(at..)?.iter().position(|&b| b == 0xff)? + 1;
        // 0xff is repeated as fill; followed by 0 it is data.
        match bytes.get(at)? {
            0 | 0xff => {}
            &code => return Some((code, at + 1)),
        }
    }
}

/// The content of the segment whose length is at `at`.
fn segment(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let length = big_endian(bytes.get(at..at + 2)?);
    bytes.get(at + 2..at + length.max(2))
}

fn big_endian(bytes: &[u8]) -> usize {
    bytes.iter().fold(0, |n, &b| n << 8 | usize::from(b))
}

/// Units of an image whose components are all in one scan, by its frame header.
fn units(frame: &[u8]) -> Option<usize> {
    let (height, width) = (big_endian(frame.get(1..3)?), big_endian(frame.get(3..5)?));
    let components = frame.get(6..)?.chunks_exact(3);
    let (mut across, mut down) = (1, 1);
    // A lone component is not interleaved: its units are its blocks, whatever its sampling.
    if components.len() > 1 {
        for component in components {
            across = across.max(usize::from(component[1] >> 4));
            down = down.max(usize::from(component[1] & 15));
        }
    }
    Some(width.div_ceil(8 * across) * height.div_ceil(8 * down))
}

/// The tables of ITU-T T.81, K.3, which Motion JPEG may leave out.
fn append_standard_tables(out: &mut Vec<u8>) {
    let tables: [(u8, &[u8; 16], &[u8]); 4] = [
        (0x00, &[0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0], &DC_VALUES),
        (0x01, &[0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0], &DC_VALUES),
        (0x10, &[0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d], &AC_LUMA),
        (0x11, &[0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77], &AC_CHROMA),
    ];
    for (id, counts, values) in tables {
        let length = (2 + 1 + 16 + values.len()) as u8;
        out.extend_from_slice(&[0xff, 0xc4, 0, length, id]);
        out.extend_from_slice(counts);
        out.extend_from_slice(values);
    }
}

const DC_VALUES: [u8; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

#[rustfmt::skip]
const AC_LUMA: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71,
    0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72,
    0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34, 0x35, 0x36, 0x37,
    0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59,
    0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83,
    0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3,
    0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3,
    0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2,
    0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];

#[rustfmt::skip]
const AC_CHROMA: [u8; 162] = [
    0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22,
    0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0, 0x15, 0x62, 0x72, 0xd1,
    0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1, 0x17, 0x18, 0x19, 0x1a, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x35, 0x36,
    0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58,
    0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a,
    0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a,
    0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba,
    0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda,
    0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];

#[cfg(test)]
mod tests {
    use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

    use super::*;
    use crate::source::image::Samples;

    /// A textured JPEG as a webcam makes it: 4:2:2, standard Huffman tables.
    fn webcam(width: u16, height: u16, restart: Option<u16>) -> Vec<u8> {
        let mut state = 1u32;
        let rgb: Vec<u8> = (0..3 * usize::from(width) * usize::from(height))
            .map(|k| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (100 + (k / 50) % 80) as u8 + (state >> 27) as u8
            })
            .collect();
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, 90);
        encoder.set_sampling_factor(SamplingFactor::R_4_2_2);
        if let Some(interval) = restart {
            encoder.set_restart_interval(interval);
        }
        encoder.encode(&rgb, width, height, ColorType::Rgb).unwrap();
        bytes
    }

    fn decode(bytes: &[u8]) -> Result<Image, String> {
        let mut image = Image::empty();
        JpegReader::default().decode_into(bytes, None, &mut image).map_err(|e| e.to_string()).map(|()| image)
    }

    /// Where the entropy-coded data begin.
    fn data_start(bytes: &[u8]) -> usize {
        let mut at = 2;
        loop {
            let (marker, after) = next_marker(bytes, at).unwrap();
            at = after + 2 + segment(bytes, after).unwrap().len();
            if marker == 0xda {
                return at;
            }
        }
    }

    #[test]
    fn tables_that_a_webcam_left_out_are_the_standard_ones() {
        let bytes = webcam(80, 48, None);
        let mut without = bytes[..2].to_vec();
        let mut at = 2;
        while at < data_start(&bytes) {
            let (marker, after) = next_marker(&bytes, at).unwrap();
            let next = after + 2 + segment(&bytes, after).unwrap().len();
            if marker != 0xc4 {
                without.extend_from_slice(&bytes[at..next]);
            }
            at = next;
        }
        without.extend_from_slice(&bytes[at..]);
        assert!(without.len() + 400 < bytes.len(), "the tables are gone");
        assert_eq!(decode(&without).unwrap(), decode(&bytes).unwrap());
    }

    #[test]
    fn padding_after_the_end_does_no_harm() {
        let bytes = webcam(80, 48, None);
        let image = decode(&bytes).unwrap();
        for padding in [&[0u8; 700][..], &[0xff; 5], &[0xff, 0xd9], b"junk \xff\xd8\xff"] {
            assert_eq!(decode(&[&bytes[..], padding].concat()).unwrap(), image);
        }
    }

    #[test]
    fn whatever_is_cut_off_or_left_out_makes_it_an_error() {
        for bytes in [webcam(160, 96, None), webcam(160, 96, Some(7))] {
            let (start, end) = (data_start(&bytes), bytes.len() - 2);
            for cut in (2..end).step_by(61) {
                assert_eq!(decode(&bytes[..cut]).unwrap_err(), "broken JPEG: cut off before its end marker", "{cut}");
            }
            // Some drivers put the end marker where the data broke off, or lose a packet in the middle.
            for cut in (start..end - 64).step_by(61) {
                decode(&[&bytes[..cut], &[0xff, 0xd9]].concat()).expect_err("ended early");
            }
            for at in (start..end - 800).step_by(61) {
                decode(&[&bytes[..at], &bytes[at + 700..]].concat()).expect_err("a part is missing");
            }
        }
    }

    #[test]
    fn an_image_of_another_size_is_refused_before_it_is_decoded() {
        let mut image = Image::empty();
        let error = JpegReader::default().decode_into(&webcam(80, 48, None), Some((640, 480)), &mut image).unwrap_err();
        assert_eq!(error.to_string(), "the image has 80 x 48 pixels, expected 640 x 480");
        assert_eq!(image.samples, Samples::Eight(Vec::new()));
    }

    #[test]
    fn the_next_image_goes_into_the_same_buffer() {
        let mut image = Image::empty();
        let mut reader = JpegReader::default();
        let bytes = webcam(80, 48, None);
        reader.decode_into(&bytes, None, &mut image).unwrap();
        let place = |image: &Image| match &image.samples {
            Samples::Eight(samples) => samples.as_ptr(),
            Samples::Sixteen(_) => unreachable!(),
        };
        let first = place(&image);
        reader.decode_into(&bytes, None, &mut image).unwrap();
        assert_eq!(place(&image), first);
    }
}
