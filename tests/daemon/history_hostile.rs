//! The history under questions that are meant to be too much for it: many rows, extreme values, many clients at once.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;

use crate::common::Daemon;
use serde_json::Value;

/// The tables as doorcam 0.2 made them.
const OLD_TABLES: &str = "
    PRAGMA journal_mode = WAL;
    CREATE TABLE events (sequence INTEGER PRIMARY KEY, kind TEXT NOT NULL, time_ns INTEGER NOT NULL,
        track INTEGER NOT NULL, x_m REAL, y_m REAL, zone TEXT) STRICT;
    CREATE INDEX events_time ON events (time_ns);
    CREATE TABLE occupancy (id INTEGER PRIMARY KEY, zone TEXT, people INTEGER NOT NULL, from_ns INTEGER NOT NULL,
        to_ns INTEGER NOT NULL) STRICT;
    CREATE INDEX occupancy_from ON occupancy (from_ns);
    CREATE TABLE numbers (name TEXT PRIMARY KEY, next INTEGER NOT NULL) STRICT, WITHOUT ROWID;
    PRAGMA user_version = 1;
";

/// A daemon that watches an empty room, with a history of so many rows from the last weeks, one a second.
fn daemon(directory: &Path, rows: u64) -> Daemon {
    let file = directory.join("history.sqlite");
    let first = jiff::Timestamp::now().as_second() - rows as i64 - 60;
    let connection = rusqlite::Connection::open(&file).unwrap();
    connection.execute_batch(OLD_TABLES).unwrap();
    let counting = format!("WITH RECURSIVE n (k) AS (SELECT 0 UNION ALL SELECT k + 1 FROM n WHERE k < {})", rows - 1);
    let fill = format!(
        "BEGIN;
         {counting} INSERT INTO events SELECT k, CASE k % 2 WHEN 0 THEN 'zone_enter' ELSE 'zone_exit' END,
            ({first} + k) * 1000000000, k / 10, 0.5, -1.25, CASE WHEN k < 50 THEN '=hall' ELSE 'bed' END FROM n;
         {counting} INSERT INTO occupancy SELECT k, CASE k % 2 WHEN 0 THEN NULL ELSE '@desk, \"left\"' END, k % 3,
            ({first} + k) * 1000000000, ({first} + k + 1) * 1000000000 FROM n;
         INSERT INTO numbers VALUES ('event', {rows}), ('track', {rows}), ('span', {rows});
         COMMIT;"
    );
    connection.execute_batch(&fill).unwrap();
    drop(connection);
    let config = directory.join("doorcam.toml");
    std::fs::write(&config, format!("[history]\nfile = {file:?}\n")).unwrap();
    Daemon::start("simulate:empty-room", &["--config", config.to_str().unwrap()])
}

fn numbers(page: &Value) -> Vec<u64> {
    page["events"].as_array().unwrap().iter().map(|event| event["sequence"].as_u64().unwrap()).collect()
}

/// The headers and the body of an answer.
fn fetch(daemon: &Daemon, path: &str) -> (u16, String, String) {
    let mut stream = TcpStream::connect(daemon.url.trim_start_matches("http://")).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    write!(stream, "GET {path} HTTP/1.0\r\nHost: localhost\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
    (status, head.to_ascii_lowercase(), body.to_owned())
}

#[test]
fn a_large_history_of_an_earlier_version_is_answered_from_and_64_at_once_hold_nobody_up() {
    let directory = tempfile::tempdir().unwrap();
    let mut daemon = daemon(directory.path(), 120_000);
    assert_eq!(daemon.json("/api/v1/status")["history"]["state"], "stored");
    let page = daemon.json("/api/v1/events?zone=%3Dhall&limit=1000");
    assert_eq!(numbers(&page), (0..50).collect::<Vec<_>>());
    assert_eq!((&page["oldest"], &page["newest"]), (&0.into(), &119_999.into()));
    assert_eq!(numbers(&daemon.json("/api/v1/events?track=3000&limit=3")), [30_007, 30_008, 30_009]);
    let paths = [
        "/api/v1/events?zone=bed",
        "/api/v1/events?zone=nowhere",
        "/api/v1/events?kind=dwell,enter&from=2000-01-01T00:00:00Z",
        "/api/v1/events?track=99999999",
        "/api/v1/occupancy?from=2000-01-01T00:00:00Z&to=9999-12-30T22:00:00Z&step=31622400",
    ];
    let answers = std::sync::Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for client in 0..64 {
            let (daemon, answers) = (&daemon, &answers);
            scope.spawn(move || {
                for k in 0..5 {
                    let (status, head, body) = fetch(daemon, paths[(client + k) % paths.len()]);
                    assert!(status == 200 || status == 503 && head.contains("retry-after: 1"), "{head} {body}");
                    answers.lock().unwrap().push(status);
                }
            });
        }
        for _ in 0..20 {
            assert_eq!(daemon.get("/livez").0, 200);
        }
    });
    assert_eq!(answers.lock().unwrap().len(), 320);
    assert!(answers.lock().unwrap().iter().filter(|&&status| status == 200).count() >= 64);
    assert_eq!(daemon.terminate().1, Some(0));
}

