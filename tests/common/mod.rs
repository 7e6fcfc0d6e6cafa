//! Helpers shared by several test files: reference data, generated recordings, the real binary.
// Each test file uses only a part of it.
#![allow(dead_code)]

pub mod memory;
#[path = "../reference/mod.rs"]
mod reference;

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use doorcam_core::optics::{FloorPoint, Transfer};
use doorcam_source::recording::{Layout, Manifest};

#[allow(unused_imports, reason = "each test program uses only a part")]
pub use self::reference::{data, published_doorway};

/// A manifest of patch images of the published doorway, 10 frames per second, with two frames of the empty room.
pub fn manifest() -> Manifest {
    Manifest {
        fps: 10.0,
        layout: Layout::Patches,
        transfer: Transfer::Linear,
        size: Some([16, 16]),
        doorway: published_doorway(),
        floor_points: Vec::new(),
        lens: None,
        fov_m: Some(0.15),
        background_frames: Some([0, 2]),
        notes: "made by a test".into(),
    }
}

/// A small JPEG of uniform grey.
pub const JPEG: &[u8] = include_bytes!("../../crates/doorcam-source/src/testdata/grey16.jpg");

/// A recording of `frames` identical JPEG pairs.
pub fn grey_recording(manifest: &Manifest, frames: usize) -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("temporary directory");
    manifest.write(dir.path()).expect("manifest");
    std::fs::create_dir(dir.path().join("frames")).expect("frames");
    for index in 0..frames {
        for side in ["left", "right"] {
            std::fs::write(dir.path().join(format!("frames/{index:08}_{side}.jpg")), JPEG).expect("frame");
        }
    }
    dir
}

/// A camera recording of a uniformly grey floor. Outside the patches, its left edge has a different grey in each frame.
pub fn camera_recording(frames: u8) -> tempfile::TempDir {
    let corners = [[-0.4, 0.0], [0.4, 0.0], [-0.4, -0.4], [0.4, -0.4]];
    // 400 pixels per metre, seen from straight above.
    let see = |[x, y]: [f64; 2]| [320.0 + 400.0 * x, 40.0 - 400.0 * y];
    let manifest = Manifest {
        layout: Layout::Camera,
        size: Some([640, 240]),
        floor_points: corners.map(|floor_m| FloorPoint { pixel: see(floor_m), floor_m }).to_vec(),
        fov_m: None,
        ..manifest()
    };
    let dir = tempfile::tempdir().unwrap();
    manifest.write(dir.path()).unwrap();
    std::fs::create_dir(dir.path().join("frames")).unwrap();
    for index in 0..frames {
        let grey = |x: u32| if x < 64 { 40 + 30 * index } else { 120 };
        let image = image::RgbImage::from_fn(640, 240, |x, _| image::Rgb([grey(x); 3]));
        image.save(dir.path().join(format!("frames/{index:08}.jpg"))).unwrap();
    }
    dir
}

/// The program with its arguments. Tokens in the environment of the test run are removed.
pub fn doorcam<S: AsRef<std::ffi::OsStr>>(arguments: &[S]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_doorcam"));
    command.args(arguments).stdin(Stdio::null()).env_remove("DOORCAM_TOKEN").env_remove("DOORCAM_READ_TOKEN");
    command
}

/// Runs the program until it exits.
pub fn run<S: AsRef<std::ffi::OsStr>>(arguments: &[S]) -> Output {
    doorcam(arguments).output().expect("the program starts")
}

/// What a program wrote to stderr.
pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("UTF-8")
}

/// A running `doorcam serve`; it is killed when dropped.
pub struct Daemon {
    child: Child,
    /// `http://ADDRESS:PORT`
    pub url: String,
    log: Arc<Mutex<String>>,
}

impl Daemon {
    /// Starts it on a free port and waits until it logs its address.
    pub fn start(source: &str, more: &[&str]) -> Self {
        let mut command = doorcam(&["serve", "--source", source, "--listen", "127.0.0.1:0"]);
        command.args(more);
        Self::spawn(command)
    }

