//! Checks of the keys of an ordinary room.

use super::super::check::{albedo, entries, light, within};
use super::super::scenario::{LampKind, Scenario, WallName};
use super::source::sunlit;
use super::spec::{FurnitureSpec, SunSpec, WindowSpec};

/// Most windows, televisions and pieces of furniture: each costs time in every frame.
const MOST: usize = 16;
/// How far beside and before the opening the sun must not shine on the floor, in metres.
const WATCHED_M: f64 = 0.7;

fn range(key: &str, [from, to]: [f64; 2], low: f64, high: f64) -> Result<(), String> {
    if from >= low && to <= high && from < to {
        return Ok(());
    }
    Err(format!("{key} is [{from}, {to}], expected [from, to] in metres, from < to, from {low} to {high}"))
}

fn on_wall(key: &str, scenario: &Scenario, wall: WallName, along: [f64; 2], up: [f64; 2]) -> Result<(), String> {
    let room = &scenario.room;
    let (low, high) = match wall {
        WallName::Back => (-room.half_width_m, room.half_width_m),
        WallName::Left | WallName::Right => (0.0, room.depth_m),
    };
    range(&format!("{key}.along_m"), along, low, high)?;
    range(&format!("{key}.up_m"), up, 0.0, room.ceiling_m)
}

pub(in crate::simulation) fn check(scenario: &Scenario) -> Result<(), String> {
    for (key, count) in [
        ("window", scenario.window.len()),
        ("television", scenario.television.len()),
        ("furniture", scenario.furniture.len()),
    ] {
        if count > MOST {
            return Err(format!("{key} has {count} entries, expected at most {MOST}"));
        }
    }
    if let Some(bounces) = scenario.room.bounces {
        within("room.bounces", bounces.into(), 2.0, 100.0, "reflections")?;
    }
    for (k, window) in scenario.window.iter().enumerate() {
        let key = format!("window[{k}]");
        on_wall(&key, scenario, window.wall, window.along_m, window.up_m)?;
        light(&format!("{key}.sky"), window.sky)?;
        entries(&format!("{key}.switch"), &window.switch)?;
        window.sun.as_ref().map_or(Ok(()), |sun| check_sun(&key, scenario, window, sun))?;
    }
    for (k, television) in scenario.television.iter().enumerate() {
        let key = format!("television[{k}]");
        on_wall(&key, scenario, television.wall, television.along_m, television.up_m)?;
        light(&format!("{key}.rgb"), television.rgb)?;
        within(&format!("{key}.flicker"), television.flicker, 0.0, 1.0, "a part of its light")?;
    }
    for (k, furniture) in scenario.furniture.iter().enumerate() {
        check_furniture(k, scenario, furniture)?;
    }
    if let Some(leaf) = &scenario.leaf {
        within("leaf.angle_deg", leaf.angle_deg, 10.0, 175.0, "degrees")?;
        within("leaf.width_m", leaf.width_m, 0.2, scenario.doorway.width_m, "metres, at most doorway.width_m,")?;
        within("leaf.height_m", leaf.height_m, 0.5, scenario.room.ceiling_m, "metres")?;
        albedo("leaf.albedo", leaf.albedo)?;
        let far = leaf.width_m * leaf.angle_deg.to_radians().cos().min(0.0);
        let reach = scenario.doorway.half_width() - far + 0.05;
        within("the leaf's end beside the middle of the doorway", reach, 0.0, scenario.room.half_width_m, "metres")?;
        within("leaf.width_m", leaf.width_m, 0.2, scenario.room.depth_m - 0.1, "metres in the room")?;
    }
    for (k, lamp) in scenario.lamp.iter().enumerate() {
        let Some(size) = lamp.size_m else { continue };
        if lamp.kind != LampKind::Panel {
            return Err(format!("lamp[{k}].size_m: expected kind \"panel\": a bulb is round"));
        }
        for (axis, side) in size.into_iter().enumerate() {
            within(&format!("lamp[{k}].size_m[{axis}]"), side, 0.02, 5.0, "metres")?;
        }
    }
    within("floor.gloss", scenario.floor.gloss, 0.0, 0.3, "a part of the light")?;
    within("floor.roughness", scenario.floor.roughness, 0.1, 1.0, "a roughness")
}

fn check_furniture(k: usize, scenario: &Scenario, furniture: &FurnitureSpec) -> Result<(), String> {
    let room = &scenario.room;
    let key = format!("furniture[{k}]");
    range(&format!("{key}.x_m"), furniture.x_m, -room.half_width_m, room.half_width_m)?;
    // Nothing stands in the doorway itself.
    range(&format!("{key}.y_m"), furniture.y_m, 0.05, room.depth_m)?;
    range(&format!("{key}.up_m"), furniture.up_m, 0.0, room.ceiling_m)?;
    albedo(&format!("{key}.albedo"), furniture.albedo)
}

