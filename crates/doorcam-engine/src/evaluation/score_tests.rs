use super::*;
use crate::evaluation::{CrossingCounts, Report, ReportedCrossing, RowFigures};
use doorcam_source::truth::TrueFrame;

/// Ten frames a second.
const FPS: f64 = 10.0;

fn target(id: u64, [x_m, y_m]: Point) -> Target {
    Target { id, x_m, y_m, radius_m: 0.2, rgb: [0.0; 3] }
}

/// With a standard deviation of 0.1 m along both axes.
fn track(id: u64, position: Point) -> Estimate {
    Estimate { id: Some(id), position, covariance: [[0.01, 0.0], [0.0, 0.01]] }
}

fn truth_of(frames: impl IntoIterator<Item = (u64, Vec<Target>)>) -> Truth {
    let frame = |(index, targets)| TrueFrame { index, t: index as f64 / FPS, targets };
    Truth { frames: frames.into_iter().map(frame).collect(), crossings: Vec::new() }
}

/// Evaluates, frame by frame from frame 0, who is there and what is reported.
fn evaluate(frames: &[(Vec<Target>, Vec<Estimate>)], first: u64, settle_s: f64) -> Evaluation {
    let truth = truth_of((0..).zip(frames.iter().map(|(targets, _)| targets.clone())));
    let mut scorer = Scorer::new(&truth, first, settle_s).unwrap();
    for (index, (_, estimates)) in (0..).zip(frames) {
        scorer.score(&Observed { frame: Some(index), estimates: estimates.clone(), ..Observed::default() });
    }
    scorer.finish()
}

fn report(frames: &[(Vec<Target>, Vec<Estimate>)], first: u64, settle_s: f64) -> Report {
    evaluate(frames, first, settle_s).report("made up", frames.len())
}

fn counts(report: &Report) -> [usize; 4] {
    [report.targets, report.detected, report.missed, report.strays]
}

#[test]
fn errors_and_their_figures_are_those_of_the_definitions() {
    // Errors of 0.0, 0.1, ... 0.4 m, and one beyond the cutoff: missed, and reported as nobody.
    let frames: Vec<_> = [0.0, 0.1, 0.2, 0.3, 0.4, 0.6]
        .map(|error| (vec![target(1, [0.0, 1.0])], vec![track(7, [error, 1.0])]))
        .to_vec();
    let report = report(&frames, 0, 0.0);
    assert_eq!(counts(&report), [6, 5, 1, 1]);
    let near = |found: Option<f64>, expected: f64| assert!((found.unwrap() - expected).abs() < 1e-12, "{found:?}");
    near(report.mean_error_m, 0.2);
    near(report.rmse_m, (0.3f64 / 5.0).sqrt());
    near(report.p95_error_m, 0.4);
    near(report.missed_share, 1.0 / 6.0);
    near(report.gospa_m, (0.0 + 0.1 + 0.2 + 0.3 + 0.4 + 0.5) / 6.0);
    let parts = report.gospa.unwrap();
    near(Some(parts.localisation_m2), 0.3 / 6.0);
    near(Some(parts.missed_m2), 0.125 / 6.0);
    near(Some(parts.false_m2), 0.125 / 6.0);
    // (error / 0.1 m)²: 0, 1, 4, 9, 16; three are below 5.991.
    near(report.ellipse_share, 0.6);
    near(report.median_nees, 4.0);
    assert_eq!([report.tracks, report.false_tracks, report.id_switches, report.people], [1, 0, 0, 1]);
}

#[test]
fn the_ellipse_is_that_of_the_covariance() {
    let at = |covariance| {
        let estimate = Estimate { id: None, position: [0.2, 1.1], covariance };
        TargetScore {
            target: target(1, [0.0, 1.0]),
            verdict: Verdict::Detected,
            estimate: Some(estimate),
            visit: 1,
            bound_m: None,
        }
    };
    // e = (0.2, 0.1), P⁻¹ = [[30, -10], [-10, 20]]: 30 · 0.04 − 20 · 0.02 + 20 · 0.01 = 1.
    let nees = at([[0.04, 0.02], [0.02, 0.06]]).nees().unwrap();
    assert!((nees - 1.0).abs() < 1e-12, "{nees}");
    for no_covariance in [[[0.0; 2]; 2], [[0.01, 0.02], [0.02, 0.01]], [[-0.01, 0.0], [0.0, -0.01]]] {
        assert_eq!(at(no_covariance).nees(), Some(f64::INFINITY));
    }
}

