//! Exact JPEG decoding compared with the 8-bit decoder in one run: quality 90, one core.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use doorcam_source::image::{ImageDecoder, JpegDepth};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

/// A textured floor with the noise of a webcam indoors, a standard deviation of about 2 codes.
fn picture(width: usize, height: usize) -> Vec<u8> {
    let mut state = 1u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
    };
    let mut rgb = Vec::with_capacity(3 * width * height);
    for k in 0..width * height {
        let (x, y) = ((k % width) as f64, (k / width) as f64);
        let floor = 120.0 + 40.0 * (0.03 * x).sin() * (0.05 * y).cos() + 12.0 * (0.7 * x + 0.3 * y).sin();
        for colour in [0.0, -8.0, -20.0] {
            rgb.push((floor + colour + 7.0 * uniform()).clamp(0.0, 255.0) as u8);
        }
    }
    rgb
}

fn jpeg(c: &mut Criterion) {
    for (width, height) in [(640_u16, 360_u16), (1280, 720)] {
        let rgb = picture(width.into(), height.into());
        let third = usize::from(height) / 3;
        for (name, sampling) in
            [("4:4:4", SamplingFactor::R_4_4_4), ("4:2:2", SamplingFactor::R_4_2_2), ("4:2:0", SamplingFactor::R_4_2_0)]
        {
            let mut bytes = Vec::new();
            let mut encoder = Encoder::new(&mut bytes, 90);
            encoder.set_sampling_factor(sampling);
            if encoder.encode(&rgb, width, height, ColorType::Rgb).is_err() {
                return;
            }
            println!("{width} x {height} {name}: {} bytes", bytes.len());
            let mut ways = [
                ("8 bits", JpegDepth::Eight, 0..usize::MAX),
                ("exact", JpegDepth::Exact, 0..usize::MAX),
                ("exact, the middle third", JpegDepth::Exact, third..2 * third),
            ]
            .map(|(way, depth, rows)| (way, ImageDecoder::with_jpegs_of(depth), rows, Duration::MAX));
            // The fastest of interleaved runs: other load on the machine hits all decoders alike, but not their fastest
            // runs.
            for _ in 0..100 {
                for (_, decoder, rows, fastest) in &mut ways {
                    let start = Instant::now();
                    if decoder.decode_rows(black_box(&bytes), None, rows.clone()).is_ok() {
                        *fastest = start.elapsed().min(*fastest);
                    }
                }
            }
            for (way, mut decoder, rows, fastest) in ways {
                println!("{way}: fastest of 100 interleaved runs {fastest:.2?}");
                c.bench_function(&format!("{width} x {height} {name} {way}"), |b| {
                    b.iter(|| decoder.decode_rows(black_box(&bytes), None, rows.clone()).is_ok())
                });
            }
        }
    }
}

criterion_group!(benches, jpeg);
criterion_main!(benches);
