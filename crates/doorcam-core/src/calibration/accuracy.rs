//! How errors in the marked floor points propagate to the measurement.

use nalgebra::Vector2;

use crate::calibration::FloorFit;
use crate::geometry::{Doorway, Side};
use crate::transport::edge_foot_mask;
use crate::transport::{PatchGrid, PixelLayout};

/// RMS errors to expect on the patches, propagated from the error with which the floor points were marked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// Error of the patch pixels' positions on the floor, in metres.
    pub floor_m: f64,
    /// Error of the patch pixels' angles around the foot of their edge on the wall's visible face, in radians. Pixels
    /// next to the foot are left out.
    pub angle_rad: f64,
}

/// Positions sampled along each side of a patch; few are enough because the errors are smooth.
const SAMPLES: usize = 16;

impl Accuracy {
    /// Errors of `fit` for points marked with a standard deviation of `noise_px` pixels per coordinate. None if part of
    /// a patch is behind the camera.
    pub fn of(fit: &FloorFit, doorway: &Doorway, patch: &PatchGrid, noise_px: f64) -> Option<Self> {
        let samples = samples(patch);
        let counted = edge_foot_mask(&samples);
        let (mut floor, mut angle) = (Mean::default(), Mean::default());
        for side in Side::BOTH {
            let foot = [doorway.edge(side)[0], -doorway.wall_thickness_m];
            for (point, &counts) in samples.points(doorway, side).into_iter().zip(&counted) {
                let covariance = fit.covariance_m2(point)?;
                floor.add(covariance.trace());
                if counts {
                    let arm = Vector2::new(point[0] - foot[0], point[1] - foot[1]);
                    let across = Vector2::new(-arm[1], arm[0]) / arm.norm_squared();
                    angle.add((across.transpose() * covariance * across)[0]);
                }
            }
        }
        Some(Self { floor_m: noise_px * floor.get().sqrt(), angle_rad: noise_px * angle.get().sqrt() })
    }
}

fn samples(patch: &PatchGrid) -> PatchGrid {
    PatchGrid { size: SAMPLES, fov_m: patch.fov_m, layout: PixelLayout::Cells }
}

