//! Connections: their number, their timeouts and TLS, whatever they carry.

mod answered;
mod certificate;
mod held;
mod slots;
mod tls;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::time::timeout;
use tower::ServiceExt;

use self::answered::answered;
use self::held::Held;
use self::slots::{Slots, Use};
pub use self::tls::{Tls, TlsError};
use super::access::Peer;
use crate::config::ServerConfig;

/// How long the TLS handshake may take.
const GREETING_TIME: Duration = Duration::from_secs(10);
/// How long a client may take for the head of a request, including the idle time before it.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// How long a client may go without taking any bytes of an answer.
const WRITE_TIME: Duration = Duration::from_secs(20);
/// Most header lines of a request.
const MOST_HEADERS: usize = 64;
/// Longest head of a request, in bytes.
const LONGEST_HEAD: usize = 16 * 1024;
/// Most unsent bytes that the system buffers for a connection, a few updates.
#[cfg(target_os = "linux")]
const UNSENT: u32 = 16_384;
/// The pause before accepting again when the system has run out of sockets.
const OUT_OF_SOCKETS: Duration = Duration::from_millis(500);

/// Accepts connections until `ending` turns true. Open ones are served to their end; each holds a receiver until then.
pub(super) async fn serve(
    listener: TcpListener,
    router: Router,
    config: ServerConfig,
    tls: Option<Arc<Tls>>,
    ending: watch::Receiver<bool>,
) {
    let following = async {
        match &tls {
            Some(tls) => Arc::clone(tls).follow().await,
            None => std::future::pending().await,
        }
    };
    tokio::select! {
        () = accept(listener, router, &config, &tls, ending) => {}
        () = following => {}
    }
}

/// Keeps data out of the system's buffers: a message goes out at once, and what the client cannot take yet stays here,
/// where a newer message replaces it. The system would buffer megabytes, a minute of updates.
fn newest_first(stream: &TcpStream) {
    // If either fails, slow clients merely get their updates late.
    let _ = stream.set_nodelay(true);
    #[cfg(target_os = "linux")]
    let _ = socket2::SockRef::from(stream).set_tcp_notsent_lowat(UNSENT);
}

async fn accept(
    listener: TcpListener,
    router: Router,
    config: &ServerConfig,
    tls: &Option<Arc<Tls>>,
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
                newest_first(&stream);
                let Some(slot) = slots.take(address.ip()) else {
                    tracing::debug!("{address}: turned away, too many connections");
                    continue;
                };
                let (router, tls, ending) = (router.clone(), tls.clone(), ending.clone());
                let (gone, uses) = (slot.gone(), slot.uses());
                let served = one(Held::new(stream, slot, WRITE_TIME), address, uses, router, tls, ending);
                tokio::spawn(async move {
                    tokio::select! {
                        () = served => {}
                        () = gone.notified() => tracing::debug!("{address}: idle, closed for another connection"),
                    }
                });
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
async fn one(
    stream: Held<TcpStream>,
    address: SocketAddr,
    uses: Use,
    router: Router,
    tls: Option<Arc<Tls>>,
    mut ending: watch::Receiver<bool>,
) {
    let Some(tls) = tls else { return requests(stream, address, uses, router, ending).await };
    let greeted = tokio::select! {
        greeted = timeout(GREETING_TIME, tls.acceptor().accept(stream)) => greeted,
        () = end(&mut ending) => return,
    };
    match greeted {
        Ok(Ok(stream)) => requests(stream, address, uses, router, ending).await,
        Ok(Err(e)) => tracing::debug!("{address}: TLS handshake failed: {e}"),
        Err(_) => tracing::debug!("{address}: no TLS handshake within {} s", GREETING_TIME.as_secs()),
    }
}

async fn requests(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    address: SocketAddr,
    uses: Use,
    router: Router,
    mut ending: watch::Receiver<bool>,
) {
    let peer = Peer(address.ip());
    let service = service_fn(move |mut request: Request<Incoming>| {
        let busy = uses.begin();
        request.extensions_mut().insert(peer);
        let answer = router.clone().oneshot(request);
        async move { answer.await.map(|answer| answered(answer, busy)) }
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME)
        .max_headers(MOST_HEADERS)
        .max_buf_size(LONGEST_HEAD)
        .serve_connection(TokioIo::new(stream), service)
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

/// Completes when the server ends or the sender is dropped.
async fn end(ending: &mut watch::Receiver<bool>) {
    let _ = ending.wait_for(|&end| end).await;
}

/// Whether accepting failed only because this connection has gone away meanwhile.
fn is_of_one_connection(e: &std::io::Error) -> bool {
    use std::io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(e.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}
