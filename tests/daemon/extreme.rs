//! Values that can be parsed but make no sense: every way in answers them, all ways agree, and nothing stops or grows.

use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering};

use doorcam_engine::{Assembly, Settings};
use doorcam_source::recording::Recording;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::{Value, json};

use crate::common::{Daemon, camera_recording, run, stderr};

/// Number of calibrations tried. `scripts/test full` tries ten times as many.
const TRIED: usize = 120;

const EXTREME: [f64; 22] = [
    0.0,
    -0.0,
    5e-324,
    2.2e-308,
    1e-9,
    1e-3,
    0.049,
    0.1,
    1.0,
    -1.0,
    2.7,
    3.5,
    63.0,
    300.0,
    7680.0,
    65_535.0,
    65_536.0,
    1e9,
    -1e9,
    1.844_674_407_370_955_2e19,
    1e308,
    -1e308,
];

fn one_of<T: Copy>(random: &mut ChaCha8Rng, of: &[T]) -> T {
    of[random.next_u32() as usize % of.len()]
}

/// Paths of all numbers, and of all lists, in a JSON value.
fn paths(value: &Value, at: &str, numbers: &mut Vec<String>, lists: &mut Vec<String>) {
    match value {
        Value::Number(_) => numbers.push(at.into()),
        Value::Array(items) => {
            lists.push(at.into());
            items.iter().enumerate().for_each(|(k, item)| paths(item, &format!("{at}/{k}"), numbers, lists));
        }
        Value::Object(members) => {
            members.iter().for_each(|(key, item)| paths(item, &format!("{at}/{key}"), numbers, lists));
        }
        _ => {}
    }
}

/// Changes one or two values or lists into extreme ones.
fn distort(value: &mut Value, random: &mut ChaCha8Rng) {
    for _ in 0..1 + random.next_u32() % 2 {
        let (mut numbers, mut lists) = (Vec::new(), Vec::new());
        paths(value, "", &mut numbers, &mut lists);
        match random.next_u32() % 8 {
            // In another unit, or mirrored.
            0 => {
                let factor = one_of(random, &[1000.0, 100.0, 1.0 / 0.3048, -1.0, 0.001]);
                let which = one_of(random, &["/width_m", "/floor_m/", "_m"]);
                for path in numbers.iter().filter(|path| path.contains(which)) {
                    let number = value.pointer_mut(path).unwrap();
                    *number = json!(number.as_f64().unwrap() * factor);
                }
            }
            1 | 2 if !lists.is_empty() => {
                let path = &lists[random.next_u32() as usize % lists.len()];
                let items = value.pointer_mut(path).unwrap().as_array_mut().unwrap();
                match random.next_u32() % 4 {
                    0 => items.reverse(),
                    1 => {
                        let first = items.first().cloned();
                        items.iter_mut().zip(first.iter().cycle()).for_each(|(item, first)| *item = first.clone());
                    }
                    2 => items.truncate(random.next_u32() as usize % 5),
                    _ => {
                        let count = one_of(random, &[5, 64, 65, 1000, 5_000]);
                        *items = items.iter().cycle().take(count).cloned().collect();
                    }
                }
            }
            _ => {
                let path = &numbers[random.next_u32() as usize % numbers.len()];
                let extreme = one_of(random, &EXTREME);
                let whole = extreme.fract() == 0.0 && extreme.abs() < 1e15 && random.next_u32().is_multiple_of(2);
                *value.pointer_mut(path).unwrap() = if whole { json!(extreme as i64) } else { json!(extreme) };
            }
        }
    }
}

