use super::draw::Draw;
use crate::simulation::ordinary::{FurnitureSpec, LampFacing, LeafSpec, SunSpec, TelevisionSpec, WindowSpec};
use crate::simulation::scenario::{FlickerSpec, LampKind, LampSpec, PanelSpec, Scenario, WallName};
use crate::simulation::visible::VisibleLampSpec;
use doorcam_core::geometry::Side;
use doorcam_core::scene::Rgb;

/// Shares of rooms with a light that the floor sees, with a leaf, with a glossy floor.
const SEEN: f64 = 0.7;
const LEAF: f64 = 0.36;
const GLOSSY: f64 = 0.36;
/// Room left beside furniture for people, in metres.
const WAY_M: f64 = 0.9;

/// Draws everything but people; says in words what light it is.
pub(super) fn room(scenario: &mut Scenario, draw: &mut Draw) -> String {
    scenario.doorway.width_m = draw.between(0.7, 1.0);
    scenario.doorway.wall_thickness_m = if draw.chance(0.1) { 0.0 } else { draw.between(0.05, 0.3) };
    scenario.doorway.height_m = Some(draw.between(1.95, 2.1));
    walls(scenario, draw);
    scenario.leaf = draw.chance(LEAF).then(|| LeafSpec {
        hinge: draw.pick(&[Side::Left, Side::Right]),
        angle_deg: draw.between(80.0, 115.0),
        width_m: scenario.doorway.width_m - 0.02,
        height_m: scenario.doorway.height_m.unwrap_or(2.0) - 0.03,
        albedo: grey(draw, 0.35, 0.75, 0.06),
    });
    let light = lights(scenario, draw);
    furniture(scenario, draw);
    visible_side(scenario, draw);
    let glossy = floor(scenario, draw);
    camera(scenario, draw);
    let leaf = if scenario.leaf.is_some() { ", the door's leaf open into it" } else { "" };
    format!("{light}{leaf}{glossy}")
}

/// A grey with a tint.
pub(super) fn grey(draw: &mut Draw, low: f64, high: f64, tint: f64) -> Rgb {
    let level = draw.between(low, high);
    [0, 1, 2].map(|_| (level + draw.between(-tint, tint)).clamp(0.02, 0.92))
}

fn walls(scenario: &mut Scenario, draw: &mut Draw) {
    let room = &mut scenario.room;
    room.half_width_m = draw.between(1.5, 2.4);
    room.depth_m = draw.between(3.2, 4.6);
    room.ceiling_m = draw.between(2.4, 2.7);
    for wall in [&mut room.albedo.left, &mut room.albedo.back, &mut room.albedo.right, &mut room.albedo.front] {
        *wall = grey(draw, 0.45, 0.8, 0.08);
    }
    room.albedo.floor = grey(draw, 0.2, 0.5, 0.06);
    room.albedo.ceiling = grey(draw, 0.7, 0.85, 0.03);
    let wide = room.half_width_m;
    let depth = room.depth_m;
    scenario.panel = (0..draw.pick(&[0, 1, 1, 2]))
        .map(|_| {
            let wall = draw.pick(&[WallName::Left, WallName::Back, WallName::Right]);
            let [low, high] = if wall == WallName::Back { [-wide + 0.5, wide - 0.5] } else { [0.6, depth - 0.5] };
            let middle = draw.between(low, high);
            let half = draw.between(0.2, 0.45);
            PanelSpec { wall, along_m: [middle - half, middle + half], up_m: [0.9, 1.8], albedo: draw.cloth() }
        })
        .collect();
}

fn lamp(kind: LampKind, at_m: [f64; 3], radius_m: f64, rgb: Rgb) -> LampSpec {
    LampSpec { kind, at_m, radius_m, rgb, size_m: None, faces: LampFacing::Down, switch: Vec::new() }
}

/// A warm white of that brightness.
fn warm(draw: &mut Draw, level: f64) -> Rgb {
    [level, level * draw.between(0.84, 0.98), level * draw.between(0.65, 0.92)]
}

