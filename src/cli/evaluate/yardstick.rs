//! How well the people found could have been located at best.

use std::sync::Arc;

use doorcam_core::bound::RoomBound;
use doorcam_core::geometry::Point;
use doorcam_core::light::Sensing;
use doorcam_engine::evaluation::Estimate;
use doorcam_engine::{Model, Published};

/// The bound for the background in use, computed again when that changes.
#[derive(Default)]
pub(super) struct Yardstick(Option<(Arc<Sensing>, RoomBound)>);

impl Yardstick {
    /// The bound for one update; none with the published model.
    pub(super) fn of(&mut self, model: &Model, published: &Published) -> Option<&RoomBound> {
        let sensing = published.sensing.as_ref()?;
        if !self.0.as_ref().is_some_and(|(of, _)| Arc::ptr_eq(of, sensing)) {
            let bound = RoomBound::new(&model.doorway, &model.patch, model.body_radius_m, sensing);
            self.0 = Some((Arc::clone(sensing), bound));
        }
        self.0.as_ref().map(|(_, bound)| bound)
    }
}

/// The least error (m) for somebody at `place` with the brightness of the track or detection they were found as.
pub(super) fn bound_m(
    bound: Option<&RoomBound>,
    published: &Published,
    place: Point,
    estimate: &Estimate,
) -> Option<f64> {
    let rgb = match estimate.id {
        Some(id) => published.update.tracks.iter().find(|track| track.id == id)?.rgb,
        None => published.detections.iter().find(|detection| detection.position == estimate.position)?.rgb,
    };
    let [[xx, _], [_, yy]] = bound?.covariance(place, rgb)?;
    Some((xx + yy).sqrt())
}
