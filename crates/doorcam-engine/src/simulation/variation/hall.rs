use super::draw::Draw;
use crate::simulation::ordinary::LampFacing;
use crate::simulation::scenario::{LampKind, LampSpec, PanelSpec, Scenario, WallName};
use crate::simulation::visible::VisibleLampSpec;
use doorcam_core::scene::Rgb;

/// Varies door, room, light, floor, wall and camera; says in words what light it is.
pub(super) fn hall(scenario: &mut Scenario, draw: &mut Draw) -> &'static str {
    scenario.doorway.width_m = draw.between(0.78, 1.0);
    scenario.doorway.wall_thickness_m = draw.between(0.08, 0.22);
    scenario.doorway.height_m = Some(draw.between(2.0, 2.1));
    room(scenario, draw);
    scenario.floor.albedo = grey(draw, 0.4, 0.65, 0.04);
    scenario.floor.speckle = draw.between(0.04, 0.08);
    scenario.wall.albedo = grey(draw, 0.35, 0.75, 0.02);
    scenario.wall.speckle = draw.between(0.02, 0.05);
    camera(scenario, draw);
    light(scenario, draw)
}

/// A grey with a tint.
fn grey(draw: &mut Draw, low: f64, high: f64, tint: f64) -> Rgb {
    let level = draw.between(low, high);
    [0, 1, 2].map(|_| level + draw.between(-tint, tint))
}

fn room(scenario: &mut Scenario, draw: &mut Draw) {
    let room = &mut scenario.room;
    room.half_width_m = draw.between(1.3, 1.9);
    room.depth_m = draw.between(3.0, 4.0);
    room.ceiling_m = draw.between(2.4, 2.7);
    for wall in [&mut room.albedo.left, &mut room.albedo.back, &mut room.albedo.right, &mut room.albedo.front] {
        *wall = grey(draw, 0.5, 0.75, 0.08);
    }
    room.albedo.floor = grey(draw, 0.25, 0.45, 0.05);
    let middle = draw.between(-0.8, 0.8);
    let poster = PanelSpec {
        wall: WallName::Back,
        along_m: [middle - 0.35, middle + 0.35],
        up_m: [1.0, 1.8],
        albedo: draw.cloth(),
    };
    scenario.panel = if draw.chance(0.5) { vec![poster] } else { Vec::new() };
}

/// Above the floor in front of the door; the picture shows the opening and both patches.
fn camera(scenario: &mut Scenario, draw: &mut Draw) {
    let (half, thickness) = (scenario.doorway.half_width(), scenario.doorway.wall_thickness_m);
    let camera = &mut scenario.camera;
    let [x, y, z] = [draw.between(-0.12, 0.12), -thickness - draw.between(0.65, 0.85), draw.between(2.2, 2.4)];
    camera.at_m = [x, y, z];
    camera.look_at_m = [draw.between(-0.04, 0.04), -thickness - draw.between(0.06, 0.12)];
    let range = (y - camera.look_at_m[1]).hypot(z);
    camera.field_of_view_deg = 2.0 * ((half + draw.between(0.42, 0.55)) / range).atan().to_degrees();
    camera.roll_deg = draw.between(-2.0, 2.0);
}

fn light(scenario: &mut Scenario, draw: &mut Draw) -> &'static str {
    let (wide, ceiling) = (scenario.room.half_width_m, scenario.room.ceiling_m);
    let side = draw.sign();
    let bulb = |draw: &mut Draw, side: f64| LampSpec {
        kind: LampKind::Bulb,
        // On the doorway's wall, where the floor in front of the door does not see it.
        at_m: [side * (wide - draw.between(0.2, 0.4)), 0.15, ceiling - draw.between(0.2, 0.4)],
        radius_m: 0.1,
        rgb: [1.0, draw.between(0.88, 1.0), draw.between(0.75, 0.95)],
        size_m: None,
        faces: LampFacing::Down,
        switch: Vec::new(),
    };
    let visible = &mut scenario.visible;
    let thickness = scenario.doorway.wall_thickness_m;
    match draw.pick(&[0, 1, 2]) {
        0 => {
            scenario.lamp = vec![bulb(draw, side)];
            visible.share = draw.between(0.2, 0.35);
            visible.lamp = Vec::new();
            "in the light of a lamp in the room"
        }
        1 => {
            // On the ceiling of the room, so that its light falls through the door.
            scenario.lamp = vec![LampSpec {
                kind: LampKind::Panel,
                at_m: [draw.between(-0.4, 0.4), draw.between(1.4, 2.0), ceiling - 0.02],
                radius_m: 0.3,
                rgb: [1.0, 0.97, 0.9],
                size_m: None,
                faces: LampFacing::Down,
                switch: Vec::new(),
            }];
            visible.share = draw.between(0.35, 0.5);
            let at_m = [draw.between(-0.8, 0.8), -thickness - draw.between(1.3, 2.2), draw.between(2.45, 2.6)];
            visible.lamp =
                vec![VisibleLampSpec { at_m, radius_m: draw.between(0.05, 0.15), share: draw.between(0.4, 0.7) }];
            "under ceiling lamps on both sides"
        }
        _ => {
            scenario.lamp = vec![bulb(draw, side), bulb(draw, -side)];
            visible.share = draw.between(0.4, 0.55);
            // A window on one side.
            let at_m = [draw.sign() * draw.between(2.0, 3.0), -thickness - draw.between(1.0, 2.0), 1.6];
            visible.lamp =
                vec![VisibleLampSpec { at_m, radius_m: draw.between(0.5, 0.8), share: draw.between(0.4, 0.6) }];
            visible.rgb = [0.9, 0.97, 1.1];
            "in daylight"
        }
    }
}
