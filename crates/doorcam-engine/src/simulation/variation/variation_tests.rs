use super::*;
use crate::simulation::Walk;

fn varied(name: &str, seed: u64) -> Scenario {
    Scenario::varied(name, seed).unwrap()
}

/// A hundred of each: valid, empty at both ends, nobody in a wall or in another one, and everything in its place.
#[test]
fn scenarios_with_any_seed_are_valid_and_people_are_where_people_can_be() {
    for (name, _) in VARIED {
        for seed in 0..100 {
            let scenario = varied(name, seed);
            scenario.check().unwrap_or_else(|e| panic!("{name} {seed}: {e}"));
            let walks: Vec<Walk> = scenario.person.iter().map(Scenario::walk).collect();
            let (half, thickness) = (scenario.doorway.half_width(), scenario.doorway.wall_thickness_m);
            let room = scenario.room;
            let end = scenario.duration_s - scenario.background_s;
            for k in 0..(end * 20.0) as usize {
                let t = k as f64 / 20.0;
                let there: Vec<[f64; 2]> = walks.iter().filter_map(|walk| walk.at(t)).collect();
                for (i, &[x, y]) in there.iter().enumerate() {
                    let told = || format!("{name} {seed}: [{x}, {y}] at {t} s");
                    if y > -thickness - 0.2 && y < 0.2 {
                        assert!(x.abs() < half - 0.2, "{}", told());
                    }
                    assert!(y < room.depth_m - 0.25, "{}", told());
                    for &[other_x, other_y] in &there[..i] {
                        let both_inside = x.abs().max(other_x.abs()) < room.half_width_m + 0.2;
                        assert!(!both_inside || (x - other_x).hypot(y - other_y) > 0.42, "{}", told());
                    }
                }
            }
            for at in [0.0, end - 0.1] {
                let gone = |[x, y]: [f64; 2]| x.abs() > room.half_width_m + 0.3 || y < -thickness - 1.5;
                assert!(walks.iter().all(|walk| walk.at(at).is_none_or(gone)), "{name} {seed}: at {at} s");
            }
        }
    }
}

#[test]
fn a_seed_gives_one_scenario_and_another_seed_another_one() {
    for (name, _) in VARIED {
        assert_eq!(varied(name, 7), varied(name, 7));
        let other = varied(name, 8);
        assert_ne!(varied(name, 7).doorway, other.doorway);
        assert_ne!(varied(name, 7).camera.at_m, other.camera.at_m);
    }
    assert_eq!(varied("two-crossing", 7), varied("two-crossing", 8));
}

/// What a seed decides is spread as it should be.
#[test]
fn seeds_give_all_kinds() {
    let walks: Vec<Scenario> = (0..200).map(|seed| varied("walk-through", seed)).collect();
    let count = |words: &str| walks.iter().filter(|s| s.description.contains(words)).count();
    assert!((80..120).contains(&count("somebody else is in the room")));
    for light in ["a lamp in the room", "under ceiling lamps on both sides", "in daylight"] {
        assert!((45..90).contains(&count(light)), "{light}: {}", count(light));
    }
    assert!((95..145).contains(&count("and out again")), "{}", count("and out again"));
    for some in ["walks in through the doorway at", "walks out through the doorway", "turns around"] {
        assert!((8..50).contains(&count(some)), "{some}: {}", count(some));
    }
    for scenario in (0..100).map(|seed| varied("bump", seed)) {
        let [(t, right, down, turn)] = scenario.camera.bump[..] else { panic!("one bump") };
        let shift = f64::hypot(right, down);
        assert!((8.0..12.0).contains(&t) && shift < 40.001 && turn.abs() <= 3.0);
        assert!(shift > 1.999 || turn.abs() >= 0.5, "{shift} {turn}");
    }
    for scenario in (0..100).map(|seed| varied("pass-by", seed)) {
        for person in &scenario.person {
            let nearest = person.walk.iter().map(|w| -w.2 - scenario.doorway.wall_thickness_m).fold(9.0, f64::min);
            assert!((0.299..1.5).contains(&nearest), "{nearest}");
        }
    }
}
