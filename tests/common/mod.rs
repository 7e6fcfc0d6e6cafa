//! What several test files need: reference data, recordings made on the spot, the real binary.
// Each test file uses a part of it.
#![allow(dead_code)]

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use doorcam::geometry::Doorway;
use doorcam::source::recording::{FloorPoint, Layout, Manifest, Transfer};

/// A path below the reference data, or none, saying so, if this machine does not have it.
pub fn data(path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("DOORCAM_DATA")
        .map(PathBuf::from)
        .unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"));
    let full = root.join(path);
    if full.exists() {
        return Some(full);
    }
    eprintln!("SKIPPED: no reference data at {} (set DOORCAM_DATA to have this tested)", full.display());
    None
}

/// A two-dimensional array of a NPY file (version 1, little-endian f64), as (rows, columns, values in row-major order).
pub fn npy(path: &Path) -> (usize, usize, Vec<f64>) {
    let bytes = std::fs::read(path).expect("readable NPY file");
    let header_len = u16::from_le_bytes([bytes[8], bytes[9]]) as usize;
    let header = std::str::from_utf8(&bytes[10..10 + header_len]).expect("ASCII header");
    assert!(header.contains("'<f8'"), "{header}");
    let fortran = header.contains("'fortran_order': True");
    let shape: Vec<usize> = header
        .split("'shape': (")
        .nth(1)
        .and_then(|s| s.split(')').next())
        .expect("shape")
        .split(',')
        .filter_map(|n| n.trim().parse().ok())
        .collect();
    let (rows, columns) = (shape[0], shape[1]);
    let raw: Vec<f64> =
        bytes[10 + header_len..].chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("8 bytes"))).collect();
    assert_eq!(raw.len(), rows * columns);
    if !fortran {
        return (rows, columns, raw);
    }
    (rows, columns, (0..rows * columns).map(|k| raw[(k % columns) * rows + k / columns]).collect())
}

/// An array of little-endian f32 of an NPZ file (a ZIP archive of NPY files), as (shape, values in row-major order).
pub fn npz_f32(path: &Path, name: &str) -> (Vec<usize>, Vec<f32>) {
    let bytes = std::fs::read(path).expect("readable NPZ file");
    let u16_at = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let u32_at = |at: usize| u16_at(at) | u16_at(at + 2) << 16;
    // The end record tells where the central directory is, and that where each file is.
    let end = (0..bytes.len() - 21).rev().find(|&k| bytes[k..].starts_with(b"PK\x05\x06")).expect("a ZIP archive");
    let mut entry = u32_at(end + 16);
    for _ in 0..u16_at(end + 10) {
        let (name_len, rest) = (u16_at(entry + 28), u16_at(entry + 30) + u16_at(entry + 32));
        if &bytes[entry + 46..entry + 46 + name_len] == format!("{name}.npy").as_bytes() {
            let (packed, local) = (u32_at(entry + 20), u32_at(entry + 42));
            let start = local + 30 + u16_at(local + 26) + u16_at(local + 28);
            let mut npy = Vec::new();
            let deflated = &bytes[start..start + packed];
            flate2::read::DeflateDecoder::new(deflated).read_to_end(&mut npy).expect("deflated data");
            let data = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
            let header = std::str::from_utf8(&npy[10..data]).expect("ASCII header");
            assert!(header.contains("'<f4'") && header.contains("'fortran_order': False"), "{header}");
            let shape = header.split("'shape': (").nth(1).and_then(|s| s.split(')').next()).expect("shape");
            let shape = shape.split(',').filter_map(|n| n.trim().parse().ok()).collect();
            let values = npy[data..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().expect("4 bytes")));
            return (shape, values.collect());
        }
        entry += 46 + name_len + rest;
    }
    panic!("{} has no {name}", path.display());
}

/// The published doorway: 20 inches wide, a thin wall.
pub fn published_doorway() -> Doorway {
    Doorway { width_m: 0.508, wall_thickness_m: 0.0, height_m: None }
}

