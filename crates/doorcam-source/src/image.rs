//! Decodes image files and raw frames to samples, and encodes JPEGs for people to look at.

use std::io::Cursor;
use std::ops::Range;

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

pub use super::image_error::ImageError;
use super::image_error::{check_size, one_line};
pub use super::jpeg::JpegDepth;
use super::jpeg::JpegReader;
use super::sensor::SensorFormat;
use doorcam_core::image::{Image, Samples};

/// Decodes a JPEG or PNG, told apart by their first bytes; JPEGs to 8 bits a sample.
///
/// # Errors
/// If the bytes are neither, or the image is broken, truncated or larger than 8K.
pub fn decode(bytes: &[u8]) -> Result<Image, ImageError> {
    let mut decoder = ImageDecoder::default();
    decoder.decode(bytes, None)?;
    Ok(decoder.image)
}

/// Width and height of a JPEG or PNG, without decoding it; none if it is neither or damaged at its beginning.
pub(crate) fn size(bytes: &[u8]) -> Option<(usize, usize)> {
    match bytes {
        [0xff, 0xd8, ..] => super::jpeg::size(bytes),
        [0x89, b'P', b'N', b'G', ..] => {
            let side = |at: usize| bytes.get(at..at + 4)?.try_into().ok().map(|side| u32::from_be_bytes(side) as usize);
            side(16).zip(side(20))
        }
        _ => None,
    }
}

/// Decodes a raw frame to 8 bits a sample, for people and files; [`SensorFormat::decode_rows`] is for measuring.
///
/// # Errors
/// If the format is impossible or bytes are missing.
pub fn decode_sensor(format: &SensorFormat, bytes: &[u8]) -> Result<Image, ImageError> {
    let mut image = Image::empty();
    format.decode_rows(bytes, 0..format.height, &mut image)?;
    image.samples = Samples::Eight(image.samples.to_eight());
    Ok(image)
}

/// Encodes an image as a JPEG of quality 1 to 100, for people: nothing that is measured should pass through a JPEG.
///
/// # Errors
/// If the image is empty, has more than 65535 pixels across or down, or its samples do not fit its size.
pub fn encode_jpeg(image: &Image, quality: u8) -> Result<Vec<u8>, ImageError> {
    let refused = || ImageError::Encode(image.width, image.height);
    let size = |n: usize| u16::try_from(n).ok().filter(|&n| n > 0).ok_or_else(refused);
    let (width, height) = (size(image.width)?, size(image.height)?);
    let scaled;
    let samples = match &image.samples {
        Samples::Eight(samples) => samples,
        sixteen => {
            scaled = sixteen.to_eight();
            &scaled
        }
    };
    if samples.len() != 3 * image.width * image.height {
        return Err(refused());
    }
    let mut bytes = Vec::with_capacity(samples.len() / 8);
    JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100))
        .encode(samples, width.into(), height.into(), ExtendedColorType::Rgb8)
        .map_err(|_| refused())?;
    Ok(bytes)
}

/// Decodes frame after frame into the same buffers.
#[derive(Debug, Clone)]
pub struct ImageDecoder {
    jpeg: JpegReader,
    image: Image,
    lacked_end: bool,
}

impl Default for ImageDecoder {
    fn default() -> Self {
        Self { jpeg: JpegReader::default(), image: Image::empty(), lacked_end: false }
    }
}

impl ImageDecoder {
    /// Decodes JPEGs to this depth; the default is 8 bits, for people.
    pub fn with_jpegs_of(depth: JpegDepth) -> Self {
        Self { jpeg: JpegReader::new(depth), ..Self::default() }
    }

    /// Whether the image that was decoded last is a JPEG that is whole but lacks its end marker.
    pub fn lacked_end(&self) -> bool {
        self.lacked_end
    }

    /// What was decoded last.
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// Decodes a JPEG or PNG.
    ///
    /// # Errors
    /// If the bytes are neither, the image is broken, truncated or larger than 8K, or its (width, height) is not
    /// `expected`.
    pub fn decode(&mut self, bytes: &[u8], expected: Option<(usize, usize)>) -> Result<&Image, ImageError> {
        self.decode_rows(bytes, expected, 0..usize::MAX)
    }

    /// Decodes at least these rows; the image's other rows may be left over from earlier frames.
    ///
    /// Exact decoding of a JPEG computes only these rows. If it has restart markers, its data below the last of them
    /// are not read. Without restart markers they are: a missing part moves all that follows up and to the left, and
    /// shows only in that the data run out at the end. Damage that leaves as many blocks as there were goes unnoticed,
    /// as does damage in data that are not read.
    ///
    /// # Errors
    /// As for [`ImageDecoder::decode`], for what is read; missing or misplaced restart markers are errors wherever they
    /// are. A missing end marker is one unless all data are there and nothing follows them: then see
    /// [`ImageDecoder::lacked_end`].
    pub fn decode_rows(
        &mut self,
        bytes: &[u8],
        expected: Option<(usize, usize)>,
        rows: Range<usize>,
    ) -> Result<&Image, ImageError> {
        self.lacked_end = false;
        match bytes {
            [0xff, 0xd8, ..] => self.jpeg.decode_into(bytes, expected, rows, &mut self.image)?,
            [0x89, b'P', b'N', b'G', ..] => self.image = decode_png(bytes, expected)?,
            _ => return Err(ImageError::UnknownFormat),
        }
        self.lacked_end = bytes[0] == 0xff && self.jpeg.lacked_end();
        Ok(&self.image)
    }

