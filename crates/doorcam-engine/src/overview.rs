use doorcam_core::alignment::Overview;
use doorcam_source::image::ImageDecoder;
use doorcam_source::{RawFrame, RawImages};

/// Makes small grey pictures of whole frames. [`FrameReader`](crate::FrameReader) only decodes what the patches need.
#[derive(Debug, Clone, Default)]
pub(crate) struct OverviewReader {
    decoder: ImageDecoder,
}

impl OverviewReader {
    /// Reads a frame of images with `size` (width, height) into `picture`. Returns false if it is damaged, has another
    /// size or is no camera's.
    pub fn read(&mut self, frame: &RawFrame, size: [usize; 2], picture: &mut Overview) -> bool {
        let image = match &frame.images {
            RawImages::Camera(bytes) => self.decoder.decode(bytes, Some((size[0], size[1]))),
            RawImages::Sensor(format, bytes) => self.decoder.decode_sensor(format, bytes, 0..format.height),
            RawImages::Patches(_) => return false,
        };
        match image {
            Ok(image) if [image.width, image.height] == size => {
                picture.reduce(image);
                true
            }
            _ => false,
        }
    }
}
