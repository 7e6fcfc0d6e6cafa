use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A pixel format that doorcam decodes, named by its V4L2 code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "UPPERCASE")]
pub enum PixelFormat {
    /// 4:2:2, interleaved.
    Yuyv,
    /// 4:2:0, two planes.
    Nv12,
    /// Red, green and blue, 24 bits a pixel.
    Rgb3,
    /// Luma only.
    Grey,
    /// One JPEG per frame.
    Mjpg,
}

impl PixelFormat {
    /// All formats, the most faithful first: a JPEG's quantisation error is as large as the change due to a far person.
    pub const ALL: [Self; 5] = [Self::Yuyv, Self::Nv12, Self::Rgb3, Self::Grey, Self::Mjpg];

    /// The V4L2 code.
    pub fn code(self) -> &'static [u8; 4] {
        match self {
            Self::Yuyv => b"YUYV",
            Self::Nv12 => b"NV12",
            Self::Rgb3 => b"RGB3",
            Self::Grey => b"GREY",
            Self::Mjpg => b"MJPG",
        }
    }

    /// The format of a V4L2 code, if it is one of these. Some drivers call the same JPEGs "JPEG".
    pub fn of_code(code: [u8; 4]) -> Option<Self> {
        if code == *b"JPEG" {
            return Some(Self::Mjpg);
        }
        Self::ALL.into_iter().find(|format| *format.code() == code)
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(std::str::from_utf8(self.code()).unwrap_or_default())
    }
}

impl FromStr for PixelFormat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(|f| f.to_string()).join(", ");
        Self::ALL
            .into_iter()
            .find(|format| format.to_string().eq_ignore_ascii_case(text))
            .ok_or_else(|| format!("unknown pixel format \"{text}\", expected one of {}", known()))
    }
}

/// The mode requested of a camera, which need not have it.
#[derive(Debug, Clone, PartialEq)]
pub struct Wish {
    /// Width and height, in pixels.
    pub size: [u32; 2],
    /// Frames a second.
    pub fps: f64,
    /// Pixel formats, the preferred one first.
    pub formats: Vec<PixelFormat>,
}

/// A mode that a camera offers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Offer {
    pub(crate) format: PixelFormat,
    pub(crate) size: [u32; 2],
    /// The highest rate, in frames a second; none if the driver does not report it.
    pub(crate) fps: Option<f64>,
}

/// A rate of at least this share of the requested one counts as reached: drivers round.
const ROUNDING: f64 = 0.98;

/// Usable offers, the best first: by size, then by how nearly the rate is reached, then by format.
///
/// A calibration is for one size, so the size comes first. The rate comes before the format because a faithful format
/// loses people if it has only two frames a second.
pub(crate) fn ranked(wish: &Wish, offers: &[Offer]) -> Vec<Offer> {
    let place = |offer: &Offer| wish.formats.iter().position(|&format| format == offer.format);
    let area = |[w, h]: [u32; 2]| f64::from(w.max(1)) * f64::from(h.max(1));
    let shape = |[w, h]: [u32; 2]| f64::from(w.max(1)) / f64::from(h.max(1));
    let key = |offer: &Offer| {
        let distance =
            (area(offer.size) / area(wish.size)).ln().abs() + (shape(offer.size) / shape(wish.size)).ln().abs();
        let rate = offer.fps.map_or(1.0, |fps| (fps / (wish.fps * ROUNDING)).min(1.0));
        (distance, -rate, place(offer))
    };
    let mut usable: Vec<Offer> = offers.iter().copied().filter(|offer| place(offer).is_some()).collect();
    usable.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2))
    });
    usable
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(format: PixelFormat, size: [u32; 2], fps: f64) -> Offer {
        Offer { format, size, fps: Some(fps) }
    }

    /// The offers of a typical webcam: raw pixels only at a low rate for large pictures.
    fn webcam() -> Vec<Offer> {
        use PixelFormat::{Mjpg, Yuyv};
        vec![
            offer(Mjpg, [640, 480], 30.0),
            offer(Mjpg, [1280, 720], 30.0),
            offer(Yuyv, [640, 480], 30.0),
            offer(Yuyv, [1280, 720], 7.5),
            offer(Yuyv, [320, 240], 30.0),
        ]
    }

    fn best(size: [u32; 2], fps: f64) -> Offer {
        let wish = Wish { size, fps, formats: PixelFormat::ALL.to_vec() };
        ranked(&wish, &webcam())[0]
    }

    #[test]
    fn raw_pixels_where_the_rate_allows_and_jpeg_where_not() {
        assert_eq!(best([640, 480], 15.0), offer(PixelFormat::Yuyv, [640, 480], 30.0));
        assert_eq!(best([1280, 720], 15.0), offer(PixelFormat::Mjpg, [1280, 720], 30.0));
        assert_eq!(best([1280, 720], 7.5), offer(PixelFormat::Yuyv, [1280, 720], 7.5));
        assert_eq!(best([800, 600], 30.0).size, [640, 480]);
    }

    #[test]
    fn the_order_in_the_configuration_decides() {
        let wish = Wish { size: [640, 480], fps: 15.0, formats: vec![PixelFormat::Mjpg] };
        assert!(ranked(&wish, &webcam()).iter().all(|offer| offer.format == PixelFormat::Mjpg));
        let wish = Wish { formats: vec![PixelFormat::Grey], ..wish };
        assert!(ranked(&wish, &webcam()).is_empty());
    }

    #[test]
    fn formats_are_known_by_their_codes() {
        for format in PixelFormat::ALL {
            assert_eq!(PixelFormat::of_code(*format.code()), Some(format));
            assert_eq!(format.to_string().to_lowercase().parse(), Ok(format));
        }
        assert_eq!(PixelFormat::of_code(*b"JPEG"), Some(PixelFormat::Mjpg));
        assert_eq!(PixelFormat::of_code(*b"H264"), None);
        assert!("H264".parse::<PixelFormat>().unwrap_err().ends_with("expected one of YUYV, NV12, RGB3, GREY, MJPG"));
    }
}
