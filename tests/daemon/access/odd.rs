//! Requests that no honest client sends: each gets one answer of its own, and others are served meanwhile.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::client::{CONTROL, Guarded, answer, bearer, connect};
use crate::common::memory::{resident_kb, settled_kb};

/// The end of a head.
const END: &str = "Host: localhost\r\nConnection: close\r\n\r\n";

/// The status of the answer to a request that is sent as it is; `None` if the connection is closed without one.
fn status(doorcam: &Guarded, request: &[u8]) -> Option<u16> {
    let mut stream = connect(doorcam.address());
    let _ = stream.write_all(request);
    answer(&mut stream).map(|answer| answer.status)
}

#[test]
fn odd_requests_are_refused_and_never_an_internal_error() {
    let doorcam = Guarded::configured("", &[("DOORCAM_TOKEN", CONTROL)]);
    let token = bearer(CONTROL);
    let mut paths: Vec<String> = [
        "/%00",
        "/index.html%00.js",
        "/../Cargo.toml",
        "/..%2fCargo.toml",
        "/%2e%2e/Cargo.toml",
        "/%2e%2e%2fCargo.toml",
        "//etc/passwd",
        "/./../../../../etc/passwd",
        "/map/../../Cargo.toml",
        "/map",
        "/map/",
        "/api/v1/../../Cargo.toml",
        "/api/v1/tracks/%00",
        "/api/v1/tracks/-1",
        "/api/v1/tracks/99999999999999999999999",
        "/api/v1/tracks/1/2",
        "/api/v1/events?limit=1&limit=2",
        "/api/v1/events?after=1&after=1",
        "/api/v1/events?limit=0",
        "/api/v1/events?limit=99999999999999999999",
        "/api/v1/events?from=%00",
        "/api/v1/events?kind=%00",
        "/api/v1/events?%00=1",
        "/api/v1/events?limit=%zz",
        "/api/v1/occupancy?step=NaN",
        "/api/v1/occupancy?step=1e999",
        "/api/v1/stream.mjpg?fps=0",
        "/api/v1/stream.mjpg?fps=1&fps=2",
        "/api/v1/session?origin=a&origin=b",
        "/api/v1/live",
    ]
    .map(String::from)
    .into();
    paths.push(format!("/api/v1/events?x={}", "a".repeat(10_000)));
    for path in paths {
        let answer = doorcam.ask("GET", &path, &[("Authorization", &token)]);
        assert!((400..500).contains(&answer.status), "{path}: {answer:?}");
        answer.problem();
    }
    // What is not asked for with one meaning only is answered as if it had not been there.
    for (path, header) in [
        ("/app.js", ("Range", "bytes=0-0,1-1,2-2,3-3")),
        ("/app.js", ("Range", "bytes=18446744073709551615-")),
        ("/api/v1/events?zone=%00", ("Accept", "*/*")),
        ("/api/v1/events?zone=%ff%fe", ("Accept", ",;q=;,text/csv;;")),
        ("/api/v1/occupancy?from=-009998-01-01T00:00:00Z&step=1", ("Accept", "")),
        ("/api/v1/status?x=1&x=2", ("If-None-Match", ",,,\"")),
        ("/api/v1/geometry", ("If-None-Match", "W/")),
        ("/livez", ("Accept-Encoding", "gzip;q=9, *;q=-1, \u{fc}")),
        ("/api/v1/session", ("Cookie", "=;;;a=;=b; doorcam-=x")),
    ] {
        assert_eq!(doorcam.ask("GET", path, &[("Authorization", &token), header]).status, 200, "{path} {header:?}");
    }
    let huge = "a".repeat(64 * 1024);
    for request in [
        format!("GET /api/v1/status?x={huge} HTTP/1.1\r\n{END}"),
        format!("GET /api/v1/status HTTP/1.1\r\nAuthorization: Bearer {huge}\r\n{END}"),
        format!("GET /api/v1/status HTTP/1.1\r\nCookie: {}\r\n{END}", "a=b;".repeat(16_000)),
        format!("{huge} / HTTP/1.1\r\n{END}"),
        format!("GET /\0 HTTP/1.1\r\n{END}"),
        format!("GET / HTTP/9.9\r\n{END}"),
        format!("GET /livez HTTP/1.1\r\n folded: a\r\n{END}"),
        format!("GET /livez HTTP/1.1\r\nX-A : a\r\n{END}"),
        format!("PUT /api/v1/zones HTTP/1.1\r\nContent-Length: -1\r\n{END}"),
        format!("PUT /api/v1/zones HTTP/1.1\r\nContent-Length: 1\r\nContent-Length: 2\r\n{END}{{}}"),
        format!("PUT /api/v1/zones HTTP/1.1\r\nContent-Length: 99999999999999999999\r\n{END}{{}}"),
        format!("PUT /api/v1/zones HTTP/1.1\r\nTransfer-Encoding: gzip\r\n{END}{{}}"),
        "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".into(),
        format!("CONNECT localhost:80 HTTP/1.1\r\n{END}"),
        format!("OPTIONS * HTTP/1.1\r\n{END}"),
        format!("TRACE / HTTP/1.1\r\n{END}"),
        "\u{16}\u{3}\u{1}\u{2}\0\u{1}\0".into(),
    ] {
        let said = &request[..request.len().min(60)];
        let status = status(&doorcam, request.as_bytes());
        assert!(status.is_none_or(|status| (400..500).contains(&status)), "{said}: {status:?}");
        assert_eq!(doorcam.ask("GET", "/livez", &[]).status, 200, "after {said}");
    }
    assert!(!doorcam.daemon.log().contains("panick"), "{}", doorcam.daemon.log());
}

