//! Whether the camera still looks where the calibration says, and what to do if not.

mod store;

use std::path::PathBuf;
use std::sync::Arc;

use doorcam_core::alignment::{Match, Motion, Overview, Reference};
use doorcam_core::calibration::{Calibration, Overlay};
use doorcam_core::geometry::Point;
use doorcam_core::image::Image;
use doorcam_core::transport::PatchGrid;
use doorcam_source::Purpose;
use jiff::Timestamp;
use serde::Serialize;

use crate::background::Work;
use store::ReferenceStore;

/// How the camera has moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct CameraMoved {
    /// How far the picture has moved to the right at its middle, in pixels; null, as the next three, if it shows nothing
    /// of what it showed.
    #[cfg_attr(feature = "schema", schema(required))]
    pub dx_px: Option<f64>,
    /// How far it has moved down, in pixels.
    #[cfg_attr(feature = "schema", schema(required))]
    pub dy_px: Option<f64>,
    /// How far it has turned clockwise, in degrees.
    #[cfg_attr(feature = "schema", schema(required))]
    pub rotation_deg: Option<f64>,
    /// The farthest that any part of the patches has moved, in pixels.
    #[cfg_attr(feature = "schema", schema(required))]
    pub shift_px: Option<f64>,
    /// When that was noticed, RFC 3339.
    pub since: Timestamp,
    /// Whether the calibration has followed. If not, there is no map until the camera is back or calibrated anew.
    pub corrected: bool,
}

/// Compares the camera's picture with the one of the empty room, a few times a second.
pub(crate) struct Alignment {
    follow_px: f64,
    picture: Overview,
    /// The calibration of the reference's time.
    home: Calibration,
    /// Outlines of the patches in the reference: where it counts whether anything moved.
    outline: Vec<Point>,
    reference: Option<Reference>,
    shown: Option<Arc<Overview>>,
    store: Option<ReferenceStore>,
    /// Looks that may become the reference, and whether a recording says that they show the empty room.
    taken: Vec<Overview>,
    given: bool,
    /// How the calibration in use follows the camera since the reference was taken.
    used: Motion,
    /// Looks that agree on where the camera looks now, if not there.
    agreeing: Vec<Match>,
    /// Looks that agree that a camera which had moved is back.
    back: usize,
    /// Looks since the last of `agreeing` that said nothing.
    blank: usize,
    /// What the camera shows where it shows nothing of the reference, and how many looks in a row have shown it.
    elsewhere: Option<Reference>,
    strange: usize,
    standing: Standing,
    moved: Option<CameraMoved>,
    /// Whether that has not been told as an event yet.
    news: bool,
    looked_s: Option<f64>,
    /// Whether somebody new may be there.
    eager: bool,
    /// Whether `picture` has not been looked at by [`Self::room_is`] yet.
    fresh: bool,
}

/// Whether there may be a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Standing {
    Aligned,
    /// A look says that the camera has moved. It takes some more to be sure, but a map would show people who are not
    /// there at once.
    Suspect,
    Misaligned,
}

/// A calibration that has followed the camera.
pub(crate) struct Followed {
    pub calibration: Calibration,
    /// Says that it is not used after all.
    motion: Motion,
    moved: CameraMoved,
}

/// Seconds between looks, if the whole picture is decoded anyway and in any case: usually, and while somebody new may be
/// there, whom a camera that has moved may only feign.
const LOOK_S: [[f64; 2]; 2] = [[0.28, 0.38], [0.14, 0.19]];
/// A longer gap between frames means that they have begun again.
const GAP_S: f64 = 10.0;
/// Looks that must agree before anything is done.
const AGREEING: usize = 3;
/// Looks in a row without a result after which a suspicion is dropped.
const BLANK: usize = 10;
/// Motion that counts, in pixels: of the image, and of the overview where that is more, for light can make an edge seem to
/// move by a part of one.
const MOVED_PX: f64 = 1.0;
const MOVED_SMALL_PX: f64 = 0.45;
/// Looks at an empty and still room that make a reference.
const TAKEN: usize = 8;
/// A look differs from the one before by at most this, as the mean of any cell, in codes, while the room is still.
const STILL: f32 = 4.0;
/// Side of these cells, in pixels of the overview.
const STILL_CELL: usize = 16;
/// Support below which a look is strange, and above which two of them show the same.
const STRANGE: f64 = 0.25;
const STAYS: f64 = 0.6;
/// Strange looks in a row, about ten seconds, after which the camera was turned away.
const STRANGE_LOOKS: usize = 25;
/// Share of the overview's support that a motion needs to be followed, and its largest standard deviation in pixels.
const FOLLOW_SUPPORT: f64 = 0.4;
const FOLLOW_SD_PX: f64 = 0.6;

