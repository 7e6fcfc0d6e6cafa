//! SIGHUP: keys that can change while doorcam runs are applied, and the others are named.

use std::path::Path;
use std::time::Duration;

use crate::common::{Daemon, camera_recording, doorcam, grey_recording, manifest};
use serde_json::{Value, json};

const TOKENS: [&str; 2] = ["the-first-token-of-the-test", "another-token-of-the-test"];

fn hang_up(daemon: &Daemon) {
    daemon.signal("HUP");
}

/// Sends SIGHUP and waits until a new line in the log contains `says`.
fn reload(daemon: &Daemon, says: &str) {
    let before = daemon.log().len();
    hang_up(daemon);
    daemon.wait_for(says, |_| daemon.log()[before..].contains(says));
}

fn write(file: &Path, text: &str) {
    std::fs::write(file, text).expect("writes");
}

fn zone(name: &str) -> String {
    format!("[[zones]]\nname = \"{name}\"\npolygon_m = [[-1, 1], [1, 1], [1, 2]]\n")
}

fn names(daemon: &Daemon) -> Vec<Value> {
    let zones = daemon.json("/api/v1/zones")["zones"].clone();
    zones.as_array().expect("zones").iter().map(|zone| zone["name"].clone()).collect()
}

#[test]
fn zones_change_a_broken_file_changes_nothing_and_what_takes_a_restart_is_named() {
    let dir = grey_recording(&manifest(), 4);
    let file = dir.path().join("doorcam.toml");
    write(&file, &zone("bed"));
    let source = format!("replay:{},loop", dir.path().display());
    let daemon = Daemon::start(&source, &["--config", file.to_str().unwrap()]);
    daemon.wait_for("a map", |s| s["state"] == "watching");
    assert_eq!(names(&daemon), ["bed"]);

    write(&file, &zone("sofa"));
    reload(&daemon, "reloaded, in use now: zones");
    assert_eq!(names(&daemon), ["sofa"]);
    assert_eq!(daemon.json("/api/v1/config")["zones"][0]["name"], "sofa");
    daemon.wait_for("updates with them", |_| daemon.json("/api/v1/reconstruction")["zones"][0]["name"] == "sofa");

    write(&file, "[room]\ndepth_m = -1\n");
    reload(&daemon, "doorcam.toml: room.depth_m is -1, expected 0.1 to 100 metres: the configuration in use stays");
    assert_eq!(names(&daemon), ["sofa"]);
    assert!(metric(&daemon).ends_with(" 0"), "{}", metric(&daemon));

    // The recording has no calibration that could be changed, so its room cannot be changed either.
    write(&file, &format!("[server]\nmax_connections = 9\n[room]\ndepth_m = 2.5\n{}", zone("sofa")));
    reload(&daemon, "not reloaded, in use after a restart: server.max_connections");
    daemon.wait_for_log("not reloaded: room.depth_m: a recording of rectified patches needs no calibration");
    let used = daemon.json("/api/v1/config");
    assert_eq!((&used["server"]["max_connections"], &used["room"]["depth_m"]), (&json!(512), &json!(3.0)));

    write(&file, &zone("sofa"));
    reload(&daemon, "reloaded: the configuration is the same");
    assert!(metric(&daemon).ends_with(" 1"), "{}", metric(&daemon));

    // Zones that were drawn stay in use.
    let drawn = json!({"zones": [{"name": "desk", "polygon_m": [[-1, 1], [1, 1], [1, 2]]}]});
    assert_eq!(daemon.send("PUT", "/api/v1/zones", &drawn).0, 200);
    write(&file, &zone("bed"));
    reload(&daemon, "reloaded, in use now: zones");
    assert_eq!(names(&daemon), ["desk"]);
    assert_eq!(ureq::delete(format!("{}/api/v1/zones", daemon.url)).call().expect("an answer").status(), 200);
    assert_eq!(names(&daemon), ["bed"]);
}

