use std::net::IpAddr;
use std::str::FromStr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tower_http::cors::{AllowOrigin, CorsLayer};

use super::Access;
use super::hosts::{host_of, is_sound};
use super::told::shown;
use crate::server::frame::CAPTURED;
use crate::server::problem::ProblemDetails;

/// Where a page comes from: scheme, host and port.
#[derive(Debug, Clone)]
pub(super) struct Origin {
    secure: bool,
    authority: Authority,
}

impl Origin {
    /// An origin as browsers write it; `None` for `null` and whatever else is none.
    pub(super) fn parse(text: &[u8]) -> Option<Self> {
        let text = str::from_utf8(text).ok()?;
        let uri = Uri::from_str(text).ok()?;
        let (scheme, authority) = (uri.scheme_str()?, uri.authority()?);
        let secure = match scheme {
            "http" => false,
            "https" => true,
            _ => return None,
        };
        let whole = text.len() == scheme.len() + "://".len() + authority.as_str().len();
        (whole && is_sound(authority)).then(|| Self { secure, authority: authority.clone() })
    }

    /// Whether the page is that of the called host. The scheme may differ, because a proxy that ends TLS changes it; a
    /// missing port is the default of the origin's scheme.
    fn is_of(&self, host: &Authority) -> bool {
        let port = |authority: &Authority| authority.port_u16().unwrap_or(if self.secure { 443 } else { 80 });
        is_same_host(self.authority.host(), host.host()) && port(&self.authority) == port(host)
    }

    fn is(&self, other: &Self) -> bool {
        self.secure == other.secure && self.is_of(&other.authority)
    }
}

/// Whether two hosts are the same name or the same address. An address of IPv6 can be written in several ways.
fn is_same_host(one: &str, other: &str) -> bool {
    let address = |host: &str| host.strip_prefix('[')?.strip_suffix(']')?.parse::<IpAddr>().ok();
    one.eq_ignore_ascii_case(other) || address(one).is_some_and(|one| address(other) == Some(one))
}

/// Refuses changes and live sockets that pages of other sites ask for. CORS does not prevent them: the browser sends
/// the request first and only then decides whether the page may see the answer, and it does not check sockets at all.
pub(super) async fn check(State(access): State<Arc<Access>>, request: Request, next: Next) -> Response {
    let headers = request.headers();
    let sees = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    let stays = sees && !headers.contains_key(header::UPGRADE);
    let Some(refusal) = (if stays { None } else { access.foreign(headers) }) else { return next.run(request).await };
    access.foreign_origins.tell(|| format!("refused a request of another site: {refusal}"));
    ProblemDetails::new(StatusCode::FORBIDDEN, &refusal).into_response()
}

impl Access {
    /// Why a request is taken for one of another site; `None` if it comes from the page itself, from a configured origin
    /// or from a program that is no browser.
    fn foreign(&self, headers: &HeaderMap) -> Option<String> {
        let mut origins = headers.get_all(header::ORIGIN).iter();
        match (origins.next(), origins.next()) {
            (Some(origin), None) => self.refusal_of(origin.as_bytes(), headers),
            (Some(_), Some(_)) => Some("expected one header Origin: see access.allowed_origins".into()),
            // Browsers that send no Origin send at least this.
            (None, _) => match headers.get("sec-fetch-site").map(HeaderValue::as_bytes) {
                None | Some(b"same-origin" | b"none") => None,
                Some(site) => {
                    let site = shown(site);
                    Some(format!(
                        "pages of other sites (Sec-Fetch-Site: {site}) may not do this: see access.allowed_origins"
                    ))
                }
            },
        }
    }

    /// Why a page of this origin may neither change anything nor listen; `None` if it may.
    pub(super) fn refusal_of(&self, origin: &[u8], headers: &HeaderMap) -> Option<String> {
        let called = host_of(headers);
        let is_ours = |origin: &Origin| {
            self.origins.iter().any(|allowed| allowed.is(origin))
                || called.as_ref().is_some_and(|host| origin.is_of(host))
        };
        if Origin::parse(origin).is_some_and(|origin| is_ours(&origin)) {
            return None;
        }
        let (origin, called) = (shown(origin), called.as_ref().map_or("nothing", Authority::as_str));
        Some(format!(
            "pages at {origin} may not do this, because doorcam was called as {called}: if they are its own, have the \
             proxy pass on the header Host with its port, or add \"{origin}\" to access.allowed_origins"
        ))
    }
}

/// Lets pages of the configured origins send requests and read the answers; `None` without any.
pub(super) fn cors(allowed: &[Origin]) -> Option<CorsLayer> {
    if allowed.is_empty() {
        return None;
    }
    let allowed = allowed.to_vec();
    let is_allowed = move |origin: &HeaderValue, _: &_| {
        Origin::parse(origin.as_bytes()).is_some_and(|origin| allowed.iter().any(|allowed| allowed.is(&origin)))
    };
    let layer = CorsLayer::new()
        .allow_origin(AllowOrigin::predicate(is_allowed))
        .allow_methods([Method::GET, Method::HEAD, Method::POST, Method::PUT, Method::DELETE])
        .allow_headers([header::AUTHORIZATION, header::CONTENT_TYPE, header::IF_MATCH, header::IF_NONE_MATCH])
        .expose_headers([header::ETAG, header::LINK, header::RETRY_AFTER, CAPTURED]);
    Some(layer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::AccessConfig;

    fn refusal(host: &'static str, origin: Option<&'static str>, site: Option<&'static str>) -> Option<String> {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, HeaderValue::from_static(host));
        if let Some(origin) = origin {
            headers.insert(header::ORIGIN, HeaderValue::from_static(origin));
        }
        if let Some(site) = site {
            headers.insert("sec-fetch-site", HeaderValue::from_static(site));
        }
        let config = AccessConfig { allowed_origins: vec!["https://dash.example".into()], ..AccessConfig::default() };
        Access::new(&config, "127.0.0.1:0".parse().unwrap(), |_| None).unwrap().foreign(&headers)
    }

    fn ours(host: &'static str, origin: Option<&'static str>, site: Option<&'static str>) -> bool {
        refusal(host, origin, site).is_none()
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
        for origin in ["HTTPS://Dash.Example", "https://dash.example:443"] {
            assert!(ours("127.0.0.1:8080", Some(origin), Some("cross-site")), "{origin}");
        }
        assert!(ours("[0:0:0:0:0:0:0:1]:8080", Some("http://[::1]:8080"), None));
        assert!(ours("door.lan.:8080", Some("http://door.lan.:8080"), None));
    }

    #[test]
    fn a_refusal_says_what_was_compared_and_what_helps() {
        // As behind a proxy on another port that passes the name on without it.
        let why = refusal("door.lan", Some("https://door.lan:8443"), None).unwrap();
        let expected = "pages at https://door.lan:8443 may not do this, because doorcam was called as door.lan: if they \
                        are its own, have the proxy pass on the header Host with its port, or add \
                        \"https://door.lan:8443\" to access.allowed_origins";
        assert_eq!(why, expected);
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
            "http://127.0.0.1:8080/",
            "http://127.0.0.1:8080/path",
            "http://u@127.0.0.1:8080",
            "http://127.0.0.1:8080@evil.example",
            "http://127.0.0.1:99999",
            "http://127.0.0.1:",
            "//127.0.0.1:8080",
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
