//! The security headers of every answer, refusals included.

use super::client::{Answer, Guarded};

fn assert_strict(answer: &Answer) {
    let policy = answer.header("content-security-policy").expect("a policy");
    for part in
        ["default-src 'none'", "script-src 'self'", "frame-ancestors 'none'", "base-uri 'none'", "form-action 'none'"]
    {
        assert!(policy.contains(part), "{part}: {policy}");
    }
    assert!(!policy.contains("unsafe") && !policy.contains('*'), "{policy}");
    for (name, value) in [
        ("x-content-type-options", "nosniff"),
        ("x-frame-options", "DENY"),
        ("referrer-policy", "no-referrer"),
        ("cross-origin-opener-policy", "same-origin"),
        ("cross-origin-resource-policy", "same-origin"),
    ] {
        assert_eq!(answer.header(name), Some(value), "{answer:?}");
    }
    assert!(answer.header("permissions-policy").unwrap().contains("camera=()"));
    assert!(answer.header("cache-control").is_some());
}

#[test]
fn every_answer_has_the_headers() {
    let doorcam = Guarded::with_tokens(&[]);
    for (method, path, status) in [
        ("GET", "/", 200),
        ("GET", "/app.js", 200),
        ("GET", "/livez", 200),
        ("GET", "/api/v1/status", 401),
        ("POST", "/api/v1/background/reset", 401),
        ("POST", "/", 405),
    ] {
        let answer = doorcam.ask(method, path, &[]);
        assert_eq!(answer.status, status, "{method} {path}");
        assert_strict(&answer);
    }
    let rebound = doorcam.ask("GET", "/", &[("Host", "evil.example")]);
    assert_eq!(rebound.status, 403);
    assert_strict(&rebound);
    let doorcam = Guarded::start(&[]);
    for path in ["/api/v1/status", "/api/v1/nothing", "/api/v1/frame.jpg", "/metrics"] {
        let answer = doorcam.ask("GET", path, &[]);
        assert_strict(&answer);
        assert_eq!(answer.header("cache-control"), Some("no-store"), "{path}");
        assert_eq!(answer.header("strict-transport-security"), None, "without TLS a browser must not insist on it");
    }
}

/// The policy forbids inline scripts and styles, so the page must have none.
#[test]
fn the_page_has_nothing_that_the_policy_forbids() {
    let doorcam = Guarded::start(&[]);
    let page = doorcam.ask("GET", "/", &[]).body;
    assert!(page.contains("<script type=\"module\" src="));
    for forbidden in ["<style", " style=", " onclick=", "javascript:", "<script>", "http://", "https://"] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
}
