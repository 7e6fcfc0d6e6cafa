//! HTTPS: the same rules of access, certificates that change, and shutdown.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

use super::client::{Answer, CONTROL, Guarded, answer, bearer, connect, write_with_mode};
use crate::common::{doorcam, stderr};

/// Makes a certificate for localhost, writes it and its key, and returns it.
fn certify(directory: &Path) -> CertificateDer<'static> {
    certify_between(directory, 1975, 4096)
}

/// The same, valid from the beginning of one year to that of another.
fn certify_between(directory: &Path, from: i32, until: i32) -> CertificateDer<'static> {
    let mut params = rcgen::CertificateParams::new(vec!["localhost".into()]).unwrap();
    (params.not_before, params.not_after) = (rcgen::date_time_ymd(from, 1, 1), rcgen::date_time_ymd(until, 1, 1));
    let key = rcgen::KeyPair::generate().unwrap();
    let made = params.self_signed(&key).unwrap();
    write_with_mode(&directory.join("key.pem"), &key.serialize_pem(), 0o600);
    std::fs::write(directory.join("cert.pem"), made.pem()).unwrap();
    made.der().clone()
}

fn start(directory: &Path, environment: &[(&str, &str)]) -> Guarded {
    let [certificate, key] = ["cert.pem", "key.pem"].map(|name| directory.join(name).display().to_string());
    Guarded::start_with("127.0.0.1:0", "", environment, &["--tls-cert", &certificate, "--tls-key", &key])
}

