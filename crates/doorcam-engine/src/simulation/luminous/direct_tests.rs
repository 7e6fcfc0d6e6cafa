use proptest::prelude::*;

use super::super::Scenario;
use super::*;

fn door(wall_thickness_m: f64) -> Doorway {
    Doorway { width_m: 0.8, wall_thickness_m, height_m: None, leaf: None }
}

fn person(centre: Point, radiance: Rgb) -> Cylinder {
    Cylinder { centre, radius_m: 0.2, height_m: 1.75, radiance }
}

fn light(walls: Vec<Wall>, nodes: usize) -> DirectLight {
    DirectLight::new(door(0.1), walls, Quadrature::new(nodes))
}

fn close(a: Rgb, b: Rgb, tolerance: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}

/// Whether light passes both faces of the wall, tested point by point.
fn passes(doorway: &Doorway, pixel: Point, point: Point) -> bool {
    [0.0, -doorway.wall_thickness_m].iter().all(|face| {
        let x = pixel[0] + (point[0] - pixel[0]) * (face - pixel[1]) / (point[1] - pixel[1]);
        x.abs() < doorway.half_width()
    })
}

/// Eq. 2 with the radiometric law over a wall, summed literally over its surface: Σ cos ϑ_floor cos ϑ_wall dA / d².
fn literal_sum(doorway: &Doorway, wall: &Wall, pixel: Point, n: usize) -> f64 {
    let along = [wall.to[0] - wall.from[0], wall.to[1] - wall.from[1]];
    let length = along[0].hypot(along[1]);
    let mut sum = 0.0;
    for i in 0..n {
        let t = (i as f64 + 0.5) / n as f64;
        let d = [wall.from[0] + t * along[0] - pixel[0], wall.from[1] + t * along[1] - pixel[1]];
        if !passes(doorway, pixel, [pixel[0] + d[0], pixel[1] + d[1]]) {
            continue;
        }
        let facing = (d[0] * along[1] - d[1] * along[0]).abs() / length;
        for k in 0..n {
            let z = (k as f64 + 0.5) / n as f64 * wall.height_m;
            let d2 = d[0] * d[0] + d[1] * d[1] + z * z;
            sum += (z / d2.sqrt()) * (facing / d2.sqrt()) / d2;
        }
    }
    sum * length * wall.height_m / (n * n) as f64
}

proptest! {
    #![proptest_config(crate::testing::cases(32))]
    #[test]
    fn a_wall_strip_equals_the_literal_sum_over_its_surface(
        px in -0.6..0.6f64, depth in 0.005..0.3f64, thickness in 0.0..0.2f64,
        x in -1.2..1.2f64, y in 0.6..2.8f64, half in 0.1..0.5f64, turn in -1.0..1.0f64, height_m in 0.5..2.5f64,
    ) {
        let door = door(thickness);
        let (dx, dy) = (half * f64::cos(turn), half * f64::sin(turn));
        let wall = Wall { from: [x - dx, y - dy], to: [x + dx, y + dy], height_m, radiance: [1.0, 0.5, 0.0] };
        let pixel = [px, -thickness - depth];
        let direct = DirectLight::new(door, vec![wall], Quadrature::new(8)).empty(pixel);
        let literal = literal_sum(&door, &wall, pixel, 1500);
        // The sum resolves the border of the visible part to one column only: 1/1500 of the whole at each end.
        let whole = literal_sum(&Doorway { width_m: 1e6, ..door }, &wall, pixel, 60);
        prop_assert!((direct[0] - literal).abs() <= 0.005 * literal + whole * 2.0 / 1500.0, "{direct:?} {literal}");
        prop_assert!(close(direct, [direct[0], direct[0] / 2.0, 0.0], 1e-15));
    }
}

/// A wall that is seen whole has no border that could explain a difference.
#[test]
fn a_wall_strip_seen_whole_equals_the_literal_sum_to_half_a_percent() {
    let wall = Wall { from: [-0.15, 1.4], to: [0.2, 1.2], height_m: 2.0, radiance: [1.0; 3] };
    for pixel in [[0.0, -0.2], [-0.25, -0.12], [0.3, -0.15]] {
        let literal = literal_sum(&door(0.1), &wall, pixel, 800);
        let direct = light(vec![wall], 8).empty(pixel)[0];
        assert!((direct - literal).abs() < 1e-5 * literal, "{direct} {literal}");
    }
}

