//! Messages to a real broker. Without Debian's mosquitto and mosquitto-clients, these tests are skipped and say so.

mod ends;

use crate::common;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use crate::common::{Daemon, grey_recording, manifest};
use serde_json::Value;

const LONG: Duration = Duration::from_secs(60);
const SOURCE: &str = "simulate:tests/rooms/busy.toml,rate=max";
const ZONES: &str = "[[zones]]\nname = \"Near, left\"\npolygon_m = [[-1.5, 0.2], [0, 0.2], [0, 3], [-1.5, 3]]\n";

/// A child process that is killed at the end of the test.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn installed() -> bool {
    let found = ["mosquitto", "mosquitto_sub", "mosquitto_passwd"].into_iter().all(|program| {
        let paths = std::env::var_os("PATH").unwrap_or_default();
        std::env::split_paths(&paths).chain([PathBuf::from("/usr/sbin")]).any(|path| path.join(program).exists())
    });
    if !found {
        eprintln!("skipped: no mosquitto here (Debian: mosquitto, mosquitto-clients)");
    }
    found
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Starts a broker that keeps nothing when it ends.
fn broker(directory: &Path, port: u16, more: &str) -> Process {
    let file = directory.join("mosquitto.conf");
    // Started as root, mosquitto would switch to another user, who cannot read the test's files.
    let root = Command::new("id").arg("-u").output().is_ok_and(|id| id.stdout == b"0\n");
    let user = if root { "user root\n" } else { "" };
    std::fs::write(&file, format!("listener {port} 127.0.0.1\npersistence false\n{user}{more}")).unwrap();
    let program = if Path::new("/usr/sbin/mosquitto").exists() { "/usr/sbin/mosquitto" } else { "mosquitto" };
    let child = Command::new(program).arg("-c").arg(&file).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    let begin = Instant::now();
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(begin.elapsed() < LONG, "mosquitto does not listen");
        std::thread::sleep(Duration::from_millis(20));
    }
    Process(child)
}

/// A client that subscribes to all topics.
struct Subscriber {
    _process: Process,
    lines: Receiver<(bool, String, String)>,
}

impl Subscriber {
    fn new(port: u16, more: &[&str]) -> Self {
        let mut child = Command::new("mosquitto_sub")
            .args(["-h", "127.0.0.1", "-p", &port.to_string(), "-t", "#", "-F", "%r %t %p"])
            .args(more)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let (tell, lines) = channel();
        std::thread::spawn(move || {
            for line in stdout.lines().map_while(Result::ok) {
                let mut parts = line.splitn(3, ' ').map(String::from);
                let (Some(retained), Some(topic), Some(payload)) = (parts.next(), parts.next(), parts.next()) else {
                    continue;
                };
                if tell.send((retained == "1", topic, payload)).is_err() {
                    return;
                }
            }
        });
        Self { _process: Process(child), lines }
    }

    /// Waits for the first message that is `wanted`.
    fn wait_for(&self, what: &str, wanted: impl Fn(&str, &str) -> bool) -> (bool, String, String) {
        let deadline = Instant::now() + LONG;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let message = self.lines.recv_timeout(left).unwrap_or_else(|e| panic!("waited in vain for {what}: {e}"));
            if wanted(&message.1, &message.2) {
                return message;
            }
        }
    }
}

/// Writes a file that only its owner can read.
fn write_secret(file: &Path, text: &str) {
    std::fs::write(file, text).unwrap();
    std::fs::set_permissions(file, std::fs::Permissions::from_mode(0o600)).unwrap();
}

/// Publishes a message, retained if so wanted.
fn publish(port: u16, topic: &str, payload: &str, retain: bool) {
    let mut command = Command::new("mosquitto_pub");
    command.args(["-h", "127.0.0.1", "-p", &port.to_string(), "-t", topic, "-m", payload]);
    assert!(command.args(retain.then_some("-r")).status().unwrap().success());
}

