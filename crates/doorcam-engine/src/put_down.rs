use doorcam_core::geometry::Side;
use doorcam_core::light::{Patch, PatchPair, Usable};

/// Share of a patch's pixels from which something lies on it, and by which that may flicker.
const LIES: f64 = 0.005;
const FLICKER: f64 = 0.01;
/// Seconds for which all must be still, in two halves that are compared, and fewest frames in each half.
const STILL_S: f64 = 3.0;
const FEWEST: usize = 4;
/// Squares along a side of a patch, and how much the light of each may differ between the halves, as a share: somebody
/// who walks in the room changes it by more, if they show at all.
const SQUARES: usize = 8;
const MOVES: f32 = 0.01;
/// Added to light, relative to full scale, so that a dark square is not noise.
const DARK: f32 = 0.01;

/// What is put down on a patch also shades the floor around it, softly. A background that learns takes that in; one that
/// is fixed to a recording's frames of the empty room would show it for ever. So once all is still around what was put
/// down, the pixels beside it are compared with how they are then, until it is taken away.
#[derive(Debug, Clone)]
pub(crate) struct PutDown {
    sides: [Settling; 2],
}

#[derive(Debug, Clone)]
struct Settling {
    since_s: Option<f64>,
    /// Pixels that were covered when it began.
    covered: usize,
    /// Sums over the frames of both halves, and how many these are.
    sums: [Patch; 2],
    frames: [usize; 2],
    /// How the patch was before, and the pixels that were covered when it was learned.
    before: Option<(Patch, usize)>,
}

impl PutDown {
    /// Nothing lies on patches of `size` x `size` pixels.
    pub(crate) fn new(size: usize) -> Self {
        let nothing = || Settling {
            since_s: None,
            covered: 0,
            sums: [Patch::zeros(size), Patch::zeros(size)],
            frames: [0; 2],
            before: None,
        };
        Self { sides: [nothing(), nothing()] }
    }

    /// Takes a frame, in which only `usable` of the `counted` pixels show the floor. `calm`: nobody is about. Changes the
    /// picture that frames are compared with, where it is time to.
    pub(crate) fn see(
        &mut self,
        seconds: f64,
        pair: &PatchPair,
        usable: &Usable,
        counted: &Usable,
        calm: bool,
        reference: &mut PatchPair,
    ) {
        for (settling, side) in self.sides.iter_mut().zip(Side::BOTH) {
            let pixels = [usable.side(side), counted.side(side)];
            settling.see(seconds, pair.side(side), pixels, calm, reference.side_mut(side));
        }
    }
}

impl Settling {
    fn see(&mut self, seconds: f64, patch: &Patch, [usable, counted]: [&[bool]; 2], calm: bool, reference: &mut Patch) {
        if patch.pixels() != reference.pixels() || patch.pixels() != self.sums[0].pixels() {
            return;
        }
        let all = counted.iter().filter(|&&counts| counts).count();
        let covered = all - usable.iter().filter(|&&usable| usable).count().min(all);
        let lies = covered as f64 > LIES * all as f64;
        let alike = |other: usize| covered.abs_diff(other) as f64 <= FLICKER * all as f64;
        if !lies
            && calm
            && let Some((before, _)) = self.before.take()
        {
            // It was taken away.
            reference.data_mut().copy_from_slice(before.data());
        }
        let known = self.before.as_ref().is_some_and(|(_, covered)| alike(*covered));
        let gap = self.since_s.is_some_and(|since| !(0.0..=2.0 * STILL_S).contains(&(seconds - since)));
        if !lies || !calm || known || gap || !alike(self.covered) {
            (self.since_s, self.covered) = (None, covered);
            return;
        }
        if self.since_s.is_none() {
            (self.since_s, self.frames) = (Some(seconds), [0; 2]);
            self.sums.iter_mut().for_each(|sum| sum.data_mut().fill(0.0));
        }
        let elapsed_s = seconds - self.since_s.unwrap_or(seconds);
        if elapsed_s < STILL_S {
            let half = usize::from(elapsed_s >= 0.5 * STILL_S);
            self.frames[half] += 1;
            self.sums[half].data_mut().iter_mut().zip(patch.data()).for_each(|(sum, now)| *sum += now);
            return;
        }
        self.since_s = None;
        if self.frames.iter().any(|&frames| frames < FEWEST) || !self.is_still(usable) {
            return;
        }
        if self.before.is_none() {
            self.before = Some((reference.clone(), covered));
        }
        if let Some((_, known)) = &mut self.before {
            *known = covered;
        }
        let share = 1.0 / (self.frames[0] + self.frames[1]) as f32;
        for channel in 0..3 {
            let [first, second] = [0, 1].map(|half| self.sums[half].plane(channel));
            let values = reference.plane_mut(channel).iter_mut().zip(first.iter().zip(second)).zip(usable);
            values.filter(|(_, usable)| **usable).for_each(|((value, (a, b)), _)| *value = share * (a + b));
        }
    }

