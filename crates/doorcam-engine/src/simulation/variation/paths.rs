use super::draw::Draw;
use crate::simulation::scenario::Scenario;
use doorcam_core::geometry::Point;

/// Who is at least this far before the wall is not in the picture, in metres.
const OUT_OF_SIGHT_M: f64 = 1.7;
/// Room that somebody needs beside their axis to go through a door, in metres.
const SHOULDERS_M: f64 = 0.3;
/// How far behind a side wall somebody is gone, in metres.
const BEHIND_WALL_M: f64 = 0.4;

/// Where people can walk.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    pub(super) half_door: f64,
    pub(super) thickness: f64,
    half_width: f64,
    pub(super) depth: f64,
}

/// A way that is made piece by piece.
pub(super) struct Path(Vec<(f64, f64, f64)>);

impl Path {
    pub(super) fn from(seconds: f64, [x, y]: Point) -> Self {
        Self(vec![(seconds, x, y)])
    }

    fn end(&self) -> (f64, f64, f64) {
        self.0[self.0.len() - 1]
    }

    /// When its end is reached.
    pub(super) fn time(&self) -> f64 {
        self.end().0
    }

    /// Goes on to a place, at a speed in metres a second.
    pub(super) fn to(&mut self, [x, y]: Point, speed: f64) {
        let (t, from_x, from_y) = self.end();
        self.0.push((t + ((x - from_x).hypot(y - from_y) / speed).max(0.05), x, y));
    }

    pub(super) fn wait(&mut self, seconds: f64) {
        let (t, x, y) = self.end();
        self.0.push((t + seconds, x, y));
    }

    pub(super) fn done(self) -> Vec<(f64, f64, f64)> {
        self.0
    }

    /// The same way back, from `seconds` on.
    fn reversed(self, seconds: f64) -> Vec<(f64, f64, f64)> {
        let end = self.time();
        self.0.into_iter().rev().map(|(t, x, y)| (seconds + end - t, x, y)).collect()
    }
}

impl Room {
    pub(super) fn of(scenario: &Scenario) -> Self {
        Self {
            half_door: scenario.doorway.half_width(),
            thickness: scenario.doorway.wall_thickness_m,
            half_width: scenario.room.half_width_m,
            depth: scenario.room.depth_m,
        }
    }

    /// A place before the door that the camera does not see.
    fn outside(&self, draw: &mut Draw) -> Point {
        [draw.between(-0.6, 0.6), -self.thickness - OUT_OF_SIGHT_M - draw.between(0.0, 0.25)]
    }

    /// Places before and behind the opening, in line with it.
    fn door(&self, draw: &mut Draw) -> [Point; 2] {
        let aside = (self.half_door - SHOULDERS_M).max(0.0);
        let x = draw.between(-aside, aside);
        [[x, -self.thickness - 0.35], [(x + draw.between(-0.05, 0.05)).clamp(-aside, aside), 0.3]]
    }

    /// A place in the room.
    fn inside(&self, draw: &mut Draw, deepest: f64) -> Point {
        let wide = (self.half_width - 0.4).min(0.9);
        [draw.between(-wide, wide), draw.between(0.8, deepest)]
    }

    /// In through the door, to two places, and out again.
    pub(super) fn in_and_out(&self, draw: &mut Draw, speed: f64, deepest: f64, time: f64) -> Vec<(f64, f64, f64)> {
        let start = draw.between(0.1, 0.6);
        let [before, behind] = self.door(draw);
        let [after, leaving] = self.door(draw);
        let places = [self.inside(draw, deepest), self.inside(draw, deepest)];
        let away = self.outside(draw);
        let mut path = Path::from(start, self.outside(draw));
        path.to(before, speed);
        path.to(behind, speed);
        let far = |a: Point, b: Point| (a[0] - b[0]).hypot(a[1] - b[1]);
        // What is left for the room, where nobody runs: places too far away move towards the door.
        let outwards = (far(leaving, after) + far(after, away)) / speed;
        let left = time - path.time() - outwards;
        let length = |places: &[Point; 2]| far(behind, places[0]) + far(places[0], places[1]) + far(places[1], leaving);
        let most = 1.2 * speed * left;
        let nearer = (most / length(&places)).min(1.0);
        let places = places.map(|[x, y]| [nearer * x, 0.3 + nearer * (y - 0.3)]);
        let slack = left - length(&places) / (1.2 * speed);
        let pause = if draw.chance(0.5) { (slack * draw.between(0.3, 0.8)).clamp(0.0, 2.0) } else { 0.0 };
        let pace = (length(&places) / (left - pause)).max(0.5 * speed);
        path.to(places[0], pace);
        if pause > 0.2 {
            path.wait(pause);
        }
        path.to(places[1], pace);
        path.to(leaving, pace);
        path.to(after, speed);
        path.to(away, speed);
        path.done()
    }