/// The broker's retained messages, by topic.
fn retained(port: u16) -> BTreeMap<String, String> {
    // The subscriber ends after three seconds.
    let subscriber = Subscriber::new(port, &["--retained-only", "-W", "3"]);
    subscriber.lines.iter().map(|(_, topic, payload)| (topic, payload)).collect()
}

fn config(directory: &Path, port: u16, more: &str) -> String {
    let file = directory.join("doorcam.toml");
    let text = format!(
        "[site]\nid = \"hall\"\nname = \"The hall\"\n[mqtt]\nhost = \"127.0.0.1\"\nport = {port}\n{more}\n{ZONES}"
    );
    std::fs::write(&file, text).unwrap();
    file.to_str().unwrap().into()
}

#[test]
fn a_broker_knows_who_is_there_and_that_doorcam_died() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let _broker = broker(directory.path(), port, "allow_anonymous true\n");
    let subscriber = Subscriber::new(port, &[]);
    let mut daemon = Daemon::start(SOURCE, &["--config", &config(directory.path(), port, "")]);
    subscriber.wait_for("availability", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "online"));
    subscriber.wait_for("a map", |topic, payload| (topic, payload) == ("doorcam/hall/state", "watching"));
    subscriber.wait_for("people", |topic, payload| (topic, payload) == ("doorcam/hall/occupancy", "ON"));
    let number = |payload: &str| payload.parse::<usize>().is_ok_and(|people| people > 0);
    subscriber.wait_for("a count", |topic, payload| topic == "doorcam/hall/people" && number(payload));
    let zone = "doorcam/hall/zones/near__left";
    subscriber
        .wait_for("somebody in the zone", |topic, payload| topic == format!("{zone}/occupancy") && payload == "ON");
    let (is_kept, _, tracks) = subscriber
        .wait_for("tracks", |topic, payload| topic == "doorcam/hall/tracks" && !payload.contains("\"tracks\":[]"));
    let tracks: Value = serde_json::from_str(&tracks).unwrap();
    assert!(!is_kept && tracks["tracks"][0]["x_m"].is_number() && tracks["time"].is_string(), "{tracks}");
    let (is_kept, _, event) = subscriber.wait_for("an event", |topic, _| topic == "doorcam/hall/events");
    let event: Value = serde_json::from_str(&event).unwrap();
    let after = event["sequence"].as_i64().unwrap() - 1;
    let query = if after < 0 { "limit=1000".into() } else { format!("after={after}&limit=1") };
    let known = daemon.json(&format!("/api/v1/events?{query}"))["events"][0].clone();
    let alike = |key: &str| assert_eq!(event[key], known[key], "{event} {known}");
    assert!(!is_kept);
    ["sequence", "kind", "track", "zone", "time"].into_iter().for_each(alike);
    let status = daemon.json("/api/v1/status");
    assert_eq!(
        (&status["publish"]["mqtt"]["state"], &status["publish"]["mqtt"]["missed"]),
        (&"connected".into(), &0.into())
    );

    // Later subscribers find the values, and Home Assistant its entities.
    let kept = retained(port);
    assert_eq!(kept["doorcam/hall/availability"], "online");
    assert_eq!(kept["doorcam/hall/known"], "online");
    assert!(!kept.contains_key("doorcam/hall/tracks") && !kept.contains_key("doorcam/hall/events"));
    let entities: Vec<(&String, Value)> = kept
        .iter()
        .filter(|(topic, _)| topic.starts_with("homeassistant/"))
        .map(|(topic, payload)| (topic, serde_json::from_str(payload).unwrap()))
        .collect();
    assert_eq!(entities.len(), 12, "{kept:?}");
    let ids: BTreeSet<&str> = entities.iter().filter_map(|(_, entity)| entity["unique_id"].as_str()).collect();
    assert_eq!(ids.len(), 12, "{ids:?}");
    for (topic, entity) in &entities {
        let component = topic.strip_prefix("homeassistant/").and_then(|rest| rest.split_once("/hall/")).unwrap();
        assert!(topic.ends_with("/config"), "{topic}");
        let state = entity["state_topic"].as_str().unwrap();
        match component.0 {
            "binary_sensor" => {
                let value = Value::from(kept[state].as_str());
                assert_eq!(entity["device_class"], "occupancy");
                assert!([&entity["payload_on"], &entity["payload_off"]].contains(&&value), "{value}");
            }
            "sensor" if entity["device_class"] == "enum" => {
                let options = entity["options"].as_array().unwrap();
                assert!(options.contains(&Value::from(kept[state].as_str())), "{topic}");
            }
            "sensor" => {
                let class = entity["state_class"].as_str().unwrap();
                assert!(kept[state].parse::<usize>().is_ok(), "{topic}");
                assert!(["measurement", "total_increasing"].contains(&class), "{class}");
            }
            "event" => {
                assert!(!kept.contains_key(state), "{topic}: an event is of its moment only");
                assert!(entity["event_types"][0].is_string());
            }
            other => panic!("{other}: {topic}"),
        }
        for availability in entity["availability"].as_array().unwrap() {
            assert!(kept.contains_key(availability["topic"].as_str().unwrap()), "{availability}");
        }
        assert_eq!(entity["device"]["name"], "The hall");
        assert!(entity["device"]["identifiers"][0].is_string() && entity["origin"]["name"] == "doorcam");
    }

    // SIGKILL cannot be caught, so the broker publishes the last will.
    assert!(Command::new("kill").args(["-KILL", &daemon.id().to_string()]).status().unwrap().success());
    subscriber.wait_for("the last will", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "offline"));
    daemon = Daemon::start(SOURCE, &["--config", &config(directory.path(), port, "")]);
    subscriber.wait_for("its return", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "online"));
    // A proper end is announced too.
    assert_eq!(daemon.terminate().1, Some(0));
    subscriber.wait_for("the end", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "offline"));
}

