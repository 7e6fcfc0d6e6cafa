//! Reduces patch images to the pixels of the model.

use crate::image::Image;
use crate::light::{LightTable, Patch};

/// How a patch image's pixels are averaged into the model's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// The published filter: antialiased bicubic (a = −0.5) with mirrored borders, on a crop of whole image pixels.
    Bicubic,
    /// The mean over each cell.
    Area,
}

/// Crops a square out of a patch image (`fraction` of its side, at the wall, centred in x) and averages it to
/// `size` x `size` pixels.
#[derive(Debug, Clone)]
pub struct PatchResampler {
    image_size: (usize, usize),
    size: usize,
    columns: Weights,
    rows: Weights,
}

/// Per output pixel, the input pixels and their weights.
type Weights = Vec<Vec<(usize, f64)>>;

impl PatchResampler {
    /// A resampler for images of `width` x `height` pixels.
    pub fn new((width, height): (usize, usize), fraction: f64, size: usize, filter: Filter) -> Self {
        let side = |n: usize| n as f64 * fraction;
        let centred = (width as f64 - side(width)) / 2.0;
        let (columns, rows) = match filter {
            Filter::Bicubic => {
                let crop = |from: f64, to: f64| (from.round() as usize, to.round() as usize);
                let bicubic = |(from, to): (usize, usize)| {
                    bicubic(to - from, size)
                        .into_iter()
                        .map(move |taps| taps.into_iter().map(|(k, w)| (from + k, w)).collect())
                        .collect()
                };
                (bicubic(crop(centred, centred + side(width))), bicubic(crop(0.0, side(height))))
            }
            Filter::Area => (area(centred, side(width), size, width), area(0.0, side(height), size, height)),
        };
        Self { image_size: (width, height), size, columns, rows }
    }

    /// The image size (width, height) for which this was made.
    pub fn image_size(&self) -> (usize, usize) {
        self.image_size
    }

    /// Averages the linear light of `image` into `patch`. The image must have the size [`Self::image_size`].
    pub fn apply(&self, image: &Image, table: &LightTable, patch: &mut Patch) {
        debug_assert_eq!((image.width, image.height), self.image_size);
        let size = self.size;
        let mut line = Vec::new();
        // Column-reduced rows under the output row's window. Windows overlap, so rows are kept until passed.
        let mut reduced: Vec<Option<Vec<f64>>> = vec![None; image.height];
        for (row, taps) in self.rows.iter().enumerate() {
            let first = taps.iter().map(|&(k, _)| k).min().unwrap_or(0);
            reduced[..first].fill(None);
            let mut sums = vec![0.0_f64; 3 * size];
            for &(k, weight) in taps {
                let values = reduced[k].get_or_insert_with(|| {
                    table.read(image, 3 * k * image.width..3 * (k + 1) * image.width, &mut line);
                    self.reduce(&line)
                });
                for (sum, value) in sums.iter_mut().zip(values) {
                    *sum += weight * *value;
                }
            }
            for channel in 0..3 {
                let out = &mut patch.plane_mut(channel)[row * size..(row + 1) * size];
                for (o, s) in out.iter_mut().zip(&sums[channel * size..]) {
                    *o = *s as f32;
                }
            }
        }
    }

    /// Reduces one interleaved line of light to `size` columns in three planes.
    fn reduce(&self, line: &[f32]) -> Vec<f64> {
        let mut out = vec![0.0; 3 * self.size];
        for (column, taps) in self.columns.iter().enumerate() {
            let mut sum = [0.0_f64; 3];
            for &(k, weight) in taps {
                for (channel, s) in sum.iter_mut().enumerate() {
                    *s += weight * f64::from(line[3 * k + channel]);
                }
            }
            for (channel, s) in sum.iter().enumerate() {
                out[channel * self.size + column] = *s;
            }
        }
        out
    }
}

