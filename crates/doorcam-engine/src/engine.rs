use std::sync::Arc;
use std::time::{Duration, Instant};

use jiff::Timestamp;

use crate::alignment::{Alignment, Followed};
use crate::assembly::{BackgroundPlan, Parts, Sight};
use crate::background::{FrameLight, Job, Keeper, KeeperError, Spaced, Work};
use crate::people::{People, Threshold};
use crate::put_down::PutDown;
use crate::validity::Validity;
use crate::visible_side::VisibleSide;
use crate::{FrameReader, ReadTimes, Reconstruction, Reconstructor, State, Timing, Update, ViewReport, ViewState};
use crate::{Published, Watched};
use doorcam_core::alignment::Overview;
use doorcam_core::calibration::Calibration;
use doorcam_core::light::{Averager, PatchPair};
use doorcam_core::scene::Brightness;
use doorcam_core::solver::{Audit, ModelKind};
use doorcam_core::tracking::{Detection, TrackState, Zone};
use doorcam_source::{Purpose, RawFrame, SkippedFrame};

/// Turns frames into updates, from encoded images to tracks. The same code runs online and offline.
pub struct Engine {
    /// What it was built from, kept for [`Self::rebuild`].
    parts: Parts,
    reader: FrameReader,
    averager: Averager,
    reconstructor: Reconstructor,
    /// `None` if people are not tracked.
    people: Option<People>,
    /// Computes what finding people needs, until it is done or the engine is replaced.
    _bodies: Option<Job<()>>,
    /// `None` if the background is fixed to a recording's frames of the empty room.
    keeper: Option<Keeper>,
    /// The camera's own side; in words why not, if it is not looked at.
    visible: Result<VisibleSide, String>,
    validity: Validity,
    /// What was put down on the patches. `None` if the background is not fixed: it learns that.
    put_down: Option<PutDown>,
    /// The recording's frames of the empty room.
    given: Spaced,
    pair: PatchPair,
    /// `None` if the frames are rectified patches.
    alignment: Option<Alignment>,
    /// What is being set up for a calibration that is to follow the camera.
    moving: Option<(Job<Option<Sight>>, Followed)>,
    /// A calibration that followed the camera, until it is taken.
    followed: Option<Calibration>,
    sequence: u64,
    /// Set by the first map. From then on frames of the empty room are reconstructed instead of learned from, so that a
    /// looped recording shows them as empty.
    watching: bool,
}

/// Why a frame yielded no update.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StepError {
    /// This frame is unusable; the next one may be fine.
    #[error(transparent)]
    Skipped(#[from] SkippedFrame),
    /// There is nothing to compare frames with.
    #[error("no frame of the empty room could be read (recording.json: background_frames), so there is no background")]
    NoBackground,
}

impl Engine {
    /// Builds an engine that has learned nothing yet, except for a stored background.
    pub(crate) fn assemble(parts: Parts) -> Self {
        let settings = parts.plan.settings();
        let reader = parts.reader.clone();
        let averager = Averager::new(settings.averaging.mode, settings.averaging.time_s, reader.patch().size);
        let mut reconstructor = parts.reconstructor();
        let people = parts.people();
        let mut bodies = None;
        let keeper = match parts.background() {
            BackgroundPlan::Given => None,
            BackgroundPlan::Rolling(work) => {
                if work == Work::Aside && people.is_some() && parts.model.kind == ModelKind::Signed {
                    // Finding people needs this. Compute it while the empty room is being learned; an earlier user
                    // waits for it.
                    let model = Arc::clone(&parts.model);
                    bodies = Some(Job::in_turn(work, "bodies", move || {
                        model.bodies();
                    }));
                }
                let store = parts.store(&format!("{:?}", averager.kind()));
                Some(Keeper::new(&settings.background, store, work, averager.independent_s(), &mut reconstructor))
            }
        };
        let visible = parts.visible_side();
        Self {
            validity: Validity::new(&parts.model.counted),
            put_down: keeper.is_none().then(|| PutDown::new(reader.patch().size)),
            visible,
            given: Spaced::new(averager.independent_s()),
            pair: PatchPair::zeros(reader.patch().size),
            sequence: 0,
            watching: keeper.as_ref().is_some_and(|keeper| !keeper.wants_given()),
            reader,
            averager,
            reconstructor,
            people,
            _bodies: bodies,
            keeper,
            alignment: parts.alignment(),
            moving: None,
            followed: None,
            parts,
        }
    }

    /// What its updates describe.
    pub fn watched(&self) -> Watched {
        Watched {
            model: Arc::clone(self.reconstructor.model()),
            calibration: self.parts.calibration(),
            no_crossings: self.visible.as_ref().err().cloned(),
        }
    }

