//! The figures of `/metrics`, in Prometheus' terms.

use metrics::{
    Counter, Gauge, Histogram, counter, describe_counter, describe_gauge, describe_histogram, gauge, histogram,
};

use doorcam_core::tracking::TrackState;
use doorcam_engine::{SolutionReport, State, Timing, Update};
use doorcam_source::SourceState;

/// Handles to the figures, made once: counting a frame looks nothing up.
pub(super) struct Meters {
    pub(super) captured: Counter,
    pub(super) solved: Counter,
    pub(super) dropped: Counter,
    pub(super) lost: Counter,
    pub(super) skipped: Counter,
    pub(super) failed: Counter,
    source: Vec<(SourceState, Gauge)>,
    watch: Vec<(State, Gauge)>,
    stages: [Histogram; 7],
    background_age: Gauge,
    gap: Gauge,
    people: Gauge,
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

const WATCH_STATES: [(State, &str); 3] =
    [(State::Learning, "learning"), (State::Watching, "watching"), (State::Relearning, "relearning")];

const STAGES: [&str; 7] = ["decode", "rectify", "background", "project", "solve", "track", "total"];

impl Meters {
    /// With the recorder that is installed, or none.
    pub(super) fn new() -> Self {
        describe_counter!("doorcam_frames_captured_total", "Frames that the source gave");
        describe_counter!("doorcam_frames_solved_total", "Frames that became updates");
        describe_counter!("doorcam_frames_dropped_total", "Frames that a newer one replaced");
        describe_counter!("doorcam_frames_lost_total", "Frames that the camera made and that never arrived");
        describe_counter!("doorcam_frames_skipped_total", "Frames that were missing or broken");
        describe_counter!("doorcam_frames_failed_total", "Frames that were lost to an internal error");
        describe_gauge!("doorcam_source_state", "1 for the state in which the source is");
        describe_gauge!("doorcam_state", "1 for the state of the newest update");
        describe_histogram!("doorcam_stage_seconds", "Time that a frame took in each stage");
        describe_gauge!(
            "doorcam_background_age_seconds",
            "Time since the empty room was learned; NaN while that goes on"
        );
        describe_gauge!("doorcam_solution_gap", "Share of the newest map's objective that is not proven to be needed");
        describe_gauge!("doorcam_clients", "Clients of the live socket");
        describe_gauge!("doorcam_people", "People who are followed, confirmed or coasting");
        let meters = Self {
            captured: counter!("doorcam_frames_captured_total"),
            solved: counter!("doorcam_frames_solved_total"),
            dropped: counter!("doorcam_frames_dropped_total"),
            lost: counter!("doorcam_frames_lost_total"),
            skipped: counter!("doorcam_frames_skipped_total"),
            failed: counter!("doorcam_frames_failed_total"),
            source: SOURCE_STATES.map(|(state, name)| (state, gauge!("doorcam_source_state", "state" => name))).into(),
            watch: WATCH_STATES.map(|(state, name)| (state, gauge!("doorcam_state", "state" => name))).into(),
            stages: STAGES.map(|stage| histogram!("doorcam_stage_seconds", "stage" => stage)),
            background_age: gauge!("doorcam_background_age_seconds"),
            gap: gauge!("doorcam_solution_gap"),
            people: gauge!("doorcam_people"),
        };
        // A counter that nobody has counted yet is 0, not absent.
        for counter in
            [&meters.captured, &meters.solved, &meters.dropped, &meters.lost, &meters.skipped, &meters.failed]
        {
            counter.increment(0);
        }
        meters.source_is(SourceState::Opening);
        meters.watch_is(State::Learning);
        meters
    }

    pub(super) fn source_is(&self, now: SourceState) {
        self.source.iter().for_each(|(state, gauge)| gauge.set(f64::from(*state == now)));
    }

    pub(super) fn watch_is(&self, now: State) {
        self.watch.iter().for_each(|(state, gauge)| gauge.set(f64::from(*state == now)));
    }

    /// Shows an update: its state, and how long its stages took.
    pub(super) fn publish(&self, update: &Update) {
        self.solved.increment(1);
        self.watch_is(update.state);
        let Timing { decode, rectify, background, project, solve, track, total } = update.timing_ms;
        for (histogram, ms) in self.stages.iter().zip([decode, rectify, background, project, solve, track, total]) {
            histogram.record(ms / 1e3);
        }
        self.background_age.set(update.background.and_then(|background| background.age_s).unwrap_or(f64::NAN));
        let SolutionReport { objective, bound, .. } = update.solution;
        self.gap.set(if objective > 0.0 { (objective - bound) / objective } else { 0.0 });
        let people = update.tracks.iter().filter(|track| track.state != TrackState::Tentative);
        self.people.set(people.count() as f64);
    }
}