impl Alignment {
    /// For a camera with this complete calibration. `None` if it does not determine where the patches are.
    pub fn new(
        calibration: &Calibration,
        patch: &PatchGrid,
        follow_px: f64,
        store: Option<(PathBuf, Work)>,
    ) -> Option<Self> {
        let store = store.map(|(file, work)| ReferenceStore::new(file, work));
        let kept = store.as_ref().and_then(|store| store.load(calibration));
        let (reference, home, used) = match kept {
            Some((reference, home, used)) => (Some(reference), home, Some(used)),
            None => (None, calibration.clone(), None),
        };
        let overlay = Overlay::new(&home.camera().ok()?, home.size, &home.doorway, patch);
        let outline: Vec<Point> = overlay.patches.left.into_iter().chain(overlay.patches.right).collect();
        let shown = reference.as_ref().map(|reference| Arc::new(reference.overview().clone()));
        let centre = home.size.map(|n| (n as f64 - 1.0) / 2.0);
        Some(Self {
            follow_px,
            picture: Overview::default(),
            outline,
            reference,
            shown,
            store,
            taken: Vec::new(),
            given: false,
            used: used.unwrap_or(Motion::none(centre)),
            home,
            agreeing: Vec::new(),
            back: 0,
            blank: 0,
            elsewhere: None,
            strange: 0,
            standing: Standing::Aligned,
            moved: None,
            news: false,
            looked_s: None,
            eager: false,
            fresh: false,
        })
    }

    /// How the camera has moved, if it has.
    pub fn moved(&self) -> Option<CameraMoved> {
        self.moved
    }

    /// Whether it has moved, or moved again, since this was last asked.
    pub fn take_news(&mut self) -> bool {
        std::mem::take(&mut self.news)
    }

    /// The reference picture, once there is one.
    pub fn reference(&self) -> Option<Arc<Overview>> {
        self.shown.clone()
    }

    /// Whether a map would be wrong.
    pub fn is_off(&self) -> bool {
        self.standing != Standing::Aligned
    }

    /// Whether it is time for a look, which needs the whole picture. `whole`: it is decoded anyway.
    pub fn is_due(&self, seconds: f64, whole: bool) -> bool {
        let soon = self.eager || self.standing == Standing::Suspect;
        let [welcome, needed] = LOOK_S[usize::from(soon)];
        let least = if whole { welcome } else { needed };
        self.looked_s.is_none_or(|last| !(0.0..least).contains(&(seconds - last)))
    }

    /// Looks at a frame's whole picture. Returns a calibration that follows the camera, if it has moved by a little: to
    /// be used from this frame on ([`Self::use_followed`]), or refused ([`Self::refuse`]).
    pub fn look(&mut self, image: &Image, seconds: f64, time: Timestamp) -> Option<Followed> {
        let since = self.looked_s.map(|last| seconds - last);
        if since.is_some_and(|since| !(0.0..=GAP_S).contains(&since)) {
            self.taken.clear();
            self.agreeing.clear();
        }
        self.looked_s = Some(seconds);
        self.fresh = [image.width, image.height] == self.home.size;
        if self.fresh {
            self.picture.reduce(image);
        }
        let reference = self.reference.as_mut().filter(|_| self.fresh)?;
        let expected = self.agreeing.last().map_or(self.used, |last| last.motion);
        let found = reference.compare(&self.picture, &expected);
        let strange = found.is_none_or(|found| found.support < STRANGE);
        self.look_elsewhere(strange, time);
        let Some(found) = found.filter(Match::is_sure) else {
            self.blank += 1;
            if self.blank >= BLANK && self.standing == Standing::Suspect {
                self.agreeing.clear();
                self.standing = Standing::Aligned;
            }
            return None;
        };
        self.blank = 0;
        let counts_px = MOVED_PX.max(MOVED_SMALL_PX * self.picture.scale as f64) + 2.0 * found.sd_px;
        if found.motion.farthest_px(&self.used, &self.outline) <= counts_px {
            self.at_home();
            return None;
        }
        self.back = 0;
        if self.standing == Standing::Aligned {
            self.standing = Standing::Suspect;
        }
        if self.agreeing.first().is_some_and(|first| found.motion.farthest_px(&first.motion, &self.outline) > counts_px)
        {
            self.agreeing.clear();
        }
        if self.agreeing.len() < AGREEING {
            self.agreeing.push(found);
        }
        if self.agreeing.len() < AGREEING { None } else { self.confirmed(time) }
    }

