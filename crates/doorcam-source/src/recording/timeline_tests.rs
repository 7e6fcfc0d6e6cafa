use proptest::prelude::*;

use super::*;

/// The times of frames 0, 1, .. that have these lines, and the notes.
fn of(stamps: &[f64], fps: f64) -> Result<(Vec<f64>, Vec<String>), String> {
    let text: String = (0..).zip(stamps).map(|(n, s): (usize, &f64)| format!("{n},{s}\n")).collect();
    with(&format!("index,seconds\n{text}"), stamps.len() as u64, fps)
}

fn with(text: &str, count: u64, fps: f64) -> Result<(Vec<f64>, Vec<String>), String> {
    let mut stamps = parse(text)?;
    let times = times(&(0..count).collect::<Vec<_>>(), &mut stamps, fps)?;
    Ok((times, stamps.notes))
}

fn close(got: &[f64], expected: &[f64]) {
    assert_eq!(got.len(), expected.len());
    assert!(got.iter().zip(expected).all(|(g, e)| (g - e).abs() < 1e-6), "{got:?} instead of {expected:?}");
}

#[test]
fn times_of_a_real_camera_stay_as_they_are() {
    // A slow frame, dropped ones, a pause of seconds, one of most of a minute.
    let stamps = [0.5, 0.599, 0.702, 0.8, 1.3, 1.4, 9.7, 9.81, 9.9, 60.0, 60.1];
    assert_eq!(of(&stamps, 10.0).unwrap(), (stamps.to_vec(), vec![]));
    // Seconds since 1970.
    let epoch: Vec<f64> = (0..50).map(|n| 1.764e9 + 0.1 * f64::from(n)).collect();
    assert_eq!(of(&epoch, 10.0).unwrap(), (epoch, vec![]));
    // A camera in the dark gives a tenth of its nominal rate.
    let slow: Vec<f64> = (0..9).map(f64::from).collect();
    assert_eq!(of(&slow, 10.0).unwrap(), (slow, vec![]));
}

#[test]
fn other_units_are_refused_with_the_line_and_the_unit() {
    for (per_second, unit) in [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")] {
        for fps in [1.0, 5.0, 29.97, 240.0] {
            for (slower, start) in [(1.0, 0.0), (3.0, 0.0), (1.0, 1.764e9)] {
                // One frame in nine is lost, one comes late.
                let at = |n: u32| start + slower * f64::from(n + n / 9) / fps + if n == 3 { 0.2 / fps } else { 0.0 };
                let stamps: Vec<f64> = (0..40).map(|n| (per_second * at(n)).round()).collect();
                let error = of(&stamps, fps).expect_err(unit);
                assert!(error.starts_with("line 3: the times are "), "{error}");
                assert!(error.ends_with(&format!("they are probably {unit}, expected seconds")), "{error}");
            }
        }
    }
    let error = of(&[0.0, 0.1, 1e300, 0.3], 10.0).expect_err("no time");
    assert_eq!(error, "line 4: the time is 1e300, expected seconds, at most 1e10");
}

#[test]
fn times_that_tell_nothing_are_replaced_by_the_frame_rate_with_one_note() {
    let denormal = f64::MIN_POSITIVE / 4.0;
    for (stamps, why) in [
        (vec![7.0; 5], "the times do not grow"),
        (vec![-0.0, 0.0, -0.0, 0.0, 0.0], "the times do not grow"),
        (vec![0.4, 0.3, 0.2, 0.1, 0.0], "the times do not grow"),
        (vec![4.0, 3.0, 2.0, 2.1, 1.0], "the times go backwards"),
        (vec![0.0, denormal, 2.0 * denormal, 3.0 * denormal, 4.0 * denormal], "the times do not grow"),
        (vec![0.0, 0.0005, 0.001, 0.0015, 0.002], "the times are almost the same for all frames"),
        (vec![1e300; 5], ""),
    ] {
        let Ok((times, notes)) = of(&stamps, 10.0) else {
            assert!(why.is_empty(), "{stamps:?}");
            continue;
        };
        assert_eq!(times, [0.0, 0.1, 0.2, 0.3, 0.4]);
        assert_eq!(notes, [format!("line 3: {why}: the frames follow each other as fps in recording.json says")]);
    }
}

