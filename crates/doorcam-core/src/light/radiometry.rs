use crate::image::{Image, Samples};
use crate::optics::Transfer;

/// How image codes are converted to linear light.
#[derive(Debug, Clone, PartialEq)]
pub enum Decoding {
    /// Inverts the transfer function; full scale is 1.
    Light(Transfer),
    /// As in the authors' program: code / 256 or code / 65536, without inverting a transfer function.
    Published,
}

impl Decoding {
    /// Light of a code of `bits` bits.
    fn light(&self, code: usize, bits: u32) -> f64 {
        match self {
            Decoding::Published => code as f64 / f64::from(1u32 << bits),
            Decoding::Light(transfer) => transfer.light(code as f64 / f64::from((1u32 << bits) - 1)),
        }
    }
}

/// Precomputed tables from 8-bit and 16-bit codes to light.
#[derive(Debug, Clone)]
pub struct LightTable {
    eight: Vec<f32>,
    sixteen: Vec<f32>,
}

impl LightTable {
    /// Computes the tables of a decoding.
    pub fn new(decoding: &Decoding) -> Self {
        let table = |bits: u32| (0..1usize << bits).map(|code| decoding.light(code, bits) as f32).collect();
        Self { eight: table(8), sixteen: table(16) }
    }

    /// Replaces the contents of `out` with the light of the samples `range` of an image.
    pub fn read(&self, image: &Image, range: std::ops::Range<usize>, out: &mut Vec<f32>) {
        out.clear();
        match &image.samples {
            Samples::Eight(codes) => out.extend(codes[range].iter().map(|&c| self.eight[usize::from(c)])),
            Samples::Sixteen(codes) => out.extend(codes[range].iter().map(|&c| self.sixteen[usize::from(c)])),
        }
    }

    /// Adds the weighted light of consecutive pixels of an image, from pixel `first` on and one per weight, to the sums
    /// of red, green and blue.
    pub fn add_weighted(&self, image: &Image, first: usize, weights: &[f32], sums: &mut [f32; 3]) {
        let samples = 3 * first..3 * (first + weights.len());
        match &image.samples {
            Samples::Eight(codes) => add(&self.eight, &codes[samples], weights, sums),
            Samples::Sixteen(codes) => add(&self.sixteen, &codes[samples], weights, sums),
        }
    }
}

fn add<C: Copy + Into<usize>>(table: &[f32], codes: &[C], weights: &[f32], sums: &mut [f32; 3]) {
    for (rgb, weight) in codes.chunks_exact(3).zip(weights) {
        for (sum, &code) in sums.iter_mut().zip(rgb) {
            *sum += weight * table[code.into()];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_codes_are_divided_by_a_power_of_two() {
        assert_eq!(Decoding::Published.light(128, 8), 0.5);
        assert_eq!(Decoding::Published.light(65535, 16), 65535.0 / 65536.0);
        assert_eq!(Decoding::Light(Transfer::Linear).light(255, 8), 1.0);
    }
}
