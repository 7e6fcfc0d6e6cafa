use crate::geometry::{Doorway, Point, Room, RoomLight};
use crate::transport::{FloorView, share};

/// Number of bands of height into which each strip of a wall is divided.
pub(super) const BANDS: usize = 3;
/// Heights between the bands, in metres: below the usual window sill, and to the top of windows.
pub(super) const BETWEEN_M: [f64; BANDS - 1] = [0.9, 2.1];
/// Height of the ceiling, in metres.
pub(super) const CEILING_M: f64 = 2.6;
/// Width of a strip of wall, in metres.
const STRIP_M: f64 = 0.2;
/// Side of a cell of the ceiling, in metres.
const CELL_M: f64 = 0.4;
/// Azimuths in which a floor point looks at the room.
pub(super) const NODES: usize = 96;
/// Elevations, as equal steps of sin².
pub(super) const LEVELS: usize = 24;

/// The walls of the hidden room (left, back, right) in upright strips and bands of height, its ceiling in cells, and lights
/// that somebody has described, each one piece.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Surfaces {
    room: Room,
    lights: Vec<RoomLight>,
}

/// A described light in a few azimuths of a floor point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shining {
    /// Its number among the lights.
    pub number: usize,
    /// The share of these azimuths in which it is.
    pub share: f64,
    /// Squared distance on the floor plan, in m².
    pub distance2: f64,
    /// Sin² of the elevations of its lower and its upper edge.
    pub elevations: [f64; 2],
}

/// One direction in which a floor point looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    pub node: usize,
    pub level: usize,
    /// The piece of a surface that is met.
    pub piece: usize,
    /// Light per unit radiance of the piece.
    pub light: f64,
}

impl Surfaces {
    /// The surfaces of a room, and those of its `lights` that are lit.
    pub fn new(room: Room, lights: &[RoomLight]) -> Self {
        Self { room, lights: lights.iter().copied().filter(|light| light.on).collect() }
    }

    /// Number of lights.
    pub fn lights(&self) -> usize {
        self.lights.len()
    }

    /// The lights that a floor point sees between two azimuths.
    pub fn shining(&self, point: Point, [first, last]: [f64; 2]) -> impl Iterator<Item = Shining> {
        let cross = |a: Point, b: Point| a[0] * b[1] - a[1] * b[0];
        self.lights.iter().enumerate().filter_map(move |(number, light)| {
            let [from, to] = [light.from_m, light.to_m].map(|end| [end[0] - point[0], end[1] - point[1]]);
            let [a, b] = [from, to].map(|end| end[0].atan2(end[1]));
            let (begin, end) = (a.min(b).max(first), a.max(b).min(last));
            if end <= begin {
                return None;
            }
            let (sine, cosine) = (0.5 * (begin + end)).sin_cos();
            let along = [to[0] - from[0], to[1] - from[1]];
            let distance2 = (cross(from, along) / cross([sine, cosine], along)).powi(2);
            let elevations = light.height_m.map(|height_m| share(height_m, distance2));
            Some(Shining { number, share: (end - begin) / (last - first), distance2, elevations })
        })
    }

    pub fn room(&self) -> Room {
        self.room
    }

    /// Length of the three walls, in metres, from the left front corner to the right front corner.
    fn length(&self) -> f64 {
        2.0 * (self.room.depth_m + self.room.half_width_m)
    }

    pub fn strips(&self) -> usize {
        2 * (self.length() / (2.0 * STRIP_M)).ceil() as usize
    }

    /// Number of pieces of the walls; those of the ceiling follow, and the lights after them.
    pub fn of_walls(&self) -> usize {
        self.strips() * BANDS
    }

    /// Cells of the ceiling, across and in depth.
    pub fn cells(&self) -> [usize; 2] {
        [2.0 * self.room.half_width_m, self.room.depth_m].map(|length| (length / CELL_M).ceil() as usize)
    }

    /// Number of pieces of the walls and of the ceiling.
    pub fn of_room(&self) -> usize {
        let [across, deep] = self.cells();
        self.of_walls() + across * deep
    }

    pub fn pieces(&self) -> usize {
        self.of_room() + self.lights()
    }