#[test]
fn after_a_jump_the_frames_go_on_at_their_rate_with_one_note() {
    let line = |by: f64| (0..9).map(|n| 0.1 * f64::from(n) + if n < 4 { 0.0 } else { by }).collect::<Vec<f64>>();
    for by in [3600.0, -3600.0, 86_400.0, 61.0, -2.0, 1e9] {
        let (times, notes) = of(&line(by), 10.0).unwrap();
        close(&times, &line(0.0));
        let [note] = &notes[..] else { panic!("{notes:?}") };
        assert!(note.starts_with("line 6: the time jumps by "), "{note}");
        assert!(note.ends_with(" s: the frames go on as if it did not"), "{note}");
    }
    // One time is wrong: there and back.
    let mut once = line(0.0);
    once[5] += 3600.0;
    let (times, notes) = of(&once, 10.0).unwrap();
    close(&times, &line(0.0));
    assert!(notes.len() == 1 && notes[0].contains("(and 1 more jump)"), "{notes:?}");
}

#[test]
fn what_came_late_or_twice_is_placed_between_its_neighbours() {
    let (times, notes) = of(&[0.0, 0.1, 0.1, 0.3, 0.25, 0.5], 10.0).unwrap();
    close(&times, &[0.0, 0.1, 0.2, 0.3, 0.4, 0.5]);
    assert_eq!(
        notes,
        [
            "line 4: the time is not later than the one before (and 1 more such line): the frame is placed between its neighbours"
        ]
    );
    // Whole seconds at 4 frames a second.
    let whole: Vec<f64> = (0..16).map(|n| 1.764e9 + f64::from(n / 4)).collect();
    let (times, _) = of(&whole, 4.0).unwrap();
    close(&times, &(0..16).map(|n| 1.764e9 + 0.25 * f64::from(n)).collect::<Vec<_>>());
}

#[test]
fn missing_lines_are_filled_and_the_later_of_two_counts() {
    let (times, notes) = with("1,10.1\n3,10.3\n4,10.4\n6,10.7\n", 8, 10.0).unwrap();
    close(&times, &[10.0, 10.1, 10.2, 10.3, 10.4, 10.55, 10.7, 10.8]);
    assert!(notes.is_empty(), "{notes:?}");
    let (times, notes) = with("0,0\n1,5\n1,0.1\n", 3, 10.0).unwrap();
    close(&times, &[0.0, 0.1, 0.2]);
    assert_eq!(notes, ["line 3: index 1 was on line 2 already; the later line counts"]);
    let (times, notes) = with("100,0\n101,5\n", 2, 10.0).unwrap();
    close(&times, &[0.0, 0.1]);
    assert!(notes[0].starts_with("has no time of any frame"), "{notes:?}");
}

#[test]
fn lines_are_read_strictly_but_a_cut_off_one_at_the_end() {
    assert_eq!(parse("index, seconds\r\n\r\n 3 , 0.5\r\n").unwrap().by_number[&3], (3, 0.5));
    for wrong in
        ["0,0\n1;2\n", "0,0\n1,2,3\n", "0,0\n-1,2\n", "0,0\n1,nan\n", "0,0\n1,1e999\n", "0,0\nx,1\n", "0,0\n1\n"]
    {
        assert_eq!(parse(wrong).expect_err(wrong), "line 2: expected \"index,seconds\"");
    }
    assert_eq!(parse("0,0\n1").unwrap().by_number.len(), 1);
}

#[test]
fn numbers_beyond_all_measure_do_not_stretch_the_time() {
    let mut none = Stamps::default();
    let huge = [20_260_101_120_000, 20_260_101_120_001, u64::MAX];
    close(&times(&huge, &mut none, 10.0).unwrap(), &[0.0, 0.1, 0.2]);
    // What is missing has an entry: the numbers themselves do not count.
    close(&times(&[7, 8, 5000], &mut none, 10.0).unwrap(), &[0.7, 0.8, 0.9]);
}

proptest! {
    #[test]
    fn whatever_the_times_are_they_grow_without_long_waits_or_are_refused(
        steps in proptest::collection::vec((0usize..9, 0.0..2.0f64), 1..60), fps in 0.01..1000.0f64, left_out in any::<u64>(),
    ) {
        let mut at = 0.0;
        let mut text = String::new();
        for (n, (kind, size)) in steps.iter().enumerate() {
            at += match kind {
                0 => 0.0,
                1 => -size / fps,
                2 => 3600.0,
                3 => -3600.0,
                4 => 40.0 * size,
                _ => size / fps,
            };
            if left_out >> (n % 64) & 1 == 0 {
                text.push_str(&format!("{n},{at}\n"));
            }
        }
        if let Ok((times, _)) = with(&text, steps.len() as u64, fps) {
            prop_assert_eq!(times.len(), steps.len());
            for pair in times.windows(2) {
                prop_assert!(pair[1] > pair[0], "{:?}", times);
            }
            let longest = times.last().unwrap() - times[0];
            prop_assert!(longest <= steps.len() as f64 * (LONGEST_PAUSE_S + OTHER_UNIT / fps), "{:?}", times);
        }
    }
}