    /// Told at each look whether it is strange: it shows nothing of the reference. The camera was turned far away if the
    /// looks show something else that stays.
    fn look_elsewhere(&mut self, strange: bool, time: Timestamp) {
        if !strange || self.standing == Standing::Misaligned {
            (self.elsewhere, self.strange) = (None, 0);
            return;
        }
        let still = Motion::none(self.picture.centre());
        let again = self.elsewhere.as_mut().and_then(|elsewhere| elsewhere.compare(&self.picture, &still));
        let again = again.is_some_and(|again| again.support >= STAYS);
        self.strange = if again { self.strange + 1 } else { 0 };
        if !again {
            let enough = self.reference.as_ref().map_or(0, |reference| reference.cells() / 2);
            // In the dark, or where a coat hangs before the camera, there is little to see.
            self.elsewhere = Reference::new(self.picture.clone()).filter(|elsewhere| elsewhere.cells() >= enough);
        }
        if self.strange >= STRANGE_LOOKS {
            tracing::warn!(
                "the camera shows nothing of what it showed: it was turned away, or something stands before it: no map \
                 until it is back or calibrated anew"
            );
            self.moved = Some(CameraMoved {
                dx_px: None,
                dy_px: None,
                rotation_deg: None,
                shift_px: None,
                since: time,
                corrected: false,
            });
            self.standing = Standing::Misaligned;
            self.news = true;
            self.agreeing.clear();
        }
    }

    /// The camera looks where the calibration in use says.
    fn at_home(&mut self) {
        self.agreeing.clear();
        match self.standing {
            Standing::Aligned => {}
            Standing::Suspect => self.standing = Standing::Aligned,
            Standing::Misaligned => {
                self.back += 1;
                if self.back >= AGREEING {
                    tracing::info!("the camera looks again where it was calibrated: the map goes on");
                    (self.standing, self.moved, self.back) = (Standing::Aligned, None, 0);
                }
            }
        }
    }

    fn confirmed(&mut self, time: Timestamp) -> Option<Followed> {
        let last = *self.agreeing.last()?;
        let motion = mean(&self.agreeing);
        let shift_px = motion.farthest_px(&self.used, &self.outline);
        let clear = last.support >= FOLLOW_SUPPORT && last.sd_px <= FOLLOW_SD_PX;
        let moved = self.telling(&motion, shift_px, time);
        if self.follow_px > 0.0 && shift_px <= self.follow_px && clear {
            let (calibration, moved) =
                (moved_calibration(&self.home, &motion), CameraMoved { corrected: true, ..moved });
            return Some(Followed { calibration, motion, moved });
        }
        self.misaligned(moved);
        None
    }

    fn misaligned(&mut self, moved: CameraMoved) {
        if self.standing != Standing::Misaligned {
            self.news = true;
            let [shift_px, rotation_deg] = [moved.shift_px, moved.rotation_deg].map(Option::unwrap_or_default);
            tracing::warn!(
                "the camera has moved: the patches are {shift_px:.1} pixels from where they were, turned by \
                 {rotation_deg:.1} degrees: no map until it is back or calibrated anew"
            );
        }
        let since =
            self.moved.filter(|_| self.standing == Standing::Misaligned).map_or(moved.since, |before| before.since);
        self.moved = Some(CameraMoved { since, ..moved });
        self.standing = Standing::Misaligned;
        // The next looks may tell that it moves on.
        self.agreeing.drain(..1);
    }

    /// The difference between a motion and the one in use, in the words of the update.
    fn telling(&self, motion: &Motion, shift_px: f64, since: Timestamp) -> CameraMoved {
        let centre = self.used.centre_px;
        let (now, then) = (motion.apply(centre), self.used.apply(centre));
        let round = |v: f64| Some((v * 100.0).round() / 100.0);
        CameraMoved {
            dx_px: round(now[0] - then[0]),
            dy_px: round(now[1] - then[1]),
            rotation_deg: round((motion.rotation - self.used.rotation).to_degrees()),
            shift_px: round(shift_px),
            since,
            corrected: false,
        }
    }

