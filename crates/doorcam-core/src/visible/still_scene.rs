use super::{Cells, Grid, Thumbnail};

/// Added to the light of a cell, relative to full scale, so that the ratio of two dark cells is not noise.
const DARK: f32 = 0.004;
/// How much the natural logarithm of one colour's ratio to the still scene may differ from that of the three: shadows and
/// lamps change all colours nearly alike.
const TINT: f32 = 0.09;
/// The logarithm of the ratio beyond which no shadow is as dark, and no lamp as bright.
const DARKER: f32 = -0.9;
const BRIGHTER: f32 = 0.4;
/// Time constant, in seconds, with which what is not covered follows the light.
const FOLLOW_S: f64 = 20.0;
/// What covers a cell for this long without changing is part of the scene.
const STAYS_S: f64 = 10.0;
/// How much the logarithm of a colour may change while it counts as the same.
const SAME: f32 = 0.1;

/// What the camera sees while nobody is there, cell by cell.
#[derive(Debug, Clone)]
pub struct StillScene {
    /// Per cell, the logarithm of its light; none before there was a picture.
    still: Option<Vec<[f32; 3]>>,
    /// Number of pictures it was learned from.
    learned: f32,
    /// What covers each cell, and for how long it has looked the same, in seconds.
    cover: Vec<([f32; 3], f32)>,
    /// The last picture's logarithms.
    now: Vec<[f32; 3]>,
    /// The last picture's logarithms, relative to the still scene.
    change: Vec<[f32; 3]>,
    /// For medians.
    sorted: Vec<f32>,
}

impl StillScene {
    /// Nothing seen yet.
    pub fn new(grid: Grid) -> Self {
        Self {
            still: None,
            learned: 0.0,
            cover: vec![([0.0; 3], 0.0); grid.len()],
            now: vec![[0.0; 3]; grid.len()],
            change: vec![[0.0; 3]; grid.len()],
            sorted: Vec::with_capacity(grid.len()),
        }
    }

    /// Learns from a picture of the scene with nobody there: the mean of all of them.
    pub fn learn(&mut self, picture: &Thumbnail) {
        let still = self.still.get_or_insert_with(|| vec![[0.0; 3]; picture.cells().len()]);
        self.learned += 1.0;
        for (still, &rgb) in still.iter_mut().zip(picture.cells()) {
            let now = log(rgb);
            (0..3).for_each(|c| still[c] += (now[c] - still[c]) / self.learned);
        }
    }

    /// Compares a picture, `step_s` seconds after the one before, with the still scene: marks what covers it in
    /// `covered`. A change of exposure or white balance, which all cells share, does not count. Then lets the scene
    /// follow slow changes of the light, if `follow`. The first picture becomes the scene.
    pub fn compare(&mut self, picture: &Thumbnail, step_s: f64, follow: bool, covered: &mut Cells) {
        covered.clear();
        let Some(still) = &mut self.still else {
            self.still = Some(picture.cells().iter().map(|&rgb| log(rgb)).collect());
            return;
        };
        for (k, (&rgb, still)) in picture.cells().iter().zip(still.iter()).enumerate() {
            self.now[k] = log(rgb);
            self.change[k] = [0, 1, 2].map(|c| self.now[k][c] - still[c]);
        }
        let shared = [0, 1, 2].map(|c| {
            self.sorted.clear();
            self.sorted.extend(self.change.iter().map(|change| change[c]));
            let middle = self.sorted.len() / 2;
            *self.sorted.select_nth_unstable_by(middle, f32::total_cmp).1
        });
        for (k, change) in self.change.iter_mut().enumerate() {
            (0..3).for_each(|c| change[c] -= shared[c]);
            let mean = (change[0] + change[1] + change[2]) / 3.0;
            let tint = change.iter().fold(0.0_f32, |most, c| most.max((c - mean).abs()));
            if tint > TINT || !(DARKER..=BRIGHTER).contains(&mean) {
                covered.set(k);
            }
        }
        let share = if follow { (1.0 - (-step_s / FOLLOW_S).exp()) as f32 } else { 0.0 };
        for (k, (still, change)) in still.iter_mut().zip(&self.change).enumerate() {
            let (look, seconds) = &mut self.cover[k];
            if !covered.has(k) {
                *seconds = 0.0;
                (0..3).for_each(|c| still[c] += share * (change[c] + shared[c]));
                continue;
            }
            let same = look.iter().zip(change).all(|(a, b)| (a - b).abs() < SAME);
            if same {
                *seconds += step_s as f32;
            } else {
                (*look, *seconds) = (*change, 0.0);
            }
            if f64::from(*seconds) >= STAYS_S {
                (0..3).for_each(|c| still[c] += change[c] + shared[c]);
                *seconds = 0.0;
            }
        }
    }

