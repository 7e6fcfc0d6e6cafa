use super::filtered::Filtered;
use super::fine::{DIRECTIONS, direction, shares};
use super::{Motion, Overview};

/// Finds large motions: tries all shifts and some rotations on a smaller picture of edges, whose directions count but
/// not which of their sides is brighter.
#[derive(Debug, Clone)]
pub(super) struct Coarse {
    /// The reference's strongest edges, spread over the picture.
    points: Vec<Edge>,
    size: [usize; 2],
    /// Largest shift, in its own pixels.
    reach: i32,
    /// Where the edges are after a rotation.
    turned: Vec<([i32; 2], [f32; 2])>,
    present: Edges,
    best: Vec<Candidate>,
}

/// An edge of the reference: where, and which way: the vector with twice the angle of its gradient, longer where the edge
/// counts for more.
#[derive(Debug, Clone, Copy)]
struct Edge {
    at: [f64; 2],
    doubled: [f32; 2],
}

/// The edges of a picture: for each pixel the doubled direction, longer where the edge is clearer, at most 1.
#[derive(Debug, Clone, Default)]
struct Edges {
    small: Overview,
    filtered: Filtered,
    doubled: Vec<[f32; 2]>,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    score: f32,
    shift: [i32; 2],
    angle: usize,
}

/// Overviews are reduced by this much more.
const REDUCED: usize = 3;
/// Largest shift, in pixels of the image, and the least and the most of this as a share of its width.
const FARTHEST_PX: f64 = 64.0;
const FARTHEST: [f64; 2] = [0.1, 0.2];
/// Rotations: so many on each side of none, so far apart, in radians. Half of that moves the border of the picture by
/// less than a coarse pixel.
const ANGLES: usize = 10;
const APART: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Most edges that are compared.
const MOST_EDGES: usize = 600;
/// Gradient, in codes per pixel, at which an edge has half of its weight.
const HALF: f32 = 1.5;
/// Motions that are tried with the fine picture.
const CANDIDATES: usize = 6;

impl Coarse {
    pub fn new(reference: &Overview) -> Self {
        let mut edges = Edges::default();
        edges.of(reference);
        let size = [edges.small.width, edges.small.height];
        let strength = |at: usize| edges.doubled[at][0].hypot(edges.doubled[at][1]);
        let mut strongest: Vec<usize> = (0..edges.doubled.len()).filter(|&at| strength(at) > 0.2).collect();
        strongest.sort_by(|&a, &b| strength(b).total_cmp(&strength(a)));
        strongest.truncate(MOST_EDGES);
        let bin = |doubled: [f32; 2]| direction(0.5 * f64::from(doubled[1]).atan2(f64::from(doubled[0])));
        let mut counts = [0; DIRECTIONS];
        strongest.iter().for_each(|&at| counts[bin(edges.doubled[at])] += 1);
        let shares = shares(counts);
        let points = strongest.into_iter().map(|at| (at, shares[bin(edges.doubled[at])] as f32)).map(|(at, share)| {
            Edge { at: [(at % size[0]) as f64, (at / size[0]) as f64], doubled: edges.doubled[at].map(|v| share * v) }
        });
        let [least, most] = FARTHEST.map(|share| share * size[0] as f64);
        let reach = (FARTHEST_PX / edges.small.scale as f64).clamp(least, most).ceil() as i32;
        let (turned, best) = (Vec::with_capacity(MOST_EDGES), Vec::with_capacity(CANDIDATES + 1));
        Self { points: points.collect(), size, reach, turned, present: Edges::default(), best }
    }

    /// The most promising motions from the reference to the picture, in pixels of the overview.
    pub fn search(&mut self, picture: &Overview) -> impl Iterator<Item = Motion> {
        self.present.of(picture);
        let [width, height] = self.size;
        let centre = [width, height].map(|n| (n as f64 - 1.0) / 2.0);
        self.best.clear();
        for angle in 0..=2 * ANGLES {
            let (sin, cos) = rotation(angle).sin_cos();
            self.turned.clear();
            self.turned.extend(self.points.iter().map(|edge| {
                let [x, y] = [edge.at[0] - centre[0], edge.at[1] - centre[1]];
                let at = [cos * x - sin * y + centre[0], sin * x + cos * y + centre[1]].map(|v| v.round() as i32);
                (at, edge.doubled)
            }));
            for down in -self.reach..=self.reach {
                for right in -self.reach..=self.reach {
                    let (mut score, mut inside) = (0.0, 0);
                    for ([x, y], doubled) in &self.turned {
                        let (x, y) = (x + right, y + down);
                        if (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
                            let seen = self.present.doubled[y as usize * width + x as usize];
                            score += doubled[0] * seen[0] + doubled[1] * seen[1];
                            inside += 1;
                        }
                    }
                    // What left the picture counts for nothing, but must not be most of it.
                    if 2 * inside > self.turned.len() {
                        self.offer(Candidate { score: score / inside as f32, shift: [right, down], angle });
                    }
                }
            }
        }
        let overview_centre = [picture.width, picture.height].map(|n| (n as f64 - 1.0) / 2.0);
        let motion = move |candidate: &Candidate| Motion {
            shift_px: candidate.shift.map(|v| f64::from(v) * REDUCED as f64),
            rotation: rotation(candidate.angle),
            ..Motion::none(overview_centre)
        };
        self.best.iter().map(motion)
    }

    /// Keeps a candidate if it is among the best and better than its neighbours.
    fn offer(&mut self, candidate: Candidate) {
        if self.best.len() == CANDIDATES && self.best[CANDIDATES - 1].score >= candidate.score {
            return;
        }
        let near = |other: &Candidate| {
            (0..2).all(|k| other.shift[k].abs_diff(candidate.shift[k]) <= 2)
                && other.angle.abs_diff(candidate.angle) <= 2
        };
        if self.best.iter().any(|other| near(other) && other.score >= candidate.score) {
            return;
        }
        self.best.retain(|other| !near(other));
        let place = self.best.partition_point(|other| other.score >= candidate.score);
        self.best.insert(place, candidate);
        self.best.truncate(CANDIDATES);
    }
}

fn rotation(angle: usize) -> f64 {
    (angle as f64 - ANGLES as f64) * APART
}

impl Edges {
    fn of(&mut self, overview: &Overview) {
        let Self { small, filtered, doubled } = self;
        (small.width, small.height) = (overview.width / REDUCED, overview.height / REDUCED);
        small.scale = overview.scale * REDUCED;
        small.codes.clear();
        small.codes.resize(small.width * small.height, 0.0);
        for y in 0..small.height * REDUCED {
            let line = &overview.codes[y * overview.width..][..small.width * REDUCED];
            let sums = &mut small.codes[y / REDUCED * small.width..][..small.width];
            for (sum, codes) in sums.iter_mut().zip(line.chunks_exact(REDUCED)) {
                *sum += codes.iter().sum::<f32>() / (REDUCED * REDUCED) as f32;
            }
        }
        filtered.make(small.width, small.height, &small.codes);
        doubled.clear();
        doubled.resize(small.codes.len(), [0.0; 2]);
        for y in 1..small.height.max(1) - 1 {
            for x in 1..small.width.max(1) - 1 {
                let [gx, gy] = filtered.gradient(x, y);
                let square = gx * gx + gy * gy;
                let share = 1.0 / (square + HALF * HALF);
                doubled[y * small.width + x] = [(gx * gx - gy * gy) * share, 2.0 * gx * gy * share];
            }
        }
    }
}