fn lights(scenario: &mut Scenario, draw: &mut Draw) -> String {
    (scenario.lamp, scenario.window, scenario.television) = (Vec::new(), Vec::new(), Vec::new());
    let mut what = if draw.chance(SEEN) {
        match draw.between(0.0, 1.0) {
            0.0..0.4 => windows(scenario, draw),
            0.4..0.75 => ceiling(scenario, draw),
            _ => bulbs(scenario, draw),
        }
    } else {
        hidden(scenario, draw);
        "lit by lamps that the floor does not see".to_owned()
    };
    if draw.chance(0.15) {
        television(scenario, draw);
        what += ", a television on";
    }
    what
}

/// On the doorway's wall, where the floor in front of the door does not see them.
fn hidden(scenario: &mut Scenario, draw: &mut Draw) {
    let (wide, high) = (scenario.room.half_width_m, scenario.room.ceiling_m);
    let first = draw.sign();
    let sides = if draw.chance(0.6) { vec![first, -first] } else { vec![first] };
    for side in sides {
        let at = [side * (wide - draw.between(0.15, 0.35)), 0.15, high - draw.between(0.2, 0.4)];
        let rgb = warm(draw, 1.0);
        scenario.lamp.push(lamp(LampKind::Bulb, at, 0.1, rgb));
    }
}

fn windows(scenario: &mut Scenario, draw: &mut Draw) -> String {
    let (wide, depth) = (scenario.room.half_width_m, scenario.room.depth_m);
    let wall = draw.pick(&[WallName::Back, WallName::Back, WallName::Left, WallName::Right]);
    let up_m = [draw.between(0.7, 1.1), draw.between(1.9, 2.25)];
    let sky = [6.0, draw.between(6.2, 6.8), draw.between(6.8, 7.8)];
    let half = draw.between(0.35, 0.75);
    let middle = match wall {
        WallName::Back => draw.between(-wide + half + 0.2, wide - half - 0.2),
        _ => draw.between(1.1 + half, depth - half - 0.2),
    };
    let sun = draw.chance(0.25).then(|| {
        let aside = draw.between(-0.6, 0.6);
        // High enough not to reach the doorway.
        let up = draw.between(1.3, 2.2);
        let towards = match wall {
            WallName::Back => [aside, 1.0, up],
            WallName::Left => [-1.0, aside, up],
            WallName::Right => [1.0, aside, up],
        };
        let strength = draw.between(20.0, 80.0);
        SunSpec { towards, rgb: [strength, 0.95 * strength, 0.85 * strength] }
    });
    let one = |along_m: [f64; 2]| WindowSpec { wall, along_m, up_m, sky, sun, switch: Vec::new() };
    // One, or two with a pillar between them.
    let pillar = draw.between(0.06, 0.2);
    scenario.window = if draw.chance(0.35) {
        vec![one([middle - half, middle - pillar / 2.0]), one([middle + pillar / 2.0, middle + half])]
    } else {
        vec![one([middle - half, middle + half])]
    };
    let sunny = if sun.is_some() { ", the sun shining in" } else { "" };
    if draw.chance(0.3) {
        hidden(scenario, draw);
        // Lamps are dim beside daylight.
        for lamp in &mut scenario.lamp {
            lamp.rgb = lamp.rgb.map(|c| 0.8 * c);
        }
        return format!("in daylight that the floor sees, and lamps that it does not{sunny}");
    }
    format!("in daylight that the floor sees{sunny}")
}

fn ceiling(scenario: &mut Scenario, draw: &mut Draw) -> String {
    let (wide, depth, high) = (scenario.room.half_width_m, scenario.room.depth_m, scenario.room.ceiling_m);
    let size = draw.pick(&[[0.6, 1.2], [0.6, 0.6], [0.3, 1.2], [1.2, 0.3]]);
    let aside = draw.between(0.5, wide - 0.6);
    let y = draw.between(1.4, depth - 0.9);
    let level = [5.0, draw.between(4.7, 5.0), draw.between(4.2, 5.0)];
    let rgb = level.map(|c| c * size[0] * size[1]);
    let places = match draw.pick(&[0, 1, 1]) {
        0 => vec![draw.between(-0.4, 0.4)],
        _ => vec![-aside, aside],
    };
    for x in places {
        let panel = lamp(LampKind::Panel, [x, y, high - 0.05], 0.3, rgb);
        scenario.lamp.push(LampSpec { size_m: Some(size), ..panel });
    }
    "under ceiling panels that the floor sees".into()
}

