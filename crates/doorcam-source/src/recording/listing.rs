//! Which files of a recording are its frames, and in which order.
//!
//! Frames are known by their numbers, whatever else their names have and however wide the numbers are. A file that does
//! not belong to the sequence must not move the others to wrong places: it is left out, and the notes say so.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::{Files, Layout};
use crate::SourceError;
use crate::files::{shown, words};
use doorcam_core::geometry::Side;

/// Most frames of a recording: a day and a half at 30 frames a second.
pub(crate) const MOST_FRAMES: usize = 4_000_000;

/// Longest run of missing numbers that counts as lost frames rather than as another way of numbering.
const LONGEST_GAP: u64 = 1000;

/// Missing numbers count as lost frames only while there are at most this many times as many of them as frames, or few:
/// somebody who keeps every 500th frame has lost none.
const MOST_LOST: u64 = 4;

/// Most names that one note lists.
const NAMED: usize = 5;

/// The frames' numbers and files, in order.
#[derive(Debug, PartialEq)]
pub(super) struct Listing {
    /// Each frame's number and files. Numbers grow.
    pub frames: Vec<(u64, Files)>,
    /// What a user should know about the names: one line each.
    pub notes: Vec<String>,
}

/// An image file's name, taken apart.
#[derive(Debug, Clone)]
struct Named {
    file: PathBuf,
    /// What the names of one sequence share: what stands before and after the number.
    group: (String, String),
    /// The number's digits.
    digits: String,
    number: u64,
}

impl Named {
    /// None if the stem has no number. `stem` is without the side's name.
    fn of(file: &Path, stem: &str) -> Option<Self> {
        let up_to = |digit: bool, part: &str| part.trim_end_matches(|c: char| c.is_ascii_digit() == digit).len();
        let end = up_to(false, stem);
        let start = up_to(true, &stem[..end]);
        let digits = stem[start..end].to_owned();
        let number = digits.parse().ok()?;
        Some(Self { file: file.to_owned(), group: (stem[..start].into(), stem[end..].into()), digits, number })
    }

    fn extension(&self) -> String {
        extension(&self.file)
    }

    /// The name that the frame with another number has, `side` included.
    fn with_number(&self, number: u64, side: &str) -> PathBuf {
        let (before, after) = &self.group;
        let extension = self.file.extension().unwrap_or_default().to_string_lossy();
        format!("{before}{number:0width$}{after}{side}.{extension}", width = self.digits.len()).into()
    }

    fn is_padded(&self) -> bool {
        self.digits.len() > 1 && self.digits.starts_with('0')
    }
}

fn extension(file: &Path) -> String {
    file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// Lists the images in `folder`.
///
/// # Errors
/// If the folder cannot be listed, has no images or too many, or if it is unclear which of them are the frames.
pub(super) fn list(folder: &Path, layout: Layout) -> Result<Listing, SourceError> {
    let refused = |reason: String| SourceError::new(folder, reason);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| refused(words(&e)))? {
        names.push(entry.map_err(|e| refused(words(&e)))?.file_name());
        if names.len() > 2 * MOST_FRAMES {
            return Err(refused(format!("too many files, expected at most {MOST_FRAMES} frames")));
        }
    }
    names.sort();
    let listing = sort(names, layout).map_err(refused)?;
    if listing.frames.len() > MOST_FRAMES {
        return Err(refused(format!("{} frames, expected at most {MOST_FRAMES}", listing.frames.len())));
    }
    Ok(listing)
}

