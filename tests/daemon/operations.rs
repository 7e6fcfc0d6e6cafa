//! What administrators rely on: the service manager's protocol, logs for programs, manual pages, completions.

use crate::common;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::net::UnixDatagram;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{Daemon, doorcam, grey_recording, manifest, run};

/// The test in the role of the service manager, with its notification socket.
struct Manager {
    dir: tempfile::TempDir,
    socket: UnixDatagram,
}

impl Manager {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let socket = UnixDatagram::bind(dir.path().join("notify")).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        Self { dir, socket }
    }

    fn start(&self, source: &str, watchdog: Duration) -> Daemon {
        let mut command = doorcam(&["serve", "--source", source, "--listen", "127.0.0.1:0"]);
        command.env("NOTIFY_SOCKET", self.dir.path().join("notify"));
        command.env("WATCHDOG_USEC", watchdog.as_micros().to_string());
        Daemon::spawn(command)
    }

    /// The next message; none after the time limit.
    fn told(&self) -> Option<String> {
        let mut buffer = [0; 4096];
        let length = self.socket.recv(&mut buffer).ok()?;
        Some(String::from_utf8_lossy(&buffer[..length]).into_owned())
    }
}

#[test]
fn the_service_manager_hears_of_start_progress_and_end() {
    let recording = grey_recording(&manifest(), 6);
    let manager = Manager::new();
    let mut daemon = manager.start(&format!("replay:{},loop", recording.path().display()), Duration::from_millis(800));
    let ready = manager.told().unwrap();
    assert!(ready.contains("READY=1") && ready.contains("STATUS=watching replay:"), "{ready}");
    assert!(ready.contains(&daemon.url), "{ready}");
    for _ in 0..5 {
        assert_eq!(manager.told().unwrap().trim(), "WATCHDOG=1");
    }
    assert_eq!(daemon.terminate().1, Some(0));
    let last = std::iter::from_fn(|| manager.told()).find(|told| told.trim() != "WATCHDOG=1");
    assert_eq!(last.unwrap().trim(), "STOPPING=1");
}

#[test]
fn the_watchdog_goes_hungry_when_no_more_frames_come() {
    let recording = grey_recording(&manifest(), 6);
    let manager = Manager::new();
    let daemon = manager.start(&format!("replay:{}", recording.path().display()), Duration::from_millis(200));
    daemon.wait_for("the end", |s| s["source"]["state"] == "ended");
    // Notifications sent before the end may still be queued.
    manager.socket.set_read_timeout(Some(Duration::from_millis(400))).unwrap();
    let until = Instant::now() + Duration::from_secs(20);
    while manager.told().is_some() {
        assert!(Instant::now() < until, "still fed");
    }
    assert_eq!(daemon.get("/livez").0, 200, "the process still answers");
}

#[cfg(target_env = "gnu")]
#[test]
fn memory_is_handed_back_with_or_without_the_service_manager() {
    let unit = include_str!("../../packaging/systemd/doorcam.service");
    let (_, settings) = unit.split_once("Environment=MALLOC_MMAP").expect("the unit's settings");
    let settings: Vec<_> =
        format!("MALLOC_MMAP{settings}").lines().next().unwrap().split(' ').map(String::from).collect();
    assert_eq!(settings.len(), 2, "{settings:?}");
    let recording = grey_recording(&manifest(), 6);
    let source = format!("replay:{},loop", recording.path().display());
    let start = |own: Option<(&str, &str)>| {
        let mut command = doorcam(&["serve", "--source", &source, "--listen", "127.0.0.1:0"]);
        command.env_remove("MALLOC_MMAP_THRESHOLD_").env_remove("MALLOC_ARENA_MAX").envs(own);
        Daemon::spawn(command)
    };
    let environment = |daemon: &Daemon| -> Vec<String> {
        let bytes = std::fs::read(format!("/proc/{}/environ", daemon.id())).unwrap();
        bytes.split(|&byte| byte == 0).map(|each| String::from_utf8_lossy(each).into_owned()).collect()
    };
    let found = environment(&start(None));
    assert!(settings.iter().all(|setting| found.contains(setting)), "{settings:?} in {found:?}");
    // A setting that is already in the environment is kept.
    let found = environment(&start(Some(("MALLOC_ARENA_MAX", "7"))));
    assert!(found.contains(&settings[0]) && found.contains(&"MALLOC_ARENA_MAX=7".to_owned()), "{found:?}");
}

#[test]
fn logs_for_programs_are_an_object_a_line() {
    let recording = grey_recording(&manifest(), 3);
    let source = format!("replay:{}", recording.path().display());
    let arguments = ["serve", "--source", &source, "--listen", "127.0.0.1:0", "--log", "json"];
    let mut child = doorcam(&arguments).stderr(Stdio::piped()).spawn().unwrap();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut said = String::new();
    while !said.contains("the page is at") {
        assert!(stderr.read_line(&mut said).unwrap() > 0, "doorcam ended before it listened: {said}");
    }
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    stderr.read_to_string(&mut said).unwrap();
    assert!(child.wait().unwrap().success());
    let lines: Vec<serde_json::Value> = said.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    let messages: Vec<&str> = lines.iter().map(|line| line["message"].as_str().unwrap()).collect();
    assert!(messages[0].starts_with("watching replay:"), "{messages:?}");
    assert_eq!(*messages.last().unwrap(), "stopping");
    assert!(lines.iter().all(|line| line["level"].is_string() && line["timestamp"].is_string()), "{said}");
}

#[test]
fn every_command_has_a_manual_page() {
    let dir = tempfile::tempdir().unwrap();
    let output = run(&["man", "--output", dir.path().to_str().unwrap()]);
    assert!(output.status.success(), "{}", common::stderr(&output));
    let help = String::from_utf8(run(&["help"]).stdout).unwrap();
    let commands = help.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap();
    // Continuation lines of descriptions are indented further.
    let names = commands.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names: Vec<&str> = names.filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.contains(&"serve") && names.contains(&"crb"), "{names:?}");
    for name in names.into_iter().filter(|&name| name != "help") {
        let page = std::fs::read_to_string(dir.path().join(format!("doorcam-{name}.1"))).expect(name);
        assert!(page.contains(".SH SYNOPSIS") && page.contains(".SH OPTIONS"), "{name}: {page}");
    }
    let page = String::from_utf8(run(&["man"]).stdout).unwrap();
    assert!(page.contains("doorcam\\-serve(1)") && page.contains(".SH NAME"), "{page}");
}

#[test]
fn shells_complete_commands_and_options() {
    for shell in ["bash", "zsh", "fish"] {
        let output = run(&["completions", shell]);
        let script = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && script.contains("evaluate") && script.contains("listen"), "{shell}");
    }
    // As bash calls it: with the words so far and the one being typed.
    let ask = "eval \"$(\"$1\" completions bash)\"; COMP_WORDS=(doorcam serv); COMP_CWORD=1; \
               _doorcam doorcam serv doorcam; echo \"${COMPREPLY[@]}\"";
    let output = Command::new("bash").args(["-c", ask, "ask", env!("CARGO_BIN_EXE_doorcam")]).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "serve", "{}", common::stderr(&output));
}
