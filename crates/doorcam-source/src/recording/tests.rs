use proptest::prelude::*;

use super::*;

const MANIFEST: &str = r#"{"fps": 5, "layout": "patches", "transfer": "linear", "size": [64, 64],
        "doorway": {"width_m": 0.9, "wall_thickness_m": 0.1, "height_m": null}, "fov_m": 0.15,
        "background_frames": [0, 2], "notes": "x", "shutter": {"open": 0}}"#;

fn folder(manifest: &str, names: &[&str]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("recording.json"), manifest).unwrap();
    std::fs::create_dir(dir.path().join("frames")).unwrap();
    for name in names {
        std::fs::write(dir.path().join("frames").join(name), b"x").unwrap();
    }
    dir
}

fn error(manifest: &str, names: &[&str]) -> String {
    let dir = folder(manifest, names);
    let text = Recording::open(dir.path()).expect_err("refused").to_string();
    text.replace(&dir.path().display().to_string(), "DIR")
}

#[test]
fn frames_are_listed_with_gaps_and_unknown_keys_are_reported() {
    let names = [
        "00000000_left.png",
        "00000000_right.jpg",
        "00000001_left.png",
        "00000003_left.png",
        "00000003_right.png",
        "notes.txt",
    ];
    let dir = folder(MANIFEST, &names);
    let recording = Recording::open(dir.path()).unwrap();
    assert_eq!(recording.unknown_keys, ["shutter"]);
    let at = |n: &str| dir.path().join("frames").join(n);
    let files: Vec<_> = recording.frames.iter().map(|f| (f.index, f.seconds, f.files.clone())).collect();
    assert_eq!(
        files,
        [
            (0, 0.0, Files::Patches(at("00000000_left.png"), at("00000000_right.jpg"))),
            (1, 0.2, Files::Missing(at("00000001_right.png"))),
            (2, 0.4, Files::Missing(at("00000002_left.png"))),
            (3, 0.6, Files::Patches(at("00000003_left.png"), at("00000003_right.png"))),
        ]
    );
    assert_eq!((recording.purpose(1), recording.purpose(2)), (Purpose::Background, Purpose::Watch));
}

#[test]
fn times_come_from_the_file_where_there_is_one() {
    let dir = folder(MANIFEST, &["00000000_left.png", "00000000_right.png"]);
    std::fs::write(dir.path().join("timestamps.csv"), "index,seconds\n0,12.5\n").unwrap();
    assert_eq!(Recording::open(dir.path()).unwrap().frames[0].seconds, 12.5);
    std::fs::write(dir.path().join("timestamps.csv"), "index,seconds\n0,12.5\n1,soon\n").unwrap();
    let text = Recording::open(dir.path()).expect_err("refused").to_string();
    assert!(text.ends_with("timestamps.csv: line 3: expected \"index,seconds\""), "{text}");
}

#[test]
fn what_is_wrong_is_said_in_one_line_that_names_file_and_key() {
    let dir = tempfile::tempdir().unwrap();
    let text = Recording::open(dir.path()).expect_err("refused").to_string();
    assert!(
        text.ends_with("recording.json: cannot read the recording's manifest: no such file or directory"),
        "{text}"
    );
    let with = |from: &str, to: &str| error(&MANIFEST.replace(from, to), &["00000000_left.png", "00000000_right.png"]);
    assert_eq!(
        with("\"fps\": 5", "\"fps\": 0"),
        "DIR/recording.json: fps is 0, expected a number of frames a second above 0"
    );
    assert_eq!(with("0.9", "-1"), "DIR/recording.json: doorway.width_m is -1, expected 0.05 to 10 metres");
    assert_eq!(
        with("0.9", "\"wide\""),
        "DIR/recording.json: doorway.width_m: invalid type: string \"wide\", expected f64 at line 2 column 37"
    );
    assert_eq!(
        with("\"linear\"", "{\"gamma\": -2.2}"),
        "DIR/recording.json: transfer.gamma is -2.2, expected 0.1 to 10"
    );
    assert_eq!(
        with("\"linear\"", "\"rec709\""),
        "DIR/recording.json: transfer: unknown variant `rec709`, expected one of `srgb`, `linear`, `gamma`, `curve` at \
         line 1 column 52"
    );
    assert_eq!(
        with(", \"fov_m\": 0.15", ""),
        "DIR/recording.json: fov_m is missing; layout \"patches\" needs the patches' side in metres"
    );
    assert_eq!(
        with("\"patches\"", "\"camera\""),
        "DIR/recording.json: floor_points has 0 points, expected at least 4 with layout \"camera\""
    );
    assert_eq!(
        with("[0, 2]", "[2, 2]"),
        "DIR/recording.json: background_frames is [2, 2], expected [first, end) with first < end"
    );
    let points = r#""camera", "floor_points": [{"pixel": [0, 0], "floor_m": [0, 0]}, {"pixel": [9, 0], "floor_m": [1, 0]},
        {"pixel": [0, 9], "floor_m": [0, 1]}, {"pixel": [9, 9], "floor_m": [1, 1]}]"#;
    let unsized_camera = MANIFEST.replace("\"patches\"", points).replace("\"size\": [64, 64],", "");
    assert_eq!(
        error(&unsized_camera, &["00000000.png"]),
        "DIR/recording.json: size is missing; layout \"camera\" needs the images' [width, height] in pixels"
    );
    assert!(error(MANIFEST, &[]).starts_with("DIR/frames: no images"));
}