    /// In through the door, and away through another entrance in a side wall.
    pub(super) fn only_in(&self, draw: &mut Draw, speed: f64, deepest: f64, time: f64) -> Vec<(f64, f64, f64)> {
        let start = draw.between(0.1, 0.6);
        self.through(draw, speed, deepest, start, time).done()
    }

    /// Into the room through another entrance in a side wall, and out through the door.
    pub(super) fn only_out(&self, draw: &mut Draw, speed: f64, deepest: f64, time: f64) -> Vec<(f64, f64, f64)> {
        let start = draw.between(0.1, 0.6);
        self.through(draw, speed, deepest, 0.0, time - start).reversed(start)
    }

    fn through(&self, draw: &mut Draw, speed: f64, deepest: f64, start: f64, time: f64) -> Path {
        let [before, behind] = self.door(draw);
        let mut path = Path::from(start, self.outside(draw));
        path.to(before, speed);
        path.to(behind, speed);
        let [x, y] = self.inside(draw, deepest);
        let side = draw.sign();
        let gone = [side * (self.half_width + BEHIND_WALL_M), y];
        let length = (x - behind[0]).hypot(y - behind[1]) + (gone[0] - x).abs();
        let pace = speed.min(0.9).max(length / (time - path.time()));
        path.to([x, y], pace);
        path.to(gone, pace);
        path
    }

    /// To the threshold and back.
    pub(super) fn turn_around(&self, draw: &mut Draw, speed: f64) -> Vec<(f64, f64, f64)> {
        let start = draw.between(0.1, 0.6);
        let [before, _] = self.door(draw);
        let turn = [before[0], -self.thickness * draw.between(0.6, 1.2)];
        let mut path = Path::from(start, self.outside(draw));
        path.to(before, speed);
        path.to(turn, 0.7 * speed);
        path.wait(draw.between(0.4, 1.2));
        path.to(before, 0.7 * speed);
        path.to(self.outside(draw), speed);
        path.done()
    }

    /// From one side wall to the other and, if there is time, back, between two depths.
    pub(super) fn across(&self, draw: &mut Draw, [near, far]: [f64; 2], start: f64, end: f64) -> Vec<(f64, f64, f64)> {
        let far = far.max(near);
        let wide = (self.half_width - 0.35).min(1.0);
        let mut side = draw.sign();
        let depth = draw.between(near, far);
        let mut path = Path::from(start, [side * (self.half_width + BEHIND_WALL_M), depth]);
        let speed = draw.between(0.5, 0.8);
        // Time for the way out from the farther side.
        let leave = |path: &Path, side: f64| {
            let (t, x, _) = path.end();
            t + (side * (self.half_width + BEHIND_WALL_M) - x).abs() / speed
        };
        path.to([side * wide, depth], speed);
        loop {
            let next = [-side * draw.between(0.3, 1.0) * wide, draw.between(near, far)];
            let (t, x, y) = path.end();
            let arrives = t + (next[0] - x).hypot(next[1] - y) / speed;
            if arrives + (self.half_width + BEHIND_WALL_M + next[0].abs()) / speed > end {
                break;
            }
            path.to(next, speed);
            side = -side;
        }
        let (_, x, y) = path.end();
        let nearer = if x < 0.0 { -1.0 } else { 1.0 };
        // Slowly, if there is time, so that somebody is there for as long as it goes.
        let slow = (speed * (leave(&path, nearer) - path.time()) / (end - path.time()).max(0.1)).clamp(0.35, 2.0);
        path.to([nearer * (self.half_width + BEHIND_WALL_M), y], slow);
        path.done()
    }

    /// Along the wall at a distance from it; `way` is 1 to the right.
    pub(super) fn past(
        &self,
        draw: &mut Draw,
        distance: f64,
        speed: f64,
        way: f64,
        start: f64,
    ) -> Vec<(f64, f64, f64)> {
        let y = -self.thickness - distance;
        let mut path = Path::from(start, [-2.2 * way, y]);
        path.to([0.0, y], speed);
        // A little closer or farther, but never closer than 0.3 m.
        path.to([2.2 * way, y - draw.between(0.0, 0.1)], speed);
        path.done()
    }
}