    /// How much lighter the last picture is than the scene in these cells: the mean logarithm of the ratio.
    pub fn lighter(&self, cells: &[usize]) -> f32 {
        let Some(still) = &self.still else { return 0.0 };
        let change = |&k: &usize| (0..3).map(|c| self.now[k][c] - still[k][c]).sum::<f32>() / 3.0;
        cells.iter().map(change).sum::<f32>() / cells.len().max(1) as f32
    }

    /// The mean logarithm of the light of these cells in the last picture.
    pub fn light(&self, cells: &[usize]) -> f32 {
        let light = |&k: &usize| self.now[k].iter().sum::<f32>() / 3.0;
        cells.iter().map(light).sum::<f32>() / cells.len().max(1) as f32
    }

    /// Takes what the last picture shows in a cell for a part of the scene.
    pub fn accept(&mut self, cell: usize) {
        if let Some(still) = &mut self.still {
            still[cell] = self.now[cell];
        }
    }
}

fn log(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|light| (light.max(0.0) + DARK).ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(grid: Grid, light: impl Fn(usize) -> [f32; 3]) -> Thumbnail {
        let mut picture = Thumbnail::new(grid);
        picture.cells_mut().iter_mut().enumerate().for_each(|(k, cell)| *cell = light(k));
        picture
    }

    #[test]
    fn bodies_cover_the_scene_and_light_does_not() {
        let grid = Grid::new([640, 360]);
        let floor = |k: usize| [0.3, 0.28, 0.25].map(|v: f32| v * (1.0 + 0.2 * (k as f32).sin()));
        let (mut scene, mut covered) = (StillScene::new(grid), Cells::new(grid.len()));
        scene.compare(&picture(grid, floor), 0.2, true, &mut covered);
        let mut count = |picture: &Thumbnail| {
            scene.clone().compare(picture, 0.2, true, &mut covered);
            covered.count()
        };
        let in_half = |k: usize| k % 80 < 30;
        let seen =
            |change: fn([f32; 3]) -> [f32; 3]| picture(grid, |k| if in_half(k) { change(floor(k)) } else { floor(k) });
        assert_eq!(count(&seen(|rgb| rgb)), 0);
        assert_eq!(count(&seen(|rgb| rgb.map(|v| 0.5 * v))), 0, "a shadow");
        assert_eq!(count(&seen(|rgb| rgb.map(|v| 1.3 * v))), 0, "a lamp");
        assert_eq!(count(&picture(grid, |k| floor(k).map(|v| 3.0 * v))), 0, "exposure");
        assert_eq!(count(&seen(|_| [0.02, 0.03, 0.12])), 45 * 30, "blue trousers");
        assert_eq!(count(&seen(|_| [0.03; 3])), 45 * 30, "black trousers");
        assert_eq!(count(&seen(|_| [0.4, 0.25, 0.18])), 45 * 30, "skin");
    }

    #[test]
    fn what_stays_becomes_part_of_the_scene() {
        let grid = Grid::new([640, 360]);
        let (mut scene, mut covered) = (StillScene::new(grid), Cells::new(grid.len()));
        let floor = picture(grid, |_| [0.3; 3]);
        let bag = picture(grid, |k| if k % 80 < 10 { [0.02, 0.02, 0.1] } else { [0.3; 3] });
        scene.compare(&floor, 0.2, true, &mut covered);
        let mut look = |picture: &Thumbnail, seconds: f64| {
            (0..(seconds / 0.2) as usize).for_each(|_| scene.compare(picture, 0.2, true, &mut covered));
            covered.count()
        };
        assert_eq!(look(&bag, 9.0), 450);
        assert_eq!(look(&bag, 2.0), 0);
        assert_eq!(look(&floor, 0.2), 450, "and so does the floor when the bag is gone");
        assert_eq!(look(&floor, 11.0), 0);
    }
}
