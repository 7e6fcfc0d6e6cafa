use axum::Json;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::Shared;
use super::answers::ROOM;
use doorcam_core::light;

/// How far the change in the newest update stands out from the camera's noise.
#[derive(Serialize, ToSchema)]
pub(super) struct Signal {
    /// Number of the update; null before the first.
    #[schema(required)]
    sequence: Option<u64>,
    /// The left patch; null while the noise is not known.
    #[schema(required)]
    left: Option<Side>,
    /// The right patch, likewise.
    #[schema(required)]
    right: Option<Side>,
}

/// Signal and noise of one patch.
#[derive(Serialize, ToSchema)]
#[schema(as = PatchSignal)]
struct Side {
    /// Signal to noise ratio per pixel and colour, in decibels; null if there is nothing but noise.
    #[schema(required)]
    snr_db: Option<f64>,
    /// Root mean square of the change without the noise, as a share of the floor's light.
    change: f64,
    /// Standard deviation of the noise of one pixel, as the same share.
    noise: f64,
}

/// How far the change in the newest update stands out from the camera's noise.
#[utoipa::path(
    get, path = "/signal", tag = ROOM,
    responses((status = 200, description = "The signal", body = Signal))
)]
pub(super) async fn signal(State(shared): State<Shared>) -> Json<Signal> {
    let latest = shared.hub.latest();
    let known = latest.as_ref().and_then(|latest| Some((latest.difference.as_ref()?, latest.sensing.as_ref()?)));
    let [left, right] = match known {
        Some((difference, sensing)) => light::Signal::of(difference, sensing).map(|signal| signal.map(side)),
        None => [None, None],
    };
    Json(Signal { sequence: latest.map(|latest| latest.update.sequence), left, right })
}

fn side(light::Signal { snr, change, noise }: light::Signal) -> Side {
    Side { snr_db: (snr > 0.0).then(|| 10.0 * snr.log10()), change, noise }
}
