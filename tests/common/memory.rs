//! The memory of a running doorcam, from the kernel.

use std::time::{Duration, Instant};

use super::Daemon;

/// Resident memory of a process, in kB.
pub fn resident_kb(id: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).expect("it runs");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("memory");
    line.trim().trim_end_matches(" kB").parse().expect("a number")
}

/// Resident memory in kB once the map is there and it no longer grows: what the map needs is set up beside the frames,
/// and takes more than most of what a test looks for.
pub fn settled_kb(daemon: &Daemon) -> u64 {
    daemon.wait_for("a map", |s| s["state"] == "watching");
    still_kb(daemon.id())
}

/// Resident memory of a process in kB once it hardly changes for two seconds.
pub fn still_kb(id: u32) -> u64 {
    let deadline = Instant::now() + Duration::from_secs(180);
    let (mut last_kb, mut still) = (resident_kb(id), 0);
    while still < 20 {
        assert!(Instant::now() < deadline, "it grows on and on");
        std::thread::sleep(Duration::from_millis(100));
        let now_kb = resident_kb(id);
        still = if now_kb.abs_diff(last_kb) < 1024 { still + 1 } else { 0 };
        last_kb = now_kb;
    }
    last_kb
}