#[test]
fn how_many_are_inside_is_told_as_it_is_set_right() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let _broker = broker(directory.path(), port, "allow_anonymous true\n");
    // What an earlier run announced goes, now that crossings are turned off.
    let device = "\"device\": {\"identifiers\": [\"doorcam_hall\"]}, \"origin\": {\"name\": \"doorcam\"}";
    let left = "homeassistant/event/hall/cross_in/config";
    publish(port, left, &format!("{{{device}}}"), true);
    let subscriber = Subscriber::new(port, &["-R"]);
    let off = config(directory.path(), port, "[crossings]\nenabled = false");
    let daemon = Daemon::start(SOURCE, &["--config", &off]);
    subscriber.wait_for("nobody", |topic, payload| (topic, payload) == ("doorcam/hall/inside", "0"));
    assert_eq!(daemon.send("PUT", "/api/v1/crossings", &serde_json::json!({"inside": 3})).0, 200);
    let all = |topic: &str, payload: &str| topic == "doorcam/hall/crossings" && payload.contains("\"inside\":3");
    let (_, _, told) = subscriber.wait_for("all of it, before what is of before", all);
    subscriber.wait_for("the estimate", |topic, payload| (topic, payload) == ("doorcam/hall/inside", "3"));
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!(told, daemon.json("/api/v1/crossings"));
    assert_eq!((&told["available"], &told["inside"]), (&false.into(), &3.into()), "{told}");
    subscriber.wait_for("what is left to go", |topic, payload| topic == left && payload.is_empty());
    let kept = retained(port);
    assert!(!kept.keys().any(|topic| topic.starts_with("homeassistant/event/")), "{kept:?}");
    assert_eq!((kept["doorcam/hall/crossings/in"].as_str(), kept["doorcam/hall/inside"].as_str()), ("0", "3"));
}

