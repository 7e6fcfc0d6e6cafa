use super::super::scenario::SMALLEST;
use super::*;
use doorcam_core::tracking::Direction;
use doorcam_source::image::ImageDecoder;

fn simulator(edit: impl Fn(String) -> String, seed: u64) -> Simulator {
    Simulator::new(Scenario::parse(&edit(SMALLEST.into())).unwrap(), seed).unwrap()
}

fn with_person(text: String) -> String {
    text.replace(
        "[visible]",
        "[[person]]\nclothes = [0.6, 0.1, 0.1]\nwalk = [[0, -0.5, 1.2], [3, 0.5, 1.2]]\n[visible]",
    )
}

fn figures(simulator: &Simulator, seconds: f64) -> Vec<Figure> {
    match simulator.cast_at(seconds) {
        Cast::Unseen(figures) => figures,
        Cast::Seen(bodies) => bodies.iter().map(Body::figure).collect(),
        Cast::Ordinary(_) => panic!("an ordinary room"),
    }
}

fn bytes(frame: &RawFrame) -> Vec<u8> {
    match &frame.images {
        RawImages::Camera(bytes) | RawImages::Sensor(_, bytes) => bytes.to_vec(),
        RawImages::Patches([left, right]) => [left.as_slice(), right.as_slice()].concat(),
    }
}

#[test]
fn seeds_reproduce_frames_made_in_any_order() {
    let (first, again, other) = (simulator(with_person, 3), simulator(with_person, 3), simulator(with_person, 4));
    let later = bytes(&first.frame(12).unwrap());
    let early = bytes(&first.frame(0).unwrap());
    assert_eq!(bytes(&again.frame(0).unwrap()), early);
    assert_eq!(bytes(&again.frame(12).unwrap()), later);
    assert_ne!(bytes(&other.frame(12).unwrap()), later);
    // The next round shows the same with other noise.
    let next = first.frame(20).unwrap();
    assert_eq!((next.index, next.seconds, next.purpose), (Some(0), 4.0, Purpose::Background));
    assert_ne!(bytes(&next), early);
}

#[test]
fn the_truth_has_people_from_the_end_of_the_empty_time_while_they_are_there() {
    let simulator = simulator(with_person, 1);
    let targets: Vec<usize> = (0..20).map(|k| simulator.truth(k).targets.len()).collect();
    assert_eq!(targets, [vec![0; 5], vec![1; 15]].concat());
    let target = simulator.truth(5).targets[0];
    assert_eq!((target.id, target.x_m, target.y_m, target.radius_m), (1, -0.5, 1.2, 0.2));
}

fn varied(name: &str, seed: u64) -> Simulator {
    let mut scenario = Scenario::varied(name, seed).unwrap();
    scenario.camera.size = [96, 54];
    Simulator::new(scenario, seed).unwrap()
}

#[test]
fn scenarios_that_vary_are_the_same_with_the_same_seed() {
    for name in ["bag", "bump", "pass-by", "walk-through"] {
        let (first, again, other) = (varied(name, 3), varied(name, 3), varied(name, 4));
        for number in [0, 60, 75] {
            assert_eq!(bytes(&first.frame(number).unwrap()), bytes(&again.frame(number).unwrap()), "{name}");
            assert_ne!(bytes(&first.frame(number).unwrap()), bytes(&other.frame(number).unwrap()), "{name}");
        }
        assert_eq!((first.truth(75), first.true_crossings()), (again.truth(75), again.true_crossings()));
        assert_eq!(first.true_crossings().is_empty(), name != "walk-through", "{name}");
    }
}

/// Who crosses in is in the truth from the next frame on, who crosses out until the frame before.
#[test]
fn the_truth_has_somebody_between_their_crossings_and_while_they_are_in_the_room() {
    let mut directions = Vec::new();
    for seed in 1..=20 {
        let simulator = varied("walk-through", seed);
        let people = |t: f64| {
            let frame = simulator.truth((t * 10.0) as u64);
            frame.targets.iter().filter(|target| target.id == 1).count()
        };
        let crossings = simulator.true_crossings();
        assert!(!crossings.is_empty(), "seed {seed}");
        for crossing in &crossings {
            let around = [people(crossing.t), people(crossing.t + 0.1)];
            let expected = match crossing.direction {
                Direction::In => [0, 1],
                Direction::Out => [1, 0],
                Direction::Back => [0, 0],
            };
            assert_eq!(around, expected, "seed {seed}: {crossing:?}");
            directions.push(crossing.direction);
        }
        assert!((0..130).all(|k| simulator.truth(k).targets.iter().all(|target| target.y_m >= 0.0)), "seed {seed}");
    }
    for direction in [Direction::In, Direction::Out, Direction::Back] {
        assert!(directions.contains(&direction), "{direction:?} in {directions:?}");
    }
}