    /// Whether the light of each square is the same in both halves.
    fn is_still(&self, usable: &[bool]) -> bool {
        let size = usable.len().isqrt().max(1);
        let mut squares = [[(0.0_f32, 0.0_f32); SQUARES * SQUARES]; 2];
        for (half, squares) in squares.iter_mut().enumerate() {
            let share = 1.0 / (3 * self.frames[half].max(1)) as f32;
            for (k, _) in usable.iter().enumerate().filter(|(_, usable)| **usable) {
                let along = |p: usize| (p * SQUARES / size).min(SQUARES - 1);
                let (sum, count) = &mut squares[along(k / size) * SQUARES + along(k % size)];
                *sum += share * (0..3).map(|c| self.sums[half].plane(c)[k]).sum::<f32>();
                *count += 1.0;
            }
        }
        let [first, second] = squares;
        // A square with few pixels is noise.
        let enough = (size * size / (SQUARES * SQUARES)) as f32 / 2.0;
        let light = |(sum, count): (f32, f32)| sum / count + DARK;
        let mut pairs = first.into_iter().zip(second).filter(|(a, _)| a.1 >= enough);
        pairs.all(|(a, b)| (light(b) / light(a) - 1.0).abs() <= MOVES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 32;

    /// The first columns of the left patch are covered, and the floor beside them has this light.
    fn frame(columns: usize, light: f32) -> (PatchPair, Usable) {
        let mut pair = PatchPair::zeros(SIZE);
        let mut usable = counted();
        for side in Side::BOTH {
            pair.side_mut(side).data_mut().fill(0.4);
        }
        for k in 0..SIZE * SIZE {
            let bag = k % SIZE < columns;
            usable.side_mut(Side::Left)[k] = !bag;
            let value = if bag { 0.05 } else { light };
            (0..3).for_each(|c| pair.left.plane_mut(c)[k] = value);
        }
        (pair, usable)
    }

    fn counted() -> Usable {
        Usable::all(&[vec![true; SIZE * SIZE], vec![true; SIZE * SIZE]])
    }

    #[test]
    fn the_floor_beside_what_lies_there_is_compared_with_itself_until_that_is_gone() {
        let (empty, _) = frame(0, 0.4);
        let (mut put_down, mut reference) = (PutDown::new(SIZE), empty.clone());
        let mut seconds = 0.0;
        let mut show = |reference: &mut PatchPair, columns: usize, light: f32, calm: bool, for_s: f64| {
            let (pair, usable) = frame(columns, light);
            for _ in 0..(for_s * 5.0).round() as usize {
                seconds += 0.2;
                put_down.see(seconds, &pair, &usable, &counted(), calm, reference);
            }
        };
        show(&mut reference, 0, 0.38, true, 10.0);
        assert_eq!(reference, empty, "a shadow without anything that lies there");
        show(&mut reference, 4, 0.37, false, 10.0);
        assert_eq!(reference, empty, "somebody is still about");
        show(&mut reference, 4, 0.37, true, 2.0);
        assert_eq!(reference, empty, "not for long enough");
        show(&mut reference, 4, 0.37, true, 3.0);
        let expected = frame(4, 0.37).0;
        for k in 0..SIZE * SIZE {
            let (now, then) = (reference.left.plane(1)[k], expected.left.plane(1)[k]);
            // What is covered remains to be told from the floor.
            let then = if k % SIZE < 4 { 0.4 } else { then };
            assert!((now - then).abs() < 1e-5, "{k}: {now}, expected {then}");
        }
        assert_eq!(reference.right, empty.right);
        let learned = reference.clone();
        show(&mut reference, 4, 0.39, true, 10.0);
        assert_eq!(reference, learned, "somebody in the room is not learned");
        show(&mut reference, 0, 0.4, true, 0.2);
        assert_eq!(reference, empty, "it was taken away");
    }

    #[test]
    fn nothing_is_learned_while_somebody_moves_in_the_room() {
        let (empty, _) = frame(0, 0.4);
        let (mut put_down, mut reference) = (PutDown::new(SIZE), empty.clone());
        for k in 0..150 {
            let (pair, usable) = frame(4, 0.35 + 0.001 * k as f32);
            put_down.see(0.2 * f64::from(k), &pair, &usable, &counted(), true, &mut reference);
        }
        assert_eq!(reference, empty);
    }
}
