use super::coarse::Coarse;
use super::filtered::Filtered;
use super::fine::{Cell, DIRECTIONS, Fine, Refined, shares};
use super::{Motion, Overview};

/// The picture of the empty room, to which later pictures are compared.
#[derive(Debug, Clone)]
pub struct Reference {
    overview: Overview,
    cells: Vec<Cell>,
    coarse: Coarse,
    fine: Fine,
    present: Filtered,
}

/// How a picture fits the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// From the reference to the picture, in the image's pixels.
    pub motion: Motion,
    /// Share of the cells with edges that agree with it, 0 to 1: others are covered, or lit so differently that they
    /// cannot be compared.
    pub support: f64,
    /// Standard deviation of where the motion puts the picture's pixels: the worst over the middle half of the picture,
    /// in pixels.
    pub sd_px: f64,
    /// The support of the best other motion; 0 if none was looked for, as most of the picture fits.
    pub rival: f64,
}

impl Match {
    /// Whether enough of the picture agrees to believe it.
    pub fn is_sure(&self) -> bool {
        let turned = self.motion.rotation.abs() * self.motion.centre_px[0] / 2.0;
        let far = self.motion.shift_px[0].hypot(self.motion.shift_px[1]) + turned;
        // Where only some edges agree, those along one direction may do so anywhere along it.
        let share = if self.support >= CLEAR { SURE_SHARE } else { 0.0 };
        let rival = RIVAL[usize::from(self.support >= MOST)];
        self.support >= SUPPORT && self.sd_px <= SURE_PX + share * far && self.rival <= rival * self.support
    }
}

/// Side of a cell, in pixels of the overview.
pub(super) const CELL: usize = 10;
/// Most cells that are compared: enough to find a tenth of a pixel, and a look stays cheap.
const MOST_CELLS: usize = 200;
/// Fewest cells with edges that make a picture comparable.
const FEWEST_CELLS: usize = 10;
/// Parts of the picture, across and down, that each contribute cells: what covers some of them must not cover most cells.
const PARTS: [usize; 2] = [8, 5];
/// Root mean square of the gradient, in codes per pixel, from which a cell has edges rather than noise.
const EDGE: f32 = 0.35;
/// Share of the cells that must agree. Two people side by side cover half of the picture, and a changed light makes some
/// of the rest incomparable.
const SUPPORT: f64 = 0.3;
/// Standard deviation up to which a motion is believed, in pixels of the image, and so much more for each pixel of the
/// motion, if this share of the cells agrees: how the far parts of the picture grow is known less well then.
const SURE_PX: f64 = 0.5;
const SURE_SHARE: f64 = 0.02;
const CLEAR: f64 = 0.9;
/// Share of the support that another motion may have, usually and where most cells agree: two that fit alike are both
/// doubtful.
const RIVAL: [f64; 2] = [0.6, 0.8];
const MOST: f64 = 0.75;
/// Motions that differ by less than this are the same one, in pixels of the overview.
const SAME: f64 = 1.5;
/// A motion this near to the expected one is the expected one, in pixels of the overview: while enough fits, no other is
/// looked for.
const REST: f64 = 0.5;
/// Support from which no other motion is looked for anyway.
const PLENTY: f64 = 0.9;

impl Reference {
    /// From a picture of the empty room, the mean of several where possible. `None` if it shows too few edges to tell
    /// where the camera looks.
    pub fn new(overview: Overview) -> Option<Self> {
        if overview.codes.len() != overview.width * overview.height || overview.codes.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let filtered = Filtered::of(&overview);
        let cells = cells(&filtered);
        if cells.len() < FEWEST_CELLS {
            return None;
        }
        let (coarse, fine) = (Coarse::new(&overview), Fine::default());
        Some(Self { overview, cells, coarse, fine, present: Filtered::default() })
    }

    /// The picture.
    pub fn overview(&self) -> &Overview {
        &self.overview
    }

    /// Number of cells with edges.
    pub fn cells(&self) -> usize {
        self.cells.len()
    }

    /// Finds the motion from the reference to a picture of the same size; `None` if none fits. It is looked for near
    /// `expected` first, and elsewhere only if most of the picture does not fit there.
    pub fn compare(&mut self, picture: &Overview, expected: &Motion) -> Option<Match> {
        if !picture.is_like(&self.overview) || picture.codes.len() != self.overview.codes.len() {
            return None;
        }
        let (scale, centre) = (self.overview.scale, self.overview.centre());
        let small_centre = [self.overview.width, self.overview.height].map(|n| (n as f64 - 1.0) / 2.0);
        self.present.make(picture.width, picture.height, &picture.codes);
        let Self { cells, fine, present, coarse, .. } = self;
        let mut best = fine.refine(cells, present, expected.reduced(scale, small_centre));
        let mut rival = 0.0_f64;
        let [x, y] = small_centre;
        let ring = [[0.5 * x, 0.5 * y], [1.5 * x, 0.5 * y], [0.5 * x, 1.5 * y], [1.5 * x, 1.5 * y]];
        let at_rest = |found: &Refined| found.motion.farthest_px(&expected.reduced(scale, small_centre), &ring) < REST;
        let plain = |found: &Refined| {
            let enough = if at_rest(found) { SUPPORT } else { PLENTY };
            found.support >= enough && found.sd * scale as f64 <= SURE_PX
        };
        if !best.as_ref().is_some_and(plain) {
            for start in coarse.search(picture) {
                let Some(mut found) = fine.refine(cells, present, start) else { continue };
                if let Some(best) = &mut best {
                    if found.motion.farthest_px(&best.motion, &ring) < SAME {
                        if found.sd < best.sd {
                            *best = found;
                        }
                        continue;
                    }
                    if found.support > best.support {
                        std::mem::swap(best, &mut found);
                    }
                    rival = rival.max(found.support);
                } else {
                    best = Some(found);
                }
            }
        }
        best.map(|best| Match {
            motion: best.motion.enlarged(scale, centre),
            support: best.support,
            sd_px: best.sd * scale as f64,
            rival,
        })
    }
}

/// The cells with the strongest edges, from all parts of the picture.
fn cells(picture: &Filtered) -> Vec<Cell> {
    let (across, down) = ((picture.width.max(2) - 2) / CELL, (picture.height.max(2) - 2) / CELL);
    let mut found: Vec<(usize, Cell)> = Vec::new();
    for row in 0..down {
        for column in 0..across {
            let cell = Cell::new(picture, 1 + column * CELL, 1 + row * CELL);
            if cell.edge() >= EDGE {
                let part = row * PARTS[1] / down * PARTS[0] + column * PARTS[0] / across;
                found.push((part, cell));
            }
        }
    }
    found.sort_by(|(_, a), (_, b)| b.edge().total_cmp(&a.edge()));
    // Each part's own best ones first, then whatever is left.
    let quota = MOST_CELLS / (PARTS[0] * PARTS[1]);
    let mut taken = vec![0; PARTS[0] * PARTS[1]];
    let (mut chosen, mut rest) = (Vec::new(), Vec::new());
    for (part, cell) in found {
        taken[part] += 1;
        if taken[part] <= quota { chosen.push(cell) } else { rest.push(cell) }
    }
    let room = MOST_CELLS - chosen.len().min(MOST_CELLS);
    chosen.extend(rest.into_iter().take(room));
    let mut counts = [0; DIRECTIONS];
    chosen.iter().for_each(|cell| counts[cell.direction()] += 1);
    let shares = shares(counts);
    chosen.iter_mut().for_each(|cell| cell.share = shares[cell.direction()]);
    chosen
}
