use std::ops::Range;
use std::time::{Duration, Instant};

use crate::{Model, Preprocessing, Settings, SetupError};
use doorcam_core::calibration::{Calibration, Camera};
use doorcam_core::geometry::Side;
use doorcam_core::image::Image;
use doorcam_core::light::{CameraRectifier, Decoding, Filter, LightTable, PatchPair, PatchRectifier};
use doorcam_core::optics::Transfer;
use doorcam_core::transport::PatchGrid;
use doorcam_core::visible::Thumbnail;
use doorcam_source::image::{ImageDecoder, JpegDepth};
use doorcam_source::recording::Manifest;
use doorcam_source::{RawFrame, RawImages, SkipKind, SkippedFrame};

/// Decodes frames and rectifies them into patch pairs in linear light.
#[derive(Debug, Clone)]
pub struct FrameReader {
    decoder: ImageDecoder,
    table: LightTable,
    rectifier: Rectifier,
    patch: PatchGrid,
    /// The camera and the size of its pictures; none for images of patches.
    camera: Option<(Camera, [usize; 2])>,
    without_end: u64,
}

#[derive(Debug, Clone)]
enum Rectifier {
    Patches([PatchRectifier; 2]),
    Camera(CameraRectifier, Range<usize>),
}

/// How long reading a frame took.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReadTimes {
    /// Decoding the images.
    pub decode: Duration,
    /// Rectifying them.
    pub rectify: Duration,
}

impl FrameReader {
    /// A reader for the frames of a recording.
    ///
    /// # Errors
    ///
    /// If the calibration does not determine the camera, or the camera sees less than half of a patch.
    pub fn for_recording(settings: &Settings, manifest: &Manifest) -> Result<Self, SetupError> {
        if let Some(calibration) = manifest.calibration() {
            return Self::for_calibration(settings, &calibration);
        }
        let patch = Model::patch_grid(settings, manifest.fov_m);
        let filter = match settings.preprocessing {
            Preprocessing::Published => Filter::Bicubic,
            Preprocessing::Linear => Filter::Area,
        };
        let rectifier = PatchRectifier::new(&patch, manifest.fov_m.unwrap_or(patch.fov_m), filter);
        Ok(Self::new(settings, &manifest.transfer, Rectifier::Patches([rectifier.clone(), rectifier]), patch))
    }

    /// A reader for the frames of a calibrated camera.
    ///
    /// # Errors
    ///
    /// If the calibration does not determine the camera, or the camera sees less than half of a patch.
    pub fn for_calibration(settings: &Settings, calibration: &Calibration) -> Result<Self, SetupError> {
        let patch = Model::patch_grid(settings, None);
        let [width, height] = calibration.size;
        let fitted = calibration.camera()?;
        if let Some(unseen) = calibration.unseen(&patch, &calibration.patch_sights(&patch, &fitted)).next() {
            return Err(unseen.into());
        }
        let camera = CameraRectifier::new(&calibration.doorway, &patch, &fitted, (width, height));
        let rows = camera.rows();
        let reader = Self::new(settings, calibration.transfer(), Rectifier::Camera(camera, rows), patch);
        Ok(Self { camera: Some((fitted, calibration.size)), ..reader })
    }

    fn new(settings: &Settings, transfer: &Transfer, rectifier: Rectifier, patch: PatchGrid) -> Self {
        // The authors' numbers come from 8-bit JPEGs.
        let (decoding, depth) = match settings.preprocessing {
            Preprocessing::Published => (Decoding::Published, JpegDepth::Eight),
            Preprocessing::Linear => (Decoding::Light(transfer.clone()), JpegDepth::Exact),
        };
        Self {
            decoder: ImageDecoder::with_jpegs_of(depth),
            table: LightTable::new(&decoding),
            rectifier,
            patch,
            camera: None,
            without_end: 0,
        }
    }