#[test]
fn two_who_cross_and_swap_their_tracks_are_two_switches() {
    let frames: Vec<_> = (0..11)
        .map(|k| {
            let x = -0.5 + 0.1 * f64::from(k);
            let (a, b) = ([x, 1.0], [-x, 1.6]);
            let ids = if k < 6 { [1, 2] } else { [2, 1] };
            (vec![target(1, a), target(2, b)], vec![track(ids[0], a), track(ids[1], b)])
        })
        .collect();
    let report = report(&frames, 0, 0.0);
    assert_eq!(counts(&report), [22, 22, 0, 0]);
    assert_eq!([report.id_switches, report.false_tracks, report.tracks, report.people], [2, 0, 2, 2]);
    assert_eq!(report.mean_error_m, Some(0.0));
}

#[test]
fn a_switch_is_one_also_across_frames_that_miss() {
    let here = [0.0, 1.0];
    let frame = |id: Option<u64>| (vec![target(1, here)], id.map(|id| track(id, here)).into_iter().collect());
    let switches =
        |ids: &[Option<u64>]| report(&ids.iter().map(|&id| frame(id)).collect::<Vec<_>>(), 0, 0.0).id_switches;
    assert_eq!(switches(&[Some(1), None, Some(1)]), 0);
    assert_eq!(switches(&[Some(1), None, Some(2)]), 1);
    assert_eq!(switches(&[Some(1), Some(2), Some(1)]), 2);
    // Somebody who left and comes back is another person, even if the frame of the return has no update.
    let away = (vec![], vec![]);
    let again = [frame(Some(1)), away, frame(Some(2)), frame(Some(2))];
    assert_eq!(report(&again, 0, 0.0).id_switches, 0);
    let truth = truth_of((0..).zip(again.iter().map(|(targets, _)| targets.clone())));
    let mut scorer = Scorer::new(&truth, 0, 0.0).unwrap();
    for (index, id) in [(0, 1), (3, 2)] {
        scorer.score(&Observed { frame: Some(index), estimates: vec![track(id, here)], ..Observed::default() });
    }
    let evaluation = scorer.finish();
    assert_eq!((evaluation.report("", 4).id_switches, evaluation.unseen), (0, 2));
}

#[test]
fn while_somebody_settles_nothing_about_them_is_right_or_wrong() {
    // There from frame 5 on, found from frame 10 on; one second has passed in frame 15.
    let here = [0.0, 1.0];
    let frame = |k: i32| {
        let there = if k >= 5 { vec![target(1, here)] } else { vec![] };
        (there, if k >= 10 { vec![track(1, here)] } else { vec![] })
    };
    let frames: Vec<_> = (0..20).map(frame).collect();
    let settled = report(&frames, 0, 1.0);
    assert_eq!(counts(&settled), [5, 5, 0, 0]);
    assert_eq!((settled.scored_frames, settled.gospa_m), (20, Some(0.0)));
    assert_eq!(counts(&report(&frames, 0, 0.0)), [15, 10, 5, 0]);
    assert_eq!(counts(&report(&frames, 0, 0.7)), [8, 8, 0, 0]);
    assert_eq!(counts(&report(&frames, 0, 0.3)), [12, 10, 2, 0]);
    // Whoever comes back settles again; a frame that the truth does not contain is no absence.
    let gone = (0..40).filter(|&k| k != 30).map(|k| (k, if k == 20 { vec![] } else { vec![target(1, here)] }));
    let truth = truth_of(gone);
    let mut scorer = Scorer::new(&truth, 0, 1.0).unwrap();
    (0..40).for_each(|k| scorer.score(&Observed { frame: Some(k), estimates: vec![], ..Observed::default() }));
    let late = scorer.finish().report("", 40);
    assert_eq!((late.scored_frames, late.missed), (39, 10 + 9));
}

#[test]
fn a_stranger_beside_who_settles_is_wrong_all_the_same() {
    let frames = [(vec![target(1, [0.0, 1.0])], vec![track(1, [0.0, 1.0]), track(2, [1.0, 1.0])])];
    let report = report(&frames, 0, 1.0);
    assert_eq!(counts(&report), [0, 0, 0, 1]);
    assert_eq!([report.tracks, report.false_tracks], [2, 1]);
    assert!((report.gospa_m.unwrap() - 0.125f64.sqrt()).abs() < 1e-12);
}

