//! The history's file disappears, or the clock leaps, while the program runs.

use std::path::Path;

use crate::common::{Daemon, doorcam};
use crate::endurance::{clock, set};

const SOURCE: &str = "simulate:tests/rooms/busy.toml,rate=max";

fn config(directory: &Path) -> String {
    let file = directory.join("doorcam.toml");
    std::fs::write(&file, format!("[history]\nfile = {:?}\n", directory.join("kept/history.sqlite"))).unwrap();
    file.to_str().unwrap().into()
}

fn in_file(file: &Path) -> Vec<u64> {
    let connection = rusqlite::Connection::open(file).unwrap();
    let mut select = connection.prepare("SELECT sequence FROM events ORDER BY sequence").unwrap();
    select.query_map((), |row| row.get(0)).unwrap().collect::<Result<_, _>>().unwrap()
}

fn wait_for_events(daemon: &Daemon, count: usize) {
    let events = || daemon.json("/api/v1/events?limit=1000")["events"].as_array().unwrap().len();
    daemon.wait_for("events", |_| events() >= count);
}

#[test]
fn a_directory_that_is_moved_away_while_it_runs_is_made_anew_and_nothing_is_lost() {
    let directory = tempfile::tempdir().unwrap();
    let mut daemon = Daemon::start(SOURCE, &["--config", &config(directory.path())]);
    wait_for_events(&daemon, 4);
    let place = directory.path().join("kept");
    std::fs::rename(&place, directory.path().join("away")).unwrap();
    // In its place, something in which no file can be made.
    std::fs::write(&place, "").unwrap();
    let status = daemon.wait_for("memory", |status| status["history"]["state"] == "memory");
    let reason = status["history"]["reason"].as_str().unwrap();
    assert!(reason.contains("kept/history.sqlite"), "{reason}");
    daemon.wait_for_log("it was deleted or moved away while it was in use");
    wait_for_events(&daemon, 2);
    std::fs::remove_file(&place).unwrap();
    let status = daemon.wait_for("the file", |status| status["history"]["state"] == "stored");
    assert_eq!((&status["history"]["reason"], &status["history"]["lost"]), (&serde_json::Value::Null, &0.into()));
    assert_eq!(daemon.terminate().1, Some(0));
    let before = in_file(&directory.path().join("away/history.sqlite"));
    let after = in_file(&place.join("history.sqlite"));
    assert!(before.len() >= 4 && after.len() >= 2, "{before:?} {after:?}");
    let all: Vec<u64> = before.iter().chain(&after).copied().collect();
    assert!(all.windows(2).all(|pair| pair[1] == pair[0] + 1), "{all:?}");
}

#[test]
fn a_leap_of_the_clock_by_a_month_erases_nothing() {
    let Some(library) = clock() else { return };
    let directory = tempfile::tempdir().unwrap();
    let offset = directory.path().join("offset");
    set(&offset, 0);
    let mut command = doorcam(&["serve", "--source", SOURCE, "--listen", "127.0.0.1:0"]);
    command.args(["--config", &config(directory.path())]).env("LD_PRELOAD", library);
    command.env("FAKETIME_TIMESTAMP_FILE", &offset).env("FAKETIME_NO_CACHE", "1").env("DONT_FAKE_MONOTONIC", "1");
    let mut daemon = Daemon::spawn(command);
    wait_for_events(&daemon, 4);
    let events =
        |daemon: &Daemon| daemon.json("/api/v1/events?after=0&limit=1000")["events"].as_array().unwrap().clone();
    let known = events(&daemon);
    let newest = |daemon: &Daemon| daemon.json("/api/v1/events?limit=1")["newest"].as_u64().unwrap();
    for days in [32, 0, -400, 20_000, 0] {
        set(&offset, 86_400 * days);
        // Written, and pruned, by that clock.
        let then = newest(&daemon);
        daemon.wait_for("more events", |_| newest(&daemon) > then + 1);
        assert_eq!(events(&daemon)[..known.len()], known, "{days} days");
    }
    daemon.wait_for_log("the clock was put");
    assert_eq!(daemon.terminate().1, Some(0));
    assert!(in_file(&directory.path().join("kept/history.sqlite")).len() > known.len());
}