fn metric(daemon: &Daemon) -> String {
    let text = String::from_utf8(daemon.get("/metrics").1).expect("UTF-8");
    text.lines().find(|line| line.starts_with("doorcam_config_last_reload_successful ")).unwrap_or_default().into()
}

#[test]
fn another_room_is_mapped_with_the_same_calibration() {
    let dir = camera_recording(6);
    let (file, calibration) = (dir.path().join("doorcam.toml"), dir.path().join("calibration.json"));
    write(&file, "");
    let source = format!("replay:{},loop", dir.path().display());
    let more = ["--config", file.to_str().unwrap(), "--calibration", calibration.to_str().unwrap()];
    let daemon = Daemon::start(&source, &more);
    daemon.wait_for("a map", |s| s["state"] == "watching");
    let before = daemon.json("/api/v1/geometry");

    write(&file, "[room]\ndepth_m = 2.0\n[solver]\nlambda = 0.01\n");
    reload(&daemon, "in use now, and the empty room is learned anew: ");
    let update = daemon.wait_for_update("a map of the other room", |update| {
        update["state"] == "watching" && update["calibration"] == 1
    });
    assert_eq!(update["solution"]["lambda"], 0.01);
    let after = daemon.json("/api/v1/geometry");
    assert_eq!((&after["room"]["depth_m"], &after["calibration"]), (&json!(2.0), &json!(1)));
    assert!(after["facets"].as_array().unwrap().len() < before["facets"].as_array().unwrap().len());
    assert_eq!(daemon.json("/api/v1/config")["room"]["depth_m"], 2.0);

    // A grid that does not fit this doorway leaves the map as it is.
    write(&file, "[room]\nhalf_width_m = 0.1\n");
    reload(&daemon, "not reloaded: ");
    assert_eq!(daemon.json("/api/v1/geometry"), after);
}

/// The status code for a request with a token or a session in a header.
fn asked_with(daemon: &Daemon, header: &str, value: &str) -> u16 {
    let config =
        ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(Duration::from_secs(20)));
    let agent: ureq::Agent = config.build().into();
    let request = agent.get(format!("{}/api/v1/status", daemon.url)).header(header, value);
    request.call().expect("an answer").status().as_u16()
}

#[test]
fn another_token_takes_the_place_of_the_one_before_and_ends_its_sessions() {
    let dir = grey_recording(&manifest(), 4);
    let token = dir.path().join("token");
    let private = |text: &str| {
        use std::os::unix::fs::PermissionsExt;
        write(&token, text);
        std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).expect("is its owner's");
    };
    private(TOKENS[0]);
    let source = format!("replay:{},loop", dir.path().display());
    let daemon = Daemon::spawn(doorcam(&[
        "serve",
        "--source",
        &source,
        "--listen",
        "127.0.0.1:0",
        "--token-file",
        token.to_str().unwrap(),
    ]));
    let bearer = |token: &str| asked_with(&daemon, "authorization", &format!("Bearer {token}"));
    assert_eq!((bearer(TOKENS[0]), bearer(TOKENS[1])), (200, 401));
    let agent: ureq::Agent = ureq::Agent::config_builder().build().into();
    let begun = agent.post(format!("{}/api/v1/session", daemon.url)).send(json!({"token": TOKENS[0]}).to_string());
    let cookie =
        begun.expect("a session").headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap().to_owned();
    assert_eq!(asked_with(&daemon, "cookie", &cookie), 200);

    let said = |what: &str| {
        let before = daemon.log().len();
        hang_up(&daemon);
        for _ in 0..200 {
            if daemon.log()[before..].contains(what) {
                return;
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("{what}: {}", daemon.log());
    };
    private("short");
    said("the tokens in use stay");
    assert_eq!(bearer(TOKENS[0]), 200);
    private(TOKENS[1]);
    said("other tokens are in use");
    assert_eq!((bearer(TOKENS[0]), bearer(TOKENS[1])), (401, 200));
    assert_eq!(asked_with(&daemon, "cookie", &cookie), 401);
}