/// Finds the frames among files of these names, which are sorted.
fn sort(names: Vec<OsString>, layout: Layout) -> Result<Listing, String> {
    const NONE: &str = "no images, expected 00000000.jpg, ... or 00000000_left.png, ...";
    let (mut strays, mut named, mut unnumbered) = (Vec::new(), Vec::new(), Vec::new());
    for name in names {
        let file = PathBuf::from(&name);
        let image = matches!(extension(&file).as_str(), "jpg" | "jpeg" | "png");
        if !image || name.as_encoded_bytes().starts_with(b".") {
            strays.push(file);
            continue;
        }
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let (stem, side) = match layout {
            Layout::Camera => (Some(&stem[..]), 0),
            Layout::Patches => match Side::BOTH.iter().position(|side| of_side(&stem, *side).is_some()) {
                Some(side) => (of_side(&stem, Side::BOTH[side]), side),
                None => (None, 0),
            },
        };
        match stem.and_then(|stem| Named::of(&file, stem)) {
            Some(name) => named.push((name, side)),
            None => unnumbered.push(file),
        }
    }
    if named.is_empty() && (unnumbered.is_empty() || layout == Layout::Patches) {
        return Err(NONE.into());
    }
    let mut notes = Vec::new();
    if named.is_empty() {
        notes.push("no name has a number: the frames are taken in the order of their names".into());
        notes.extend(left_out(&strays));
        let frames = (0..).zip(unnumbered).map(|(n, file)| (n, Files::Camera(file))).collect();
        return Ok(Listing { frames, notes });
    }
    let (kept, others) = one_sequence(named, unnumbered.len())?;
    strays.extend(others.into_iter().map(|name| name.file));
    strays.extend(unnumbered);
    strays.sort();
    notes.extend(left_out(&strays));
    let padded = kept.iter().filter(|(name, _)| name.is_padded()).count() > 1;
    let mut extensions: HashMap<String, usize> = HashMap::new();
    kept.iter().for_each(|(name, _)| *extensions.entry(name.extension()).or_default() += 1);
    // Of two files for one frame the one whose name is more like the others'.
    let likeness = |name: &Named| (extensions[&name.extension()], name.is_padded() == padded);
    let mut frames: BTreeMap<u64, [Option<Named>; 2]> = BTreeMap::new();
    let mut twice = Vec::new();
    for (name, side) in kept {
        let place = &mut frames.entry(name.number).or_default()[side];
        let better = place.as_ref().is_none_or(|before| likeness(&name) > likeness(before));
        let loser = if better { place.replace(name) } else { Some(name) };
        twice.extend(loser.map(|name| name.file));
    }
    if !twice.is_empty() {
        notes.push(format!("{} left out, as their numbers are there twice: {}", files(twice.len()), listed(&twice)));
    }
    let frames = in_order(frames, layout, &mut notes);
    Ok(Listing { frames, notes })
}

/// The stem without the side's name, if it ends in that.
fn of_side(stem: &str, side: Side) -> Option<&str> {
    stem.strip_suffix(side.name())?.strip_suffix('_')
}

type Sided = (Named, usize);

/// The names that belong to the one numbered sequence, and those that do not.
fn one_sequence(named: Vec<Sided>, unnumbered: usize) -> Result<(Vec<Sided>, Vec<Named>), String> {
    let all = named.len() + unnumbered;
    let plain = |group: &(String, String)| group.0.is_empty() && group.1.is_empty();
    let (group, size) = {
        let mut sizes: HashMap<&(String, String), usize> = HashMap::new();
        named.iter().for_each(|(name, _)| *sizes.entry(&name.group).or_default() += 1);
        let largest = sizes.into_iter().max_by_key(|&(group, size)| (size, plain(group), Reverse(group)));
        largest.map(|(group, size)| (group.clone(), size)).unwrap_or_default()
    };
    // A few strays are no matter. If there are as many of them, it is anybody's guess which ones are the frames.
    if !plain(&group) && 2 * size <= all {
        let example =
            |same: bool| named.iter().find(|(name, _)| (name.group == group) == same).map(|(n, _)| shown(&n.file));
        let (one, other) = (example(true).unwrap_or_default(), example(false).unwrap_or_else(|| "others".into()));
        return Err(format!(
            "it is unclear which of the {all} images are the frames ({one} or {other}), expected one numbered sequence"
        ));
    }
    let (kept, others): (Vec<_>, Vec<_>) = named.into_iter().partition(|(name, _)| name.group == group);
    Ok((kept, others.into_iter().map(|(name, _)| name).collect()))
}