/// A `timestamps.csv` whose times make no sense.
fn odd_times(random: &mut ChaCha8Rng, frames: usize) -> String {
    let factor = one_of(random, &[1.0, 1e3, 1e6, 1e9, 0.0, -1.0, 1e-9]);
    let offset = one_of(random, &[0.0, 1.7e9, -5.0, 1e15]);
    let mut times: Vec<f64> = (0..frames).map(|k| offset + 0.1 * k as f64 * factor).collect();
    match random.next_u32() % 4 {
        0 => times.reverse(),
        1 => times[frames / 2..].iter_mut().for_each(|t| *t += 3600.0),
        2 => times[frames / 2] = one_of(random, &EXTREME),
        _ => {}
    }
    let line = |(k, t): (usize, &f64)| format!("{k},{t}\n");
    std::iter::once("index,seconds\n".to_owned()).chain(times.iter().enumerate().map(line)).collect()
}

#[test]
fn extreme_recordings_end_with_a_result_or_one_line_that_names_the_file() {
    let sound = tempfile::tempdir().unwrap();
    let directory = sound.path().join("room");
    let directory = directory.to_str().unwrap();
    let made = run(&["simulate", "tests/rooms/busy.toml", directory, "--frames", "24"]);
    assert!(made.status.success(), "{}", stderr(&made));
    let path = |name: &str| format!("{directory}/{name}");
    let read = |name: &str| serde_json::from_slice::<Value>(&fs::read(path(name)).unwrap()).unwrap();
    let (manifest, truth) = (read("recording.json"), read("truth.json"));
    assert!(run(&["evaluate", directory]).status.success());
    let mut random = ChaCha8Rng::seed_from_u64(18);
    let rounds = if std::env::var_os("DOORCAM_TEST_FULL").is_some() { 240 } else { 24 };
    let mut refused = 0;
    for round in 0..rounds {
        let (mut manifest, mut truth) = (manifest.clone(), truth.clone());
        let mut times = None;
        match round % 3 {
            0 => distort(&mut manifest, &mut random),
            1 => distort(&mut truth, &mut random),
            _ => times = Some(odd_times(&mut random, 24)),
        }
        fs::write(path("recording.json"), manifest.to_string()).unwrap();
        fs::write(path("truth.json"), truth.to_string()).unwrap();
        // The file may be left over from the round before.
        let _ = fs::remove_file(path("timestamps.csv"));
        times.iter().for_each(|times| fs::write(path("timestamps.csv"), times).unwrap());
        let out = run(&["evaluate", directory, "--json"]);
        let told = || format!("{manifest:.1500}\n{truth:.1500}\n{times:?}\n{}", stderr(&out));
        let last = stderr(&out).lines().last().unwrap_or_default().to_owned();
        match out.status.code() {
            Some(0) => {
                let result: Value = serde_json::from_slice(&out.stdout).unwrap();
                let error = result["mean_error_m"].as_f64().unwrap_or(0.0);
                assert!(error.is_finite() && error >= 0.0, "{}", told());
            }
            Some(1) => {
                assert!(last.starts_with("doorcam: ") && last.contains(directory), "{}", told());
                refused += 1;
            }
            other => panic!("{other:?}: {}", told()),
        }
    }
    assert!(refused > 0 && refused < rounds, "{refused} of {rounds}");
}

/// Whether a recording with this calibration is accepted.
fn recording_accepts(directory: &std::path::Path, calibration: &Value) -> Result<(), String> {
    let mut manifest = json!({"fps": 10, "layout": "camera", "transfer": "srgb"});
    for (key, value) in calibration.as_object().unwrap() {
        manifest[key] = value.clone();
    }
    fs::write(directory.join("recording.json"), manifest.to_string()).unwrap();
    let recording = Recording::open(directory).map_err(|e| e.to_string())?;
    Assembly::new(Settings::default()).for_recording(&recording.manifest).map(drop).map_err(|e| e.to_string())
}