#[derive(Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    fn get(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::calibration::pinhole::Pinhole;
    use crate::geometry::Point;
    use crate::optics::FloorPoint;

    const DOORWAY: Doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.12, height_m: None, leaf: None };
    const PATCH: PatchGrid = PatchGrid { size: 64, fov_m: 0.3, layout: PixelLayout::Cells };
    const NOISE_PX: f64 = 0.5;

    struct Dice(ChaCha8Rng);

    impl Dice {
        fn within(&mut self, from: f64, to: f64) -> f64 {
            from + (to - from) * (self.0.next_u32() as f64 / f64::from(u32::MAX))
        }

        fn normal(&mut self) -> f64 {
            StandardNormal.sample(&mut self.0)
        }

        /// A webcam somewhere in front of the door, aimed at it.
        fn camera(&mut self) -> Pinhole {
            let at = [self.within(-0.8, 0.8), self.within(-2.5, -0.9), self.within(0.9, 2.3)];
            let aim = [self.within(-0.15, 0.15), self.within(-0.5, -0.15)];
            let (dx, dy) = (aim[0] - at[0], aim[1] - at[1]);
            let width = self.within(640.0, 1920.0);
            Pinhole {
                at,
                tilt: (at[2] / dx.hypot(dy)).atan(),
                turn: dx.atan2(dy),
                roll: self.within(-0.1, 0.1),
                focal: width * self.within(0.6, 0.9),
                centre: [width / 2.0, width * 0.28],
            }
        }

        /// Six points as people choose them: the feet of both edges and four around the patches.
        fn floor(&mut self) -> [Point; 6] {
            let (half, wall) = (DOORWAY.half_width(), -DOORWAY.wall_thickness_m);
            let mut about = |x: f64, y: f64| [x + self.within(-0.1, 0.1), y + self.within(-0.1, 0.1)];
            [
                [-half, wall],
                [half, wall],
                about(-half - 0.15, wall - 0.4),
                about(half + 0.15, wall - 0.4),
                about(-0.1, wall - 0.5),
                about(0.15, wall - 0.25),
            ]
        }

        fn marked(&mut self, camera: &Pinhole, floor: &[Point], noise_px: f64) -> Vec<FloorPoint> {
            let mark = |&floor_m: &Point| {
                let seen = camera.see(floor_m).expect("in front of the camera");
                FloorPoint { pixel: [0, 1].map(|c| seen[c] + noise_px * self.normal()), floor_m }
            };
            floor.iter().map(mark).collect()
        }
    }

    /// The fit's actual errors: each patch pixel is read where the fitted camera sees it, but the real camera shows a
    /// different piece of floor there.
    fn truth(fit: &FloorFit, camera: &Pinhole) -> Accuracy {
        let corners = [[-1.0, 0.0], [1.0, 0.0], [1.0, -1.0], [-1.0, -1.0]];
        let exact = corners.map(|floor_m| FloorPoint { pixel: camera.see(floor_m).unwrap(), floor_m });
        let exact = FloorFit::new(&exact, None).unwrap();
        let samples = samples(&PATCH);
        let counted = edge_foot_mask(&samples);
        let (mut floor, mut angle) = (Mean::default(), Mean::default());
        for side in Side::BOTH {
            let foot = [DOORWAY.edge(side)[0], -DOORWAY.wall_thickness_m];
            let around = |p: Point| (p[1] - foot[1]).atan2(p[0] - foot[0]);
            for (believed, &counts) in samples.points(&DOORWAY, side).into_iter().zip(&counted) {
                let real = exact.camera().floor(fit.camera().project(believed).unwrap()).unwrap();
                floor.add((real[0] - believed[0]).powi(2) + (real[1] - believed[1]).powi(2));
                if counts {
                    let turn = (around(real) - around(believed) + PI).rem_euclid(2.0 * PI) - PI;
                    angle.add(turn * turn);
                }
            }
        }
        Accuracy { floor_m: floor.get().sqrt(), angle_rad: angle.get().sqrt() }
    }

    fn median(values: &mut [f64]) -> f64 {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    }

    #[test]
    fn reported_errors_are_those_that_ten_thousand_cameras_make() {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(7));
        let (mut floor_ratio, mut angle_ratio, mut noise) = (Vec::new(), Vec::new(), Vec::new());
        let (mut floor_mm, mut angle_deg) = (Vec::new(), Vec::new());
        let (mut scaled_floor, mut scaled_angle) = (Mean::default(), Mean::default());
        let (mut refused, mut contradicted) = (0, 0);
        for _ in 0..10_000 {
            let (camera, floor) = (dice.camera(), dice.floor());
            let Ok(fit) = FloorFit::new(&dice.marked(&camera, &floor, NOISE_PX), None) else {
                refused += 1;
                continue;
            };
            contradicted += usize::from(fit.contradiction(1280).is_some());
            let real = truth(&fit, &camera);
            let noise_px = fit.noise_px().unwrap();
            let told = Accuracy::of(&fit, &DOORWAY, &PATCH, noise_px).unwrap();
            floor_ratio.push(told.floor_m / real.floor_m);
            angle_ratio.push(told.angle_rad / real.angle_rad);
            noise.push(noise_px);
            floor_mm.push(real.floor_m * 1e3);
            angle_deg.push(real.angle_rad.to_degrees());
            // When the pixel error is known, the mean square must be right too, not only the median.
            let known = NOISE_PX / noise_px;
            scaled_floor.add((real.floor_m / (told.floor_m * known)).powi(2));
            scaled_angle.add((real.angle_rad / (told.angle_rad * known)).powi(2));
        }
        let (floor, angle) = (median(&mut floor_ratio), median(&mut angle_ratio));
        let noise_px = median(&mut noise);
        let (floor_rms, angle_rms) = (scaled_floor.get().sqrt(), scaled_angle.get().sqrt());
        println!(
            "reported / true, median: floor {floor:.3}, angle {angle:.3}; noise {noise_px:.3} px; true error {:.2} mm, \
             {:.2}°; true / predicted, rms: {floor_rms:.3}, {angle_rms:.3}; refused {refused}, contradicted {contradicted}",
            median(&mut floor_mm),
            median(&mut angle_deg),
        );
        assert!((1.0 / 1.5..1.5).contains(&floor) && (1.0 / 1.5..1.5).contains(&angle), "{floor} {angle}");
        assert!((0.9 * NOISE_PX..1.05 * NOISE_PX).contains(&noise_px), "{noise_px}");
        assert!((0.95..1.05).contains(&floor_rms) && (0.95..1.05).contains(&angle_rms), "{floor_rms} {angle_rms}");
        assert!(refused + contradicted < 10, "{refused} {contradicted}");
    }

    #[test]
    fn points_near_a_line_are_refused_whatever_the_noise_makes_of_them() {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(8));
        for _ in 0..1000 {
            let camera = dice.camera();
            // All within millimetres of a line across the door; all but one on that line; and duplicated points.
            let slope = dice.within(-0.3, 0.3);
            let line: [Point; 6] = std::array::from_fn(|_| {
                let x = dice.within(-0.6, 0.6);
                [x, -0.4 + slope * x + 0.001 * dice.normal()]
            });
            let mut but_one = line;
            but_one[5] = [0.1, -0.14];
            let mut pairs = line;
            pairs[..4].copy_from_slice(&[line[4], line[4], line[5], line[5]]);
            for floor in [line, but_one, pairs] {
                for count in 4..=6 {
                    let points = dice.marked(&camera, &floor[6 - count..], NOISE_PX);
                    let fit = FloorFit::new(&points, None);
                    assert!(
                        fit.is_err(),
                        "{count} points: {:?}",
                        Accuracy::of(&fit.unwrap(), &DOORWAY, &PATCH, NOISE_PX)
                    );
                }
            }
        }
    }

    #[test]
    fn a_mistyped_point_is_named() {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(9));
        let (mut named, mut other, mut refused, mut unseen) = (0, 0, 0, 0);
        for round in 0..1000 {
            let (camera, floor) = (dice.camera(), dice.floor());
            let mut points = dice.marked(&camera, &floor, NOISE_PX);
            // One coordinate is off by a decimetre.
            let wrong = round % 6;
            points[wrong].floor_m[round % 2] += 0.1;
            let verdict = match FloorFit::new(&points, None) {
                Ok(fit) => fit.contradiction(1280),
                Err(error) => FloorFit::culprit(&points, None).or(Some(error)),
            };
            match verdict {
                Some(crate::calibration::HomographyError::Outlier { point, .. }) if point == wrong + 1 => named += 1,
                Some(crate::calibration::HomographyError::Outlier { .. }) => other += 1,
                Some(_) => refused += 1,
                None => unseen += 1,
            }
        }
        println!("named {named}, another named {other}, refused without a name {refused}, not noticed {unseen}");
        assert!(named > 900 && other < 50, "{named} {other} {refused} {unseen}");
    }

    #[test]
    fn a_shaky_hand_contradicts_nothing() {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(11));
        let contradicted = (0..1000).filter(|_| {
            let (camera, floor) = (dice.camera(), dice.floor());
            FloorFit::new(&dice.marked(&camera, &floor, 2.0), None).is_ok_and(|fit| fit.contradiction(1280).is_some())
        });
        let contradicted = contradicted.count();
        assert!(contradicted < 20, "{contradicted}");
    }

    #[test]
    fn mirrored_points_are_refused() {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(10));
        for _ in 0..100 {
            let (camera, floor) = (dice.camera(), dice.floor());
            let mut points = dice.marked(&camera, &floor, NOISE_PX);
            points.iter_mut().for_each(|p| p.floor_m[0] = -p.floor_m[0]);
            FloorFit::new(&points, None).expect_err("mirrored");
        }
    }
}