/// Compared with a literal sum over the cylinder's lit face, which uses no outlines or chords.
#[test]
fn a_person_equals_the_literal_sum_over_the_cylinders_face() {
    let cylinder = Cylinder { height_m: 1.6, ..person([0.1, 1.3], [1.0; 3]) };
    let light = light(Vec::new(), 8);
    let n = 2000;
    for pixel in [[-0.3, -0.15], [0.43, -0.3], [0.3, -0.35]] {
        let mut sum = 0.0;
        for i in 0..n {
            let turn = (i as f64 + 0.5) / n as f64 * std::f64::consts::TAU;
            let normal = [turn.cos(), turn.sin()];
            let point = [0, 1].map(|k| cylinder.centre[k] + cylinder.radius_m * normal[k]);
            let d = [pixel[0] - point[0], pixel[1] - point[1]];
            let facing = d[0] * normal[0] + d[1] * normal[1];
            if facing <= 0.0 || !passes(&door(0.1), pixel, point) {
                continue;
            }
            for k in 0..400 {
                let z = (f64::from(k) + 0.5) / 400.0 * cylinder.height_m;
                let d2 = d[0] * d[0] + d[1] * d[1] + z * z;
                sum += facing * z / (d2 * d2);
            }
        }
        let literal = sum * std::f64::consts::TAU * cylinder.radius_m / f64::from(n) * cylinder.height_m / 400.0;
        let direct = light.change(&light.crowd(vec![cylinder]), pixel)[0];
        assert!((direct - literal).abs() < 0.005 * literal, "{direct} {literal}");
    }
}

#[test]
fn eight_nodes_are_converged() {
    let demo = Scenario::demo();
    let with = |nodes| DirectLight::new(demo.doorway, demo.walls.clone(), Quadrature::new(nodes));
    let (coarse, fine) = (with(8), with(100));
    let (mut largest, mut worst) = (0.0_f64, 0.0_f64);
    for frame in (10..210).step_by(7) {
        let people: Vec<_> = demo.people_in(frame).into_iter().map(|(_, c)| c).collect();
        let crowd = coarse.crowd(people);
        for pixel in [[-0.54, -0.102], [-0.4, -0.2], [-0.27, -0.35], [0.0, -0.15], [0.31, -0.11], [0.5, -0.3]] {
            assert!(close(coarse.empty(pixel), fine.empty(pixel), 2e-8));
            let (change, exact) = (coarse.change(&crowd, pixel), fine.change(&crowd, pixel));
            for c in 0..3 {
                largest = largest.max(exact[c].abs());
                worst = worst.max((change[c] - exact[c]).abs());
            }
        }
    }
    // A fraction of one 16-bit code (1.5e-5), a thousandth of the noise (3e-3).
    assert!(largest > 0.01 && worst < 3e-6, "largest change {largest}, worst error {worst}");
}

#[test]
fn people_out_of_sight_change_nothing() {
    let demo = Scenario::demo();
    let light = DirectLight::new(demo.doorway, demo.walls, Quadrature::new(8));
    let pixel = [-0.3, -0.25];
    let behind_the_wall = person([1.9, 1.5], [1.0; 3]);
    let beside_the_fan = person([-1.2, 0.3], [1.0; 3]);
    for people in [vec![], vec![behind_the_wall], vec![beside_the_fan, behind_the_wall]] {
        assert_eq!(light.change(&light.crowd(people), pixel), [0.0; 3]);
    }
}

#[test]
fn who_stands_behind_another_changes_nothing_where_only_the_nearer_is_seen() {
    let light = light(Scenario::demo().walls, 8);
    let near = person([0.0, 0.9], [0.2, 0.1, 0.1]);
    let far = Cylinder { radius_m: 0.15, ..person([0.0, 2.2], [0.1, 0.1, 0.9]) };
    let alone = light.crowd(vec![near]);
    // In either order.
    for both in [vec![near, far], vec![far, near]] {
        let both = light.crowd(both);
        for pixel in [[0.0, -0.15], [0.02, -0.3]] {
            // To the quadrature's accuracy: the far person's outline splits the interval at another azimuth.
            assert!(close(light.change(&both, pixel), light.change(&alone, pixel), 1e-9));
        }
        let aside = [0.38, -0.35];
        assert!(light.change(&both, aside)[2] > light.change(&alone, aside)[2] + 1e-4);
    }
}

#[test]
fn a_taller_surface_shows_above_a_nearer_one() {
    let wall = Wall { from: [-9.0, 2.0], to: [9.0, 2.0], height_m: 3.0, radiance: [0.0, 1.0, 0.0] };
    let low = Wall { from: [-9.0, 1.0], to: [9.0, 1.0], height_m: 0.8, radiance: [1.0, 0.0, 0.0] };
    let pixel = [0.1, -0.2];
    let [red, green, _] = light(vec![wall, low], 8).empty(pixel);
    let all = light(vec![wall], 8).empty(pixel)[1];
    let hidden = light(vec![Wall { height_m: 0.8 / 1.2 * 2.2, ..wall }], 8).empty(pixel)[1];
    assert!((red - light(vec![low], 8).empty(pixel)[0]).abs() < 1e-12);
    assert!((green - (all - hidden)).abs() < 1e-12, "{green} {all} {hidden}");
}

#[test]
fn a_lintel_hides_what_is_above_its_shadow() {
    let wall = |height_m| vec![Wall { from: [-3.0, 2.0], to: [3.0, 2.0], height_m, radiance: [1.0; 3] }];
    let pixel = [0.1, -0.5];
    let under = Doorway { height_m: Some(0.3), ..door(0.1) };
    let cut = DirectLight::new(under, wall(3.0), Quadrature::new(8)).empty(pixel);
    // Seen from 0.5 m in front of the hidden face, 0.3 m there is 1.5 m on the wall 2.5 m away.
    assert!(close(cut, light(wall(1.5), 8).empty(pixel), 1e-12));
}
