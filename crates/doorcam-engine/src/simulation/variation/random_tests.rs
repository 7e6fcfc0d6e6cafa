use super::*;
use crate::simulation::Walk;
use crate::simulation::scenario::WallName;
use doorcam_core::geometry::{Point, Side};

/// As many as docs/simulator.md counts.
const ROOMS: u64 = 500;

fn room(seed: u64) -> Scenario {
    Scenario::random(seed, None).unwrap()
}

/// Whether some place of the watched floor sees some place of a light past the edges and under the lintel.
fn sees_a_light(scenario: &Scenario) -> bool {
    let door = &scenario.doorway;
    let thickness = door.wall_thickness_m;
    let floor: Vec<Point> = [-1.0, 1.0]
        .into_iter()
        .flat_map(|side| (1..8).map(move |k| (side, f64::from(k) * 0.04)))
        .flat_map(|(side, beside)| {
            let x = side * (door.half_width() + beside);
            [0.05, 0.15, 0.28].map(|away| [x, -thickness - away])
        })
        .collect();
    let room = &scenario.room;
    let on_wall = |wall: WallName, along: f64, z: f64| match wall {
        WallName::Left => [-room.half_width_m, along, z],
        WallName::Back => [along, room.depth_m, z],
        WallName::Right => [room.half_width_m, along, z],
    };
    let lamps = scenario.lamp.iter().map(|lamp| lamp.at_m);
    let windows = scenario.window.iter().flat_map(|w| {
        (1..4).map(move |k| {
            let along = w.along_m[0] + f64::from(k) / 4.0 * (w.along_m[1] - w.along_m[0]);
            on_wall(w.wall, along, (w.up_m[0] + w.up_m[1]) / 2.0)
        })
    });
    let places: Vec<[f64; 3]> = lamps.chain(windows).collect();
    floor.iter().any(|&[x, y]| {
        places.iter().any(|at| {
            [0.0, -thickness].into_iter().all(|face| {
                let share = (face - y) / (at[1] - y);
                (x + share * (at[0] - x)).abs() < door.half_width()
                    && share * at[2] < door.height_m.unwrap_or(f64::INFINITY)
            })
        })
    })
}

/// The published shares, and that each room is valid, nobody is in a wall, in furniture or in another one, and as many
/// people are there as the seed or the user says.
#[test]
fn five_hundred_rooms_have_the_published_shares() {
    let rooms: Vec<Scenario> = (0..ROOMS).map(room).collect();
    for (seed, scenario) in rooms.iter().enumerate() {
        scenario.check().unwrap_or_else(|e| panic!("{seed}: {e}"));
        assert!((1..=MOST_PEOPLE).contains(&scenario.person.len()), "{seed}");
        assert!((scenario.duration_s, scenario.fps, scenario.background_s) == (20.0, 5.0, 5.0));
        people_are_where_people_can_be(seed, scenario);
    }
    let share = |what: &dyn Fn(&Scenario) -> bool| rooms.iter().filter(|s| what(s)).count() as f64 / ROOMS as f64;
    let people: Vec<&PersonSpec> = rooms.iter().flat_map(|s| &s.person).collect();
    let of_people =
        |what: &dyn Fn(&PersonSpec) -> bool| people.iter().filter(|p| what(p)).count() as f64 / people.len() as f64;
    let all_dark = |p: &PersonSpec| p.clothes.iter().all(|c| *c < 0.1);
    let found = [
        ("a light is seen", share(&sees_a_light), 0.60..0.85),
        ("window", share(&|s| !s.window.is_empty()), 0.22..0.34),
        ("sun", share(&|s| s.window.iter().any(|w| w.sun.is_some())), 0.03..0.12),
        ("television", share(&|s| !s.television.is_empty()), 0.1..0.2),
        ("leaf", share(&|s| s.leaf.is_some()), 0.30..0.42),
        ("glossy", share(&|s| s.floor.gloss > 0.0), 0.30..0.42),
        ("thin wall", share(&|s| s.doorway.wall_thickness_m == 0.0), 0.06..0.14),
        ("one person", share(&|s| s.person.len() == 1), 0.34..0.46),
        ("four people", share(&|s| s.person.len() == 4), 0.06..0.14),
        ("furniture", share(&|s| !s.furniture.is_empty()), 0.55..0.9),
        ("limbs", of_people(&|p| p.limbs), 0.5..0.68),
        ("dark clothes", of_people(&all_dark), 0.22..0.36),
        ("far places", of_people(&|p| p.walk.iter().any(|w| w.2 > 3.0)), 0.25..0.6),
    ];
    println!("{found:?}");
    for (what, share, expected) in found {
        assert!(expected.contains(&share), "{what}: {share}");
    }
    for s in &rooms {
        assert!((0.7..=1.0).contains(&s.doorway.width_m) && (0.0..=0.3).contains(&s.doorway.wall_thickness_m));
        assert!((5000.0..=30000.0).contains(&s.camera.full_scale_electrons));
        assert!((80..=95).contains(&s.camera.quality));
    }
}

fn people_are_where_people_can_be(seed: usize, scenario: &Scenario) {
    let walks: Vec<Walk> = scenario.person.iter().map(Scenario::walk).collect();
    let room = &scenario.room;
    for k in 0..300 {
        let t = f64::from(k) / 20.0;
        let there: Vec<Point> = walks.iter().filter_map(|walk| walk.at(t)).collect();
        for (i, &[x, y]) in there.iter().enumerate() {
            let told = || format!("{seed}: [{x}, {y}] at {t} s");
            assert!(y > 0.45 && y < room.depth_m - 0.25 && y < 4.35, "{}", told());
            for f in &scenario.furniture {
                let outside = x < f.x_m[0] - 0.2 || x > f.x_m[1] + 0.2 || y < f.y_m[0] - 0.2 || y > f.y_m[1] + 0.2;
                assert!(outside, "{}: {f:?}", told());
            }
            for &[a, b] in &there[..i] {
                assert!((x - a).hypot(y - b) > 0.45, "{}: [{a}, {b}]", told());
            }
        }
    }
}

#[test]
fn a_seed_gives_one_room_and_any_number_of_people_can_be_in_it() {
    assert_eq!(room(7), room(7));
    assert_ne!(room(7), room(8));
    for count in 1..=MOST_PEOPLE {
        let scenario = Scenario::random(7, Some(count)).unwrap();
        assert_eq!(scenario.person.len(), count);
        // The room itself is the same.
        assert_eq!((scenario.room, &scenario.window), (room(7).room, &room(7).window));
    }
    assert!((0..40).all(|seed| Scenario::random(seed, Some(4)).unwrap().person.len() == 4));
    let error = Scenario::random(7, Some(5)).unwrap_err().to_string();
    assert_eq!(error, "5 people: expected 1 to 4");
    assert!(room(3).leaf.is_none_or(|leaf| leaf.hinge == Side::Left || leaf.hinge == Side::Right));
}
