use std::net::{IpAddr, SocketAddr};

use axum::http::{HeaderMap, HeaderName};

use super::Peer;

/// Says for whom a proxy asks: each proxy on the way appends the address that it was asked from.
const FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");

/// The proxies whose word on their clients' addresses is taken. Anybody else could write anything there.
#[derive(Debug, Default)]
pub(super) struct Proxies(Vec<IpAddr>);

impl Proxies {
    pub(super) fn new(addresses: &[IpAddr]) -> Self {
        Self(addresses.iter().map(IpAddr::to_canonical).collect())
    }

    /// The address that a request comes from: that of the connection or, if a trusted proxy made it, the last one that
    /// is none of the trusted proxies.
    pub(super) fn client(&self, Peer(peer): Peer, headers: &HeaderMap) -> IpAddr {
        let trusted = |address: &IpAddr| self.0.contains(&address.to_canonical());
        let mut client = peer;
        let lists = headers.get_all(FORWARDED_FOR).iter().rev();
        let mut named = lists.flat_map(|list| list.as_bytes().rsplit(|&byte| byte == b',')).map(address);
        while trusted(&client) {
            // Beyond what cannot be read, anything could be made up.
            let Some(Some(next)) = named.next() else { break };
            client = next;
        }
        client
    }
}

/// An address of a list, perhaps with a port.
fn address(text: &[u8]) -> Option<IpAddr> {
    let text = str::from_utf8(text).ok()?.trim();
    let plain = text.strip_prefix('[').and_then(|text| text.strip_suffix(']')).unwrap_or(text);
    plain.parse().ok().or_else(|| text.parse().ok().map(|address: SocketAddr| address.ip()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(trusted: &[&str], peer: &str, lists: &[&'static str]) -> String {
        let trusted: Vec<IpAddr> = trusted.iter().map(|address| address.parse().unwrap()).collect();
        let mut headers = HeaderMap::new();
        for list in lists {
            headers.append(FORWARDED_FOR, list.parse().unwrap());
        }
        Proxies::new(&trusted).client(Peer(peer.parse().unwrap()), &headers).to_string()
    }

    #[test]
    fn only_trusted_proxies_are_believed() {
        assert_eq!(client(&[], "127.0.0.1", &["192.0.2.1"]), "127.0.0.1");
        assert_eq!(client(&["127.0.0.1"], "192.0.2.9", &["192.0.2.1"]), "192.0.2.9");
        assert_eq!(client(&["127.0.0.1"], "127.0.0.1", &["192.0.2.1"]), "192.0.2.1");
        assert_eq!(client(&["127.0.0.1"], "::ffff:127.0.0.1", &["2001:db8::1"]), "2001:db8::1");
        assert_eq!(client(&["127.0.0.1"], "127.0.0.1", &[]), "127.0.0.1");
    }

    #[test]
    fn what_a_client_writes_itself_is_not_believed() {
        let proxy = ["127.0.0.1", "10.0.0.1"];
        // The proxy appends the client's address to whatever the client has sent.
        assert_eq!(client(&proxy, "127.0.0.1", &["198.51.100.1, 192.0.2.1"]), "192.0.2.1");
        assert_eq!(client(&proxy, "127.0.0.1", &["198.51.100.1", "192.0.2.1,10.0.0.1"]), "192.0.2.1");
        assert_eq!(client(&proxy, "127.0.0.1", &["192.0.2.1, unknown"]), "127.0.0.1");
        assert_eq!(client(&proxy, "127.0.0.1", &["192.0.2.1:4711"]), "192.0.2.1");
        assert_eq!(client(&proxy, "127.0.0.1", &["[2001:db8::1]:80"]), "2001:db8::1");
        assert_eq!(client(&proxy, "127.0.0.1", &["[2001:db8::1]"]), "2001:db8::1");
        assert_eq!(client(&proxy, "127.0.0.1", &["127.0.0.1"]), "127.0.0.1");
    }
}
