//! Events and occupancy over REST: pages, ranges, CSV, across restarts and on a full disk.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::Daemon;
use serde_json::Value;

const SOURCE: &str = "simulate:tests/rooms/busy.toml,rate=max";

fn config(directory: &Path) -> String {
    let file = directory.join("doorcam.toml");
    let zones = "[[zones]]\nname = \"left\"\npolygon_m = [[-1.5, 0.2], [0, 0.2], [0, 3], [-1.5, 3]]\n";
    let text = format!("[history]\nfile = {:?}\n{zones}", directory.join("history.sqlite"));
    std::fs::write(&file, text).unwrap();
    file.to_str().unwrap().into()
}

fn rows<'a>(page: &'a Value, key: &str) -> &'a [Value] {
    page[key].as_array().unwrap_or_else(|| panic!("{key} of {page}"))
}

fn wait_for_events(daemon: &Daemon, count: usize) {
    daemon.wait_for("events", |_| rows(&daemon.json("/api/v1/events?limit=1000"), "events").len() >= count);
}

/// The body, the content type and the address of the next page.
fn fetch(daemon: &Daemon, path: &str, accept: &str) -> (String, String, Option<String>) {
    let mut response = ureq::get(format!("{}{path}", daemon.url)).header("accept", accept).call().unwrap();
    let header = |name: &str| response.headers().get(name).map(|value| value.to_str().unwrap().to_owned());
    let (kind, link) = (header("content-type").unwrap(), header("link"));
    // Relative to what was asked for, and so right behind any proxy.
    let base = &path[..=path.rfind('/').unwrap()];
    let next = link.map(|link| link.strip_prefix('<').and_then(|l| l.split('>').next()).unwrap().to_owned());
    let next = next.inspect(|next| assert!(!next.contains('/'), "{next}")).map(|next| format!("{base}{next}"));
    (response.body_mut().read_to_string().unwrap(), kind, next)
}

#[test]
fn events_and_occupancy_come_in_pages_and_as_csv() {
    let directory = tempfile::tempdir().unwrap();
    let mut daemon = Daemon::start(SOURCE, &["--config", &config(directory.path())]);
    wait_for_events(&daemon, 8);
    assert_eq!(daemon.json("/api/v1/status")["history"]["state"], "stored");
    // Restarted with an empty room, so that no events are added from here on.
    assert_eq!(daemon.terminate().1, Some(0));
    let daemon = Daemon::start("simulate:empty-room,rate=max", &["--config", &config(directory.path())]);
    let all = daemon.json("/api/v1/events?limit=1000");
    let events = rows(&all, "events");
    assert_eq!((&all["oldest"], &all["newest"]), (&events[0]["sequence"], &events.last().unwrap()["sequence"]));

    let mut paged = Vec::new();
    let mut path = Some(String::from("/api/v1/events?from=2000-01-01T00:00:00Z&limit=3"));
    while let Some(next) = path {
        let (body, kind, next) = fetch(&daemon, &next, "*/*");
        assert_eq!(kind, "application/json");
        paged.extend(rows(&serde_json::from_str(&body).unwrap(), "events").iter().cloned());
        path = next;
    }
    assert_eq!(paged, events);

    let time = events[3]["time"].as_str().unwrap();
    let before = daemon.json(&format!("/api/v1/events?to={time}&limit=1000"));
    let after = daemon.json(&format!("/api/v1/events?from={time}&limit=1000"));
    assert_eq!(rows(&before, "events").len() + rows(&after, "events").len(), events.len());
    let (left, visits) = ("/api/v1/events?zone=left&limit=1000", "/api/v1/events?kind=enter,exit&limit=1000");
    for (path, key, values) in [(left, "zone", ["left", "left"]), (visits, "kind", ["enter", "exit"])] {
        let some = daemon.json(path);
        let wanted: Vec<&Value> = events.iter().filter(|e| values.iter().any(|value| e[key] == *value)).collect();
        assert!(!wanted.is_empty() && rows(&some, "events").iter().eq(wanted), "{some}");
    }
    let (csv, kind, _) = fetch(&daemon, "/api/v1/events", "text/csv");
    let lines: Vec<&str> = csv.lines().collect();
    let columns = "sequence,kind,time,track,x_m,y_m,zone,through,reason,speed_m_s";
    assert!(kind.starts_with("text/csv") && lines[0] == columns, "{csv}");
    assert!(lines.iter().all(|line| line.matches(',').count() == 9), "{csv}");
    assert_eq!(lines.len(), events.len() + 1);
    assert!(lines[1].starts_with(&format!(
        "{},{},{}",
        events[0]["sequence"],
        "enter",
        events[0]["time"].as_str().unwrap()
    )));

    for zone in ["", "&zone=left"] {
        let spans = daemon.json(&format!("/api/v1/occupancy?from=2000-01-01T00:00:00Z{zone}"));
        let spans = rows(&spans, "spans");
        assert!(spans.iter().any(|span| span["people"].as_u64() > Some(0)));
        let end = spans.last().unwrap()["to"].as_str().unwrap();
        let begin = spans[0]["from"].as_str().unwrap();
        let intervals = daemon.json(&format!("/api/v1/occupancy?from={begin}&to={end}&step=1{zone}"));
        let intervals = rows(&intervals, "intervals");
        let seconds = |span: &Value| {
            let time = |key: &str| span[key].as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
            time("to").duration_since(time("from")).as_secs_f64()
        };
        let sum = |key: &str| intervals.iter().map(|interval| interval[key].as_f64().unwrap()).sum::<f64>();
        let occupied = spans.iter().filter(|span| span["people"].as_u64() > Some(0)).map(seconds).sum::<f64>();
        let watched = spans.iter().map(seconds).sum::<f64>();
        assert!(occupied > 0.1 && (sum("occupied_s") - occupied).abs() < 1e-6, "{} {occupied}", sum("occupied_s"));
        assert!((sum("watched_s") - watched).abs() < 1e-6, "{} {watched}", sum("watched_s"));
    }
    let (csv, _, next) = fetch(&daemon, "/api/v1/occupancy?format=csv&step=1&limit=1", "*/*");
    assert!(csv.starts_with("from,to,most,mean,occupied_s,watched_s\n") && csv.lines().count() == 2, "{csv}");
    assert!(next.is_some_and(|next| next.starts_with("/api/v1/occupancy?format=csv&step=1&limit=1&from=")));

    for wrong in
        ["events?limit=1001", "events?kind=arrive", "events?from=yesterday", "events?until=2026-01-01T00:00:00Z"]
            .into_iter()
            .chain([
                "occupancy?step=0",
                "occupancy?step=nan",
                "occupancy?from=2026-01-02T00:00:00Z&to=2026-01-01T00:00:00Z",
            ])
    {
        let (code, problem) = daemon.get(&format!("/api/v1/{wrong}"));
        let problem: Value = serde_json::from_slice(&problem).unwrap();
        assert!(
            code == 400 && problem["detail"].as_str().unwrap().contains("(parameters: after, from, to"),
            "{problem}"
        );
    }
}

