use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use doorcam::config::Config;
use doorcam::feed::{Feed, Place, SourceSpec};
use doorcam_core::calibration::Calibration;
use doorcam_core::geometry::Doorway;
use doorcam_source::camera::Setting;
use doorcam_source::files::{self, FileKind};
use doorcam_source::recorder::{Recorder, RecordingLimits, RecordingPlan, RecordingStatus, RecordingWriter};
use doorcam_source::recording::Manifest;
use doorcam_source::{Condition, Granted, SkipTally, Source, SourceEvent, SourceState};
use indicatif::{ProgressBar, ProgressStyle};
use tokio::signal::unix::{SignalKind, signal};

use super::source_help;

/// Record a camera, a recording or a simulation into a directory that can be replayed
///
/// The first seconds must show the empty room: they become the recording's background. The recording ends with Ctrl-C,
/// --seconds, --frames or --max-bytes. JPEGs are kept as the camera gives them; raw pixels become PNGs.
#[derive(Debug, clap::Args)]
#[command(after_help = format!("{}

A recording of a camera includes its calibration: the one made on the page of doorcam serve, or --calibration FILE,
which is JSON with the keys size, doorway and floor_points of recording.json (docs/recordings.md). The recording.json
of another recording from the same place also works. Without a calibration, record with --uncalibrated, and add doorway
and floor_points to OUT/recording.json before replaying.

Examples:
  doorcam record --source v4l2:/dev/video0 --seconds 60 evening
  doorcam record --source v4l2:/dev/video0 --uncalibrated --empty-seconds 10 evening
  doorcam serve --source replay:evening,loop", source_help::HELP))]
pub(super) struct Arguments {
    /// Where frames come from
    #[arg(long, value_name = "SOURCE")]
    source: SourceSpec,
    /// Directory to write to; must be empty or not exist yet
    out: PathBuf,
    /// Stop after this many seconds
    #[arg(long, value_name = "S", value_parser = above_zero)]
    seconds: Option<f64>,
    /// Stop after this many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Stop before the files take more than this, in bytes or with kB, MB, GB
    #[arg(long, value_name = "SIZE", default_value = "10GB", value_parser = parse_size)]
    max_bytes: u64,
    /// The camera's calibration [default: the one made on the page, calibration.json in the storage directory]
    #[arg(long, value_name = "FILE", conflicts_with = "uncalibrated")]
    calibration: Option<PathBuf>,
    /// Directory for state kept between runs [default: storage.directory of the configuration]
    #[arg(long, value_name = "DIR")]
    storage: Option<PathBuf>,
    /// Record without a calibration
    #[arg(long)]
    uncalibrated: bool,
    /// How long the room is empty, from the first frame on; 0 if it never is [default: 3]
    #[arg(long, value_name = "S", value_parser = not_negative)]
    empty_seconds: Option<f64>,
    /// Configuration file; only [camera] and [storage] are used
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

/// How long to wait for a camera's first frame.
const WAIT: Duration = Duration::from_secs(10);
/// Time allowed after `settle_s` until the automatic controls are locked: the camera is polled once a second.
const LOCKING: Duration = Duration::from_millis(1500);

fn above_zero(text: &str) -> Result<f64, String> {
    not_negative(text).and_then(|s| if s > 0.0 { Ok(s) } else { Err("expected a number above 0".into()) })
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..1e9).contains(&seconds) => Ok(seconds),
        _ => Err("expected a number of seconds".into()),
    }
}

