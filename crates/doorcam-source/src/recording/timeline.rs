//! When a recording's frames were captured: from `timestamps.csv` as far as that is sound, else from `fps`.
//!
//! The times must grow from frame to frame, and a reader waits for them. So they are held against each other and
//! against the frame rate: what is in another unit is refused, and a jump, as from a clock that was set, is closed.

use std::collections::BTreeMap;
use std::path::Path;

use crate::SourceError;
use crate::files::{self, FileKind};

/// Longest pause between two frames, in seconds beyond the time that the frames between them take. A camera may be
/// unplugged for a while; what takes longer is a clock that was set, or another recording.
const LONGEST_PAUSE_S: f64 = 60.0;

/// A time that is this much earlier than the one before, in seconds, is a clock that was set back. What goes back by
/// less is a time that came late, or twice.
const SET_BACK_S: f64 = 1.0;

/// Times whose steps are this many times as long as the frame rate says are no seconds. A camera in the dark may be
/// slower than its nominal rate, but not by this much.
const OTHER_UNIT: f64 = 200.0;

/// With steps that are shorter than the frame rate says by more than this, the times tell nothing.
const TELL_NOTHING: f64 = 0.01;

/// Beyond this factor from the frame rate, a note says so.
const FAR_OFF: f64 = 20.0;

/// Times beyond this, in seconds, lose their microseconds as floating-point numbers. Counted from 1970, it is the year
/// 2286.
const LATEST_S: f64 = 1e10;

/// What is later than the frame before by less than this, in seconds, is not later.
const LEAST_STEP_S: f64 = 1e-5;

/// Times by frame number, as the file has them.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Stamps {
    /// Line and seconds.
    by_number: BTreeMap<u64, (usize, f64)>,
    /// What a user should know about the file: one line each.
    pub notes: Vec<String>,
}

/// Reads `timestamps.csv`; empty if there is none.
///
/// # Errors
/// If it cannot be read, or a line is no number and time. The last line may be cut off: a power cut leaves it so.
pub(super) fn read(file: &Path) -> Result<Stamps, SourceError> {
    let text = match files::read_text(file, FileKind::TIMES) {
        Ok(text) => text,
        Err(e) if e.is_missing() => return Ok(Stamps::default()),
        Err(e) => return Err(SourceError::new(file, e.words())),
    };
    parse(&text).map_err(|e| SourceError::new(file, e))
}

fn parse(text: &str) -> Result<Stamps, String> {
    let mut stamps = Stamps::default();
    let mut twice = None;
    let last = text.lines().count().saturating_sub(1);
    for (number, line) in text.lines().enumerate() {
        let mut fields = line.split(',').map(str::trim);
        let fields = [fields.next(), fields.next(), fields.next()].map(|field| field.filter(|f| !f.is_empty()));
        let is_number = |field: &Option<&str>| field.is_none_or(|f| f.parse::<f64>().is_ok());
        if line.trim().is_empty() || (number == 0 && !fields.iter().all(is_number)) {
            continue;
        }
        let parsed = match fields {
            [Some(index), Some(seconds), None] => {
                index.parse().ok().zip(seconds.parse().ok().filter(|s: &f64| s.is_finite()))
            }
            _ => None,
        };
        if parsed.is_none() && number == last && !text.ends_with('\n') {
            break;
        }
        let (index, seconds) = parsed.ok_or_else(|| format!("line {}: expected \"index,seconds\"", number + 1))?;
        if let Some((before, _)) = stamps.by_number.insert(index, (number + 1, seconds)) {
            twice.get_or_insert((index, before, number + 1));
        }
    }
    if let Some((index, before, after)) = twice {
        stamps.notes.push(format!("line {after}: index {index} was on line {before} already; the later line counts"));
    }
    Ok(stamps)
}

/// The unit that times are probably in, if they are not in seconds: their median step from frame to frame is far longer
/// than the frame rate says.
pub(crate) fn other_unit(median_step: f64, fps: f64) -> Option<&'static str> {
    let times = median_step * fps;
    (times >= OTHER_UNIT).then_some(match times {
        ..2e4 => "milliseconds",
        ..2e7 => "microseconds",
        _ => "nanoseconds",
    })
}

