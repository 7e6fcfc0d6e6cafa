//! Latency of updates to 500 clients of the live socket at 15 updates a second: `cargo bench --bench live`.
//!
//! The real program replays a simulated doorway; the clients are threads of this program, on the same machine. The
//! latency runs from a frame's capture until a client has read the whole message, so it includes solving the frame and
//! the clients' own work. Exits with status 1 if the limit is exceeded.

use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Barrier;
use std::time::{Duration, Instant};

use jiff::Timestamp;
use tungstenite::Message;

const CLIENTS: usize = 500;
/// The scenario has 15 frames a second.
const SCENARIO: &str = "two-crossing";
const MEASURED: Duration = Duration::from_secs(20);
/// Limit that 99 of 100 deliveries must keep.
const LIMIT_MS: f64 = 100.0;

/// Kills the program when the measurement ends.
struct Daemon(Child);

impl Drop for Daemon {
    fn drop(&mut self) {
        // It may have exited already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// What one client has seen.
#[derive(Default)]
struct Followed {
    delays_ms: Vec<f64>,
    bytes: usize,
    missed: u64,
}

fn main() -> ExitCode {
    // `cargo test` runs it without `--bench`, only to check that it builds.
    if !std::env::args().any(|argument| argument == "--bench") {
        return ExitCode::SUCCESS;
    }
    let dir = tempfile::tempdir().expect("a directory");
    let recording = dir.path().join("recording");
    let made = doorcam().args(["simulate", SCENARIO]).arg(&recording).status().expect("doorcam starts");
    assert!(made.success());
    let source = format!("replay:{},loop", recording.display());
    // All clients come from one address.
    let config = dir.path().join("doorcam.toml");
    let limits = format!("[server]\nmax_connections = {0}\nmax_connections_per_address = {0}\n", CLIENTS + 10);
    std::fs::write(&config, limits).expect("writes");
    let config = config.to_str().expect("UTF-8");
    let serve = ["serve", "--source", &source, "--listen", "127.0.0.1:0", "--config", config];
    let mut daemon = Daemon(doorcam().args(serve).stderr(Stdio::piped()).spawn().expect("doorcam starts"));
    let mut said = BufReader::new(daemon.0.stderr.take().expect("piped")).lines().map_while(Result::ok);
    let address = said.find_map(|line| Some(line.split("http://").nth(1)?.trim().to_owned())).expect("its address");
    std::thread::spawn(move || said.for_each(drop));

    let connected = Barrier::new(CLIENTS);
    let seen: Vec<Followed> = std::thread::scope(|scope| {
        let client = || scope.spawn(|| follow(&address, &connected));
        let clients: Vec<_> = (0..CLIENTS).map(|_| client()).collect();
        clients.into_iter().map(|client| client.join().expect("a client")).collect()
    });

    let mut delays: Vec<f64> = seen.iter().flat_map(|client| client.delays_ms.iter().copied()).collect();
    delays.sort_by(f64::total_cmp);
    let at = |share: f64| delays[((delays.len() - 1) as f64 * share) as usize];
    let (bytes, missed) = (seen.iter().map(|s| s.bytes).sum::<usize>(), seen.iter().map(|s| s.missed).sum::<u64>());
    println!(
        "{CLIENTS} clients, {:.1} updates a second each of {:.1} kB, {missed} missed of {}",
        delays.len() as f64 / CLIENTS as f64 / MEASURED.as_secs_f64(),
        bytes as f64 / delays.len() as f64 / 1e3,
        delays.len() as u64 + missed,
    );
    println!("capture to client, ms: p50 {:.1}, p99 {:.1}, most {:.1}", at(0.5), at(0.99), at(1.0));
    if at(0.99) <= LIMIT_MS { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn doorcam() -> Command {
    Command::new(env!("CARGO_BIN_EXE_doorcam"))
}

/// Reads the live socket during the measurement, once all clients are connected.
fn follow(address: &str, connected: &Barrier) -> Followed {
    let stream = TcpStream::connect(address).expect("connects");
    let (mut socket, _) = tungstenite::client(format!("ws://{address}/api/v1/live"), stream).expect("upgrades");
    connected.wait();
    let (mut seen, begin) = (Followed::default(), Instant::now());
    // The first seconds are spent catching up.
    let settled = Duration::from_secs(2);
    while begin.elapsed() < settled + MEASURED {
        let Message::Text(text) = socket.read().expect("a message") else { continue };
        if begin.elapsed() < settled {
            continue;
        }
        let captured: Timestamp = after(&text, "\"time\":\"").expect("a time").parse().expect("RFC 3339");
        seen.delays_ms.push(Timestamp::now().duration_since(captured).as_secs_f64() * 1e3);
        seen.bytes += text.len();
        seen.missed += after(&text, "{\"missed\":").map_or(0, |count| count.parse().expect("a count"));
    }
    seen
}

/// The value after a key. Parsing whole messages would measure the clients instead.
fn after<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.split_once(key)?.1.split(['"', ',']).next()
}
