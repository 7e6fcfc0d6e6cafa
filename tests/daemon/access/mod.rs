//! The rules of access, each tried on the real program by somebody who breaks it.

mod attempts;
mod client;
mod headers;
mod hosts;
mod images;
mod limits;
mod session;
mod tls;
mod tokens;
