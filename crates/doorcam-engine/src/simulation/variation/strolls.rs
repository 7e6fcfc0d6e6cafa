use super::draw::Draw;
use super::{person, rooms};
use crate::simulation::Walk;
use crate::simulation::scenario::{PersonSpec, Scenario};
use doorcam_core::geometry::Point;

/// Most people in a room.
pub(super) const MOST_PEOPLE: usize = 4;
/// Least distance between the axes of two people, and from an axis to furniture, in metres.
const APART_M: f64 = 0.55;
const BESIDE_M: f64 = 0.32;
/// People go to places from this far to this far behind the doorway, in metres, and not nearer to walls than that.
const NEAREST_M: f64 = 0.6;
const FARTHEST_M: f64 = 4.1;
const FROM_WALL_M: f64 = 0.4;
/// How far behind a side wall somebody is gone, in metres.
const BEHIND_WALL_M: f64 = 0.45;
/// Walks that are tried for a person, and times that all people are tried together.
const TRIES: usize = 300;
const ROUNDS: u32 = 16;
/// Steps at which walks are compared, in seconds.
const STEP_S: f64 = 0.05;
/// Shares of people with limbs, in clothes that are dark or like a wall, and who are there from the first frame on.
const LIMBS: f64 = 0.6;
const PLAIN: f64 = 0.57;
const THERE: f64 = 0.25;

/// Adds people to a room: so many, or one to four. Returns how many.
pub(super) fn people(scenario: &mut Scenario, draw: &mut Draw, wanted: Option<usize>) -> usize {
    let drawn = match draw.between(0.0, 1.0) {
        0.0..0.4 => 1,
        0.4..0.7 => 2,
        0.7..0.9 => 3,
        _ => MOST_PEOPLE,
    };
    let count = wanted.unwrap_or(drawn);
    for round in 0..ROUNDS {
        if round == ROUNDS / 2 {
            // Too little room.
            scenario.furniture.clear();
        }
        scenario.person.clear();
        // The longer it takes, the shorter people stay.
        let hurry = f64::from(round) / f64::from(ROUNDS);
        let whole = (0..count).all(|_| one(scenario, draw, hurry));
        if whole {
            return count;
        }
    }
    scenario.person.len()
}

/// Adds somebody whose walk is free; false if none is found.
fn one(scenario: &mut Scenario, draw: &mut Draw, hurry: f64) -> bool {
    let others: Vec<Walk> = scenario.person.iter().map(Scenario::walk).collect();
    for _ in 0..TRIES {
        let walk = stroll(scenario, draw, hurry);
        let path = Walk { waypoints: walk.iter().map(|&(t, x, y)| (t, [x, y])).collect(), period_s: None };
        if is_free(scenario, &path, &others) {
            let somebody = dressed(scenario, draw, walk);
            scenario.person.push(somebody);
            return true;
        }
    }
    false
}

/// A walk from place to place; most come in through a side wall and leave through one.
fn stroll(scenario: &Scenario, draw: &mut Draw, hurry: f64) -> Vec<(f64, f64, f64)> {
    let room = &scenario.room;
    let end = scenario.duration_s - scenario.background_s - super::GONE_S;
    let wide = room.half_width_m - FROM_WALL_M;
    let deep = (room.depth_m - FROM_WALL_M).min(FARTHEST_M);
    let place = |draw: &mut Draw| -> Point {
        // Of five places, two are near: as many degrees of azimuth as far away.
        let far = if draw.chance(0.4) { deep.min(2.2) } else { deep };
        [draw.between(-wide, wide), draw.between(NEAREST_M, far)]
    };
    let gate =
        |draw: &mut Draw| -> Point { [draw.sign() * (room.half_width_m + BEHIND_WALL_M), draw.between(0.8, deep)] };
    let there = draw.chance(THERE) && hurry == 0.0;
    let stays = end * (1.0 - 0.7 * hurry);
    let starts = if there { 0.0 } else { draw.between(0.0, 2.0 + (end - stays)) };
    let end = if there { end } else { end.min(starts + stays) };
    let speed = draw.between(0.4, 1.1);
    let mut way: Vec<(f64, f64, f64)> = Vec::new();
    let mut at = if there { place(draw) } else { gate(draw) };
    let mut time = starts;
    way.push((time, at[0], at[1]));
    loop {
        let pace = speed * draw.between(0.8, 1.2);
        let next = place(draw);
        let length = (next[0] - at[0]).hypot(next[1] - at[1]);
        let out = (room.half_width_m + BEHIND_WALL_M - next[0].abs()) / speed;
        let arrives = time + (length / pace).max(0.3);
        if arrives + if there { 0.0 } else { out } > end {
            break;
        }
        // Nobody turns on the spot at speed.
        if length < 0.5 {
            continue;
        }
        way.push((arrives, next[0], next[1]));
        (at, time) = (next, arrives);
        if draw.chance(0.2) {
            let pause = draw.between(0.5, 2.0);
            if time + pause + out < end {
                time += pause;
                way.push((time, at[0], at[1]));
            }
        }
    }
    if !there {
        let out = if at[0] < 0.0 { -1.0 } else { 1.0 } * (room.half_width_m + BEHIND_WALL_M);
        let leaves = time + ((out - at[0]).abs() / speed).max(0.3);
        way.push((leaves.min(end).max(time + 0.2), out, at[1]));
    }
    way
}

