//! Raw pixels as a camera's driver delivers them.

use std::ops::Range;

use crate::image_error::ImageError;
use doorcam_core::image::Image;

/// How the bytes of a raw frame are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SensorFormat {
    /// Order and subsampling of the samples.
    pub pixels: SensorPixels,
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Bytes from one row (of either plane) to the next.
    pub stride: usize,
    /// Whether samples use all 8 bits; otherwise black to white is 16..=235, and chroma 16..=240.
    pub full_range: bool,
    /// Matrix from luma and chroma to red, green and blue.
    pub matrix: LumaMatrix,
}

/// Order and subsampling of a raw frame's samples, by V4L2's names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SensorPixels {
    /// Y0 Cb Y1 Cr: two pixels share their chroma.
    Yuyv,
    /// A plane of luma, then a plane with one Cb Cr pair for each 2 x 2 pixels.
    Nv12,
    /// Red, green, blue.
    Rgb24,
    /// Luma only.
    Grey,
}

/// Weights of red, green and blue in luma.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LumaMatrix {
    /// ITU-R BT.601.
    Bt601,
    /// ITU-R BT.709.
    Bt709,
}

impl LumaMatrix {
    /// Weights of red and blue; green has the rest of 1.
    fn weights(self) -> (f64, f64) {
        match self {
            LumaMatrix::Bt601 => (0.299, 0.114),
            LumaMatrix::Bt709 => (0.2126, 0.0722),
        }
    }
}

impl SensorFormat {
    /// The least number of bytes in a frame: the last row's padding may be missing.
    ///
    /// # Errors
    /// If the format has no pixels, a row does not fit its stride, or the size overflows.
    pub fn bytes(&self) -> Result<usize, ImageError> {
        self.checked_bytes().ok_or(ImageError::SensorFormat {
            width: self.width,
            height: self.height,
            stride: self.stride,
            pixels: self.pixels,
        })
    }

    fn checked_bytes(&self) -> Option<usize> {
        let pairs = self.width.div_ceil(2);
        let row = match self.pixels {
            SensorPixels::Yuyv => pairs.checked_mul(4)?,
            SensorPixels::Nv12 => pairs.checked_mul(2)?,
            SensorPixels::Rgb24 => self.width.checked_mul(3)?,
            SensorPixels::Grey => self.width,
        };
        let rows = match self.pixels {
            SensorPixels::Nv12 => self.height.checked_add(self.height.div_ceil(2))?,
            SensorPixels::Yuyv | SensorPixels::Rgb24 | SensorPixels::Grey => self.height,
        };
        if self.width == 0 || self.height == 0 || self.stride < row {
            return None;
        }
        // The decoded image, 3 samples of 2 bytes a pixel, must be addressable too.
        self.width.checked_mul(self.height)?.checked_mul(6)?;
        (rows - 1).checked_mul(self.stride)?.checked_add(row)
    }

    /// Decodes `rows` of a frame to red, green and blue as 16-bit codes in `image`, which takes on the frame's size.
    /// Its other rows keep their contents. Chroma is not interpolated between the pixels that share it.
    ///
    /// 8 bits of luma and chroma give more than 8 bits of colour: rounding to 8 bits would add noise.
    ///
    /// # Errors
    /// If the format is impossible or `bytes` are fewer than [`SensorFormat::bytes`].
    pub fn decode_rows(&self, bytes: &[u8], rows: Range<usize>, image: &mut Image) -> Result<(), ImageError> {
        let expected = self.bytes()?;
        if bytes.len() < expected {
            return Err(ImageError::Short { got: bytes.len(), expected });
        }
        let rows = rows.start.min(self.height)..rows.end.min(self.height);
        let samples = image.sixteen_mut(self.width, self.height);
        let tables = Tables::new(self);
        let row_of = |y: usize, length: usize| &bytes[y * self.stride..][..length];
        let (width, pairs) = (self.width, self.width.div_ceil(2));
        for y in rows {
            let out = &mut samples[3 * width * y..3 * width * (y + 1)];
            match self.pixels {
                SensorPixels::Yuyv => {
                    let row = row_of(y, 4 * pairs).chunks_exact(4);
                    for (quad, out) in row.zip(out.chunks_mut(6)) {
                        let chroma = tables.chroma(quad[1], quad[3]);
                        let luma = [quad[0], quad[2]];
                        out.chunks_exact_mut(3).zip(luma).for_each(|(rgb, y)| tables.write(y, chroma, rgb));
                    }
                }
                SensorPixels::Nv12 => {
                    let luma = row_of(y, width).chunks(2);
                    let colour = row_of(self.height + y / 2, 2 * pairs).chunks_exact(2);
                    for ((luma, pair), out) in luma.zip(colour).zip(out.chunks_mut(6)) {
                        let chroma = tables.chroma(pair[0], pair[1]);
                        out.chunks_exact_mut(3).zip(luma).for_each(|(rgb, &y)| tables.write(y, chroma, rgb));
                    }
                }
                SensorPixels::Rgb24 => {
                    out.iter_mut().zip(row_of(y, 3 * width)).for_each(|(o, &c)| *o = tables.code(c));
                }
                SensorPixels::Grey => {
                    let luma = row_of(y, width);
                    out.chunks_exact_mut(3).zip(luma).for_each(|(rgb, &y)| rgb.fill(tables.code(y)));
                }
            }
        }
        Ok(())
    }
}

