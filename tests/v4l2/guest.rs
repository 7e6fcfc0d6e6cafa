//! Helpers for the scenarios: the machine's cameras, and a daemon that watches one of them.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::common::Daemon;

/// Whether this runs in the virtual machine, which sets the variable.
pub fn inside() -> bool {
    std::env::var("V4L2_VM").is_ok_and(|value| value == "1")
}

/// Skips a scenario outside the virtual machine, where it would use the host's cameras.
macro_rules! only_inside {
    () => {
        if !crate::guest::inside() {
            eprintln!("SKIPPED: this scenario only runs in the virtual machine");
            return;
        }
    };
}
pub(crate) use only_inside;

/// A temporary storage directory with a configuration in it: the given lines below `[camera]`, a short settling time
/// and a coarse map.
pub fn configured(camera: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("doorcam.toml");
    let coarse = "[grid]\nangular_step_deg = 10.0\n[patch]\npixels = 16";
    let text =
        format!("[storage]\ndirectory = {:?}\n{coarse}\n[camera]\nsettle_s = 0.5\n{camera}\n", dir.path().join("kept"));
    fs::write(&file, text).unwrap();
    (dir, file)
}

/// A calibration as of a camera that looks down on a doorway, whatever it really sees.
pub fn calibration(size: [usize; 2]) -> Value {
    let [w, h] = size.map(|n| n as f64);
    let point = |u: f64, v: f64, x: f64, y: f64| json!({"pixel": [u * w, v * h], "floor_m": [x, y]});
    let [left, right, near, far] = [-0.5, 0.5, -0.1, -0.45];
    let points = [
        point(0.1, 0.1, left, near),
        point(0.9, 0.1, right, near),
        point(0.9, 0.9, right, far),
        point(0.1, 0.9, left, far),
    ];
    let doorway = json!({"width_m": 0.6, "wall_thickness_m": 0.1, "height_m": null});
    json!({"size": size, "doorway": doorway, "floor_points": points})
}

/// Seconds within which a fault is told and frames are back, however busy the machine beneath the virtual one is. How
/// long it took is printed; undisturbed it is a fraction of a second.
pub const SOON_S: f64 = 20.0;

/// A small image at a rate that an emulated processor can keep up with.
pub const SMALL: &str = "size = [320, 180]\nfps = 10";

/// A daemon that watches a camera.
pub struct Watching {
    pub daemon: Daemon,
    _kept: tempfile::TempDir,
}

impl Watching {
    /// Starts it without waiting for frames.
    pub fn start(source: &str, camera: &str) -> Self {
        let (kept, config) = configured(camera);
        let daemon = Daemon::start(source, &["--config", config.to_str().unwrap()]);
        Self { daemon, _kept: kept }
    }

    /// Starts it and waits for frames.
    pub fn streaming(source: &str, camera: &str) -> Self {
        let watching = Self::start(source, camera);
        watching.daemon.wait_for("frames", |s| s["source"]["state"] == "streaming" && s["frames"]["captured"] != 0);
        watching
    }

    pub fn status(&self) -> Value {
        self.daemon.json("/api/v1/status")
    }

    pub fn count(&self, what: &str) -> u64 {
        self.status()["frames"][what].as_u64().unwrap()
    }

    /// Waits for a state of the source. Returns how long that took and the status.
    pub fn until(&self, state: &str) -> (f64, Value) {
        let start = Instant::now();
        let status = self.daemon.wait_for(state, |s| s["source"]["state"] == state);
        (start.elapsed().as_secs_f64(), status)
    }

    /// Waits for new frames and returns how long that took.
    pub fn until_frames(&self) -> f64 {
        let (start, before) = (Instant::now(), self.count("captured"));
        self.daemon.wait_for("more frames", |s| {
            s["source"]["state"] == "streaming" && s["frames"]["captured"].as_u64().unwrap() > before
        });
        start.elapsed().as_secs_f64()
    }

    /// Resident memory in kB, and the number of open descriptors.
    pub fn resources(&self) -> [u64; 2] {
        let process = format!("/proc/{}", self.daemon.id());
        let status = fs::read_to_string(format!("{process}/status")).unwrap();
        let rss = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        let rss = rss.trim().trim_end_matches(" kB").parse().unwrap();
        [rss, fs::read_dir(format!("{process}/fd")).unwrap().count() as u64]
    }
}

