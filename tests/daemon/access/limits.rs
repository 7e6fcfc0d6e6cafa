//! Clients that are slow, send too much or are too many are turned away, and others are served meanwhile.

use std::io::{Read, Write};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::client::{Answer, Guarded, answer, connect, exchange};
use crate::common::memory::{resident_kb, settled_kb};

#[test]
fn who_sends_slowly_or_nothing_is_cut_off_and_others_are_served_meanwhile() {
    let doorcam = Guarded::start(&[]);
    let address = doorcam.address();
    let begin = Instant::now();
    // No request at all, a head that never ends, and a whole request followed by silence.
    let starts = [
        "",
        "GET /api/v1/status HTTP/1.1\r\nHost: 127.0.0.1\r\nX-A: ",
        "GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    ];
    let slow: Vec<_> = (0..60)
        .map(|k| {
            let mut stream = connect(address);
            stream.write_all(starts[k % 3].as_bytes()).unwrap();
            std::thread::spawn(move || {
                // One byte a second, as over a slow line.
                let mut sender = stream.try_clone().unwrap();
                if k % 3 == 1 {
                    std::thread::spawn(move || {
                        while sender.write_all(b"a").is_ok() {
                            std::thread::sleep(Duration::from_secs(1));
                        }
                    });
                }
                // Read to the end of the connection; a timeout means that it is still open.
                match stream.read_to_end(&mut Vec::new()) {
                    Ok(_) => {}
                    Err(e) => assert_eq!(e.kind(), std::io::ErrorKind::ConnectionReset, "still open: {e}"),
                }
            })
        })
        .collect();
    while slow.iter().any(|client| !client.is_finished()) {
        assert_eq!(doorcam.ask("GET", "/api/v1/status", &[]).status, 200);
        assert!(begin.elapsed() < Duration::from_secs(55), "slow clients are still connected");
        std::thread::sleep(Duration::from_millis(200));
    }
    slow.into_iter().for_each(|client| client.join().unwrap());
}

#[test]
fn a_body_that_does_not_come_is_given_up() {
    let doorcam = Guarded::start(&[]);
    let mut stream = connect(doorcam.address());
    let head = "POST /api/v1/calibration/check HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\
                Content-Length: 100\r\n\r\n{";
    stream.write_all(head.as_bytes()).unwrap();
    let refused = answer(&mut stream).expect("an answer");
    assert_eq!(refused.status, 408);
    refused.problem();
}

#[test]
fn a_body_that_is_cut_off_is_malformed_and_not_too_large() {
    let doorcam = Guarded::start(&[]);
    let head = "POST /api/v1/calibration/check HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n";
    for rest in [
        "Content-Length: 100\r\n\r\n{",
        "Transfer-Encoding: chunked\r\n\r\n5\r\n{\"a\"",
        "Transfer-Encoding: chunked\r\n\r\nfive\r\n{\"a\":\r\n0\r\n\r\n",
    ] {
        let mut stream = connect(doorcam.address());
        stream.write_all(format!("{head}{rest}").as_bytes()).unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        let refused = answer(&mut stream).expect("an answer");
        assert_eq!(refused.status, 400, "{rest}");
        assert!(refused.problem()["detail"].as_str().unwrap().contains("cut off"), "{refused:?}");
    }
}

/// Sends two megabytes of spaces, with their length in front or in one chunk.
fn send_spaces(address: SocketAddr, method: &str, path: &str, body: &str, chunked: bool) -> Answer {
    let (length, end) = match chunked {
        false => (format!("Content-Length: {}\r\n\r\n", body.len()), ""),
        true => (format!("Transfer-Encoding: chunked\r\n\r\n{:x}\r\n", body.len()), "\r\n0\r\n\r\n"),
    };
    let mut stream = connect(address);
    let head = format!("{method} {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{length}");
    for part in [&head, body, end] {
        // After an early refusal the connection may already be closed, but the answer is still there.
        let _ = stream.write_all(part.as_bytes());
    }
    answer(&mut stream).expect("an answer")
}

#[test]
fn many_large_bodies_are_answered_and_leave_no_memory_behind() {
    let doorcam = Guarded::start(&[]);
    let (address, id) = (doorcam.address(), doorcam.daemon.id());
    let routes = [
        ("PUT", "/api/v1/zones"),
        ("PUT", "/api/v1/calibration"),
        ("POST", "/api/v1/calibration/check"),
        ("POST", "/api/v1/session"),
    ];
    let body = " ".repeat(2 * 1024 * 1024);
    for (method, path) in routes {
        send_spaces(address, method, path, &body, false);
    }
    let before_kb = settled_kb(&doorcam.daemon);
    let (most_kb, over) = (AtomicU64::new(0), AtomicBool::new(false));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                most_kb.fetch_max(resident_kb(id), Ordering::Relaxed);
                assert!(is_served(&doorcam));
            }
        });
        let clients: Vec<_> = (0..120)
            .map(|k| {
                let (body, (method, path)) = (&body, routes[k % 4]);
                scope.spawn(move || {
                    let answer = send_spaces(address, method, path, body, k % 8 < 4);
                    // Nothing but spaces, or too many at the same time; or too long for the route.
                    let expected: &[u16] = if path.contains("calibration") { &[400, 503] } else { &[413] };
                    assert!(expected.contains(&answer.status), "{path}: {answer:?}");
                    assert_eq!(answer.header("retry-after").is_some(), answer.status == 503, "{answer:?}");
                    answer.problem();
                })
            })
            .collect();
        clients.into_iter().for_each(|client| client.join().unwrap());
        over.store(true, Ordering::Relaxed);
    });
    // 16 MB of bodies, and as much again for buffers and threads; with every body in memory it would be 240 MB.
    let most_kb = most_kb.into_inner();
    assert!(most_kb < before_kb + 40 * 1024, "{before_kb} kB before, {most_kb} kB at most");
    let deadline = Instant::now() + Duration::from_secs(60);
    while resident_kb(id) > before_kb + 10 * 1024 {
        assert!(Instant::now() < deadline, "{before_kb} kB before, {} kB after", resident_kb(id));
        std::thread::sleep(Duration::from_millis(200));
    }
}

