//! Browsers send a token once and are known by a cookie from then on.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::client::{Answer, CONTROL, Guarded, READ, bearer};

const SESSION: &str = "/api/v1/session";

fn log_in(doorcam: &Guarded, token: &str, headers: &[(&str, &str)]) -> Answer {
    doorcam.send("POST", SESSION, headers, &json!({ "token": token }).to_string())
}

/// The cookie's name and number, as a browser sends it back.
fn cookie(answer: &Answer) -> String {
    answer.header("set-cookie").expect("a cookie").split(';').next().unwrap().to_owned()
}

fn report(doorcam: &Guarded, headers: &[(&str, &str)]) -> Value {
    let answer = doorcam.ask("GET", SESSION, headers);
    assert_eq!(answer.status, 200);
    serde_json::from_str(&answer.body).unwrap()
}

#[test]
fn a_session_may_do_what_its_token_may_until_it_is_logged_out() {
    let doorcam = Guarded::with_tokens(&[]);
    let outside = report(&doorcam, &[]);
    assert_eq!(
        (&outside["scope"], &outside["token_needed"], &outside["exposed"]),
        (&Value::Null, &json!(true), &json!(false))
    );

    let read = log_in(&doorcam, READ, &[]);
    assert_eq!(read.status, 200, "{read:?}");
    let attributes = read.header("set-cookie").unwrap();
    for attribute in ["HttpOnly", "SameSite=Strict", "Path=/", "Max-Age="] {
        assert!(attributes.contains(attribute), "{attributes}");
    }
    assert!(!attributes.contains("Secure") && !attributes.contains(READ), "{attributes}");
    let read = cookie(&read);
    let with = |cookie: &str, method: &str, path: &str| doorcam.ask(method, path, &[("Cookie", cookie)]).status;
    assert_eq!(with(&read, "GET", "/api/v1/status"), 200);
    assert_eq!(with(&format!("a=b; {read}; c=d"), "GET", "/metrics"), 200);
    assert_eq!(with(&read, "POST", "/api/v1/background/reset"), 403);
    assert_eq!(doorcam.upgrade(&[("Cookie", &read)]), 101);
    assert_eq!(doorcam.upgrade(&[("Cookie", &read), ("Origin", "http://evil.example")]), 403);
    let inside = report(&doorcam, &[("Cookie", &read)]);
    assert_eq!(inside["scope"], "read");
    assert!(inside["expires_s"].as_u64().is_some_and(|s| s > 3600), "{inside}");

    let control = cookie(&log_in(&doorcam, CONTROL, &[("Cookie", &read)]));
    assert_eq!(with(&read, "GET", "/api/v1/status"), 401, "a new login ends the previous session");
    assert_eq!(with(&control, "POST", "/api/v1/background/reset"), 202);
    assert_eq!(with(&control[..control.len() - 1], "GET", "/api/v1/status"), 401);
    let out = doorcam.ask("DELETE", SESSION, &[("Cookie", &control)]);
    assert_eq!(out.status, 204);
    assert!(out.header("set-cookie").unwrap().contains("Max-Age=0"));
    assert_eq!(with(&control, "GET", "/api/v1/status"), 401);
}

#[test]
fn who_has_no_token_gets_no_session() {
    let doorcam = Guarded::with_tokens(&[]);
    let wrong = log_in(&doorcam, "wrong-0123456789abcdef01", &[]);
    assert_eq!((wrong.status, wrong.header("set-cookie")), (401, None));
    for body in ["", "{}", "token", "{\"token\": 3}", "{\"token\": \"secret-secret\", \"more\": 1}"] {
        let odd = doorcam.send("POST", SESSION, &[], body);
        assert_eq!(odd.status, 400, "{body}");
        assert!(!odd.problem().to_string().contains("secret-secret"));
    }
    assert_eq!(log_in(&doorcam, &"a".repeat(2000), &[]).status, 413);
    assert_eq!(log_in(&doorcam, READ, &[("Origin", "http://evil.example")]).status, 403);
    for k in 0..9 {
        assert_eq!(log_in(&doorcam, &format!("wrong-0123456789abcdef{k}"), &[]).status, 401);
    }
    assert_eq!(log_in(&doorcam, "wrong-0123456789abcdef9", &[]).status, 429);
}

#[test]
fn who_is_in_is_not_locked_out_by_who_guesses() {
    let doorcam = Guarded::with_tokens(&[]);
    let read = cookie(&log_in(&doorcam, READ, &[]));
    for k in 0..12 {
        log_in(&doorcam, &format!("wrong-0123456789abcdef{k}"), &[]);
    }
    assert_eq!(log_in(&doorcam, "wrong-0123456789abcdef", &[]).status, 429);
    assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Cookie", &read)]).status, 200);
    assert_eq!(log_in(&doorcam, READ, &[]).status, 200, "nor is who has the right token");
}

#[test]
fn a_session_ends_by_itself() {
    let environment = [("DOORCAM_TOKEN", CONTROL)];
    let doorcam = Guarded::configured("[access]\nsession_s = 2.0\n", &environment);
    let cookie = cookie(&log_in(&doorcam, CONTROL, &[]));
    assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Cookie", &cookie)]).status, 200);
    let deadline = Instant::now() + Duration::from_secs(30);
    while doorcam.ask("GET", "/api/v1/status", &[("Cookie", &cookie)]).status != 401 {
        assert!(Instant::now() < deadline, "the session does not end");
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn over_https_the_cookie_stays_there() {
    let doorcam = Guarded::configured("[access]\nallowed_hosts = [\"door.lan\"]\n", &[("DOORCAM_TOKEN", CONTROL)]);
    // Like a page behind a proxy that ends TLS.
    let answer = log_in(&doorcam, CONTROL, &[("Host", "door.lan"), ("Origin", "https://door.lan")]);
    assert!(answer.status == 200 && answer.header("set-cookie").unwrap().contains("; Secure"), "{answer:?}");
}

#[test]
fn without_tokens_everybody_may_and_the_page_is_told_so() {
    let here = report(&Guarded::start(&[]), &[]);
    assert_eq!(
        (&here["scope"], &here["token_needed"], &here["exposed"]),
        (&json!("control"), &json!(false), &json!(false))
    );
    let exposed = Guarded::start_with("0.0.0.0:0", "", &[], &["--allow-unauthenticated"]);
    assert_eq!(report(&exposed, &[])["exposed"], true);
    let guarded = Guarded::with_tokens(&[]);
    assert_eq!(report(&guarded, &[("Authorization", &bearer(CONTROL))])["scope"], "control");
}