/// The middle one of these values, the lower one of two; none if there are none.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len().saturating_sub(1) / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The time of each frame, in seconds; `numbers` are the frames' numbers in order. Frames that neighbour each other in
/// that list follow each other in time, whatever their numbers: what is lost has an entry too. Times that the file has
/// and that are sound are returned as they are. Adds to the notes what is not.
///
/// # Errors
/// If the times are not in seconds.
pub(super) fn times(numbers: &[u64], stamps: &mut Stamps, fps: f64) -> Result<Vec<f64>, String> {
    let known: Vec<Known> = (0..)
        .zip(numbers)
        .filter_map(|(at, number)| stamps.by_number.get(number).map(|&(line, seconds)| Known { at, line, seconds }))
        .collect();
    let notes = &mut stamps.notes;
    let by_rate = || {
        let first = numbers.first().copied().unwrap_or(0);
        let first = if first as f64 / fps < LATEST_S { first } else { 0 };
        (0..numbers.len() as u64).map(|at| (first + at) as f64 / fps).collect::<Vec<f64>>()
    };
    let (mut rising, mut late): (Vec<Known>, Vec<usize>) = (Vec::with_capacity(known.len()), Vec::new());
    for &next in &known {
        match rising.last() {
            Some(before) if next.is_late_after(before) => late.push(next.line),
            _ => rising.push(next),
        }
    }
    let steps: Vec<f64> =
        rising.windows(2).map(|w| (w[1].seconds - w[0].seconds) / (w[1].at - w[0].at) as f64).collect();
    let back = steps.iter().filter(|&&step| step < 0.0).count();
    let typical = median(steps.iter().copied().filter(|&step| step > 0.0).collect());
    if let Some(step) = typical
        && let Some(unit) = other_unit(step, fps)
    {
        let line = known.get(1).map_or(1, |k| k.line);
        return Err(format!(
            "line {line}: the times are {} s a frame apart, but {} s by fps in recording.json; they are probably {unit}, \
             expected seconds",
            brief(step),
            brief(1.0 / fps)
        ));
    }
    if let Some(wrong) = known.iter().find(|k| k.seconds.abs() > LATEST_S) {
        let Known { line, seconds, .. } = wrong;
        return Err(format!("line {line}: the time is {seconds:e}, expected seconds, at most {LATEST_S:e}"));
    }
    let Some(start) = known.first() else {
        if !stamps.by_number.is_empty() {
            notes.push("has no time of any frame: the frames follow each other as fps in recording.json says".into());
        }
        return Ok(by_rate());
    };
    let why_not = match typical {
        _ if known.len() < 2 => None,
        None => Some("the times do not grow"),
        Some(_) if 2 * back > steps.len() => Some("the times go backwards"),
        Some(step) if step * fps < TELL_NOTHING => Some("the times are almost the same for all frames"),
        Some(_) => None,
    };
    if let Some(why_not) = why_not {
        let line = known.get(1).map_or(1, |k| k.line);
        notes.push(format!("line {line}: {why_not}: the frames follow each other as fps in recording.json says"));
        return Ok(by_rate());
    }
    let step = typical.unwrap_or(1.0 / fps);
    if !(1.0 / FAR_OFF..=FAR_OFF).contains(&(step * fps)) {
        let (step, expected) = (brief(step), brief(1.0 / fps));
        notes.push(format!("the times are {step} s a frame apart, but {expected} s by fps in recording.json"));
    }
    let (mut kept, mut jumps) = (vec![(*start, start.seconds)], Vec::new());
    for &next in &rising[1..] {
        let Some(&(before, time)) = kept.last() else { break };
        let (elapsed, usual) = (next.seconds - before.seconds, step * (next.at - before.at) as f64);
        let counts = if elapsed <= 0.0 || elapsed > usual + LONGEST_PAUSE_S {
            jumps.push((next.line, elapsed));
            time + usual
        } else if time == before.seconds {
            // As it is in the file, for nothing was shifted before.
            next.seconds
        } else {
            time + elapsed
        };
        kept.push((next, counts));
    }
    if let Some(&(line, by)) = jumps.first() {
        notes.push(format!(
            "line {line}: the time jumps by {} s{}: the frames go on as if it did not",
            brief(by),
            more(jumps.len(), "jump")
        ));
    }
    if let Some(&line) = late.first() {
        notes.push(format!(
            "line {line}: the time is not later than the one before{}: the frame is placed between its neighbours",
            more(late.len(), "such line")
        ));
    }
    Ok(filled(numbers.len(), &kept, step))
}

/// A time in the file.
#[derive(Debug, Clone, Copy)]
struct Known {
    /// The frame's place in the list.
    at: usize,
    line: usize,
    seconds: f64,
}

impl Known {
    /// Whether this is no time later than `before`, but not so much earlier that a clock was set.
    fn is_late_after(&self, before: &Known) -> bool {
        let elapsed = self.seconds - before.seconds;
        elapsed > -SET_BACK_S && elapsed < LEAST_STEP_S * (self.at - before.at) as f64
    }
}

/// A time for each of `count` frames: those between two known ones are evenly spread, those before the first and after
/// the last are `step` apart.
fn filled(count: usize, kept: &[(Known, f64)], step: f64) -> Vec<f64> {
    let mut times = Vec::with_capacity(count);
    let mut after = kept.iter().peekable();
    let mut before: Option<(usize, f64)> = None;
    for at in 0..count {
        if let Some((known, time)) = after.next_if(|(known, _)| known.at == at) {
            before = Some((known.at, *time));
        }
        times.push(match (before, after.peek()) {
            (Some((from, time)), _) if from == at => time,
            (Some((from, time)), Some((to, end))) => time + (end - time) * ((at - from) as f64 / (to.at - from) as f64),
            (Some((from, time)), None) => time + step * (at - from) as f64,
            (None, Some((to, end))) => end - step * (to.at - at) as f64,
            (None, None) => step * at as f64,
        });
    }
    times
}

/// A number of seconds for people.
pub(crate) fn brief(seconds: f64) -> String {
    let digits = 2 - seconds.abs().max(1e-6).log10().floor() as i32;
    let text = format!("{seconds:.*}", usize::try_from(digits).unwrap_or(0));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

fn more(count: usize, what: &str) -> String {
    match count {
        0 | 1 => String::new(),
        2 => format!(" (and 1 more {what})"),
        _ => format!(" (and {} more {what}s)", count - 1),
    }
}

#[cfg(test)]
#[path = "timeline_tests.rs"]
mod tests;
