//! Tests that try to break each rule of access, on the real program.

mod attempts;
mod client;
mod headers;
mod hosts;
mod images;
mod limits;
mod odd;
mod proxies;
mod revoked;
mod session;
mod tls;
mod tokens;
