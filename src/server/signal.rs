use axum::Json;
use axum::extract::State;
use serde::Serialize;

use super::Shared;
use crate::measurement;

/// GET /api/v1/signal: how far the newest update's change stands out of the camera's noise.
#[derive(Serialize)]
pub(super) struct Signal {
    /// The update that it is of; none before the first.
    sequence: Option<u64>,
    left: Option<Side>,
    right: Option<Side>,
}

/// One patch; none while the noise is not known.
#[derive(Serialize)]
struct Side {
    /// Signal to noise per pixel and colour, in decibels; none if nothing but noise is there.
    snr_db: Option<f64>,
    /// The change, and the noise of one pixel, as shares of the floor's light.
    change: f64,
    noise: f64,
}

pub(super) async fn signal(State(shared): State<Shared>) -> Json<Signal> {
    let latest = shared.hub.latest();
    let known = latest.as_ref().and_then(|latest| Some((latest.difference.as_ref()?, latest.sensing.as_ref()?)));
    let [left, right] = match known {
        Some((difference, sensing)) => measurement::Signal::of(difference, sensing).map(|signal| signal.map(side)),
        None => [None, None],
    };
    Json(Signal { sequence: latest.map(|latest| latest.update.sequence), left, right })
}

fn side(measurement::Signal { snr, change, noise }: measurement::Signal) -> Side {
    Side { snr_db: (snr > 0.0).then(|| 10.0 * snr.log10()), change, noise }
}