/// Fraction bits of the fixed-point codes in the tables.
const FRACTION: u32 = 12;

/// For each value of a sample, its contribution to the 16-bit codes of red, green and blue, in fixed point.
struct Tables {
    luma: [i32; 256],
    red_cr: [i32; 256],
    green_cb: [i32; 256],
    green_cr: [i32; 256],
    blue_cb: [i32; 256],
}

impl Tables {
    fn new(format: &SensorFormat) -> Self {
        let (black, white, chroma) = if format.full_range { (0.0, 255.0, 255.0) } else { (16.0, 235.0, 224.0) };
        let unit = 65535.0 * f64::from(1 << FRACTION);
        let table = |zero: f64, gain: f64| std::array::from_fn(|k| ((k as f64 - zero) * gain * unit).round() as i32);
        let (kr, kb) = format.matrix.weights();
        let kg = 1.0 - kr - kb;
        let (red, blue) = (2.0 * (1.0 - kr), 2.0 * (1.0 - kb));
        Self {
            luma: table(black, 1.0 / (white - black)),
            red_cr: table(128.0, red / chroma),
            green_cb: table(128.0, -blue * kb / kg / chroma),
            green_cr: table(128.0, -red * kr / kg / chroma),
            blue_cb: table(128.0, blue / chroma),
        }
    }

    /// Contribution of a Cb and a Cr to red, green and blue.
    fn chroma(&self, cb: u8, cr: u8) -> [i32; 3] {
        let (cb, cr) = (usize::from(cb), usize::from(cr));
        [self.red_cr[cr], self.green_cb[cb] + self.green_cr[cr], self.blue_cb[cb]]
    }

    fn write(&self, luma: u8, chroma: [i32; 3], rgb: &mut [u16]) {
        let luma = self.luma[usize::from(luma)];
        rgb.iter_mut().zip(chroma).for_each(|(out, c)| *out = rounded(luma + c));
    }

    fn code(&self, value: u8) -> u16 {
        rounded(self.luma[usize::from(value)])
    }
}

