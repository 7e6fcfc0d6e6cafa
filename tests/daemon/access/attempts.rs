//! Guessing tokens is slow, and does not affect anybody with a session.

use std::sync::atomic::{AtomicBool, Ordering};

use super::client::{CONTROL, Guarded, READ, bearer};

#[test]
fn ten_wrong_tokens_keep_an_address_from_trying_more() {
    let doorcam = Guarded::with_tokens(&[]);
    let status = |token: &str| doorcam.ask("GET", "/api/v1/status", &[("Authorization", &bearer(token))]);
    for k in 0..10 {
        assert_eq!(status(&format!("wrong-0123456789abcdef{k:02}")).status, 401, "{k}");
    }
    for _ in 0..3 {
        let barred = status("wrong-0123456789abcdef99");
        assert_eq!(barred.status, 429);
        let wait: u64 = barred.header("retry-after").expect("retry-after").parse().expect("seconds");
        assert!((1..=61).contains(&wait), "{wait}");
        barred.problem();
        // A scraper behind the same proxy has the right one.
        for token in [READ, CONTROL] {
            assert_eq!(status(token).status, 200, "a right token is always let in");
        }
    }
    // Requests without a token are still answered.
    assert_eq!(doorcam.ask("GET", "/api/v1/status", &[]).status, 401);
    assert_eq!(doorcam.ask("GET", "/livez", &[]).status, 200);
    doorcam.daemon.wait_for_log("wrong tokens");
    assert_eq!(doorcam.daemon.log().matches("wrong tokens").count(), 1, "{}", doorcam.daemon.log());
}

#[test]
fn a_right_token_is_let_in_while_many_wrong_ones_come() {
    let doorcam = Guarded::with_tokens(&[]);
    let status = |token: &str| doorcam.ask("GET", "/metrics", &[("Authorization", &bearer(token))]).status;
    (0..10).for_each(|_| assert_eq!(status("wrong-0123456789abcdef99"), 401));
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..16 {
            scope.spawn(|| {
                while !over.load(Ordering::Relaxed) {
                    assert_eq!(status("wrong-0123456789abcdef99"), 429);
                }
            });
        }
        for _ in 0..20 {
            assert_eq!(status(READ), 200);
        }
        over.store(true, Ordering::Relaxed);
    });
}

#[test]
fn behind_a_trusted_proxy_each_client_is_counted_by_itself() {
    let config = "[access]\ntrusted_proxies = [\"127.0.0.1\"]\n";
    let doorcam = Guarded::configured(config, &[("DOORCAM_READ_TOKEN", READ)]);
    let from = |client: &str| {
        let headers = [("Authorization", "Bearer wrong-0123456789abcdef99"), ("X-Forwarded-For", client)];
        doorcam.ask("GET", "/metrics", &headers).status
    };
    for _ in 0..10 {
        assert_eq!(from("198.51.100.7, 192.0.2.1"), 401);
    }
    // What the client has put in front itself does not matter.
    assert_eq!((from("192.0.2.1"), from("198.51.100.7, 192.0.2.1"), from("198.51.100.7")), (429, 429, 401));
    doorcam.daemon.wait_for_log("192.0.2.1: too many wrong tokens");

    let doorcam = Guarded::configured("", &[("DOORCAM_READ_TOKEN", READ)]);
    let from = |client: String| {
        let headers = [("Authorization", "Bearer wrong-0123456789abcdef99"), ("X-Forwarded-For", client.as_str())];
        doorcam.ask("GET", "/metrics", &headers).status
    };
    let answers: Vec<u16> = (0..11).map(|k| from(format!("192.0.2.{k}"))).collect();
    assert_eq!((answers[9], answers[10]), (401, 429), "nobody else is believed");
}

#[test]
fn right_tokens_are_not_counted() {
    let doorcam = Guarded::with_tokens(&[]);
    for _ in 0..30 {
        assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Authorization", &bearer(READ))]).status, 200);
        assert_eq!(doorcam.ask("POST", "/api/v1/background/reset", &[("Authorization", &bearer(READ))]).status, 403);
    }
}
