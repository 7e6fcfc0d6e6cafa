use doorcam_core::geometry::Side;
use doorcam_core::light::{PatchPair, Usable};

use crate::{PatchView, ViewReport, ViewState};

/// Added to the light of a pixel, relative to full scale, so that the ratio of two dark pixels is not noise.
const DARK: f32 = 0.01;
/// How much the ratio of one colour to the empty room may differ from that of the three, as a share: nobody in the room
/// colours the floor that much.
const TINT: f32 = 0.2;
/// Light relative to the empty room that neither the room nor a shadow causes.
const DARKEST: f32 = 0.35;
const BRIGHTEST: f32 = 1.8;
/// Share of used pixels below which a patch is partly covered, and below which it is blocked.
const PARTIAL: f64 = 0.97;
const BLOCKED: f64 = 0.4;
/// Share of a patch's pixels that may come and go at the border of what lies still.
const FLICKER: f64 = 0.01;
/// Share of used pixels of both patches below which it is the light that has changed.
const LIGHT: f64 = 0.2;

/// Judges which pixels of a frame still show the floor.
#[derive(Debug, Clone)]
pub(crate) struct Validity {
    counted: Usable,
    usable: Usable,
    spread: Vec<bool>,
    /// Number of usable pixels per side when it was last asked whether it has changed.
    before: [usize; 2],
}

impl Validity {
    /// All pixels that count can be used.
    pub(crate) fn new(counted: &[Vec<bool>; 2]) -> Self {
        let counted = Usable::all(counted);
        let before = Side::BOTH.map(|side| counted.count(side));
        Self { usable: counted.clone(), counted, spread: Vec::new(), before }
    }

    /// Starts a frame with all pixels.
    pub(crate) fn restart(&mut self) {
        self.usable.copy_from(&self.counted);
    }

    /// Takes all pixels back if nearly none is left of either patch: without anybody there to cover them, that is a lamp,
    /// for which there is the background.
    pub(crate) fn allow_for_light(&mut self) {
        let few = |side| (self.usable.count(side) as f64) < LIGHT * self.counted.count(side) as f64;
        if Side::BOTH.into_iter().all(few) {
            self.restart();
        }
    }

    /// Whether more pixels than a border's flicker have become usable or unusable since this was last asked.
    pub(crate) fn has_changed(&mut self) -> bool {
        let now = Side::BOTH.map(|side| self.usable.count(side));
        let before = std::mem::replace(&mut self.before, now);
        let all = Side::BOTH.map(|side| self.counted.count(side));
        (0..2).any(|s| now[s].abs_diff(before[s]) as f64 > FLICKER * all[s] as f64)
    }

    /// Whether all pixels can be used.
    pub(crate) fn is_clear(&self) -> bool {
        self.usable == self.counted
    }

    /// Takes out pixels with a light that neither the room nor a shadow can cause, compared with the `empty` room, and
    /// their neighbours.
    pub(crate) fn judge(&mut self, frame: &PatchPair, empty: &PatchPair) {
        for side in Side::BOTH {
            let (now, then) = (frame.side(side), empty.side(side));
            let size = now.size();
            self.spread.clear();
            self.spread.resize(now.pixels(), false);
            for k in 0..now.pixels() {
                let ratio = [0, 1, 2].map(|c| (now.plane(c)[k] + DARK) / (then.plane(c)[k] + DARK));
                let mean = (ratio[0] + ratio[1] + ratio[2]) / 3.0;
                let tint = ratio.iter().fold(0.0_f32, |most, r| most.max((r - mean).abs()));
                if tint > TINT * mean || !(DARKEST..=BRIGHTEST).contains(&mean) {
                    let (row, column) = (k / size, k % size);
                    for near in row.saturating_sub(1)..(row + 2).min(size) {
                        self.spread[near * size + column.saturating_sub(1)..near * size + (column + 2).min(size)]
                            .fill(true);
                    }
                }
            }
            let usable = self.usable.side_mut(side).iter_mut();
            usable.zip(&self.spread).for_each(|(usable, covered)| *usable &= !covered);
        }
    }

    /// All pixels that count.
    pub(crate) fn counted(&self) -> &Usable {
        &self.counted
    }

    /// What is left, to take more out of it.
    pub(crate) fn usable_mut(&mut self) -> &mut Usable {
        &mut self.usable
    }

    /// What is left.
    pub(crate) fn usable(&self) -> &Usable {
        &self.usable
    }

    /// The same as a report, and per side the share of used pixels, 0 if it is blocked.
    pub(crate) fn report(&self) -> (ViewReport, [f64; 2]) {
        let [left, right] = Side::BOTH.map(|side| {
            let used = self.usable.count(side) as f64 / self.counted.count(side).max(1) as f64;
            let state = match used {
                used if used < BLOCKED => ViewState::Blocked,
                used if used < PARTIAL => ViewState::Partial,
                _ => ViewState::Clear,
            };
            PatchView { state, used }
        });
        let share = |view: PatchView| if view.state == ViewState::Blocked { 0.0 } else { view.used };
        (ViewReport { left, right }, [share(left), share(right)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 32;

    fn floor(light: [f32; 3]) -> PatchPair {
        let mut pair = PatchPair::zeros(SIZE);
        for side in Side::BOTH {
            (0..3).for_each(|c| pair.side_mut(side).plane_mut(c).fill(light[c]));
        }
        pair
    }

    #[test]
    fn what_is_covered_is_left_out_with_a_border_and_what_is_lit_otherwise_is_not() {
        let mut validity = Validity::new(&[vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]]);
        let empty = floor([0.4, 0.38, 0.35]);
        let mut used = |frame: &PatchPair| {
            validity.restart();
            validity.judge(frame, &empty);
            validity.report()
        };
        // Somebody in the room, a shadow, a lamp.
        for light in [[0.36, 0.36, 0.33], [0.2, 0.19, 0.17], [0.55, 0.52, 0.48]] {
            assert_eq!(used(&floor(light)), (ViewReport::CLEAR, [1.0; 2]), "{light:?}");
        }
        let mut leg = empty.clone();
        for (row, column) in (10..20).flat_map(|row| (4..8).map(move |column| (row, column))) {
            (0..3).for_each(|c| leg.left.plane_mut(c)[row * SIZE + column] = [0.03, 0.04, 0.1][c]);
        }
        let (view, share) = used(&leg);
        let expected = 1.0 - (12.0 * 6.0) / (SIZE * SIZE) as f64;
        assert_eq!((view.left.state, view.right), (ViewState::Partial, PatchView::CLEAR));
        assert!((view.left.used - expected).abs() < 1e-12 && share == [view.left.used, 1.0], "{view:?}");
        // Black trousers all over both.
        let (view, share) = used(&floor([0.02; 3]));
        assert_eq!((view.left.state, view.right.state, share), (ViewState::Blocked, ViewState::Blocked, [0.0; 2]));
        // If nobody is there, it is the light.
        validity.allow_for_light();
        assert!(validity.is_clear());
    }
}
