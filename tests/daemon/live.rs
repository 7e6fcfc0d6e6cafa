//! The live socket: its messages match the schema, and a slow client gets the newest update and a count of those that
//! it missed.

use std::net::TcpStream;
use std::time::Duration;

use crate::common::{Daemon, grey_recording, manifest};
use serde_json::{Value, json};
use tungstenite::WebSocket;

/// A recording of the empty room, then with a part of the floor brighter, so that there is a map.
fn recording() -> tempfile::TempDir {
    let dir = grey_recording(&manifest(), 9);
    for index in 6..9 {
        std::fs::remove_file(dir.path().join(format!("frames/{index:08}_left.jpg"))).unwrap();
        let image = image::RgbImage::from_fn(16, 16, |x, _| image::Rgb(if x < 8 { [120; 3] } else { [150, 120, 120] }));
        image.save(dir.path().join(format!("frames/{index:08}_left.png"))).unwrap();
    }
    dir
}

fn next(socket: &mut WebSocket<TcpStream>) -> Value {
    loop {
        if let tungstenite::Message::Text(text) = socket.read().expect("a message") {
            return serde_json::from_str(&text).expect("JSON");
        }
    }
}

/// The schema of messages, made stricter: it refuses keys that it does not describe.
fn closed_schema() -> Value {
    let mut schema: Value = serde_json::from_str(doorcam::server::live_schema_json()).unwrap();
    for (name, part) in schema["$defs"].as_object_mut().unwrap() {
        // A message is an update with one more key, so unknown keys can be found only in the whole message.
        if name == "LiveMessage" {
            part["unevaluatedProperties"] = json!(false);
        } else if name != "Update" && part["type"] == "object" {
            part["additionalProperties"] = json!(false);
        }
    }
    schema
}

#[test]
fn every_message_is_as_the_schema_says() {
    let dir = recording();
    let zones = dir.path().join("zones.toml");
    std::fs::write(&zones, "[[zones]]\nname = \"bed\"\npolygon_m = [[-1, 1], [1, 1], [1, 2]]\n").unwrap();
    let daemon =
        Daemon::start(&format!("replay:{},loop", dir.path().display()), &["--config", zones.to_str().unwrap()]);
    let schema = jsonschema::validator_for(&closed_schema()).expect("a schema");
    let mut socket = daemon.live();
    let (mut facets, mut states) = (0, std::collections::BTreeSet::new());
    for _ in 0..30 {
        let message = next(&mut socket);
        let wrong: Vec<String> = schema.iter_errors(&message).map(|e| format!("{}: {e}", e.instance_path())).collect();
        assert!(wrong.is_empty(), "{wrong:#?}\n{message}");
        facets += message["facets"].as_array().unwrap().len();
        states.insert(message["state"].to_string());
    }
    assert!(facets > 0 && states.len() > 1, "the run shows something: {facets} facets, {states:?}");
    // The schema refuses what it should.
    let mut wrong = next(&mut socket);
    wrong["tracks"] = json!([{"id": 1}]);
    assert!(!schema.is_valid(&wrong));
    wrong["tracks"] = json!([]);
    assert!(schema.is_valid(&wrong));
    wrong["surprise"] = json!(1);
    assert!(!schema.is_valid(&wrong));
}

#[test]
fn crossings_come_with_the_first_message_and_when_they_have_changed() {
    let dir = grey_recording(&manifest(), 9);
    let daemon = Daemon::start(&format!("replay:{},loop", dir.path().display()), &[]);
    let path = "/api/v1/crossings";
    let mut socket = daemon.live();
    let mut told = next(&mut socket)["crossings"].clone();
    assert!(told.is_object(), "{told}");
    for inside in [2, 5] {
        assert_eq!(daemon.send("PUT", path, &json!({"inside": inside})).0, 200);
        // Whether they are available also changes, as the map comes and goes.
        while told["inside"] != inside {
            if let Some(crossings) = next(&mut socket).get("crossings") {
                assert_ne!(*crossings, told, "only news");
                told.clone_from(crossings);
            }
        }
        let known = daemon.json(path);
        let of = |value: &Value| ["in", "out", "back", "inside", "since", "last"].map(|key| value[key].clone());
        assert_eq!(of(&told), of(&known), "the same as over REST");
    }
}

/// A client with a tiny receive buffer.
fn narrow(daemon: &Daemon) -> WebSocket<TcpStream> {
    let address: std::net::SocketAddr = daemon.url.trim_start_matches("http://").parse().unwrap();
    let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::STREAM, None).unwrap();
    socket.set_recv_buffer_size(4096).unwrap();
    socket.connect(&address.into()).unwrap();
    let stream = TcpStream::from(socket);
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    tungstenite::client(format!("ws://{address}/api/v1/live"), stream).expect("upgrades").0
}

#[test]
fn who_is_slow_gets_the_newest_and_the_count_of_what_was_missed() {
    let dir = recording();
    // At full rate: far more updates than a client could show.
    let daemon = Daemon::start(&format!("replay:{},loop,rate=max", dir.path().display()), &[]);
    let mut slow: Vec<_> = (0..4).map(|_| narrow(&daemon)).collect();
    std::thread::scope(|scope| {
        for socket in &mut slow {
            scope.spawn(move || read_slowly(socket));
        }
    });
}

/// Reads at most twenty messages per second until 800 in between were missed. (A client that reads nothing for long is
/// disconnected.)
fn read_slowly(socket: &mut WebSocket<TcpStream>) {
    let mut last = next(socket)["sequence"].as_u64().unwrap();
    let (mut whole, mut missed) = (0, 0);
    while missed < 800 {
        std::thread::sleep(Duration::from_millis(50));
        let message = next(socket);
        let sequence = message["sequence"].as_u64().unwrap();
        let gap = sequence - last - 1;
        assert_eq!(message["missed"].as_u64().unwrap_or(0), gap, "the count is that of the gap after {last}");
        assert_eq!(message.get("missed").is_some(), gap > 0, "it is left out if nothing was missed");
        missed += gap;
        // Updates in the system's buffers come first; no others are kept.
        whole += u64::from(missed == 0);
        assert!(whole < 100, "{whole} updates one after the other");
        last = sequence;
    }
}
