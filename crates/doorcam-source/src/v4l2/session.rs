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
use crate::{Granted, Purpose, RawFrame, RawImages, SkipKind, SkippedFrame};

/// Buffers that the driver fills: enough to cover short times in which this thread does not run.
const BUFFERS: u32 = 8;
/// How often the controls are checked: each query costs a webcam a transfer.
const RECHECK: Duration = Duration::from_secs(5);
/// `POLLIN` of poll(2).
const READABLE: i16 = 1;

/// An open, streaming device.
pub struct V4l2Session {
    node: PathBuf,
    name: Arc<str>,
    // Declared before the device, so that the stream's buffers are released first.
    stream: Stream<'static>,
    device: Device,
    format: Granting,
    granted: Granted,
    settings: ControlSettings,
    locked: Arc<Locked>,
    /// When the first frame arrived.
    first_frame: Option<Instant>,
    /// Whether the automatics have been locked.
    settled: bool,
    /// When the controls were last checked.
    checked: Instant,
    sequence: Option<u32>,
    newest_only: bool,
    /// Whether the driver has all buffers, because a frame that it signalled was not there.
    owed: bool,
    /// Lost and superseded frames that no capture has told yet.
    uncounted: (u64, u64),
    pool: BufferPool,
}

/// Layout of the frames.
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

    // One call per control: a call must not mix classes, and one refusal would undo the others.
    fn set(&self, id: u32, value: i64) -> io::Result<()> {
        self.set_control(Control { id, value: Value::Integer(value) })
    }
}

impl V4l2Session {
    /// Opens a node, negotiates a format and starts the stream.
    pub(super) fn open(node: &Path, options: &CameraOptions, locked: &Arc<Locked>) -> Result<Self, Fault> {
        let device = Device::with_path(node).map_err(|e| refused(node, &e))?;
        let capabilities = device.query_caps().map_err(|e| fault(node, "is not a camera", &e))?;
        let (format, pixels) = agree(node, &device, &options.wish)?;
        let fps = set_rate(&device, options.wish.fps).unwrap_or(options.wish.fps);
        locked.with(&capabilities.card, |locked| keep(&device, &options.controls, locked, false));
        let mut stream = Stream::with_buffers(&device, Type::VideoCapture, BUFFERS)
            .map_err(|e| fault(node, "gives no buffers", &e))?;
        // `next` queues buffer 0 itself before it waits; the driver may have granted fewer than requested.
        for index in 1..BUFFERS as usize {
            if CaptureStream::queue(&mut stream, index).is_err() {
                break;
            }
        }
        stream.start().map_err(|e| fault(node, "does not start", &e))?;
        // Some cameras reset their controls when streaming starts.
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
            owed: false,
            uncounted: (0, 0),
            pool: BufferPool::default(),
        };
        session.told(kept);
        Ok(session)
    }

    /// Stores the state of the controls; true if it has changed.
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
            Err(e) => Err(fault(&self.node, "waiting for a frame failed", &e)),
        }
    }

    fn frame(&mut self, buffer: Range, metadata: &Metadata) -> Result<RawFrame, SkippedFrame> {
        let skipped = |reason: String| Err(SkippedFrame::new(&*self.name, SkipKind::Damaged, reason));
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
        if self.owed {
            // `Stream::next` would give back a buffer that the driver has already. Taking one costs its frame, which
            // the gap in the numbers tells.
            match CaptureStream::dequeue(&mut self.stream) {
                Ok(_) => self.owed = false,
                Err(e) if is_harmless(&e) => std::thread::sleep(AFTER_NOTHING),
                Err(e) => return Err(fault(&self.node, "stopped", &e)),
            }
            return Ok(None);
        }
        let (mut lost, mut superseded) = std::mem::take(&mut self.uncounted);
        let handle = self.stream.handle();
        loop {
            let (buffer, metadata) = match self.stream.next() {
                Ok((buffer, metadata)) => (buffer, *metadata),
                Err(e) if is_harmless(&e) => {
                    (self.owed, self.uncounted) = (true, (lost, superseded));
                    std::thread::sleep(AFTER_NOTHING);
                    return Ok(None);
                }
                Err(e) => return Err(fault(&self.node, "stopped", &e)),
            };
            let used = (metadata.bytesused as usize).min(buffer.len());
            // Sequence numbers may start anywhere and wrap around.
            let gap = self.sequence.map_or(0, |last| metadata.sequence.wrapping_sub(last).wrapping_sub(1));
            self.sequence = Some(metadata.sequence);
            // A huge gap means that the driver restarted its count, or does not count: no losses are known.
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

/// How long to wait after the driver signalled a frame but had none, as it may do so again at once.
const AFTER_NOTHING: Duration = Duration::from_millis(5);

/// Whether an error of taking a frame only means that there was none: a signal came, or the driver announced a frame
/// that it does not have. A driver that does nothing else is found out by the frames that do not come.
fn is_harmless(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

/// When a frame was captured: seconds of the monotonic clock, and time of day. Without a usable time stamp, the former
/// is now and the latter none.
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

/// Sets the best format that the device actually grants: a driver may grant another than the one requested.
fn agree(node: &Path, device: &Device, wish: &Wish) -> Result<(Format, PixelFormat), Fault> {
    let offered = offers(device);
    let mut wanted = ranked(wish, &offered);
    if offered.is_empty() {
        // The driver does not list its formats: try each.
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

/// Requests a rate; returns the one granted, if the driver reports it.
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
    // As V4L2_MAP_QUANTIZATION_DEFAULT: RGB and JPEG's colour space have the full range, all else the limited range.
    let full_range = match format.quantization {
        Quantization::FullRange => true,
        Quantization::LimitedRange => false,
        Quantization::Default => matches!(format.colorspace, Colorspace::JPEG) || matches!(pixels, SensorPixels::Rgb24),
    };
    let matrix = if matches!(format.colorspace, Colorspace::Rec709) { LumaMatrix::Bt709 } else { LumaMatrix::Bt601 };
    let stride = (format.stride as usize).max(tight);
    Granting::Raw(SensorFormat { pixels, width, height, stride, full_range, matrix })
}
