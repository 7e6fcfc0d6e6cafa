use super::super::scenario::SMALLEST;
use super::*;
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
        if scenario.shows_people() {
            // Who stands on the floor itself darkens it by more.
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
            let levels = simulator.levels(seconds);
            let empty = simulator.light.light(&levels, Vec::new(), [0.0; 3]);
            let nodes = simulator.light.light(&levels, figures(&simulator, seconds), simulator.visible);
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
    let (some, all) = (simulator.light.light(&[1.0], people(), [0.0; 3]), all.light(&[1.0], people(), [0.0; 3]));
    assert_ne!(some, all);
    for pixel in &simulator.views[0].view.pixels {
        assert_eq!(pixel.taps.map(|tap| tap.of(&some)), pixel.taps.map(|tap| tap.of(&all)));
    }
}
