//! What a sensor's driver delivers: pixels that are not an image file.

/// How the bytes of a raw frame are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SensorFormat {
    /// Order and subsampling of the samples.
    pub pixels: SensorPixels,
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Bytes from one row (of the first plane) to the next.
    pub stride: usize,
    /// Whether luma and chroma use all 8 bits; otherwise 16..=235 and 16..=240.
    pub full_range: bool,
    /// How luma and chroma make red, green and blue.
    pub matrix: LumaMatrix,
}

/// Order and subsampling of a raw frame's samples, by V4L2's names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SensorPixels {
    /// Y0 Cb Y1 Cr: two pixels share their chroma.
    Yuyv,
    /// A plane of luma, then one of Cb Cr for each 2 x 2 pixels.
    Nv12,
    /// Red, green, blue.
    Rgb24,
    /// Luma alone.
    Grey,
}

/// Weights of red, green and blue in luma.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LumaMatrix {
    /// ITU-R BT.601.
    Bt601,
    /// ITU-R BT.709.
    Bt709,
}
