use super::*;

const SIZE: usize = 8;

fn filled(value: f32) -> PatchPair {
    let mut pair = PatchPair::zeros(SIZE);
    Side::BOTH.iter().for_each(|&side| pair.side_mut(side).data_mut().fill(value));
    pair
}

fn value(pair: &PatchPair) -> f32 {
    pair.left.data()[0]
}

/// Pushes values a tenth of a second apart and returns the averages.
fn averages(averager: &mut Averager, from_s: f64, values: &[f32]) -> Vec<f32> {
    let push = |(k, v): (usize, &f32)| value(averager.push(&filled(*v), from_s + 0.1 * k as f64).0);
    values.iter().enumerate().map(push).collect()
}

fn assert_close(found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len());
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() < 1e-6, "{found:?}, expected {expected:?}");
    }
}

#[test]
fn without_averaging_a_frame_passes_as_it_is() {
    let mut averager = Averager::new(Averaging::None, 1.0, SIZE);
    assert_eq!(averages(&mut averager, 0.0, &[1.0, 2.0, 0.3]), [1.0, 2.0, 0.3]);
    assert_eq!((averager.excess(), averager.independent_s()), (1.0, 0.0));
}

#[test]
fn a_boxcar_is_the_mean_of_the_frames_in_its_time() {
    let mut averager = Averager::new(Averaging::Boxcar, 0.3, SIZE);
    let values = [1.0, 1.03, 1.02, 1.04, 1.0, 0.99];
    let expected = [1.0, 1.015, 3.05 / 3.0, 3.09 / 3.0, 3.06 / 3.0, 3.03 / 3.0];
    assert_close(&averages(&mut averager, 5.0, &values), &expected);
    assert_eq!(averager.excess(), 1.0);
}

#[test]
fn an_exponential_average_forgets_by_time_and_not_by_frames() {
    // The same step of light gives the same result at 10 and at 40 frames a second.
    let after_a_second = |fps: usize| {
        let mut averager = Averager::new(Averaging::Exponential, 0.5, SIZE);
        (0..10 * fps).for_each(|k| {
            averager.push(&filled(1.0), k as f64 / fps as f64 - 10.0);
        });
        let mut last = 0.0;
        (0..fps).for_each(|k| last = value(averager.push(&filled(1.04), k as f64 / fps as f64).0));
        assert_eq!(averager.excess(), 1.0);
        last
    };
    let expected = 1.04 - 0.04 * (-2.0_f64).exp() as f32;
    for fps in [10, 40] {
        assert!((after_a_second(fps) - expected).abs() < 1e-4, "{fps}: {}", after_a_second(fps));
    }
}

#[test]
fn no_average_mixes_what_is_before_and_after_a_gap_a_jump_or_a_restart() {
    for mode in [Averaging::Exponential, Averaging::Boxcar] {
        let mut averager = Averager::new(mode, 0.5, SIZE);
        averages(&mut averager, 0.0, &[1.0; 20]);
        assert_eq!(averager.excess(), 1.0);
        // Time runs backwards, a gap, then a jump of the light.
        assert_eq!(averages(&mut averager, 0.0, &[1.01]), [1.01]);
        assert!(averager.excess() > 1.5, "{}", averager.excess());
        averages(&mut averager, 0.1, &[1.01; 20]);
        assert_eq!(averages(&mut averager, 9.0, &[1.02]), [1.02]);
        averages(&mut averager, 9.1, &[1.02; 20]);
        assert_close(&averages(&mut averager, 11.1, &[1.3, 1.3]), &[1.3, 1.3]);
        averages(&mut averager, 11.3, &[1.3; 20]);
        averager.restart();
        assert_eq!(averages(&mut averager, 13.3, &[1.31]), [1.31]);
    }
}

#[test]
fn slow_and_uneven_frames_are_no_pauses() {
    for mode in [Averaging::Exponential, Averaging::Boxcar] {
        for slowest_s in [0.6, 1.6, 5.0, 30.0] {
            let mut averager = Averager::new(mode, 0.5, SIZE);
            let mut seconds = 0.0;
            let mut full = 0;
            for k in 0..100 {
                // Between half of the slowest interval and all of it, in an order that looks random.
                seconds += slowest_s * (0.5 + 0.5 * f64::from(k * 37 % 100) / 99.0);
                let (_, excess) = averager.push(&filled(1.0), seconds);
                full += usize::from(k >= 10 && excess == 1.0);
            }
            assert!(full > 60, "{mode:?}, up to {slowest_s} s: {full} of 90 averages are full");
        }
    }
}

#[test]
fn the_excess_is_how_much_noisier_a_young_average_is() {
    use crate::light::noise::tests::{SIZE, all, frames};
    use crate::light::{NoiseModel, Patch};

    let noise = NoiseModel { read: 1e-6, shot: 0.0 };
    let frames = frames(60, noise, 0.0);
    let deviation = |averaged: &PatchPair, truth: &PatchPair| {
        let sum = |a: &Patch, b: &Patch| {
            a.data().iter().zip(b.data()).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.data().len() as f64
        };
        (sum(&averaged.left, &truth.left) + sum(&averaged.right, &truth.right)).sqrt()
    };
    let truth = &super::super::noise::tests::frames(1, NoiseModel { read: 0.0, shot: 0.0 }, 0.0)[0];
    assert_eq!(all()[0].len(), SIZE * SIZE);
    for mode in [Averaging::Exponential, Averaging::Boxcar] {
        let mut averager = Averager::new(mode, 0.8, SIZE);
        let mut young = Vec::new();
        let mut full = 0.0;
        for (k, frame) in frames.iter().enumerate() {
            let averaged = averager.push(frame, 0.1 * k as f64).0.clone();
            if (1..4).contains(&k) {
                young.push((deviation(&averaged, truth), averager.excess()));
            }
            full = deviation(&averaged, truth);
        }
        assert_eq!(averager.excess(), 1.0);
        for (found, excess) in young {
            assert!((found / full / excess - 1.0).abs() < 0.06, "{mode:?}: {found} {full} {excess}");
        }
    }
}
