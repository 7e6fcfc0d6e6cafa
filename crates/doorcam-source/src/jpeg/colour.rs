//! Converts components to rows of red, green and blue: upsamples chroma, then applies JFIF's colour matrix.

use super::header::Colours;

/// A component's samples of one row of units (MCU), preceded by the last row of the units above.
#[derive(Debug, Clone, Default)]
pub(super) struct Strip {
    /// Row by row.
    pub samples: Vec<f32>,
    /// Samples a row.
    pub stride: usize,
    /// Number of the component's rows above these units.
    pub above: usize,
    /// Samples across and down of the whole component that belong to the image; the blocks may extend beyond them.
    pub size: (usize, usize),
    /// Whether a sample covers two pixels: across, down.
    pub halved: (bool, bool),
}

/// Scratch for upsampling.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    blended: Vec<f32>,
    wide: Vec<f32>,
}

impl Strip {
    /// Resizes to `height` rows and the one above them.
    pub fn resize(&mut self, stride: usize, height: usize) {
        self.stride = stride;
        self.samples.resize(stride * (1 + height), 0.0);
    }

    /// Prepares for the next row of units: the last row becomes the one above.
    pub fn next(&mut self) {
        let last = self.samples.len() - self.stride;
        self.samples.copy_within(last.., 0);
    }

    /// The samples of the component's row `y`, or of its last row if `y` is beyond it.
    fn row(&self, y: usize) -> &[f32] {
        let place = y.min(self.size.1 - 1) + 1 - self.above;
        &self.samples[place * self.stride..][..self.stride]
    }

    /// The component's values at the pixels of the image's row `y`.
    ///
    /// A pixel's centre is a quarter of a halved sample's width from the centre of the nearest sample. Values are
    /// interpolated linearly between samples, like libjpeg's "fancy" triangle filter, which encoders expect, and are
    /// constant beyond the outermost.
    #[inline(always)]
    fn pixels<'a>(&'a self, y: usize, scratch: &'a mut Scratch) -> &'a [f32] {
        let Scratch { blended, wide } = scratch;
        let mut row = if self.halved.1 { self.row(y / 2) } else { self.row(y) };
        if self.halved.1 {
            let far = self.row(if y.is_multiple_of(2) { (y / 2).saturating_sub(1) } else { y / 2 + 1 });
            blended.resize(self.stride, 0.0);
            blended.iter_mut().zip(row).zip(far).for_each(|((out, near), far)| *out = 0.75 * near + 0.25 * far);
            row = blended;
        }
        if self.halved.0 {
            wide.resize(2 * self.stride, 0.0);
            let row = &row[..self.size.0];
            for (pair, sides) in wide[1..].chunks_exact_mut(2).zip(row.windows(2)) {
                pair[0] = 0.75 * sides[0] + 0.25 * sides[1];
                pair[1] = 0.25 * sides[0] + 0.75 * sides[1];
            }
            (wide[0], wide[2 * row.len() - 1]) = (row[0], row[row.len() - 1]);
            return wide;
        }
        row
    }
}

/// Writes the image's row `y` as 16-bit codes, three for each pixel.
#[inline(always)]
pub(super) fn write_row(strips: &[Strip; 3], colours: Colours, y: usize, scratch: &mut [Scratch; 3], out: &mut [u16]) {
    let [first, second, third] = strips;
    let [scratch1, scratch2, scratch3] = scratch;
    let first = first.pixels(y, scratch1);
    if colours == Colours::Grey {
        out.chunks_exact_mut(3).zip(first).for_each(|(rgb, &v)| rgb.fill(code(v)));
        return;
    }
    let (second, third) = (second.pixels(y, scratch2), third.pixels(y, scratch3));
    let groups = first.chunks(GROUP).zip(second.chunks(GROUP)).zip(third.chunks(GROUP));
    for (out, ((a, b), c)) in out.chunks_mut(3 * GROUP).zip(groups) {
        match (a.try_into(), b.try_into(), c.try_into(), out.try_into()) {
            (Ok(a), Ok(b), Ok(c), Ok(out)) => convert(colours, a, b, c, out),
            _ => {
                // The end of the row: convert a padded group, and keep the part that exists.
                let mut whole = [[0.0; GROUP]; 3];
                for (whole, part) in whole.iter_mut().zip([a, b, c]) {
                    whole[..part.len().min(GROUP)].copy_from_slice(part);
                }
                let mut codes = [0; 3 * GROUP];
                convert(colours, &whole[0], &whole[1], &whole[2], &mut codes);
                out.copy_from_slice(&codes[..out.len()]);
            }
        }
    }
}

/// Pixels that are converted together.
const GROUP: usize = 16;

/// Codes of a group of pixels. Chroma is centred on 0, all else is 0 to 255 (JFIF 1.02: matrix of BT.601, full range).
#[inline(always)]
fn convert(colours: Colours, a: &[f32; GROUP], b: &[f32; GROUP], c: &[f32; GROUP], out: &mut [u16; 3 * GROUP]) {
    let mut planes = [[0; GROUP]; 3];
    for k in 0..GROUP {
        let (red, green, blue) = match colours {
            Colours::YCbCr => {
                (a[k] + 1.402 * c[k], a[k] - 0.344_136_3 * b[k] - 0.714_136_3 * c[k], a[k] + 1.772 * b[k])
            }
            Colours::Rgb | Colours::Grey => (a[k], b[k], c[k]),
        };
        (planes[0][k], planes[1][k], planes[2][k]) = (code(red), code(green), code(blue));
    }
    for (k, rgb) in out.chunks_exact_mut(3).enumerate() {
        (rgb[0], rgb[1], rgb[2]) = (planes[0][k], planes[1][k], planes[2][k]);
    }
}

/// The 16-bit code of a value of 0 to 255.
#[inline(always)]
fn code(value: f32) -> u16 {
    // From 2^23 on, the last bit of an f32 is worth 1: adding 2^23 rounds, and leaves the integer in the low bits.
    (value.clamp(0.0, 255.0) * 257.0 + 8_388_608.0).to_bits() as u16
}
