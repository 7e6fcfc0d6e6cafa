use super::super::super::scenario::{SMALLEST, Scenario};
use super::super::super::view::{Bump, Seen, Surface};
use super::super::super::{Simulator, Walk};
use super::super::gait::pose;
use super::super::{Looks, VisibleLamp, VisibleLampSpec};
use super::*;
use crate::simulation::floor::FloorMap;
use crate::simulation::scenario::FrameFormat;

const LOOKS: Looks = Looks { radius: 0.2, height: 1.7, clothes: [0.5; 3], trousers: [0.2; 3], skin: [0.4; 3] };

fn body(at: Point) -> Body {
    let [x, y] = at;
    let walk = Walk { waypoints: vec![(0.0, [x, y - 1.0]), (1.0, [x, y]), (2.0, [x + 0.2, y + 1.0])], period_s: None };
    Body::person(&LOOKS, &pose(&walk, 1.0).unwrap())
}

fn scenario() -> Scenario {
    let text = SMALLEST.replace("[camera]", "[camera]\nsize = [64, 36]");
    let text = text.replace("at_m = [0.05, -0.75, 1.3]", "at_m = [0.05, -0.8, 2.3]");
    Scenario::parse(&text).unwrap()
}

fn stage<'a>(
    doorway: &'a Doorway,
    lamps: &'a [VisibleLamp],
    bodies: &'a [Body],
    hidden: &'a (dyn Fn(Point) -> Rgb + Sync),
) -> Stage<'a> {
    Stage { doorway, lamps, ambient: 0.6, bodies, visible: [1.0; 3], hidden }
}

/// Whether a place is in a body, in the wall or below the floor: all that marching along a line of sight needs.
fn in_body(body: &Body, place: Vector) -> bool {
    body.capsules.iter().any(|(capsule, _)| {
        let axis = sub(capsule.to, capsule.from);
        let share = dot(sub(place, capsule.from), axis) / dot(axis, axis).max(1e-12);
        let apart = sub(place, along(capsule.from, share.clamp(0.0, 1.0), axis));
        dot(apart, apart) < capsule.radius * capsule.radius
    })
}

fn in_wall(doorway: &Doorway, [x, y, z]: Vector) -> bool {
    let open = x.abs() < doorway.half_width() && doorway.height_m.is_none_or(|h| z < h);
    z < 0.0 || (y > -doorway.wall_thickness_m && y < 0.0 && !open)
}

/// Before the wall, on the threshold, behind it, and half hidden by the wall: with and without a bump.
#[test]
fn a_pixel_shows_a_body_if_its_line_of_sight_meets_one_before_the_wall_or_the_floor() {
    let mut scenario = scenario();
    scenario.doorway.height_m = Some(2.0);
    let doorway = scenario.doorway;
    let map = FloorMap::new(doorway);
    let seen = Seen { doorway: &doorway, floor: &scenario.floor, wall: &scenario.wall, map: &map };
    let mut partly = 0;
    for (at, bump) in [
        ([0.1, -0.5], Bump::default()),
        ([-0.1, -0.05], Bump { shift: [3.0, -2.0], turn_deg: 3.0 }),
        ([0.1, 0.25], Bump::default()),
        ([0.6, 0.2], Bump::default()),
        ([0.05, -0.85], Bump::default()),
    ] {
        let camera = Pinhole::new(&scenario.camera).bumped(bump);
        let view = View::picture(&camera, &seen);
        let bodies = [body(at)];
        let sights = stage(&doorway, &[], &bodies, &|_| [0.0; 3]).sights(&view, Some(&camera));
        for (k, sight) in sights.iter().enumerate() {
            let mut covered = 0.0;
            for part in 0..4 {
                let [du, dv] = [part % 2, part / 2].map(|i| f64::from(i) * 0.5 - 0.25);
                let ray = camera.ray([(k % 64) as f64 + du, (k / 64) as f64 + dv]);
                let first = (1..4000).map(|step| along(camera.at, f64::from(step) * 1e-3, ray));
                let met = first.into_iter().find(|&at| in_body(&bodies[0], at) || in_wall(&doorway, at));
                covered += if met.is_some_and(|at| in_body(&bodies[0], at)) { 0.25 } else { 0.0 };
            }
            // A step of a millimetre may pass what is barely touched.
            assert!((sight.covered - covered).abs() < 0.26, "{at:?}, pixel {k}: {} {covered}", sight.covered);
            partly += i32::from((sight.covered - covered).abs() > 0.01);
        }
        let whole = sights.iter().filter(|sight| sight.covered == 1.0).count();
        assert!(whole > 20 || at == [0.6, 0.2], "{at:?}: {whole}");
    }
    assert!(partly < 20, "{partly} pixels differ by one sample");
}

