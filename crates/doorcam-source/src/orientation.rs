//! How an image file is tagged to be turned before people look at it (EXIF, tag 274).
//!
//! doorcam measures in the pixels that are stored, and so do floor points: it never turns an image. But somebody who
//! took floor points from a viewer that turns images has other points, so the tag is never passed over in silence.

use std::fmt;
use std::ops::Range;

/// The tag's value: 1 for upright, 2 to 8 for the other ways to turn and mirror an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Orientation(u8);

impl Default for Orientation {
    fn default() -> Self {
        Self(1)
    }
}

impl fmt::Display for Orientation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Orientation {
    /// That of a JPEG or PNG; upright if it has no such tag, or an impossible one.
    pub(crate) fn of(image: &[u8]) -> Self {
        let value = tag(image).map_or(1, |at| if image[at] == 0 { image[at + 1] } else { image[at] });
        if (1..=8).contains(&value) { Self(value) } else { Self::default() }
    }

    /// Whether width and height change places.
    pub(crate) fn swaps_sides(self) -> bool {
        self.0 >= 5
    }

    /// Sets a JPEG's tag to upright, so that whoever shows the image shows it as it is stored.
    pub(crate) fn reset(image: &mut [u8]) {
        // A PNG's checksum would no longer fit.
        if image.starts_with(&[0xff, 0xd8])
            && let Some(at) = tag(image)
        {
            let low = if image[at] == 0 { at + 1 } else { at };
            image[low] = 1;
        }
    }
}

/// Position of the tag's value: two bytes, of which one is 0.
fn tag(image: &[u8]) -> Option<usize> {
    let exif = if image.starts_with(&[0xff, 0xd8]) { crate::jpeg::exif(image)? } else { of_png(image)? };
    let at = exif.start;
    let tiff = image.get(exif)?;
    let little = match tiff.get(..4)? {
        b"II*\0" => true,
        b"MM\0*" => false,
        _ => return None,
    };
    let number = |range: Range<usize>| {
        let bytes = tiff.get(range)?.iter();
        let add = |n: usize, &byte: &u8| n << 8 | usize::from(byte);
        Some(if little { bytes.rev().fold(0, add) } else { bytes.fold(0, add) })
    };
    let directory = number(4..8)?;
    for entry in 0..number(directory..directory.checked_add(2)?)? {
        let start = directory + 2 + 12 * entry;
        // Tag 274 with one value of type SHORT.
        if number(start..start + 2)? == 274 && number(start + 2..start + 4)? == 3 && number(start + 4..start + 8)? == 1
        {
            return (number(start + 8..start + 10)? < 256).then_some(at + start + 8);
        }
    }
    None
}

/// The EXIF data of a PNG, which may follow the image; those do not count.
fn of_png(image: &[u8]) -> Option<Range<usize>> {
    let mut at = image.starts_with(b"\x89PNG\r\n\x1a\n").then_some(8)?;
    loop {
        let length = image.get(at..at + 4)?.iter().fold(0, |n: usize, &byte| n << 8 | usize::from(byte));
        match image.get(at + 4..at + 8)? {
            b"eXIf" => return Some(at + 8..at + 8 + length),
            b"IDAT" => return None,
            _ => at += 12 + length,
        }
    }
}

/// EXIF data with nothing but an orientation, in either byte order.
#[cfg(test)]
pub(crate) fn exif(value: u8, little: bool) -> Vec<u8> {
    if little {
        [&b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[value, 0, 0, 0, 0, 0, 0, 0]].concat()
    } else {
        [&b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01"[..], &[0, value, 0, 0, 0, 0, 0, 0]].concat()
    }
}

/// A JPEG with an orientation.
#[cfg(test)]
pub(crate) fn tagged(jpeg: &[u8], value: u8, little: bool) -> Vec<u8> {
    let exif = exif(value, little);
    let length = u16::try_from(exif.len() + 8).unwrap().to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe1], &length, b"Exif\0\0", &exif, &jpeg[2..]].concat()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const JPEG: &[u8] = include_bytes!("testdata/grey16.jpg");

    #[test]
    fn the_tag_is_found_in_either_byte_order_and_reset() {
        assert_eq!(Orientation::of(JPEG), Orientation(1));
        for little in [true, false] {
            for value in 1..=8 {
                let mut image = tagged(JPEG, value, little);
                assert_eq!(Orientation::of(&image), Orientation(value), "{little}");
                assert_eq!(Orientation(value).swaps_sides(), value >= 5);
                Orientation::reset(&mut image);
                assert_eq!(Orientation::of(&image), Orientation(1));
                assert_eq!(image, tagged(JPEG, 1, little));
            }
            assert_eq!(Orientation::of(&tagged(JPEG, 0, little)), Orientation(1));
            assert_eq!(Orientation::of(&tagged(JPEG, 77, little)), Orientation(1));
        }
    }

    #[test]
    fn pngs_may_have_it_too() {
        let exif = exif(6, false);
        let chunk = |name: &[u8], data: &[u8]| [&(data.len() as u32).to_be_bytes(), name, data, b"sum."].concat();
        let png = |chunks: &[Vec<u8>]| [b"\x89PNG\r\n\x1a\n".to_vec(), chunks.concat()].concat();
        let head = chunk(b"IHDR", &[0; 13]);
        assert_eq!(Orientation::of(&png(&[head.clone(), chunk(b"eXIf", &exif), chunk(b"IDAT", b"")])), Orientation(6));
        assert_eq!(Orientation::of(&png(&[head, chunk(b"IDAT", b""), chunk(b"eXIf", &exif)])), Orientation(1));
    }

    proptest! {
        #[test]
        fn damage_never_panics(
            changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 0..9), cut in any::<proptest::sample::Index>(),
            little in any::<bool>(),
        ) {
            let mut image = tagged(JPEG, 6, little);
            for (at, value) in changes {
                let at = at.index(64);
                image[at] = value;
            }
            image.truncate(cut.index(image.len()));
            let _ = Orientation::of(&image);
            Orientation::reset(&mut image);
        }
    }
}
