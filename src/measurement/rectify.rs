//! Images to patch pairs.

use std::ops::Range;

use super::{Camera, Filter, LightTable, Patch, PatchPair, PatchResampler};
use crate::geometry::{Doorway, Point, Side};
use crate::source::image::Image;
use crate::transport::PatchGrid;

/// An image that does not fit what the rectifier was made for.
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
    /// For images that show a square of side `image_fov_m`; the model's patch must not be larger.
    pub fn new(patch: &PatchGrid, image_fov_m: f64, filter: Filter) -> Self {
        Self { fraction: (patch.fov_m / image_fov_m).min(1.0), size: patch.size, filter, resampler: None }
    }

    /// Linear light of one patch image, averaged into `patch`.
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

/// Points along each side of a patch pixel at which the camera's image is read.
const SUBSAMPLES: usize = 4;

/// Reads the patches out of a camera's image: each patch pixel is the mean over its square of floor, read by bilinear
/// interpolation, so that its value does not depend on how obliquely the camera sees it (paper, footnote 2).
#[derive(Debug, Clone)]
pub struct CameraRectifier {
    image_size: (usize, usize),
    taps: [Taps; 2],
}

/// Per patch pixel, the image pixels that it averages: `weights[start[k]..start[k + 1]]`.
#[derive(Debug, Clone)]
struct Taps {
    start: Vec<usize>,
    pixel: Vec<u32>,
    weight: Vec<f32>,
}

impl CameraRectifier {
    /// For images of `image_size` (width, height) from `camera`.
    pub fn new(doorway: &Doorway, patch: &PatchGrid, camera: &Camera, image_size: (usize, usize)) -> Self {
        let taps = Side::BOTH.map(|side| Taps::new(doorway, patch, side, camera, image_size));
        Self { image_size, taps }
    }

    /// Width and height of the images.
    pub fn image_size(&self) -> (usize, usize) {
        self.image_size
    }

    /// Per side, the patch pixels that the camera sees whole.
    pub fn visible(&self) -> [Vec<bool>; 2] {
        [0, 1].map(|s| self.taps[s].start.windows(2).map(|w| w[0] < w[1]).collect())
    }

    /// The image rows that the patches are read from: the others need not be decoded.
    pub fn rows(&self) -> Range<usize> {
        let pixels = || self.taps.iter().flat_map(|taps| &taps.pixel).map(|&p| p as usize / self.image_size.0.max(1));
        pixels().min().unwrap_or(0)..pixels().max().map_or(0, |last| last + 1)
    }