/// The frames in order, with an entry for each that is lost.
fn in_order(pairs: BTreeMap<u64, [Option<Named>; 2]>, layout: Layout, notes: &mut Vec<String>) -> Vec<(u64, Files)> {
    let count = pairs.len() as u64;
    let gaps = |pairs: &BTreeMap<u64, _>| {
        let numbers: Vec<u64> = pairs.keys().copied().collect();
        numbers.windows(2).map(|w| w[1] - w[0] - 1).collect::<Vec<u64>>()
    };
    let lost: u64 = gaps(&pairs).iter().filter(|&&gap| gap <= LONGEST_GAP).sum();
    let fill = lost <= (MOST_LOST * count).max(LONGEST_GAP);
    let (mut frames, mut missing, mut jumps) = (Vec::with_capacity(pairs.len()), Vec::new(), Vec::new());
    let mut before: Option<(u64, [Option<Named>; 2])> = None;
    for (number, pair) in pairs {
        if let Some((last, like)) = &before {
            let gap = number - last - 1;
            if fill && gap <= LONGEST_GAP {
                let (name, side) = template(like, layout);
                let expected = |k| name.map_or_else(PathBuf::new, |name| name.with_number(k, side));
                frames.extend((last + 1..number).map(|k| (k, Files::Missing(expected(k)))));
            }
            match gap {
                0 => {}
                _ if fill && gap <= LONGEST_GAP => missing.push(run(last + 1, number - 1)),
                _ => jumps.push(run(*last, number)),
            }
        }
        let files = match (layout, &pair) {
            (Layout::Camera, [Some(name), _]) => Files::Camera(name.file.clone()),
            (Layout::Patches, [Some(left), Some(right)]) => Files::Patches(left.file.clone(), right.file.clone()),
            (_, [Some(left), None]) => Files::Missing(left.with_number(number, "_right")),
            (_, [None, Some(right)]) => Files::Missing(right.with_number(number, "_left")),
            (_, [None, None]) => continue,
        };
        frames.push((number, files));
        before = Some((number, pair));
    }
    if !missing.is_empty() {
        let frames = if lost == 1 { "1 frame is".into() } else { format!("{lost} frames are") };
        notes.push(format!("{frames} missing, by the numbers: {}", some(missing.into_iter())));
    }
    if !jumps.is_empty() {
        notes.push(format!("the numbers jump, which counts as no loss: {}", some(jumps.into_iter())));
    }
    frames
}

/// A name to make that of a missing neighbour from, and the side's part in it.
fn template(like: &[Option<Named>; 2], layout: Layout) -> (Option<&Named>, &'static str) {
    match (layout, like) {
        (Layout::Camera, [name, _]) => (name.as_ref(), ""),
        (Layout::Patches, [Some(left), _]) => (Some(left), "_left"),
        (Layout::Patches, [None, right]) => (right.as_ref(), "_left"),
    }
}

fn run(first: u64, last: u64) -> String {
    if first == last { first.to_string() } else { format!("{first} to {last}") }
}

fn left_out(strays: &[PathBuf]) -> Option<String> {
    (!strays.is_empty()).then(|| format!("{} left out, as no frames: {}", files(strays.len()), listed(strays)))
}

fn files(count: usize) -> String {
    if count == 1 { "1 file is".into() } else { format!("{count} files are") }
}

fn listed(files: &[PathBuf]) -> String {
    some(files.iter().map(|file| shown(file)))
}

/// The first few of these words.
fn some(words: impl ExactSizeIterator<Item = String>) -> String {
    let more = words.len().saturating_sub(NAMED);
    let list = words.take(NAMED).collect::<Vec<_>>().join(", ");
    if more == 0 { list } else { format!("{list} and {more} more") }
}

#[cfg(test)]
#[path = "listing_tests.rs"]
mod tests;
