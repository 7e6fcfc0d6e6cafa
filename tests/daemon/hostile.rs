//! Damaged or malicious input from outside is refused, and nothing panics, hangs or grows.

use crate::inputs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::common::memory::still_kb;
use crate::common::{Daemon, grey_recording, manifest};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Number of damaged versions made for each kind of file, and of damaged requests sent to a server. `scripts/test full`
/// makes and sends ten times as many.
const DAMAGED: u64 = 1_200;
const REQUESTS: u64 = 2_000;

fn full(count: u64) -> u64 {
    if std::env::var_os("DOORCAM_TEST_FULL").is_some() { 10 * count } else { count }
}

/// Bytes that often trip up parsers.
const ODD: [&[u8]; 14] = [
    b"-1",
    b"0",
    b"1e999",
    b"NaN",
    b"18446744073709551616",
    b"null",
    b"\"",
    b"}",
    b"]",
    b"\xff\xd9",
    b"\xff\xd8",
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\xf0\x9f\x9a\xaa",
];

/// Damages bytes in one to four places: flips, deletes, duplicates, replaces them by something odd, or truncates.
fn damage(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    for _ in 0..1 + random.next_u32() % 4 {
        let at = random.next_u32() as usize % (bytes.len() + 1);
        let to = (at + random.next_u32() as usize % 40).min(bytes.len());
        match random.next_u32() % 6 {
            0 if at < bytes.len() => bytes[at] ^= 1 << (random.next_u32() % 8),
            1 if at < bytes.len() => bytes[at] = random.next_u32() as u8,
            2 => drop(bytes.drain(at..to)),
            3 => {
                let part = bytes[at..to].to_vec();
                drop(bytes.splice(at..at, part));
            }
            4 => drop(bytes.splice(at..to, ODD[random.next_u32() as usize % ODD.len()].iter().copied())),
            _ if random.next_u32().is_multiple_of(8) => bytes.truncate(at),
            _ => {}
        }
    }
}

/// The corpus of a kind of input, sorted by file name.
fn corpus(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(&folder).expect("a corpus").map(|entry| entry.expect("a file").path()).collect();
    files.sort();
    files.into_iter().map(|file| (file.clone(), std::fs::read(file).expect("a file"))).collect()
}

#[test]
fn damaged_files_are_refused_and_nothing_else_happens() {
    for inputs::Input { name, take } in &inputs::INPUTS {
        let files = corpus(name);
        assert!(!files.is_empty(), "{name}");
        for (_, bytes) in &files {
            take(bytes);
        }
        for seed in 0..full(DAMAGED) {
            let mut bytes = files[seed as usize % files.len()].1.clone();
            damage(&mut bytes, &mut ChaCha8Rng::seed_from_u64(seed));
            if catch_unwind(AssertUnwindSafe(|| take(&bytes))).is_err() {
                panic!("{name}, seed {seed}: {}", String::from_utf8_lossy(&bytes));
            }
        }
    }
}

/// The number of files that a process has open, from the kernel.
fn open_files(id: u32) -> usize {
    std::fs::read_dir(format!("/proc/{id}/fd")).expect("it runs").count()
}

/// Sends bytes and reads the answer, if there is one, until the server closes the connection.
fn send(daemon: &Daemon, bytes: &[u8]) -> Vec<u8> {
    let mut stream = TcpStream::connect(daemon.url.trim_start_matches("http://")).expect("it listens");
    stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a limit");
    // The server may close the connection before it has read everything.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(std::net::Shutdown::Write);
    let mut answer = Vec::new();
    let _ = (&mut stream).take(1 << 20).read_to_end(&mut answer);
    answer
}

#[test]
fn damaged_requests_are_answered_and_the_server_stays_as_it_was() {
    let recording = grey_recording(&manifest(), 6);
    let daemon = Daemon::start(&format!("replay:{}", recording.path().display()), &[]);
    daemon.wait_for("the end", |s| s["source"]["state"] == "ended");
    let body = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/calibration/hall.json"));
    let body = body.expect("a calibration");
    let host = daemon.url.trim_start_matches("http://");
    let get = |path| format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    let mut requests: Vec<String> =
        ["/", "/api/v1/status", "/api/v1/tracks/1", "/api/v1/events?after=0&limit=5", "/metrics"].map(get).into();
    for path in ["/api/v1/calibration/check", "/api/v1/background/reset"] {
        let length = body.len();
        let head = "Content-Type: application/json\r\nConnection: close";
        requests
            .push(format!("POST {path} HTTP/1.1\r\nHost: {host}\r\n{head}\r\nContent-Length: {length}\r\n\r\n{body}"));
    }
    requests.push(format!(
        "GET /api/v1/live HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n\u{81}\u{5}hello"
    ));
    let attack = |seeds: std::ops::Range<u64>| {
        for seed in seeds {
            let mut bytes = requests[seed as usize % requests.len()].clone().into_bytes();
            damage(&mut bytes, &mut ChaCha8Rng::seed_from_u64(seed));
            let answer = send(&daemon, &bytes);
            let said = String::from_utf8_lossy(&answer[..answer.len().min(15)]).into_owned();
            assert!(!said.starts_with("HTTP/1.1 5"), "{seed}: {said} to {}", String::from_utf8_lossy(&bytes));
        }
    };
    // The first requests fill all caches and pools.
    attack(0..full(REQUESTS) / 4);
    let (before_kb, before_files) = (still_kb(daemon.id()), open_files(daemon.id()));
    attack(full(REQUESTS) / 4..full(REQUESTS));
    let (after_kb, after_files) = (still_kb(daemon.id()), open_files(daemon.id()));
    assert!(after_kb <= before_kb + 4096, "{before_kb} kB before, {after_kb} kB after");
    assert!(after_files <= before_files + 4, "{before_files} files before, {after_files} after");
    assert_eq!(daemon.get("/livez").0, 200);
    daemon.json("/api/v1/status");
}
