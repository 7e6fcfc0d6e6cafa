//! When a start is refused, what each token allows, and that no token is ever shown.

use super::client::{CONTROL, Guarded, READ, bearer, write_with_mode};
use crate::common::{doorcam, grey_recording, manifest, stderr};

/// The routes that read.
const READS: [&str; 18] = [
    "/metrics",
    "/api/v1/status",
    "/api/v1/geometry",
    "/api/v1/reconstruction",
    "/api/v1/reconstruction.png",
    "/api/v1/difference.png",
    "/api/v1/patches.png",
    "/api/v1/signal",
    "/api/v1/recording",
    "/api/v1/tracks",
    "/api/v1/tracks/1",
    "/api/v1/events",
    "/api/v1/crossings",
    "/api/v1/zones",
    "/api/v1/uncertainty",
    "/api/v1/calibration",
    "/api/v1/calibration/reference.jpg",
    "/api/v1/frame.jpg",
];

/// The routes that change something.
const CHANGES: [(&str, &str); 9] = [
    ("PUT", "/api/v1/calibration"),
    ("POST", "/api/v1/calibration/check"),
    ("POST", "/api/v1/calibration/previous"),
    ("POST", "/api/v1/background/reset"),
    ("PUT", "/api/v1/crossings"),
    ("PUT", "/api/v1/zones"),
    ("DELETE", "/api/v1/zones"),
    ("POST", "/api/v1/recording"),
    ("DELETE", "/api/v1/recording"),
];

/// Runs doorcam, which must refuse to start with a single line, and returns the line.
fn refusal(arguments: &[&str], environment: &[(&str, &str)]) -> String {
    let directory = grey_recording(&manifest(), 3);
    let source = format!("replay:{}", directory.path().display());
    let mut command = doorcam(&["serve", "--source", &source]);
    command.args(arguments).envs(environment.iter().copied()).env("RUST_LOG", "error");
    let output = command.output().expect("starts");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
    assert_eq!(said.lines().count(), 1, "{arguments:?}: {said}");
    said.trim_end().to_owned()
}

#[test]
fn an_address_that_others_can_reach_is_refused_without_a_token() {
    let expected = "doorcam: 0.0.0.0:0 can be reached by others and there is no token, expected --token-file FILE, \
                    access.token_file or DOORCAM_TOKEN (or --allow-unauthenticated, with which everybody who reaches \
                    it sees and changes everything)";
    assert_eq!(refusal(&["--listen", "0.0.0.0:0"], &[]), expected);
    let demo = doorcam(&["demo", "--listen", "[::]:0"]).output().unwrap();
    assert!(demo.status.code() == Some(1) && stderr(&demo).contains("there is no token"), "{}", stderr(&demo));

    let doorcam = Guarded::start_with("0.0.0.0:0", "", &[("DOORCAM_READ_TOKEN", READ)], &[]);
    assert_eq!(doorcam.ask("GET", "/api/v1/status", &[]).status, 401);
    assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Authorization", &bearer(READ))]).status, 200);

    let doorcam = Guarded::start_with("0.0.0.0:0", "", &[], &["--allow-unauthenticated"]);
    assert_eq!(doorcam.ask("GET", "/api/v1/status", &[]).status, 200);
    doorcam.daemon.wait_for_log("WARN 0.0.0.0:0 needs no token");
}

#[test]
fn a_token_that_others_can_read_or_guess_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("token");
    let path = file.to_str().unwrap();
    let missing = format!("doorcam: access.token_file: {path}: cannot read it: no such file or directory");
    assert_eq!(refusal(&["--token-file", path], &[]), missing);
    for mode in [0o644, 0o604, 0o660, 0o602] {
        write_with_mode(&file, CONTROL, mode);
        let open = format!(
            "doorcam: access.token_file: {path}: its mode {mode:o} lets others at the secret, expected 600 or 640 \
             (chmod 600 {path})"
        );
        assert_eq!(refusal(&["--token-file", path], &[]), open);
    }
    write_with_mode(&file, "secret\n", 0o600);
    let short =
        format!("doorcam: {path} has 6 characters, expected a token of 20 to 256, as from openssl rand -hex 24");
    assert_eq!(refusal(&["--token-file", path], &[]), short);
    write_with_mode(&file, CONTROL, 0o640);
    let two = "doorcam: DOORCAM_TOKEN and access.token_file (or its option) are both given, expected one of them";
    assert_eq!(refusal(&["--token-file", path], &[("DOORCAM_TOKEN", CONTROL)]), two);
    let same = "doorcam: the token and the read token are the same, expected two different ones";
    assert_eq!(refusal(&["--token-file", path], &[("DOORCAM_READ_TOKEN", CONTROL)]), same);
}

