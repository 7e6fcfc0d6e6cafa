use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use jiff::{SignedDuration, Timestamp};
use rustix::time::{ClockId, clock_gettime};
use v4l::buffer::{Flags, Metadata, Type};
use v4l::control::{Control, Value};
use v4l::format::{Colorspace, Quantization};
use v4l::io::mmap::Stream;
use v4l::io::traits::{CaptureStream, Stream as _};
use v4l::video::Capture as _;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC, Fraction};

use super::find::{fault, refused};
use super::inventory::offers;
use crate::camera::controls::{Controls, Kept, keep};
use crate::camera::negotiation::{Offer, ranked};
use crate::camera::{CameraOptions, Capture, ControlSettings, Fault, Locked, PixelFormat, Session, Wish};
use crate::pool::BufferPool;
use crate::sensor::{LumaMatrix, SensorFormat, SensorPixels};
use crate::{Granted, Purpose, RawFrame, RawImages, SkippedFrame};

/// Buffers that the driver fills: enough to bridge a moment in which this thread does not run.
const BUFFERS: u32 = 8;
/// How often the controls are looked at: asking costs a webcam a transfer each.
const RECHECK: Duration = Duration::from_secs(5);
/// `POLLIN` of poll(2).
const READABLE: i16 = 1;

/// An open device that streams.
pub struct V4l2Session {
    node: PathBuf,
    name: Arc<str>,
    // Before the device: the stream's buffers are given back first.
    stream: Stream<'static>,
    device: Device,
    format: Granting,
    granted: Granted,
    settings: ControlSettings,
    locked: Arc<Locked>,
    /// When the first frame came.
    first_frame: Option<Instant>,
    /// Whether the automatics have been locked.
    settled: bool,
    /// When the controls were looked at.
    checked: Instant,
    sequence: Option<u32>,
    newest_only: bool,
    pool: BufferPool,
}

/// How the frames are laid out.
#[derive(Debug, Clone, Copy)]
enum Granting {
    Jpeg,
    Raw(SensorFormat),
}

