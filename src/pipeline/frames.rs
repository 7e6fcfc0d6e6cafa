use std::ops::Range;
use std::time::{Duration, Instant};

use super::{Model, SetupError};
use crate::config::{Config, Preset};
use crate::geometry::Side;
use crate::measurement::{CameraRectifier, Decoding, Filter, Homography, LightTable, PatchPair, PatchRectifier};
use crate::source::image::ImageDecoder;
use crate::source::recording::{Layout, Manifest};
use crate::source::{RawFrame, RawImages, SkippedFrame};
use crate::transport::PatchGrid;

/// Decodes frames and rectifies them into patch pairs in linear light.
pub struct FrameReader {
    decoder: ImageDecoder,
    table: LightTable,
    rectifier: Rectifier,
    patch: PatchGrid,
}

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
    /// For the frames of a recording.
    pub fn for_recording(config: &Config, manifest: &Manifest) -> Result<Self, SetupError> {
        let (decoding, filter) = match config.preset {
            Some(Preset::Published) => (Decoding::Published, Filter::Bicubic),
            None => (Decoding::Light(manifest.transfer), Filter::Area),
        };
        let patch = Model::patch_grid(config, manifest.fov_m.filter(|_| manifest.layout == Layout::Patches));
        let rectifier = match manifest.layout {
            Layout::Patches => {
                let rectifier = PatchRectifier::new(&patch, manifest.fov_m.unwrap_or(patch.fov_m), filter);
                Rectifier::Patches([rectifier.clone(), rectifier])
            }
            Layout::Camera => {
                let points: Vec<_> = manifest.floor_points.iter().map(|p| (p.floor_m, p.pixel)).collect();
                let homography = Homography::fit(&points)?;
                let [width, height] = manifest.size.unwrap_or_default();
                let camera = CameraRectifier::new(&manifest.doorway, &patch, &homography, (width, height));
                let rows = camera.rows();
                Rectifier::Camera(camera, rows)
            }
        };
        let reader = Self { decoder: ImageDecoder::default(), table: LightTable::new(decoding), rectifier, patch };
        for (side, seen) in Side::BOTH.into_iter().zip(reader.seen().into_iter().flatten()) {
            let count = seen.iter().filter(|&&s| s).count();
            if 2 * count < seen.len() {
                let (side, all, fov_m) = (side.name(), seen.len(), patch.fov_m);
                return Err(SetupError::PatchNotSeen { side, seen: count, all, fov_m });
            }
        }
        Ok(reader)
    }

    /// The patches that it makes.
    pub fn patch(&self) -> PatchGrid {
        self.patch
    }

    /// Per side and pixel, what the camera sees; none if everything is seen.
    pub fn seen(&self) -> Option<[Vec<bool>; 2]> {
        match &self.rectifier {
            Rectifier::Camera(camera, _) => Some(camera.visible()),
            Rectifier::Patches(_) => None,
        }
    }

    /// Decodes and rectifies one frame into `pair`.
    pub fn read(&mut self, frame: &RawFrame, pair: &mut PatchPair) -> Result<ReadTimes, SkippedFrame> {
        let skipped = |reason: String| SkippedFrame { name: frame.name.to_string(), reason };
        let mut times = ReadTimes::default();
        let mut timed =
            |slot: fn(&mut ReadTimes) -> &mut Duration, start: Instant| *slot(&mut times) += start.elapsed();
        let decoder = &mut self.decoder;
        match (&mut self.rectifier, &frame.images) {
            (Rectifier::Patches(rectifiers), RawImages::Patches(images)) => {
                for ((side, rectifier), bytes) in Side::BOTH.into_iter().zip(rectifiers).zip(images) {
                    let start = Instant::now();
                    let image = decoder.decode(bytes, None).map_err(|e| SkippedFrame {
                        name: frame.name.replace("_left.", &format!("_{}.", side.name())),
                        reason: e.to_string(),
                    })?;
                    timed(|t| &mut t.decode, start);
                    let start = Instant::now();
                    rectifier.apply(image, &self.table, pair.side_mut(side));
                    timed(|t| &mut t.rectify, start);
                }
            }
            (Rectifier::Camera(camera, rows), images) => {
                let start = Instant::now();
                let image = match images {
                    RawImages::Camera(bytes) => decoder.decode(bytes, Some(camera.image_size())),
                    RawImages::Sensor(format, bytes) => decoder.decode_sensor(format, bytes, rows.clone()),
                    RawImages::Patches(_) => {
                        return Err(skipped("a pair of patches, expected a camera's image".into()));
                    }
                };
                let image = image.map_err(|e| skipped(e.to_string()))?;
                timed(|t| &mut t.decode, start);
                let start = Instant::now();
                camera.apply(image, &self.table, pair).map_err(|e| skipped(e.to_string()))?;
                timed(|t| &mut t.rectify, start);
            }
            (Rectifier::Patches(_), RawImages::Camera(_) | RawImages::Sensor(..)) => {
                return Err(skipped("a camera's image, expected a pair of patches".into()));
            }
        }
        Ok(times)
    }
}
