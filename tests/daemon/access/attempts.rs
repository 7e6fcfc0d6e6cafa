//! Guessing tokens is slow, and does not affect anybody with a session.

use super::client::{CONTROL, Guarded, READ, bearer};

#[test]
fn ten_wrong_tokens_keep_an_address_from_trying_more() {
    let doorcam = Guarded::with_tokens(&[]);
    let status = |token: &str| doorcam.ask("GET", "/api/v1/status", &[("Authorization", &bearer(token))]);
    for k in 0..10 {
        assert_eq!(status(&format!("wrong-0123456789abcdef{k:02}")).status, 401, "{k}");
    }
    for token in ["wrong-0123456789abcdef99", READ, CONTROL] {
        let barred = status(token);
        assert_eq!(barred.status, 429, "the answer does not tell whether a token is right");
        let wait: u64 = barred.header("retry-after").expect("retry-after").parse().expect("seconds");
        assert!((1..=60).contains(&wait), "{wait}");
        barred.problem();
    }
    // Requests without a token are still answered.
    assert_eq!(doorcam.ask("GET", "/api/v1/status", &[]).status, 401);
    assert_eq!(doorcam.ask("GET", "/livez", &[]).status, 200);
    doorcam.daemon.wait_for_log("wrong tokens");
    assert_eq!(doorcam.daemon.log().matches("wrong tokens").count(), 1, "{}", doorcam.daemon.log());
}

#[test]
fn right_tokens_are_not_counted() {
    let doorcam = Guarded::with_tokens(&[]);
    for _ in 0..30 {
        assert_eq!(doorcam.ask("GET", "/api/v1/status", &[("Authorization", &bearer(READ))]).status, 200);
        assert_eq!(doorcam.ask("POST", "/api/v1/background/reset", &[("Authorization", &bearer(READ))]).status, 403);
    }
}