    /// Linear light of the two patches in `image`; pixels that the camera does not see whole are 0.
    pub fn apply(&self, image: &Image, table: &LightTable, pair: &mut PatchPair) -> Result<(), WrongSize> {
        let got = (image.width, image.height);
        if got != self.image_size {
            return Err(WrongSize { got, expected: self.image_size });
        }
        for (taps, side) in self.taps.iter().zip(Side::BOTH) {
            let patch = pair.side_mut(side);
            for (k, window) in taps.start.windows(2).enumerate() {
                let mut sum = [0.0_f32; 3];
                for (&pixel, &weight) in taps.pixel[window[0]..window[1]].iter().zip(&taps.weight[window[0]..window[1]])
                {
                    for (channel, s) in sum.iter_mut().enumerate() {
                        *s += weight * table.sample(image, 3 * pixel as usize + channel);
                    }
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
    fn new(doorway: &Doorway, patch: &PatchGrid, side: Side, camera: &Camera, (width, height): (usize, usize)) -> Self {
        let mut taps = Taps { start: vec![0], pixel: Vec::new(), weight: Vec::new() };
        let cell = patch.fov_m / patch.size as f64;
        let corner = [doorway.edge(side)[0] - patch.fov_m / 2.0, -doorway.wall_thickness_m];
        let mut found: Vec<(u32, f32)> = Vec::new();
        for k in 0..patch.pixels() {
            let (row, column) = (k / patch.size, k % patch.size);
            found.clear();
            let whole = (0..SUBSAMPLES * SUBSAMPLES).all(|s| {
                let within = |n: usize| (n as f64 + 0.5) / SUBSAMPLES as f64;
                let floor = [
                    corner[0] + (column as f64 + within(s % SUBSAMPLES)) * cell,
                    corner[1] - (row as f64 + within(s / SUBSAMPLES)) * cell,
                ];
                camera.project(floor).is_some_and(|at| bilinear(at, width, height, &mut found))
            });
            if whole {
                found.sort_unstable_by_key(|&(pixel, _)| pixel);
                for (pixel, weight) in &found {
                    if taps.pixel.len() > taps.start[k] && taps.pixel.last() == Some(pixel) {
                        if let Some(last) = taps.weight.last_mut() {
                            *last += weight;
                        }
                    } else {
                        taps.pixel.push(*pixel);
                        taps.weight.push(*weight);
                    }
                }
            }
            taps.start.push(taps.pixel.len());
        }
        taps
    }
}

/// Per pixel of a patch, whether the camera sees the whole of its square.
pub(super) fn seen_cells(
    doorway: &Doorway,
    patch: &PatchGrid,
    side: Side,
    camera: &Camera,
    (width, height): (usize, usize),
) -> Vec<bool> {
    let n = patch.size;
    let within = |at: f64, size: usize| (-0.5..=size as f64 - 0.5).contains(&at);
    let corners: Vec<bool> = (0..(n + 1) * (n + 1))
        .map(|k| {
            let seen = camera.project(corner(doorway, patch, side, k / (n + 1), k % (n + 1)));
            seen.is_some_and(|[u, v]| within(u, width) && within(v, height))
        })
        .collect();
    let whole = |k: usize| {
        let first = k / n * (n + 1) + k % n;
        [first, first + 1, first + n + 1, first + n + 2].iter().all(|&c| corners[c])
    };
    (0..patch.pixels()).map(whole).collect()
}

/// The corner nearest the wall and with the smallest x of a patch pixel's square of floor, in metres in the door frame; the
/// last row and column are followed by one more.
fn corner(doorway: &Doorway, patch: &PatchGrid, side: Side, row: usize, column: usize) -> Point {
    let along = |k: usize| k as f64 / patch.size as f64;
    [doorway.edge(side)[0] + (along(column) - 0.5) * patch.fov_m, -doorway.wall_thickness_m - along(row) * patch.fov_m]
}

/// Adds the four pixels around an image position with their weights; false if it is outside the image.
fn bilinear([u, v]: [f64; 2], width: usize, height: usize, out: &mut Vec<(u32, f32)>) -> bool {
    if width == 0 || height == 0 {
        return false;
    }
    let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
    // Up to half a pixel beyond the outermost centres is still in the image.
    if !(-0.5..=right + 0.5).contains(&u) || !(-0.5..=bottom + 0.5).contains(&v) {
        return false;
    }
    let (u, v) = (u.clamp(0.0, right), v.clamp(0.0, bottom));
    let (x, y) = (u.floor().min((right - 1.0).max(0.0)), v.floor().min((bottom - 1.0).max(0.0)));
    let (fx, fy) = (u - x, v - y);
    for (dx, dy, weight) in [
        (0.0, 0.0, (1.0 - fx) * (1.0 - fy)),
        (1.0, 0.0, fx * (1.0 - fy)),
        (0.0, 1.0, (1.0 - fx) * fy),
        (1.0, 1.0, fx * fy),
    ] {
        if weight > 0.0 {
            let index = (y + dy) as usize * width + (x + dx) as usize;
            out.push((index as u32, (weight / (SUBSAMPLES * SUBSAMPLES) as f64) as f32));
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::{Decoding, Homography};
    use crate::source::image::Samples;
    use crate::source::recording::Transfer;
    use crate::transport::PixelLayout;

    const DOORWAY: Doorway = Doorway { width_m: 0.6, wall_thickness_m: 0.1, height_m: None };
    const PATCH: PatchGrid = PatchGrid { size: 16, fov_m: 0.3, layout: PixelLayout::Cells };

    /// A camera that looks straight down: 500 pixels a metre, door line at row 20.
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
                assert!((f64::from(patch.plane(1)[k]) * 65535.0 - 300.0 * v).abs() < 1.0, "{side:?} {row} {column}");
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
        // From the wall at row 20 down to 0.3 m in front of it.
        let rows = rectifier().rows();
        assert!((19..=21).contains(&rows.start) && (170..=172).contains(&rows.end), "{rows:?}");
    }
}
