use crate::image::{Image, Samples};

/// A small grey picture of a whole image: each pixel is the mean over a square of `scale` x `scale` pixels.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Overview {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Side of the square of the image's pixels that each pixel stands for.
    pub scale: usize,
    /// The brightness of each pixel, row by row: 0 to 255, as encoded by the camera.
    pub codes: Vec<f32>,
}

/// Overviews are at most this wide: a pixel of the image is then found to a tenth, and a look takes milliseconds.
const WIDEST: usize = 480;

impl Overview {
    /// The scale for images of this width.
    pub fn scale_of(width: usize) -> usize {
        width.div_ceil(WIDEST).max(1)
    }

    /// Makes this the overview of `image`. Does not allocate once it has been that of an image of this size.
    pub fn reduce(&mut self, image: &Image) {
        let scale = Self::scale_of(image.width);
        (self.scale, self.width, self.height) = (scale, image.width / scale, image.height / scale);
        self.codes.clear();
        self.codes.resize(self.width * self.height, 0.0);
        match &image.samples {
            Samples::Eight(samples) => self.add(samples, image.width, f32::from),
            Samples::Sixteen(samples) => self.add(samples, image.width, |code| f32::from(code) / 257.0),
        }
        // Red and blue count once, green twice.
        let share = 1.0 / (4 * scale * scale) as f32;
        self.codes.iter_mut().for_each(|code| *code *= share);
    }

    fn add<T: Copy>(&mut self, samples: &[T], image_width: usize, code: impl Fn(T) -> f32) {
        let (width, scale) = (self.width, self.scale);
        if width == 0 || samples.len() < 3 * image_width * self.height * scale {
            return;
        }
        for (line, row) in samples.chunks_exact(3 * image_width).take(self.height * scale).zip(0..) {
            let sums = &mut self.codes[row / scale * width..][..width];
            for (sum, pixels) in sums.iter_mut().zip(line.chunks_exact(3 * scale)) {
                *sum += pixels.chunks_exact(3).map(|p| code(p[0]) + 2.0 * code(p[1]) + code(p[2])).sum::<f32>();
            }
        }
    }

    /// The picture, to be shown.
    pub fn image(&self) -> Image {
        let grey = |&code: &f32| [code.round().clamp(0.0, 255.0) as u8; 3];
        let samples = Samples::Eight(self.codes.iter().flat_map(grey).collect());
        Image { width: self.width, height: self.height, samples }
    }

    /// Whether it has the size and scale of `other`.
    pub fn is_like(&self, other: &Self) -> bool {
        (self.width, self.height, self.scale) == (other.width, other.height, other.scale)
    }

    /// The pixel of the image at the middle of this picture. Whole numbers are the centres of pixels.
    pub fn centre(&self) -> [f64; 2] {
        [self.width, self.height].map(|n| ((n * self.scale) as f64 - 1.0) / 2.0)
    }

    /// The mean of several pictures of the same size; `None` if there is none or their sizes differ.
    pub fn mean(pictures: &[Self]) -> Option<Self> {
        let mut mean = pictures.first()?.clone();
        for picture in &pictures[1..] {
            if !picture.is_like(&mean) {
                return None;
            }
            mean.codes.iter_mut().zip(&picture.codes).for_each(|(sum, code)| *sum += code);
        }
        let share = 1.0 / pictures.len() as f32;
        mean.codes.iter_mut().for_each(|code| *code *= share);
        Some(mean)
    }
}