#[test]
fn zones_that_are_drawn_take_the_place_of_those_before() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let _broker = broker(directory.path(), port, "allow_anonymous true\n");
    let subscriber = Subscriber::new(port, &[]);
    let daemon = Daemon::start(SOURCE, &["--config", &config(directory.path(), port, "")]);
    subscriber.wait_for("the zone", |topic, _| topic == "doorcam/hall/zones/near__left/people");
    let drawn = serde_json::json!({"zones": [{"name": "Desk", "polygon_m": [[-1, 1], [1, 1], [1, 2]]}]});
    assert_eq!(daemon.send("PUT", "/api/v1/zones", &drawn).0, 200);
    subscriber.wait_for("the other", |topic, _| topic == "doorcam/hall/zones/desk/people");
    let kept = retained(port);
    let of = |zone: &str| kept.keys().filter(|topic| topic.contains(zone)).count();
    assert_eq!((of("near__left"), of("desk")), (0, 4), "occupancy and people, and their discovery messages: {kept:?}");
}

#[test]
fn a_broker_that_forgot_everything_is_told_again() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    // There is no broker yet, and frames do not wait for one.
    let daemon = Daemon::start(SOURCE, &["--config", &config(directory.path(), port, "home_assistant = \"\"")]);
    let away = |status: &Value| {
        let mqtt = &status["publish"]["mqtt"];
        mqtt["state"] == "connecting" && mqtt["error"].is_string() && status["frames"]["solved"].as_u64() > Some(3)
    };
    daemon.wait_for("frames without a broker", away);
    for _ in 0..2 {
        let broker = broker(directory.path(), port, "allow_anonymous true\n");
        daemon.wait_for("a connection", |status| status["publish"]["mqtt"]["state"] == "connected");
        let subscriber = Subscriber::new(port, &[]);
        subscriber
            .wait_for("availability", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "online"));
        subscriber.wait_for("a count", |topic, _| topic == "doorcam/hall/people");
        drop(broker);
        daemon.wait_for("the loss to be noticed", away);
    }
}

#[test]
fn a_password_opens_the_broker_and_is_not_told() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let passwords = directory.path().join("passwords");
    let made =
        Command::new("mosquitto_passwd").args(["-b", "-c"]).arg(&passwords).args(["door", "s3cret-word"]).status();
    assert!(made.unwrap().success());
    let more = format!("allow_anonymous false\npassword_file {}\n", passwords.display());
    let _broker = broker(directory.path(), port, &more);
    let file = directory.path().join("password");
    let keys = format!("username = \"door\"\npassword_file = {file:?}\n");
    write_secret(&file, "another\n");
    let daemon = Daemon::start(SOURCE, &["--config", &config(directory.path(), port, &keys)]);
    let refused = daemon.wait_for("a refusal", |status| status["publish"]["mqtt"]["error"].is_string());
    assert!(refused["publish"]["mqtt"]["error"].as_str().unwrap().contains("refused"), "{refused}");
    drop(daemon);
    write_secret(&file, "s3cret-word\n");
    let daemon = Daemon::start(SOURCE, &["--config", &config(directory.path(), port, &keys)]);
    let status = daemon.wait_for("a connection", |status| status["publish"]["mqtt"]["state"] == "connected");
    assert!(!status.to_string().contains("s3cret"), "{status}");
    drop(daemon);
    for (mode, is_refused) in [(0o666, true), (0o644, true), (0o620, true), (0o640, false), (0o400, false)] {
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(mode)).unwrap();
        let config = config(directory.path(), port, &format!("{keys}ca_file = \"/none\"\ntls = true\n"));
        let output = common::run(&["serve", "--source", SOURCE, "--config", &config, "--listen", "127.0.0.1:0"]);
        let said = common::stderr(&output);
        let expected = format!("mqtt.password_file: {}: its mode {mode:o} lets others at the secret", file.display());
        // Where the mode is right, the next thing is wrong.
        assert!(said.contains(if is_refused { &expected } else { "mqtt.ca_file: /none: no such file" }), "{said}");
    }
    std::fs::remove_file(&file).unwrap();
    let output = common::run(&["serve", "--source", SOURCE, "--config", &config(directory.path(), port, &keys)]);
    let said = common::stderr(&output);
    let expected = format!("doorcam: mqtt.password_file: {}: cannot read it: no such file", file.display());
    assert!(output.status.code() == Some(1) && said.contains(&expected), "{said}");
}