/// Unplugs both of vivid's cameras, or plugs them in again.
pub fn vivid_is(plugged: bool) {
    let action = if plugged { "bind" } else { "unbind" };
    fs::write(format!("/sys/bus/platform/drivers/vivid/{action}"), "vivid.0").unwrap();
}

/// Control ids that make vivid fail (drivers/media/test-drivers/vivid/vivid-ctrls.c).
pub mod inject {
    pub const DROPPED_PERCENT: u32 = 0x00f0_f040;
    pub const DISCONNECT: u32 = 0x00f0_f041;
    pub const DAMAGED_BUFFER: u32 = 0x00f0_f042;
    pub const STREAMON_ERROR: u32 = 0x00f0_f045;
    pub const FATAL_ERROR: u32 = 0x00f0_f046;
}

pub fn set_control(node: &str, id: u32, value: i64) {
    let device = v4l::Device::with_path(node).unwrap();
    device.set_control(v4l::Control { id, value: v4l::control::Value::Integer(value) }).unwrap();
}

pub fn control(node: &str, id: u32) -> i64 {
    match v4l::Device::with_path(node).unwrap().control(id).unwrap().value {
        v4l::control::Value::Integer(value) => value,
        v4l::control::Value::Boolean(value) => i64::from(value),
        other => panic!("{other:?}"),
    }
}

/// A simulated USB webcam, plugged in.
pub struct Webcam {
    child: Child,
    pub node: String,
}

impl Webcam {
    pub fn plug_in() -> Self {
        Self::run(std::env::var("UVC_SIM").expect("UVC_SIM names the simulated webcam").as_ref())
    }

    /// The same webcam with a single size.
    pub fn plug_in_with_size(size: [u32; 2]) -> Self {
        let original = fs::read_to_string(std::env::var("UVC_SIM").unwrap()).unwrap();
        let sizes = "SIZES = [(640, 480), (320, 240)]";
        assert!(original.contains(sizes), "uvc-sim has changed");
        let other = std::env::temp_dir().join("uvc-sim-other");
        fs::write(&other, original.replace(sizes, &format!("SIZES = [({}, {})]", size[0], size[1]))).unwrap();
        Self::run(&other)
    }

    fn run(program: &Path) -> Self {
        let mut child = Command::new("python3")
            .arg(program)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut node = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut node).unwrap();
        let node = node.trim().to_owned();
        assert!(node.starts_with("/dev/video"), "uvc-sim did not come up: {node:?}");
        Self { child, node }
    }

    fn signal(&self, name: &str) {
        let killed = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status();
        assert!(killed.unwrap().success());
    }

    /// Stops the frames or resumes them.
    pub fn stall_or_go_on(&self) {
        self.signal("USR1");
    }

    /// Truncates the next JPEG.
    pub fn cut_a_frame(&self) {
        self.signal("USR2");
    }

    pub fn unplug(mut self) {
        self.signal("TERM");
        self.child.wait().unwrap();
        // The kernel removes the node with a delay.
        let deadline = Instant::now() + Duration::from_secs(10);
        while Path::new("/sys/class/video4linux").join(self.node.trim_start_matches("/dev/")).exists() {
            assert!(Instant::now() < deadline, "{} is still there", self.node);
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Webcam {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Keeps a node open so that a camera that comes back gets another number.
pub fn hold(node: &str) -> File {
    File::open(node).unwrap()
}

/// Prints a measurement.
pub fn measured(what: &str) {
    println!("measured: {what}");
}

/// Retries a failed check some times. A busy host can freeze the virtual machine for longer than a frame takes, and then the
/// driver itself drops frames.
pub fn unless_frozen(mut attempt: impl FnMut() -> Result<(), String>) {
    let mut failures = Vec::new();
    while failures.len() < 8 {
        match attempt() {
            Ok(()) => return,
            Err(failure) => {
                measured(&format!("retrying because frames were lost: {failure}"));
                failures.push(failure);
            }
        }
    }
    panic!("failed each time: {failures:?}");
}

/// Copies a recording to the host, which is much faster.
pub fn hand_out(recording: &Path) {
    let out = std::env::var_os("V4L2_VM_OUT").expect("V4L2_VM_OUT names the directory for results");
    assert!(Command::new("cp").arg("-R").arg(recording).arg(out).status().unwrap().success());
}