/// The whole floor's light, of lamps and sky, compared with rays from the floor to all of them.
#[test]
fn the_floor_lacks_what_rays_to_lamps_and_sky_say() {
    let scenario = scenario();
    let doorway = scenario.doorway;
    let reference = [[-0.5, -0.25], [0.5, -0.25]];
    let spec = VisibleLampSpec { at_m: [0.4, -2.2, 2.5], radius_m: 0.15, share: 0.4 };
    let lamp = VisibleLamp::new(&spec, &reference);
    assert!((reference.map(|p| lamp.on_floor(p)).iter().sum::<f64>() / 2.0 - 0.4).abs() < 1e-12);
    let bodies = [body([0.1, -0.7])];
    let stage = stage(&doorway, std::slice::from_ref(&lamp), &bodies, &|_| [0.0; 3]);
    let (mut error, mut count, mut darkest) = (0.0, 0.0, 1.0_f64);
    for k in 0..20 * 12 {
        let place = [f64::from(k % 20) * 0.1 - 0.95, f64::from(k / 20) * 0.08 - 1.05];
        let at = [place[0], place[1], 1e-6];
        if in_body(&bodies[0], at) {
            continue;
        }
        let stops = |ray: Vector, until: f64| {
            bodies[0].capsules.iter().any(|(capsule, _)| capsule.meet(at, ray).is_some_and(|t| t < until))
        };
        let n = 48;
        let mut sky = 0.0;
        for k in 0..n * n {
            let (phi, s) =
                (((k % n) as f64 + 0.5) / n as f64 * std::f64::consts::TAU, ((k / n) as f64 + 0.5) / n as f64);
            let ray = [phi.cos() * (1.0 - s).sqrt(), phi.sin() * (1.0 - s).sqrt(), s.sqrt()];
            sky += f64::from(u8::from(!stops(ray, f64::INFINITY))) / (n * n) as f64;
        }
        // What a body reflects is half of its albedo.
        let dark = 1.0 - REFLECTED * 0.35;
        let sky = 1.0 - dark * (1.0 - sky);
        let mut free = 0.0;
        let mut all = 0.0;
        for k in 0..16 * 16 {
            let [a, b] = [k % 16, k / 16].map(|i| (f64::from(i) + 0.5) / 8.0 - 1.0);
            if a * a + b * b < 1.0 {
                // The lamp is high above: a level disc is nearly the sphere that it is.
                let end = [lamp.at[0] + a * lamp.radius, lamp.at[1] + b * lamp.radius, lamp.at[2]];
                free += f64::from(u8::from(!stops(sub(end, at), 1.0)));
                all += 1.0;
            }
        }
        let expected = 0.6 * sky + lamp.on_floor(place) * free / all;
        let found = stage.on_floor(place, 1.0);
        darkest = darkest.min(found);
        // Below somebody, where the camera sees little of the floor, upright legs are not quite where legs are.
        if (place[0] - 0.1).hypot(place[1] + 0.7) < 0.45 {
            continue;
        }
        assert!((found - expected).abs() < 0.16, "{place:?}: {found} {expected}");
        error += (found - expected).abs();
        count += 1.0;
    }
    assert!(error / count < 0.05 && darkest < 0.45, "{} {darkest}", error / count);
}

/// Behind the wall only what comes through the opening is seen of a lamp.
#[test]
fn the_wall_hides_a_lamp_of_the_visible_side_from_the_hidden_floor() {
    let doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: Some(2.0), leaf: None };
    let lamp = [0.0, -2.0, 2.5];
    let seen = |x: f64, y: f64| lit_through(&doorway, lamp, 0.1, [x, y, 0.0]);
    assert_eq!([seen(0.0, -0.3), seen(3.0, -0.2), seen(0.0, 0.3)], [1.0; 3]);
    assert_eq!([seen(0.6, 0.1), seen(0.0, 20.0)], [0.0; 2]);
    let edge = 0.4 * 2.3 / 2.0;
    assert!((seen(edge, 0.3) - 0.5).abs() < 0.01, "{}", seen(edge, 0.3));
}

/// Every pixel of a bumped picture shows what the same picture showed elsewhere before.
#[test]
fn a_bump_shifts_and_turns_the_picture_about_its_middle() {
    let scenario = scenario();
    let bump = Bump { shift: [6.0, -3.5], turn_deg: 2.0 };
    let (before, after) = (Pinhole::new(&scenario.camera), Pinhole::new(&scenario.camera).bumped(bump));
    for point in [[0.1, -0.4], [-0.3, -0.2], [0.2, -0.6]] {
        let (Some([u, v]), Some(moved)) = (before.see(point), after.see(point)) else { panic!("{point:?} is seen") };
        let (x, y) = (u - 31.5, v - 17.5);
        let (sine, cosine) = f64::to_radians(2.0).sin_cos();
        // Clockwise where down is positive.
        let expected = [31.5 + cosine * x - sine * y + 6.0, 17.5 + sine * x + cosine * y - 3.5];
        assert!((moved[0] - expected[0]).hypot(moved[1] - expected[1]) < 1e-9, "{moved:?} {expected:?}");
        let places = [before.meet(&scenario.doorway, [u, v]), after.meet(&scenario.doorway, moved)];
        let [(Surface::Floor(a), _), (Surface::Floor(b), _)] = places else { panic!("{point:?} is floor") };
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9);
    }
    let mut scenario = Scenario::parse(SMALLEST).unwrap();
    let camera = &mut scenario.camera;
    (camera.size, camera.format, camera.bump) = ([64, 48], FrameFormat::Png, vec![(1.0, 5.0, 0.0, 0.0)]);
    (camera.full_scale_electrons, camera.read_electrons) = (f64::INFINITY, 0.0);
    let simulator = Simulator::new(scenario, 1).unwrap();
    let picture = |number: u64| {
        let frame = simulator.frame(number).unwrap();
        let doorcam_source::RawImages::Camera(png) = &frame.images else { panic!("a picture") };
        let image = doorcam_source::image::decode(png).unwrap();
        let doorcam_core::image::Samples::Eight(codes) = image.samples else { panic!("8 bits") };
        codes
    };
    // The empty time is 1 s at 5 frames a second; the bump comes a second later.
    let (first, moved) = (picture(9), picture(10));
    assert_eq!(first, picture(0));
    for row in 0..48 {
        let at = 3 * 64 * row;
        assert_eq!(moved[at + 15..at + 192], first[at..at + 177], "row {row}");
    }
}
