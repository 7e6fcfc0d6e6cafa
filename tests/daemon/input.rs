//! What comes in from files: only what it should be is read, and what is wrong with it is said once.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::common::{Daemon, JPEG, camera_recording, doorcam, grey_recording, manifest, run, stderr};
use serde_json::{Value, json};

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

fn fifo(path: &Path) {
    let _ = std::fs::remove_file(path);
    assert!(Command::new("mkfifo").arg(path).status().expect("mkfifo").success());
}

/// Runs the program, which must fail with status 1 and one line of error, and returns that.
fn failure(arguments: &[&str]) -> String {
    let output = doorcam(arguments).env("RUST_LOG", "error").output().expect("starts");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
    assert_eq!(said.lines().count(), 1, "{arguments:?}: {said}");
    said.trim_end().to_owned()
}

/// Runs the program, which must succeed; the numbers of the frames that it reconstructed, and what it said.
fn reconstructed(arguments: &[&str]) -> (Vec<u64>, String) {
    let output = run(arguments);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {said}");
    let out = String::from_utf8(output.stdout).expect("UTF-8");
    let frame = |line: &str| serde_json::from_str::<Value>(line).expect("JSON")["frame"].as_u64().expect("a number");
    (out.lines().map(frame).collect(), said)
}

#[test]
fn frames_that_are_no_files_are_skipped_without_waiting_for_them() {
    let dir = grey_recording(&manifest(), 9);
    let at = |name: &str| dir.path().join("frames").join(name);
    fifo(&at("00000003_left.jpg"));
    for (name, to) in [("00000004_left.jpg", "/dev/zero"), ("00000005_right.jpg", "/dev/stdin")] {
        std::fs::remove_file(at(name)).unwrap();
        symlink(to, at(name)).unwrap();
    }
    std::fs::remove_file(at("00000006_left.jpg")).unwrap();
    std::fs::create_dir(at("00000006_left.jpg")).unwrap();
    std::fs::File::create(at("00000007_left.jpg")).unwrap().set_len(100 << 30).unwrap();
    // A link to a file is as good as the file.
    std::fs::rename(at("00000008_left.jpg"), dir.path().join("elsewhere.jpg")).unwrap();
    symlink(dir.path().join("elsewhere.jpg"), at("00000008_left.jpg")).unwrap();
    let (frames, said) = reconstructed(&["reconstruct", text(dir.path())]);
    assert_eq!(frames, [2, 8], "{said}");
    for line in [
        "00000003_left.jpg: is a FIFO, expected a file with an image",
        "00000004_left.jpg: is a device, expected a file with an image",
        "00000006_left.jpg: is a directory, expected a file with an image",
        "00000007_left.jpg: is larger than 256 MB, expected an image",
        "5 frames skipped: 5 not readable (the first is frames/00000003_left.jpg: is a FIFO",
    ] {
        assert!(said.contains(line), "{line}: {said}");
    }
}

#[test]
fn other_files_that_are_none_are_refused_in_one_line() {
    let dir = grey_recording(&manifest(), 4);
    let path = text(dir.path());
    fifo(&dir.path().join("truth.json"));
    let refused = failure(&["evaluate", path]);
    assert!(refused.ends_with("truth.json: is a FIFO, expected a file with a recording's truth"), "{refused}");

    let pipe = dir.path().join("pipe");
    fifo(&pipe);
    let source = format!("replay:{path}");
    let camera = camera_recording(3);
    let of_camera = format!("replay:{}", camera.path().display());
    for (arguments, expected) in [
        (vec!["check-config", text(&pipe)], "a configuration"),
        (vec!["reconstruct", path, "--config", text(&pipe)], "a configuration"),
        (vec!["simulate", text(&pipe), text(&dir.path().join("out"))], ""),
        (vec!["serve", "--source", &source, "--token-file", text(&pipe)], "a token or a key"),
        (vec!["serve", "--source", &of_camera, "--calibration", text(&pipe)], "a calibration"),
        (vec!["serve", "--source", &source, "--tls-cert", text(&pipe), "--tls-key", text(&pipe)], "certificates"),
    ] {
        let refused = failure(&arguments);
        let expected =
            if expected.is_empty() { String::new() } else { format!("is a FIFO, expected a file with {expected}") };
        assert!(refused.contains(&expected), "{arguments:?}: {refused}");
    }
    let scenario = dir.path().join("scenario.toml");
    fifo(&scenario);
    let refused = failure(&["simulate", text(&scenario), text(&dir.path().join("out"))]);
    assert!(refused.contains("is a FIFO, expected a file with a scenario"), "{refused}");
}

