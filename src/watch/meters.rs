//! The metrics served at `/metrics` for Prometheus.

use std::sync::{Mutex, PoisonError};

use jiff::Timestamp;
use metrics::{
    Counter, Gauge, Histogram, counter, describe_counter, describe_gauge, describe_histogram, gauge, histogram,
};

use doorcam_core::tracking::Direction;
use doorcam_engine::{SolutionReport, Timing, Update};
use doorcam_source::SourceState;

/// Handles to the metrics, created once so that counting a frame needs no lookup.
pub(super) struct Meters {
    pub(super) captured: Counter,
    pub(super) solved: Counter,
    pub(super) dropped: Counter,
    pub(super) lost: Counter,
    pub(super) skipped: Counter,
    pub(super) failed: Counter,
    source: Vec<(SourceState, Gauge)>,
    stages: [Histogram; 7],
    background_age: Gauge,
    gap: Gauge,
    crossings: [(Direction, Counter); 3],
    /// Share of each patch that is used, left and right.
    used: [Gauge; 2],
    shift: Gauge,
    moved: Counter,
    /// When the last motion of the camera was noticed that has been counted.
    counted: Mutex<Option<Timestamp>>,
}

const SOURCE_STATES: [(SourceState, &str); 7] = [
    (SourceState::Opening, "opening"),
    (SourceState::Streaming, "streaming"),
    (SourceState::Stalled, "stalled"),
    (SourceState::Lost, "lost"),
    (SourceState::BackingOff, "backing-off"),
    (SourceState::Ended, "ended"),
    (SourceState::Failed, "failed"),
];

const STAGES: [&str; 7] = ["decode", "rectify", "background", "project", "solve", "track", "total"];

impl Meters {
    /// Registers the metrics with the installed recorder; without one they do nothing.
    pub(super) fn new() -> Self {
        describe_counter!("doorcam_frames_captured_total", "Frames that the source delivered");
        describe_counter!("doorcam_frames_solved_total", "Frames that were turned into updates");
        describe_counter!("doorcam_frames_dropped_total", "Frames that a newer one replaced before they were solved");
        describe_counter!("doorcam_frames_lost_total", "Frames that the camera numbered but that never arrived");
        describe_counter!("doorcam_frames_skipped_total", "Frames that were missing or broken");
        describe_counter!("doorcam_frames_failed_total", "Frames that were lost to an internal error");
        describe_gauge!("doorcam_source_state", "1 for the current state of the source");
        describe_histogram!("doorcam_stage_seconds", "Time that each stage took for a frame");
        describe_gauge!(
            "doorcam_background_age_seconds",
            "Time since the empty room was learned; NaN while it is being learned"
        );
        describe_gauge!("doorcam_solution_gap", "Relative gap between the newest map's objective and its lower bound");
        describe_counter!("doorcam_crossings_total", "People who walked through the doorway since the start");
        describe_gauge!("doorcam_view_used", "Share of each patch's pixels that show the floor and are used");
        describe_gauge!(
            "doorcam_camera_shift_px",
            "How far the camera has moved from the calibration in use, in pixels; 0 if it has not"
        );
        describe_counter!("doorcam_camera_moved_total", "How often the camera was noticed to have moved");
        describe_gauge!("doorcam_clients", "Clients of the live socket");
        let meters = Self {
            captured: counter!("doorcam_frames_captured_total"),
            solved: counter!("doorcam_frames_solved_total"),
            dropped: counter!("doorcam_frames_dropped_total"),
            lost: counter!("doorcam_frames_lost_total"),
            skipped: counter!("doorcam_frames_skipped_total"),
            failed: counter!("doorcam_frames_failed_total"),
            source: SOURCE_STATES.map(|(state, name)| (state, gauge!("doorcam_source_state", "state" => name))).into(),
            stages: STAGES.map(|stage| histogram!("doorcam_stage_seconds", "stage" => stage)),
            background_age: gauge!("doorcam_background_age_seconds"),
            gap: gauge!("doorcam_solution_gap"),
            crossings: Direction::ALL.map(|way| (way, counter!("doorcam_crossings_total", "direction" => way.name()))),
            used: ["left", "right"].map(|patch| gauge!("doorcam_view_used", "patch" => patch)),
            shift: gauge!("doorcam_camera_shift_px"),
            moved: counter!("doorcam_camera_moved_total"),
            counted: Mutex::default(),
        };
        // A counter that has never been incremented should be reported as 0, not be absent.
        let Self { captured, solved, dropped, lost, skipped, failed, moved, .. } = &meters;
        let frames = [captured, solved, dropped, lost, skipped, failed, moved];
        for counter in frames.into_iter().chain(meters.crossings.iter().map(|(_, counter)| counter)) {
            counter.increment(0);
        }
        meters.source_is(SourceState::Opening);
        meters
    }

    pub(super) fn source_is(&self, now: SourceState) {
        self.source.iter().for_each(|(state, gauge)| gauge.set(f64::from(*state == now)));
    }

    /// Counts somebody who walked through the doorway.
    pub(super) fn crossed(&self, direction: Direction) {
        self.crossings.iter().filter(|(way, _)| *way == direction).for_each(|(_, counter)| counter.increment(1));
    }

    /// Records an update and the time that each of its stages took.
    pub(super) fn publish(&self, update: &Update) {
        self.solved.increment(1);
        let Timing { decode, rectify, background, project, solve, track, total } = update.timing_ms;
        for (histogram, ms) in self.stages.iter().zip([decode, rectify, background, project, solve, track, total]) {
            histogram.record(ms / 1e3);
        }
        self.background_age.set(update.background.and_then(|background| background.age_s).unwrap_or(f64::NAN));
        let [left, right] = &self.used;
        left.set(update.view.left.used);
        right.set(update.view.right.used);
        let moved = update.camera_moved;
        self.shift.set(moved.filter(|moved| !moved.corrected).map_or(0.0, |moved| moved.shift_px.unwrap_or(f64::NAN)));
        let mut counted = self.counted.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(moved) = moved.filter(|moved| Some(moved.since) != *counted) {
            *counted = Some(moved.since);
            self.moved.increment(1);
        }
        drop(counted);
        let SolutionReport { objective, bound, .. } = update.solution;
        self.gap.set(if objective > 0.0 { (objective - bound) / objective } else { 0.0 });
    }
}