#[test]
fn the_whole_history_comes_as_csv_in_pages_whose_cells_no_spreadsheet_calculates() {
    let directory = tempfile::tempdir().unwrap();
    let daemon = daemon(directory.path(), 25_000);
    let mut path = Some(String::from("/api/v1/events?format=csv&from=2000-01-01T00:00:00Z"));
    let (mut rows, mut pages) = (Vec::new(), 0);
    while let Some(next) = path {
        let (status, head, body) = fetch(&daemon, &next);
        assert_eq!(status, 200, "{head}");
        let mut lines = body.lines();
        assert_eq!(lines.next(), Some("sequence,kind,time,track,x_m,y_m,zone,through,reason,speed_m_s"));
        rows.extend(lines.map(String::from));
        pages += 1;
        path = head.lines().find(|line| line.starts_with("link: ")).map(|link| {
            let (_, rest) = link.split_once('<').unwrap();
            // Relative to the address that was asked for.
            format!("/api/v1/{}", rest.split_once('>').unwrap().0.replace("t00:00:00z", "T00:00:00Z"))
        });
    }
    assert_eq!((pages, rows.len()), (3, 25_000));
    for (k, row) in rows.iter().enumerate() {
        assert!(row.starts_with(&format!("{k},")), "{row}");
        let zone = if k < 50 { "'=hall" } else { "bed" };
        assert!(row.ends_with(&format!(",{},0.5,-1.25,{zone},,,", k / 10)), "{row}");
    }
    let newest = fetch(&daemon, "/api/v1/events?format=csv&limit=2").2;
    assert!(newest.lines().nth(1).unwrap().starts_with("24998,") && newest.lines().count() == 3, "{newest}");
    assert_eq!(fetch(&daemon, "/api/v1/events?format=csv&zone=nowhere").2.lines().count(), 1);

    let spans = fetch(&daemon, "/api/v1/occupancy?format=csv&zone=@desk,+%22left%22&from=2000-01-01T00:00:00Z");
    assert_eq!(spans.2.lines().count(), 10_001);
    assert!(spans.2.lines().nth(1).unwrap().starts_with("1,\"'@desk, \"\"left\"\"\",1,"), "{}", &spans.2[..200]);
    assert!(spans.1.contains("link: ") && spans.1.contains("&after=19999>"), "{}", spans.1);
    let hours = fetch(&daemon, "/api/v1/occupancy?format=csv&step=1&limit=2500");
    assert_eq!((hours.0, hours.2.lines().count()), (200, 2501));
    let from: Vec<&str> = hours.2.lines().skip(1).map(|line| line.split(',').nth(1).unwrap()).collect();
    let next = hours.1.split("&from=").nth(1).unwrap().split('>').next().unwrap();
    assert_eq!(from.last().unwrap().to_ascii_lowercase(), next, "the next page begins where this one ends");
    assert!(from.windows(2).all(|pair| pair[0] < pair[1]));
}