#[test]
fn a_false_track_is_nobody_for_most_of_its_life() {
    let (here, nowhere) = ([0.0, 1.0], [1.0, 2.0]);
    let frames = |right: usize, wrong: usize| -> Vec<_> {
        let at = |place| (vec![target(1, here)], vec![track(1, place)]);
        (0..right).map(|_| at(here)).chain((0..wrong).map(|_| at(nowhere))).collect()
    };
    let false_tracks = |right, wrong| report(&frames(right, wrong), 0, 0.0).false_tracks;
    assert_eq!([false_tracks(3, 2), false_tracks(2, 2), false_tracks(2, 3), false_tracks(0, 1)], [0, 0, 1, 1]);
    // To be found while settling is to be found.
    assert_eq!(report(&frames(3, 2), 0, 9.0).false_tracks, 0);
    // Reports in frames before the first scored one do not count.
    assert_eq!(report(&frames(3, 2), 3, 0.0).false_tracks, 1);
}

#[test]
fn frames_that_nobody_knows_or_that_come_too_early_are_not_scored() {
    let here = [0.0, 1.0];
    let truth = truth_of([(2, vec![target(1, here)]), (3, vec![target(1, here)]), (5, vec![target(1, here)])]);
    let mut scorer = Scorer::new(&truth, 3, 0.0).unwrap();
    // Out of order, twice, and from a live camera.
    for frame in [Some(5), Some(2), Some(4), Some(3), Some(3), None] {
        scorer.score(&Observed { frame, estimates: vec![track(1, here)], ..Observed::default() });
    }
    let evaluation = scorer.finish();
    assert_eq!(evaluation.frames.iter().map(|f| f.index).collect::<Vec<_>>(), [3, 5]);
    assert_eq!(evaluation.unseen, 0);
    assert_eq!(counts(&evaluation.report("", 6)), [2, 2, 0, 0]);
}

#[test]
fn an_empty_room_without_tracks_has_no_errors() {
    let report = report(&vec![(vec![], vec![]); 4], 0, 1.0);
    assert_eq!(counts(&report), [0; 4]);
    assert_eq!((report.scored_frames, report.gospa_m), (4, Some(0.0)));
    assert_eq!(
        [report.mean_error_m, report.rmse_m, report.p95_error_m, report.ellipse_share, report.missed_share],
        [None; 5]
    );
}

#[test]
fn a_mirrored_room_has_the_same_figures() {
    let frames: Vec<_> = (0..30)
        .map(|k| {
            let phase = f64::from(k) * 0.3;
            let (a, b) = ([phase.sin(), 1.0 + 0.3 * phase.cos()], [0.6 * phase.cos(), 1.7]);
            let seen = |id, [x, y]: Point, wobble: f64| Estimate {
                id: Some(id),
                position: [x + wobble * (7.0 * phase).sin(), y + wobble * (5.0 * phase).cos()],
                covariance: [[0.01, 0.004], [0.004, 0.02]],
            };
            (vec![target(1, a), target(2, b)], vec![seen(1, a, 0.2), seen(2, b, 0.4), seen(3, [0.9, 0.4], 0.1)])
        })
        .collect();
    let mirrored = |(targets, estimates): &(Vec<Target>, Vec<Estimate>)| {
        let target = |t: &Target| Target { x_m: -t.x_m, ..*t };
        let estimate = |e: &Estimate| Estimate {
            position: [-e.position[0], e.position[1]],
            covariance: [[e.covariance[0][0], -e.covariance[0][1]], [-e.covariance[1][0], e.covariance[1][1]]],
            ..*e
        };
        (targets.iter().map(target).collect(), estimates.iter().map(estimate).collect())
    };
    let other = report(&frames.iter().map(mirrored).collect::<Vec<_>>(), 0, 1.0);
    let one = report(&frames, 0, 1.0);
    assert!(one.missed > 0 && one.strays > 0 && one.id_switches == 0 && one.ellipse_share.unwrap() < 1.0, "{one:?}");
    assert_eq!(one, other);
}

#[test]
fn gospa_of_a_frame_is_that_of_who_counts() {
    use crate::evaluation::gospa;
    let (settled, late) = (target(1, [0.0, 1.0]), target(2, [0.3, 1.0]));
    let reported = vec![track(1, [0.05, 1.1]), track(2, [0.4, 1.0]), track(3, [-1.0, 1.0])];
    let mut frames = vec![(vec![settled], vec![]); 12];
    frames.push((vec![settled, late], reported.clone()));
    let evaluation = evaluate(&frames, 12, 1.0);
    let frame = &evaluation.frames[0];
    assert_eq!(frame.count(Verdict::Settling), 1);
    let expected = gospa(&[[0.0, 1.0]], &[reported[0].position, reported[2].position], CUTOFF_M);
    assert_eq!(frame.gospa(), expected);
}