/// A recording of two rounds tells the crossings and bumps of both.
#[test]
fn a_recording_tells_crossings_and_bumps_of_each_round() {
    let walker = |text: String| {
        let walk = "walk = [[0, 0, -2], [1.0, 0, -0.5], [2.9, 0, 1.4]]";
        let person = &format!("[[person]]\nclothes = [0.6, 0.1, 0.1]\n{walk}\n[visible]");
        let camera = "[camera]\nsize = [64, 36]\nbump = [[2, 3, 0, 0.5]]";
        text.replace("[visible]", person).replace("[camera]", camera)
    };
    let simulator = simulator(walker, 1);
    let dir = tempfile::tempdir().unwrap();
    crate::simulation::record_simulation(&simulator, dir.path(), 34, || ()).unwrap();
    let truth = doorcam_source::truth::Truth::of_recording(dir.path()).unwrap().unwrap();
    let [first, second] = truth.crossings[..] else { panic!("{:?}", truth.crossings) };
    assert_eq!((first.direction, second.direction), (Direction::In, Direction::In));
    assert!((2.0..3.0).contains(&first.t) && (second.t - first.t - 4.0).abs() < 1e-9, "{first:?} {second:?}");
    let text = std::fs::read_to_string(dir.path().join("truth.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let bump = |t: f64| serde_json::json!({"t": t, "shift_px": [3.0, 0.0], "turn_deg": 0.5});
    assert_eq!(json["bumps"], serde_json::json!([bump(3.0)]), "the second round's has not come yet");
}

/// The light on the floor beside the edges, as decoded from a noiseless picture.
#[test]
fn a_picture_has_the_level_and_the_visible_sides_share_that_the_scenario_says() {
    let noiseless = |text: String| {
        let camera = "[camera]\nformat = \"png\"\nfull_scale_electrons = inf\nread_electrons = 0\nlevel = 0.35";
        text.replace("[camera]", camera)
    };
    let dark =
        |text: String| noiseless(text).replace("radius_m = 0.08", "radius_m = 0.08\nswitch = [[-9, 1.0], [1, 0.0]]");
    let simulator = simulator(dark, 1);
    let camera = Pinhole::new(&simulator.scenario().camera);
    let level = |number: u64| {
        let frame = simulator.frame(number).unwrap();
        let mut decoder = ImageDecoder::default();
        let image = decoder.decode(&bytes(&frame), None).unwrap();
        let Samples::Eight(codes) = &image.samples else { panic!("8 bits") };
        let points: Vec<Point> =
            Side::BOTH.into_iter().flat_map(|side| REFERENCE.points(&simulator.scenario().doorway, side)).collect();
        let light = |&point: &Point| {
            let [u, v] = camera.see(point).unwrap();
            let at = 3 * (v.round() as usize * image.width + u.round() as usize);
            codes[at..at + 3].iter().map(|&code| Transfer::Srgb.light(f64::from(code) / 255.0)).sum::<f64>() / 3.0
        };
        points.iter().map(light).sum::<f64>() / points.len() as f64
    };
    assert!((level(0) / 0.35 - 1.0).abs() < 0.01, "{}", level(0));
    // The only lamp of the room is off: the visible side's 40 % remain.
    assert!((level(15) / level(0) - 0.4).abs() < 0.01, "{}", level(15) / level(0));
}

#[test]
fn raw_pixels_png_and_patches_come_as_asked() {
    let with =
        |line: &str| simulator(|text| text.replace("[camera]", &format!("[camera]\nsize = [64, 48]\n{line}")), 1);
    let raw = with("format = \"rgb\"").frame(0).unwrap();
    let png = with("format = \"png\"").frame(0).unwrap();
    let RawImages::Sensor(format, codes) = &raw.images else { panic!("raw") };
    assert_eq!((format.width, format.height, codes.len()), (64, 48, 3 * 64 * 48));
    let decoded = doorcam_source::image::decode(&bytes(&png)).unwrap();
    assert_eq!(decoded.samples, Samples::Eight(codes.to_vec()));
    let patches = with("layout = \"patches\"");
    assert_eq!((patches.manifest().size, patches.manifest().fov_m), (Some([64, 64]), Some(0.3)));
    let RawImages::Patches([left, _]) = patches.frame(0).unwrap().images else { panic!("patches") };
    let left = doorcam_source::image::decode(&left).unwrap();
    assert!(matches!((left.width, left.height, left.samples), (64, 64, Samples::Sixteen(_))));
}

#[test]
fn a_camera_that_does_not_see_the_doorways_foot_is_refused() {
    let text = SMALLEST.replace("look_at_m = [0.0, -0.25]", "look_at_m = [3.0, -0.25]");
    let error = Simulator::new(Scenario::parse(&text).unwrap(), 1).unwrap_err();
    assert!(error.starts_with("camera sees 0 of the 10 marks"), "{error}");
}

/// As in path-traced rooms of this kind, a person mostly takes light away, at most some percent of the floor's.
#[test]
fn people_darken_the_floor_by_some_percent_in_every_scenario_that_has_them() {
    for name in Scenario::names() {
        let simulator = Simulator::new(Scenario::load(&name).unwrap(), 1).unwrap();
        let scenario = simulator.scenario();
        if scenario.shows_people() || scenario.is_ordinary() {
            // Who stands on the floor itself, or before a window, darkens it by more.
            continue;
        }
        let points: Vec<Point> = Side::BOTH.into_iter().flat_map(|s| REFERENCE.points(&scenario.doorway, s)).collect();
        let map = simulator.light.floor();
        let (mut peak, mut sum, mut count, mut rms) = (0.0_f64, [0.0; 3], 0.0, Vec::new());
        for index in (0..scenario.frames().min(1000)).step_by(10) {
            if simulator.truth(index).targets.is_empty() {
                continue;
            }
            let seconds = simulator.seconds_after_empty(index);
            let levels = simulator.levels(seconds, None);
            let light = |cast: Cast| simulator.hidden_light(&levels, cast, simulator.visible).0;
            let empty = light(Cast::Unseen(Vec::new()));
            let nodes = light(simulator.cast_at(seconds));
            let mut squares = 0.0;
            for &point in &points {
                let [a, b] = map.taps(point).map(|tap| tap.of(&nodes));
                let [p, q] = map.taps(point).map(|tap| tap.of(&empty));
                for c in 0..3 {
                    let level = f64::from(p[c] + q[c]) + simulator.visible[c];
                    let change = f64::from(a[c] + b[c] - p[c] - q[c]) / level;
                    peak = peak.max(change.abs());
                    sum[c] += change;
                    squares += change * change;
                }
            }
            rms.push((squares / (3 * points.len()) as f64).sqrt());
            count += points.len() as f64;
        }
        if count == 0.0 {
            assert_eq!(name, "empty-room");
            continue;
        }
        rms.sort_by(f64::total_cmp);
        let mean = sum.map(|s| s / count);
        println!("{name}: peak {peak:.3}, mean {mean:.4?}, median rms {:.4}", rms[rms.len() / 2]);
        assert!((0.03..0.2).contains(&peak), "{name}: {peak}");
        assert!(mean.iter().filter(|&&m| m < 0.0).count() >= 2, "{name}: {mean:?}");
    }
}

/// Leaving out nodes that the camera does not use changes nothing that it sees.
#[test]
fn nodes_that_no_pixel_needs_may_be_left_out() {
    let simulator = simulator(with_person, 1);
    let all = RoomLight::new(simulator.scenario());
    let people = || figures(&simulator, 1.0);
    let some = simulator.hidden_light(&[1.0], Cast::Unseen(people()), [0.0; 3]).0;
    let all = all.light(&[1.0], people(), [0.0; 3]);
    assert_ne!(some, all);
    for pixel in &simulator.views[0].view.pixels {
        assert_eq!(pixel.taps.map(|tap| tap.of(&some)), pixel.taps.map(|tap| tap.of(&all)));
    }
}
