//! Checks of a scenario's values. Each message names the key and what was expected.

use super::scenario::{CameraSpec, FlickerSpec, PersonSpec, Scenario};
use doorcam_core::scene::Rgb;
use doorcam_source::recording::Layout;

/// Longest side of a picture in pixels, and longest scenario in frames: limits that only mistyped numbers exceed.
const MOST_PIXELS: usize = 4096;
const MOST_FRAMES: f64 = 1e7;
/// Most bumps of a camera: each has a view of its own, of some ten megabytes.
const MOST_BUMPS: usize = 16;

pub(super) fn within(key: &str, value: f64, low: f64, high: f64, unit: &str) -> Result<(), String> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(format!("{key} is {value}, expected {unit} from {low} to {high}"))
}

pub(super) fn albedo(key: &str, rgb: Rgb) -> Result<(), String> {
    if rgb.iter().all(|c| (0.0..=1.0).contains(c)) {
        return Ok(());
    }
    Err(format!("{key} is {rgb:?}, expected red, green and blue from 0 to 1"))
}

pub(super) fn light(key: &str, rgb: Rgb) -> Result<(), String> {
    if rgb.iter().all(|c| (0.0..1e6).contains(c)) && rgb.iter().sum::<f64>() > 0.0 {
        return Ok(());
    }
    Err(format!("{key} is {rgb:?}, expected red, green and blue of 0 or above, not all 0"))
}

pub(super) fn entries(key: &str, entries: &[(f64, f64)]) -> Result<(), String> {
    let rising = entries.windows(2).all(|pair| pair[0].0 < pair[1].0);
    if rising && entries.iter().all(|&(t, value)| t.is_finite() && (0.0..=100.0).contains(&value)) {
        return Ok(());
    }
    Err(format!("{key} is {entries:?}, expected [seconds, factor] with rising times and factors from 0 to 100"))
}

pub(super) fn check(scenario: &Scenario) -> Result<(), String> {
    within("fps", scenario.fps, 0.1, 240.0, "frames a second")?;
    within("background_s", scenario.background_s, 1.0 / scenario.fps, 1e5, "seconds")?;
    within("duration_s", scenario.duration_s, scenario.background_s, MOST_FRAMES / scenario.fps, "seconds")?;
    scenario.doorway.validate().map_err(|e| e.to_string())?;
    let room = &scenario.room;
    within("room.half_width_m", room.half_width_m, scenario.doorway.width_m / 2.0, 20.0, "metres")?;
    within("room.depth_m", room.depth_m, 0.5, 40.0, "metres")?;
    within("room.ceiling_m", room.ceiling_m, scenario.doorway.height_m.unwrap_or(1.0), 10.0, "metres")?;
    for (key, rgb) in [
        ("room.albedo.left", room.albedo.left),
        ("room.albedo.back", room.albedo.back),
        ("room.albedo.right", room.albedo.right),
        ("room.albedo.front", room.albedo.front),
        ("room.albedo.floor", room.albedo.floor),
        ("room.albedo.ceiling", room.albedo.ceiling),
        ("floor.albedo", scenario.floor.albedo),
    ] {
        albedo(key, rgb)?;
    }
    for (k, panel) in scenario.panel.iter().enumerate() {
        albedo(&format!("panel[{k}].albedo"), panel.albedo)?;
        for (key, [from, to]) in [("along_m", panel.along_m), ("up_m", panel.up_m)] {
            if !(from.is_finite() && to.is_finite() && from < to) {
                return Err(format!("panel[{k}].{key} is [{from}, {to}], expected [from, to] in metres, from < to"));
            }
        }
    }
    if scenario.lamp.is_empty() && scenario.window.is_empty() && scenario.television.is_empty() {
        return Err(
            "lamp is empty, expected at least one [[lamp]], [[window]] or [[television]]: nobody is seen in the \
             dark"
                .into(),
        );
    }
    for (k, lamp) in scenario.lamp.iter().enumerate() {
        let [x, y, z] = lamp.at_m;
        within(&format!("lamp[{k}].at_m[0]"), x, -room.half_width_m, room.half_width_m, "metres in the room")?;
        within(&format!("lamp[{k}].at_m[1]"), y, 0.0, room.depth_m, "metres in the room")?;
        within(&format!("lamp[{k}].at_m[2]"), z, 0.0, room.ceiling_m, "metres in the room")?;
        within(&format!("lamp[{k}].radius_m"), lamp.radius_m, 0.0, 0.5, "metres")?;
        light(&format!("lamp[{k}].rgb"), lamp.rgb)?;
        entries(&format!("lamp[{k}].switch"), &lamp.switch)?;
    }
    for (k, person) in scenario.person.iter().enumerate() {
        check_person(k, person)?;
    }
    let visible = &scenario.visible;
    within("visible.share", visible.share, 0.0, 0.99, "a share")?;
    light("visible.rgb", visible.rgb)?;
    within("visible.drift", visible.drift, 0.0, 0.9, "a part of the visible light")?;
    within("visible.drift_period_s", visible.drift_period_s, 0.1, 1e6, "seconds")?;
    check_visible_side(scenario)?;
    super::ordinary::check(scenario)?;
    within("floor.speckle", scenario.floor.speckle, 0.0, 0.3, "a part of the albedo")?;
    within("floor.grain_m", scenario.floor.grain_m, 0.0005, 0.1, "metres")?;
    check_camera(&scenario.camera)?;
    scenario.flicker.as_ref().map_or(Ok(()), check_flicker)
}

