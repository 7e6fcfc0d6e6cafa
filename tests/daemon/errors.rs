//! Bad input: exit status 1 and one clear line.

use crate::common::{JPEG, doorcam, grey_recording, manifest, run, stderr};

/// Runs the program, which must fail with status 1 and one line, and returns the line.
fn failure<S: AsRef<std::ffi::OsStr> + std::fmt::Debug>(arguments: &[S]) -> String {
    let output = doorcam(arguments).env("RUST_LOG", "error").output().expect("starts");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
    assert_eq!(said.lines().count(), 1, "{arguments:?}: {said}");
    assert!(output.stdout.is_empty());
    said.trim_end().to_owned()
}

#[test]
fn a_truncated_image_is_one_skipped_frame_named_and_counted() {
    let dir = grey_recording(&manifest(), 5);
    std::fs::write(dir.path().join("frames/00000003_right.jpg"), &JPEG[..JPEG.len() / 2]).unwrap();
    let path = dir.path().to_str().unwrap();
    let output = run(&["reconstruct", path]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let frames: Vec<u64> = String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["frame"].as_u64().unwrap())
        .collect();
    assert_eq!(frames, [2, 4]);
    assert!(said.contains("skipped frame 3: frames/00000003_right.jpg: broken JPEG: cut off"), "{said}");
    assert!(said.contains("1 frames skipped"), "{said}");
}

#[test]
fn a_folder_without_manifest_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().to_str().unwrap();
    let expected =
        format!("doorcam: {path}/recording.json: cannot read the recording's manifest: no such file or directory");
    assert_eq!(failure(&["reconstruct", path]), expected);
    assert_eq!(failure(&["serve", "--source", &format!("replay:{path}")]), expected);
}

#[test]
fn a_doorway_wider_than_the_room_is_refused() {
    let mut manifest = manifest();
    manifest.doorway.width_m = 3.4;
    let dir = grey_recording(&manifest, 3);
    let path = dir.path().to_str().unwrap();
    assert_eq!(
        failure(&["reconstruct", path]),
        format!(
            "doorcam: {path}/recording.json: doorway.width_m is 3.4, wider than the room (3 m, room.half_width_m = 1.5)"
        )
    );
}

#[test]
fn a_lambda_that_is_no_positive_number_is_refused() {
    let dir = grey_recording(&manifest(), 3);
    let path = dir.path().to_str().unwrap();
    for (given, shown) in [("-1", "-1"), ("0", "0"), ("nan", "NaN"), ("inf", "inf"), ("-inf", "-inf")] {
        let expected = format!("doorcam: --lambda is {shown}, expected \"auto\" or a number above 0");
        assert_eq!(failure(&["reconstruct", path, "--lambda", given]), expected);
    }
    let expected = "doorcam: --lambda is \"few\", expected \"auto\" or a number above 0";
    assert_eq!(failure(&["reconstruct", path, "--lambda", "few"]), expected);
    assert_eq!(failure(&["serve", "--source", &format!("replay:{path}"), "--lambda=few"]), expected);
}

#[test]
fn an_unknown_key_or_bad_value_of_the_configuration_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("my.toml");
    let path = file.to_str().unwrap();
    std::fs::write(&file, "[solver]\nlambda = 0.1\n\n[room]\nwidth = 3\n").unwrap();
    let expected =
        format!("doorcam: {path}: line 5: unknown field `width`, expected one of `half_width_m`, `depth_m`, `lights`");
    assert_eq!(failure(&["check-config", path]), expected);
    let recording = grey_recording(&manifest(), 3);
    assert_eq!(failure(&["reconstruct", recording.path().to_str().unwrap(), "--config", path]), expected);
    std::fs::write(&file, "[patch]\npixels = 4\n").unwrap();
    assert_eq!(
        failure(&["check-config", path]),
        format!("doorcam: {path}: patch.pixels is 4, expected 8 to 256 pixels")
    );
    std::fs::write(&file, "[patch]\nexclude = [{ from_m = [-9, -9], to_m = [0, 0] }]\n").unwrap();
    let everything = failure(&["reconstruct", recording.path().to_str().unwrap(), "--config", path]);
    assert!(
        everything.ends_with("patch.exclude leaves 0 pixels of the left patch, expected at least 64"),
        "{everything}"
    );
    std::fs::write(&file, "[tls]\ncertificate_file = \"cert.pem\"\n").unwrap();
    let keyless = format!("doorcam: {path}: tls.key_file is empty, expected the key of tls.certificate_file");
    assert_eq!(failure(&["check-config", path]), keyless);
    std::fs::write(&file, "[patch]\npixels = 32\n").unwrap();
    assert_eq!(run(&["check-config", path]).status.code(), Some(0));
}

#[test]
fn a_port_in_use_is_refused() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let dir = grey_recording(&manifest(), 3);
    let source = format!("replay:{}", dir.path().display());
    assert_eq!(
        failure(&["serve", "--source", &source, "--listen", &address]),
        format!(
            "doorcam: cannot listen on {address}: the port is in use (choose another with --listen or server.listen)"
        )
    );
}

#[test]
fn recordings_without_anything_to_do_are_refused() {
    let mut no_background = manifest();
    no_background.background_frames = None;
    let dir = grey_recording(&no_background, 3);
    let path = dir.path().to_str().unwrap();
    assert!(failure(&["reconstruct", path]).contains("recording.json: background_frames is missing"));
    let dir = grey_recording(&manifest(), 2);
    let path = dir.path().to_str().unwrap();
    assert!(failure(&["reconstruct", path]).ends_with("no frame to reconstruct after background_frames"));
    // All background frames are broken, so there is nothing to compare with.
    let dir = grey_recording(&manifest(), 3);
    for index in 0..2 {
        std::fs::write(dir.path().join(format!("frames/{index:08}_left.jpg")), b"no image").unwrap();
    }
    let path = dir.path().to_str().unwrap();
    assert!(failure(&["reconstruct", path]).contains("no frame of the empty room could be read"));
}

#[test]
fn wrong_usage_is_status_2() {
    for arguments in [
        vec!["reconstruct"],
        vec!["watch"],
        vec!["serve", "--source", "camera"],
        vec!["reconstruct", "x", "--frames", "9..3"],
    ] {
        assert_eq!(run(&arguments).status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn help_names_every_command_and_its_purpose() {
    let output = run(&["--help"]);
    let help = String::from_utf8(output.stdout).unwrap();
    for word in [
        "demo",
        "serve",
        "reconstruct",
        "evaluate",
        "record",
        "simulate",
        "import",
        "bench",
        "check-config",
        "Exit status",
    ] {
        assert!(help.contains(word), "{word}: {help}");
    }
}