#[test]
fn a_refusal_leaves_its_connection_usable_or_says_that_it_ends() {
    let doorcam = Guarded::start(&[]);
    let foreign = "POST /api/v1/background/reset HTTP/1.1\r\nHost: localhost\r\nOrigin: http://evil.example\r\n";
    let mut stream = connect(doorcam.address());
    stream.write_all(format!("{foreign}Content-Length: 2\r\n\r\n").as_bytes()).unwrap();
    // Long enough for a server that would refuse without the body.
    std::thread::sleep(Duration::from_millis(100));
    stream.write_all(b"{}GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    let mut both = String::new();
    stream.read_to_string(&mut both).unwrap();
    assert!(both.starts_with("HTTP/1.1 403 ") && both.ends_with("alive\n"), "{both}");
    for body in ["Content-Length: 100000\r\n\r\n{", "Transfer-Encoding: chunked\r\n\r\n1\r\n{\r\n"] {
        let refused = exchange(doorcam.address(), &format!("{foreign}{body}"));
        assert_eq!((refused.status, refused.header("connection")), (403, Some("close")), "{body}");
    }
}

#[test]
fn a_client_that_asks_first_is_refused_before_it_sends() {
    let doorcam = Guarded::start(&[]);
    let refused = exchange(
        doorcam.address(),
        "PUT /api/v1/zones HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nExpect: 100-continue\r\n\
         Content-Length: 2097152\r\n\r\n",
    );
    assert_eq!(refused.status, 413);
    let mut stream = connect(doorcam.address());
    let head = "PUT /api/v1/zones HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nExpect: 100-continue\r\n\
                Content-Length: 12\r\n\r\n";
    stream.write_all(head.as_bytes()).unwrap();
    let mut word = [0; 25];
    stream.read_exact(&mut word).unwrap();
    assert_eq!(&word, b"HTTP/1.1 100 Continue\r\n\r\n");
    stream.write_all(b"{\"zones\":[]}").unwrap();
    assert_eq!(answer(&mut stream).expect("an answer").status, 200);
}

#[test]
fn a_thousand_connections_that_ask_for_nothing_keep_nobody_out() {
    let doorcam = Guarded::configured("[server]\nmax_connections_per_address = 20\n", &[]);
    let address = doorcam.address();
    let mut socket = doorcam.daemon.live();
    let starts = [
        "",
        "GET",
        "GET /livez HTTP/1.1\r\nHost: localhost\r\nX-A: ",
        "GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ];
    let mut idle = std::collections::VecDeque::new();
    for k in 0..1000 {
        let mut stream = connect(address);
        // It may be gone already.
        let _ = stream.write_all(starts[k % 4].as_bytes());
        idle.push_back(stream);
        // They stay open on this side, as far as this process may have files.
        if idle.len() > 400 {
            idle.pop_front();
        }
        if k % 50 == 49 {
            assert!(is_served(&doorcam), "after {k}");
        }
    }
    // Who uses a connection keeps it.
    loop {
        match socket.read().expect("the live socket is still open") {
            tungstenite::Message::Text(_) => break,
            _ => continue,
        }
    }
}

#[test]
fn large_requests_are_refused() {
    let doorcam = Guarded::start(&[]);
    let address = doorcam.address();
    for path in ["/api/v1/calibration/check", "/api/v1/background/reset"] {
        let refused = doorcam.send("POST", path, &[], &" ".repeat(2049 * 1024));
        assert_eq!(refused.status, 413, "{path}");
        refused.problem();
    }
    let chunks = format!("{:x}\r\n{}\r\n", 8192, " ".repeat(8192)).repeat(257);
    let head = "POST /api/v1/calibration/check HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n";
    assert_eq!(exchange(address, &format!("{head}Transfer-Encoding: chunked\r\n\r\n{chunks}0\r\n\r\n")).status, 413);
    // Too many headers, then one that is too long.
    let get = "GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n";
    let flood: String = (0..200).map(|k| format!("X-{k}: a\r\n")).collect();
    assert_eq!(exchange(address, &format!("{get}{flood}\r\n")).status, 431);
    let long = format!("{get}X-A: {}\r\n\r\n", "a".repeat(20_000));
    assert_eq!(exchange(address, &long).status, 431);
    let usual: String = (0..40).map(|k| format!("X-{k}: {}\r\n", "a".repeat(200))).collect();
    assert_eq!(exchange(address, &format!("{get}{usual}\r\n")).status, 200);
}

/// Whether a connection is served.
fn is_served(doorcam: &Guarded) -> bool {
    let mut stream = connect(doorcam.address());
    let sent = stream.write_all(b"GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    sent.is_ok() && answer(&mut stream).is_some_and(|answer| answer.status == 200)
}

#[test]
fn one_address_takes_its_share_of_connections_and_no_more() {
    for config in ["max_connections_per_address = 5", "max_connections = 5"] {
        let doorcam = Guarded::configured(&format!("[server]\n{config}\n"), &[]);
        // Live sockets count until they are closed.
        let sockets: Vec<_> = (0..5).map(|_| doorcam.daemon.live()).collect();
        assert!(!is_served(&doorcam), "{config}");
        drop(sockets);
        let deadline = Instant::now() + Duration::from_secs(30);
        while !is_served(&doorcam) {
            assert!(Instant::now() < deadline, "{config}: closed connections still count");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

#[test]
fn a_client_that_takes_no_bytes_is_cut_off() {
    let doorcam = Guarded::configured("[server]\nmax_connections = 1\n", &[]);
    let address = doorcam.address();
    let mut stream = connect(address);
    // Ask for far more than the buffers in between can hold, and read none of it.
    let ask = "GET /app.js HTTP/1.1\r\nHost: localhost\r\n\r\n".repeat(2000);
    stream.set_write_timeout(Some(Duration::from_secs(2))).unwrap();
    let _ = stream.write_all(ask.as_bytes());
    let begin = Instant::now();
    while !is_served(&doorcam) {
        assert!(begin.elapsed() < Duration::from_secs(55), "it still holds the only connection");
        std::thread::sleep(Duration::from_millis(200));
    }
}
