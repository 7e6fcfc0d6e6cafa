use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::{Access, is_loopback};
use crate::server::problem::ProblemDetails;

/// The host names by which doorcam may be called. If the name of a foreign page is made to resolve to this machine (DNS
/// rebinding), the browser takes both for the same origin; only the host name in the request gives the page away.
#[derive(Debug)]
pub(super) struct Hosts {
    /// The configured ones, in lower case.
    names: Vec<String>,
    /// Whether any IP address is allowed, since addresses cannot be rebound. Otherwise only loopback, which is all that
    /// is needed when only this machine can connect.
    addresses: bool,
}

impl Hosts {
    pub(super) fn new(names: &[String], listen: SocketAddr) -> Self {
        let names = names.iter().map(|name| name.to_ascii_lowercase()).collect();
        Self { names, addresses: !is_loopback(listen) }
    }

    /// Whether this is one of them. The port does not matter, because a proxy or a forwarded port has its own.
    fn allow(&self, host: &Authority) -> bool {
        if host.as_str().contains('@') {
            return false;
        }
        let host = host.host().to_ascii_lowercase();
        let address = host.strip_prefix('[').and_then(|h| h.strip_suffix(']')).unwrap_or(&host);
        if self.names.iter().any(|name| *name == host || *name == address) {
            return true;
        }
        match address.parse::<IpAddr>() {
            Ok(address) => self.addresses || address.to_canonical().is_loopback(),
            // These names always resolve to loopback (RFC 6761).
            Err(_) => host == "localhost" || host.ends_with(".localhost"),
        }
    }
}

/// The host that a request names; `None` unless it names exactly one.
pub(super) fn host_of(headers: &HeaderMap) -> Option<Authority> {
    let mut all = headers.get_all(header::HOST).iter();
    let host = all.next()?.to_str().ok()?;
    if all.next().is_some() { None } else { Authority::from_str(host).ok() }
}

/// Lets a request pass if it calls doorcam by an allowed name.
pub(super) async fn check(State(access): State<Arc<Access>>, request: Request, next: Next) -> Response {
    let Some(host) = host_of(request.headers()) else {
        return ProblemDetails::bad_request("expected one header Host with a name or address").into_response();
    };
    // A request line with an absolute URI must not get past the check.
    let line = request.uri().authority();
    if access.hosts.allow(&host) && line.is_none_or(|line| access.hosts.allow(line)) {
        return next.run(request).await;
    }
    let detail = format!("{} is not a name of this doorcam: see access.allowed_hosts", host.host());
    ProblemDetails::new(StatusCode::FORBIDDEN, &detail).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn allows(names: &[&str], listen: &str, host: &str) -> bool {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        Hosts::new(&names, listen.parse().unwrap()).allow(&Authority::from_str(host).unwrap())
    }

    #[test]
    fn on_loopback_only_loopback_names_are_its_own() {
        for host in ["localhost", "LOCALHOST:8080", "127.0.0.1", "127.0.0.1:9", "[::1]", "[::1]:80", "door.localhost"] {
            assert!(allows(&[], "127.0.0.1:8080", host), "{host}");
        }
        for host in
            ["evil.example", "localhost.evil.example", "192.168.1.2:8080", "127.0.0.1.evil.example", "u@localhost"]
        {
            assert!(!allows(&[], "127.0.0.1:8080", host), "{host}");
        }
    }

    #[test]
    fn elsewhere_addresses_are_its_own_and_names_only_as_configured() {
        for host in ["192.168.1.2:8080", "[fe80::1]", "localhost:1", "Door.Lan:8080"] {
            assert!(allows(&["door.lan"], "0.0.0.0:8080", host), "{host}");
        }
        for host in ["evil.example", "door.lan.evil.example", "lan", "xdoor.lan"] {
            assert!(!allows(&["door.lan"], "0.0.0.0:8080", host), "{host}");
        }
        assert!(allows(&["DOOR.lan", "::2"], "127.0.0.1:1", "door.LAN") && allows(&["::2"], "127.0.0.1:1", "[::2]:80"));
    }

    #[test]
    fn a_request_has_one_host() {
        let of = |hosts: &[&'static str]| {
            let mut headers = HeaderMap::new();
            for host in hosts {
                headers.append(header::HOST, host.parse().unwrap());
            }
            host_of(&headers)
        };
        assert_eq!(of(&["a.example:80"]).unwrap().host(), "a.example");
        assert!(of(&[]).is_none() && of(&["a", "a"]).is_none() && of(&["a b"]).is_none() && of(&[""]).is_none());
    }
}