fn dressed(scenario: &Scenario, draw: &mut Draw, walk: Vec<(f64, f64, f64)>) -> PersonSpec {
    let plain = draw.chance(PLAIN);
    let albedo = &scenario.room.albedo;
    let wall = draw.pick(&[albedo.left, albedo.back, albedo.right]);
    let clothes =
        if draw.chance(0.5) { rooms::grey(draw, 0.03, 0.08, 0.01) } else { wall.map(|c| c * draw.between(0.92, 1.05)) };
    let mut somebody = person(draw, walk);
    somebody.limbs = draw.chance(LIMBS);
    let bright = draw.pick(&[
        [0.62, 0.07, 0.06],
        [0.06, 0.12, 0.55],
        [0.7, 0.69, 0.66],
        [0.08, 0.45, 0.12],
        [0.25, 0.25, 0.26],
        [0.6, 0.45, 0.28],
    ]);
    somebody.clothes = if plain { clothes.map(|c: f64| c.min(1.0)) } else { bright };
    let trousers = draw.pick(&[[0.08, 0.1, 0.2], [0.04, 0.04, 0.045], [0.2, 0.18, 0.15], [0.35, 0.3, 0.22]]);
    somebody.trousers = Some(trousers);
    somebody
}

/// Whether a walk keeps its distance from others, from furniture and the leaf, and stays in the room between its ends.
fn is_free(scenario: &Scenario, path: &Walk, others: &[Walk]) -> bool {
    let end = scenario.duration_s - scenario.background_s;
    let steps = (end / STEP_S) as usize;
    let room = &scenario.room;
    // Between the first and the last place in the room, nobody is in a wall.
    let count = path.waypoints.len();
    let inside = match (path.waypoints.get(1), path.waypoints.get(count.saturating_sub(2))) {
        (Some(second), Some(last)) => second.0..=last.0,
        _ => 0.0..=0.0,
    };
    let leaf = scenario.leaf.map(|leaf| {
        let side = if leaf.hinge == doorcam_core::geometry::Side::Left { -1.0 } else { 1.0 };
        let (sine, cosine) = leaf.angle_deg.to_radians().sin_cos();
        let hinge = [side * scenario.doorway.half_width(), 0.0];
        (hinge, [-side * cosine * leaf.width_m, sine * leaf.width_m])
    });
    (0..steps).all(|k| {
        let t = k as f64 * STEP_S;
        let Some([x, y]) = path.at(t) else { return true };
        let apart = others.iter().filter_map(|other| other.at(t)).all(|[a, b]| (x - a).hypot(y - b) > APART_M);
        let furniture = scenario.furniture.iter().all(|f| {
            let beyond = |at: f64, [from, to]: [f64; 2]| (from - at).max(at - to).max(0.0);
            beyond(x, f.x_m).hypot(beyond(y, f.y_m)) > BESIDE_M
        });
        let door = leaf.is_none_or(|(hinge, along)| {
            let d = [x - hinge[0], y - hinge[1]];
            let share = (d[0] * along[0] + d[1] * along[1]) / (along[0] * along[0] + along[1] * along[1]);
            let share = share.clamp(0.0, 1.0);
            (d[0] - share * along[0]).hypot(d[1] - share * along[1]) > BESIDE_M + 0.05
        });
        let in_wall = inside.contains(&t) && x.abs() > room.half_width_m - 0.25;
        apart && furniture && door && !in_wall && y > 0.5 && y < room.depth_m - 0.3
    })
}