#[test]
fn a_truth_that_contradicts_itself_is_refused() {
    let twice = truth_of([(4, vec![target(1, [0.0; 2]), target(1, [1.0; 2])])]);
    assert_eq!(
        Scorer::new(&twice, 0, 1.0).err().unwrap().to_string(),
        "frames: index 4 has two targets with id 1, expected each target once"
    );
    let again = truth_of([(4, vec![]), (4, vec![])]);
    assert_eq!(Scorer::new(&again, 0, 1.0).err().unwrap().to_string(), "frames: index 4 is there twice");
}

/// A person at 2 m straight ahead, with the report's ellipse narrow in x and long in y.
fn ahead(id: u64, y: f64) -> Estimate {
    Estimate { id: Some(id), position: [0.0, y], covariance: [[0.009, 0.0], [0.0, 0.35]] }
}

#[test]
fn without_a_map_everybody_is_missed_whatever_is_reported() {
    let here = [0.0, 1.0];
    let truth = truth_of((0..6).map(|k| (k, vec![target(1, here)])));
    let mut scorer = Scorer::new(&truth, 0, 0.2).unwrap();
    // Right where the person is, in their direction, and where nobody is.
    let reported = [track(7, here), ahead(8, 2.1), track(9, [-1.0, 1.0])];
    for frame in 0..6 {
        let estimates = reported.to_vec();
        scorer.score(&Observed { frame: Some(frame), watching: frame == 5, estimates, ..Observed::default() });
    }
    let evaluation = scorer.finish();
    let verdicts: Vec<Verdict> = evaluation.frames.iter().map(|frame| frame.targets[0].verdict).collect();
    use Verdict::{Detected, Missed, Settling};
    assert_eq!(verdicts, [Settling, Settling, Missed, Missed, Missed, Detected]);
    let report = evaluation.report("", 6);
    assert_eq!((report.scored_frames, report.unwatched, report.directions), (6, 5, 0));
    // What is reported of nobody is as false as with a map.
    assert_eq!(counts(&report), [4, 1, 3, 12]);
    assert_eq!(report.missed_share, Some(0.75));
    // A track that is right without a map is neither somebody nor nobody.
    assert_eq!((report.tracks, report.false_tracks), (3, 2));
    assert_eq!(evaluation.frames[2].gospa().distance_m(), f64::sqrt(3.0 * 0.125));
    let mut scorer = Scorer::new(&truth, 0, 0.0).unwrap();
    let estimates = vec![ahead(8, 2.1)];
    scorer.score(&Observed { frame: Some(3), watching: false, estimates, ..Observed::default() });
    let report = scorer.finish().report("", 6);
    assert_eq!((counts(&report), report.directions, report.tracks), ([1, 0, 1, 0], 0, 0));
}

#[test]
fn the_direction_of_somebody_who_has_no_report_is_neither_missed_nor_false() {
    let (near, far) = ([0.0, 1.0], [0.0, 2.0]);
    let frame = |estimates| report(&[(vec![target(1, far)], estimates)], 0, 0.0);
    let directed = frame(vec![ahead(4, 0.9)]);
    assert_eq!((counts(&directed), directed.directions), ([0, 0, 0, 0], 1));
    assert_eq!((directed.people, directed.tracks, directed.false_tracks), (1, 1, 0));
    assert_eq!((directed.missed_share, directed.mean_error_m, directed.gospa_m), (None, None, Some(0.0)));
    // The second report has nobody left; one that is near is no direction, and the other then holds nobody.
    let twice = frame(vec![ahead(4, 0.9), ahead(5, 1.2)]);
    assert_eq!((counts(&twice), twice.directions, twice.false_tracks), ([0, 0, 0, 1], 1, 1));
    let found = frame(vec![ahead(4, 0.9), track(5, far)]);
    assert_eq!((counts(&found), found.directions), ([1, 1, 0, 1], 0));
    // Beside them.
    let past = frame(vec![Estimate { position: [0.6, 0.9], ..ahead(4, 0.0) }]);
    assert_eq!((counts(&past), past.directions), ([1, 0, 1, 1], 0));
    // Of two who stand one behind the other, one is known.
    let behind = report(&[(vec![target(1, near), target(2, far)], vec![ahead(4, 2.9)])], 0, 0.0);
    assert_eq!((counts(&behind), behind.directions), ([1, 0, 1, 0], 1));
    let farther = [0.0, 2.6];
    // Whoever settles gets a direction only if nobody who counts is there.
    let late = |settled: bool| {
        let mut frames: Vec<_> =
            (0..10).map(|_| (if settled { vec![target(1, farther)] } else { vec![] }, vec![])).collect();
        let there = if settled { vec![target(2, near), target(1, farther)] } else { vec![target(2, near)] };
        frames.push((there, vec![ahead(4, 1.8)]));
        report(&frames, 10, 0.5)
    };
    assert_eq!((counts(&late(true)), late(true).directions), ([0, 0, 0, 0], 1));
    assert_eq!((counts(&late(false)), late(false).directions), ([0, 0, 0, 0], 1));
}

