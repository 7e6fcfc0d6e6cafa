//! Names and origins: DNS rebinding, and pages of other sites.

use std::io::{Read, Write};

use super::client::{Guarded, READ, bearer, connect, exchange};

#[test]
fn a_name_that_is_not_its_own_gets_nothing() {
    let doorcam = Guarded::start(&[]);
    let port = doorcam.address().port();
    for host in [format!("localhost:{port}"), "127.0.0.1".into(), format!("[::1]:{port}"), "127.0.0.1:1".into()] {
        assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Host", &host)]).status, 200, "{host}");
    }
    for host in ["evil.example", &format!("evil.example:{port}"), "192.168.1.2", "localhost.evil.example"] {
        for path in ["/", "/api/v1/status", "/metrics", "/livez", "/nothing"] {
            let answer = doorcam.ask("GET", path, &[("Host", host)]);
            assert_eq!(answer.status, 403, "{host}{path}");
            assert!(answer.problem()["detail"].as_str().unwrap().contains("access.allowed_hosts"));
        }
        assert_eq!(doorcam.upgrade(&[("Host", host)]), 403);
    }
    // No host, two hosts, and another host in the request line.
    let address = doorcam.address();
    let raw = |head: &str| exchange(address, &format!("{head}Connection: close\r\n\r\n")).status;
    assert_eq!(raw("GET /api/v1/status HTTP/1.1\r\n"), 400);
    assert_eq!(raw("GET /api/v1/status HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n"), 400);
    assert_eq!(raw("GET http://evil.example/api/v1/status HTTP/1.1\r\nHost: localhost\r\n"), 403);
}

#[test]
fn a_configured_name_is_its_own() {
    let doorcam = Guarded::configured("[access]\nallowed_hosts = [\"door.lan\"]\n", &[]);
    for host in ["Door.LAN:8443", "door.lan.", "door.lan.:80", "door.lan:"] {
        assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Host", host)]).status, 200, "{host}");
    }
    assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Host", "xdoor.lan")]).status, 403);
    for host in ["door.lan:99999", "door.lan:8o", "u@door.lan", ":80", "door.lan, door.lan", "[::1", "::1"] {
        assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Host", host)]).status, 400, "{host}");
    }
    // The absolute form, as proxies get it.
    for (line, status) in [("http://DOOR.lan:1/livez", 200), ("http://evil.example/livez", 403)] {
        assert_eq!(doorcam.ask("GET", line, &[("Host", "door.lan")]).status, status, "{line}");
    }
}

#[test]
fn the_log_and_the_page_say_what_was_refused_and_what_was_expected() {
    let doorcam = Guarded::configured("[access]\nallowed_hosts = [\"door.lan\"]\n", &[]);
    let refused = "refused a request to \"evil.example\", expected door.lan, localhost or a loopback address; other names \
                   belong in access.allowed_hosts";
    for _ in 0..3 {
        assert_eq!(doorcam.ask("GET", "/", &[("Host", "evil.example")]).status, 403);
    }
    // As behind a proxy on another port that passes the name on without it.
    let page = "http://door.lan:8081";
    for _ in 0..3 {
        assert_eq!(doorcam.upgrade(&[("Host", "door.lan"), ("Origin", page)]), 403);
    }
    let why = "pages at http://door.lan:8081 may not do this, because doorcam was called as door.lan: if they are its own, \
               have the proxy pass on the header Host with its port, or add \"http://door.lan:8081\" to \
               access.allowed_origins";
    doorcam.daemon.wait_for_log(why);
    let log = doorcam.daemon.log();
    assert!(log.contains(refused), "{log}");
    assert_eq!((log.matches("refused a request to").count(), log.matches(why).count()), (1, 1), "{log}");
    // A socket's refusal is not shown to the page, so it asks.
    let asked = |origin: &str| {
        let answer = doorcam.ask("GET", &format!("/api/v1/session?origin={origin}"), &[("Host", "door.lan")]);
        assert_eq!(answer.status, 200, "{answer:?}");
        serde_json::from_str::<serde_json::Value>(&answer.body).unwrap()["refusal"].clone()
    };
    assert_eq!(asked("http%3A%2F%2Fdoor.lan%3A8081"), why);
    assert!(asked("http%3A%2F%2Fdoor.lan").is_null() && asked("https://door.lan").is_null());
    assert_eq!(doorcam.ask("GET", "/api/v1/session?origin=a&origin=b", &[]).status, 400);
}