/// A camera's recording of 64 x 48 pixels.
fn camera_manifest() -> serde_json::Value {
    let point = |u: i32, v: i32, x: f64, y: f64| serde_json::json!({"pixel": [u, v], "floor_m": [x, y]});
    serde_json::json!({
        "fps": 5, "layout": "camera", "transfer": "linear", "size": [64, 48], "doorway": {"width_m": 0.9},
        "floor_points": [point(0, 0, 0.0, 0.0), point(9, 0, 1.0, 0.0), point(0, 9, 0.0, -1.0), point(9, 9, 1.0, -1.0)],
        "background_frames": [0, 2]
    })
}

#[test]
fn extreme_values_and_counts_are_refused_by_key_and_limit() {
    let with = |key: &str, value: serde_json::Value| {
        let mut manifest = camera_manifest();
        manifest[key] = value;
        error(&manifest.to_string(), &["0.jpg", "1.jpg"]).replace("DIR/recording.json: ", "")
    };
    for fps in [1e-9, 1e9, 1e308, 5e-324, 0.009] {
        let error = with("fps", fps.into());
        assert!(error.starts_with("fps is ") && error.ends_with("expected 0.01 to 1000 frames a second"), "{error}");
    }
    assert!(with("fps", (-0.0).into()).starts_with("fps is -0, expected a number of frames a second above 0"));
    assert!(with("size", serde_json::json!([100_000, 100_000])).starts_with("size is [100000, 100000], expected"));
    assert!(with("size", serde_json::json!([usize::MAX, usize::MAX])).starts_with("size is ["));
    assert!(
        with("background_frames", serde_json::json!([5, 900]))
            .starts_with("background_frames is [5, 900], but the frames are 0 to 1")
    );
    assert!(with("notes", "x".repeat(20_000).into()).starts_with("notes has 20000 bytes, expected at most 16384"));
    assert!(with("transfer", serde_json::json!({"gamma": 1e308})).starts_with("transfer.gamma is 1"));
    let curve: Vec<f64> = (0..100_000).map(f64::from).collect();
    assert!(with("transfer", serde_json::json!({ "curve": curve })).starts_with("transfer.curve has 100000 values"));
    let point = camera_manifest()["floor_points"][0].clone();
    let error = with("floor_points", vec![point; 100_000].into());
    assert!(error.starts_with("floor_points: more than 64 values, expected at most 64"), "{error}");
    let patches = |fov: f64| error_of_fov(fov);
    for fov in [1e308, 1e-308, 100.5] {
        assert!(patches(fov).ends_with("expected 0.01 to 100 metres"), "{fov}");
    }
}

fn error_of_fov(fov: f64) -> String {
    error(&MANIFEST.replace("0.15", &format!("{fov:e}")), &["00000000_left.png", "00000000_right.png"])
}

#[test]
fn whatever_rate_a_driver_reports_its_recording_opens() {
    let manifest: Manifest = serde_json::from_value(camera_manifest()).unwrap();
    let calibration = manifest.calibration().unwrap();
    for (reported, written) in [(90_000.0, 1000.0), (1e-6, 0.01), (29.97, 29.97)] {
        let manifest = Manifest::of_camera(&calibration, reported, String::new());
        assert_eq!((manifest.fps, manifest.check()), (written, Ok(())));
    }
}

#[test]
fn many_unknown_keys_are_not_all_kept() {
    let mut manifest = camera_manifest();
    for n in 0..1000 {
        manifest[format!("key\n{n}")] = n.into();
    }
    let dir = folder(&manifest.to_string(), &["0.jpg", "1.jpg"]);
    let keys = Recording::open(dir.path()).unwrap().unknown_keys;
    assert!(keys.len() == 20 && keys.iter().all(|key| !key.contains('\n')), "{keys:?}");
}

