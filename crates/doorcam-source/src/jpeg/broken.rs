use crate::image_error::ImageError;

/// What is wrong with a JPEG's data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Broken(pub &'static str);

impl From<Broken> for ImageError {
    fn from(Broken(reason): Broken) -> Self {
        ImageError::Jpeg(reason.into())
    }
}
