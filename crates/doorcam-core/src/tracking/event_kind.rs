use serde::{Deserialize, Serialize};

/// Which way somebody went through the doorway.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// From the visible side into the hidden room.
    In,
    /// Out of the hidden room.
    Out,
    /// To the threshold and back to where they came from.
    Back,
}

impl Direction {
    /// Every direction.
    pub const ALL: [Self; 3] = [Self::In, Self::Out, Self::Back];

    /// The name used in JSON and elsewhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::In => "in",
            Self::Out => "out",
            Self::Back => "back",
        }
    }

    /// The event that tells such a crossing.
    pub fn kind(self) -> EventKind {
        match self {
            Self::In => EventKind::CrossIn,
            Self::Out => EventKind::CrossOut,
            Self::Back => EventKind::CrossBack,
        }
    }
}

/// What a person who leaves goes through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Through {
    /// The doorway that is watched.
    Door,
}

impl Through {
    /// The name used in JSON and elsewhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Door => "door",
        }
    }
}

/// Why a track ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum ExitReason {
    /// Seen to leave through the watched doorway.
    Door,
    /// Lost at a wall of the room, where another entrance may be.
    Entrance,
    /// Lost inside the room, or no longer watched.
    Unseen,
    /// Found to be the same person as another track.
    Merged,
}

impl ExitReason {
    /// Every reason.
    pub const ALL: [Self; 4] = [Self::Door, Self::Entrance, Self::Unseen, Self::Merged];

    /// The name used in JSON and elsewhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Door => "door",
            Self::Entrance => "entrance",
            Self::Unseen => "unseen",
            Self::Merged => "merged",
        }
    }
}

/// Kind of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// Somebody is there. Reported when the track is confirmed, with time and place of its first detection.
    Enter,
    /// The track ended. Reported with time and place of its last detection.
    Exit,
    /// Somebody has stayed in one place for a while.
    Dwell,
    /// Somebody entered a zone.
    ZoneEnter,
    /// Somebody left a zone, or was last seen in it.
    ZoneExit,
    /// Somebody came into the room through the doorway. The time is when their body's axis passed y = 0.
    CrossIn,
    /// Somebody left the room through the doorway. The time is when their body's axis passed y = 0.
    CrossOut,
    /// Somebody came up to the threshold and turned around. The time is when their body's axis was nearest to y = 0.
    CrossBack,
    /// The camera has moved: the calibration follows it, or there is no map until it is back or calibrated anew. The one
    /// event that is of no person.
    CameraMoved,
}

impl EventKind {
    /// Every kind.
    pub const ALL: [Self; 9] = [
        Self::Enter,
        Self::Exit,
        Self::Dwell,
        Self::ZoneEnter,
        Self::ZoneExit,
        Self::CrossIn,
        Self::CrossOut,
        Self::CrossBack,
        Self::CameraMoved,
    ];

    /// The name used in JSON and elsewhere.
    pub fn name(self) -> &'static str {
        match self {
            Self::Enter => "enter",
            Self::Exit => "exit",
            Self::Dwell => "dwell",
            Self::ZoneEnter => "zone_enter",
            Self::ZoneExit => "zone_exit",
            Self::CrossIn => "cross_in",
            Self::CrossOut => "cross_out",
            Self::CrossBack => "cross_back",
            Self::CameraMoved => "camera_moved",
        }
    }

    /// Which way somebody crossed the threshold; none for other events.
    pub fn direction(self) -> Option<Direction> {
        match self {
            Self::CrossIn => Some(Direction::In),
            Self::CrossOut => Some(Direction::Out),
            Self::CrossBack => Some(Direction::Back),
            _ => None,
        }
    }
}
