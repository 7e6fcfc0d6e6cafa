//! The page, the REST API and the live socket.

mod access;
mod api;
mod assets;
mod calibration;
mod connections;
mod frame;
mod live;
mod people;
mod pictures;
mod problem;
mod recording;
mod secret_file;
mod signal;
mod uncertainty;
mod zones;

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::Router;
use axum::http::{Method, Uri, header};
use axum::response::IntoResponse;
use axum::routing::{get, post};
use metrics_exporter_prometheus::PrometheusHandle;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::timeout;
use tower_http::compression::CompressionLayer;

pub use self::access::{Access, AccessError};
pub use self::connections::{Tls, TlsError};
use self::pictures::Pictures;
use self::problem::Problem;
use crate::config::ServerConfig;
use crate::pipeline::{Calibrator, Control, Hub, Recordings, ZoneKeeper};

/// Why the server is not there.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {reason} (choose another with --listen or server.listen)")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why not.
        reason: String,
    },
}

/// What a server shows and steers.
pub struct Backend {
    /// Updates and status.
    pub hub: Arc<Hub>,
    /// The frame loop.
    pub control: Control,
    /// The calibration.
    pub calibrator: Calibrator,
    /// Recordings of what the source gives.
    pub recordings: Arc<Recordings>,
    /// The zones.
    pub zones: ZoneKeeper,
    /// The recorder of `/metrics`; none for none.
    pub metrics: Option<PrometheusHandle>,
}

/// What every request can see.
#[derive(Clone)]
struct Shared {
    hub: Arc<Hub>,
    control: Control,
    calibrator: Arc<Calibrator>,
    recordings: Arc<Recordings>,
    zones: Arc<ZoneKeeper>,
    metrics: Option<PrometheusHandle>,
    pictures: Arc<Pictures>,
    encoded: Arc<frame::Encoded>,
    uncertain: Arc<uncertainty::Mapped>,
    clients: Arc<AtomicUsize>,
    /// Turns true when the server ends: open sockets would hold it up for ever.
    ending: watch::Receiver<bool>,
}

/// A bound address, not yet served.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    config: ServerConfig,
    access: Arc<Access>,
    tls: Option<Arc<Tls>>,
}

/// How long clients are given to leave when the server ends.
const FAREWELL: Duration = Duration::from_millis(1500);

impl Server {
    /// Binds the configured address, under these rules of access and with TLS, if any; port 0 takes a free one.
    pub async fn bind(config: &ServerConfig, access: Access, tls: Option<Tls>) -> Result<Self, ServerError> {
        let address = config.listen;
        let failed = |e: std::io::Error| ServerError::Listen {
            address,
            reason: match e.kind() {
                std::io::ErrorKind::AddrInUse => "the port is in use".into(),
                std::io::ErrorKind::PermissionDenied => "permission denied".into(),
                std::io::ErrorKind::AddrNotAvailable => "this machine does not have that address".into(),
                _ => e.to_string(),
            },
        };
        let listener = TcpListener::bind(address).await.map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let access = Arc::new(access.on(address.port(), tls.is_some()));
        Ok(Self { listener, address, config: config.clone(), access, tls: tls.map(Arc::new) })
    }

    /// Where it listens, as browsers write it.
    pub fn url(&self) -> String {
        format!("{}://{}", if self.tls.is_some() { "https" } else { "http" }, self.address)
    }

    /// Serves until `end` completes, then tells clients and gives them a moment to leave.
    pub async fn serve(self, backend: Backend, end: impl Future<Output = ()>) {
        let Backend { hub, control, calibrator, recordings, zones, metrics } = backend;
        let (tell, ending) = watch::channel(false);
        let shared = Shared {
            hub,
            control,
            calibrator: Arc::new(calibrator),
            recordings,
            zones: Arc::new(zones),
            metrics,
            pictures: Arc::default(),
            encoded: Arc::default(),
            uncertain: Arc::default(),
            clients: Arc::default(),
            ending: ending.clone(),
        };
        tokio::select! {
            () = connections::serve(self.listener, routes(shared, self.access), &self.config, self.tls, ending) => {}
            () = end => {}
        }
        tell.send_replace(true);
        // Each connection holds a receiver, and so does each live socket that one has become. Who does not leave is cut off.
        let _ = timeout(FAREWELL, tell.closed()).await;
    }
}

fn routes(shared: Shared, access: Arc<Access>) -> Router {
    let v1 = Router::new()
        .route("/status", get(api::status))
        .route("/geometry", get(api::geometry))
        .route("/reconstruction", get(api::reconstruction))
        .route("/reconstruction.png", get(api::reconstruction_png))
        .route("/difference.png", get(api::difference_png))
        .route("/patches.png", get(api::patches_png))
        .route("/signal", get(signal::signal))
        .route("/tracks", get(people::tracks))
        .route("/tracks/{id}", get(people::track))
        .route("/events", get(people::events))
        .route("/zones", get(people::zones).put(zones::put).delete(zones::delete))
        .route("/recording", get(recording::get).post(recording::post).delete(recording::delete))
        .route("/uncertainty", get(uncertainty::uncertainty))
        .route("/calibration", get(calibration::get).put(calibration::put))
        .route("/calibration/check", post(calibration::check))
        .route("/calibration/previous", post(calibration::previous))
        .route("/frame.jpg", get(frame::frame))
        .route("/background/reset", post(api::reset_background))
        .route("/live", get(live::live))
        .route("/session", access::session::methods(Arc::clone(&access)));
    let all = Router::new()
        .nest("/api/v1", v1)
        .route("/livez", get(|| async { "alive\n" }))
        .route("/readyz", get(api::readyz))
        .route("/metrics", get(prometheus))
        .fallback(not_found_or_asset)
        .method_not_allowed_fallback(|method: Method, uri: Uri| async move {
            Problem::method_not_allowed(&format!("{method} is not possible on {}", uri.path()))
        })
        // The page and JSON; pictures are compressed already, and left alone.
        .layer(CompressionLayer::new())
        .with_state(shared);
    access::layers(all, access)
}

/// The figures for Prometheus; none unless a recorder was installed.
async fn prometheus(axum::extract::State(shared): axum::extract::State<Shared>) -> axum::response::Response {
    metrics::gauge!("doorcam_clients").set(shared.clients.load(Ordering::Relaxed) as f64);
    let kind = [(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")];
    (kind, shared.metrics.as_ref().map(PrometheusHandle::render).unwrap_or_default()).into_response()
}

async fn not_found_or_asset(request: axum::extract::Request) -> axum::response::Response {
    assets::serve(&request)
}