    /// Sets the first track id and event number.
    pub fn count_from(&mut self, track: u64, event: u64) {
        self.parts.plan = self.parts.plan.clone().counting_from(track, event);
        self.people = self.people.take().map(|people| people.counting_from(track, event));
    }

    /// Replaces another engine and continues its numbering of updates, tracks and events.
    pub fn continue_from(&mut self, mut other: Self) {
        self.sequence = other.sequence;
        if let (Some(people), Some(others)) = (&mut self.people, other.people.take()) {
            people.continue_from(others);
        }
    }

    /// Rebuilds everything from the engine's parts, after a panic that may have left it in a half-finished state. The
    /// background and all numbering continue; people who were tracked start new tracks.
    pub fn rebuild(&mut self) {
        let mut broken = std::mem::replace(self, Self::assemble(self.parts.clone()));
        if let (Some(keeper), Some(before)) = (&mut self.keeper, broken.keeper.take()) {
            keeper.resume(before, &mut self.reconstructor);
        }
        if self.keeper.as_ref().is_none_or(Keeper::wants_given) {
            self.reconstructor.restore_background(broken.reconstructor.take_background());
        }
        self.watching = broken.watching;
        (self.alignment, self.followed) = (broken.alignment.take(), broken.followed.take());
        self.continue_from(broken);
    }

    /// Counts people in other zones from now on.
    pub fn use_zones(&mut self, zones: Vec<Zone>) {
        if let Some(people) = &mut self.people {
            people.use_zones(zones);
        }
    }

    /// Learns the background again from the next frames, with whatever is in the room then. A fixed one stays.
    pub fn reset_background(&mut self) {
        if let Some(keeper) = &mut self.keeper {
            self.averager.restart();
            keeper.reset(&self.reconstructor);
            self.watching = true;
        }
    }

    /// Saves the background if a file was given for it, and waits until it is saved. Dropping the engine does the same.
    pub fn save_background(&mut self) {
        if let Some(keeper) = &mut self.keeper {
            keeper.save(&self.reconstructor);
        }
    }

    /// Number of frames whose JPEGs were whole but lacked their end markers. They are used.
    pub fn without_end_marker(&self) -> u64 {
        self.reader.without_end()
    }

    /// Compares the last frame's solution with those from `starts` random starts; `None` before the first solution.
    pub fn audit(&self, starts: usize) -> Option<Audit> {
        self.reconstructor.audit(starts)
    }

