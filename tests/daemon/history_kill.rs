//! The history survives kill -9 at any moment, except for the last second.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::Daemon;
use doorcam::history::{History, Kept, Observation, Retention};
use doorcam_core::tracking::{Event, EventKind};
use jiff::{SignedDuration, Timestamp};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rusqlite::Connection;

/// Environment variable with the history file for the process that is killed.
const FILE: &str = "DOORCAM_TEST_HISTORY";
/// Number of histories written at the same time, and how often the writer of each is killed.
const LANES: u64 = 6;
const KILLS: u64 = 18;
const LATEST_MS: u64 = 1500;

/// A line printed by the killed process: an event was handed over, or all events up to it are kept.
struct Said {
    kept: bool,
    number: u64,
    at: Instant,
}

/// Not a test itself: the process that is killed.
#[test]
#[ignore = "started by the test below"]
fn write_until_killed() {
    let Some(file) = std::env::var_os(FILE) else { return };
    let limits = Retention { age: SignedDuration::MAX, bytes: 50_000_000 };
    let history = History::start(Kept { file: Ok(file.into()), limits }).unwrap();
    assert_eq!(history.report().state, "stored", "{:?}", history.report());
    let mut out = std::io::stdout();
    let first = history.numbers().event;
    for number in first.. {
        let time = Timestamp::now();
        let event = Event {
            sequence: number,
            kind: EventKind::Enter,
            time,
            track: number,
            x_m: 0.0,
            y_m: 1.0,
            zone: None,
            through: None,
            reason: None,
            speed_m_s: None,
        };
        let people = Some((number as usize % 3, [].as_slice()));
        history.take(&Observation { time, people, events: &[event], track: Some(number) });
        writeln!(out, "handed {number}").unwrap();
        if number % 100 == 99 && history.settle() {
            writeln!(out, "kept {number}").unwrap();
        }
        std::thread::sleep(Duration::from_millis(3));
    }
}

/// Starts the writer and kills it after `time`. Returns what it printed, and when it was killed.
fn killed_after(time: Duration, file: &Path) -> (Vec<Said>, Instant) {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "history_kill::write_until_killed", "--nocapture"])
        .env(FILE, file)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let reader = std::thread::spawn(move || {
        let said = |line: String| {
            let (what, number) = line.split_once(' ')?;
            Some(Said { kept: what == "kept", number: number.parse().ok()?, at: Instant::now() })
        };
        lines.map_while(Result::ok).filter_map(said).collect::<Vec<_>>()
    });
    std::thread::sleep(time);
    child.kill().unwrap();
    let at = Instant::now();
    child.wait().unwrap();
    (reader.join().unwrap(), at)
}

fn check(file: &Path) -> Connection {
    let connection = Connection::open(file).unwrap();
    let found: String = connection.query_row("PRAGMA integrity_check", (), |row| row.get(0)).unwrap();
    assert_eq!(found, "ok");
    connection
}

#[test]
fn killed_a_hundred_times_it_keeps_all_but_the_last_second() {
    let lanes = (0..LANES).map(|lane| {
        std::thread::spawn(move || {
            let directory = tempfile::tempdir().unwrap();
            let file = directory.path().join("history.sqlite");
            let mut random = ChaCha8Rng::seed_from_u64(lane);
            let (mut due, mut last) = (Vec::new(), None);
            for kill in 0..KILLS {
                let wait = Duration::from_millis(random.next_u64() % LATEST_MS);
                let (said, killed) = killed_after(wait, &file);
                let repeated = said.iter().find(|said| last.is_some_and(|last| !said.kept && said.number <= last));
                assert!(repeated.is_none_or(|said| said.kept), "a number came again after kill {kill}");
                last = said.iter().map(|said| said.number).max().or(last);
                let kept = said.iter().filter(|said| said.kept).map(|said| said.number).max();
                let old = |said: &&Said| killed.duration_since(said.at) > Duration::from_secs(1);
                due.extend(
                    said.iter()
                        .filter(|said| !said.kept && (old(said) || kept.is_some_and(|kept| said.number <= kept)))
                        .map(|said| said.number),
                );
                if !file.exists() {
                    continue;
                }
                let connection = check(&file);
                // Killed before it created its tables.
                let Ok(mut select) = connection.prepare("SELECT 1 FROM events WHERE sequence = ?1") else {
                    assert!(due.is_empty());
                    continue;
                };
                let missing: Vec<u64> = due.iter().copied().filter(|n| !select.exists([*n as i64]).unwrap()).collect();
                assert!(missing.is_empty(), "lane {lane}, kill {kill}: {missing:?} of {} are lost", due.len());
                let people: Vec<(i64, i64)> = connection
                    .prepare("SELECT from_ns, to_ns FROM occupancy ORDER BY id")
                    .and_then(|mut select| select.query_map((), |row| Ok((row.get(0)?, row.get(1)?)))?.collect())
                    .unwrap();
                assert!(people.iter().all(|(from, to)| from < to));
            }
            due.len()
        })
    });
    let lanes: Vec<_> = lanes.collect();
    let due: Vec<usize> = lanes.into_iter().map(|lane| lane.join().unwrap()).collect();
    assert!(due.iter().all(|&due| due > 100), "too few events were written for a meaningful test: {due:?}");
}

/// The same for the whole program.
#[test]
fn a_killed_doorcam_tells_what_it_told_before_and_counts_on() {
    let directory = tempfile::tempdir().unwrap();
    let (file, config) = (directory.path().join("history.sqlite"), directory.path().join("doorcam.toml"));
    std::fs::write(&config, format!("[history]\nfile = {file:?}\n")).unwrap();
    let mut told: Vec<serde_json::Value> = Vec::new();
    for _ in 0..3 {
        let daemon = Daemon::start("simulate:tests/rooms/busy.toml,rate=max", &["--config", config.to_str().unwrap()]);
        let known = told.len();
        let page = || daemon.json("/api/v1/events?after=0&limit=1000")["events"].as_array().unwrap().clone();
        daemon.wait_for("new events", |_| page().len() > known + 3);
        let now = page();
        assert_eq!(now[..known], told, "earlier events are still there");
        let number = |event: &serde_json::Value| event["sequence"].as_u64().unwrap();
        assert!(now.windows(2).all(|pair| number(&pair[0]) < number(&pair[1])));
        let entered = |events: &[serde_json::Value]| -> Vec<u64> {
            events.iter().filter(|e| e["kind"] == "enter").map(|e| e["track"].as_u64().unwrap()).collect()
        };
        let (before, after) = (entered(&now[..known]), entered(&now[known..]));
        assert!(after.iter().all(|track| !before.contains(track)), "a track's id came again: {before:?}, {after:?}");
        told = now;
        // Dropping a daemon kills it.
        drop(daemon);
        check(&file);
    }
}
