//! Scans a JPEG's markers before anything is decoded: where it ends, and whether a part of it is missing.

use std::ops::Range;

use crate::image_error::ImageError;

/// What a JPEG's markers reveal.
#[derive(Debug, Default)]
pub(super) struct Outline {
    /// Position of the end marker, or of the end if there is none.
    pub end: usize,
    /// Whether there is an end marker.
    pub ended: bool,
    /// Whether it contains Huffman tables.
    pub huffman_tables: bool,
    /// Whether it is baseline or extended sequential, coded from top to bottom.
    pub sequential: bool,
    /// Whether a component has more samples, across or down, than the first one. No encoder makes these, and zune-jpeg
    /// panics on them.
    pub finer_colours: bool,
    /// Number of units (MCU) of the image, if it has a single scan.
    units: usize,
    /// Units between restart markers; 0 if there are no such markers.
    restart_interval: usize,
    /// Number of scans.
    pub scans: usize,
    /// Number of restart markers; none if their numbers have a gap.
    restarts: Option<usize>,
}

impl Outline {
    /// Walks from marker to marker. Whatever follows the end marker is padding. Without one, the data end with the
    /// bytes, and whether all of them are there is for the decoder to say.
    pub fn of(bytes: &[u8]) -> Result<Self, ImageError> {
        let mut outline = Outline { restarts: Some(0), ..Outline::default() };
        let mut at = 2;
        loop {
            let Some((marker, after)) = next_marker(bytes, at) else {
                outline.end = bytes.len();
                return if outline.scans > 0 { Ok(outline) } else { Err(cut_off()) };
            };
            at = after;
            match marker {
                0xd9 if outline.scans > 0 => {
                    (outline.end, outline.ended) = (after - 2, true);
                    return Ok(outline);
                }
                0xd0..=0xd7 => {
                    let number = usize::from(marker - 0xd0);
                    outline.restarts = outline.restarts.filter(|n| n % 8 == number).map(|n| n + 1);
                }
                // Markers without a segment.
                0x01 | 0xd8 | 0xd9 => {}
                _ => {
                    let segment = segment(bytes, at).ok_or_else(cut_off)?;
                    at += segment.len() + 2;
                    if matches!(marker, 0xc0..=0xc2) {
                        outline.finer_colours |= finer_colours(segment);
                    }
                    match marker {
                        0xc4 => outline.huffman_tables = true,
                        0xc0 | 0xc1 => {
                            outline.sequential = true;
                            outline.units = units(segment).unwrap_or(0);
                        }
                        0xdd => outline.restart_interval = segment.get(..2).map_or(0, big_endian),
                        0xda => outline.scans += 1,
                        _ => {}
                    }
                }
            }
        }
    }

    /// An error if restart markers are missing: lost data leave a gap in their numbers, which the decoders ignore.
    pub fn check_restarts(&self) -> Result<(), ImageError> {
        if !self.sequential || self.scans != 1 || self.restart_interval == 0 {
            return Ok(());
        }
        let expected = self.units.div_ceil(self.restart_interval).saturating_sub(1);
        match self.restarts {
            Some(found) if found >= expected => Ok(()),
            _ => Err(ImageError::Jpeg("data between restart markers are missing".into())),
        }
    }
}

pub(super) fn cut_off() -> ImageError {
    ImageError::Jpeg("cut off before its end marker".into())
}

/// The next marker's code, and the position after it.
pub(super) fn next_marker(bytes: &[u8], from: usize) -> Option<(u8, usize)> {
    let mut at = from;
    loop {
        at += memchr::memchr(0xff, bytes.get(at..)?)? + 1;
        // Repeated 0xff is fill; 0xff followed by 0 is data.
        match bytes.get(at)? {
            0 | 0xff => {}
            &code => return Some((code, at + 1)),
        }
    }
}

/// The segments before the first scan: their markers, and where their contents are.
pub(super) fn header_segments(bytes: &[u8]) -> impl Iterator<Item = (u8, Range<usize>)> {
    let mut at = 2;
    std::iter::from_fn(move || {
        let (marker, after) = next_marker(bytes, at)?;
        let content = segment(bytes, after)?;
        at = after + 2 + content.len();
        (marker != 0xda).then(|| (marker, at - content.len()..at))
    })
}

/// The content of the segment whose length is at `at`.
pub(super) fn segment(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let length = big_endian(bytes.get(at..at + 2)?);
    bytes.get(at + 2..at + length.max(2))
}

pub(super) fn big_endian(bytes: &[u8]) -> usize {
    bytes.iter().fold(0, |n, &b| n << 8 | usize::from(b))
}

/// Whether a component has a larger sampling factor than the first one, by the frame header.
fn finer_colours(frame: &[u8]) -> bool {
    let mut factors = frame.get(6..).unwrap_or(&[]).chunks_exact(3).map(|c| (c[1] >> 4, c[1] & 15));
    let first = factors.next();
    factors.any(|(across, down)| first.is_some_and(|first| across > first.0 || down > first.1))
}

/// Units of an image whose components are all in one scan, by its frame header.
fn units(frame: &[u8]) -> Option<usize> {
    let (height, width) = (big_endian(frame.get(1..3)?), big_endian(frame.get(3..5)?));
    let components = frame.get(6..)?.chunks_exact(3);
    let (mut across, mut down) = (1, 1);
    // A single component is not interleaved: its units are its blocks, whatever its sampling factors.
    if components.len() > 1 {
        for component in components {
            across = across.max(usize::from(component[1] >> 4));
            down = down.max(usize::from(component[1] & 15));
        }
    }
    Some(width.div_ceil(8 * across) * height.div_ceil(8 * down))
}