/// A configuration with zones of these names.
fn zoned(directory: &Path, port: u16, names: &[&str]) -> String {
    let file = directory.join("doorcam.toml");
    let zone = |name: &&str| format!("[[zones]]\nname = \"{name}\"\npolygon_m = [[-1, 1], [1, 1], [1, 2]]\n");
    let zones = names.iter().map(zone).collect::<String>();
    let text = format!("[site]\nid = \"hall\"\n[mqtt]\nhost = \"127.0.0.1\"\nport = {port}\n{zones}");
    std::fs::write(&file, text).unwrap();
    file.to_str().unwrap().into()
}

#[test]
fn the_end_of_a_source_is_told_without_a_frame() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let _broker = broker(directory.path(), port, "allow_anonymous true\n");
    let subscriber = Subscriber::new(port, &[]);
    let recording = grey_recording(&manifest(), 30);
    let source = format!("replay:{}", recording.path().display());
    let daemon = Daemon::start(&source, &["--config", &config(directory.path(), port, "")]);
    subscriber.wait_for("a map", |topic, payload| (topic, payload) == ("doorcam/hall/state", "watching"));
    subscriber.wait_for("the end", |topic, payload| (topic, payload) == ("doorcam/hall/state", "stale"));
    let (_, _, told) = subscriber.wait_for("the reason", |topic, _| topic == "doorcam/hall/watching");
    subscriber.wait_for("unknown", |topic, payload| (topic, payload) == ("doorcam/hall/known", "offline"));
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!((&told["watching"], &told["reason"]), (&false.into(), &"ended".into()));
    assert_eq!(told, daemon.json("/api/v1/status")["watching"], "the same as everywhere");
}

#[test]
fn zones_keep_their_entities_and_those_that_went_while_doorcam_was_off_go() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let _broker = broker(directory.path(), port, "allow_anonymous true\n");
    publish(port, "homeassistant/sensor/hall/lamp/config", "{\"name\": \"a lamp\"}", true);
    publish(port, "doorcam/attic/zones/bed/people", "1", true);
    let start = |names: &[&str]| {
        let subscriber = Subscriber::new(port, &["-R"]);
        let daemon = Daemon::start(SOURCE, &["--config", &zoned(directory.path(), port, names)]);
        subscriber.wait_for("its values", |topic, _| topic == "doorcam/hall/people");
        daemon
    };
    let topics_of = |daemon: &Daemon, name: &str| {
        let zones = daemon.json("/api/v1/zones");
        let zone = zones["zones"].as_array().unwrap().iter().find(|zone| zone["name"] == name).unwrap();
        let id = zone["id"].as_str().unwrap();
        [
            format!("doorcam/hall/zones/{id}/occupancy"),
            format!("doorcam/hall/zones/{id}/people"),
            format!("homeassistant/binary_sensor/hall/occupancy_{id}/config"),
            format!("homeassistant/sensor/hall/people_{id}/config"),
        ]
    };
    let mut daemon = start(&["Спальня", "Кабинет"]);
    let [bedroom, study] = ["Спальня", "Кабинет"].map(|name| topics_of(&daemon, name));
    let deadline = Instant::now() + LONG;
    while !bedroom.iter().chain(&study).all(|topic| retained(port).contains_key(topic)) {
        assert!(Instant::now() < deadline, "{:?}", retained(port));
    }
    assert_eq!(daemon.terminate().1, Some(0));
    let subscriber = Subscriber::new(port, &[]);
    let daemon = start(&["Кабинет"]);
    assert_eq!(topics_of(&daemon, "Кабинет"), study, "it has not become the other one");
    let mut gone: Vec<&String> = bedroom.iter().collect();
    while !gone.is_empty() {
        let (_, topic, _) =
            subscriber.wait_for("what is left to go", |topic, payload| payload.is_empty() && topic.contains("zone-"));
        assert!(!study.contains(&topic), "{topic}");
        gone.retain(|left| **left != topic);
    }
    let kept = retained(port);
    assert!(study.iter().all(|topic| kept.contains_key(topic)), "{kept:?}");
    assert!(!bedroom.iter().any(|topic| kept.contains_key(topic)), "{kept:?}");
    // What is not doorcam's, or another doorway's, stays.
    assert!(kept.contains_key("homeassistant/sensor/hall/lamp/config"));
    assert!(kept.contains_key("doorcam/attic/zones/bed/people"));
}