#[test]
fn what_is_piped_in_on_purpose_is_read() {
    let dir = grey_recording(&manifest(), 4);
    let command = format!(
        "printf '[patch]\\npixels = 32\\n' | {} reconstruct {} --config /dev/stdin",
        env!("CARGO_BIN_EXE_doorcam"),
        dir.path().display()
    );
    let output = Command::new("sh").args(["-c", &command]).output().expect("a shell");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(output.stdout.iter().filter(|&&byte| byte == b'\n').count(), 2);
}

#[test]
fn counts_are_looked_at_before_anything_is_made_of_them() {
    let camera = camera_recording(3);
    let file = camera.path().join("recording.json");
    let mut manifest_json: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    let point = manifest_json["floor_points"][0].clone();
    manifest_json["floor_points"] = vec![point; 100_000].into();
    std::fs::write(&file, manifest_json.to_string()).unwrap();
    let refused = failure(&["reconstruct", text(camera.path())]);
    assert!(refused.contains("recording.json: floor_points: more than 64 values, expected at most 64"), "{refused}");

    let dir = grey_recording(&manifest(), 4);
    let crowd: Vec<Value> = (0..100_000).map(|id| json!({"id": id, "x_m": 0, "y_m": 1})).collect();
    let truth = json!({"frames": [{"index": 2, "t": 0.2, "targets": crowd}]});
    std::fs::write(dir.path().join("truth.json"), truth.to_string()).unwrap();
    let refused = failure(&["evaluate", text(dir.path())]);
    assert!(refused.contains("truth.json: frames[0].targets: more than 256 values, expected at most 256"), "{refused}");

    let truth = json!({"frames": [{"index": 2, "t": 0.2, "targets": [{"id": 1, "x_m": 0, "y_m": 1}]}]});
    std::fs::write(dir.path().join("truth.json"), truth.to_string()).unwrap();
    let track = json!({"id": 1, "state": "confirmed", "x_m": 0, "y_m": 1, "covariance_m2": [[1, 0], [0, 1]]});
    let updates = dir.path().join("updates.jsonl");
    std::fs::write(&updates, json!({"frame": 2, "tracks": vec![track; 20_000]}).to_string()).unwrap();
    let refused = failure(&["evaluate", text(dir.path()), "--updates", text(&updates)]);
    assert!(refused.ends_with("line 1: tracks: 20000 tracks, expected at most 1024"), "{refused}");
}

#[test]
fn times_in_another_unit_are_refused_by_every_command() {
    let dir = grey_recording(&manifest(), 9);
    let path = text(dir.path());
    let truth = json!({"frames": [{"index": 2, "t": 0.2, "targets": []}]});
    std::fs::write(dir.path().join("truth.json"), truth.to_string()).unwrap();
    let source = format!("replay:{path}");
    for (per_second, unit) in [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")] {
        let lines: String = (0..9).map(|n| format!("{n},{}\n", f64::from(n) * 0.1 * per_second)).collect();
        std::fs::write(dir.path().join("timestamps.csv"), format!("index,seconds\n{lines}")).unwrap();
        for arguments in [vec!["reconstruct", path], vec!["evaluate", path], vec!["serve", "--source", &source]] {
            let refused = failure(&arguments);
            assert!(refused.contains("timestamps.csv: line 3: the times are "), "{arguments:?}: {refused}");
            assert!(refused.ends_with(&format!("they are probably {unit}, expected seconds")), "{refused}");
        }
    }
    std::fs::remove_file(dir.path().join("timestamps.csv")).unwrap();
    let frame = |n: u32| json!({"index": n, "t": 100 * n, "targets": []});
    let truth = json!({"frames": (0..9).map(frame).collect::<Vec<_>>()});
    std::fs::write(dir.path().join("truth.json"), truth.to_string()).unwrap();
    let refused = failure(&["evaluate", path]);
    assert!(refused.contains("truth.json: frames[1].t: the times are 100 s a frame apart"), "{refused}");
}