#[test]
fn odd_logins_are_refused() {
    let doorcam = Guarded::configured("", &[("DOORCAM_TOKEN", CONTROL)]);
    let bodies: [String; 10] = [
        "null".into(),
        "[]".into(),
        "[\"a\"]".into(),
        "\"token\"".into(),
        "{\"token\": null}".into(),
        "{\"token\": [\"a\"]}".into(),
        "{\"token\": \"a\", \"token\": \"b\"}".into(),
        "{\"token\": \"\\ud800\"}".into(),
        "[".repeat(1000),
        format!("{{\"token\": {}1{}}}", "[".repeat(400), "]".repeat(400)),
    ];
    for body in bodies {
        let answer = doorcam.send("POST", "/api/v1/session", &[], &body);
        assert_eq!(answer.status, 400, "{body}");
        answer.problem();
    }
    for token in ["", " ", "\\u0000", "\\n", "ü"] {
        let answer = doorcam.send("POST", "/api/v1/session", &[], &format!("{{\"token\": \"{token}\"}}"));
        assert_eq!(answer.status, 401, "{token}");
    }
    assert_eq!(doorcam.ask("PUT", "/api/v1/session", &[]).status, 405);
}

/// The head of a masked frame of a WebSocket with this first byte and length, and a mask of zeros.
fn frame(first: u8, length: u64) -> Vec<u8> {
    let mut head = vec![first, 0x80 | 127];
    head.extend(length.to_be_bytes());
    head.extend([0; 4]);
    head
}

/// Reads what the server sends until the connection ends; the code of its farewell, if it sent one.
fn farewell(stream: &mut TcpStream) -> Option<u16> {
    let mut bytes = Vec::new();
    // A reset after the farewell does not matter.
    let _ = stream.read_to_end(&mut bytes);
    let at = bytes.windows(2).rposition(|head| head[0] == 0x88 && (2..126).contains(&head[1]))?;
    Some(u16::from_be_bytes([*bytes.get(at + 2)?, *bytes.get(at + 3)?]))
}

#[test]
fn a_huge_message_to_the_live_socket_is_refused_before_it_is_taken() {
    let doorcam = Guarded::start(&[]);
    let id = doorcam.daemon.id();
    let part = vec![0; 64 * 1024];
    let attack = |length: u64| {
        let mut socket = doorcam.live(&[]);
        let stream = socket.get_mut();
        stream.write_all(&frame(0x82, length)).unwrap();
        // As much of it as is taken.
        stream.set_write_timeout(Some(Duration::from_secs(5))).unwrap();
        let mut sent = 0;
        while sent < length.min(64 << 20) && stream.write_all(&part).is_ok() {
            sent += part.len() as u64;
        }
        farewell(stream)
    };
    attack(64 << 20);
    let before_kb = settled_kb(&doorcam.daemon);
    for length in [5000, 1 << 20, 64 << 20, 1 << 40, u64::MAX] {
        assert_eq!(attack(length), Some(1008), "{length}");
    }
    let after_kb = resident_kb(id);
    assert!(after_kb < before_kb + 32 * 1024, "{before_kb} kB before, {after_kb} kB after");
}

#[test]
fn what_is_no_websocket_ends_its_connection_and_a_flood_of_messages_holds_nobody_up() {
    let doorcam = Guarded::start(&[]);
    // Reserved bits, an unknown kind, a frame without a mask, a ping that is too long, a continuation of nothing.
    for bytes in [&[0xf1, 0x80][..], &[0x83, 0x80, 0, 0, 0, 0], &[0x81, 0x01, b'a'], &[0x89, 0xfe, 1, 0], &[0x80, 0x80]]
    {
        let mut socket = doorcam.live(&[]);
        socket.get_mut().write_all(bytes).unwrap();
        socket.get_mut().write_all(&[0; 300]).unwrap();
        assert!(farewell(socket.get_mut()).is_some(), "{bytes:x?}");
    }
    let small: Vec<u8> = [0x81, 0x81, 0, 0, 0, 0, b'a'].repeat(1000);
    let floods: Vec<_> = (0..8).map(|_| doorcam.live(&[])).collect();
    let end = Instant::now() + Duration::from_secs(2);
    std::thread::scope(|scope| {
        for mut socket in floods {
            let small = &small;
            scope.spawn(move || {
                let stream = socket.get_mut();
                stream.set_write_timeout(Some(Duration::from_millis(100))).unwrap();
                while Instant::now() < end {
                    let _ = stream.write_all(small);
                }
            });
        }
        while Instant::now() < end {
            assert_eq!(doorcam.ask("GET", "/livez", &[]).status, 200);
        }
    });
}
