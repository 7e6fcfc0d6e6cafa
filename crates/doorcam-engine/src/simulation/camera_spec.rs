//! Keys of a scenario that describe the camera.

use serde::Deserialize;

use doorcam_core::optics::Transfer;
use doorcam_source::recording::Layout;

/// What a simulated camera delivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FrameFormat {
    /// JPEG files.
    Jpeg,
    /// 8-bit PNG files.
    Png,
    /// Raw pixels, as in a webcam's uncompressed format; recorded as PNG.
    Rgb,
}

/// `[camera]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// "camera": its picture; "patches": rectified squares of floor in 16-bit linear light, which no camera delivers.
    #[serde(default = "camera_layout")]
    pub layout: Layout,
    /// Its position.
    pub at_m: [f64; 3],
    /// The floor point in the centre of its picture.
    pub look_at_m: [f64; 2],
    /// Angle spanned by the width of its picture, in degrees.
    pub field_of_view_deg: f64,
    /// Clockwise rotation about its line of sight, in degrees.
    #[serde(default)]
    pub roll_deg: f64,
    /// Width and height in pixels; for patches, the width counts.
    #[serde(default = "usual_size")]
    pub size: [usize; 2],
    /// Side of the squares with layout "patches".
    #[serde(default = "usual_fov")]
    pub fov_m: f64,
    /// Mean light of the floor beside the edges while the room is empty, relative to full scale.
    #[serde(default = "usual_level")]
    pub level: f64,
    /// Times and the exposure factor from then on; 1 applies before the first.
    #[serde(default)]
    pub exposure: Vec<(f64, f64)>,
    /// Times at which somebody bumps it, and where its picture is from then on: pixels to the right and down, and
    /// degrees clockwise about its middle, from where it was at first.
    #[serde(default)]
    pub bump: Vec<(f64, f64, f64, f64)>,
    /// Electrons of a pixel at full scale; determines photon noise.
    #[serde(default = "usual_electrons")]
    pub full_scale_electrons: f64,
    /// Standard deviation of a pixel's read noise, in electrons.
    #[serde(default = "usual_read")]
    pub read_electrons: f64,
    /// Transfer function from light to codes.
    #[serde(default = "srgb")]
    pub transfer: Transfer,
    /// What it delivers.
    #[serde(default = "jpeg")]
    pub format: FrameFormat,
    /// JPEG quality.
    #[serde(default = "usual_quality")]
    pub quality: u8,
}

/// `[flicker]`: lamps on the mains brighten twice per period.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlickerSpec {
    /// Frequency of the mains.
    pub mains_hz: f64,
    /// Amplitude of the hidden light's rise and fall, as a part of itself.
    pub hidden: f64,
    /// Amplitude of the visible light's rise and fall, as a part of itself.
    pub visible: f64,
    /// Exposure time of each row of pixels, in seconds.
    pub exposure_s: f64,
    /// Delay of each row after the one above it, in seconds; 0 for a global shutter.
    #[serde(default)]
    pub line_s: f64,
}

fn camera_layout() -> Layout {
    Layout::Camera
}
fn usual_size() -> [usize; 2] {
    [640, 360]
}
fn usual_fov() -> f64 {
    0.3
}
fn usual_level() -> f64 {
    0.45
}
fn usual_electrons() -> f64 {
    10_000.0
}
fn usual_read() -> f64 {
    8.0
}
fn srgb() -> Transfer {
    Transfer::Srgb
}
fn jpeg() -> FrameFormat {
    FrameFormat::Jpeg
}
fn usual_quality() -> u8 {
    95
}