#[test]
fn a_replay_goes_on_after_a_jump_of_the_time() {
    let dir = grey_recording(&manifest(), 9);
    let times = [0.0, 0.1, 0.2, 0.3, 3600.4, 3600.5, -7200.0, -7199.9, -7199.8];
    let lines: String = (0..).zip(times).map(|(n, t): (u32, f64)| format!("{n},{t}\n")).collect();
    std::fs::write(dir.path().join("timestamps.csv"), lines).unwrap();
    let daemon = Daemon::start(&format!("replay:{}", dir.path().display()), &[]);
    daemon.wait_for("the end", |s| s["source"]["state"] == "ended");
    daemon.wait_for_log("timestamps.csv: line 5: the time jumps by 3600 s (and 1 more jump)");
}

#[test]
fn a_recording_without_a_usable_frame_fails_and_says_why() {
    let dir = grey_recording(&manifest(), 9);
    let path = text(dir.path());
    for index in 2..9 {
        let file = dir.path().join(format!("frames/{index:08}_right.jpg"));
        if index < 7 {
            std::fs::write(file, b"no image").unwrap();
        } else {
            std::fs::remove_file(&file).unwrap();
            std::fs::create_dir(&file).unwrap();
        }
    }
    let expected = format!(
        "doorcam: {path}: no frame could be used: 7 frames skipped: 5 damaged or no images (the first is \
         frames/00000002_right.jpg: neither a JPEG nor a PNG image), 2 not readable (the first is \
         frames/00000007_right.jpg: is a directory, expected a file with an image)"
    );
    assert_eq!(failure(&["reconstruct", path]), expected);
    let truth = json!({"frames": [{"index": 3, "t": 0.3, "targets": []}]});
    std::fs::write(dir.path().join("truth.json"), truth.to_string()).unwrap();
    let refused = failure(&["evaluate", path]);
    assert!(refused.contains("no update of a frame") && refused.contains("7 frames skipped: 5 damaged"), "{refused}");
    for index in 0..2 {
        std::fs::write(dir.path().join(format!("frames/{index:08}_left.jpg")), b"no image").unwrap();
    }
    let refused = failure(&["reconstruct", path]);
    assert!(refused.contains("9 frames skipped"), "{refused}");
}

