//! Lights that somebody has described.

use proptest::prelude::*;

use super::surfaces::Surfaces;
use super::tests::{DOOR, PATCH, ROOM, fit_with, picture, room_with};
use super::*;
use crate::geometry::{LightKind, Point, RoomLight, Side};
use crate::transport::Body;

const WINDOW: RoomLight =
    RoomLight { kind: LightKind::Window, from_m: [0.1, 4.0], to_m: [1.2, 4.0], height_m: [1.1, 2.2], on: true };
/// In the middle of the room, so that people walk behind it too.
const LAMP: RoomLight =
    RoomLight { kind: LightKind::Lamp, from_m: [-0.9, 1.9], to_m: [-0.5, 2.2], height_m: [1.0, 1.5], on: true };

/// A room of even walls with these lights.
fn lit(lights: &[RoomLight], walls: f64, strength: f64) -> StillRoom {
    let of_room = Surfaces::new(ROOM, lights).of_room();
    room_with(lights, |piece| [if piece < of_room { walls } else { strength }; 3])
}

/// Light of one upright strip of unit radiance at a floor point, and what a cylinder takes of it, summed over points of the
/// strip: the cosines of the angles at the floor and at the strip, over the squared distance.
fn literal(light: &RoomLight, [px, py]: Point, body: &Body) -> [f64; 2] {
    const N: usize = 120;
    let [from, to] = [light.from_m, light.to_m];
    let along = [to[0] - from[0], to[1] - from[1]];
    let length = along[0].hypot(along[1]);
    let normal = [along[1] / length, -along[0] / length];
    let [lower, upper] = light.height_m;
    let area = length * (upper - lower) / (N * N) as f64;
    let (mut all, mut hidden) = (0.0, 0.0);
    for i in 0..N {
        let part = (i as f64 + 0.5) / N as f64;
        let at = [0, 1].map(|k| from[k] + part * along[k]);
        let away = [at[0] - px, at[1] - py];
        let crosses = |face: f64| (px + away[0] * (face - py) / away[1]).abs() < DOOR.half_width();
        if !crosses(0.0) || !crosses(-DOOR.wall_thickness_m) {
            continue;
        }
        let ground = away[0].hypot(away[1]);
        let to_body = [body.centre[0] - px, body.centre[1] - py];
        let distance = to_body[0].hypot(to_body[1]);
        let beside = (to_body[0] * away[1] - to_body[1] * away[0]) / ground;
        let before = beside.abs() < body.radius_m && distance < ground;
        for j in 0..N {
            let z = lower + (j as f64 + 0.5) / N as f64 * (upper - lower);
            // Under the lintel.
            if z / away[1] * -py > 2.03 {
                break;
            }
            let r2 = ground * ground + z * z;
            let towards = (away[0] * normal[0] + away[1] * normal[1]).abs();
            let value = z * towards / (r2 * r2) * area;
            all += value;
            if before && z / ground * distance < body.height_m {
                hidden += value;
            }
        }
    }
    [all, hidden]
}

proptest! {
    #![proptest_config(crate::testing::cases(32))]
    #[test]
    fn a_light_and_what_a_cylinder_hides_of_it_equal_sums_over_its_points(
        px in -0.6..0.6f64, depth in 0.02..0.3f64, x in -1.5..1.5f64, y in 0.6..3.5f64, lamp in proptest::bool::ANY,
    ) {
        let light = if lamp { LAMP } else { WINDOW };
        let still = lit(&[light], 0.0, 1.0);
        let point = [px, -DOOR.wall_thickness_m - depth];
        let seen = still.seen(&DOOR, &FloorView::new(&DOOR, point));
        let body = Body { centre: [x, y], radius_m: 0.2, height_m: 1.7 };
        let [all, hidden] = literal(&light, point, &body);
        let most = literal(&light, [0.0, point[1]], &body)[0];
        prop_assert!((seen.light()[1] - all).abs() < 0.03 * all + 0.05 * most, "{} {all} {most}", seen.light()[1]);
        // The model takes the distance of a body's axis and the azimuth's middle, so borders are off by a little.
        let found = seen.hidden(&body)[1];
        let touches = literal(&light, point, &Body { radius_m: 0.3, ..body })[1] > 0.0;
        prop_assert!(if touches { (found - hidden).abs() < 0.12 * most } else { found < 0.02 * most }, "{found} {hidden} of {most}");
    }
}

#[test]
fn a_lamp_in_the_room_is_hidden_by_those_before_it_only() {
    let still = lit(&[LAMP], 0.0, 1.0);
    let seen = still.seen(&DOOR, &FloorView::new(&DOOR, [0.3, -0.3]));
    let at = |part: f64| [0.3 - part * 1.0, -0.3 + part * 2.35];
    let hidden = |part: f64| seen.hidden(&Body { centre: at(part), radius_m: 0.2, height_m: 1.7 })[0];
    assert!(hidden(0.7) > 0.5 * seen.light()[0], "{} of {}", hidden(0.7), seen.light()[0]);
    assert_eq!(hidden(1.4), 0.0);
}

#[test]
fn a_described_window_has_its_light_and_its_place() {
    let truth = lit(&[WINDOW], 0.1, 4.0);
    let empty = picture(&truth, 0.15);
    let (known, unknown) = (fit_with(&[WINDOW], &empty), fit_with(&[], &empty));
    let window = known.radiance.last().unwrap();
    assert!(window.iter().all(|v| (v - 4.0).abs() < 0.4), "{window:?}");
    assert!(known.is_bright() && known.misfit() <= 1.05 * unknown.misfit(), "{} {}", known.misfit(), unknown.misfit());
    assert!(known.bright_things().is_empty(), "{:?}", known.bright_things());
    // How much better it is known what people before it hide.
    let even = lit(&[], 0.1, 0.0);
    let wrong = |still: &StillRoom| {
        let mut wrong = 0.0;
        for (x, y) in [(0.4, 2.0), (0.2, 1.5), (0.1, 1.0), (0.5, 3.0)] {
            let body = Body { centre: [x, y], radius_m: 0.2, height_m: 1.7 };
            for point in Side::BOTH.into_iter().flat_map(|side| PATCH.points(&DOOR, side)).step_by(7) {
                let view = FloorView::new(&DOOR, point);
                let beyond = truth.seen(&DOOR, &view).hidden(&body)[1] - even.seen(&DOOR, &view).hidden(&body)[1];
                wrong += (still.seen(&DOOR, &view).hidden(&body)[1] - beyond).powi(2);
            }
        }
        wrong.sqrt()
    };
    assert!(wrong(&known) < 0.5 * wrong(&unknown), "{} {}", wrong(&known), wrong(&unknown));
}

#[test]
fn a_light_that_is_off_is_no_light() {
    let empty = picture(&lit(&[], 0.1, 0.0), 0.15);
    let off = RoomLight { on: false, ..WINDOW };
    assert_eq!(fit_with(&[off], &empty), fit_with(&[], &empty));
}
