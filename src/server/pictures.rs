use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;

use crate::pipeline::{Model, Published};
use crate::render;

/// Pictures of the newest update, drawn when first asked for.
#[derive(Default)]
pub(super) struct Pictures {
    reconstruction: Drawn,
    difference: Drawn,
    patches: Drawn,
}

/// The last picture drawn and the update that it is of. The lock is held while drawing, so that many who ask at once wait
/// for one drawing.
type Drawn = Mutex<Option<(u64, Bytes)>>;

/// Width of the figure, in pixels.
const WIDTH: u32 = 1600;
/// Side of a patch pixel, in pixels.
const PATCH_PIXEL: u32 = 4;

impl Pictures {
    /// The figure of an update; none while there is no map.
    pub(super) fn reconstruction(
        &self,
        model: &Model,
        of: &Arc<Published>,
    ) -> Option<Result<Bytes, render::RenderError>> {
        let scene = of.scene.as_ref()?;
        Some(drawn(&self.reconstruction, of, || {
            let (update, shown) = (&of.update, model.brightness.words());
            let caption = format!("{}, λ = {:.4}, {shown}", update.time, update.solution.lambda);
            let svg = render::reconstruction_svg(&model.picture(scene, of.difference.as_ref(), &caption));
            render::png(&svg, WIDTH)
        }))
    }

    /// The magnified difference patches of an update; none while there is no background.
    pub(super) fn difference(&self, of: &Arc<Published>) -> Option<Result<Bytes, render::RenderError>> {
        let difference = of.difference.as_ref()?;
        Some(drawn(&self.difference, of, || render::difference_png(difference, PATCH_PIXEL)))
    }

    /// The patches of an update as the camera sees them.
    pub(super) fn patches(&self, of: &Arc<Published>) -> Option<Result<Bytes, render::RenderError>> {
        let patches = of.patches.as_ref()?;
        Some(drawn(&self.patches, of, || render::patches_png(patches, PATCH_PIXEL)))
    }
}

fn drawn(
    cache: &Drawn,
    of: &Published,
    draw: impl FnOnce() -> Result<Vec<u8>, render::RenderError>,
) -> Result<Bytes, render::RenderError> {
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