/// A sun shines into the room, but not through it on the floor before the doorway, whose samples do not show the sharp
/// border of its light.
fn check_sun(key: &str, scenario: &Scenario, window: &WindowSpec, sun: &SunSpec) -> Result<(), String> {
    light(&format!("{key}.sun.rgb"), sun.rgb)?;
    let [x, y, z] = sun.towards;
    let out = match window.wall {
        WallName::Left => -x,
        WallName::Back => y,
        WallName::Right => x,
    };
    let length = (x * x + y * y + z * z).sqrt();
    if !(out > 0.02 * length && z > 0.02 * length && length.is_finite()) {
        return Err(format!(
            "{key}.sun.towards is {:?}, expected a direction that leads out of the window and upwards",
            sun.towards
        ));
    }
    let (half, thickness) = (scenario.doorway.half_width(), scenario.doorway.wall_thickness_m);
    let reaches = |x: f64, y: f64| {
        let open = [0.0, -thickness].into_iter().all(|face| {
            let share = (face - y) / sun.towards[1];
            share > 0.0 && (x + share * sun.towards[0]).abs() < half
        });
        open && sunlit(window, sun, scenario.room.half_width_m, scenario.room.depth_m, [x, y, 0.0])
    };
    let places = (0..=40).flat_map(|i| (0..=20).map(move |j| (f64::from(i) / 20.0 - 1.0, f64::from(j) / 20.0)));
    for (along, away) in places {
        if reaches(along * (half + WATCHED_M), -thickness - 0.01 - away * WATCHED_M) {
            return Err(format!(
                "{key}.sun.towards is {:?}, expected a sun whose beam does not fall through the doorway",
                sun.towards
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::super::scenario::SMALLEST;
    use super::*;

    fn error(more: &str) -> String {
        Scenario::parse(&SMALLEST.replacen("[visible]", &format!("{more}\n[visible]"), 1)).expect_err("refused")
    }

    #[test]
    fn what_is_wrong_in_an_ordinary_room_is_named_by_key_with_what_was_expected() {
        let window = |rest: &str| error(&format!("[[window]]\nwall = \"back\"\nup_m = [1, 2]\n{rest}"));
        assert_eq!(
            window("along_m = [1, 1.6]\nsky = [1, 1, 1]"),
            "window[0].along_m is [1, 1.6], expected [from, to] in metres, from < to, from -1.5 to 1.5"
        );
        assert_eq!(
            window("along_m = [0, 1]\nsky = [0, 0, 0]"),
            "window[0].sky is [0.0, 0.0, 0.0], expected red, green and blue of 0 or above, not all 0"
        );
        let sun = |towards: &str| {
            window(&format!("along_m = [-0.4, 0.4]\nsky = [1, 1, 1]\nsun = {{ towards = {towards}, rgb = [9, 9, 9] }}"))
        };
        assert_eq!(
            sun("[0, -1, 1]"),
            "window[0].sun.towards is [0.0, -1.0, 1.0], expected a direction that leads out of the window and upwards"
        );
        assert_eq!(
            sun("[0, 1, 0.4]"),
            "window[0].sun.towards is [0.0, 1.0, 0.4], expected a sun whose beam does not fall through the doorway"
        );
        assert_eq!(
            error("[leaf]\nhinge = \"left\"\nangle_deg = 5\nwidth_m = 0.7"),
            "leaf.angle_deg is 5, expected degrees from 10 to 175"
        );
        assert_eq!(
            error("[[furniture]]\nx_m = [0, 1]\ny_m = [-1, 1]\nup_m = [0, 1]\nalbedo = [0.5, 0.5, 0.5]"),
            "furniture[0].y_m is [-1, 1], expected [from, to] in metres, from < to, from 0.05 to 3"
        );
        let many = "[[television]]\nwall = \"left\"\nalong_m = [1, 2]\nup_m = [1, 2]\nrgb = [1, 1, 1]\n".repeat(17);
        assert_eq!(error(&many), "television has 17 entries, expected at most 16");
        let bulb = SMALLEST.replace("radius_m = 0.08", "radius_m = 0.08\nsize_m = [1, 1]");
        assert_eq!(Scenario::parse(&bulb).unwrap_err(), "lamp[0].size_m: expected kind \"panel\": a bulb is round");
    }
}