    /// Runs a command that becomes a `doorcam serve` and waits until it logs its address.
    pub fn spawn(mut command: Command) -> Self {
        let mut child = command.stderr(Stdio::piped()).spawn().expect("the program starts");
        let mut stderr = BufReader::new(child.stderr.take().expect("piped"));
        let mut said = String::new();
        while !said.contains("the page is at http") {
            let mut line = String::new();
            if stderr.read_line(&mut line).expect("readable") == 0 {
                panic!("doorcam exited before it listened: {said}");
            }
            said.push_str(&line);
        }
        let url = said.split_whitespace().find(|word| word.starts_with("http")).expect("an address").to_owned();
        let log = Arc::new(Mutex::new(said));
        let more = Arc::clone(&log);
        // Keep reading, or the program would block on a full pipe.
        std::thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                more.lock().expect("unpoisoned").push_str(&format!("{line}\n"));
            }
        });
        Self { child, url, log }
    }

    /// The process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal, given by its name without SIG.
    pub fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().expect("kill").success());
    }

    /// What it has written to stderr so far.
    pub fn log(&self) -> String {
        self.log.lock().expect("unpoisoned").clone()
    }

    /// Waits until the log contains a text. The log comes through a pipe and may arrive after the answer it belongs to.
    pub fn wait_for_log(&self, said: &str) {
        let deadline = Instant::now() + Duration::from_secs(600);
        while !self.log().contains(said) {
            assert!(Instant::now() < deadline, "waited in vain for \"{said}\" in the log: {}", self.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Status code and body of a GET request.
    pub fn get(&self, path: &str) -> (u16, Vec<u8>) {
        let agent: ureq::Agent = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .timeout_global(Some(Duration::from_secs(20)))
            .build()
            .into();
        let mut response = agent.get(format!("{}{path}", self.url)).call().expect("an answer");
        let mut body = Vec::new();
        response.body_mut().as_reader().read_to_end(&mut body).expect("a body");
        (response.status().as_u16(), body)
    }

    /// Status code and JSON of the answer to a request with a JSON body; null if the answer has none.
    pub fn send(&self, method: &str, path: &str, body: &serde_json::Value) -> (u16, serde_json::Value) {
        let agent: ureq::Agent = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .timeout_global(Some(Duration::from_secs(20)))
            .build()
            .into();
        let url = format!("{}{path}", self.url);
        let request = if method == "PUT" { agent.put(url) } else { agent.post(url) };
        let mut response = request.send_json(body).expect("an answer");
        let mut text = String::new();
        response.body_mut().as_reader().read_to_string(&mut text).expect("a body");
        (response.status().as_u16(), serde_json::from_str(&text).unwrap_or_default())
    }

    /// Status code and JSON of the answer to a DELETE request.
    pub fn delete(&self, path: &str) -> (u16, serde_json::Value) {
        let agent: ureq::Agent = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .timeout_global(Some(Duration::from_secs(20)))
            .build()
            .into();
        let mut response = agent.delete(format!("{}{path}", self.url)).call().expect("an answer");
        let mut text = String::new();
        response.body_mut().as_reader().read_to_string(&mut text).expect("a body");
        (response.status().as_u16(), serde_json::from_str(&text).unwrap_or_default())
    }

    /// The JSON answer of a GET request that must succeed.
    pub fn json(&self, path: &str) -> serde_json::Value {
        let (status, body) = self.get(path);
        assert_eq!(status, 200, "{path}: {}", String::from_utf8_lossy(&body));
        serde_json::from_slice(&body).expect("JSON")
    }

    /// Polls the status until it is as wanted.
    pub fn wait_for(&self, what: &str, wanted: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
        // Catches hangs, not slowness: a busy machine renders only a few frames per second.
        let deadline = Instant::now() + Duration::from_secs(900);
        loop {
            let status = self.json("/api/v1/status");
            if wanted(&status) {
                return status;
            }
            assert!(Instant::now() < deadline, "waited in vain for {what}: {status}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Polls the newest update until one is as wanted. Everything in one update is of the same moment, unlike a status
    /// and an update requested one after the other.
    pub fn wait_for_update(&self, what: &str, wanted: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
        let deadline = Instant::now() + Duration::from_secs(900);
        loop {
            let (status, body) = self.get("/api/v1/reconstruction");
            let update: serde_json::Value = serde_json::from_slice(&body).unwrap_or_default();
            if status == 200 && wanted(&update) {
                return update;
            }
            assert!(Instant::now() < deadline, "waited in vain for {what}: {update}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Opens the live socket.
    pub fn live(&self) -> tungstenite::WebSocket<std::net::TcpStream> {
        let address = self.url.trim_start_matches("http://");
        let stream = std::net::TcpStream::connect(address).expect("connects");
        stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a limit");
        tungstenite::client(format!("ws://{address}/api/v1/live"), stream).expect("upgrades").0
    }

    /// Sends SIGTERM, as a service manager does. Returns how long it took to exit and its exit status.
    pub fn terminate(&mut self) -> (Duration, Option<i32>) {
        let start = Instant::now();
        self.signal("TERM");
        let status = self.child.wait().expect("it ends");
        (start.elapsed(), status.code())
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // It may have exited already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
