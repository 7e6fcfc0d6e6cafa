use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::{Access, is_loopback};
use crate::server::problem::Problem;

/// By which names doorcam may be called. A page of somebody else's whose name suddenly means this machine (DNS rebinding) is of
/// the same origin for its browser; only the name that it calls gives it away.
#[derive(Debug)]
pub(super) struct Hosts {
    /// Configured ones, in lower case.
    names: Vec<String>,
    /// Whether any address will do. None can be rebound; but where only this machine can call, it calls loopback.
    addresses: bool,
}

impl Hosts {
    pub(super) fn new(names: &[String], listen: SocketAddr) -> Self {
        let names = names.iter().map(|name| name.to_ascii_lowercase()).collect();
        Self { names, addresses: !is_loopback(listen) }
    }

    /// Whether this is one of them, with whatever port: a proxy or a forwarded port has its own.
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
            // Resolvers must not ask anybody else for these (RFC 6761).
            Err(_) => host == "localhost" || host.ends_with(".localhost"),
        }
    }
}

/// The name that a request calls doorcam by; none unless there is just one.
pub(super) fn host_of(headers: &HeaderMap) -> Option<Authority> {
    let mut all = headers.get_all(header::HOST).iter();
    let host = all.next()?.to_str().ok()?;
    if all.next().is_some() { None } else { Authority::from_str(host).ok() }
}

/// Lets pass who calls doorcam by its name.
pub(super) async fn check(State(access): State<Arc<Access>>, request: Request, next: Next) -> Response {
    let Some(host) = host_of(request.headers()) else {
        return Problem::bad_request("expected one header Host with a name or address").into_response();
    };
    // A request line with a whole address must not get past the check.
    let line = request.uri().authority();
    if access.hosts.allow(&host) && line.is_none_or(|line| access.hosts.allow(line)) {
        return next.run(request).await;
    }
    let detail = format!("this doorcam is not called {}: see access.allowed_hosts", host.host());
    Problem::new(StatusCode::FORBIDDEN, &detail).into_response()
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
