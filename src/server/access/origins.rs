use std::str::FromStr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tower_http::cors::CorsLayer;

use super::Access;
use super::hosts::host_of;
use crate::server::problem::ProblemDetails;

/// Refuses changes and live sockets that pages of other sites ask for. CORS does not prevent them: the browser sends
/// the request first and only then decides whether the page may see the answer, and it does not check sockets at all.
pub(super) async fn check(State(access): State<Arc<Access>>, request: Request, next: Next) -> Response {
    let headers = request.headers();
    let sees = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    let stays = sees && !headers.contains_key(header::UPGRADE);
    if stays || is_ours(headers, &access.origins) {
        return next.run(request).await;
    }
    ProblemDetails::new(StatusCode::FORBIDDEN, "pages of other sites may not do this: see access.allowed_origins")
        .into_response()
}

/// Whether a request comes from the page itself, from a configured origin or from a program that is no browser.
fn is_ours(headers: &HeaderMap, allowed: &[HeaderValue]) -> bool {
    let Some(origin) = headers.get(header::ORIGIN) else {
        // Browsers that send no Origin send at least this.
        let site = headers.get("sec-fetch-site").map(HeaderValue::as_bytes);
        return matches!(site, None | Some(b"same-origin" | b"none"));
    };
    if allowed.contains(origin) {
        return true;
    }
    let origin = origin.to_str().ok().and_then(|text| Uri::from_str(text).ok());
    match (origin, host_of(headers)) {
        (Some(origin), Some(host)) => is_same(&origin, &host),
        _ => false,
    }
}

/// Whether an origin is that of the called host. The scheme may differ, because a proxy that ends TLS changes it; a
/// missing port is the default of the origin's scheme.
fn is_same(origin: &Uri, host: &Authority) -> bool {
    let usual = match origin.scheme_str() {
        Some("http") => 80,
        Some("https") => 443,
        _ => return false,
    };
    let Some(authority) = origin.authority() else { return false };
    let port = |authority: &Authority| authority.port_u16().unwrap_or(usual);
    authority.host().eq_ignore_ascii_case(host.host()) && port(authority) == port(host)
}

/// Lets pages of the configured origins send requests and read the answers; `None` without any.
pub(super) fn cors(allowed: &[HeaderValue]) -> Option<CorsLayer> {
    let layer = CorsLayer::new()
        .allow_origin(allowed.to_vec())
        .allow_methods([Method::GET, Method::HEAD, Method::POST, Method::PUT, Method::DELETE])
        .allow_headers([header::AUTHORIZATION, header::CONTENT_TYPE, header::IF_MATCH, header::IF_NONE_MATCH])
        .expose_headers([header::ETAG, header::RETRY_AFTER]);
    (!allowed.is_empty()).then_some(layer)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ours(host: &'static str, origin: Option<&'static str>, site: Option<&'static str>) -> bool {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, HeaderValue::from_static(host));
        if let Some(origin) = origin {
            headers.insert(header::ORIGIN, HeaderValue::from_static(origin));
        }
        if let Some(site) = site {
            headers.insert("sec-fetch-site", HeaderValue::from_static(site));
        }
        is_ours(&headers, &[HeaderValue::from_static("https://dash.example")])
    }

    #[test]
    fn the_page_the_configured_and_what_is_no_browser_are_ours() {
        assert!(ours("127.0.0.1:8080", None, None));
        assert!(ours("127.0.0.1:8080", Some("http://127.0.0.1:8080"), Some("same-origin")));
        assert!(
            ours("door.lan", Some("https://door.lan"), None) && ours("door.lan:443", Some("https://door.lan"), None)
        );
        assert!(
            ours("door.lan", Some("http://DOOR.lan:80"), None) && ours("[::1]:8080", Some("http://[::1]:8080"), None)
        );
        assert!(ours("127.0.0.1:8080", Some("https://dash.example"), Some("cross-site")));
        assert!(ours("127.0.0.1:8080", None, Some("none")));
    }

    #[test]
    fn pages_of_others_are_not() {
        for origin in [
            "http://evil.example",
            "http://127.0.0.1:8081",
            "http://127.0.0.1",
            "null",
            "",
            "file://",
            "ftp://127.0.0.1:8080",
        ] {
            assert!(!ours("127.0.0.1:8080", Some(origin), None), "{origin}");
        }
        assert!(!ours("127.0.0.1:8080", Some("http://dash.example"), None), "another scheme is another origin");
        assert!(!ours("127.0.0.1:8080", Some("https://dash.example.evil.example"), None));
        for site in ["cross-site", "same-site", "anything"] {
            assert!(!ours("127.0.0.1:8080", None, Some(site)), "{site}");
        }
    }
}