#[test]
fn home_assistant_is_told_everything_when_it_starts() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let _broker = broker(directory.path(), port, "allow_anonymous true\n");
    let subscriber = Subscriber::new(port, &[]);
    let _daemon = Daemon::start(SOURCE, &["--config", &config(directory.path(), port, "")]);
    let announced = |topic: &str| topic == "homeassistant/sensor/hall/people_near__left/config";
    subscriber.wait_for("discovery", |topic, _| announced(topic));
    subscriber.wait_for("availability", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "online"));
    publish(port, "homeassistant/status", "online", false);
    subscriber.wait_for("the birth", |topic, _| topic == "homeassistant/status");
    subscriber.wait_for("discovery again", |topic, _| announced(topic));
    subscriber.wait_for("its values again", |topic, _| topic == "doorcam/hall/zones/near__left/people");
    // Who says that doorcam is offline while it is not is corrected.
    publish(port, "doorcam/hall/availability", "offline", true);
    subscriber.wait_for("the lie", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "offline"));
    subscriber.wait_for("the truth", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "online"));
}

#[test]
fn two_doorcams_of_one_id_do_not_fight_and_say_that_there_are_two() {
    if !installed() {
        return;
    }
    let (directory, port) = (tempfile::tempdir().unwrap(), free_port());
    let _broker = broker(directory.path(), port, "allow_anonymous true\n");
    let config = config(directory.path(), port, "");
    let start = |storage: &str| {
        let storage = directory.path().join(storage);
        Daemon::start(SOURCE, &["--config", &config, "--storage", storage.to_str().unwrap()])
    };
    let (one, mut other) = (start("one"), start("other"));
    let mqtt = |daemon: &Daemon| daemon.json("/api/v1/status")["publish"]["mqtt"].clone();
    let warned = |status: &Value| status["publish"]["mqtt"]["warning"].as_str().is_some_and(|w| w.contains("site.id"));
    for daemon in [&one, &other] {
        daemon.wait_for("the warning", warned);
        daemon.wait_for_log("publishes under doorcam/hall, too");
        assert!(!daemon.log().contains("trying again"), "{}", daemon.log());
        assert_eq!(daemon.log().matches("publishes under doorcam/hall, too").count(), 1, "{}", daemon.log());
        assert_eq!(mqtt(daemon)["state"], "connected");
    }
    assert_ne!(mqtt(&one)["client_id"], mqtt(&other)["client_id"]);
    let id = mqtt(&one)["client_id"].clone();
    // One leaves, and the one that stays is not taken for away.
    let subscriber = Subscriber::new(port, &["-R"]);
    // It hears nothing of what was said before it had subscribed.
    subscriber.wait_for("anything", |_, _| true);
    assert_eq!(other.terminate().1, Some(0));
    subscriber.wait_for("the end", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "offline"));
    subscriber.wait_for("the other", |topic, payload| (topic, payload) == ("doorcam/hall/availability", "online"));
    drop(one);
    assert_eq!(mqtt(&start("one"))["client_id"], id, "the same after a restart");
}
