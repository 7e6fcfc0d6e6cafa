use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use serde::Serialize;
use v4l::capability::Flags;
use v4l::control::{Flags as ControlFlags, Type as ControlType};
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::video::Capture;
use v4l::{Device, FourCC, Fraction};

use super::find::{nodes, refused, stable_name};
use crate::camera::PixelFormat;
use crate::camera::controls::Controls;
use crate::camera::negotiation::Offer;

/// A camera, as `doorcam devices` lists it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraReport {
    /// `/dev/video0`
    pub node: String,
    /// The name below /dev/v4l/by-id, which does not depend on the node's number; none if udev made none.
    pub stable_name: Option<String>,
    /// The name that the camera reports.
    pub card: String,
    /// The kernel's driver.
    pub driver: String,
    /// Where it is plugged in.
    pub bus: String,
    /// Pixel formats that it offers.
    pub formats: Vec<FormatReport>,
    /// Controls that can be set.
    pub controls: Vec<ControlReport>,
    /// Why the rest is missing, in one line that says what to do.
    pub error: Option<String>,
}

/// A pixel format of a camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FormatReport {
    /// The V4L2 code.
    pub format: String,
    /// The driver's description of it.
    pub description: String,
    /// Whether doorcam can use it.
    pub usable: bool,
    /// Its sizes.
    pub sizes: Vec<SizeReport>,
}

/// A picture size of a format.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizeReport {
    /// Width and height, in pixels; the largest where the camera has a range.
    pub size: [u32; 2],
    /// The smallest, where the camera has a range.
    pub smallest: Option<[u32; 2]>,
    /// Frames a second that the camera supports; the highest and the lowest where it has a range.
    pub fps: Vec<f64>,
}

/// A control of a camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ControlReport {
    /// The driver's name for it.
    pub name: String,
    /// Its value now; none if it cannot be read.
    pub value: Option<i64>,
    /// The least and the largest value.
    pub range: [i64; 2],
    /// Its value at power-on.
    pub default: i64,
    /// Meaning of the values of a menu.
    pub menu: Vec<(u32, String)>,
    /// Whether it has no effect now, usually because its automatic is on.
    pub inactive: bool,
}

/// Every camera of this machine, ordered by node number.
pub fn cameras() -> Vec<CameraReport> {
    nodes().iter().filter_map(|node| report(node)).collect()
}

/// The report on a node; none if it captures no pictures.
fn report(node: &Path) -> Option<CameraReport> {
    let mut report = CameraReport {
        node: node.display().to_string(),
        stable_name: stable_name(node),
        card: String::new(),
        driver: String::new(),
        bus: String::new(),
        formats: Vec::new(),
        controls: Vec::new(),
        error: None,
    };
    let device = match Device::with_path(node) {
        Ok(device) => device,
        Err(e) => {
            report.error = Some(refused(node, &e).reason);
            return Some(report);
        }
    };
    let capabilities = guarded(|| device.query_caps()).filter(|c| c.capabilities.contains(Flags::VIDEO_CAPTURE))?;
    report.card = capabilities.card;
    report.driver = capabilities.driver;
    report.bus = capabilities.bus;
    report.formats = formats(&device);
    // A webcam's second node, for metadata, also claims to capture video, but has no format.
    if report.formats.is_empty() {
        return None;
    }
    report.controls = controls(&device);
    Some(report)
}

/// Runs a query of the v4l crate, which panics on unknown answers.
fn guarded<T>(query: impl FnOnce() -> std::io::Result<T>) -> Option<T> {
    catch_unwind(AssertUnwindSafe(query)).ok()?.ok()
}

fn formats(device: &Device) -> Vec<FormatReport> {
    let listed = guarded(|| device.enum_formats()).unwrap_or_default();
    let report = |format: v4l::format::Description| FormatReport {
        format: code_name(format.fourcc.repr),
        description: format.description.clone(),
        usable: PixelFormat::of_code(format.fourcc.repr).is_some(),
        sizes: sizes(device, format.fourcc),
    };
    listed.into_iter().map(report).collect()
}

/// A format's code as text; the kernel sets the top bit of big-endian ones.
fn code_name(code: [u8; 4]) -> String {
    let letters: String = code.iter().map(|&b| char::from(b & 0x7f)).collect();
    let suffix = if code[3] & 0x80 != 0 { "-BE" } else { "" };
    format!("{}{suffix}", letters.trim_end())
}

fn sizes(device: &Device, format: FourCC) -> Vec<SizeReport> {
    let listed = guarded(|| device.enum_framesizes(format)).unwrap_or_default();
    let report = |size: FrameSizeEnum| {
        let (largest, smallest) = match size {
            FrameSizeEnum::Discrete(d) => ([d.width, d.height], None),
            FrameSizeEnum::Stepwise(s) => ([s.max_width, s.max_height], Some([s.min_width, s.min_height])),
        };
        SizeReport { size: largest, smallest, fps: rates(device, format, largest) }
    };
    listed.into_iter().map(|listed| report(listed.size)).collect()
}

fn rates(device: &Device, format: FourCC, [width, height]: [u32; 2]) -> Vec<f64> {
    let listed = guarded(|| device.enum_frameintervals(format, width, height)).unwrap_or_default();
    let rate = |f: Fraction| (f.numerator > 0).then(|| f64::from(f.denominator) / f64::from(f.numerator));
    let mut rates: Vec<f64> = listed
        .into_iter()
        .flat_map(|listed| match listed.interval {
            FrameIntervalEnum::Discrete(interval) => vec![rate(interval)],
            FrameIntervalEnum::Stepwise(range) => vec![rate(range.min), rate(range.max)],
        })
        .flatten()
        .collect();
    rates.sort_by(|a, b| b.total_cmp(a));
    rates.dedup();
    rates
}

/// A device's offers in formats that doorcam decodes. A range of sizes counts as its largest size and the usual ones in
/// it.
pub(super) fn offers(device: &Device) -> Vec<Offer> {
    const USUAL: [[u32; 2]; 7] =
        [[320, 240], [640, 360], [640, 480], [800, 600], [1280, 720], [1280, 960], [1920, 1080]];
    let mut offers = Vec::new();
    for report in formats(device) {
        let code: Option<[u8; 4]> = report.format.as_bytes().try_into().ok();
        let Some(format) = code.and_then(PixelFormat::of_code) else { continue };
        for size in report.sizes {
            let within = |s: &[u32; 2]| {
                size.smallest.is_some_and(|small| (0..2).all(|k| (small[k]..=size.size[k]).contains(&s[k])))
            };
            let fps = size.fps.first().copied();
            let usual = USUAL.into_iter().filter(within).map(|s| (s, None));
            let own = std::iter::once((size.size, fps));
            offers.extend(own.chain(usual).map(|(size, fps)| Offer { format, size, fps }));
        }
    }
    offers
}

fn controls(device: &Device) -> Vec<ControlReport> {
    let listed = guarded(|| device.query_controls()).unwrap_or_default();
    let single = |t: ControlType| {
        matches!(t, ControlType::Integer | ControlType::Boolean | ControlType::Menu | ControlType::IntegerMenu)
    };
    listed
        .into_iter()
        .filter(|c| single(c.typ) && !c.flags.contains(ControlFlags::DISABLED))
        .map(|control| ControlReport {
            value: guarded(|| device.get(control.id)),
            range: [control.minimum, control.maximum],
            default: control.default,
            menu: control.items.iter().flatten().map(|(value, item)| (*value, item.to_string())).collect(),
            inactive: control.flags.contains(ControlFlags::INACTIVE),
            name: control.name,
        })
        .collect()
}
