use std::net::IpAddr;

/// The address at the other end of a request's connection, an extension of every request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::server) struct Peer(pub(in crate::server) IpAddr);