#[test]
fn every_way_in_gives_one_verdict_on_extreme_calibrations() {
    let recording = camera_recording(3);
    let other = tempfile::tempdir().unwrap();
    fs::create_dir(other.path().join("frames")).unwrap();
    fs::copy(recording.path().join("frames/00000000.jpg"), other.path().join("frames/00000000.jpg")).unwrap();
    let file = recording.path().join("calibration.json");
    let source = format!("replay:{},loop", recording.path().display());
    let mut running = Daemon::start(&source, &["--calibration", file.to_str().unwrap()]);
    running.wait_for("a frame", |s| s["frames"]["captured"].as_u64() > Some(0));
    let mut sound = running.json("/api/v1/calibration")["calibration"].clone();
    sound["lens"] = json!({"k1": -0.05, "k2": 0.01, "focal_px": 900.0});
    sound["transfer"] = json!({"curve": [0.0, 0.3, 0.6, 1.0]});
    let (status, check) = running.send("POST", "/api/v1/calibration/check", &sound);
    assert_eq!((status, &check["ok"]), (200, &json!(true)), "{check}");

    let mut random = ChaCha8Rng::seed_from_u64(17);
    let tried = if std::env::var_os("DOORCAM_TEST_FULL").is_some() { 10 * TRIED } else { TRIED };
    let (mut used, mut refused) = (0, 0);
    for _ in 0..tried {
        let mut calibration = sound.clone();
        distort(&mut calibration, &mut random);
        let (checked, check) = running.send("POST", "/api/v1/calibration/check", &calibration);
        let (put, answer) = running.send("PUT", "/api/v1/calibration", &calibration);
        let replayed = recording_accepts(other.path(), &calibration);
        let told =
            || format!("{calibration:.2000}\nchecked {checked} {check:.500}\nput {put} {answer:.500}\n{replayed:?}");
        assert_eq!(running.get("/livez").0, 200, "{}", told());
        if checked == 400 {
            // Not even the form is right: a fraction where a whole number is expected, for example.
            assert_eq!((put, replayed.is_ok()), (400, false), "{}", told());
            refused += 1;
            continue;
        }
        assert_eq!(checked, 200, "{}", told());
        let errors: Vec<&str> = check["errors"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
        assert_eq!(put, if errors.is_empty() { 200 } else { 422 }, "{}", told());
        if let Some(first) = errors.first() {
            assert_eq!(answer["detail"], *first, "{}", told());
        }
        // Only a running camera knows the size of its images.
        let sound = errors.iter().all(|error| error.starts_with("size: the calibration is for "));
        assert_eq!(replayed.is_ok(), sound, "{}", told());
        if errors.is_empty() { used += 1 } else { refused += 1 }
    }
    assert!(used > 0 && refused > 0, "{used} {refused}");
    let solved = |status: &Value| status["frames"]["solved"].as_u64().unwrap();
    let before = solved(&running.json("/api/v1/status"));
    running.wait_for("more frames", |status| solved(status) > before + 3);
    assert_eq!(running.terminate().1, Some(0));
}

#[test]
fn of_many_calibrations_at_once_only_the_newest_is_built() {
    let recording = camera_recording(3);
    let file = recording.path().join("calibration.json");
    let source = format!("replay:{},loop", recording.path().display());
    let running = Daemon::start(&source, &["--calibration", file.to_str().unwrap()]);
    running.wait_for("a frame", |s| s["frames"]["captured"].as_u64() > Some(0));
    let sound = running.json("/api/v1/calibration")["calibration"].clone();
    let (used, superseded) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let threads = || fs::read_dir(format!("/proc/{}/task", running.id())).unwrap().count();
    let before = threads();
    std::thread::scope(|scope| {
        for client in 0..20 {
            let (running, sound, used, superseded) = (&running, &sound, &used, &superseded);
            scope.spawn(move || {
                for round in 0..10 {
                    let mut calibration = sound.clone();
                    calibration["doorway"]["width_m"] = json!(0.5 + f64::from(client * 10 + round) * 1e-6);
                    match running.send("PUT", "/api/v1/calibration", &calibration) {
                        (200, _) => used.fetch_add(1, Ordering::Relaxed),
                        (409, problem) if problem["detail"].to_string().contains("another change") => {
                            superseded.fetch_add(1, Ordering::Relaxed)
                        }
                        (status, problem) => panic!("{status} {problem}"),
                    };
                }
            });
        }
    });
    let (used, superseded) = (used.into_inner(), superseded.into_inner());
    assert_eq!(used + superseded, 200);
    assert!(superseded > used, "{used} were built");
    // What was built for earlier ones ends soon, and leaves no thread that waits for its turn.
    let status = running.wait_for("the newest", |s| s["calibration_revision"].as_u64() == Some(used as u64));
    assert!(threads() < before + 40, "{} threads, {before} before: {status}", threads());
}

#[test]
fn a_door_of_a_million_kilometres_is_answered_and_the_daemon_ends_when_told() {
    let recording = camera_recording(3);
    let file = recording.path().join("calibration.json");
    let source = format!("replay:{},loop", recording.path().display());
    let mut running = Daemon::start(&source, &["--calibration", file.to_str().unwrap()]);
    let mut calibration = running.json("/api/v1/calibration")["calibration"].clone();
    calibration["doorway"]["width_m"] = json!(1e9);
    let (status, check) = running.send("POST", "/api/v1/calibration/check", &calibration);
    assert_eq!((status, &check["ok"]), (200, &json!(false)));
    assert_eq!(check["errors"][0], "doorway.width_m is 1000000000, expected 0.05 to 10 metres");
    assert_eq!(running.send("PUT", "/api/v1/calibration", &calibration).0, 422);
    // Wider than the room that the map covers: only the configuration tells.
    calibration["doorway"]["width_m"] = json!(3.5);
    let (_, check) = running.send("POST", "/api/v1/calibration/check", &calibration);
    assert_eq!(check["ok"], false, "{check}");
    assert_eq!(running.get("/api/v1/recording").0, 200);
    assert_eq!(running.get("/livez").0, 200);
    assert_eq!(running.terminate().1, Some(0));
}

#[test]
fn a_calibration_that_has_changed_since_is_not_overwritten() {
    let recording = camera_recording(3);
    let file = recording.path().join("calibration.json");
    let source = format!("replay:{},loop", recording.path().display());
    let running = Daemon::start(&source, &["--calibration", file.to_str().unwrap()]);
    running.wait_for("a frame", |s| s["frames"]["captured"].as_u64() > Some(0));
    let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
    let path = format!("{}/api/v1/calibration", running.url);
    let tag = agent.get(&path).call().unwrap().headers()["etag"].clone();
    let mut calibration = running.json("/api/v1/calibration")["calibration"].clone();
    let mut put = |tag: &str, width: f64| {
        calibration["doorway"]["width_m"] = json!(width);
        let answer = agent.put(&path).header("if-match", tag).send_json(&calibration).unwrap();
        (answer.status().as_u16(), answer.headers().get("etag").cloned())
    };
    let (status, next) = put(tag.to_str().unwrap(), 0.51);
    let next = next.expect("the answer has the tag of what is in use now");
    assert!(status == 200 && next != tag);
    assert_eq!(put(tag.to_str().unwrap(), 0.52).0, 412, "another client's change would be lost");
    assert_eq!(put(next.to_str().unwrap(), 0.53).0, 200);
    assert_eq!(put("*", 0.54).0, 200);
    assert_eq!(running.json("/api/v1/calibration")["calibration"]["doorway"]["width_m"], 0.54);
}

/// Names that people give, and some that only look like names.
const NAMES: [&str; 16] = [
    "bed",
    "Bed",
    "a b",
    "a_b",
    "Küche",
    "Kuche",
    "Спальня",
    "Кабинет",
    "寝室",
    "👩‍👩‍👧",
    "",
    "   ",
    "a\nb",
    "\u{202e}x",
    "_",
    "=1+1",
];

#[test]
fn extreme_zones_get_one_verdict_and_identities_of_their_own() {
    let recording = camera_recording(3);
    let running = Daemon::start(&format!("replay:{},loop", recording.path().display()), &[]);
    let mut random = ChaCha8Rng::seed_from_u64(19);
    let rounds = if std::env::var_os("DOORCAM_TEST_FULL").is_some() { 10 * TRIED } else { TRIED };
    let (mut used, mut refused) = (0, 0);
    for _ in 0..rounds {
        let zone = |random: &mut ChaCha8Rng| {
            let mut polygon = json!([[-0.5, 0.5], [0.5, 0.5], [0.5, 1.5], [-0.5, 1.5]]);
            if random.next_u32().is_multiple_of(3) {
                distort(&mut polygon, random);
            }
            let long = if random.next_u32().is_multiple_of(12) { 5_000 } else { 1 };
            json!({"name": one_of(random, &NAMES).repeat(long), "polygon_m": polygon})
        };
        let count = one_of(&mut random, &[0, 1, 2, 3, 3, 200]);
        let zones: Vec<Value> = (0..count).map(|_| zone(&mut random)).collect();
        let (status, answer) = running.send("PUT", "/api/v1/zones", &json!({"zones": zones}));
        // JSON's strings and lists are TOML's, too.
        let table = |zone: &Value| format!("[[zones]]\nname = {}\npolygon_m = {}\n", zone["name"], zone["polygon_m"]);
        let configured = doorcam::config::Config::parse(&zones.iter().map(table).collect::<String>());
        let told = || format!("{zones:.2000?}\n{status} {answer:.500}\n{:?}", configured.as_ref().err());
        assert_eq!(running.get("/livez").0, 200, "{}", told());
        match status {
            200 => {
                assert!(configured.is_ok(), "{}", told());
                let now = running.json("/api/v1/zones")["zones"].clone();
                let of = |key: &str| now.as_array().unwrap().iter().map(|zone| zone[key].clone()).collect::<Vec<_>>();
                assert_eq!(of("name"), zones.iter().map(|zone| zone["name"].clone()).collect::<Vec<_>>(), "{}", told());
                let mut ids: Vec<String> = of("id").iter().map(|id| id.as_str().unwrap().into()).collect();
                let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
                assert!(ids.iter().all(|id| !id.is_empty() && id.chars().all(plain)), "{ids:?}");
                ids.sort();
                ids.dedup();
                assert_eq!(ids.len(), zones.len(), "{}", told());
                used += 1;
            }
            400 | 413 | 422 => {
                assert!(configured.is_err(), "{}", told());
                assert!(!answer["detail"].as_str().unwrap().contains('\n'), "{}", told());
                refused += 1;
            }
            _ => panic!("{}", told()),
        }
    }
    assert!(used > 0 && refused > 0, "{used} {refused}");
}

#[test]
fn zones_that_have_changed_since_are_not_overwritten() {
    let recording = camera_recording(3);
    let running = Daemon::start(&format!("replay:{},loop", recording.path().display()), &[]);
    let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
    let path = format!("{}/api/v1/zones", running.url);
    let zone = |name: &str| json!({"zones": [{"name": name, "polygon_m": [[0, 1], [1, 1], [1, 2]]}]});
    let put = |tag: &str, name: &str| {
        let answer = agent.put(&path).header("if-match", tag).send_json(zone(name)).unwrap();
        (answer.status().as_u16(), answer.headers().get("etag").map(|tag| tag.to_str().unwrap().to_owned()))
    };
    let answer = agent.get(&path).call().unwrap();
    let first = answer.headers()["etag"].to_str().unwrap().to_owned();
    let (status, second) = put(&first, "bed");
    let second = second.expect("the answer has the tag of the new zones");
    assert!(status == 200 && second != first);
    assert_eq!(put(&first, "sofa").0, 412);
    assert_eq!(agent.delete(&path).header("if-match", &first).call().unwrap().status(), 412);
    assert_eq!(put(&second, "sofa").0, 200);
    assert_eq!(running.json("/api/v1/zones")["zones"][0]["name"], "sofa");
}
