//! Compares the bound with independent methods: integrals in polar coordinates, and simulated estimates.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Matrix3, Vector3};
use proptest::prelude::*;
use rayon::prelude::*;

use super::pixel_light::patch_light;
use super::{Bound, Setup, Strategy, place_of, plotted_angles, sample_measurement};
use crate::bound::quadrature::Rule;
use crate::geometry::{Biangular, Doorway, Point, Side};

fn unit_noise() -> Setup {
    Setup { noise: 1.0, ..Setup::PUBLISHED }
}

fn degrees(alpha1: f64, alpha2: f64) -> Biangular {
    Biangular { alpha1: alpha1.to_radians(), alpha2: alpha2.to_radians() }
}

fn place(setup: &Setup, alpha1: f64, alpha2: f64) -> Point {
    place_of(&setup.doorway, degrees(alpha1, alpha2)).unwrap()
}

/// Eq. 9 for one pixel in polar coordinates around the edge; `angles` are the target's at this edge and at the other
/// one. Integrated along a ray in closed form, and over θ by Gauss quadrature between the pixel's corners and the
/// shadow's edge.
fn polar(width_m: f64, [phi, other]: [f64; 2], edge: bool, [x, y]: [[f64; 2]; 2], rule: &Rule) -> f64 {
    let rho = width_m * other.sin() / (PI - phi - other).sin();
    // The pixel's corners as angles from the wall, which extends from the edge towards -x; the floor is at y < 0.
    let mut breaks: Vec<f64> = x.iter().flat_map(|&x| y.map(|y| (-y).max(0.0).atan2(-x))).collect();
    if edge {
        breaks.iter_mut().for_each(|theta| *theta = theta.max(phi));
    }
    breaks.sort_by(f64::total_cmp);
    let along = |theta: f64| {
        let (b, k) = (rho * (theta - phi).cos(), rho * (theta - phi).sin().abs());
        let (mut r1, mut r2) = (0.0_f64, f64::INFINITY);
        for ([low, high], direction) in [(x, -theta.cos()), (y, -theta.sin())] {
            let ends = [low / direction, high / direction];
            r1 = r1.max(ends[0].min(ends[1]));
            r2 = r2.min(ends[0].max(ends[1]));
        }
        if r2 <= r1 {
            return 0.0;
        }
        let q = |r: f64| r * r + 2.0 * b * r + rho * rho;
        // `turn` is (atan((r2 + b) / k) − atan((r1 + b) / k)) / k; k is 0 if the ray points at the target.
        let slope = (r2 - r1) / (k * k + (r1 + b) * (r2 + b));
        let turn = if k * slope > 1e-9 { (k * slope).atan() / k } else { slope };
        0.5 * (q(r2) / q(r1)).ln() - b * turn
    };
    breaks.windows(2).flat_map(|pair| rule.segment(pair[0], pair[1])).map(|(theta, w)| w * along(theta)).sum()
}

/// The bound from [`polar`] in the paper's own parameters, with derivatives by differences of its exact values.
fn by_polar(setup: &Setup, strategy: Strategy, angles: [f64; 2]) -> [f64; 3] {
    const STEP: f64 = 1e-6;
    let (n, rule, cell) = (setup.pixels, Rule::with_nodes(6), setup.patch_m / setup.pixels as f64);
    let pixel = |side: Side, k: usize, [phi1, phi2]: [f64; 2]| {
        let (row, column) = ((k / n) as f64, (k % n) as f64);
        let x = [column, column + 1.0].map(|c| c * cell - setup.patch_m / 2.0);
        let y = [-(row + 1.0) * cell, -row * cell];
        // The right patch mirrored: the order of pixels does not matter to their sum.
        let seen = if side == Side::Left { [phi1, phi2] } else { [phi2, phi1] };
        polar(setup.doorway.width_m, seen, strategy.has_edge(), [x, y], &rule)
    };
    let sum = strategy.sides().iter().map(|&side| {
        let outer = (0..n * n).into_par_iter().map(|k| {
            let at = |d1: f64, d2: f64| pixel(side, k, [angles[0] + d1 * STEP, angles[1] + d2 * STEP]);
            let by1 = (at(1.0, 0.0) - at(-1.0, 0.0)) / (2.0 * STEP);
            let by2 = (at(0.0, 1.0) - at(0.0, -1.0)) / (2.0 * STEP);
            let gradient = Vector3::new(at(0.0, 0.0), by1, by2) / setup.noise;
            gradient * gradient.transpose()
        });
        outer.sum::<Matrix3<f64>>()
    });
    let inverse = sum.sum::<Matrix3<f64>>().try_inverse().unwrap();
    [0, 1, 2].map(|k| inverse[(k, k)].sqrt())
}