fn parse_size(text: &str) -> Result<u64, String> {
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor = match &unit.trim().to_ascii_lowercase()[..] {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "t" | "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1024.0 * 1024.0,
        "gib" => 1024.0 * 1024.0 * 1024.0,
        _ => return Err("expected a size such as 500MB, 2GB or a number of bytes".into()),
    };
    match number.parse::<f64>() {
        Ok(number) if number > 0.0 => Ok((number * factor) as u64),
        _ => Err("expected a size above 0, such as 500MB".into()),
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    RecordingWriter::check_free(&arguments.out)?;
    let limits =
        RecordingLimits { seconds: arguments.seconds, frames: arguments.frames, bytes: Some(arguments.max_bytes) };
    let interrupted = interrupted()?;
    match &arguments.source.place {
        Place::Camera(_) => camera(arguments, limits, &interrupted),
        Place::Replay(..) => copy(arguments, "a recording has its own calibration", limits, &interrupted),
        Place::Simulate(_) => copy(arguments, "a simulated camera brings its own calibration", limits, &interrupted),
    }
}

/// A flag that becomes true on Ctrl-C or SIGTERM.
fn interrupted() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let set = Arc::clone(&flag);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    // Before the thread starts, so that no signal is missed.
    let (mut interrupt, mut terminate) = {
        let _inside = runtime.enter();
        (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?)
    };
    std::thread::spawn(move || {
        runtime.block_on(async {
            tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
            set.store(true, Ordering::Relaxed);
            // A second signal exits at once, without waiting for the disk.
            tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
            std::process::exit(1);
        });
    });
    Ok(flag)
}

/// Records a source that has its own manifest: every frame, at the source's pace.
fn copy(
    arguments: &Arguments,
    calibrated: &str,
    limits: RecordingLimits,
    interrupted: &AtomicBool,
) -> anyhow::Result<()> {
    let spec = &arguments.source;
    if arguments.calibration.is_some() || arguments.uncalibrated {
        bail!("{}: {calibrated}", spec.text);
    }
    let feed = Feed::open(spec, &Config::default())?.every_frame();
    let manifest = feed.manifest().cloned().with_context(|| format!("{}: has no manifest", spec.text))?;
    let plan = RecordingPlan { manifest, empty_seconds: arguments.empty_seconds, calibrated: true, limits };
    let mut recorder = Recorder::start(&arguments.out, plan)?;
    record(&mut *feed.start(), &mut recorder, Narrator::default(), None, interrupted)
}

fn camera(arguments: &Arguments, limits: RecordingLimits, interrupted: &AtomicBool) -> anyhow::Result<()> {
    let spec = &arguments.source.text;
    let empty = arguments.empty_seconds.unwrap_or(3.0);
    if let Some(seconds) = limits.seconds.filter(|&seconds| seconds <= empty) {
        bail!("--seconds {seconds} leaves nothing after the {empty} s of the empty room (--empty-seconds)");
    }
    let mut config = arguments.config.as_deref().map(Config::load).transpose()?.unwrap_or_default();
    if let Some(directory) = &arguments.storage {
        config.storage.directory.clone_from(directory);
    }
    let kept = config.storage.directory().map(|directory| directory.join("calibration.json"));
    let file = arguments.calibration.clone().or(kept.filter(|file| !arguments.uncalibrated && file.exists()));
    let calibration = match &file {
        Some(file) => Some(load_calibration(file, &config)?),
        None if arguments.uncalibrated => None,
        None => bail!(
            "{spec}: this camera is not calibrated: calibrate it on the page of doorcam serve, or give --calibration \
             FILE, or --uncalibrated to add doorway and floor_points to the recording later"
        ),
    };
    let mut feed = Feed::open(&arguments.source, &config)?.every_frame();
    if let Some(calibration) = &calibration {
        feed.use_calibration(calibration);
    }
    let mut source = feed.start();
    let mut narrator = Narrator::default();
    let granted = first_frame(&mut *source, &mut narrator, spec, interrupted)?;
    if let (Some(calibration), Some(file)) = (&calibration, &file)
        && calibration.size != granted.size
    {
        let ([w, h], [cw, ch]) = (granted.size, calibration.size);
        bail!("{}: size is [{cw}, {ch}], but the camera gives {w} x {h} pixels", file.display());
    }
    let camera = &config.camera;
    if [camera.exposure, camera.gain, camera.white_balance, camera.focus].contains(&Setting::Lock)
        && camera.settle_s > 0.0
    {
        tracing::info!("letting the camera's automatic controls settle for {} s", camera.settle_s);
        let settled = Instant::now() + Duration::from_secs_f64(camera.settle_s) + LOCKING;
        watch(&mut *source, &mut narrator, interrupted, |_| Instant::now() >= settled);
    }
    let notes =
        format!("{}, {}, recorded {}", granted.card, granted.format, jiff::Timestamp::now().strftime("%F %R UTC"));
    let plan = RecordingPlan {
        calibrated: calibration.is_some(),
        manifest: Manifest::of_camera(&calibration.unwrap_or_else(|| unknown(granted.size)), granted.fps, notes),
        empty_seconds: (empty > 0.0).then_some(empty),
        limits,
    };
    if interrupted.load(Ordering::Relaxed) {
        bail!("{spec}: interrupted before the first frame was recorded");
    }
    let mut recorder = Recorder::start(&arguments.out, plan)?;
    if empty > 0.0 {
        tracing::info!("recording: keep the room empty for {empty} s");
    }
    record(&mut *source, &mut recorder, narrator, Some(granted.size), interrupted)
}