    /// Takes over from another reader of the same camera, with what it has decoded.
    pub(crate) fn continue_from(&mut self, before: &mut Self) {
        std::mem::swap(&mut self.decoder, &mut before.decoder);
        self.without_end = before.without_end;
    }

    /// Number of frames whose JPEGs are whole but lack their end markers. They are used.
    pub fn without_end(&self) -> u64 {
        self.without_end
    }

    /// The patches it produces.
    pub fn patch(&self) -> PatchGrid {
        self.patch
    }

    /// The camera and the size of its pictures (width, height); none for images of patches.
    pub fn camera(&self) -> Option<(&Camera, [usize; 2])> {
        self.camera.as_ref().map(|(camera, size)| (camera, *size))
    }

    /// Per side and pixel, whether the camera sees it; none if everything is seen.
    pub fn seen(&self) -> Option<[Vec<bool>; 2]> {
        match &self.rectifier {
            Rectifier::Camera(camera, _) => Some(camera.visible()),
            Rectifier::Patches(_) => None,
        }
    }

    /// Decodes and rectifies one frame into `pair`.
    ///
    /// # Errors
    ///
    /// If an image cannot be decoded, has another size, or is not of the kind that this reader expects.
    pub fn read(&mut self, frame: &RawFrame, pair: &mut PatchPair) -> Result<ReadTimes, SkippedFrame> {
        let decode = self.decode(frame, false)?;
        let rest = self.rectify(frame, pair, None)?;
        Ok(ReadTimes { decode: decode + rest.decode, ..rest })
    }

    /// The first half of [`Self::read`], for a camera's frame: decodes what the patches need, or the `whole` picture,
    /// which takes two to three times as long. Returns how long it took.
    ///
    /// # Errors
    ///
    /// As [`Self::read`].
    pub(crate) fn decode(&mut self, frame: &RawFrame, whole: bool) -> Result<Duration, SkippedFrame> {
        let start = Instant::now();
        let Rectifier::Camera(camera, rows) = &self.rectifier else { return Ok(Duration::ZERO) };
        let size = camera.image_size();
        let rows = if whole { 0..size.1 } else { rows.clone() };
        let image = match &frame.images {
            RawImages::Camera(bytes) => self.decoder.decode_rows(bytes, Some(size), rows),
            RawImages::Sensor(format, bytes) => self.decoder.decode_sensor(format, bytes, rows),
            RawImages::Patches(_) => return Err(unfit(frame, "a pair of patches, expected a camera's image")),
        };
        let image = image.map_err(|e| SkippedFrame::undecoded(&*frame.name, &e))?;
        camera.check(image).map_err(|e| unfit(frame, &e.to_string()))?;
        let lacked_end = !matches!(frame.images, RawImages::Sensor(..)) && self.decoder.lacked_end();
        self.without_end += u64::from(lacked_end);
        Ok(start.elapsed())
    }

    /// What was decoded last: all of the picture, if that was asked for.
    pub(crate) fn decoded(&self) -> &Image {
        self.decoder.image()
    }

