use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use doorcam_core::solver::Audit;
use doorcam_engine::Assembly;
use doorcam_engine::figures::{self, ReconstructionPicture};
use doorcam_engine::{Model, Published, StepError};
use doorcam_source::Purpose;
use doorcam_source::recording::Entry;
use jiff::{SignedDuration, Timestamp};

use super::skipping::Skipping;
use super::{ModelOptions, manifest_of, progress};
use doorcam::feed::open_recording;

/// Reconstruct a recording's frames: one update per line on stdout, pictures in a directory
///
/// The recording's background_frames show the empty room; the frames after them are reconstructed, each on its own.
/// Each of them has an update, without facets where there is no map; frames that cannot be read are skipped.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  doorcam reconstruct recordings/lab-0 --preset published --output pictures
  doorcam reconstruct recordings/lab-0 | head -1 | python3 -m json.tool")]
pub(super) struct Arguments {
    /// The recording's directory
    recording: PathBuf,
    /// Only these frames: A (from A on), A..B (without B) or ..B
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    frames: Option<Range<u64>>,
    /// Write pictures here: reconstruction_N.svg and .png, difference_N.png
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Solve each frame again from N random starts, and with two lights allowed in each facet, and report on stderr how
    /// the objectives compare (slow)
    #[arg(long, value_name = "N")]
    audit: Option<usize>,
    #[command(flatten)]
    model: ModelOptions,
}

fn parse_range(text: &str) -> Result<Range<u64>, String> {
    let number = |part: &str, default: u64| {
        if part.is_empty() {
            Ok(default)
        } else {
            part.parse().map_err(|_| format!("\"{part}\" is not a frame number"))
        }
    };
    let (from, to) = text.split_once("..").unwrap_or((text, ""));
    let range = number(from, 0)?..number(to, u64::MAX)?;
    if range.is_empty() { Err("expected A..B with A below B".into()) } else { Ok(range) }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let config = arguments.model.config()?;
    let recording = open_recording(&arguments.recording)?;
    let manifest = recording.path.join("recording.json");
    if recording.manifest.background_frames.is_none() {
        bail!("{}: background_frames is missing, expected [first, end) of the empty room", manifest.display());
    };
    let wanted = |e: &&Entry| match recording.purpose(e.index) {
        Purpose::Before => false,
        Purpose::Background => true,
        Purpose::Watch | Purpose::Live => arguments.frames.as_ref().is_none_or(|r| r.contains(&e.index)),
    };
    let entries: Vec<&Entry> = recording.frames.iter().filter(wanted).collect();
    if entries.iter().all(|e| recording.purpose(e.index) == Purpose::Background) {
        bail!("{}: no frame to reconstruct after background_frames", recording.path.display());
    }
    let assembly = Assembly::new(config.settings()).cold_starts();
    let named = || manifest_of(&recording.path);
    let mut engine = assembly.for_recording(&recording.manifest).with_context(named)?;
    let model = engine.watched().model;
    let pictures = arguments.output.as_deref().map(|dir| Pictures::new(dir, &recording.path)).transpose()?;
    let progress = progress(entries.len() as u64);
    let (mut skipping, mut used) = (Skipping::default(), false);
    let mut stdout = std::io::stdout().lock();
    for entry in entries {
        let stepped = doorcam_source::load(&recording, entry)
            .map_err(StepError::Skipped)
            .and_then(|frame| engine.step(&frame, recording_time(entry.seconds)));
        match stepped {
            Ok(published) => {
                if recording.purpose(entry.index) == Purpose::Watch {
                    used = true;
                    writeln!(stdout, "{}", published.json)?;
                    stdout.flush()?;
                }
                if let Some(audit) = arguments.audit.filter(|_| published.scene.is_some()).and_then(|n| engine.audit(n))
                {
                    progress.suspend(|| report(entry.index, published.update.solution.objective, &audit));
                }
                if let Some(pictures) = &pictures {
                    pictures.write(&model, entry.index, &published)?;
                }
            }
            Err(StepError::Skipped(skipped)) => skipping.add(entry, &skipped, &progress),
            Err(e @ StepError::NoBackground) => bail!("{}: {e}{}", recording.path.display(), skipping.because()),
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    if !used {
        bail!("{}: no frame could be used{}", recording.path.display(), skipping.because());
    }
    skipping.finish(&recording, &engine);
    Ok(())
}

fn report(frame: u64, objective: f64, audit: &Audit) {
    let relative = |value: f64| value / objective;
    tracing::info!(
        "frame {frame}: objective {objective:.6}; relative to it, the best of {} random starts {:.6} ({:.0} % of them \
         agree), two lights per facet {:.6} and from there {:.6}, proven bound {:.6}",
        audit.starts,
        relative(audit.best),
        100.0 * audit.agreeing,
        relative(audit.two_lights),
        relative(audit.from_two_lights),
        relative(audit.bound)
    );
}

/// A recording's time as seconds from the epoch, since a recording has no date.
pub(super) fn recording_time(seconds: f64) -> Timestamp {
    let offset = SignedDuration::try_from_secs_f64(seconds).unwrap_or_default();
    Timestamp::UNIX_EPOCH.checked_add(offset).unwrap_or_default()
}

/// The directory that pictures are written to.
struct Pictures<'a> {
    directory: &'a Path,
    title: String,
}

/// Width of the PNG figures, in pixels.
const WIDTH: u32 = 1600;
/// Side of a patch pixel in difference pictures, in pixels.
const PATCH_PIXEL: u32 = 4;

impl<'a> Pictures<'a> {
    fn new(directory: &'a Path, recording: &Path) -> anyhow::Result<Self> {
        std::fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
        let name = recording.file_name().map_or_else(|| "recording".into(), |n| n.to_string_lossy().into_owned());
        Ok(Self { directory, title: name })
    }

    fn write(&self, model: &Model, frame: u64, published: &Published) -> anyhow::Result<()> {
        let (Some(scene), Some(difference)) = (&published.scene, &published.difference) else {
            return Ok(());
        };
        let solution = &published.update.solution;
        let caption = format!(
            "{}, frame {frame}: λ = {:.4}, objective {:.5}, {} facets changed, {}",
            self.title,
            solution.lambda,
            solution.objective,
            published.update.facets.len(),
            model.brightness.words()
        );
        let svg = figures::reconstruction_svg(&ReconstructionPicture::of(model, scene, Some(difference), &caption));
        self.save(&format!("reconstruction_{frame:08}.svg"), svg.as_bytes())?;
        self.save(&format!("reconstruction_{frame:08}.png"), &figures::png(&svg, WIDTH)?)?;
        self.save(&format!("difference_{frame:08}.png"), &figures::difference_png(difference, PATCH_PIXEL)?)
    }

    fn save(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        let path = self.directory.join(name);
        std::fs::write(&path, bytes).with_context(|| path.display().to_string())
    }
}