    /// The calibration is used from now on.
    pub fn use_followed(&mut self, followed: &Followed) {
        let CameraMoved { dx_px, dy_px, rotation_deg, .. } = followed.moved;
        let [dx_px, dy_px, rotation_deg] = [dx_px, dy_px, rotation_deg].map(Option::unwrap_or_default);
        tracing::warn!(
            "the camera has moved by {dx_px:+.1} pixels to the right, {dy_px:+.1} down and {rotation_deg:+.1} degrees \
             clockwise: the calibration follows, and the map goes on"
        );
        (self.used, self.moved) = (followed.motion, Some(followed.moved));
        self.standing = Standing::Aligned;
        self.news = true;
        self.agreeing.clear();
        if let (Some(store), Some(reference)) = (&mut self.store, &self.reference) {
            store.save(reference.overview(), &self.home, &self.used);
        }
    }

    /// The calibration cannot be used: part of a patch has left the picture.
    pub fn refuse(&mut self, followed: &Followed) {
        self.misaligned(CameraMoved { corrected: false, ..followed.moved });
    }

    /// Told after each frame whether it showed an empty room, or somebody who was not there before. Takes the reference
    /// of an empty room if there is none yet.
    pub fn room_is(&mut self, purpose: Purpose, empty: bool, newcomer: bool) {
        self.eager = newcomer;
        if !std::mem::take(&mut self.fresh) || self.reference.is_some() {
            return;
        }
        let given = purpose == Purpose::Background;
        if self.given && !given {
            // There may have been few of them, but that they show the empty room is certain.
            self.given = false;
            self.take();
            return;
        }
        self.given = given;
        if !given && !empty {
            self.taken.clear();
            return;
        }
        if self.taken.last().is_some_and(|last| !given && !is_still(last, &self.picture)) {
            self.taken.clear();
        }
        self.taken.push(self.picture.clone());
        if self.taken.len() >= TAKEN {
            self.take();
        }
    }

    fn take(&mut self) {
        let taken = std::mem::take(&mut self.taken);
        self.reference = Overview::mean(&taken).and_then(Reference::new);
        match &self.reference {
            None => tracing::debug!("the picture shows too few edges to tell whether the camera moves"),
            Some(reference) => {
                self.shown = Some(Arc::new(reference.overview().clone()));
                // It is of now: the calibration in use is its own.
                self.home = moved_calibration(&self.home, &self.used);
                self.used = Motion::none(self.used.centre_px);
                if let Some(store) = &mut self.store {
                    store.save(reference.overview(), &self.home, &self.used);
                }
            }
        }
    }
}

/// The calibration of a camera whose picture has moved. Positions are rounded, so that they are the same once saved.
fn moved_calibration(calibration: &Calibration, motion: &Motion) -> Calibration {
    let mut moved = calibration.clone();
    for point in &mut moved.floor_points {
        point.pixel = motion.apply(point.pixel).map(|v| (v * 1e3).round() / 1e3);
    }
    moved
}

/// The mean of motions that are nearly the same.
fn mean(matches: &[Match]) -> Motion {
    let share = 1.0 / matches.len().max(1) as f64;
    let mean = |of: fn(&Motion) -> f64| matches.iter().map(|found| of(&found.motion)).sum::<f64>() * share;
    Motion {
        centre_px: [mean(|m| m.centre_px[0]), mean(|m| m.centre_px[1])],
        shift_px: [mean(|m| m.shift_px[0]), mean(|m| m.shift_px[1])],
        rotation: mean(|m| m.rotation),
        tilt_per_px: [mean(|m| m.tilt_per_px[0]), mean(|m| m.tilt_per_px[1])],
    }
}

/// Whether no cell of the picture became much brighter or darker.
fn is_still(before: &Overview, now: &Overview) -> bool {
    if !before.is_like(now) {
        return false;
    }
    let (across, down) = (now.width / STILL_CELL, now.height / STILL_CELL);
    (0..across * down).all(|cell| {
        let (left, top) = (cell % across * STILL_CELL, cell / across * STILL_CELL);
        let rows = (top..top + STILL_CELL).map(|y| y * now.width + left..y * now.width + left + STILL_CELL);
        let change: f32 = rows
            .map(|row| before.codes[row.clone()].iter().zip(&now.codes[row]).map(|(a, b)| (b - a).abs()).sum::<f32>())
            .sum();
        change / (STILL_CELL * STILL_CELL) as f32 <= STILL
    })
}

#[cfg(test)]
mod tests;
