use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::told::shown;
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
        let names = names.iter().map(|name| plain(name)).collect();
        Self { names, addresses: !is_loopback(listen) }
    }

    /// Whether this is one of them. The port does not matter, because a proxy or a forwarded port has its own.
    fn allow(&self, host: &Authority) -> bool {
        if !is_sound(host) {
            return false;
        }
        let host = plain(host.host());
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

    /// The allowed ones, in words.
    fn in_words(&self) -> String {
        let addresses = if self.addresses { "an IP address" } else { "a loopback address" };
        let names: String = self.names.iter().map(|name| format!("{name}, ")).collect();
        format!("{names}localhost or {addresses}")
    }
}

/// A name as it is compared: in lower case and without the dot of the root, which may follow any name.
fn plain(host: &str) -> String {
    let host = host.to_ascii_lowercase();
    host.strip_suffix('.').map(str::to_owned).unwrap_or(host)
}

/// Whether an authority is a host, perhaps with a port, and nothing else.
pub(super) fn is_sound(authority: &Authority) -> bool {
    let (all, host) = (authority.as_str(), authority.host());
    let port = all.strip_prefix(host).map(|rest| rest.strip_prefix(':').unwrap_or(rest));
    let is_port =
        |port: &str| port.bytes().all(|b| b.is_ascii_digit()) && (port.is_empty() || port.parse::<u16>().is_ok());
    !host.is_empty() && port.is_some_and(is_port)
}

/// The host that a request names; `None` unless it names exactly one.
pub(super) fn host_of(headers: &HeaderMap) -> Option<Authority> {
    let mut all = headers.get_all(header::HOST).iter();
    let host = all.next()?.to_str().ok()?;
    if all.next().is_some() { None } else { Authority::from_str(host).ok().filter(is_sound) }
}

/// Lets a request pass if it calls doorcam by an allowed name.
pub(super) async fn check(State(access): State<Arc<Access>>, request: Request, next: Next) -> Response {
    let Some(host) = host_of(request.headers()) else {
        let count = request.headers().get_all(header::HOST).iter().count();
        let first = request.headers().get(header::HOST).map(|host| shown(host.as_bytes())).unwrap_or_default();
        let expected = "expected one header Host with a name or address";
        access.foreign_hosts.tell(|| format!("refused a request with {count} headers Host ({first}), {expected}"));
        return ProblemDetails::bad_request(expected).into_response();
    };
    // A request line with an absolute URI must not get past the check.
    let line = request.uri().authority();
    let foreign = std::iter::once(&host).chain(line).find(|host| !access.hosts.allow(host));
    let Some(foreign) = foreign else { return next.run(request).await };
    let name = shown(foreign.host().as_bytes());
    access.foreign_hosts.tell(|| {
        let expected = access.hosts.in_words();
        format!("refused a request to \"{name}\", expected {expected}; other names belong in access.allowed_hosts")
    });
    let detail = format!(
        "this address is not allowed: {name} is not a name of this doorcam; if it should be, add \"{name}\" to \
         access.allowed_hosts"
    );
    ProblemDetails::new(StatusCode::FORBIDDEN, &detail).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn allows(names: &[&str], listen: &str, host: &str) -> bool {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        let hosts = Hosts::new(&names, listen.parse().unwrap());
        Authority::from_str(host).is_ok_and(|host| hosts.allow(&host))
    }

    #[test]
    fn on_loopback_only_loopback_names_are_its_own() {
        for host in [
            "localhost",
            "LOCALHOST:8080",
            "localhost.",
            "Localhost.:8080",
            "localhost:",
            "127.0.0.1",
            "127.0.0.1:9",
            "[::1]",
            "[::1]:80",
            "[0:0:0:0:0:0:0:1]",
            "[::ffff:127.0.0.1]:80",
            "door.localhost",
        ] {
            assert!(allows(&[], "127.0.0.1:8080", host), "{host}");
        }
        for host in [
            "evil.example",
            "localhost.evil.example",
            "evil.example.",
            "localhost..",
            "xlocalhost",
            "192.168.1.2:8080",
            "0.0.0.0",
            "[::]",
            "127.0.0.1.evil.example",
            "u@localhost",
            "localhost:99999",
            "localhost:+80",
            "localhost:8o",
        ] {
            assert!(!allows(&[], "127.0.0.1:8080", host), "{host}");
        }
    }

    #[test]
    fn elsewhere_addresses_are_its_own_and_names_only_as_configured() {
        for host in ["192.168.1.2:8080", "[fe80::1]", "localhost:1", "Door.Lan:8080", "door.lan.", "DOOR.LAN.:443"] {
            assert!(allows(&["door.lan"], "0.0.0.0:8080", host), "{host}");
        }
        for host in ["evil.example", "door.lan.evil.example", "lan", "xdoor.lan"] {
            assert!(!allows(&["door.lan"], "0.0.0.0:8080", host), "{host}");
        }
        assert!(allows(&["door.lan."], "127.0.0.1:1", "door.lan"));
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
        for wrong in [&[] as &[&'static str], &["a", "a"], &["a b"], &[""], &[":80"], &["u@a"], &["a:b"], &["a:65536"]]
        {
            assert!(of(wrong).is_none(), "{wrong:?}");
        }
    }
}
