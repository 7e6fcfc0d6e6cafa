//! Encoded frames to samples.

use std::io::Cursor;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Why an image file's bytes are not an image.
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
}

/// Sample values as the file has them, red, green, blue interleaved, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// 8 bits a sample.
    Eight(Vec<u8>),
    /// 16 bits a sample.
    Sixteen(Vec<u16>),
}

/// A decoded image; grey images have three equal channels, transparency is dropped.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `3 * width * height` samples.
    pub samples: Samples,
}

impl Image {
    /// Decodes a JPEG or PNG, told apart by its first bytes. A truncated file is an error, not half an image.
    pub fn decode(bytes: &[u8]) -> Result<Self, ImageError> {
        match bytes {
            [0xff, 0xd8, ..] => decode_jpeg(bytes),
            [0x89, b'P', b'N', b'G', ..] => decode_png(bytes),
            _ => Err(ImageError::UnknownFormat),
        }
    }
}

fn decode_jpeg(bytes: &[u8]) -> Result<Image, ImageError> {
    // A JPEG that was cut off decodes to an image with a grey lower part: its end marker is what tells.
    let padding = bytes.iter().rev().take_while(|&&b| b == 0).count();
    if !bytes[..bytes.len() - padding].ends_with(&[0xff, 0xd9]) {
        return Err(ImageError::Jpeg("cut off before its end marker".into()));
    }
    let options = DecoderOptions::default().set_strict_mode(true).jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let samples = decoder.decode().map_err(|e| ImageError::Jpeg(one_line(&e)))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| ImageError::Jpeg("has no size".into()))?;
    if samples.len() != 3 * width * height {
        return Err(ImageError::Jpeg("not a colour or grey image".into()));
    }
    Ok(Image { width, height, samples: Samples::Eight(samples) })
}

fn decode_png(bytes: &[u8]) -> Result<Image, ImageError> {
    use image::DynamicImage;

    let reader = image::ImageReader::with_format(Cursor::new(bytes), image::ImageFormat::Png);
    let decoded = reader.decode().map_err(|e| ImageError::Png(one_line(&e)))?;
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let samples = match decoded {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => Samples::Sixteen(decoded.into_rgb16().into_raw()),
        other => Samples::Eight(other.into_rgb8().into_raw()),
    };
    Ok(Image { width, height, samples })
}

fn one_line(error: &dyn std::fmt::Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
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
        let decoded = Image::decode(&png(image::DynamicImage::ImageRgb16(buffer))).unwrap();
        assert_eq!(decoded, Image { width: 4, height: 2, samples: Samples::Sixteen(rgb) });
    }

    #[test]
    fn grey_and_alpha_come_out_as_three_channels() {
        let buffer = image::ImageBuffer::from_raw(2, 1, vec![10u8, 255, 200, 0]).unwrap();
        let decoded = Image::decode(&png(image::DynamicImage::ImageLumaA8(buffer))).unwrap();
        assert_eq!(decoded.samples, Samples::Eight(vec![10, 10, 10, 200, 200, 200]));
    }

    #[test]
    fn a_jpeg_decodes_and_a_truncated_one_is_an_error() {
        let decoded = Image::decode(JPEG).unwrap();
        assert_eq!((decoded.width, decoded.height), (16, 16));
        for cut in [3, 20, JPEG.len() / 2, JPEG.len() - 1] {
            Image::decode(&JPEG[..cut]).expect_err("truncated");
        }
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
            let _ = Image::decode(&bytes);
        }
    }
}
