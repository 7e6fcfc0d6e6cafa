//! A function of bytes for every kind of untrusted input. It may accept or reject the bytes, but must not panic, hang
//! or take more memory than they justify. The fuzz targets beside this file and `tests/daemon/hostile.rs` call them.

use std::path::Path;

use doorcam::config::Config;
use doorcam_core::calibration::Calibration;
use doorcam_core::light::{Fingerprint, Snapshot};
use doorcam_engine::simulation::Scenario;
use doorcam_engine::{Assembly, FrameReader, Settings};
use doorcam_source::image::{ImageDecoder, JpegDepth};
use doorcam_source::recording::Recording;
use doorcam_source::truth::Truth;

/// One kind of input.
pub struct Input {
    /// Name of its fuzz target and of its corpus folder.
    pub name: &'static str,
    /// Reads it.
    pub take: fn(&[u8]),
}

/// All kinds.
pub const INPUTS: [Input; 9] = [
    Input { name: "recording", take: recording },
    Input { name: "timestamps", take: timestamps },
    Input { name: "truth", take: truth },
    Input { name: "config", take: config },
    Input { name: "calibration", take: calibration },
    Input { name: "background", take: background },
    Input { name: "scenario", take: scenario },
    Input { name: "jpeg", take: image },
    Input { name: "png", take: image },
];

/// `recording.json`, and the rectification that is set up from it.
pub fn recording(bytes: &[u8]) {
    in_file("recording.json", bytes, |directory| {
        if let Ok(recording) = Recording::open(directory)
            && is_ordinary(recording.manifest.size)
        {
            let _ = FrameReader::for_recording(&Settings::default(), &recording.manifest);
        }
    });
}

/// `timestamps.csv`.
pub fn timestamps(bytes: &[u8]) {
    let manifest = r#"{"fps": 10, "layout": "patches", "transfer": "linear", "doorway": {"width_m": 0.5, "wall_thickness_m": 0},
        "fov_m": 0.15, "background_frames": [0, 2]}"#;
    in_file("timestamps.csv", bytes, |directory| {
        if std::fs::write(directory.join("recording.json"), manifest).is_ok() {
            let _ = std::fs::create_dir(directory.join("frames"));
            let _ = Recording::open(directory);
        }
    });
}

/// `truth.json`.
pub fn truth(bytes: &[u8]) {
    in_file(Truth::FILE, bytes, |directory| {
        let _ = Truth::of_recording(directory);
    });
}

/// The configuration.
pub fn config(bytes: &[u8]) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = Config::parse(text);
    }
}

/// The body of `PUT /api/v1/calibration`.
pub fn calibration(bytes: &[u8]) {
    if let Ok(calibration) = serde_json::from_slice::<Calibration>(bytes)
        && is_ordinary(Some(calibration.size))
    {
        let _ = Assembly::new(Settings::default()).check(&calibration);
    }
}

/// A background saved by an earlier run.
pub fn background(bytes: &[u8]) {
    let _ = Snapshot::decode(bytes, &Fingerprint::new("a test"), 4, f64::INFINITY);
}

/// A scenario of the simulator.
pub fn scenario(bytes: &[u8]) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = Scenario::parse(text);
    }
}

/// A JPEG or PNG frame, decoded for people and for measuring.
pub fn image(bytes: &[u8]) {
    let _ = doorcam_source::image::decode(bytes);
    let _ = ImageDecoder::with_jpegs_of(JpegDepth::Exact).decode(bytes, None);
}

/// Whether the image is small enough to try: a camera of a hundred million pixels is slow to set up, which is no fault.
fn is_ordinary(size: Option<[usize; 2]>) -> bool {
    size.is_none_or(|[width, height]| width.saturating_mul(height) <= 1 << 20)
}

fn in_file(name: &str, bytes: &[u8], take: impl FnOnce(&Path)) {
    let directory = tempfile::tempdir().expect("a temporary directory");
    std::fs::write(directory.path().join(name), bytes).expect("a temporary file");
    take(directory.path());
}