#[test]
fn the_bound_agrees_with_an_independent_quadrature() {
    let setup = unit_noise();
    for [phi1, phi2] in [[60.0, 60.0], [90.0, 45.0], [35.0, 110.0], [75.0, 75.0], [20.0, 25.0]] {
        let angles = degrees(phi1, phi2);
        for (strategy, bound) in Strategy::ALL.into_iter().zip(setup.bounds(place(&setup, phi1, phi2))) {
            let expected = by_polar(&setup, strategy, [angles.alpha1, angles.alpha2]);
            for (found, expected) in [bound.sd_c, bound.sd_phi1, bound.sd_phi2].into_iter().zip(expected) {
                let ratio = found / expected;
                assert!((ratio - 1.0).abs() < 1e-3, "{strategy:?} at {phi1}, {phi2}: {found} for {expected}");
            }
            assert_eq!(setup.bound(strategy, place(&setup, phi1, phi2)), bound);
        }
    }
}

#[test]
fn coarse_pixels_and_near_targets_are_integrated_too() {
    for pixels in [2, 3, 8] {
        let setup = Setup { pixels, ..unit_noise() };
        for [phi1, phi2] in [[3.0, 5.0], [120.0, 4.0], [80.0, 62.0]] {
            let angles = degrees(phi1, phi2);
            let expected = by_polar(&setup, Strategy::Doorway, [angles.alpha1, angles.alpha2]);
            let bound = setup.bound(Strategy::Doorway, place(&setup, phi1, phi2));
            for (found, expected) in [bound.sd_c, bound.sd_phi1, bound.sd_phi2].into_iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 3e-3, "{pixels}, {phi1}, {phi2}: {found} for {expected}");
            }
        }
    }
}

/// With a strong signal, a maximum-likelihood estimate attains the bound: the most direct check of the bound.
#[test]
fn a_maximum_likelihood_estimate_attains_the_bound() {
    const TRIALS: usize = 600;
    let setup = Setup { noise: 1e-8, ..Setup::PUBLISHED };
    for [phi1, phi2] in [[60.0, 70.0], [100.0, 40.0], [35.0, 35.0]] {
        let truth = place(&setup, phi1, phi2);
        let bound = setup.bound(Strategy::Doorway, truth);
        let errors: Vec<Vector3<f64>> = (0..TRIALS as u64)
            .into_par_iter()
            .map(|seed| {
                let measured = sample_measurement(&setup, Strategy::Doorway, truth, seed);
                let [c, x, y] = maximum_likelihood(&setup, &measured, [1.0, truth[0], truth[1]]);
                let found = Biangular::from_point(&setup.doorway, [x, y]);
                let angles = degrees(phi1, phi2);
                Vector3::new(c - 1.0, found.alpha1 - angles.alpha1, found.alpha2 - angles.alpha2)
            })
            .collect();
        for (k, sd) in [bound.sd_c, bound.sd_phi1, bound.sd_phi2].into_iter().enumerate() {
            let rms = (errors.iter().map(|e| e[k] * e[k]).sum::<f64>() / TRIALS as f64).sqrt();
            assert!((rms / sd - 1.0).abs() < 0.1, "parameter {k} at {phi1}, {phi2}: {rms} for {sd}");
        }
    }
}

/// Least squares by Fisher scoring from a start nearby, until the step is negligible.
fn maximum_likelihood(setup: &Setup, measured: &[Vec<f64>], start: [f64; 3]) -> [f64; 3] {
    let mut at = Vector3::from(start);
    for _ in 0..30 {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (side, values) in Side::BOTH.into_iter().zip(measured) {
            for (pixel, value) in patch_light(setup, side, true, [at[1], at[2]]).iter().zip(values) {
                let gradient = Vector3::new(pixel.light, at[0] * pixel.by[0], at[0] * pixel.by[1]);
                normal += gradient * gradient.transpose();
                right += gradient * (value - at[0] * pixel.light);
            }
        }
        let step = normal.try_inverse().unwrap() * right;
        at += step;
        if step.norm() < 1e-9 {
            return at.into();
        }
    }
    panic!("no convergence");
}