/// A limit on the size of files stands in for a full disk, because it can be set and lifted while the program runs.
#[test]
fn on_a_full_disk_it_goes_on_in_memory_and_says_so() {
    let directory = tempfile::tempdir().unwrap();
    let mut command = Command::new("sh");
    command.args(["-c", "trap '' XFSZ; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_doorcam")]);
    command.args(["serve", "--source", SOURCE, "--listen", "127.0.0.1:0", "--config", &config(directory.path())]);
    command.stdin(Stdio::null());
    let mut daemon = Daemon::spawn(command);
    let limit = |length: &str| {
        let process = daemon.id().to_string();
        let set = Command::new("prlimit").args(["--pid", &process, &format!("--fsize={length}:")]).status();
        assert!(set.expect("prlimit (Debian: util-linux)").success());
    };
    wait_for_events(&daemon, 3);
    limit("0");
    let status = daemon.wait_for("memory", |status| status["history"]["state"] == "memory");
    let reason = status["history"]["reason"].as_str().unwrap();
    assert!(reason.starts_with(directory.path().join("history.sqlite").to_str().unwrap()), "{reason}");
    let known = rows(&daemon.json("/api/v1/events?limit=1000"), "events").len();
    wait_for_events(&daemon, known + 3);
    let while_full = daemon.json("/api/v1/events?limit=1000");
    limit("unlimited");
    let status = daemon.wait_for("the file", |status| status["history"]["state"] == "stored");
    assert_eq!((&status["history"]["reason"], &status["history"]["lost"]), (&Value::Null, &0.into()));
    assert_eq!(daemon.terminate().1, Some(0));
    let connection = rusqlite::Connection::open(directory.path().join("history.sqlite")).unwrap();
    let in_file: Vec<u64> = connection
        .prepare("SELECT sequence FROM events ORDER BY sequence")
        .and_then(|mut select| select.query_map((), |row| row.get(0))?.collect())
        .unwrap();
    let sequence = |event: &Value| event["sequence"].as_u64().unwrap();
    let told: Vec<u64> = rows(&while_full, "events").iter().map(sequence).collect();
    assert!(told.len() > 5 && in_file.starts_with(&told), "{told:?} {in_file:?}");
    assert!(in_file.windows(2).all(|pair| pair[1] == pair[0] + 1), "{in_file:?}");
}

#[test]
fn without_a_file_a_simulation_is_remembered_as_long_as_it_runs() {
    let daemon = Daemon::start(SOURCE, &[]);
    wait_for_events(&daemon, 2);
    let history = daemon.json("/api/v1/status")["history"].clone();
    assert_eq!((&history["state"], &history["file"], &history["lost"]), (&"memory".into(), &Value::Null, &0.into()));
    assert!(history["reason"].as_str().unwrap().contains("history.file"), "{history}");
    let people = daemon.json("/api/v1/occupancy?step=3600&from=2000-01-01T00:00:00Z&limit=1000");
    assert!(people["next"].is_string());
}
