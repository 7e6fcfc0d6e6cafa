use axum::Json;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::Shared;
use super::openapi::ROOM;
use doorcam_core::light;

/// How far the newest update's change stands out of the camera's noise.
#[derive(Serialize, ToSchema)]
pub(super) struct Signal {
    /// The update that it is of; none before the first.
    #[schema(required)]
    sequence: Option<u64>,
    /// The left patch; null while the noise is not known.
    #[schema(required)]
    left: Option<Side>,
    /// The right one.
    #[schema(required)]
    right: Option<Side>,
}

/// One patch.
#[derive(Serialize, ToSchema)]
#[schema(as = PatchSignal)]
struct Side {
    /// Signal to noise per pixel and colour, in decibels; none if nothing but noise is there.
    #[schema(required)]
    snr_db: Option<f64>,
    /// The change, as a share of the floor's light.
    change: f64,
    /// The noise of one pixel, likewise.
    noise: f64,
}

/// How far the newest update's change stands out of the camera's noise.
#[utoipa::path(get, path = "/signal", tag = ROOM, responses((status = 200, description = "The signal", body = Signal)))]
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
