use std::borrow::Cow;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::image::ImageError;
use crate::sensor::{SensorFormat, SensorPixels};
use crate::{RawFrame, RawImages};
use doorcam_core::geometry::Side;
use doorcam_core::image::Samples;

/// A frame's image files: what follows the number in the name, and the bytes.
pub(super) type EncodedFrame<'a> = Vec<(String, Cow<'a, [u8]>)>;

/// Keeps image files as they are; encodes raw pixels as PNG, with 8 bits a colour and no other loss.
pub(super) fn encode(frame: &RawFrame) -> Result<EncodedFrame<'_>, ImageError> {
    Ok(match &frame.images {
        RawImages::Camera(bytes) => vec![(format!(".{}", extension(bytes)), Cow::Borrowed(&bytes[..]))],
        RawImages::Patches(sides) => {
            let file =
                |(side, bytes): (Side, &'_ std::sync::Arc<Vec<u8>>)| format!("_{}.{}", side.name(), extension(bytes));
            let named = Side::BOTH.into_iter().zip(sides);
            named.map(|(side, bytes)| (file((side, bytes)), Cow::Borrowed(&bytes[..]))).collect()
        }
        RawImages::Sensor(format, bytes) => vec![(".png".into(), Cow::Owned(png(format, bytes)?))],
    })
}

/// Anything but a PNG is a JPEG, perhaps a damaged one: cameras make nothing else.
fn extension(bytes: &[u8]) -> &'static str {
    if bytes.starts_with(b"\x89PNG") { "png" } else { "jpg" }
}

fn png(format: &SensorFormat, bytes: &[u8]) -> Result<Vec<u8>, ImageError> {
    let image = crate::image::decode_sensor(format, bytes)?;
    let refused = || ImageError::Encode(image.width, image.height);
    let Samples::Eight(rgb) = &image.samples else { return Err(refused()) };
    let (samples, colour) = match format.pixels {
        // Three equal channels would take longer to encode.
        SensorPixels::Grey => (Cow::Owned(rgb.iter().copied().step_by(3).collect()), ExtendedColorType::L8),
        _ => (Cow::Borrowed(&rgb[..]), ExtendedColorType::Rgb8),
    };
    let mut png = Vec::with_capacity(samples.len() / 2);
    let size = |n: usize| u32::try_from(n).map_err(|_| refused());
    // Neighbouring pixels are alike, so a fixed filter does: the search for each row's best filter takes longer than
    // writing the bytes that it saves.
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Sub)
        .write_image(&samples, size(image.width)?, size(image.height)?, colour)
        .map_err(|_| refused())?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::Purpose;
    use crate::sensor::LumaMatrix;

    fn frame(images: RawImages) -> RawFrame {
        RawFrame { index: None, purpose: Purpose::Live, seconds: 0.0, images, time: None, name: "camera".into() }
    }

    fn sensor(pixels: SensorPixels, stride: usize, bytes: Vec<u8>) -> RawFrame {
        let format = SensorFormat { pixels, width: 6, height: 4, stride, full_range: true, matrix: LumaMatrix::Bt601 };
        frame(RawImages::Sensor(format, Arc::new(bytes)))
    }

    #[test]
    fn raw_pixels_come_back_from_the_png() {
        let rgb: Vec<u8> = (0..3 * 6 * 4).map(|k| (k * 37 % 256) as u8).collect();
        let frame = sensor(SensorPixels::Rgb24, 18, rgb.clone());
        let files = encode(&frame).unwrap();
        assert_eq!(files[0].0, ".png");
        assert_eq!(crate::image::decode(&files[0].1).unwrap().samples, Samples::Eight(rgb));
        let grey: Vec<u8> = (0..8 * 4).map(|k| (k * 7) as u8).collect();
        let frame = sensor(SensorPixels::Grey, 8, grey.clone());
        let decoded = crate::image::decode(&encode(&frame).unwrap()[0].1).unwrap();
        let expected = grey.chunks(8).flat_map(|row| row[..6].iter().flat_map(|&g| [g; 3])).collect();
        assert_eq!(decoded.samples, Samples::Eight(expected));
        let frame = sensor(SensorPixels::Yuyv, 12, vec![128; 12 * 4]);
        assert_eq!(crate::image::decode(&encode(&frame).unwrap()[0].1).unwrap().samples, Samples::Eight(vec![128; 72]));
        encode(&sensor(SensorPixels::Yuyv, 12, vec![128; 40])).expect_err("too short");
    }

    #[test]
    fn image_files_are_kept_as_they_are() {
        let jpeg = Arc::new(vec![0xff, 0xd8, 1]);
        let camera = frame(RawImages::Camera(Arc::clone(&jpeg)));
        assert_eq!(encode(&camera).unwrap(), [(".jpg".to_owned(), Cow::Borrowed(&jpeg[..]))]);
        let patches = frame(RawImages::Patches([Arc::new(b"\x89PNG".to_vec()), jpeg]));
        let names: Vec<String> = encode(&patches).unwrap().into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["_left.png", "_right.jpg"]);
    }
}