fn bulbs(scenario: &mut Scenario, draw: &mut Draw) -> String {
    let (wide, depth, high) = (scenario.room.half_width_m, scenario.room.depth_m, scenario.room.ceiling_m);
    let rgb = warm(draw, 1.0);
    if draw.chance(0.5) {
        let at = [draw.between(-0.5, 0.5), draw.between(1.3, depth - 1.2), high - draw.between(0.3, 0.6)];
        scenario.lamp.push(lamp(LampKind::Bulb, at, draw.between(0.12, 0.2), rgb));
        return "under a lamp that hangs where the floor sees it".into();
    }
    // Beside the line from one edge into a far corner.
    let x = draw.sign() * draw.between(0.2, (wide - 0.35).min(1.3));
    let at = [x, depth - draw.between(0.25, 0.5), draw.between(1.2, 1.7)];
    scenario.lamp.push(lamp(LampKind::Bulb, at, draw.between(0.12, 0.18), rgb));
    "in the light of a floor lamp that the floor sees".into()
}

fn television(scenario: &mut Scenario, draw: &mut Draw) {
    let depth = scenario.room.depth_m;
    let wall = draw.pick(&[WallName::Left, WallName::Right]);
    let half = draw.between(0.4, 0.6);
    let middle = draw.between(0.8 + half, depth - half - 0.2).min(depth - half);
    let low = draw.between(0.7, 1.0);
    // A small part of the light in the evening, and next to nothing by day.
    let level = draw.between(0.2, 0.6);
    scenario.television = vec![TelevisionSpec {
        wall,
        along_m: [middle - half, middle + half],
        up_m: [low, low + 1.12 * half],
        rgb: [0.8 * level, 0.95 * level, 1.3 * level],
        flicker: draw.between(0.3, 0.7),
    }];
    // It hangs beside windows, not on top of them.
    let on_window = |w: &WindowSpec| w.wall == wall && w.along_m[0] < middle + half && w.along_m[1] > middle - half;
    if scenario.window.iter().any(on_window) {
        scenario.television[0].wall = if wall == WallName::Left { WallName::Right } else { WallName::Left };
    }
}

/// Shelves and sofas along the walls, and a table.
fn furniture(scenario: &mut Scenario, draw: &mut Draw) {
    let (wide, depth) = (scenario.room.half_width_m, scenario.room.depth_m);
    scenario.furniture.clear();
    for _ in 0..draw.pick(&[0, 1, 1, 2, 2, 3]) {
        let [tall, deep, long] = draw.pick(&[[1.9, 0.38, 0.9], [1.2, 0.35, 1.2], [0.45, 0.6, 1.5], [0.8, 0.45, 1.0]]);
        let (tall, deep, long) =
            (tall * draw.between(0.9, 1.1), deep * draw.between(0.8, 1.1), long * draw.between(0.7, 1.1));
        let albedo = draw.cloth().map(|c| 0.1 + 0.6 * c);
        let side = draw.sign();
        let (x_m, y_m, up_m) = match draw.pick(&[0, 0, 1, 2]) {
            0 => {
                let y = draw.between(1.0, (depth - long - 0.1).max(1.01));
                let x = if side < 0.0 { [-wide, -wide + deep] } else { [wide - deep, wide] };
                (x, [y, (y + long).min(depth)], [0.0, tall])
            }
            1 => {
                let x = draw.between(-wide, wide - long);
                ([x, x + long], [depth - deep, depth], [0.0, tall])
            }
            _ => {
                let x = side * (wide - draw.between(0.9, 1.1));
                let y = draw.between(1.6, depth - 1.2);
                ([x - 0.4, x + 0.4], [y, y + 0.8], [0.7, 0.74])
            }
        };
        let clear = |other: &FurnitureSpec| {
            x_m[0] > other.x_m[1] + 0.1
                || x_m[1] < other.x_m[0] - 0.1
                || y_m[0] > other.y_m[1] + 0.1
                || y_m[1] < other.y_m[0] - 0.1
        };
        // Nothing in the leaf's way, and no shelf before a window or a screen on its own wall.
        let leaf = scenario.leaf.is_some()
            && x_m[0].abs().min(x_m[1].abs()) < scenario.doorway.half_width() + 0.6
            && y_m[0] < 1.3;
        let covers = |wall: WallName, along: [f64; 2], low: f64| {
            let [from, to] = if wall == WallName::Back { x_m } else { y_m };
            let at = match wall {
                WallName::Left => x_m[0] < -wide + WAY_M,
                WallName::Right => x_m[1] > wide - WAY_M,
                WallName::Back => y_m[1] > depth - WAY_M,
            };
            at && from < along[1] && to > along[0] && up_m[1] > low
        };
        let before = scenario.window.iter().any(|w| covers(w.wall, w.along_m, w.up_m[0]))
            || scenario.television.iter().any(|t| covers(t.wall, t.along_m, t.up_m[0]));
        let lamp = scenario.lamp.iter().any(|l| {
            let [x, y, z] = l.at_m;
            x > x_m[0] - 0.25 && x < x_m[1] + 0.25 && y > y_m[0] - 0.25 && y < y_m[1] + 0.25 && z < up_m[1] + 0.3
        });
        if scenario.furniture.iter().all(clear) && !leaf && !before && !lamp {
            scenario.furniture.push(FurnitureSpec { x_m, y_m, up_m, albedo });
        }
    }
}

