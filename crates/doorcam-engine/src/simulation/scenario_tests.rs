use super::*;

#[test]
fn every_scenario_that_comes_along_is_valid_and_begins_and_ends_with_nobody() {
    let names = Scenario::names();
    assert_eq!(names.len(), 14, "{names:?}");
    for name in names {
        let scenario = Scenario::load(&name).unwrap();
        assert!(scenario.background_s >= 3.0, "{name}");
        let end = scenario.duration_s - scenario.background_s;
        for (k, person) in scenario.person.iter().enumerate() {
            let walk = Scenario::walk(person);
            for t in [0.0, end - 1.0 / scenario.fps] {
                let outside = |[x, y]: [f64; 2]| y < -1.5 || x.abs() > scenario.room.half_width_m + person.radius_m;
                assert!(walk.at(t).is_none_or(outside), "{name}: person {k} is in the room at {t} s");
            }
        }
    }
}

#[test]
fn people_do_not_walk_through_each_other_or_the_doorways_wall() {
    for name in Scenario::names() {
        let scenario = Scenario::load(&name).unwrap();
        let walks: Vec<_> = scenario.person.iter().map(|p| (p.radius_m, Scenario::walk(p))).collect();
        for k in 0..scenario.frames().min(3000) {
            let t = k as f64 / scenario.fps;
            let there: Vec<_> = walks.iter().filter_map(|(r, walk)| Some((r, walk.at(t)?))).collect();
            for (i, &(r, a)) in there.iter().enumerate() {
                let doorway = &scenario.doorway;
                let opening = a[0].abs() + 1.25 * r < doorway.half_width() || a[1] < -doorway.wall_thickness_m - r;
                assert!(a[1] > r + 0.25 || opening, "{name}: {a:?} at {t} s");
                assert!(a[1] < scenario.room.depth_m - r, "{name}: {a:?} at {t} s");
                for &(other, b) in &there[..i] {
                    let apart = (a[0] - b[0]).hypot(a[1] - b[1]);
                    let inside = a[0].abs().min(b[0].abs()) < scenario.room.half_width_m;
                    assert!(!inside || apart > r + other + 0.05, "{name}: {apart} m apart at {t} s: {a:?} {b:?}");
                }
            }
        }
    }
}

#[test]
fn an_unknown_name_is_answered_with_the_known_ones() {
    let error = Scenario::load("two-crosing").unwrap_err().to_string();
    assert!(error.starts_with("two-crosing: unknown scenario, expected bag, bump, busy-doorway, "), "{error}");
    let error = Scenario::load("no/such.toml").unwrap_err().to_string();
    assert_eq!(error, "no/such.toml: no such file, expected a scenario (config/scenarios has some)");
}

#[test]
fn entries_are_in_force_from_their_time_on() {
    let entries = [(2.0, 0.5), (4.0, 0.0)];
    assert_eq!([-1.0, 1.9, 2.0, 3.9, 9.0].map(|t| in_force(&entries, t)), [1.0, 1.0, 0.5, 0.5, 0.0]);
}

/// All other scenarios that come along are rendered as they always were, so that their frames stay the same.
#[test]
fn of_those_that_come_along_only_random_is_an_ordinary_room() {
    for name in Scenario::names() {
        assert_eq!(Scenario::load(&name).unwrap().is_ordinary(), name == "random", "{name}");
        assert_eq!(Scenario::varied(&name, 5).unwrap().is_ordinary(), name == "random", "{name}");
    }
}
