//! Real V4L2 drivers in a virtual machine: camera failures from unplugging to a full disk.
//!
//! V4L2_VM names a program that runs another one in a virtual machine with the kernel's test driver vivid at
//! /dev/video0 and /dev/video1; beside it is uvc-sim, which plugs in a simulated USB webcam. This test program runs
//! itself there. Each `guest_` test is one scenario, and times are the guest's.
#![cfg(feature = "v4l2")]

#[path = "../common/mod.rs"]
mod common;
mod guest;
mod live;
mod record;
mod uvc;
mod vivid;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

/// Runs all `guest_` tests in one virtual machine, because booting takes longer than most of them.
#[test]
fn cameras_in_a_virtual_machine() {
    if guest::inside() {
        return;
    }
    let Some(tool) = std::env::var_os("V4L2_VM").map(PathBuf::from) else {
        eprintln!("SKIPPED: no virtual machine with cameras (set V4L2_VM to the program that runs one)");
        return;
    };
    let webcam = tool.parent().unwrap_or(Path::new(".")).join("uvc-sim");
    // V4L2_TEST selects a single scenario by name.
    let only = std::env::var("V4L2_TEST").unwrap_or_else(|_| "guest_".into());
    let handed_out = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let seconds = || start.elapsed().as_secs_f64();
    let mut child = Command::new(&tool)
        .args(["--time", "2700", "--out"])
        .arg(handed_out.path())
        .arg(std::env::current_exe().unwrap())
        .args(["--ignored", "--test-threads=1", "--nocapture", &only])
        .env("UVC_SIM", webcam)
        .env("RUST_BACKTRACE", "0")
        .stdout(Stdio::piped())
        .spawn()
        .unwrap_or_else(|e| panic!("{}: {e}", tool.display()));
    // Print the output as it arrives, so that a long run shows its progress.
    for line in BufReader::new(child.stdout.take().unwrap()).lines() {
        println!("{:6.1} {}", seconds(), line.unwrap());
    }
    let status = child.wait().unwrap();
    println!("measured: the virtual machine ran for {:.0} s", seconds());
    assert!(status.success(), "{status}: see above what failed in the virtual machine");
    if only == "guest_" {
        record::reconstruct_what_was_recorded(handed_out.path());
    }
}