fn visible_side(scenario: &mut Scenario, draw: &mut Draw) {
    let thickness = scenario.doorway.wall_thickness_m;
    let visible = &mut scenario.visible;
    visible.share = draw.between(0.2, 0.5);
    visible.rgb = [1.0, draw.between(0.94, 1.02), draw.between(0.85, 1.08)];
    visible.drift = if draw.chance(0.3) { draw.between(0.01, 0.06) } else { 0.0 };
    visible.drift_period_s = draw.between(20.0, 90.0);
    visible.lamp = Vec::new();
    if draw.chance(0.4) {
        let at_m = [draw.between(-0.8, 0.8), -thickness - draw.between(1.2, 2.2), draw.between(2.4, 2.6)];
        visible.lamp.push(VisibleLampSpec { at_m, radius_m: draw.between(0.05, 0.3), share: draw.between(0.2, 0.6) });
    }
    let (mains_hz, part) = (draw.pick(&[50.0, 60.0]), draw.between(0.01, 0.06));
    scenario.flicker = draw.chance(0.2).then(|| FlickerSpec {
        mains_hz,
        hidden: if scenario.window.is_empty() { part } else { 0.2 * part },
        visible: part * draw.between(0.5, 1.0),
        exposure_s: draw.between(0.011, 0.017),
        line_s: draw.between(1e-5, 4e-5),
    });
}

fn floor(scenario: &mut Scenario, draw: &mut Draw) -> &'static str {
    let floor = &mut scenario.floor;
    floor.albedo = grey(draw, 0.35, 0.65, 0.04);
    floor.speckle = draw.between(0.01, 0.08);
    floor.grain_m = draw.between(0.002, 0.008);
    scenario.wall.albedo = grey(draw, 0.35, 0.75, 0.02);
    scenario.wall.speckle = draw.between(0.0, 0.05);
    let glossy = draw.chance(GLOSSY);
    let (gloss, roughness) = (draw.between(0.025, 0.06), draw.between(0.15, 0.4));
    (floor.gloss, floor.roughness) = if glossy { (gloss, roughness) } else { (0.0, 0.22) };
    if glossy { ", a glossy floor" } else { "" }
}

/// Above the floor in front of the door; the picture shows the opening and both patches.
fn camera(scenario: &mut Scenario, draw: &mut Draw) {
    let (half, thickness) = (scenario.doorway.half_width(), scenario.doorway.wall_thickness_m);
    let camera = &mut scenario.camera;
    let [x, y, z] = [draw.between(-0.15, 0.15), -thickness - draw.between(0.35, 0.85), draw.between(1.15, 2.4)];
    camera.at_m = [x, y, z];
    camera.look_at_m = [draw.between(-0.04, 0.04), -thickness - draw.between(0.08, 0.16)];
    let range = (y - camera.look_at_m[1]).hypot(z);
    camera.field_of_view_deg = 2.0 * ((half + draw.between(0.36, 0.5)) / range).atan().to_degrees();
    camera.roll_deg = draw.between(-2.0, 2.0);
    camera.level = draw.between(0.33, 0.48);
    // As many small wells as large ones.
    camera.full_scale_electrons = 5000.0 * 6.0_f64.powf(draw.between(0.0, 1.0));
    camera.read_electrons = draw.between(4.0, 14.0);
    camera.quality = draw.between(80.0, 96.0) as u8;
}