/// A placeholder for a missing calibration. Only its size is written to the recording.
fn unknown(size: [usize; 2]) -> Calibration {
    let doorway = Doorway { width_m: 1.0, wall_thickness_m: 0.0, height_m: None, leaf: None };
    Calibration { size, doorway, floor_points: Vec::new(), lens: None, transfer: None }
}

/// Loads a calibration, with the configuration's lens and transfer function where the file has none.
fn load_calibration(file: &Path, config: &Config) -> anyhow::Result<Calibration> {
    let name = || file.display().to_string();
    let text = files::read_text(file, FileKind::CALIBRATION).with_context(name)?;
    let mut json = serde_json::Deserializer::from_str(&text);
    let mut calibration: Calibration = serde_path_to_error::deserialize(&mut json).with_context(name)?;
    calibration.lens = calibration.lens.or(config.camera.lens());
    calibration.transfer = calibration.transfer.or(Some(config.camera.transfer.clone()));
    calibration.camera().with_context(name)?;
    Ok(calibration)
}

/// Waits until a camera streams and returns what it granted.
fn first_frame(
    source: &mut dyn Source,
    narrator: &mut Narrator,
    spec: &str,
    interrupted: &AtomicBool,
) -> anyhow::Result<Granted> {
    let deadline = Instant::now() + WAIT;
    let mut condition = None;
    watch(source, narrator, interrupted, |event| {
        if let SourceEvent::Condition(news) = event {
            condition = Some(news.clone());
        }
        let streams = condition.as_ref().is_some_and(|c| c.state == SourceState::Streaming);
        streams || Instant::now() >= deadline
    });
    match condition {
        Some(Condition { state: SourceState::Streaming, granted: Some(granted), .. }) => Ok(granted),
        _ if interrupted.load(Ordering::Relaxed) => bail!("{spec}: interrupted before the first frame"),
        Some(Condition { reason: Some(reason), .. }) => bail!("gave up after {} s: {reason}", WAIT.as_secs()),
        _ => bail!("{spec}: no frame within {} s", WAIT.as_secs()),
    }
}

/// Takes a camera's events until `done`, reporting its condition; frames are discarded.
fn watch(
    source: &mut dyn Source,
    narrator: &mut Narrator,
    interrupted: &AtomicBool,
    mut done: impl FnMut(&SourceEvent) -> bool,
) {
    while !interrupted.load(Ordering::Relaxed)
        && let Some(event) = source.next()
    {
        if let SourceEvent::Condition(condition) = &event {
            narrator.tell(condition);
        }
        if done(&event) {
            return;
        }
    }
}

/// Logs a source's condition when it changes.
#[derive(Default)]
struct Narrator(Option<SourceState>);

impl Narrator {
    fn tell(&mut self, condition: &Condition) {
        if let Some(reason) = &condition.reason {
            tracing::warn!("{reason}");
        }
        let news = self.0.replace(condition.state) != Some(condition.state);
        let Some(granted) = &condition.granted else { return };
        if news && condition.state == SourceState::Streaming {
            let Granted { node, card, format, size: [width, height], fps, .. } = granted;
            let fps = (fps * 100.0).round() / 100.0;
            tracing::info!("{node}: {card}, {format} {width}x{height}, {fps} frames a second");
        }
        granted.mismatches.iter().for_each(|mismatch| tracing::warn!("{}: {mismatch}", granted.node));
    }
}