    /// The second half of [`Self::read`]: writes the patches of what was decoded into `pair`, and fills a thumbnail of
    /// all that the camera sees, if one is wanted, for which the whole picture must have been decoded.
    ///
    /// # Errors
    ///
    /// As [`Self::read`].
    pub(crate) fn rectify(
        &mut self,
        frame: &RawFrame,
        pair: &mut PatchPair,
        thumbnail: Option<&mut Thumbnail>,
    ) -> Result<ReadTimes, SkippedFrame> {
        let mut times = ReadTimes::default();
        match (&mut self.rectifier, &frame.images) {
            (Rectifier::Camera(camera, _), _) => {
                let start = Instant::now();
                let image = self.decoder.image();
                camera.apply(image, &self.table, pair).map_err(|e| unfit(frame, &e.to_string()))?;
                if let Some(thumbnail) = thumbnail {
                    thumbnail.fill(image, &self.table);
                }
                times.rectify += start.elapsed();
            }
            (Rectifier::Patches(rectifiers), RawImages::Patches(images)) => {
                let decoder = &mut self.decoder;
                let mut lacked_end = false;
                for ((side, rectifier), bytes) in Side::BOTH.into_iter().zip(rectifiers).zip(images) {
                    let start = Instant::now();
                    let image = decoder.decode(bytes, None).map_err(|e| {
                        SkippedFrame::undecoded(frame.name.replace("_left.", &format!("_{}.", side.name())), &e)
                    })?;
                    times.decode += start.elapsed();
                    let start = Instant::now();
                    rectifier.apply(image, &self.table, pair.side_mut(side));
                    times.rectify += start.elapsed();
                    lacked_end |= decoder.lacked_end();
                }
                self.without_end += u64::from(lacked_end);
            }
            (Rectifier::Patches(_), RawImages::Camera(_) | RawImages::Sensor(..)) => {
                return Err(unfit(frame, "a camera's image, expected a pair of patches"));
            }
        }
        Ok(times)
    }
}