#[test]
fn jpegs_without_their_end_marker_are_used_and_counted_once() {
    let dir = grey_recording(&manifest(), 9);
    for index in 0..9 {
        std::fs::write(dir.path().join(format!("frames/{index:08}_left.jpg")), &JPEG[..JPEG.len() - 2]).unwrap();
    }
    let (frames, said) = reconstructed(&["reconstruct", text(dir.path())]);
    assert_eq!(frames, [2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(said.matches("end marker").count(), 1, "{said}");
    assert!(said.contains("the JPEGs of 9 frames lack their end marker"), "{said}");

    let daemon = Daemon::start(&format!("replay:{},loop,rate=max", dir.path().display()), &[]);
    daemon.wait_for("many frames", |s| s["frames"]["solved"].as_u64() > Some(50));
    assert_eq!(daemon.log().matches("end marker").count(), 1, "{}", daemon.log());
}

#[test]
fn a_replay_whose_frames_vanish_says_so_once_and_goes_on_when_they_are_back() {
    for rate in ["", ",rate=max"] {
        let dir = grey_recording(&manifest(), 9);
        let (frames, away) = (dir.path().join("frames"), dir.path().join("away"));
        let daemon = Daemon::start(&format!("replay:{},loop{rate}", dir.path().display()), &[]);
        daemon.wait_for("a map", |s| s["state"] == "watching");
        std::fs::rename(&frames, &away).unwrap();
        let status = daemon.wait_for("the loss", |s| s["source"]["state"] == "lost");
        let reason = format!("{}: no such file or directory", frames.display());
        assert_eq!(status["source"]["error"], reason);
        let before = status["frames"]["skipped"].as_u64().unwrap();
        daemon.wait_for("more attempts", |s| s["frames"]["skipped"].as_u64() > Some(before + 20));
        daemon.wait_for_log(&reason);
        let log = daemon.log();
        assert_eq!(log.matches("skipped").count(), 1, "{log}");
        assert_eq!(log.matches(&reason).count(), 1, "{log}");
        std::fs::rename(&away, &frames).unwrap();
        let status = daemon.wait_for("frames again", |s| s["source"]["state"] == "streaming");
        assert!(status["source"]["error"].is_null(), "{status}");
        let solved = status["frames"]["solved"].as_u64();
        daemon.wait_for("a map again", |s| s["frames"]["solved"].as_u64() > solved && s["state"] == "watching");
        daemon.wait_for_log("frames come again");
    }
}

#[test]
fn a_replay_whose_frames_become_damaged_does_not_stream() {
    let dir = grey_recording(&manifest(), 9);
    let write = |bytes: &[u8]| {
        for index in 0..9 {
            for side in ["left", "right"] {
                let file = dir.path().join(format!("frames/{index:08}_{side}.jpg"));
                std::fs::write(file, bytes).unwrap();
            }
        }
    };
    let daemon = Daemon::start(&format!("replay:{},loop,rate=max", dir.path().display()), &[]);
    daemon.wait_for("a map", |s| s["state"] == "watching");
    write(b"no image");
    let status = daemon.wait_for("trouble", |s| s["source"]["state"] == "stalled");
    let error = status["source"]["error"].as_str().unwrap();
    assert!(error.starts_with("10 frames in a row cannot be used: frames/0000000"), "{error}");
    let before = status["frames"]["skipped"].as_u64().unwrap();
    daemon.wait_for("more attempts", |s| s["frames"]["skipped"].as_u64() > Some(before + 50));
    assert!(daemon.log().matches("neither a JPEG nor a PNG").count() <= 2, "{}", daemon.log());
    write(JPEG);
    let status = daemon.wait_for("frames again", |s| s["source"]["state"] == "streaming");
    assert!(status["source"]["error"].is_null(), "{status}");
}

#[test]
fn a_byte_order_mark_before_a_body_is_taken_and_another_encoding_named() {
    let dir = grey_recording(&manifest(), 9);
    let daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
    let put = |body: &[u8]| {
        let request = agent.put(format!("{}/api/v1/zones", daemon.url)).header("content-type", "application/json");
        let mut response = request.send(body).expect("an answer");
        (response.status().as_u16(), response.body_mut().read_to_string().expect("text"))
    };
    let zones = r#"{"zones": []}"#;
    let (plain, _) = put(zones.as_bytes());
    let (marked, answer) = put(format!("\u{feff}{zones}").as_bytes());
    assert_eq!(plain, marked, "{answer}");
    let wide: Vec<u8> = zones.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let (status, answer) = put(&wide);
    assert!(status == 400 && answer.contains("the body is text in UTF-16 or UTF-32, expected UTF-8"), "{answer}");
}

#[test]
fn numbers_count_and_strays_do_not_move_the_empty_room() {
    let dir = camera_recording(7);
    let frames = dir.path().join("frames");
    for index in 0..7 {
        std::fs::rename(frames.join(format!("{index:08}.jpg")), frames.join(format!("frame{}.jpg", index + 4)))
            .unwrap();
    }
    for stray in ["._frame4.jpg", "Thumbs.db", "cover.jpg", "frame4 (copy).jpg"] {
        std::fs::write(frames.join(stray), b"stray").unwrap();
    }
    let file = dir.path().join("recording.json");
    let mut manifest_json: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    manifest_json["background_frames"] = json!([4, 6]);
    std::fs::write(&file, manifest_json.to_string()).unwrap();
    let (numbers, said) = reconstructed(&["reconstruct", text(dir.path())]);
    assert_eq!(numbers, [6, 7, 8, 9, 10]);
    let note = "4 files are left out, as no frames: ._frame4.jpg, Thumbs.db, cover.jpg, frame4 (copy).jpg";
    assert_eq!(said.matches(note).count(), 1, "{said}");
    assert!(!said.contains("skipped"), "{said}");
}