/// A connection that accepts only a server with this certificate.
fn greet(doorcam: &Guarded, certificate: &CertificateDer<'static>) -> StreamOwned<ClientConnection, TcpStream> {
    let mut trusted = RootCertStore::empty();
    trusted.add(certificate.clone()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let config = Arc::new(config.with_root_certificates(trusted).with_no_client_auth());
    let client = ClientConnection::new(config, ServerName::try_from("localhost").unwrap()).unwrap();
    StreamOwned::new(client, connect(doorcam.address()))
}

/// Sends a request over a new connection; `None` if the server has another certificate.
fn ask(doorcam: &Guarded, certificate: &CertificateDer<'static>, request: &str) -> Option<Answer> {
    let mut stream = greet(doorcam, certificate);
    stream.write_all(request.as_bytes()).ok()?;
    answer(&mut stream)
}

fn get(path: &str, more: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{more}\r\n")
}

#[test]
fn everything_is_served_over_tls_and_nothing_without() {
    let directory = tempfile::tempdir().unwrap();
    let certificate = certify(directory.path());
    let doorcam = start(directory.path(), &[("DOORCAM_TOKEN", CONTROL)]);
    assert!(doorcam.daemon.url.starts_with("https://"), "{}", doorcam.daemon.url);
    let alive = ask(&doorcam, &certificate, &get("/livez", "")).expect("an answer");
    assert_eq!((alive.status, alive.header("strict-transport-security")), (200, Some("max-age=2592000")));
    assert_eq!(ask(&doorcam, &certificate, &get("/api/v1/status", "")).unwrap().status, 401);
    let token = format!("Authorization: {}\r\n", bearer(CONTROL));
    assert_eq!(ask(&doorcam, &certificate, &get("/api/v1/status", &token)).unwrap().status, 200);
    let body = format!("{{\"token\": \"{CONTROL}\"}}");
    let head = "POST /api/v1/session HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length:";
    let session = ask(&doorcam, &certificate, &format!("{head} {}\r\n\r\n{body}", body.len())).unwrap();
    assert!(session.header("set-cookie").unwrap().contains("; Secure"), "{session:?}");

    let mut plain = connect(doorcam.address());
    plain.write_all(get("/livez", "").as_bytes()).unwrap();
    assert!(answer(&mut plain).is_none(), "plain HTTP gets no answer");
}

#[test]
fn who_never_greets_holds_nobody_up_and_live_sockets_are_told_of_the_end() {
    let directory = tempfile::tempdir().unwrap();
    let certificate = certify(directory.path());
    let mut doorcam = start(directory.path(), &[]);
    let mut mute: Vec<_> = (0..20).map(|_| connect(doorcam.address())).collect();
    assert_eq!(ask(&doorcam, &certificate, &get("/livez", "")).unwrap().status, 200);
    mute.remove(0).read_to_end(&mut Vec::new()).expect("cut off");

    let _again: Vec<_> = (0..5).map(|_| connect(doorcam.address())).collect();
    let stream = greet(&doorcam, &certificate);
    let mut socket = tungstenite::client("wss://localhost/api/v1/live", stream).expect("upgrades").0;
    assert!(socket.read().expect("an update").is_text());
    let listener = std::thread::spawn(move || {
        loop {
            if let tungstenite::Message::Close(frame) = socket.read().expect("a message") {
                return frame.map(|frame| u16::from(frame.code));
            }
        }
    });
    let (took, code) = doorcam.daemon.terminate();
    assert_eq!(code, Some(0));
    assert!(took < Duration::from_secs(60), "{took:?}");
    assert_eq!(listener.join().unwrap(), Some(1001));
}

#[test]
fn a_new_certificate_is_used_without_a_restart_and_a_broken_one_is_not() {
    let directory = tempfile::tempdir().unwrap();
    let old = certify(directory.path());
    let doorcam = start(directory.path(), &[]);
    let is_used =
        |certificate| ask(&doorcam, certificate, &get("/livez", "")).is_some_and(|answer| answer.status == 200);
    assert!(is_used(&old));
    let wait_for = |what: &str, is: &dyn Fn() -> bool| {
        let deadline = Instant::now() + Duration::from_secs(60);
        while !is() {
            assert!(Instant::now() < deadline, "waited in vain for {what}: {}", doorcam.daemon.log());
            std::thread::sleep(Duration::from_millis(100));
        }
    };

    std::fs::write(directory.path().join("cert.pem"), "-----BEGIN CERTIFICATE-----\nbroken\n").unwrap();
    wait_for("the warning", &|| doorcam.daemon.log().contains("the certificate in use stays"));
    assert!(is_used(&old));

    let new = certify(directory.path());
    wait_for("the new certificate", &|| is_used(&new));
    assert!(!is_used(&old));
}

#[test]
fn a_certificate_or_key_that_cannot_be_used_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let [certificate, key] = ["cert.pem", "key.pem"].map(|name| directory.path().join(name));
    let (c, k) = (certificate.to_str().unwrap(), key.to_str().unwrap());
    let refusal = |arguments: &[&str]| {
        let output = doorcam(&["demo", "--listen", "127.0.0.1:0"]).args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
        let said = stderr(&output);
        assert_eq!(said.lines().count(), 1, "{said}");
        said.trim_end().trim_start_matches("doorcam: ").to_owned()
    };
    let both = ["--tls-cert", c, "--tls-key", k];
    assert_eq!(refusal(&both), format!("tls.certificate_file: {c}: cannot read it: no such file or directory"));
    certify(directory.path());
    write_with_mode(&key, &std::fs::read_to_string(&key).unwrap(), 0o644);
    assert!(refusal(&both).starts_with(&format!("tls.key_file: {k}: its mode 644 lets others at the secret")));
    let half = doorcam(&["demo", "--tls-cert", c]).output().unwrap();
    assert!(half.status.code() == Some(2) && stderr(&half).contains("--tls-key"), "{}", stderr(&half));
    // A key that belongs to another certificate.
    let first = std::fs::read(&certificate).unwrap();
    certify(directory.path());
    std::fs::write(&certificate, first).unwrap();
    assert!(refusal(&both).starts_with(&format!("tls.certificate_file: {c}: cannot be used with {k}: ")));
    std::fs::write(&certificate, "nothing").unwrap();
    assert!(refusal(&both).contains("no certificate in it"));
}

#[test]
fn a_certificate_that_is_not_valid_now_is_used_but_not_without_a_word() {
    let directory = tempfile::tempdir().unwrap();
    certify_between(directory.path(), 2001, 2002);
    let doorcam = start(directory.path(), &[]);
    let said = doorcam.daemon.log();
    let file = directory.path().join("cert.pem");
    let expected = format!("tls.certificate_file: {}: expired at 2002-01-01T00:00:00Z", file.display());
    assert_eq!(said.matches(&expected).count(), 1, "{said}");

    let new = certify_between(directory.path(), 2001, 2100);
    doorcam.daemon.wait_for_log("the new certificate is in use");
    let metrics = ask(&doorcam, &new, &get("/metrics", "")).expect("an answer");
    assert!(metrics.body.contains("doorcam_tls_certificate_expiry_seconds 4102444800\n"), "{}", metrics.body);
    assert_eq!(doorcam.daemon.log().matches("browsers refuse it").count(), 1, "{}", doorcam.daemon.log());

    certify_between(directory.path(), 2100, 2101);
    doorcam.daemon.wait_for_log("not valid before 2100-01-01T00:00:00Z");
    certify_between(directory.path(), 2003, 2004);
    doorcam.daemon.wait_for_log("expired at 2004-01-01T00:00:00Z");
}
