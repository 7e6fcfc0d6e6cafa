use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;

use doorcam_engine::figures::{self, ReconstructionPicture};
use doorcam_engine::{Model, Published};

/// Pictures of the newest update, drawn at the first request.
#[derive(Default)]
pub(super) struct Pictures {
    reconstruction: Drawn,
    difference: Drawn,
    patches: Drawn,
}

/// The last picture drawn, with the number of its update. The lock is held while drawing, so that simultaneous requests
/// share one drawing.
type Drawn = Mutex<Option<(u64, Bytes)>>;

/// Width of the figure, in pixels.
const WIDTH: u32 = 1600;
/// Side of a patch pixel, in pixels of the picture.
const PATCH_PIXEL: u32 = 4;

impl Pictures {
    /// The figure of an update; `None` without a map.
    pub(super) fn reconstruction(
        &self,
        model: &Model,
        of: &Arc<Published>,
    ) -> Option<Result<Bytes, figures::RenderError>> {
        let scene = of.scene.as_ref()?;
        Some(drawn(&self.reconstruction, of, || {
            let (update, shown) = (&of.update, model.brightness.words());
            let caption = format!("{}, λ = {:.4}, {shown}", update.time, update.solution.lambda);
            let svg =
                figures::reconstruction_svg(&ReconstructionPicture::of(model, scene, of.difference.as_ref(), &caption));
            figures::png(&svg, WIDTH)
        }))
    }

    /// The difference of an update, with magnified colours; `None` without a background.
    pub(super) fn difference(&self, of: &Arc<Published>) -> Option<Result<Bytes, figures::RenderError>> {
        let difference = of.difference.as_ref()?;
        Some(drawn(&self.difference, of, || figures::difference_png(difference, PATCH_PIXEL)))
    }

    /// The patches of an update as the camera sees them.
    pub(super) fn patches(&self, of: &Arc<Published>) -> Option<Result<Bytes, figures::RenderError>> {
        let patches = of.patches.as_ref()?;
        Some(drawn(&self.patches, of, || figures::patches_png(patches, PATCH_PIXEL)))
    }
}

fn drawn(
    cache: &Drawn,
    of: &Published,
    draw: impl FnOnce() -> Result<Vec<u8>, figures::RenderError>,
) -> Result<Bytes, figures::RenderError> {
    let mut cache = cache.lock().unwrap_or_else(PoisonError::into_inner);
    match &*cache {
        Some((sequence, bytes)) if *sequence == of.update.sequence => Ok(bytes.clone()),
        _ => {
            let bytes = Bytes::from(draw()?);
            *cache = Some((of.update.sequence, bytes.clone()));
            Ok(bytes)
        }
    }
}
