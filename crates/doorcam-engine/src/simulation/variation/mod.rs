//! Scenarios that are different with each seed: what comes with doorcam says what happens, and a seed where and how.

mod draw;
mod hall;
mod paths;
mod rooms;
mod strolls;

use super::scenario::{PersonSpec, Scenario};
use draw::Draw;
use paths::{Path, Room};

/// Seconds before the end of a round by which everybody has left.
const GONE_S: f64 = 0.2;

/// Changes a scenario.
type Vary = fn(&mut Scenario, &mut Draw);

/// The scenarios that vary.
const VARIED: [(&str, Vary); 4] = [("bag", bag), ("bump", bump), ("pass-by", pass_by), ("walk-through", walk_through)];

/// The scenario that is another room with each seed.
pub(super) const RANDOM: &str = "random";
/// Most people in it.
pub(super) const MOST_PEOPLE: usize = strolls::MOST_PEOPLE;

/// Makes a room, its door, camera and lights as the seed says, with so many people, or as many as the seed says.
pub(super) fn random(scenario: &mut Scenario, seed: u64, people: Option<usize>) {
    let mut draw = Draw::new(RANDOM, seed);
    scenario.ordinary = true;
    let light = rooms::room(scenario, &mut draw);
    let count = strolls::people(scenario, &mut draw, people);
    let who = match count {
        1 => "one person".into(),
        count => format!("{count} people"),
    };
    scenario.description = format!("{who} in an ordinary room, {light}");
}

/// Changes a scenario of that name as its seed says; those that do not vary remain as they are.
pub(super) fn vary(scenario: &mut Scenario, name: &str, seed: u64) {
    if name == RANDOM {
        return random(scenario, seed, None);
    }
    if let Some((_, vary)) = VARIED.iter().find(|(varied, _)| *varied == name) {
        let mut draw = Draw::new(name, seed);
        let light = hall::hall(scenario, &mut draw);
        vary(scenario, &mut draw);
        scenario.description = format!("{}, {light}", scenario.description);
    }
}

/// Seconds for which somebody may be there after the empty time.
fn time(scenario: &Scenario) -> f64 {
    scenario.duration_s - scenario.background_s - GONE_S
}

fn person(draw: &mut Draw, walk: Vec<(f64, f64, f64)>) -> PersonSpec {
    let [clothes, trousers] = [draw.cloth(), draw.cloth()];
    PersonSpec {
        radius_m: draw.between(0.17, 0.22),
        height_m: draw.between(1.55, 1.85),
        clothes,
        trousers: Some(trousers.map(|c| 0.6 * c)),
        limbs: false,
        skin: draw.pick(&[[0.03, 0.025, 0.02], [0.12, 0.07, 0.04], [0.3, 0.22, 0.12], [0.5, 0.36, 0.29]]),
        walk,
        repeat_s: None,
    }
}

fn walk_through(scenario: &mut Scenario, draw: &mut Draw) {
    let room = Room::of(scenario);
    let time = time(scenario);
    let other = draw.chance(0.5);
    let deepest = if other { (room.depth - 1.5).min(1.5) } else { (room.depth - 0.5).min(2.0) };
    let speed = draw.between(0.75, 1.5);
    let (what, walk) = match draw.between(0.0, 1.0) {
        0.0..0.6 => {
            ("somebody walks in through the doorway and out again", room.in_and_out(draw, speed, deepest, time))
        }
        0.6..0.75 => ("somebody walks in through the doorway", room.only_in(draw, speed, deepest, time)),
        0.75..0.9 => ("somebody walks out through the doorway", room.only_out(draw, speed, deepest, time)),
        _ => ("somebody turns around on the threshold", room.turn_around(draw, speed)),
    };
    scenario.person = vec![person(draw, walk)];
    scenario.description = format!("{what} at {speed:.2} m/s");
    if other {
        let walk = room.across(draw, [deepest + 0.6, room.depth - 0.4], 0.1, time);
        scenario.person.push(person(draw, walk));
        scenario.description += " while somebody else is in the room";
    }
}

fn pass_by(scenario: &mut Scenario, draw: &mut Draw) {
    let room = Room::of(scenario);
    let (speed, way) = (draw.between(0.8, 1.6), draw.sign());
    let start = draw.between(0.3, 1.2);
    let distance = draw.between(0.3, 1.5);
    let walk = room.past(draw, distance, speed, way, start);
    scenario.person = vec![person(draw, walk)];
    scenario.description = format!("somebody walks past the doorway, {distance:.2} m from the wall, at {speed:.2} m/s");
    if speed > 1.0 && draw.chance(0.4) {
        let start = start + draw.between(1.5, 2.5);
        let slower = speed * draw.between(0.9, 1.0);
        let distance = draw.between(0.3, 1.5);
        let walk = room.past(draw, distance, slower, way, start);
        scenario.person.push(person(draw, walk));
        scenario.description += ", and a second one";
    }
}

fn bag(scenario: &mut Scenario, draw: &mut Draw) {
    let room = Room::of(scenario);
    let side = draw.sign();
    let thickness = draw.between(0.12, 0.24);
    // All of it is before the wall.
    let away = draw.between(thickness / 2.0 + 0.02, 0.28);
    let at = [side * (room.half_door + draw.between(0.06, 0.28)), -room.thickness - away];
    let beside = [at[0] + side * 0.3, at[1] - 0.4];
    let far = [side * 2.6, at[1] - 0.5];
    let speed = draw.between(0.8, 1.3);
    let mut path = Path::from(0.5, far);
    path.to(beside, speed);
    let stands = path.time();
    path.wait(draw.between(1.0, 2.0));
    path.to(far, speed);
    let walk = room.across(draw, [1.0, room.depth - 0.4], 16.0, time(scenario));
    scenario.person = vec![person(draw, path.done()), person(draw, walk)];
    for object in &mut scenario.object {
        object.at_m = at;
        object.thickness_m = thickness;
        object.length_m = thickness * draw.between(1.2, 2.0);
        // Along the wall, more or less, so that it does not reach into it.
        object.turn_deg = draw.between(-8.0, 8.0);
        object.albedo = draw.cloth();
        object.from_s = stands + 0.6;
    }
    let name = if side < 0.0 { "left" } else { "right" };
    scenario.description = format!("somebody leaves a bag on the {name} patch, then another one walks in the room");
}

fn bump(scenario: &mut Scenario, draw: &mut Draw) {
    let room = Room::of(scenario);
    let at = draw.between(8.0, 12.0);
    let [shifts, turns] = draw.pick(&[[true, false], [true, false], [false, true], [true, true], [true, true]]);
    // As many small ones as large ones.
    let shift = if shifts { 2.0 * 20.0_f64.powf(draw.between(0.0, 1.0)) } else { 0.0 };
    let direction = draw.between(0.0, std::f64::consts::TAU);
    let turn = if turns { draw.sign() * draw.between(0.5, 3.0) } else { 0.0 };
    let [right, down] = if shifts { [shift * direction.cos(), shift * direction.sin()] } else { [0.0; 2] };
    scenario.camera.bump = vec![(at, right, down, turn)];
    scenario.description = format!("the camera is bumped by {shift:.1} pixels and {turn:.1} degrees");
    scenario.person.clear();
    if draw.chance(0.5) {
        let walk = room.across(draw, [1.0, room.depth - 0.4], 0.3, time(scenario));
        scenario.person.push(person(draw, walk));
        scenario.description += " while somebody is in the room";
    }
}

#[cfg(test)]
#[path = "variation_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "random_tests.rs"]
mod random_tests;