#[test]
fn the_order_of_figure_5_holds_at_every_plotted_point() {
    for (width_m, patch_m) in [(1.0, 0.2), (0.5, 0.15), (0.85, 0.3), (2.0, 0.1)] {
        let doorway = Doorway { width_m, ..Setup::PUBLISHED.doorway };
        let setup = Setup { doorway, patch_m, ..Setup::PUBLISHED };
        let points = plotted_angles(&doorway);
        assert_eq!(points.len(), 28);
        for angles in points {
            let [single, corner, double, door] = setup.bounds(place_of(&doorway, angles).unwrap());
            let pair = |b: Bound| [b.sd_phi1, b.sd_phi2];
            let below = |a: Bound, b: Bound| pair(a).into_iter().zip(pair(b)).all(|(a, b)| a <= b);
            assert!(below(door, corner) && below(door, double), "{angles:?}");
            assert!(below(double, single), "{angles:?}");
            assert!(corner.sd_phi1 < 0.2 * single.sd_phi1, "{angles:?}: {} {}", corner.sd_phi1, single.sd_phi1);
            let ratio = corner.sd_phi2 / single.sd_phi2;
            assert!((0.4..2.0).contains(&ratio), "{angles:?}: {ratio} {corner:?} {single:?}");
        }
    }
}