/// Records until there are no more frames, a limit is reached or the user interrupts. A live camera has an image
/// `size`, and frames that the disk is too slow for are dropped; without a `size`, the source waits for the disk.
fn record(
    source: &mut dyn Source,
    recorder: &mut Recorder,
    mut narrator: Narrator,
    size: Option<[usize; 2]>,
    interrupted: &AtomicBool,
) -> anyhow::Result<()> {
    let spinner = ProgressBar::hidden();
    if std::io::IsTerminal::is_terminal(&std::io::stderr()) {
        spinner.set_draw_target(indicatif::ProgressDrawTarget::stderr());
        spinner.set_style(ProgressStyle::with_template("{spinner} {msg}")?);
    }
    let (mut changed, mut skips) = (None, SkipTally::default());
    while !interrupted.load(Ordering::Relaxed) && !recorder.has_ended() && changed.is_none() {
        match source.next() {
            None => break,
            Some(SourceEvent::Frame(frame)) => {
                let taken = if size.is_some() { recorder.offer(&frame) } else { recorder.put(&frame) };
                if !taken {
                    break;
                }
            }
            Some(SourceEvent::Skipped(skipped)) => {
                // A line for each of thousands of frames would hide all others.
                if skips.add(&skipped).is_power_of_two() {
                    spinner.suspend(|| tracing::warn!("skipped a frame, {} by now: {skipped}", skips.total()));
                }
                recorder.lost(1);
            }
            Some(SourceEvent::Lost(count) | SourceEvent::Superseded(count)) => recorder.lost(count),
            Some(SourceEvent::Condition(condition)) => {
                spinner.suspend(|| narrator.tell(&condition));
                changed = size.zip(condition.granted).filter(|(size, granted)| *size != granted.size);
            }
            Some(SourceEvent::Nothing) => {}
        }
        spinner.set_message(summary(&recorder.status()));
        spinner.tick();
    }
    spinner.set_message("writing to disk");
    let status = recorder.stop();
    spinner.finish_and_clear();
    let out = status.directory.display();
    if let Some(error) = &status.error {
        bail!("{error} (the {} frames before that are safe in {out})", status.written.frames);
    }
    if let Some(([w, h], Granted { node, size: [nw, nh], .. })) = changed {
        let frames = status.written.frames;
        bail!(
            "{node}: the camera gives {nw} x {nh} pixels now, the recording has {w} x {h} ({frames} frames in {out})"
        );
    }
    if status.written.frames == 0 {
        let because = skips.words().map_or_else(String::new, |words| format!(": {words}"));
        bail!("{out}: no frame was recorded{because}");
    }
    tracing::info!("recorded {}: {out}", summary(&status));
    Ok(())
}

fn summary(status: &RecordingStatus) -> String {
    let written = &status.written;
    let rate = if written.seconds > 0.0 { (written.frames.saturating_sub(1)) as f64 / written.seconds } else { 0.0 };
    format!(
        "{} frames in {:.1} s ({rate:.2} a second), {:.1} MB; {} lost, {} skipped, {} too fast for the disk",
        written.frames,
        written.seconds,
        written.bytes as f64 / 1e6,
        status.lost,
        written.skipped,
        status.overflowed
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read() {
        assert_eq!(parse_size("500MB"), Ok(500_000_000));
        assert_eq!(parse_size("2GiB"), Ok(2 << 30));
        assert_eq!(parse_size("1.5 kb"), Ok(1500));
        assert_eq!(parse_size("4096"), Ok(4096));
        for wrong in ["", "MB", "0", "-1", "3 parsecs", "1.2.3"] {
            assert!(parse_size(wrong).unwrap_err().starts_with("expected a size"), "{wrong}");
        }
        assert_eq!(above_zero("2.5"), Ok(2.5));
        for wrong in ["0", "-1", "nan", "inf", "x"] {
            above_zero(wrong).unwrap_err();
        }
    }
}