    /// Decodes `rows` of a raw frame to 16 bits a sample; the image's other rows are left over from earlier frames.
    ///
    /// # Errors
    /// If the format is impossible or bytes are missing.
    pub fn decode_sensor(
        &mut self,
        format: &SensorFormat,
        bytes: &[u8],
        rows: Range<usize>,
    ) -> Result<&Image, ImageError> {
        format.decode_rows(bytes, rows, &mut self.image)?;
        Ok(&self.image)
    }
}

fn decode_png(bytes: &[u8], expected: Option<(usize, usize)>) -> Result<Image, ImageError> {
    use image::{DynamicImage, ImageDecoder as _};

    let broken = |e: image::ImageError| ImageError::Png(one_line(&e));
    let reader = image::ImageReader::with_format(Cursor::new(bytes), image::ImageFormat::Png);
    let decoder = reader.into_decoder().map_err(broken)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    check_size((width, height), expected)?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(broken)?;
    let samples = match decoded {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => Samples::Sixteen(decoded.into_rgb16().into_raw()),
        other => Samples::Eight(other.into_rgb8().into_raw()),
    };
    Ok(Image { width, height, samples })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn png(image: image::DynamicImage) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    /// A 16 x 16 JPEG of one colour (baseline, made with a stock encoder).
    const JPEG: &[u8] = include_bytes!("testdata/grey16.jpg");

    #[test]
    fn sixteen_bit_png_keeps_its_codes() {
        let rgb: Vec<u16> = (0..3 * 4 * 2).map(|k| k * 2500).collect();
        let buffer = image::ImageBuffer::from_raw(4, 2, rgb.clone()).unwrap();
        let decoded = decode(&png(image::DynamicImage::ImageRgb16(buffer))).unwrap();
        assert_eq!(decoded, Image { width: 4, height: 2, samples: Samples::Sixteen(rgb) });
    }

    #[test]
    fn an_image_that_claims_to_be_huge_is_refused_before_there_is_room_for_it() {
        let refused = decode(include_bytes!("../../../fuzz/corpus/png/huge.png")).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "the image has 40 x 1744830464 pixels, expected at most as many as 7680 x 4320"
        );
        let mut jpeg = JPEG.to_vec();
        let frame = jpeg.windows(2).position(|m| m == [0xff, 0xc0]).unwrap();
        jpeg[frame + 5..frame + 9].fill(0x3f);
        assert!(matches!(decode(&jpeg), Err(ImageError::TooLarge(0x3f3f, 0x3f3f))));
    }

    #[test]
    fn grey_and_alpha_come_out_as_three_channels() {
        let buffer = image::ImageBuffer::from_raw(2, 1, vec![10u8, 255, 200, 0]).unwrap();
        let decoded = decode(&png(image::DynamicImage::ImageLumaA8(buffer))).unwrap();
        assert_eq!(decoded.samples, Samples::Eight(vec![10, 10, 10, 200, 200, 200]));
    }

    #[test]
    fn a_jpeg_decodes_and_a_truncated_one_is_an_error() {
        let decoded = decode(JPEG).unwrap();
        assert_eq!((decoded.width, decoded.height), (16, 16));
        for cut in [3, 20, JPEG.len() / 2, JPEG.len() - 3] {
            decode(&JPEG[..cut]).expect_err("truncated");
        }
        for lacking in 1..=2 {
            assert_eq!(decode(&JPEG[..JPEG.len() - lacking]).unwrap(), decoded, "only the end marker");
        }
        assert_eq!(
            (size(JPEG), size(b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\x05\0\0\0\x02\xd0")),
            (Some((16, 16)), Some((1280, 720)))
        );
    }

    #[test]
    fn an_encoded_image_is_the_image_again() {
        let codes: Vec<u16> = (0..3 * 40 * 24).map(|k| 20_000 + 257 * (k / 40) as u16).collect();
        let image = Image { width: 40, height: 24, samples: Samples::Sixteen(codes) };
        let decoded = decode(&encode_jpeg(&image, 100).unwrap()).unwrap();
        let (Samples::Eight(decoded), expected) = (decoded.samples, image.samples.to_eight()) else { unreachable!() };
        assert!(decoded.iter().zip(expected).all(|(&d, e)| d.abs_diff(e) <= 2));
        assert!(encode_jpeg(&image, 30).unwrap().len() < encode_jpeg(&image, 90).unwrap().len());
        encode_jpeg(&Image::empty(), 90).expect_err("no pixels");
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(which in any::<bool>(), at in 2usize..600, with in any::<u8>(), cut in 2usize..2000) {
            let mut bytes = if which {
                JPEG.to_vec()
            } else {
                png(image::DynamicImage::ImageRgb8(image::ImageBuffer::from_pixel(9, 7, image::Rgb([1, 2, 3]))))
            };
            let length = bytes.len();
            bytes[at % length] = with;
            bytes.truncate(cut.min(length));
            let _ = decode(&bytes);
        }
    }
}
