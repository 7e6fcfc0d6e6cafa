use super::light::{Light, light};
use crate::Reconstructor;
use doorcam_core::geometry::Side;
use doorcam_core::light::{PatchPair, RollingBackground, Usable};
use doorcam_source::Purpose;

/// What the keeper needs to know of a frame.
#[derive(Clone, Copy)]
pub(crate) struct FrameLight<'a> {
    /// As captured.
    pub raw: &'a PatchPair,
    /// Averaged in time; the same as `raw` without averaging.
    pub pair: &'a PatchPair,
    /// Noise of this average as a multiple of a full average's.
    pub excess: f64,
    /// Capture time on the source's clock.
    pub seconds: f64,
    pub purpose: Purpose,
    /// The pixels that show the floor; none if all do.
    pub usable: Option<&'a Usable>,
    /// Whether somebody on the visible side disturbs the light, or did a moment ago.
    pub busy: bool,
}

/// Share of a patch's pixels that must show the floor for the patch to say anything about the light.
const ENOUGH: f64 = 0.5;

impl FrameLight<'_> {
    /// The frame's light and that of the picture in use, on the pixels that show the floor. `reference` is the
    /// picture's on all pixels.
    pub fn lights(&self, reference: Light, reconstructor: &Reconstructor) -> [Light; 2] {
        let counted = reconstructor.model().counted.each_ref().map(Vec::as_slice);
        match (self.usable, reconstructor.reference()) {
            (Some(usable), Some(picture)) => {
                let floor = Side::BOTH.map(|side| usable.side(side));
                [light(self.raw, floor), light(picture, floor)]
            }
            _ => [light(self.raw, counted), reference],
        }
    }

    /// Whether the frame says nothing about the light and the empty room: most of a patch cannot be used, or somebody is
    /// in its light.
    pub fn is_disturbed(&self, counted: &[Vec<bool>; 2]) -> bool {
        self.busy || self.mostly_blocked(counted)
    }

    /// Whether most of a patch cannot be used.
    fn mostly_blocked(&self, counted: &[Vec<bool>; 2]) -> bool {
        let blocked = |usable: &Usable, s: usize| {
            let all = counted[s].iter().filter(|&&counts| counts).count();
            (usable.count(Side::BOTH[s]) as f64) < ENOUGH * all as f64
        };
        self.usable.is_some_and(|usable| [0, 1].into_iter().any(|s| blocked(usable, s)))
    }
}

/// Writes into `out` the pair as it would be if every pixel showed the floor: in place of those that do not, the picture
/// `floor` in the light of the others, with the noise of one of the background's frames, after `turn`.
///
/// What learns from such a pair learns nothing from the pixels that are not usable, and takes neither more nor less
/// noise for usual than there is.
pub(super) fn fill(
    pair: &PatchPair,
    usable: &Usable,
    floor: &PatchPair,
    noise: Option<&RollingBackground>,
    turn: usize,
    out: &mut PatchPair,
) {
    let noise = noise.and_then(|rolling| rolling.deviation(turn));
    out.copy_from(pair);
    for side in Side::BOTH {
        let usable = usable.side(side);
        for channel in 0..3 {
            let (now, floor) = (pair.side(side).plane(channel), floor.side(side).plane(channel));
            let noise = noise.map(|noise| noise.side(side).plane(channel));
            let sum = |plane: &[f32]| plane.iter().zip(usable).filter(|u| *u.1).map(|u| f64::from(*u.0)).sum::<f64>();
            let (all, of_floor) = (sum(now), sum(floor));
            let gain = if all > 0.0 && of_floor > 0.0 { (all / of_floor) as f32 } else { 1.0 };
            let values = out.side_mut(side).plane_mut(channel).iter_mut().enumerate();
            for (k, value) in values.filter(|&(k, _)| !usable[k]) {
                *value = gain * (floor[k] + noise.map_or(0.0, |noise| noise[k]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(value: impl Fn(usize) -> f32) -> PatchPair {
        let mut pair = PatchPair::zeros(4);
        for side in Side::BOTH {
            pair.side_mut(side).data_mut().iter_mut().enumerate().for_each(|(k, v)| *v = value(k));
        }
        pair
    }

    #[test]
    fn what_does_not_show_the_floor_is_filled_with_the_floor_in_the_light_of_the_rest() {
        let floor = pair(|k| 0.2 + 0.01 * k as f32);
        let counted = [vec![true; 16], vec![true; 16]];
        let mut usable = Usable::all(&counted);
        usable.side_mut(Side::Left)[..8].fill(false);
        // Everything is a tenth brighter, but a dark thing lies on half of the left patch.
        let mut now = pair(|k| 1.1 * (0.2 + 0.01 * k as f32));
        (0..3).for_each(|p| now.left.plane_mut(p)[..8].fill(0.05));
        let mut out = PatchPair::zeros(4);
        fill(&now, &usable, &floor, None, 0, &mut out);
        let expected = pair(|k| 1.1 * (0.2 + 0.01 * k as f32));
        for side in Side::BOTH {
            let values = out.side(side).data().iter().zip(expected.side(side).data());
            values.for_each(|(a, b)| assert!((a - b).abs() < 1e-5, "{a} {b}"));
        }
        let mostly_blocked = |usable: &Usable| {
            let (excess, seconds, purpose) = (1.0, 0.0, Purpose::Live);
            let seen =
                FrameLight { raw: &now, pair: &now, excess, seconds, purpose, usable: Some(usable), busy: false };
            seen.mostly_blocked(&counted)
        };
        assert!(!mostly_blocked(&usable));
        usable.side_mut(Side::Left)[8] = false;
        assert!(mostly_blocked(&usable));
    }
}