#[test]
fn crossings_count_from_every_update_after_the_background() {
    use doorcam_core::tracking::Direction::{In, Out};
    let mut truth = truth_of((0..60).filter(|k| k % 2 == 0).map(|k| (k, vec![])));
    let crossing = |&(t, direction): &(f64, _)| TrueCrossing { t, direction };
    truth.crossings = [(0.5, Out), (2.0, In), (4.0, Out), (5.0, In)].iter().map(crossing).collect();
    let mut scorer = Scorer::new(&truth, 10, 0.0).unwrap();
    let clock = |seconds: f64| jiff::Timestamp::from_millisecond((1000.0 * seconds) as i64).unwrap();
    let mut tell = |frame: Option<u64>, at: f64, direction| {
        scorer.score(&Observed {
            frame,
            time: frame.map(|frame| clock(frame as f64 / FPS)),
            crossings: vec![ReportedCrossing { time: clock(at), direction }],
            ..Observed::default()
        });
    };
    // In a frame that the truth does not contain, in the same one again, long after, and of no frame.
    tell(Some(23), 2.2, In);
    tell(Some(23), 3.9, Out);
    tell(Some(58), 4.6, Out);
    tell(None, 5.0, In);
    let evaluation = scorer.finish();
    let CrossingCounts { right, missed, strays } = evaluation.report("", 60).crossings;
    assert_eq!([right, missed, strays], [1, 2, 1]);
    assert_eq!(evaluation.frames.len(), 1);
}

#[test]
fn rows_by_person_and_by_distance_add_up_to_the_whole() {
    let (a, b) = (target(3, [0.6, 0.7]), target(5, [0.0, 2.4]));
    let frames = [
        (vec![a, b], vec![track(1, [0.6, 0.9]), ahead(2, 1.2)]),
        (vec![a, b], vec![track(1, [0.6, 1.0]), track(2, [0.0, 2.5])]),
        (vec![b, Target { x_m: 1.0, y_m: 1.0, ..a }], vec![]),
    ];
    let evaluation = evaluate(&frames, 0, 0.0);
    let people = evaluation.by_person();
    let figures = |row: &RowFigures| [row.targets, row.detected, row.missed, row.directions];
    let ids: Vec<u64> = people.iter().map(|row| row.id).collect();
    assert_eq!(ids, [3, 5]);
    assert_eq!(figures(&people[0].figures), [3, 2, 1, 0]);
    assert_eq!(figures(&people[1].figures), [2, 1, 1, 1]);
    assert!((people[0].figures.mean_error_m.unwrap() - 0.25).abs() < 1e-12);
    // (0.2 / 0.1)² = 4 is inside, (0.3 / 0.1)² = 9 outside.
    assert_eq!([0, 1].map(|k| people[k].figures.ellipse_share), [Some(0.5), Some(1.0)]);
    let metres = evaluation.by_distance();
    let rows: Vec<_> = metres.iter().map(|row| (row.from_m, row.to_m, figures(&row.figures))).collect();
    assert_eq!(rows, [(0, 1, [2, 2, 0, 0]), (1, 2, [1, 0, 1, 0]), (2, 3, [2, 1, 1, 1])]);
    assert_eq!((metres[1].figures.mean_error_m, metres[1].figures.ellipse_share), (None, None));
    let report = evaluation.report("", 3);
    let sum = |of: fn(&RowFigures) -> usize| people.iter().map(|row| of(&row.figures)).sum::<usize>();
    assert_eq!([sum(|r| r.targets), sum(|r| r.detected), sum(|r| r.missed)], [5, 3, 2]);
    assert_eq!((report.targets, report.detected, report.missed, report.directions), (5, 3, 2, 1));
    assert!(report.by_person.is_none() && report.by_distance.is_none());
    // Who only settles has no row.
    assert_eq!(evaluate(&frames, 0, 9.0).by_person(), []);
}
