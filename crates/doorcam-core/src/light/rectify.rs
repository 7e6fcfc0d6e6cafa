//! From images to patch pairs.

use std::ops::Range;

use crate::calibration::Camera;
use crate::calibration::{Footprint, footprints};
use crate::geometry::{Doorway, Side};
use crate::image::Image;
use crate::light::{Filter, LightTable, Patch, PatchPair, PatchResampler};
use crate::transport::PatchGrid;

/// An image that does not have the size for which the rectifier was made.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the image has {} x {} pixels, expected {} x {}", got.0, got.1, expected.0, expected.1)]
pub struct WrongSize {
    got: (usize, usize),
    expected: (usize, usize),
}

/// Averages images of already rectified patches down to the model's pixels.
#[derive(Debug, Clone)]
pub struct PatchRectifier {
    fraction: f64,
    size: usize,
    filter: Filter,
    resampler: Option<PatchResampler>,
}

impl PatchRectifier {
    /// A rectifier for images of a square of side `image_fov_m` (m). The model's patch must not be larger.
    pub fn new(patch: &PatchGrid, image_fov_m: f64, filter: Filter) -> Self {
        Self { fraction: (patch.fov_m / image_fov_m).min(1.0), size: patch.size, filter, resampler: None }
    }

    /// Averages the linear light of one patch image into `patch`.
    pub fn apply(&mut self, image: &Image, table: &LightTable, patch: &mut Patch) {
        let size = (image.width, image.height);
        let (fraction, pixels, filter) = (self.fraction, self.size, self.filter);
        let make = || PatchResampler::new(size, fraction, pixels, filter);
        let resampler = self.resampler.get_or_insert_with(make);
        if resampler.image_size() != size {
            *resampler = make();
        }
        resampler.apply(image, table, patch);
    }
}

/// Reads the patches out of a camera's image: each patch pixel is the mean over its square of floor.
#[derive(Debug, Clone)]
pub struct CameraRectifier {
    image_size: (usize, usize),
    taps: [Taps; 2],
}

/// Per patch pixel, the image pixels that it averages.
#[derive(Debug, Clone, Default)]
struct Taps {
    /// Patch pixel k has `runs[start[k]..start[k + 1]]`.
    start: Vec<usize>,
    runs: Vec<Run>,
    /// Weights of all runs, one after the other.
    weights: Vec<f32>,
}

/// Consecutive image pixels.
#[derive(Debug, Clone, Copy)]
struct Run {
    /// Index of the first image pixel.
    pixel: usize,
    count: usize,
}

impl CameraRectifier {
    /// A rectifier for images of `image_size` (width, height) in pixels from `camera`.
    pub fn new(doorway: &Doorway, patch: &PatchGrid, camera: &Camera, image_size: (usize, usize)) -> Self {
        let taps = Side::BOTH.map(|side| Taps::new(&footprints(doorway, patch, side, camera, image_size)));
        Self { image_size, taps }
    }

    /// Width and height of the images.
    pub fn image_size(&self) -> (usize, usize) {
        self.image_size
    }

    /// Per side, whether the camera sees the whole of each patch pixel.
    pub fn visible(&self) -> [Vec<bool>; 2] {
        [0, 1].map(|s| self.taps[s].start.windows(2).map(|w| w[0] < w[1]).collect())
    }

    /// The image rows from which the patches are read; the others need not be decoded.
    pub fn rows(&self) -> Range<usize> {
        let rows = || self.taps.iter().flat_map(|taps| &taps.runs).map(|run| run.pixel / self.image_size.0.max(1));
        rows().min().unwrap_or(0)..rows().max().map_or(0, |last| last + 1)
    }

    /// Checks that an image has the size [`Self::image_size`].
    ///
    /// # Errors
    ///
    /// If it has not.
    pub fn check(&self, image: &Image) -> Result<(), WrongSize> {
        let got = (image.width, image.height);
        if got == self.image_size { Ok(()) } else { Err(WrongSize { got, expected: self.image_size }) }
    }

    /// Writes the linear light of the two patches in `image` into `pair`; patch pixels that the camera does not see
    /// whole are 0.
    ///
    /// # Errors
    ///
    /// If the image does not have the size [`Self::image_size`].
    pub fn apply(&self, image: &Image, table: &LightTable, pair: &mut PatchPair) -> Result<(), WrongSize> {
        self.check(image)?;
        for (taps, side) in self.taps.iter().zip(Side::BOTH) {
            let patch = pair.side_mut(side);
            let mut weights = &taps.weights[..];
            for (k, window) in taps.start.windows(2).enumerate() {
                let mut sum = [0.0_f32; 3];
                for run in &taps.runs[window[0]..window[1]] {
                    let (own, rest) = weights.split_at(run.count);
                    table.add_weighted(image, run.pixel, own, &mut sum);
                    weights = rest;
                }
                for (channel, s) in sum.into_iter().enumerate() {
                    patch.plane_mut(channel)[k] = s;
                }
            }
        }
        Ok(())
    }
}

