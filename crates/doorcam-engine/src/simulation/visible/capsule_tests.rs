use proptest::prelude::*;

use super::*;

/// Distance of a place from the line between two points, by trying many points of the line.
fn apart(place: Vector, from: Vector, to: Vector) -> f64 {
    let at = |k: i32| along(from, f64::from(k) / 400.0, sub(to, from));
    (0..=400)
        .map(|k| {
            let d = sub(place, at(k));
            dot(d, d).sqrt()
        })
        .fold(f64::INFINITY, f64::min)
}

fn place() -> impl Strategy<Value = Vector> {
    [-1.0..1.0f64, -1.0..1.0f64, 0.0..1.8f64]
}

proptest! {
    #![proptest_config(crate::testing::cases(128))]
    /// Compared with marching along the ray.
    #[test]
    fn a_ray_meets_a_capsule_where_marching_along_it_enters(
        from in place(), to in place(), radius in 0.05..0.3f64, aim in place(),
    ) {
        let capsule = Capsule { from, to, radius };
        let eye = [0.3, -2.5, 2.4];
        let ray = sub(aim, eye);
        let inside = |t: f64| apart(along(eye, t, ray), from, to) - radius;
        // Steps of 1/300 of the ray, which is 2 to 5 m long.
        let entered = (0..600).map(|k| f64::from(k) / 300.0).find(|&t| inside(t) < 0.0);
        match (capsule.meet(eye, ray), entered) {
            (Some(t), Some(entered)) => {
                prop_assert!((-1e-9..=1.0 / 299.0).contains(&(entered - t)), "{t} {entered}");
                let normal = capsule.normal(along(eye, t, ray));
                prop_assert!((dot(normal, normal) - 1.0).abs() < 1e-6 && dot(normal, ray) <= 1e-6);
            }
            // A step may jump over what is barely touched.
            (Some(t), None) => prop_assert!(t > 1.99 || inside(t).abs() < 2e-3, "{t}"),
            (None, Some(entered)) => prop_assert!(false, "missed at {entered}"),
            (None, None) => {}
        }
    }

    #[test]
    fn the_nearest_points_of_two_lines_are_nearer_than_any_others(
        a in place(), b in place(), c in place(), d in place(),
    ) {
        let [share, distance] = nearest(a, b, c, d);
        let others = (0..=200).map(|k| apart(along(a, f64::from(k) / 200.0, sub(b, a)), c, d));
        let tried = others.fold(f64::INFINITY, f64::min);
        prop_assert!(distance <= tried + 1e-9 && tried <= distance + 0.02, "{distance} {tried}");
        prop_assert!((apart(along(a, share, sub(b, a)), c, d) - distance).abs() < 0.01);
    }
}

#[test]
fn a_ball_is_a_capsule_without_length() {
    let ball = Capsule { from: [0.0, 0.0, 1.0], to: [0.0, 0.0, 1.0], radius: 0.25 };
    assert_eq!(ball.meet([0.0, -2.0, 1.0], [0.0, 1.0, 0.0]), Some(1.75));
    assert_eq!(ball.meet([0.3, -2.0, 1.0], [0.0, 1.0, 0.0]), None);
    assert_eq!(ball.meet([0.0, 2.0, 1.0], [0.0, 1.0, 0.0]), None);
}

/// Compared with rays to points all over the lamp, sharp and soft.
#[test]
fn a_shadow_is_the_share_of_rays_to_the_lamp_that_the_capsule_stops() {
    let trunk = Capsule { from: [0.0, -0.8, 0.9], to: [0.05, -0.8, 1.3], radius: 0.16 };
    let leg = Capsule { from: [0.1, -0.7, 0.05], to: [0.0, -0.85, 0.8], radius: 0.07 };
    for (lamp, radius) in [([0.4, -2.2, 2.5], 0.05), ([0.4, -2.2, 2.5], 0.15), ([-2.5, -1.5, 1.6], 0.6)] {
        for capsule in [trunk, leg] {
            let (mut partial, mut whole, mut error, mut count) = (0, 0, 0.0, 0.0);
            for k in 0..40 * 40 {
                let place = [f64::from(k % 40) * 0.08 - 1.6, f64::from(k / 40) * 0.05 - 1.6, 0.0];
                if apart(place, capsule.from, capsule.to) < capsule.radius {
                    continue;
                }
                let literal = stopped(&capsule, place, lamp, radius);
                let ours = capsule.hides(place, 0.0, lamp, radius);
                partial += i32::from((0.1..0.9).contains(&literal));
                whole += i32::from(literal > 0.99);
                if literal > 0.0 || ours > 0.0 {
                    error += (literal - ours).abs();
                    count += 1.0;
                    assert!((literal - ours).abs() < 0.25, "{place:?}: {literal} {ours}, {lamp:?} {radius}");
                }
            }
            assert!(partial >= 5 && (whole >= 5 || radius > 0.5), "{partial} {whole}");
            assert!(error / count < 0.04, "{} in the mean, {lamp:?} {radius}", error / count);
        }
    }
}

fn stopped(capsule: &Capsule, place: Vector, lamp: Vector, radius: f64) -> f64 {
    // Two directions across that to the lamp.
    let to = sub(lamp, place);
    let long = dot(to, to).sqrt();
    let flat = to[0].hypot(to[1]);
    let aside = [to[1] / flat, -to[0] / flat, 0.0];
    let up = [-to[0] * to[2] / (flat * long), -to[1] * to[2] / (flat * long), flat / long];
    let (mut hit, mut all) = (0.0, 0.0);
    for k in 0..24 * 24 {
        let [a, b] = [k % 24, k / 24].map(|i| (f64::from(i) + 0.5) / 12.0 - 1.0);
        if a * a + b * b < 1.0 {
            let end = along(along(lamp, a * radius, aside), b * radius, up);
            hit += f64::from(u8::from(capsule.meet(place, sub(end, place)).is_some_and(|t| t < 1.0)));
            all += 1.0;
        }
    }
    hit / all
}