fn unfit(frame: &RawFrame, reason: &str) -> SkippedFrame {
    SkippedFrame::new(&*frame.name, SkipKind::Unfit, reason)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use doorcam_source::Purpose;
    use doorcam_source::sensor::{LumaMatrix, SensorFormat, SensorPixels};

    const FORMAT: SensorFormat = SensorFormat {
        pixels: SensorPixels::Yuyv,
        width: 600,
        height: 200,
        stride: 1200,
        full_range: true,
        matrix: LumaMatrix::Bt601,
    };

    /// A camera that looks straight down, with 500 pixels per metre.
    fn calibration() -> Calibration {
        serde_json::from_str(
            r#"{"size": [600, 200], "doorway": {"width_m": 0.6, "wall_thickness_m": 0.1}, "transfer": "linear",
                "floor_points": [{"pixel": [50, 20], "floor_m": [-0.5, -0.1]}, {"pixel": [550, 20], "floor_m": [0.5, -0.1]},
                    {"pixel": [550, 170], "floor_m": [0.5, -0.4]}, {"pixel": [50, 170], "floor_m": [-0.5, -0.4]}]}"#,
        )
        .unwrap()
    }

    fn frame(images: RawImages) -> RawFrame {
        RawFrame { index: None, purpose: Purpose::Live, seconds: 0.0, images, time: None, name: "camera".into() }
    }

    #[test]
    fn raw_and_encoded_frames_of_one_scene_agree() {
        let mut reader = FrameReader::for_calibration(&Settings::default(), &calibration()).unwrap();
        // Luma grows along the rows; no colour.
        let raw: Vec<u8> = (0..1200 * 200).map(|k| if k % 2 == 0 { (k % 1200 / 8 + 50) as u8 } else { 128 }).collect();
        let grey = raw.chunks(2).flat_map(|pair| [pair[0]; 3]).collect();
        let buffer = image::ImageBuffer::from_raw(600, 200, grey).unwrap();
        let mut png = std::io::Cursor::new(Vec::new());
        image::DynamicImage::ImageRgb8(buffer).write_to(&mut png, image::ImageFormat::Png).unwrap();

        let (mut from_raw, mut from_png) = (PatchPair::zeros(64), PatchPair::zeros(64));
        reader.read(&frame(RawImages::Sensor(FORMAT, Arc::new(raw))), &mut from_raw).unwrap();
        reader.read(&frame(RawImages::Camera(Arc::new(png.into_inner()))), &mut from_png).unwrap();
        for side in Side::BOTH {
            let pairs = from_raw.side(side).data().iter().zip(from_png.side(side).data());
            assert!(pairs.clone().all(|(a, b)| (a - b).abs() < 2e-5 && *a > 0.1));
        }
    }

    #[test]
    fn jpegs_are_measured_exactly_but_by_the_published_preset_with_8_bits() {
        // A floor of one colour that 8-bit red, green and blue cannot represent.
        let pixels = [101, 119, 133].repeat(600 * 200);
        let mut jpeg = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 100);
        encoder.encode(&pixels, 600, 200, jpeg_encoder::ColorType::Ycbcr).unwrap();
        let jpeg = Arc::new(jpeg);
        let (red, blue) = (101.0 + 1.402 * 5.0, 101.0 - 1.772 * 9.0);
        let rgb = [red, (101.0 - 0.299 * red - 0.114 * blue) / 0.587, blue];

        for (settings, light) in [
            (Settings::default(), rgb.map(|v| v / 255.0)),
            (Settings::published(), rgb.map(|v: f64| v.round() / 256.0)),
        ] {
            let mut reader = FrameReader::for_calibration(&settings, &calibration()).unwrap();
            let mut pair = PatchPair::zeros(reader.patch().size);
            reader.read(&frame(RawImages::Camera(Arc::clone(&jpeg))), &mut pair).unwrap();
            for (channel, light) in light.into_iter().enumerate() {
                let plane = pair.side(Side::Left).plane(channel);
                assert!(
                    plane.iter().all(|&v| (f64::from(v) - light).abs() < 1e-5),
                    "{:?} {channel}",
                    settings.preprocessing
                );
            }
        }
    }

    #[test]
    fn jpegs_that_lack_only_their_end_marker_are_used_and_counted() {
        let mut reader = FrameReader::for_calibration(&Settings::default(), &calibration()).unwrap();
        let mut jpeg = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 90);
        encoder.encode(&[120; 3 * 600 * 200], 600, 200, jpeg_encoder::ColorType::Rgb).unwrap();
        let (mut whole, mut without) = (PatchPair::zeros(64), PatchPair::zeros(64));
        let mut read = |bytes: &[u8], pair: &mut PatchPair| {
            reader.read(&frame(RawImages::Camera(Arc::new(bytes.to_vec()))), pair).map(|_| reader.without_end())
        };
        assert_eq!(read(&jpeg, &mut whole), Ok(0));
        assert_eq!(read(&jpeg[..jpeg.len() - 2], &mut without), Ok(1));
        assert_eq!(without.side(Side::Left).data(), whole.side(Side::Left).data());
        read(&jpeg[..jpeg.len() / 2], &mut without).expect_err("half of it is missing");
        assert_eq!(read(&jpeg, &mut whole), Ok(1));
    }

    #[test]
    fn a_frame_that_is_not_whole_or_not_this_cameras_is_skipped_with_a_reason() {
        let mut reader = FrameReader::for_calibration(&Settings::default(), &calibration()).unwrap();
        let mut reason = |images| {
            let skipped = reader.read(&frame(images), &mut PatchPair::zeros(64)).expect_err("skipped");
            skipped.to_string()
        };
        assert_eq!(
            reason(RawImages::Sensor(FORMAT, Arc::new(vec![0; 239_999]))),
            "camera: the raw frame has 239999 bytes, expected at least 240000"
        );
        let small = SensorFormat { width: 2, height: 2, stride: 4, ..FORMAT };
        assert_eq!(
            reason(RawImages::Sensor(small, Arc::new(vec![0; 8]))),
            "camera: the image has 2 x 2 pixels, expected 600 x 200"
        );
        let jpeg = include_bytes!("../../doorcam-source/src/testdata/grey16.jpg");
        assert_eq!(
            reason(RawImages::Camera(Arc::new(jpeg.to_vec()))),
            "camera: the image has 16 x 16 pixels, expected 600 x 200"
        );
        assert_eq!(
            reason(RawImages::Camera(Arc::new(jpeg[..300].to_vec()))),
            "camera: broken JPEG: cut off before its end marker"
        );
    }
}