impl Taps {
    fn new(footprints: &[Footprint]) -> Self {
        let mut taps = Taps { start: vec![0], ..Taps::default() };
        for footprint in footprints {
            let own = taps.runs.len();
            for &(pixel, weight) in footprint {
                let pixel = pixel as usize;
                match taps.runs[own..].last_mut() {
                    Some(run) if run.pixel + run.count == pixel => run.count += 1,
                    _ => taps.runs.push(Run { pixel, count: 1 }),
                }
                taps.weights.push(weight);
            }
            taps.start.push(taps.runs.len());
        }
        taps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Homography;
    use crate::image::Samples;
    use crate::light::Decoding;
    use crate::optics::Transfer;
    use crate::transport::PixelLayout;

    const DOORWAY: Doorway = Doorway { width_m: 0.6, wall_thickness_m: 0.1, height_m: None, leaf: None };
    const PATCH: PatchGrid = PatchGrid { size: 16, fov_m: 0.3, layout: PixelLayout::Cells };

    /// A camera that looks straight down: 500 pixels per metre, door line at row 20.
    fn overhead(floor: [f64; 2]) -> [f64; 2] {
        [300.0 + 500.0 * floor[0], 20.0 - 500.0 * (floor[1] + 0.1)]
    }

    fn rectifier() -> CameraRectifier {
        let corners = [[-0.5, -0.1], [0.5, -0.1], [0.5, -0.4], [-0.5, -0.4]];
        let homography = Homography::fit(&corners.map(|c| (c, overhead(c)))).unwrap();
        CameraRectifier::new(&DOORWAY, &PATCH, &Camera::new(homography, None), (600, 200))
    }

    #[test]
    fn patches_show_the_floor_beside_each_edge_row_0_at_the_wall() {
        // An image whose codes are linear in position: the mean over a patch pixel is the value at its centre.
        let code = |u: usize, v: usize| [(u * 100) as u16, (v * 300) as u16, 7000];
        let samples = (0..200).flat_map(|v| (0..600).flat_map(move |u| code(u, v))).collect();
        let image = Image { width: 600, height: 200, samples: Samples::Sixteen(samples) };
        let mut pair = PatchPair::zeros(16);
        rectifier().apply(&image, &LightTable::new(&Decoding::Light(Transfer::Linear)), &mut pair).unwrap();
        for side in Side::BOTH {
            for (row, column) in [(0, 0), (3, 12), (15, 15)] {
                let [u, v] = overhead(PATCH.point(&DOORWAY, side, row, column));
                let k = row * 16 + column;
                let patch = pair.side(side);
                assert!((f64::from(patch.plane(0)[k]) * 65535.0 - 100.0 * u).abs() < 1.0, "{side:?} {row} {column}");
                // Row 20 of the image shows half wall, half floor, so its floor half is taken from row 21.
                let limit = if row == 0 { 15.0 } else { 1.0 };
                assert!((f64::from(patch.plane(1)[k]) * 65535.0 - 300.0 * v).abs() < limit, "{side:?} {row} {column}");
                assert!((f64::from(patch.plane(2)[k]) * 65535.0 - 7000.0).abs() < 0.1);
            }
        }
    }

    #[test]
    fn pixels_outside_the_image_are_told_and_a_wrong_image_is_refused() {
        let corners = [[-0.5, -0.1], [0.5, -0.1], [0.5, -0.4], [-0.5, -0.4]];
        let shifted = |c: [f64; 2]| {
            let [u, v] = overhead(c);
            [u - 150.0, v]
        };
        let homography = Homography::fit(&corners.map(|c| (c, shifted(c)))).unwrap();
        let narrow = CameraRectifier::new(&DOORWAY, &PATCH, &Camera::new(homography, None), (600, 200));
        let [left, right] = narrow.visible();
        // The left patch spans image columns -75 .. 75 of the shifted camera.
        assert_eq!(left.iter().filter(|&&seen| seen).count(), 16 * 8);
        assert!(right.iter().all(|&seen| seen));
        let small = Image { width: 2, height: 2, samples: Samples::Eight(vec![0; 12]) };
        let table = LightTable::new(&Decoding::Light(Transfer::Srgb));
        narrow.apply(&small, &table, &mut PatchPair::zeros(16)).expect_err("wrong size");
    }

    #[test]
    fn rows_are_those_that_the_patches_are_read_from() {
        // From the wall at row 20 to 0.3 m in front of it.
        let rows = rectifier().rows();
        assert!((19..=21).contains(&rows.start) && (170..=172).contains(&rows.end), "{rows:?}");
    }
}