impl Controls for Device {
    fn get(&self, id: u32) -> io::Result<i64> {
        match self.control(id)?.value {
            Value::Integer(value) => Ok(value),
            Value::Boolean(value) => Ok(i64::from(value)),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    // One call a control: a call must not mix classes, and one refusal would undo the others.
    fn set(&self, id: u32, value: i64) -> io::Result<()> {
        self.set_control(Control { id, value: Value::Integer(value) })
    }
}

impl V4l2Session {
    /// Opens a node, agrees on a format and starts the stream.
    pub(super) fn open(node: &Path, options: &CameraOptions, locked: &Arc<Locked>) -> Result<Self, Fault> {
        let device = Device::with_path(node).map_err(|e| refused(node, &e))?;
        let capabilities = device.query_caps().map_err(|e| fault(node, "is no camera", &e))?;
        let (format, pixels) = agree(node, &device, &options.wish)?;
        let fps = set_rate(&device, options.wish.fps).unwrap_or(options.wish.fps);
        locked.with(&capabilities.card, |locked| keep(&device, &options.controls, locked, false));
        let mut stream = Stream::with_buffers(&device, Type::VideoCapture, BUFFERS)
            .map_err(|e| fault(node, "gives no buffers", &e))?;
        // `next` queues buffer 0 itself before it waits; the driver may have granted fewer than were asked for.
        for index in 1..BUFFERS as usize {
            if CaptureStream::queue(&mut stream, index).is_err() {
                break;
            }
        }
        stream.start().map_err(|e| fault(node, "does not start", &e))?;
        // Some cameras forget their controls when they start.
        let kept = locked.with(&capabilities.card, |locked| keep(&device, &options.controls, locked, false));
        let granted = Granted {
            node: node.display().to_string(),
            card: capabilities.card,
            format: pixels.to_string(),
            size: [format.width as usize, format.height as usize],
            fps,
            controls: BTreeMap::new(),
            mismatches: Vec::new(),
        };
        let mut session = Self {
            name: node.display().to_string().into(),
            node: node.to_owned(),
            stream,
            device,
            format: granting(&format, pixels),
            granted,
            settings: options.controls.clone(),
            locked: Arc::clone(locked),
            first_frame: None,
            settled: false,
            checked: Instant::now(),
            sequence: None,
            newest_only: options.newest_only,
            pool: BufferPool::default(),
        };
        session.told(kept);
        Ok(session)
    }

    /// Takes in how the controls are; true if that is news.
    fn told(&mut self, kept: Kept) -> bool {
        let controls: BTreeMap<String, i64> =
            kept.values.iter().map(|(name, value)| (name.to_string(), *value)).collect();
        let news = controls != self.granted.controls || kept.mismatches != self.granted.mismatches;
        self.granted.controls = controls;
        self.granted.mismatches = kept.mismatches;
        news
    }

    fn ready(&self, wait: Duration) -> Result<bool, Fault> {
        let milliseconds = i32::try_from(wait.as_millis()).unwrap_or(i32::MAX);
        match self.stream.handle().poll(READABLE, milliseconds) {
            Ok(count) => Ok(count > 0),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(e) => Err(fault(&self.node, "cannot be waited for", &e)),
        }
    }

    fn frame(&mut self, buffer: Range, metadata: &Metadata) -> Result<RawFrame, SkippedFrame> {
        let skipped = |reason: String| Err(SkippedFrame { name: self.name.to_string(), reason });
        let bytes = match buffer {
            Range::Damaged => return skipped("the driver marks the frame as damaged".into()),
            Range::Bytes(bytes) => bytes,
        };
        let images = match self.format {
            Granting::Jpeg => RawImages::Camera(bytes),
            Granting::Raw(format) => RawImages::Sensor(format, bytes),
        };
        let (seconds, time) = capture_time(metadata);
        Ok(RawFrame { index: None, purpose: Purpose::Live, seconds, images, time, name: Arc::clone(&self.name) })
    }
}

/// What a buffer holds.
enum Range {
    Damaged,
    Bytes(Arc<Vec<u8>>),
}

impl Session for V4l2Session {
    fn granted(&self) -> &Granted {
        &self.granted
    }

    fn next(&mut self, wait: Duration) -> Result<Option<Capture>, Fault> {
        if !self.ready(wait)? {
            return Ok(None);
        }
        let (mut lost, mut superseded) = (0, 0);
        let handle = self.stream.handle();
        loop {
            let (buffer, metadata) = match self.stream.next() {
                Ok((buffer, metadata)) => (buffer, *metadata),
                // Another reader cannot be, but a driver may wake us for nothing.
                Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {
                    return Err(Fault::unusable(format!("{}: woke up for no frame", self.node.display())));
                }
                Err(e) => return Err(fault(&self.node, "stopped", &e)),
            };
            let used = (metadata.bytesused as usize).min(buffer.len());
            // Sequence numbers may start anywhere and wrap around.
            let gap = self.sequence.map_or(0, |last| metadata.sequence.wrapping_sub(last).wrapping_sub(1));
            self.sequence = Some(metadata.sequence);
            // A driver that starts to count anew, or does not count, has lost nothing that it knows of.
            lost += if gap < u32::MAX / 2 { u64::from(gap) } else { 0 };
            let newer = self.newest_only && handle.poll(READABLE, 0).is_ok_and(|count| count > 0);
            if newer {
                superseded += 1;
                continue;
            }
            let damaged = metadata.flags.contains(Flags::ERROR) || used == 0;
            let range = if damaged { Range::Damaged } else { Range::Bytes(self.pool.copy_of(&buffer[..used])) };
            let frame = self.frame(range, &metadata);
            if frame.is_ok() {
                self.first_frame.get_or_insert_with(Instant::now);
            }
            return Ok(Some(Capture { frame, lost, superseded }));
        }
    }

    fn recheck(&mut self) -> Result<bool, Fault> {
        let settled = self.first_frame.is_some_and(|first| first.elapsed() >= self.settings.settle);
        if settled == self.settled && self.checked.elapsed() < RECHECK {
            return Ok(false);
        }
        (self.settled, self.checked) = (settled, Instant::now());
        let keep = |locked: &mut BTreeMap<String, i64>| keep(&self.device, &self.settings, locked, settled);
        let kept = self.locked.with(&self.granted.card, keep);
        Ok(self.told(kept))
    }
}

/// Seconds of the machine's monotonic clock, and the time of day, at which a frame was captured.
fn capture_time(metadata: &Metadata) -> (f64, Option<Timestamp>) {
    let stamp = Duration::from(metadata.timestamp);
    let monotonic = metadata.flags & Flags::TIMESTAMP_MASK == Flags::TIMESTAMP_MONOTONIC;
    if !monotonic || stamp.is_zero() {
        let now = monotonic_now();
        return (now.as_secs_f64(), None);
    }
    let age = monotonic_now().saturating_sub(stamp);
    let time = SignedDuration::try_from(age).ok().and_then(|age| Timestamp::now().checked_sub(age).ok());
    (stamp.as_secs_f64(), time)
}

fn monotonic_now() -> Duration {
    let now = clock_gettime(ClockId::Monotonic);
    Duration::new(u64::try_from(now.tv_sec).unwrap_or(0), u32::try_from(now.tv_nsec).unwrap_or(0))
}

/// Sets the best format that the device really grants: a driver may answer with another than it was asked for.
fn agree(node: &Path, device: &Device, wish: &Wish) -> Result<(Format, PixelFormat), Fault> {
    let offered = offers(device);
    let mut wanted = ranked(wish, &offered);
    if offered.is_empty() {
        // A driver that does not list its formats is asked for each.
        wanted.extend(wish.formats.iter().map(|&format| Offer { format, size: wish.size, fps: None }));
    }
    let mut refusal = None;
    for offer in &wanted {
        let asked = Format::new(offer.size[0], offer.size[1], FourCC::new(offer.format.code()));
        match device.set_format(&asked) {
            Ok(granted) => {
                match PixelFormat::of_code(granted.fourcc.repr).filter(|format| wish.formats.contains(format)) {
                    Some(pixels) => return Ok((granted, pixels)),
                    None => continue,
                }
            }
            Err(e) => refusal = Some(e),
        }
    }
    Err(match refusal {
        Some(e) => fault(node, "the format is refused", &e),
        None => {
            let formats: Vec<String> = wish.formats.iter().map(ToString::to_string).collect();
            Fault::unusable(format!(
                "{}: the camera has none of the formats {} (camera.formats; doorcam devices lists what it has)",
                node.display(),
                formats.join(", ")
            ))
        }
    })
}

/// Asks for a rate; returns what was granted, if the driver tells.
fn set_rate(device: &Device, fps: f64) -> Option<f64> {
    let interval = Fraction::new(1000, (fps * 1000.0).round().clamp(1.0, 1e6) as u32);
    let granted = device.set_params(&Parameters::new(interval)).ok()?.interval;
    (granted.numerator > 0).then(|| f64::from(granted.denominator) / f64::from(granted.numerator))
}

fn granting(format: &Format, pixels: PixelFormat) -> Granting {
    let pixels = match pixels {
        PixelFormat::Mjpg => return Granting::Jpeg,
        PixelFormat::Yuyv => SensorPixels::Yuyv,
        PixelFormat::Nv12 => SensorPixels::Nv12,
        PixelFormat::Rgb3 => SensorPixels::Rgb24,
        PixelFormat::Grey => SensorPixels::Grey,
    };
    let (width, height) = (format.width as usize, format.height as usize);
    let tight = match pixels {
        SensorPixels::Yuyv => 2 * width,
        SensorPixels::Rgb24 => 3 * width,
        SensorPixels::Nv12 | SensorPixels::Grey => width,
    };
    // As V4L2 maps its defaults: luma is in the limited range but for JPEG's own colour space; grey and RGB are full.
    let full_range = match format.quantization {
        Quantization::FullRange => true,
        Quantization::LimitedRange => false,
        Quantization::Default => matches!(format.colorspace, Colorspace::JPEG) || matches!(pixels, SensorPixels::Rgb24),
    };
    let matrix = if matches!(format.colorspace, Colorspace::Rec709) { LumaMatrix::Bt709 } else { LumaMatrix::Bt601 };
    let stride = (format.stride as usize).max(tight);
    Granting::Raw(SensorFormat { pixels, width, height, stride, full_range, matrix })
}
