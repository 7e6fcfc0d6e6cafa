//! Connections: how many, for how long, over TLS or not. What travels on them is nobody's business here.

mod held;
mod slots;

use std::net::SocketAddr;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tower::ServiceExt;

use self::held::Held;
use self::slots::Slots;
use super::access::Peer;
use crate::config::ServerConfig;

/// How long a client may take for the head of a request, and do nothing before it: an idle connection is closed then.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// How long a client may take no bytes of an answer.
const WRITE_TIME: Duration = Duration::from_secs(20);
/// Lines of a request's head.
const MOST_HEADERS: usize = 64;
/// Bytes of a request's head, all lines together.
const LONGEST_HEAD: usize = 16 * 1024;
/// How long nothing is accepted when the system has no more sockets.
const OUT_OF_SOCKETS: Duration = Duration::from_millis(500);

/// Serves connections until `ending` turns true, and those that are open to their end: each holds a receiver until then.
pub(super) async fn serve(
    listener: TcpListener,
    router: Router,
    config: &ServerConfig,
    mut ending: watch::Receiver<bool>,
) {
    let slots = Slots::new(config.max_connections, config.max_connections_per_address);
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = end(&mut ending) => return,
        };
        match accepted {
            Ok((stream, address)) => {
                let Some(slot) = slots.take(address.ip()) else {
                    tracing::debug!("{address}: turned away, too many connections");
                    continue;
                };
                let (router, ending) = (router.clone(), ending.clone());
                tokio::spawn(one(Held::new(stream, slot, WRITE_TIME), address, router, ending));
            }
            Err(e) if is_of_one_connection(&e) => {}
            Err(e) => {
                tracing::warn!("cannot accept a connection: {e}");
                tokio::time::sleep(OUT_OF_SOCKETS).await;
            }
        }
    }
}

/// Serves one connection to its end.
async fn one(stream: Held<TcpStream>, address: SocketAddr, router: Router, ending: watch::Receiver<bool>) {
    requests(stream, address, router, ending).await;
}

async fn requests(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    address: SocketAddr,
    router: Router,
    mut ending: watch::Receiver<bool>,
) {
    let peer = Peer(address.ip());
    let service = router.map_request(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(peer);
        request
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME)
        .max_headers(MOST_HEADERS)
        .max_buf_size(LONGEST_HEAD)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(service))
        .with_upgrades();
    let mut connection = std::pin::pin!(connection);
    let result = tokio::select! {
        result = connection.as_mut() => result,
        () = end(&mut ending) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(e) = result {
        tracing::debug!("{address}: {e}");
    }
}

/// Completes when the server ends, or is gone.
async fn end(ending: &mut watch::Receiver<bool>) {
    let _ = ending.wait_for(|&end| end).await;
}

/// Whether accepting failed for reasons of the connection that went away meanwhile.
fn is_of_one_connection(e: &std::io::Error) -> bool {
    use std::io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(e.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}
