//! The two patches and their colour-magnified difference (paper: figure 10 g, h and figure 14 g, h).

use super::{RenderError, colour, raster};
use doorcam_core::light::{Patch, PatchPair};

/// The largest |y| of both patches, a common scale that makes them comparable; 0 if nothing differs.
pub(super) fn largest(difference: &PatchPair) -> f64 {
    [&difference.left, &difference.right]
        .into_iter()
        .flat_map(Patch::data)
        .map(|v| f64::from(v.abs()))
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max)
}

/// y / max|y| / 2 + 0.5 as a byte: no change is middle grey.
pub(super) fn magnify(y: f64, largest: f64) -> u8 {
    let relative = if y.is_nan() || largest <= 0.0 { 0.0 } else { (y / largest).clamp(-1.0, 1.0) };
    (255.0 * (relative / 2.0 + 0.5)).round() as u8
}

/// One magnified patch as RGB bytes: row 0 (at the wall) on top, each patch pixel `pixel_scale` pixels wide and high.
pub(super) fn magnified(patch: &Patch, largest: f64, pixel_scale: usize) -> Vec<u8> {
    enlarged(patch, pixel_scale, |y| magnify(y, largest))
}

fn enlarged(patch: &Patch, pixel_scale: usize, byte: impl Fn(f64) -> u8) -> Vec<u8> {
    let size = patch.size();
    let mut bytes = Vec::with_capacity(3 * patch.pixels() * pixel_scale * pixel_scale);
    for row in 0..size {
        let line: Vec<u8> = (0..size)
            .flat_map(|column| {
                let rgb = [0, 1, 2].map(|p| byte(f64::from(patch.plane(p)[row * size + column])));
                std::iter::repeat_n(rgb, pixel_scale).flatten()
            })
            .collect();
        (0..pixel_scale).for_each(|_| bytes.extend_from_slice(&line));
    }
    bytes
}

/// The left and the right difference side by side, with a white gap between them, as a PNG: y / max|y| / 2 + 0.5 with
/// one scale for both, row 0 (at the wall) on top, each patch pixel `pixel_scale` picture pixels wide and high.
///
/// # Errors
///
/// If the picture would be empty or too large, or the PNG cannot be written.
pub fn difference_png(difference: &PatchPair, pixel_scale: u32) -> Result<Vec<u8>, RenderError> {
    let largest = largest(difference);
    pair_png(difference, pixel_scale, |y| magnify(y, largest))
}

/// The left and the right patch as they are, linear light encoded as sRGB, in the layout of [`difference_png`].
///
/// # Errors
///
/// If the picture would be empty or too large, or the PNG cannot be written.
pub fn patches_png(patches: &PatchPair, pixel_scale: u32) -> Result<Vec<u8>, RenderError> {
    pair_png(patches, pixel_scale, colour::encode)
}

fn pair_png(pair: &PatchPair, pixel_scale: u32, byte: impl Fn(f64) -> u8) -> Result<Vec<u8>, RenderError> {
    /// Space between the patches, in patch pixels.
    const GAP: u64 = 4;
    let [left, right] = [&pair.left, &pair.right];
    let scale = u64::from(pixel_scale);
    let [left_size, right_size] = [left, right].map(|p| p.size() as u64);
    let width = (left_size + GAP + right_size).saturating_mul(scale);
    let height = left_size.max(right_size).saturating_mul(scale);
    raster::check_size(width, height)?;

    // After this check none of these can overflow its type.
    let (width, height, scale) = (width as usize, height as usize, scale as usize);
    let mut page = vec![u8::MAX; 3 * width * height];
    for (patch, column) in [(left, 0), (right, (left.size() + GAP as usize) * scale)] {
        let side = patch.size() * scale;
        let bytes = enlarged(patch, scale, &byte);
        for (from, to) in bytes.chunks_exact((3 * side).max(1)).zip(page.chunks_exact_mut(3 * width)) {
            to[3 * column..3 * (column + side)].copy_from_slice(from);
        }
    }
    raster::encode(&page, width as u32, height as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(png: &[u8]) -> image::RgbImage {
        image::load_from_memory(png).expect("a PNG").to_rgb8()
    }

    #[test]
    fn zero_is_middle_grey_and_the_extreme_of_both_patches_is_saturated() {
        let mut pair = PatchPair::zeros(64);
        pair.left.plane_mut(0)[64 + 2] = 0.02; // row 1, column 2
        pair.right.plane_mut(2)[3] = -0.01; // row 0, column 3
        let picture = decode(&difference_png(&pair, 3).expect("png"));
        assert_eq!(picture.dimensions(), ((64 + 4 + 64) * 3, 64 * 3));
        for (dx, dy) in [(0, 0), (2, 2)] {
            assert_eq!(picture.get_pixel(2 * 3 + dx, 3 + dy).0, [255, 128, 128], "red at row 1, column 2");
            // Half the scale of the other patch: the scale is common.
            assert_eq!(picture.get_pixel((68 + 3) * 3 + dx, dy).0, [128, 128, 64], "blue lost at row 0, column 3");
        }
        assert_eq!(picture.get_pixel(2 * 3, 2).0, [128; 3], "row 0 is not row 1");
        assert_eq!(picture.get_pixel(64 * 3 + 5, 50).0, [255; 3], "the gap");
        assert_eq!(decode(&difference_png(&PatchPair::zeros(8), 1).expect("png")).get_pixel(3, 3).0, [128; 3]);
    }

    #[test]
    fn patches_are_shown_as_bright_as_they_are() {
        let mut pair = PatchPair::zeros(8);
        pair.left.plane_mut(1)[9] = 0.18; // row 1, column 1
        pair.right.data_mut().fill(2.0);
        let picture = decode(&patches_png(&pair, 2).expect("png"));
        assert_eq!(picture.dimensions(), (40, 16));
        assert_eq!((picture.get_pixel(0, 0).0, picture.get_pixel(3, 3).0), ([0; 3], [0, 118, 0]));
        assert_eq!(picture.get_pixel(39, 15).0, [255; 3], "clipped, not wrapped");
    }

    #[test]
    fn values_that_are_not_numbers_do_not_spoil_the_scale() {
        let mut pair = PatchPair::zeros(4);
        pair.left.data_mut()[..4].copy_from_slice(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.5]);
        let picture = decode(&difference_png(&pair, 1).expect("png"));
        let red: Vec<u8> = (0..4).map(|x| picture.get_pixel(x, 0).0[0]).collect();
        assert_eq!(red, [128, 255, 0, 255]);
    }

    #[test]
    fn a_picture_of_no_or_of_too_many_pixels_is_refused() {
        for scale in [0, 1000, u32::MAX] {
            assert!(matches!(difference_png(&PatchPair::zeros(64), scale), Err(RenderError::Size { .. })), "{scale}");
        }
    }
}