    /// Processes one frame, captured at `time`. Learns from frames of the empty room until the first one after them,
    /// and reconstructs from then on.
    ///
    /// # Errors
    /// If the frame is unusable, or there is no background to compare it with.
    pub fn step(&mut self, frame: &RawFrame, time: Timestamp) -> Result<Published, StepError> {
        let start = Instant::now();
        self.parts.plan.meet(frame);
        self.take_sight();
        let looked = self.visible.as_ref().is_ok_and(|visible| visible.is_due(frame.seconds));
        let aligns = self.moving.is_none()
            && self.alignment.as_ref().is_some_and(|alignment| alignment.is_due(frame.seconds, looked));
        let decode = self.reader.decode(frame, looked || aligns)?;
        if aligns {
            self.look_around(frame, time);
        }
        let off = self.alignment.as_ref().is_some_and(Alignment::is_off);
        let thumbnail = self.visible.as_mut().ok().filter(|_| looked).map(VisibleSide::picture);
        let rest = self.reader.rectify(frame, &mut self.pair, thumbnail)?;
        let read = ReadTimes { decode: decode + rest.decode, ..rest };
        let model = self.reconstructor.model().clone();
        let view = self.judge_view(frame, looked);
        let (pair, excess) = self.averager.push(&self.pair, frame.seconds);
        let map = if off {
            None
        } else if !self.watching && is_given(frame.purpose, self.keeper.is_some()) {
            if frame.purpose == Purpose::Background {
                self.given.offer(pair, frame.seconds, &mut self.reconstructor);
            }
            None
        } else {
            self.given.finish(&mut self.reconstructor);
            match &mut self.keeper {
                None => {
                    let map = self.reconstructor.reconstruct_in_noise(pair, excess);
                    let map = map.map_err(|e| KeeperError::from(e).of(&frame.name))?;
                    Some(map.ok_or(StepError::NoBackground)?)
                }
                Some(keeper) => {
                    let (seconds, purpose) = (frame.seconds, frame.purpose);
                    let usable = (!self.validity.is_clear()).then(|| self.validity.usable());
                    let busy = self.visible.as_ref().is_ok_and(|visible| visible.is_busy(seconds));
                    let seen = FrameLight { raw: &self.pair, pair, excess, seconds, purpose, usable, busy };
                    let map = keeper.step(&seen, &mut self.reconstructor).map_err(|e| e.of(&frame.name))?;
                    if let (Some(pixels), Ok(visible)) = (keeper.take_uncovered(), &mut self.visible) {
                        visible.accept(&pixels);
                    }
                    map
                }
            }
        };
        self.watching |= map.is_some();
        let (mut update, scene) = match map {
            None => (Update::learning(&model, self.sequence, time, frame.index, timing(read, None, start)), None),
            Some(mut map) => {
                let timing = timing(read, Some(&map), start);
                let update = Update::watching(&model, self.sequence, time, frame.index, &map, timing);
                // The update reports the refit's factors separately; the published scene has them multiplied in.
                if model.brightness == Brightness::Measured {
                    map.scene.multiply(&map.refit);
                }
                (update, Some(map.scene))
            }
        };
        update.calibration = self.parts.calibration();
        update.view = view;
        if let Some(keeper) = &self.keeper {
            update.state = keeper.state();
            update.background = Some(keeper.report());
        }
        let obstructed = [view.left, view.right].iter().all(|view| view.state == ViewState::Blocked);
        if obstructed && update.state == State::Watching {
            update.state = State::Obstructed;
        }
        if [view.left, view.right].iter().any(|view| view.state == ViewState::Blocked) {
            update.facets.clear();
        }
        if off {
            update.state = State::Misaligned;
        }
        let detections = self.follow(frame.seconds, looked, &mut update);
        let reference = self.tell_alignment(frame, &mut update);
        update.timing_ms.total = ms(start.elapsed());
        self.sequence += 1;
        let difference = scene.is_some().then(|| self.reconstructor.difference().clone());
        let sensing = scene.is_some().then(|| self.reconstructor.sensing().cloned()).flatten();
        let still = scene.is_some().then(|| self.reconstructor.still().cloned()).flatten();
        let patches = Some(self.pair.clone());
        Ok(Published { patches, detections, sensing, still, reference, ..Published::new(update, scene, difference) })
    }

    /// Looks at the whole picture that was decoded, whether the camera has moved. If the calibration may follow it,
    /// what depends on that is set up beside the frames; until then there is no map.
    fn look_around(&mut self, frame: &RawFrame, time: Timestamp) {
        let Some(alignment) = &mut self.alignment else { return };
        if let Some(followed) = alignment.look(self.reader.decoded(), frame.seconds, time) {
            let work = self.parts.work();
            let sight = Job::start(work, "follow", self.parts.sight(&followed.calibration));
            self.moving = Some((sight, followed));
            if work == Work::InPlace {
                self.take_sight();
            }
        }
    }

    /// Uses a calibration that follows the camera, as soon as all that depends on it is set up.
    fn take_sight(&mut self) {
        let Some((job, followed)) = self.moving.take() else { return };
        let sight = match job.poll() {
            Ok(sight) => sight.flatten(),
            Err(running) => {
                self.moving = Some((running, followed));
                return;
            }
        };
        let Some(alignment) = &mut self.alignment else { return };
        let Some(Sight { mut reader, visible }) = sight else {
            alignment.refuse(&followed);
            return;
        };
        self.parts.follow(followed.calibration.clone(), reader.clone());
        reader.continue_from(&mut self.reader);
        self.reader = reader;
        self.averager.restart();
        self.visible = visible;
        alignment.use_followed(&followed);
        self.followed = Some(followed.calibration);
    }

    /// Tells the watch over the camera what came of the frame, and the update how the camera has moved.
    fn tell_alignment(&mut self, frame: &RawFrame, update: &mut Update) -> Option<Arc<Overview>> {
        let alignment = self.alignment.as_mut()?;
        let alone = self.visible.as_ref().map_or(true, |visible| !visible.is_doubtful(frame.seconds));
        let watching = alone && update.state == State::Watching;
        let empty = watching && update.facets.is_empty() && update.tracks.is_empty();
        let newcomer = update.tracks.iter().any(|track| track.state == TrackState::Tentative);
        alignment.room_is(frame.purpose, empty, newcomer);
        update.camera_moved = alignment.moved();
        if alignment.take_news()
            && let Some(people) = &mut self.people
        {
            update.events.push(people.camera_moved(update.time));
        }
        alignment.reference()
    }

    /// The calibration that has followed the camera since this was last asked; none if it has not moved.
    pub fn take_followed(&mut self) -> Option<Calibration> {
        self.followed.take()
    }