#[test]
fn a_byte_order_mark_is_taken_and_another_encoding_named() {
    let manifest = camera_manifest().to_string();
    let dir = folder(&format!("\u{feff}{manifest}"), &["0.jpg", "1.jpg"]);
    std::fs::write(dir.path().join("timestamps.csv"), "\u{feff}index,seconds\n0,1\n1,1.2\n").unwrap();
    assert_eq!(Recording::open(dir.path()).unwrap().frames[1].seconds, 1.2);
    let wide: Vec<u8> = manifest.encode_utf16().flat_map(u16::to_be_bytes).collect();
    std::fs::write(dir.path().join("recording.json"), [&b"\xfe\xff"[..], &wide].concat()).unwrap();
    let error = Recording::open(dir.path()).unwrap_err().to_string();
    assert!(error.ends_with("manifest: is text in UTF-16 or UTF-32, expected UTF-8"), "{error}");
}

#[test]
fn notes_name_the_file_that_they_are_about() {
    let dir = folder(&camera_manifest().to_string(), &["0.jpg", "1.jpg", "3.jpg", "cover.jpg"]);
    std::fs::write(dir.path().join("timestamps.csv"), "index,seconds\n0,0\n1,0.2\n3,3600\n").unwrap();
    let recording = Recording::open(dir.path()).unwrap();
    let notes: Vec<String> =
        recording.notes.iter().map(|note| note.replace(&dir.path().display().to_string(), "DIR")).collect();
    assert_eq!(
        notes,
        [
            "DIR/frames: 1 file is left out, as no frames: cover.jpg",
            "DIR/frames: 1 frame is missing, by the numbers: 2",
            "DIR/timestamps.csv: line 4: the time jumps by 3600 s: the frames go on as if it did not",
        ]
    );
    let seconds: Vec<f64> = recording.frames.iter().map(|frame| frame.seconds).collect();
    assert!(seconds.windows(2).all(|w| (w[1] - w[0] - 0.2).abs() < 1e-9), "{seconds:?}");
}

#[test]
fn what_is_no_file_is_refused_without_waiting_for_it() {
    for name in ["recording.json", "timestamps.csv"] {
        let dir = folder(&camera_manifest().to_string(), &["0.jpg", "1.jpg"]);
        let path = dir.path().join(name);
        let _ = std::fs::remove_file(&path);
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        let error = Recording::open(dir.path()).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("is a FIFO, expected a file with a recording's "), "{error}");
        std::fs::remove_file(&path).unwrap();
        std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
        let error = Recording::open(dir.path()).unwrap_err().to_string();
        assert!(error.contains("is a device, expected a file with a recording's "), "{error}");
    }
}

#[test]
fn a_size_of_turned_images_is_refused_and_any_other_tag_noted() {
    let open = |value: u8, size: [usize; 2], expected_first: &str| {
        let mut manifest = camera_manifest();
        manifest["size"] = serde_json::json!(size);
        let dir = folder(&manifest.to_string(), &["1.jpg"]);
        let pixels = doorcam_core::image::Image {
            width: 64,
            height: 48,
            samples: doorcam_core::image::Samples::Eight(vec![9; 3 * 64 * 48]),
        };
        let jpeg = crate::image::encode_jpeg(&pixels, 90).unwrap();
        let file = dir.path().join("frames/0.jpg");
        std::fs::write(&file, crate::orientation::tagged(&jpeg, value, true)).unwrap();
        let opened = Recording::open(dir.path());
        let text = match opened {
            Ok(recording) => recording.notes.concat(),
            Err(e) => format!("refused: {e}"),
        };
        let text = text.replace(&file.display().to_string(), "FILE");
        assert!(text.starts_with(expected_first), "{value} {size:?}: {text}");
    };
    open(1, [64, 48], "");
    for value in 2..=8 {
        open(value, [64, 48], &format!("FILE: tagged to be turned for people (EXIF orientation {value})"));
    }
    for value in 5..=8 {
        open(
            value,
            [48, 64],
            &format!(
                "refused: FILE: its pixels are stored as 64 x 48 and tagged to be turned (EXIF orientation {value})"
            ),
        );
    }
}

proptest! {
    #[test]
    fn any_text_as_manifest_is_refused_or_read_without_panic(text in ".{0,200}") {
        let _ = parse_manifest(&text);
    }

    #[test]
    fn damaged_manifests_never_panic(at in 0usize..300, with in proptest::char::any()) {
        let mut text: Vec<char> = MANIFEST.chars().collect();
        let length = text.len();
        text[at % length] = with;
        if let Ok((manifest, _)) = parse_manifest(&text.into_iter().collect::<String>()) {
            let _ = manifest.check();
        }
    }
}