    /// Pairs of neighbouring pieces.
    pub fn neighbours(&self) -> Vec<(usize, usize)> {
        let (strips, walls, [across, deep]) = (self.strips(), self.of_walls(), self.cells());
        let mut pairs = Vec::new();
        for strip in 0..strips {
            for band in 0..BANDS {
                let piece = strip * BANDS + band;
                if strip + 1 < strips {
                    pairs.push((piece, piece + BANDS));
                }
                if band + 1 < BANDS {
                    pairs.push((piece, piece + 1));
                }
            }
        }
        for row in 0..deep {
            for column in 0..across {
                let piece = walls + row * across + column;
                if column + 1 < across {
                    pairs.push((piece, piece + 1));
                }
                if row + 1 < deep {
                    pairs.push((piece, piece + across));
                }
            }
        }
        pairs
    }

    /// Where a strip begins, in metres along the walls; that of the strip after the last is their end.
    pub fn start(&self, strip: usize) -> f64 {
        self.length() * strip as f64 / self.strips() as f64
    }

    /// The wall that is met this many metres along the walls, and the coordinate there that changes along it.
    pub fn at(&self, along: f64) -> (super::Place, f64) {
        let Room { half_width_m, depth_m } = self.room;
        if along < depth_m {
            (super::Place::LeftWall, along)
        } else if along <= depth_m + 2.0 * half_width_m {
            (super::Place::BackWall, along - depth_m - half_width_m)
        } else {
            (super::Place::RightWall, self.length() - along)
        }
    }

    /// Calls `each` for what a floor point sees in each direction in which it looks at the room; more than once for a
    /// direction in which there is a light.
    pub fn look(&self, doorway: &Doorway, view: &FloorView, mut each: impl FnMut(Look)) {
        let Room { half_width_m, depth_m } = self.room;
        let ([x, y], [first, last]) = (view.point(), view.azimuths());
        if last <= first {
            return;
        }
        let width = (last - first) / NODES as f64;
        let step = 1.0 / LEVELS as f64;
        let [across, deep] = self.cells();
        let mut lights = Vec::with_capacity(self.lights());
        for node in 0..NODES {
            let (sine, cosine) = (first + (node as f64 + 0.5) * width).sin_cos();
            lights.clear();
            lights.extend(self.shining([x, y], [0, 1].map(|k| first + (node + k) as f64 * width)));
            lights.sort_by(|a: &Shining, b| a.distance2.total_cmp(&b.distance2));
            let behind = (depth_m - y) / cosine;
            let beside = (half_width_m.copysign(sine) - x) / sine;
            // Infinite for a ray along y, which meets no side wall; negative if the wall lies behind the floor point.
            let side = beside > 0.0 && beside < behind;
            let distance = if side { beside } else { behind };
            let met = [x + distance * sine, y + distance * cosine];
            let along = match side {
                true if sine < 0.0 => met[1].max(0.0),
                true => self.length() - met[1].max(0.0),
                false => depth_m + half_width_m + met[0],
            };
            let strip = ((along / self.length() * self.strips() as f64) as usize).min(self.strips() - 1);
            let open = view.lintel(doorway, cosine * cosine);
            for level in 0..LEVELS {
                let mut part = (open - level as f64 * step).min(step);
                if part <= 0.0 {
                    break;
                }
                let [below, above] = [level as f64 * step, level as f64 * step + part];
                for light in &lights {
                    let [lower, upper] = light.elevations;
                    let lit = (light.share * (upper.min(above) - lower.max(below))).clamp(0.0, part);
                    part -= lit;
                    if lit > 0.0 {
                        each(Look { node, level, piece: self.of_room() + light.number, light: 0.5 * width * lit });
                    }
                }
                let s = (level as f64 + 0.5) * step;
                let slope = (s / (1.0 - s)).sqrt();
                let height = distance * slope;
                let piece = if height < CEILING_M {
                    strip * BANDS + BETWEEN_M.iter().filter(|&&top| height > top).count()
                } else {
                    let away = CEILING_M / slope;
                    let column = (x + away * sine + half_width_m) / (2.0 * half_width_m) * across as f64;
                    let row = (y + away * cosine).max(0.0) / depth_m * deep as f64;
                    self.of_walls() + (row as usize).min(deep - 1) * across + (column.max(0.0) as usize).min(across - 1)
                };
                each(Look { node, level, piece, light: 0.5 * width * part });
            }
        }
    }
}