    /// Sets the calibration's revision, which updates carry.
    pub fn revise(&mut self, revision: u32) {
        self.parts.plan = self.parts.plan.clone().of_calibration(revision);
    }

    /// Looks at the camera's own side, and judges which pixels of the patches can be used.
    fn judge_view(&mut self, frame: &RawFrame, looked: bool) -> ViewReport {
        let learning = !self.watching && is_given(frame.purpose, self.keeper.is_some());
        self.validity.restart();
        if !learning && let Some(empty) = self.reconstructor.empty() {
            self.validity.judge(&self.pair, empty);
        }
        if let Ok(visible) = &mut self.visible {
            if looked {
                visible.look(frame.seconds, learning);
            }
            if visible.is_someone_there() {
                visible.mask(self.validity.usable_mut());
            } else {
                self.validity.allow_for_light();
            }
            if self.validity.has_changed() || self.keeper.as_ref().is_some_and(Keeper::awaits_shade) {
                visible.disturb(frame.seconds);
            }
        } else {
            self.validity.allow_for_light();
        }
        let calm = self.visible.as_ref().map_or(true, |visible| !visible.is_busy(frame.seconds));
        if !learning
            && let Some(put_down) = &mut self.put_down
            && let Some(reference) = self.reconstructor.reference_mut()
        {
            let (usable, counted) = (self.validity.usable(), self.validity.counted());
            put_down.see(frame.seconds, &self.pair, usable, counted, calm, reference);
        }
        let (view, used) = self.validity.report();
        self.reconstructor.use_only(self.validity.usable(), used);
        view
    }

    /// Tracks people on the current map. Tracking pauses while there is no map of the present.
    fn follow(&mut self, seconds: f64, looked: bool, update: &mut Update) -> Vec<Detection> {
        let Some(people) = &mut self.people else { return Vec::new() };
        let start = Instant::now();
        let (detections, report) = if matches!(update.state, State::Watching | State::Obstructed) {
            let elapsed_s = people.elapsed_s(seconds);
            let mut detections = match update.state {
                State::Watching => self.reconstructor.find(people.predictions(seconds), elapsed_s).to_vec(),
                _ => Vec::new(),
            };
            let unsure = self.keeper.as_ref().map_or(1.0, Keeper::unsure);
            let wider = |row: [f64; 2]| row.map(|v| unsure * unsure * v);
            detections.iter_mut().for_each(|d| d.covariance = d.covariance.map(wider));
            let report = match &mut self.visible {
                Err(_) => people.step(seconds, update.time, &detections),
                Ok(visible) => {
                    // Nobody is on the threshold without being in the picture.
                    detections.retain(|detection| !visible.is_absent(detection.position));
                    let told = self.parts.plan.settings().crossings;
                    let crossings = if told { visible.take_crossings() } else { Vec::new() };
                    let busy = visible.is_doubtful(seconds);
                    let beside = Threshold { walkers: visible.walkers(), crossings: &crossings, busy, looked };
                    people.step_beside(seconds, update.time, &detections, beside)
                }
            };
            (detections, report)
        } else {
            let report = match &mut self.visible {
                Ok(visible) if self.parts.plan.settings().crossings && update.state != State::Misaligned => {
                    let crossings = visible.take_crossings();
                    let walkers = visible.walkers();
                    let beside = Threshold { walkers, crossings: &crossings, busy: true, looked };
                    people.pause_beside(seconds, update.time, beside)
                }
                _ => people.pause(update.time),
            };
            (Vec::new(), report)
        };
        (update.tracks, update.events, update.zones) = (report.tracks, report.events, report.zones);
        update.timing_ms.track = ms(start.elapsed());
        detections
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        self.save_background();
    }
}

/// Whether a frame belongs to the initial part of a recording, up to its frames of the empty room. With a fixed
/// background that is every frame not marked to be watched.
fn is_given(purpose: Purpose, rolling: bool) -> bool {
    match purpose {
        Purpose::Before | Purpose::Background => true,
        Purpose::Live => !rolling,
        Purpose::Watch => false,
    }
}

fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

fn timing(read: ReadTimes, solved: Option<&Reconstruction>, start: Instant) -> Timing {
    Timing {
        decode: ms(read.decode),
        rectify: ms(read.rectify),
        background: solved.map_or(0.0, |r| ms(r.background_time)),
        project: solved.map_or(0.0, |r| ms(r.project_time)),
        solve: solved.map_or(0.0, |r| ms(r.solve_time)),
        track: 0.0,
        total: ms(start.elapsed()),
    }
}

#[cfg(test)]
#[path = "engine_tests.rs"]
mod tests;