/// Rounds a fixed-point code, clamped to black and white.
fn rounded(code: i32) -> u16 {
    ((code + (1 << (FRACTION - 1))) >> FRACTION).clamp(0, 65535) as u16
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use doorcam_core::image::Samples;

    const PIXELS: [SensorPixels; 4] = [SensorPixels::Yuyv, SensorPixels::Nv12, SensorPixels::Rgb24, SensorPixels::Grey];

    /// Red, green and blue of a pixel, 0 to 1, straight from the standards' formulas.
    fn literal(format: &SensorFormat, bytes: &[u8], x: usize, y: usize) -> [f64; 3] {
        let at = |k: usize| f64::from(bytes[k]);
        let row = y * format.stride;
        let (luma, cb, cr) = match format.pixels {
            SensorPixels::Yuyv => (at(row + 2 * x), at(row + 4 * (x / 2) + 1), at(row + 4 * (x / 2) + 3)),
            SensorPixels::Nv12 => {
                let colour = (format.height + y / 2) * format.stride + 2 * (x / 2);
                (at(row + x), at(colour), at(colour + 1))
            }
            SensorPixels::Grey => (at(row + x), 128.0, 128.0),
            SensorPixels::Rgb24 => {
                let (black, range) = if format.full_range { (0.0, 255.0) } else { (16.0, 219.0) };
                return [0, 1, 2].map(|c| ((at(row + 3 * x + c) - black) / range).clamp(0.0, 1.0));
            }
        };
        let (y, cb, cr) = if format.full_range {
            (luma / 255.0, (cb - 128.0) / 255.0, (cr - 128.0) / 255.0)
        } else {
            ((luma - 16.0) / 219.0, (cb - 128.0) / 224.0, (cr - 128.0) / 224.0)
        };
        let rgb = match format.matrix {
            LumaMatrix::Bt601 => [y + 1.402 * cr, y - 0.344_136_286 * cb - 0.714_136_286 * cr, y + 1.772 * cb],
            LumaMatrix::Bt709 => [y + 1.5748 * cr, y - 0.187_324_273 * cb - 0.468_124_273 * cr, y + 1.8556 * cb],
        };
        rgb.map(|v| v.clamp(0.0, 1.0))
    }

    fn formats() -> impl Strategy<Value = SensorFormat> {
        (0usize..4, 1usize..24, 1usize..12, 0usize..9, any::<bool>(), any::<bool>()).prop_map(
            |(pixels, width, height, padding, full_range, bt601)| {
                let pixels = PIXELS[pixels];
                let row = match pixels {
                    SensorPixels::Yuyv => 4 * width.div_ceil(2),
                    SensorPixels::Nv12 => 2 * width.div_ceil(2),
                    SensorPixels::Rgb24 => 3 * width,
                    SensorPixels::Grey => width,
                };
                let matrix = if bt601 { LumaMatrix::Bt601 } else { LumaMatrix::Bt709 };
                SensorFormat { pixels, width, height, stride: row + padding, full_range, matrix }
            },
        )
    }

    fn noise(length: usize, seed: u64) -> Vec<u8> {
        let mut state = seed | 1;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        };
        (0..length).map(|_| next()).collect()
    }

    fn blank() -> Image {
        Image { width: 0, height: 0, samples: Samples::Sixteen(Vec::new()) }
    }

    proptest! {
        #[test]
        fn every_pixel_is_what_the_standards_say(format in formats(), seed in any::<u64>(), from in 0usize..12, to in 0usize..14) {
            let bytes = noise(format.bytes().unwrap(), seed);
            let mut image = blank();
            image.sixteen_mut(format.width, format.height).fill(7);
            format.decode_rows(&bytes, from..to, &mut image).unwrap();
            let Samples::Sixteen(codes) = &image.samples else { unreachable!() };
            for (k, rgb) in codes.chunks(3).enumerate() {
                let (x, y) = (k % format.width, k / format.width);
                if !(from..to).contains(&y) {
                    prop_assert_eq!(rgb, [7, 7, 7], "row {} was not asked for", y);
                    continue;
                }
                for (code, truth) in rgb.iter().zip(literal(&format, &bytes, x, y)) {
                    prop_assert!((f64::from(*code) - 65535.0 * truth).abs() < 0.51, "{format:?} {x} {y}: {code} {truth}");
                }
            }
        }

        #[test]
        fn a_short_buffer_is_an_error(format in formats(), missing in 1usize..2000) {
            let length = format.bytes().unwrap().saturating_sub(missing);
            let error = format.decode_rows(&vec![0; length], 0..1, &mut blank()).expect_err("short");
            let expected = format.bytes().unwrap();
            prop_assert_eq!(error.to_string(), format!("the raw frame has {length} bytes, expected at least {expected}"));
        }

        #[test]
        fn no_format_makes_it_panic(
            pixels in 0usize..4, width in any::<usize>(), height in any::<usize>(), stride in any::<usize>(), length in 0usize..3000,
            small in any::<bool>(), rows in any::<(usize, usize)>(),
        ) {
            let limit = |n: usize| if small { n % 40 } else { n };
            let format = SensorFormat {
                pixels: PIXELS[pixels], width: limit(width), height: limit(height), stride: limit(stride),
                full_range: true, matrix: LumaMatrix::Bt601,
            };
            let _ = format.decode_rows(&vec![3; length], rows.0..rows.1, &mut blank());
            let _ = crate::image::decode_sensor(&format, &vec![3; length]);
        }
    }

    #[test]
    fn a_stride_that_cannot_hold_a_row_is_refused() {
        let format = SensorFormat {
            pixels: SensorPixels::Yuyv,
            width: 5,
            height: 2,
            stride: 11,
            full_range: false,
            matrix: LumaMatrix::Bt601,
        };
        let error = format.bytes().expect_err("three pairs need 12 bytes");
        assert_eq!(error.to_string(), "a raw frame of 5 x 2 pixels (Yuyv) cannot have rows of 11 bytes");
    }

    #[test]
    fn a_picture_for_people_has_8_bits() {
        let format = SensorFormat {
            pixels: SensorPixels::Grey,
            width: 3,
            height: 1,
            stride: 3,
            full_range: false,
            matrix: LumaMatrix::Bt601,
        };
        let image = crate::image::decode_sensor(&format, &[16, 126, 240]).unwrap();
        assert_eq!(image.samples, Samples::Eight(vec![0, 0, 0, 128, 128, 128, 255, 255, 255]));
    }
}