#[test]
fn extreme_parameters_are_answered_or_refused_in_words() {
    let directory = tempfile::tempdir().unwrap();
    let daemon = daemon(directory.path(), 3000);
    let long = "z".repeat(12_000);
    let times = [
        "0001-01-01T00:00:00Z",
        "9999-12-30T22:00:00Z",
        "9999-12-31T23:59:59Z",
        "0000-00-00T00:00:00Z",
        "",
        "-009999-01-02T01:59:59Z",
        "1970-01-01T00:00:00Z",
    ];
    let mut paths = Vec::new();
    for route in ["events", "occupancy"] {
        for limit in ["0", "1", "1000", "1001", "1000000000", "-1", "1e3", "18446744073709551616", "", "NaN"] {
            paths.push(format!("{route}?limit={limit}"));
            paths.push(format!("{route}?limit={limit}&format=csv"));
        }
        for from in times {
            for to in times {
                paths.push(format!("{route}?from={from}&to={to}"));
                paths.push(format!("{route}?from={from}&to={to}&format=csv&zone=bed"));
            }
        }
        for zone in ["", "%00", "a%00b", "%F0%9F%9A%AA", "%FF", "%E2%80%AE", "'%20OR%201=1--", &long] {
            paths.push(format!("{route}?zone={zone}"));
        }
        for after in ["0", "9223372036854775807", "9223372036854775808", "-1", "1.5", "%00", "null"] {
            paths.push(format!("{route}?after={after}"));
            paths.push(format!("{route}?after={after}&format=csv"));
        }
        paths.push(format!("{route}?limit=1&limit=2"));
        paths.push(format!("{route}?format=xml"));
        paths.push(format!("{route}?{long}=1&a%0Ab%1B=2"));
        paths.push(format!("{route}?a%0Ab%1B%E2%80%AE=2"));
        paths.push(format!("{route}?from={long}"));
        paths.push(format!("{route}?{}", "from=2026-01-01T00:00:00Z&".repeat(100)));
    }
    paths.push(format!("events?kind={}", "enter,".repeat(1500) + "exit"));
    paths.push("events?kind=".into());
    for track in ["0", "-1", "9223372036854775807", "18446744073709551615"] {
        paths.push(format!("events?track={track}&zone=bed&kind=exit,exit"));
    }
    for step in ["1", "1e-9", "0", "-1", "1e308", "NaN", "inf", "31622400", "31622401", "1.0000000001"] {
        paths.push(format!("occupancy?step={step}"));
        paths.push(format!("occupancy?step={step}&from=0001-01-01T00:00:00Z&to=9999-12-30T22:00:00Z"));
        paths.push(format!("occupancy?step={step}&from=0001-01-01T00:00:00Z&format=csv"));
        paths.push(format!("occupancy?step={step}&after=3"));
    }
    for path in paths {
        let shown: String = path.chars().take(120).collect();
        let (status, _, body) = fetch(&daemon, &format!("/api/v1/{path}"));
        match status {
            200 => {}
            400 => {
                let problem: Value = serde_json::from_str(&body).unwrap();
                let detail = problem["detail"].as_str().unwrap();
                let clear = detail.contains("(parameters: after, from, to") && detail.len() < 600;
                assert!(clear && !detail.contains(char::is_control), "{shown}: {detail}");
            }
            _ => panic!("{shown}: {status} {body}"),
        }
    }
    // Longer than a head may be: the rest of it may be cut off before it was sent.
    let mut stream = TcpStream::connect(daemon.url.trim_start_matches("http://")).unwrap();
    let _ = write!(stream, "GET /api/v1/events?zone={} HTTP/1.0\r\n\r\n", "z".repeat(1 << 20));
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    assert!(answer.is_empty() || answer.starts_with(b"HTTP/1.1 4"), "{}", String::from_utf8_lossy(&answer));
    let head = {
        let mut stream = TcpStream::connect(daemon.url.trim_start_matches("http://")).unwrap();
        let request = "HEAD /api/v1/events?format=csv HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    assert!(head.starts_with("HTTP/1.1 200") && head.ends_with("\r\n\r\n"), "{head}");
    assert_eq!(daemon.get("/livez").0, 200);
}