proptest! {
    #![proptest_config(crate::testing::cases(24))]

    #[test]
    fn errors_grow_with_the_noise(x in -1.5..1.5f64, y in 0.1..3.0f64, factor in 0.01..100.0f64) {
        let quiet = Setup { pixels: 12, ..Setup::PUBLISHED };
        let noisy = Setup { noise: factor * quiet.noise, ..quiet };
        for (a, b) in quiet.bounds([x, y]).into_iter().zip(noisy.bounds([x, y])) {
            for (a, b) in
                [(a.sd_c, b.sd_c), (a.sd_phi1, b.sd_phi1), (a.sd_phi2, b.sd_phi2), (a.error_m(), b.error_m())]
            {
                prop_assert!((b / (factor * a) - 1.0).abs() < 1e-9, "{a} {b}");
            }
        }
    }

    /// Mirroring exchanges the two angles.
    #[test]
    fn the_mirror_image_of_a_room_is_as_uncertain(x in -1.5..1.5f64, y in 0.1..3.0f64, thickness in 0.0..0.2f64) {
        let doorway = Doorway { wall_thickness_m: thickness, ..Setup::PUBLISHED.doorway };
        let setup = Setup { doorway, pixels: 12, ..Setup::PUBLISHED };
        for strategy in [Strategy::DoublePatch, Strategy::Doorway] {
            let (here, there) = (setup.bound(strategy, [x, y]), setup.bound(strategy, [-x, y]));
            for (a, b) in [(here.sd_c, there.sd_c), (here.sd_phi1, there.sd_phi2), (here.sd_phi2, there.sd_phi1)] {
                prop_assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
            }
            let scale = here.error_m().powi(2);
            prop_assert!((here.covariance_m2[0][1] + there.covariance_m2[0][1]).abs() < 1e-6 * scale);
        }
        let pixels = |x, side| patch_light(&setup, side, true, [x, y]);
        for (row, mirrored) in pixels(x, Side::Left).chunks(12).zip(pixels(-x, Side::Right).chunks(12)) {
            for (a, b) in row.iter().zip(mirrored.iter().rev()) {
                prop_assert_eq!((a.light, a.by[0], a.by[1]), (b.light, -b.by[0], b.by[1]));
            }
        }
    }

    /// If doorway, patches and room are scaled together, the angles stay the same: light falls with the square of the
    /// distance, and a pixel's area grows with it.
    #[test]
    fn size_does_not_matter_to_angles(
        x in -0.4..1.0f64, y in 0.4..3.0f64, size in 0.2..5.0f64, thickness in 0.0..0.2f64,
    ) {
        let doorway = Doorway { wall_thickness_m: thickness, ..Setup::PUBLISHED.doorway };
        let setup = Setup { doorway, pixels: 9, ..Setup::PUBLISHED };
        let large = Setup {
            doorway: Doorway { width_m: size, wall_thickness_m: size * thickness, height_m: None, leaf: None },
            patch_m: size * setup.patch_m,
            ..setup
        };
        for (a, b) in setup.bounds([x, y]).into_iter().zip(large.bounds([size * x, size * y])) {
            prop_assert!((a.sd_phi1 / b.sd_phi1 - 1.0).abs() < 1e-6, "{a:?} {b:?}");
            prop_assert!((size * a.error_m() / b.error_m() - 1.0).abs() < 1e-6, "{a:?} {b:?}");
        }
    }

    /// The uncertainty in metres and the one in angles agree.
    #[test]
    fn angles_follow_from_metres(x in -1.5..1.5f64, y in 0.1..3.0f64) {
        let setup = Setup { pixels: 9, ..Setup::PUBLISHED };
        let bound = setup.bound(Strategy::Doorway, [x, y]);
        let covariance = Matrix2::from_fn(|i, j| bound.covariance_m2[i][j]);
        let sd = |alpha: fn(Biangular) -> f64| {
            let at = |dx, dy| alpha(Biangular::from_point(&setup.doorway, [x + dx, y + dy]));
            let gradient =
                nalgebra::Vector2::new(at(1e-6, 0.0) - at(-1e-6, 0.0), at(0.0, 1e-6) - at(0.0, -1e-6)) / 2e-6;
            (gradient.transpose() * covariance * gradient)[(0, 0)].sqrt()
        };
        prop_assert!((sd(|a| a.alpha1) / bound.sd_phi1 - 1.0).abs() < 1e-6);
        prop_assert!((sd(|a| a.alpha2) / bound.sd_phi2 - 1.0).abs() < 1e-6);
    }

    /// Compares each pixel with single rays through both faces of a thick wall, and its derivatives with differences of
    /// its own exact values.
    #[test]
    fn a_thick_wall_cuts_with_the_face_that_is_in_the_way(
        x in -1.2..1.2f64, y in 0.3..2.0f64, thickness in 0.0..0.25f64, pixels in 1..5usize,
    ) {
        let doorway = Doorway { width_m: 0.8, wall_thickness_m: thickness, height_m: None, leaf: None };
        let setup = Setup { doorway, patch_m: 0.3, pixels, noise: 1.0 };
        let found = patch_light(&setup, Side::Left, true, [x, y]);
        let cell = setup.patch_m / pixels as f64;
        for (k, pixel) in found.iter().enumerate() {
            const RAYS: usize = 150;
            let mut sum = 0.0;
            for ray in 0..RAYS * RAYS {
                let share = [ray % RAYS, ray / RAYS].map(|k| (k as f64 + 0.5) / RAYS as f64);
                let px = -0.4 - 0.15 + (k % pixels) as f64 * cell + share[0] * cell;
                let py = -thickness - (k / pixels) as f64 * cell - share[1] * cell;
                let crossing = |face: f64| px + (x - px) * (face - py) / (y - py);
                if crossing(0.0) > -0.4 && crossing(-thickness) > -0.4 {
                    sum += (cell / RAYS as f64).powi(2) / ((px - x).powi(2) + (py - y).powi(2));
                }
            }
            let whole = cell * cell / (y + thickness).powi(2);
            prop_assert!((pixel.light - sum).abs() < 0.01 * whole, "{} {sum}", pixel.light);
            // There is no derivative where the face that blocks the light changes.
            prop_assume!((x + 0.4).abs() > 1e-3);
            for axis in 0..2 {
                let at = |step: f64| {
                    let mut target = [x, y];
                    target[axis] += step;
                    patch_light(&setup, Side::Left, true, target)[k].light
                };
                let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
                prop_assert!((pixel.by[axis] - difference).abs() < 1e-4 * whole / y, "{:?} {difference}", pixel.by);
            }
        }
    }
}

#[test]
fn what_the_pixels_cannot_tell_is_infinite() {
    let setup = Setup { pixels: 1, ..Setup::PUBLISHED };
    let [single, corner, ..] = setup.bounds([0.2, 1.0]);
    assert_eq!(
        [single, corner].map(|b| (b.sd_c, b.sd_phi1, b.error_m())),
        [(f64::INFINITY, f64::INFINITY, f64::INFINITY); 2]
    );
}

#[test]
fn numbers_that_no_setup_has_are_named() {
    let refused = |setup: Setup| setup.validate().unwrap_err().to_string();
    let published = Setup::PUBLISHED;
    assert_eq!(published.validate(), Ok(()));
    assert_eq!(refused(Setup { noise: 0.0, ..published }), "noise is 0, expected a number above 0");
    assert_eq!(refused(Setup { patch_m: f64::NAN, ..published }), "patch is NaN, expected metres from 0.001 to 10");
    assert!(refused(Setup { pixels: 0, ..published }).starts_with("pixels is 0, "));
}