/// A manifest of patch images of the published doorway, 10 frames a second, with two frames of the empty room.
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

/// A small JPEG, all of one grey.
pub const JPEG: &[u8] = include_bytes!("../../src/source/testdata/grey16.jpg");

/// A recording of `frames` equal JPEG pairs.
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

/// A camera's recording of a floor of one grey; beside the patches, its left end has another grey in each frame.
pub fn camera_recording(frames: u8) -> tempfile::TempDir {
    let corners = [[-0.4, 0.0], [0.4, 0.0], [-0.4, -0.4], [0.4, -0.4]];
    // 400 pixels a metre, from straight above.
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

/// The program, with its arguments; the tokens of whoever runs the tests are not its own.
pub fn doorcam<S: AsRef<std::ffi::OsStr>>(arguments: &[S]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_doorcam"));
    command.args(arguments).stdin(Stdio::null()).env_remove("DOORCAM_TOKEN").env_remove("DOORCAM_READ_TOKEN");
    command
}

/// Runs the program to its end.
pub fn run<S: AsRef<std::ffi::OsStr>>(arguments: &[S]) -> Output {
    doorcam(arguments).output().expect("the program starts")
}

/// What a program said on stderr.
pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("UTF-8")
}

/// A running `doorcam serve`; it is ended with the test.
pub struct Daemon {
    child: Child,
    /// `http://ADDRESS:PORT`
    pub url: String,
    log: Arc<Mutex<String>>,
}

impl Daemon {
    /// Starts it on a free port and waits until it says where.
    pub fn start(source: &str, more: &[&str]) -> Self {
        let mut command = doorcam(&["serve", "--source", source, "--listen", "127.0.0.1:0"]);
        command.args(more);
        Self::spawn(command)
    }

    /// Starts a command that becomes a `doorcam serve` and waits until it says where it listens.
    pub fn spawn(mut command: Command) -> Self {
        let mut child = command.stderr(Stdio::piped()).spawn().expect("the program starts");
        let mut stderr = BufReader::new(child.stderr.take().expect("piped"));
        let mut said = String::new();
        while !said.contains("the page is at http") {
            let mut line = String::new();
            if stderr.read_line(&mut line).expect("readable") == 0 {
                panic!("doorcam ended before it listened: {said}");
            }
            said.push_str(&line);
        }
        let url = said.split_whitespace().find(|word| word.starts_with("http")).expect("an address").to_owned();
        let log = Arc::new(Mutex::new(said));
        let more = Arc::clone(&log);
        // Somebody must go on reading, or the program would block on a full pipe.
        std::thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                more.lock().expect("unpoisoned").push_str(&format!("{line}\n"));
            }
        });
        Self { child, url, log }
    }

    /// The process.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends it a signal, by its name without SIG.
    pub fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().expect("kill").success());
    }

    /// What it has said on stderr so far.
    pub fn log(&self) -> String {
        self.log.lock().expect("unpoisoned").clone()
    }

    /// Waits until the log says something: it comes through a pipe, after the answer that it tells of.
    pub fn wait_for_log(&self, said: &str) {
        let deadline = Instant::now() + Duration::from_secs(60);
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

    /// Status code and JSON of the answer to a request with a JSON body; null where the answer has none.
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

    /// Asks for the status until it is as wanted.
    pub fn wait_for(&self, what: &str, wanted: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
        // For what hangs, not for what is slow: a machine with much else to do renders a few frames a second.
        let deadline = Instant::now() + Duration::from_secs(180);
        loop {
            let status = self.json("/api/v1/status");
            if wanted(&status) {
                return status;
            }
            assert!(Instant::now() < deadline, "waited in vain for {what}: {status}");
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

    /// Asks it to end, as a service manager does; returns how long that took and its exit status.
    pub fn terminate(&mut self) -> (Duration, Option<i32>) {
        let start = Instant::now();
        self.signal("TERM");
        let status = self.child.wait().expect("it ends");
        (start.elapsed(), status.code())
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
