use serde::Serialize;

use crate::scene::Rgb;

/// Covariance of a position: a symmetric 2 x 2 matrix [[xx, xy], [xy, yy]], in m².
pub type Covariance = [[f64; 2]; 2];

/// How sure a track is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum TrackState {
    /// It may still be a false alarm.
    Tentative,
    /// Somebody is there.
    Confirmed,
    /// Somebody was there, but the last frames do not show them; the position is where they are expected to be.
    Coasting,
}

/// A tracked person, as updates report it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Track {
    /// Number of the track. It is never reused, not in later runs either if the history is kept.
    pub id: u64,
    /// How sure the track is.
    pub state: TrackState,
    /// Position of the body's axis to the right, in metres in the door frame.
    pub x_m: f64,
    /// Position of the body's axis into the hidden room, in metres in the door frame.
    pub y_m: f64,
    /// Velocity to the right, in metres per second.
    pub vx_m_s: f64,
    /// Velocity into the hidden room, in metres per second.
    pub vy_m_s: f64,
    /// Covariance of the position, in m².
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Covariance))]
    pub covariance_m2: Covariance,
    /// Radiance relative to what is behind the body, as a share of full scale; negative where the body is darker.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Rgb))]
    pub rgb: Rgb,
    /// Seconds since the first detection.
    pub age_s: f64,
}