/// Keys's cubic convolution kernel with a = −0.5.
fn cubic(x: f64) -> f64 {
    let x = x.abs();
    if x <= 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x <= 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

/// Weights of the antialiased bicubic reduction of `n` pixels to `size`: the kernel is stretched by the reduction
/// factor and mirrored at the borders.
fn bicubic(n: usize, size: usize) -> Weights {
    // No stretching when enlarging.
    let stretch = (n as f64 / size as f64).max(1.0);
    (0..size)
        .map(|k| {
            let centre = (k as f64 + 0.5) * n as f64 / size as f64 - 0.5;
            let reach = 2.0 * stretch;
            let mut taps: Vec<(usize, f64)> = Vec::new();
            for j in (centre - reach).floor() as i64..=(centre + reach).ceil() as i64 {
                let weight = cubic((j as f64 - centre) / stretch);
                if weight == 0.0 {
                    continue;
                }
                let period = 2 * n as i64;
                let folded = j.rem_euclid(period).min(period - 1 - j.rem_euclid(period)) as usize;
                match taps.iter_mut().find(|(index, _)| *index == folded) {
                    Some(tap) => tap.1 += weight,
                    None => taps.push((folded, weight)),
                }
            }
            let total: f64 = taps.iter().map(|&(_, w)| w).sum();
            taps.iter_mut().for_each(|tap| tap.1 /= total);
            taps
        })
        .collect()
}

/// Weights of the mean over each of `size` equal cells of the interval `start .. start + length` of `n` pixels.
fn area(start: f64, length: f64, size: usize, n: usize) -> Weights {
    let cell = length / size as f64;
    (0..size)
        .map(|k| {
            let (from, to) = (start + k as f64 * cell, start + (k + 1) as f64 * cell);
            (from.floor() as usize..(to.ceil() as usize).min(n))
                .map(|j| (j, (to.min(j as f64 + 1.0) - from.max(j as f64)) / cell))
                .filter(|&(_, w)| w > 1e-12)
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::image::Samples;
    use crate::light::Decoding;
    use crate::optics::Transfer;

    fn apply(image: &Image, fraction: f64, size: usize, filter: Filter) -> Patch {
        let mut patch = Patch::zeros(size);
        PatchResampler::new((image.width, image.height), fraction, size, filter).apply(
            image,
            &LightTable::new(&Decoding::Light(Transfer::Linear)),
            &mut patch,
        );
        patch
    }

    fn ramp(width: usize, height: usize, code: impl Fn(usize, usize, usize) -> u16) -> Image {
        let samples = (0..height)
            .flat_map(|y| (0..width).flat_map(move |x| [0, 1, 2].map(|c| (x, y, c))))
            .map(|(x, y, c)| code(x, y, c))
            .collect();
        Image { width, height, samples: Samples::Sixteen(samples) }
    }

    #[test]
    fn bicubic_weights_are_the_published_convention() {
        // Reduction by two with a = -0.5, interior pixel: the known taps of the stretched kernel.
        let taps = &bicubic(16, 8)[4];
        let expected = [-0.011_718_75, -0.035_156_25, 0.113_281_25, 0.433_593_75];
        for (k, e) in expected.iter().enumerate() {
            for j in [5 + k, 12 - k] {
                let weight = taps.iter().find(|&&(index, _)| index == j).unwrap().1;
                assert!((weight - e).abs() < 1e-12, "pixel {j}: {weight}");
            }
        }
    }

    #[test]
    fn the_crop_is_the_half_nearest_the_wall_centred() {
        let image = ramp(512, 512, |x, y, c| if c == 0 { 100 * x as u16 } else { 100 * y as u16 });
        for filter in [Filter::Bicubic, Filter::Area] {
            let patch = apply(&image, 0.5, 64, filter);
            for (row, column) in [(5, 9), (30, 31), (50, 60)] {
                // Centres of cells of 4 x 4 pixels, starting at column 128 and row 0.
                let (x, y) = (128.0 + 4.0 * column as f32 + 1.5, 4.0 * row as f32 + 1.5);
                let k = row * 64 + column;
                assert!((patch.plane(0)[k] * 65535.0 - 100.0 * x).abs() < 0.05, "{filter:?}");
                assert!((patch.plane(1)[k] * 65535.0 - 100.0 * y).abs() < 0.05, "{filter:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn a_constant_stays_a_constant(
            width in 8usize..200, height in 8usize..200, size in 2usize..40, fraction in 0.3..1.0f64, code in any::<u16>(),
        ) {
            let image = ramp(width, height, |_, _, _| code);
            for filter in [Filter::Bicubic, Filter::Area] {
                let patch = apply(&image, fraction, size, filter);
                prop_assert!(patch.data().iter().all(|v| (v - f32::from(code) / 65535.0).abs() < 1e-6));
            }
        }

        #[test]
        fn area_keeps_the_mean(width in 8usize..100, size in 2usize..40, seed in any::<u16>()) {
            let image = ramp(width, width, |x, y, c| seed.wrapping_mul((x * 31 + y * 17 + c * 7 + 1) as u16));
            let patch = apply(&image, 1.0, size, Filter::Area);
            let Samples::Sixteen(codes) = &image.samples else { unreachable!() };
            let mean = |values: &mut dyn Iterator<Item = f64>| {
                let (sum, n) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
                sum / n
            };
            let before = mean(&mut codes.iter().map(|&c| f64::from(c) / 65535.0));
            let after = mean(&mut patch.data().iter().map(|&v| f64::from(v)));
            prop_assert!((before - after).abs() < 1e-6);
        }
    }
}
