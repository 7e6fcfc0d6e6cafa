//! Decoding and rectifying a webcam frame to a patch pair: 1280 x 720 pixels, patches of 64 x 64, one core.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use doorcam_core::calibration::Calibration;
use doorcam_core::light::PatchPair;
use doorcam_engine::{FrameReader, Settings};
use doorcam_source::sensor::{LumaMatrix, SensorFormat, SensorPixels};
use doorcam_source::{Purpose, RawFrame, RawImages};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

const WIDTH: usize = 1280;
const HEIGHT: usize = 720;

/// A camera 1.1 m high and 1.3 m in front of a door 0.8 m wide: the patches cover 30 % of its image.
const CALIBRATION: &str = r#"{"size": [1280, 720], "doorway": {"width_m": 0.8, "wall_thickness_m": 0.1},
    "lens": {"k1": -0.05, "focal_px": 1100},
    "floor_points": [{"pixel": [315, 210], "floor_m": [-0.4, -0.1]}, {"pixel": [965, 210], "floor_m": [0.4, -0.1]},
        {"pixel": [1040, 480], "floor_m": [0.4, -0.4]}, {"pixel": [240, 480], "floor_m": [-0.4, -0.4]}]}"#;

/// A textured floor with a gradient across it and the noise of a webcam indoors.
fn picture() -> Vec<u8> {
    let mut state = 1u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
    };
    let mut rgb = Vec::with_capacity(3 * WIDTH * HEIGHT);
    for k in 0..WIDTH * HEIGHT {
        let (x, y) = ((k % WIDTH) as f64, (k / WIDTH) as f64);
        let floor = 120.0 + 40.0 * (0.03 * x).sin() * (0.05 * y).cos() + 12.0 * (0.7 * x + 0.3 * y).sin();
        for colour in [0.0, -8.0, -20.0] {
            // The scaled sum of four has a standard deviation of about 3 codes.
            let noise: f64 = (0..4).map(|_| uniform()).sum::<f64>() * 5.2;
            rgb.push((floor + colour + noise).clamp(0.0, 255.0) as u8);
        }
    }
    rgb
}

fn frame(images: RawImages) -> RawFrame {
    RawFrame { index: None, purpose: Purpose::Live, seconds: 0.0, images, time: None, name: "bench".into() }
}

fn rectify(c: &mut Criterion) {
    let Ok(calibration) = serde_json::from_str::<Calibration>(CALIBRATION) else { return };
    let Ok(mut reader) = FrameReader::for_calibration(&Settings::default(), &calibration) else { return };
    let mut pair = PatchPair::zeros(reader.patch().size);
    let rgb = picture();

    let mut mjpg = Vec::new();
    let mut encoder = Encoder::new(&mut mjpg, 90);
    encoder.set_sampling_factor(SamplingFactor::R_4_2_2);
    if encoder.encode(&rgb, WIDTH as u16, HEIGHT as u16, ColorType::Rgb).is_err() {
        return;
    }
    let mut frames = vec![("MJPG", frame(RawImages::Camera(Arc::new(mjpg))))];
    for (name, pixels, stride, rows) in [
        ("YUYV", SensorPixels::Yuyv, 2 * WIDTH, HEIGHT),
        ("NV12", SensorPixels::Nv12, WIDTH, HEIGHT * 3 / 2),
        ("RGB24", SensorPixels::Rgb24, 3 * WIDTH, HEIGHT),
        ("GREY", SensorPixels::Grey, WIDTH, HEIGHT),
    ] {
        let matrix = LumaMatrix::Bt601;
        let format = SensorFormat { pixels, width: WIDTH, height: HEIGHT, stride, full_range: false, matrix };
        // The decoding time does not depend on the contents.
        let bytes = rgb[..stride * rows].to_vec();
        frames.push((name, frame(RawImages::Sensor(format, Arc::new(bytes)))));
    }
    for (name, frame) in &frames {
        let Ok(times) = reader.read(frame, &mut pair).and_then(|_| reader.read(frame, &mut pair)) else { return };
        let size = match &frame.images {
            RawImages::Camera(bytes) | RawImages::Sensor(_, bytes) | RawImages::Patches([bytes, _]) => bytes.len(),
        };
        println!("{name}: {size} bytes, decode {:.2?}, rectify {:.2?}", times.decode, times.rectify);
        c.bench_function(&format!("rectify {name}"), |b| {
            b.iter(|| reader.read(black_box(frame), &mut pair).map_err(|e| e.to_string()))
        });
    }
    c.bench_function("calibrate", |b| {
        b.iter(|| FrameReader::for_calibration(&Settings::default(), &calibration).is_ok())
    });
    let patch = reader.patch();
    c.bench_function("check a calibration", |b| b.iter(|| black_box(&calibration).check(&patch)));
}

criterion_group!(benches, rectify);
criterion_main!(benches);
