//! Decoding a camera's JPEGs exactly allocates nothing once one has been decoded.

use crate::allocations;
use doorcam_source::image::{ImageDecoder, JpegDepth};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

fn jpeg(seed: usize, sampling: SamplingFactor) -> Vec<u8> {
    let pixels: Vec<u8> = (0..3 * 160 * 90).map(|k| (k * (k + seed) / 97 % 256) as u8).collect();
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 90);
    encoder.set_sampling_factor(sampling);
    encoder.encode(&pixels, 160, 90, ColorType::Rgb).expect("a JPEG");
    bytes
}

pub fn check() {
    for sampling in [SamplingFactor::R_4_4_4, SamplingFactor::R_4_2_2, SamplingFactor::R_4_2_0, SamplingFactor::R_4_4_0]
    {
        let frames: Vec<Vec<u8>> = (0..4).map(|seed| jpeg(seed, sampling)).collect();
        let mut decoder = ImageDecoder::with_jpegs_of(JpegDepth::Exact);
        let mut step = |bytes: &Vec<u8>| {
            decoder.decode(bytes, Some((160, 90))).expect("decodes");
            decoder.decode_rows(bytes, Some((160, 90)), 30..60).expect("decodes");
        };
        step(&frames[0]);
        let fewest = (0..4).map(|_| allocations(|| frames.iter().for_each(&mut step))).min();
        assert_eq!(fewest, Some(0));
    }
}