fn check_visible_side(scenario: &Scenario) -> Result<(), String> {
    let lamps = &scenario.visible.lamp;
    for (k, lamp) in lamps.iter().enumerate() {
        let [x, y, z] = lamp.at_m;
        within(&format!("visible.lamp[{k}].at_m[0]"), x, -20.0, 20.0, "metres")?;
        let before = -scenario.doorway.wall_thickness_m - 0.01;
        within(&format!("visible.lamp[{k}].at_m[1]"), y, -20.0, before, "metres on the visible side")?;
        within(&format!("visible.lamp[{k}].at_m[2]"), z, 0.1, 10.0, "metres")?;
        within(&format!("visible.lamp[{k}].radius_m"), lamp.radius_m, 0.0, 2.0, "metres")?;
        within(&format!("visible.lamp[{k}].share"), lamp.share, 0.0, 1.0, "a part of the visible light")?;
    }
    within("the sum of visible.lamp's share", lamps.iter().map(|lamp| lamp.share).sum(), 0.0, 1.0, "a part")?;
    for (k, object) in scenario.object.iter().enumerate() {
        let [x, y] = object.at_m;
        within(&format!("object[{k}].at_m[0]"), x, -20.0, 20.0, "metres")?;
        within(&format!("object[{k}].at_m[1]"), y, -20.0, 20.0, "metres")?;
        within(&format!("object[{k}].length_m"), object.length_m, 0.02, 3.0, "metres")?;
        within(
            &format!("object[{k}].thickness_m"),
            object.thickness_m,
            0.02,
            object.length_m,
            "metres, at most length_m,",
        )?;
        within(&format!("object[{k}].turn_deg"), object.turn_deg, -360.0, 360.0, "degrees")?;
        albedo(&format!("object[{k}].albedo"), object.albedo)?;
        within(&format!("object[{k}].from_s"), object.from_s, 0.0, 1e9, "seconds after the empty time")?;
        if let Some(until) = object.until_s {
            within(&format!("object[{k}].until_s"), until, object.from_s, 1e9, "seconds, not before from_s,")?;
        }
    }
    albedo("wall.albedo", scenario.wall.albedo)?;
    within("wall.speckle", scenario.wall.speckle, 0.0, 0.3, "a part of the albedo")?;
    within("wall.grain_m", scenario.wall.grain_m, 0.0005, 0.1, "metres")?;
    let patches = scenario.camera.layout == Layout::Patches;
    if patches && (scenario.shows_people() || !scenario.camera.bump.is_empty()) {
        return Err("camera.layout is \"patches\", expected \"camera\": patches show neither people \
             on the visible side nor a bump"
            .into());
    }
    Ok(())
}

fn check_bumps(bumps: &[(f64, f64, f64, f64)]) -> Result<(), String> {
    if bumps.len() > MOST_BUMPS {
        return Err(format!("camera.bump has {} entries, expected at most {MOST_BUMPS}", bumps.len()));
    }
    let rising = bumps.windows(2).all(|pair| pair[0].0 < pair[1].0);
    let possible = |&(t, right, down, turn): &(f64, f64, f64, f64)| {
        t >= 0.0 && t.is_finite() && [right, down].iter().all(|px| px.abs() <= 1000.0) && (-45.0..=45.0).contains(&turn)
    };
    if rising && bumps.iter().all(possible) {
        return Ok(());
    }
    Err(format!(
        "camera.bump is {bumps:?}, expected [seconds, right, down, degrees] with rising times from 0 on, at most 1000 \
         pixels and 45 degrees"
    ))
}