#[test]
fn nobody_forges_lines_of_the_log() {
    let doorcam = Guarded::start(&[]);
    let forged = "http://evil\u{9b}2K\u{fc}\".example";
    assert_eq!(doorcam.ask("POST", "/api/v1/background/reset", &[("Origin", forged)]).status, 403);
    doorcam.daemon.wait_for_log("pages at http://evil\\xc2\\x9b2K\\xc3\\xbc\\\".example may not do this");
}

#[test]
fn pages_of_other_sites_change_nothing_and_do_not_listen() {
    let doorcam = Guarded::start(&[]);
    let own = format!("http://{}", doorcam.address());
    let reset = |headers: &[(&str, &str)]| doorcam.ask("POST", "/api/v1/background/reset", headers).status;
    assert_eq!(reset(&[]), 202, "programs other than browsers send no origin");
    assert_eq!(reset(&[("Origin", &own), ("Sec-Fetch-Site", "same-origin")]), 202);
    let others = ["http://evil.example", "null", "http://127.0.0.1:1", "https://localhost"];
    for origin in others {
        assert_eq!(reset(&[("Origin", origin)]), 403, "{origin}");
        assert_eq!(doorcam.upgrade(&[("Origin", origin)]), 403, "{origin}");
        assert_eq!(doorcam.ask("PUT", "/api/v1/calibration", &[("Origin", origin)]).status, 403, "{origin}");
    }
    assert_eq!(reset(&[("Sec-Fetch-Site", "cross-site")]), 403);
    assert_eq!((doorcam.upgrade(&[]), doorcam.upgrade(&[("Origin", &own)])), (101, 101));
    // Reading is allowed from any origin; without CORS headers the browser does not hand the answer to the page.
    let seen = doorcam.ask("GET", "/api/v1/status", &[("Origin", "http://evil.example")]);
    assert_eq!((seen.status, seen.header("access-control-allow-origin")), (200, None));
    let asked = [("Origin", "http://evil.example"), ("Access-Control-Request-Method", "PUT")];
    let preflight = doorcam.ask("OPTIONS", "/api/v1/calibration", &asked);
    assert_eq!(preflight.header("access-control-allow-origin"), None);
}

#[test]
fn pages_of_configured_origins_may_ask() {
    let config = "[access]\nallowed_origins = [\"https://dash.example\"]\n";
    let doorcam = Guarded::configured(config, &[("DOORCAM_READ_TOKEN", READ)]);
    let origin = ("Origin", "https://dash.example");
    let preflight = doorcam.ask(
        "OPTIONS",
        "/api/v1/status",
        &[origin, ("Access-Control-Request-Method", "GET"), ("Access-Control-Request-Headers", "authorization")],
    );
    assert_eq!(preflight.status, 200, "a browser sends no token with a preflight request");
    assert_eq!(preflight.header("access-control-allow-origin"), Some("https://dash.example"));
    assert!(preflight.header("access-control-allow-headers").unwrap().contains("authorization"));
    let answer = doorcam.ask("GET", "/api/v1/status", &[origin, ("Authorization", &bearer(READ))]);
    assert_eq!((answer.status, answer.header("access-control-allow-origin")), (200, Some("https://dash.example")));
    assert_eq!(answer.header("access-control-allow-credentials"), None);
    let exposed = answer.header("access-control-expose-headers").expect("headers that a page may read");
    for name in ["etag", "link", "retry-after", "x-captured"] {
        assert!(exposed.split(',').any(|exposed| exposed.trim() == name), "{name}: {exposed}");
    }
    assert_eq!(doorcam.upgrade(&[origin, ("Authorization", &bearer(READ))]), 101);
    let other =
        doorcam.ask("GET", "/api/v1/status", &[("Origin", "https://evil.example"), ("Authorization", &bearer(READ))]);
    assert_eq!(other.header("access-control-allow-origin"), None);
}

#[test]
fn a_live_socket_of_the_page_still_works() {
    let doorcam = Guarded::start(&[]);
    let address = doorcam.address();
    let mut stream = connect(address);
    let request = format!(
        "GET /api/v1/live HTTP/1.1\r\nHost: {address}\r\nOrigin: http://{address}\r\nConnection: Upgrade\r\n\
         Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).unwrap();
    let mut seen = Vec::new();
    while !String::from_utf8_lossy(&seen).contains("\"sequence\"") {
        let mut more = [0; 4096];
        let got = stream.read(&mut more).unwrap();
        assert!(got > 0, "{}", String::from_utf8_lossy(&seen));
        seen.extend_from_slice(&more[..got]);
    }
}
