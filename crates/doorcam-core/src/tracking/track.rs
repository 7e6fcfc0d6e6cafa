use serde::Serialize;

use crate::scene::Rgb;

/// A symmetric 2 x 2 matrix [[xx, xy], [xy, yy]].
pub type Covariance = [[f64; 2]; 2];

/// How sure a track is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum TrackState {
    /// It may be a false alarm yet.
    Tentative,
    /// Somebody is there.
    Confirmed,
    /// Somebody was there; the last frames show nobody, and this is where they are expected to be.
    Coasting,
}

/// A tracked person, as updates report it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Track {
    /// Never used again for anybody else, in no other run either where those are kept.
    pub id: u64,
    /// How sure it is.
    pub state: TrackState,
    /// The body's axis, in metres in the door frame.
    pub x_m: f64,
    /// The same, into the room.
    pub y_m: f64,
    /// Velocity, in metres a second.
    pub vx_m_s: f64,
    /// The same, into the room.
    pub vy_m_s: f64,
    /// Covariance of the position, in m².
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Covariance))]
    pub covariance_m2: Covariance,
    /// Radiance against what is behind, relative to full scale; negative where the body is darker.
    #[cfg_attr(feature = "schema", schema(value_type = crate::schema::Rgb))]
    pub rgb: Rgb,
    /// Seconds since it was first seen.
    pub age_s: f64,
}
