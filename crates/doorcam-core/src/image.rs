//! Decoded images.

/// Most pixels of an image that is looked at: 8K, more than any camera has that can watch a doorway.
pub const MOST_PIXELS: usize = 7680 * 4320;

/// Sample values as stored in the file: red, green and blue interleaved, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// 8 bits per sample.
    Eight(Vec<u8>),
    /// 16 bits per sample.
    Sixteen(Vec<u16>),
}

/// A decoded image. Grey images have three equal channels; transparency is dropped.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `3 * width * height` samples.
    pub samples: Samples,
}

impl Image {
    /// An image without pixels, to decode into.
    pub fn empty() -> Self {
        Self { width: 0, height: 0, samples: Samples::Eight(Vec::new()) }
    }

    /// Makes this an image with 8 bits per sample and returns the samples for writing. Reuses the buffer of an 8-bit
    /// image.
    pub fn eight_mut(&mut self, width: usize, height: usize) -> &mut [u8] {
        (self.width, self.height) = (width, height);
        if matches!(self.samples, Samples::Sixteen(_)) {
            self.samples = Samples::Eight(Vec::new());
        }
        match &mut self.samples {
            Samples::Eight(samples) => {
                samples.resize(3 * width * height, 0);
                samples
            }
            Samples::Sixteen(_) => &mut [],
        }
    }

    /// Makes this an image with 16 bits per sample and returns the samples for writing. Reuses the buffer of a 16-bit
    /// image.
    pub fn sixteen_mut(&mut self, width: usize, height: usize) -> &mut [u16] {
        (self.width, self.height) = (width, height);
        if matches!(self.samples, Samples::Eight(_)) {
            self.samples = Samples::Sixteen(Vec::new());
        }
        match &mut self.samples {
            Samples::Sixteen(samples) => {
                samples.resize(3 * width * height, 0);
                samples
            }
            Samples::Eight(_) => &mut [],
        }
    }
}

impl Samples {
    /// The samples rounded to 8 bits.
    pub fn to_eight(&self) -> Vec<u8> {
        match self {
            Samples::Eight(samples) => samples.clone(),
            // 65535 = 255 * 257.
            Samples::Sixteen(samples) => samples.iter().map(|&s| ((u32::from(s) + 128) / 257) as u8).collect(),
        }
    }
}