fn check_person(k: usize, person: &PersonSpec) -> Result<(), String> {
    within(&format!("person[{k}].radius_m"), person.radius_m, 0.05, 0.5, "metres")?;
    within(&format!("person[{k}].height_m"), person.height_m, 0.5, 2.3, "metres")?;
    albedo(&format!("person[{k}].clothes"), person.clothes)?;
    albedo(&format!("person[{k}].skin"), person.skin)?;
    person.trousers.map_or(Ok(()), |trousers| albedo(&format!("person[{k}].trousers"), trousers))?;
    let finite = person.walk.iter().all(|&(t, x, y)| t.is_finite() && x.is_finite() && y.is_finite());
    let rising = person.walk.windows(2).all(|pair| pair[0].0 < pair[1].0);
    if !(finite && rising) || person.walk.is_empty() {
        return Err(format!("person[{k}].walk: expected waypoints [seconds, x, y] with rising times"));
    }
    let (first, last) = (person.walk.first().map_or(0.0, |w| w.0), person.walk.last().map_or(0.0, |w| w.0));
    match person.repeat_s {
        Some(period) if !(period > last && period.is_finite()) => {
            Err(format!("person[{k}].repeat_s is {period}, expected more than the walk's last time, {last} s"))
        }
        Some(_) if first != 0.0 => {
            Err(format!("person[{k}].walk begins at {first} s, expected 0 for a walk with repeat_s"))
        }
        _ if first < 0.0 => {
            Err(format!("person[{k}].walk begins at {first} s, expected 0 or later: the room is empty before"))
        }
        _ => Ok(()),
    }
}

fn check_camera(camera: &CameraSpec) -> Result<(), String> {
    let [x, y, z] = camera.at_m;
    within("camera.at_m[0]", x, -20.0, 20.0, "metres")?;
    within("camera.at_m[1]", y, -20.0, -0.01, "metres on the visible side")?;
    within("camera.at_m[2]", z, 0.1, 10.0, "metres")?;
    within("camera.look_at_m[0]", camera.look_at_m[0], -20.0, 20.0, "metres")?;
    within("camera.look_at_m[1]", camera.look_at_m[1], -20.0, 20.0, "metres")?;
    within("camera.field_of_view_deg", camera.field_of_view_deg, 1.0, 150.0, "degrees")?;
    within("camera.roll_deg", camera.roll_deg, -180.0, 180.0, "degrees")?;
    if camera.size.iter().any(|side| !(16..=MOST_PIXELS).contains(side)) {
        return Err(format!(
            "camera.size is {:?}, expected [width, height] from 16 to {MOST_PIXELS} pixels",
            camera.size
        ));
    }
    if camera.layout == Layout::Patches {
        within("camera.fov_m", camera.fov_m, 0.01, 2.0, "metres")?;
    }
    within("camera.level", camera.level, 0.001, 1.0, "a part of full scale")?;
    entries("camera.exposure", &camera.exposure)?;
    check_bumps(&camera.bump)?;
    within("camera.full_scale_electrons", camera.full_scale_electrons, 100.0, f64::INFINITY, "electrons")?;
    within("camera.read_electrons", camera.read_electrons, 0.0, 1e6, "electrons")?;
    within("camera.quality", camera.quality.into(), 1.0, 100.0, "a quality")?;
    camera.transfer.validate().map_err(|e| format!("camera.{e}"))
}

fn check_flicker(flicker: &FlickerSpec) -> Result<(), String> {
    within("flicker.mains_hz", flicker.mains_hz, 1.0, 1000.0, "hertz")?;
    within("flicker.hidden", flicker.hidden, 0.0, 1.0, "a part of the light")?;
    within("flicker.visible", flicker.visible, 0.0, 1.0, "a part of the light")?;
    within("flicker.exposure_s", flicker.exposure_s, 0.0, 1.0, "seconds")?;
    within("flicker.line_s", flicker.line_s, 0.0, 0.01, "seconds")
}

#[cfg(test)]
mod tests {
    use super::super::scenario::SMALLEST;
    use super::*;

