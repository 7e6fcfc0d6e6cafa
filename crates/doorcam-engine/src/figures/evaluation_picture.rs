use doorcam_core::geometry::{Doorway, Room};

use crate::evaluation::{CrossingScore, PersonPath, TrackPath};

/// What the picture shows. Positions in metres in the door frame, times in seconds.
#[derive(Debug, Clone, Copy)]
pub struct EvaluationPicture<'a> {
    /// The doorway.
    pub doorway: &'a Doorway,
    /// The hidden room.
    pub room: &'a Room,
    /// True paths, one for each visit of a person to the room.
    pub people: &'a [PersonPath],
    /// Estimated paths, one per track; detections are points without a path.
    pub tracks: &'a [TrackPath],
    /// Crossings of the threshold, true and reported.
    pub crossings: &'a [CrossingScore],
    /// Text below, wrapped to the width.
    pub caption: &'a str,
}