#[test]
fn without_a_token_only_the_page_and_the_probes_are_seen() {
    let doorcam = Guarded::with_tokens(&[]);
    for path in ["/", "/app.js", "/style.css", "/livez"] {
        assert_eq!(doorcam.ask("GET", path, &[]).status, 200, "{path}");
    }
    assert_ne!(doorcam.ask("GET", "/readyz", &[]).status, 401);
    let elsewhere = [("GET", "/api/v1/nothing"), ("GET", "/nothing"), ("DELETE", "/api/v1/status")];
    let all = READS.into_iter().map(|path| ("GET", path)).chain(CHANGES).chain(elsewhere);
    for (method, path) in all.clone() {
        let answer = doorcam.ask(method, path, &[]);
        assert_eq!(answer.status, 401, "{method} {path}");
        assert_eq!(answer.header("www-authenticate"), Some("Bearer realm=\"doorcam\""), "{method} {path}");
        answer.problem();
    }
    for (method, path) in all.take(3) {
        let answer = doorcam.ask(method, path, &[("Authorization", &bearer("wrong-0123456789abcdef01"))]);
        assert_eq!(answer.status, 401, "{method} {path}");
        assert!(answer.header("www-authenticate").unwrap().contains("invalid_token"), "{answer:?}");
    }
    assert_eq!(doorcam.upgrade(&[]), 401);
}

#[test]
fn the_read_token_sees_and_the_control_token_changes() {
    let doorcam = Guarded::with_tokens(&[]);
    let read = bearer(READ);
    let control = bearer(CONTROL);
    for path in READS {
        for token in [&read, &control] {
            let status = doorcam.ask("GET", path, &[("Authorization", token)]).status;
            assert!(status == 200 || status == 404, "{path}: {status}");
        }
    }
    assert_eq!(doorcam.upgrade(&[("Authorization", &read)]), 101);
    for (method, path) in CHANGES {
        let answer = doorcam.ask(method, path, &[("Authorization", &read)]);
        assert_eq!(answer.status, 403, "{method} {path}");
        assert!(answer.header("www-authenticate").unwrap().contains("insufficient_scope"), "{answer:?}");
        answer.problem();
        let status = doorcam.ask(method, path, &[("Authorization", &control)]).status;
        assert!(status != 401 && status != 403, "{method} {path}: {status}");
    }
    assert_eq!(doorcam.ask("POST", "/api/v1/background/reset", &[("Authorization", &control)]).status, 202);
}

#[test]
fn a_token_file_is_as_good_as_a_variable() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("token");
    write_with_mode(&file, &format!("{CONTROL}\n"), 0o600);
    let doorcam = Guarded::configured(&format!("[access]\ntoken_file = \"{}\"\n", file.display()), &[]);
    assert_eq!(doorcam.ask("POST", "/api/v1/background/reset", &[]).status, 401);
    assert_eq!(doorcam.ask("POST", "/api/v1/background/reset", &[("Authorization", &bearer(CONTROL))]).status, 202);
}

#[test]
fn no_token_is_ever_told() {
    let wrong = "wrong-0123456789abcdef01";
    let environment = [("DOORCAM_TOKEN", CONTROL), ("DOORCAM_READ_TOKEN", READ), ("RUST_LOG", "trace")];
    let doorcam = Guarded::start_with("127.0.0.1:0", "", &environment, &[]);
    let mut told = String::new();
    // The wrong token comes last, because after enough wrong ones this address gets no more answers.
    for token in [READ, CONTROL, wrong] {
        let asked = READS.into_iter().chain(["/api/v1/config", "/api/v1/openapi.json"]).map(|path| ("GET", path));
        for (method, path) in asked.chain([("POST", "/api/v1/background/reset")]) {
            let answer = doorcam.ask(method, path, &[("Authorization", &bearer(token))]);
            assert_eq!(answer.status == 401 || answer.status == 429, token == wrong, "{method} {path}: {answer:?}");
            told.push_str(&format!("{answer:?}"));
        }
    }
    for said in ["as asked", "wrong tokens"] {
        doorcam.daemon.wait_for_log(said);
    }
    told.push_str(&doorcam.daemon.log());
    for token in [wrong, READ, CONTROL] {
        assert!(!told.contains(token), "{token} is shown");
    }
}