    fn error(from: &str, to: &str) -> String {
        assert!(SMALLEST.contains(from), "{from}");
        Scenario::parse(&SMALLEST.replacen(from, to, 1)).expect_err("refused")
    }

    #[test]
    fn what_is_wrong_is_named_by_key_with_what_was_expected() {
        assert_eq!(error("fps = 5", "fps = 0"), "fps is 0, expected frames a second from 0.1 to 240");
        assert_eq!(error("0.8\n", "-1\n"), "doorway.width_m is -1, expected 0.05 to 10 metres");
        assert_eq!(
            error("left = [0.6,", "left = [1.6,"),
            "room.albedo.left is [1.6, 0.3, 0.3], expected red, green and blue from 0 to 1"
        );
        assert_eq!(
            error("[0.9, 0.4, 2.1]", "[0.9, 0.4, 3]"),
            "lamp[0].at_m[2] is 3, expected metres in the room from 0 to 2.4"
        );
        assert_eq!(error("share = 0.4", "share = nan"), "visible.share is NaN, expected a share from 0 to 0.99");
        assert_eq!(error("fps = 5", "fps = 5\nspeed = 3"), format!("line 4: {}", unknown("speed")));
        let person =
            |rest: &str| error("[visible]", &format!("[[person]]\nclothes = [0.1, 0.1, 0.1]\n{rest}\n[visible]"));
        assert_eq!(
            person("walk = [[2, 0, 1], [1, 0, 1]]"),
            "person[0].walk: expected waypoints [seconds, x, y] with rising times"
        );
        assert_eq!(
            person("walk = [[0, 0, 1], [3, 0, 1]]\nrepeat_s = 2"),
            "person[0].repeat_s is 2, expected more than the walk's last time, 3 s"
        );
    }

    #[test]
    fn what_is_wrong_on_the_visible_side_is_named_too() {
        let lamp = |rest: &str| error("share = 0.4\n", &format!("share = 0.4\n[[visible.lamp]]\n{rest}\n"));
        assert_eq!(
            lamp("at_m = [0, 0, 2]\nradius_m = 0.1\nshare = 0.5"),
            "visible.lamp[0].at_m[1] is 0, expected metres on the visible side from -20 to -0.11"
        );
        assert_eq!(
            lamp(&["at_m = [0, -2, 2]\nradius_m = 0.1\nshare = 0.7"; 2].join("\n[[visible.lamp]]\n")),
            "the sum of visible.lamp's share is 1.4, expected a part from 0 to 1"
        );
        let bag = |rest: &str| error("[visible]", &format!("[[object]]\nalbedo = [0.1, 0.1, 0.1]\n{rest}\n[visible]"));
        assert_eq!(
            bag("at_m = [0.6, -0.3]\nfrom_s = 2\nuntil_s = 1"),
            "object[0].until_s is 1, expected seconds, not before from_s, from 2 to 1000000000"
        );
        let bump = |bump: &str| error("[camera]", &format!("[camera]\nbump = {bump}"));
        assert_eq!(
            bump("[[1, 5, 0, 90]]"),
            "camera.bump is [(1.0, 5.0, 0.0, 90.0)], expected [seconds, right, down, degrees] with rising times from 0 on, \
             at most 1000 pixels and 45 degrees"
        );
        assert_eq!(
            bump(&format!("[{}]", "[1, 0, 0, 0],".repeat(17))),
            "camera.bump has 17 entries, expected at most 16"
        );
        let walker = "[[person]]\nclothes = [0.1, 0.1, 0.1]\nwalk = [[0, 0, -1], [1, 0, 1]]\n[visible]";
        let patches = SMALLEST.replace("[visible]", walker).replace("[camera]", "[camera]\nlayout = \"patches\"");
        assert_eq!(
            Scenario::parse(&patches).unwrap_err(),
            "camera.layout is \"patches\", expected \"camera\": patches show neither people on the visible side nor a bump"
        );
    }

    fn unknown(key: &str) -> String {
        format!(
            "unknown field `{key}`, expected one of `description`, `fps`, `background_s`, `duration_s`, `ordinary`, `doorway`, `room`, \
             `panel`, `lamp`, `window`, `television`, `furniture`, `leaf`, `person`, `visible`, `object`, `floor`, `wall`, `camera`, `flicker`"
        )
    }
}
