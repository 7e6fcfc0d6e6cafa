//! Clients that are slow, send too much or are too many are turned away, and others are served meanwhile.

use std::io::{Read, Write};
use std::time::{Duration, Instant};

use super::client::{Guarded, answer, connect, exchange};

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
