use super::surfaces::{BANDS, BETWEEN_M, CEILING_M, Surfaces};
use crate::geometry::{FoundLight, Room};
use crate::scene::Rgb;

/// A surface of the hidden room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The wall at x = −half_width.
    LeftWall,
    /// The wall opposite the doorway.
    BackWall,
    /// The wall at x = +half_width.
    RightWall,
    /// The ceiling.
    Ceiling,
}

/// Something that shines brighter than the walls around it: a window, a lamp, a lit wall. Its direction is well known,
/// its height and distance less so: it is told as if it were on a wall or on the ceiling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightThing {
    /// Where it is.
    pub place: Place,
    /// Extent along the wall, in metres in the door frame, the smaller one first: y on a side wall, x on the back wall
    /// and the ceiling.
    pub along_m: [f64; 2],
    /// Extent in height; on the ceiling, extent along y.
    pub up_m: [f64; 2],
    /// How much brighter its radiance is than what is usual in the room: light on the floor per steradian, relative to
    /// full scale.
    pub rgb: Rgb,
}

impl BrightThing {
    /// Where it is in a room with walls at `room`.
    pub fn in_room(&self, room: Room) -> FoundLight {
        let [a, b] = self.along_m;
        let ([from_m, to_m], height_m) = match self.place {
            Place::LeftWall => ([[-room.half_width_m, a], [-room.half_width_m, b]], self.up_m),
            Place::RightWall => ([[room.half_width_m, a], [room.half_width_m, b]], self.up_m),
            Place::BackWall => ([[a, room.depth_m], [b, room.depth_m]], self.up_m),
            Place::Ceiling => {
                let middle = 0.5 * (self.up_m[0] + self.up_m[1]);
                ([[a, middle], [b, middle]], [CEILING_M, CEILING_M])
            }
        };
        FoundLight { from_m, to_m, height_m, rgb: self.rgb }
    }
}

/// How many times as bright as the median of its kind of surface something must be.
const BRIGHTER: f64 = 2.5;

/// Median of the grey radiances of the walls and of the ceiling.
fn usual(surfaces: &Surfaces, radiance: &[Rgb]) -> [f64; 2] {
    let (walls, ceiling) = radiance[..surfaces.of_room()].split_at(surfaces.of_walls());
    [walls, ceiling].map(|pieces| {
        let mut sorted: Vec<f64> = pieces.iter().map(grey).collect();
        let middle = sorted.len() / 2;
        if sorted.is_empty() { 0.0 } else { *sorted.select_nth_unstable_by(middle, f64::total_cmp).1 }
    })
}

/// What is brighter than this many times the median counts as excess: walls are lit unevenly.
const MARGIN: f64 = 1.5;

/// Directions nearer to the doorway's wall than this, in radians, as those for which there is no facet of the map: few
/// floor points see them, and what the fit finds there is light of the visible side that changes along the wall.
const GRAZING: f64 = std::f64::consts::PI / 8.0;

/// Whether a piece of a wall is seen in a grazing direction.
fn is_grazing(surfaces: &Surfaces, piece: usize) -> bool {
    let strip = piece / BANDS;
    let (place, along) = surfaces.at(0.5 * (surfaces.start(strip) + surfaces.start(strip + 1)));
    matches!(place, Place::LeftWall | Place::RightWall) && along < surfaces.room().half_width_m * GRAZING.tan()
}

/// The part of each piece's radiance by which it is brighter than usual.
pub(super) fn excess(surfaces: &Surfaces, radiance: &[Rgb]) -> Vec<Rgb> {
    let [wall, ceiling] = usual(surfaces, radiance);
    let part = |(piece, rgb): (usize, &Rgb)| {
        let of_wall = piece < surfaces.of_walls();
        if of_wall && is_grazing(surfaces, piece) {
            return [0.0; 3];
        }
        let usual = if of_wall || piece >= surfaces.of_room() { wall } else { ceiling };
        let share = (1.0 - MARGIN * usual / grey(rgb).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        rgb.map(|radiance| share * radiance)
    };
    radiance.iter().enumerate().map(part).collect()
}

fn grey(rgb: &Rgb) -> f64 {
    rgb.iter().sum::<f64>() / 3.0
}

/// The bright things, the one with the most light first.
pub(super) fn find(surfaces: &Surfaces, radiance: &[Rgb]) -> Vec<BrightThing> {
    let [wall, ceiling] = usual(surfaces, radiance);
    let walls = surfaces.of_walls();
    let usual = |piece: usize| if piece < walls { wall } else { ceiling };
    let is_told = |piece: usize| piece >= walls || !is_grazing(surfaces, piece);
    let is_bright =
        |piece: usize| is_told(piece) && grey(&radiance[piece]) > BRIGHTER * usual(piece).max(f64::MIN_POSITIVE);
    let mut things = Vec::new();
    for band in 0..BANDS {
        let up_m = [
            if band == 0 { 0.0 } else { BETWEEN_M[band - 1] },
            if band + 1 == BANDS { CEILING_M } else { BETWEEN_M[band] },
        ];
        let pieces: Vec<usize> = (0..surfaces.strips()).map(|strip| strip * BANDS + band).collect();
        let place = |piece: &usize| {
            let strip = piece / BANDS;
            surfaces.at(0.5 * (surfaces.start(strip) + surfaces.start(strip + 1))).0
        };
        let same = |a: &usize, b: &usize| is_bright(*a) == is_bright(*b) && place(a) == place(b);
        for run in pieces.chunk_by(same).filter(|run| is_bright(run[0])) {
            let ends = [surfaces.start(run[0] / BANDS) + 1e-6, surfaces.start(run[run.len() - 1] / BANDS + 1) - 1e-6]
                .map(|along| surfaces.at(along).1);
            let along_m = [ends[0].min(ends[1]), ends[0].max(ends[1])];
            things.push(thing(place(&run[0]), along_m, up_m, run, radiance, wall));
        }
    }
    let ([across, deep], room) = (surfaces.cells(), surfaces.room());
    let x = |column: usize| room.half_width_m * (2.0 * column as f64 / across as f64 - 1.0);
    let y = |row: usize| room.depth_m * row as f64 / deep as f64;
    for row in 0..deep {
        let pieces: Vec<usize> = (0..across).map(|column| walls + row * across + column).collect();
        let same = |a: &usize, b: &usize| is_bright(*a) == is_bright(*b);
        for run in pieces.chunk_by(same).filter(|run| is_bright(run[0])) {
            let from = (run[0] - walls) % across;
            let along_m = [x(from), x(from + run.len())];
            things.push(thing(Place::Ceiling, along_m, [y(row), y(row + 1)], run, radiance, ceiling));
        }
    }
    let size = |[a, b]: [f64; 2]| b - a;
    let strength = |thing: &BrightThing| grey(&thing.rgb) * size(thing.along_m) * size(thing.up_m);
    things.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
    things
}

fn thing(place: Place, along_m: [f64; 2], up_m: [f64; 2], run: &[usize], radiance: &[Rgb], usual: f64) -> BrightThing {
    let mean = |c: usize| run.iter().map(|&piece| radiance[piece][c]).sum::<f64>() / run.len() as f64;
    BrightThing { place, along_m, up_m, rgb: [0, 1, 2].map(|c| (mean(c) - usual).max(0.0)) }
}
