//! The HTTP server: the page, the REST API and the live socket.

mod access;
mod answers;
mod api;
mod assets;
mod calibration;
mod connections;
mod crossings;
mod frame;
mod history;
mod jobs;
mod live;
mod openapi;
mod people;
mod pictures;
mod problem;
mod recording;
mod room;
pub(crate) mod secret_file;
mod signal;
mod stream;
mod tag;
mod uncertainty;
mod zones;

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::time::{Duration, SystemTime};

use axum::Router;
use axum::extract::FromRef;
use axum::http::{Method, Uri};
use axum::response::IntoResponse;
use metrics_exporter_prometheus::PrometheusHandle;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::timeout;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{DefaultPredicate, NotForContentType, Predicate};
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub use self::access::{Access, AccessError};
pub use self::connections::{Tls, TlsError};
use self::jobs::Jobs;
pub use self::openapi::{live_schema_json, openapi_json};
use self::pictures::Pictures;
use self::problem::ProblemDetails;
use crate::config::{Config, ServerConfig};
use crate::history::History;
use crate::publish::Publishers;
use crate::watch::{Calibrator, Control, CrossingKeeper, Hub, Recordings, ZoneKeeper};

/// Why the server cannot start.
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

/// Everything that the server shows and controls.
pub struct Backend {
    /// Updates and status.
    pub hub: Arc<Hub>,
    /// The frame loop.
    pub control: Control,
    /// The calibration.
    pub calibrator: Arc<Calibrator>,
    /// The configuration in use; a reload changes it.
    pub config: watch::Receiver<Config>,
    /// Recordings of the source.
    pub recordings: Arc<Recordings>,
    /// The zones.
    pub zones: Arc<ZoneKeeper>,
    /// Who walked through the doorway.
    pub crossings: Arc<CrossingKeeper>,
    /// Events and occupancy.
    pub history: History,
    /// The MQTT broker and the webhooks that are told of them.
    pub publishers: Publishers,
    /// Renders `/metrics`; without it the answer is empty.
    pub metrics: Option<PrometheusHandle>,
}

/// The state that all handlers share.
#[derive(Clone)]
struct Shared {
    hub: Arc<Hub>,
    control: Control,
    calibrator: Arc<Calibrator>,
    config: watch::Receiver<Config>,
    recordings: Arc<Recordings>,
    zones: Arc<ZoneKeeper>,
    crossings: Arc<CrossingKeeper>,
    history: History,
    turns: history::Turns,
    publishers: Publishers,
    metrics: Option<PrometheusHandle>,
    pictures: Arc<Pictures>,
    encoded: Arc<frame::Encoded>,
    uncertain: Arc<uncertainty::Mapped>,
    clients: Arc<AtomicUsize>,
    jobs: Arc<Jobs>,
    access: Arc<Access>,
    /// Differs from run to run, so that an ETag made from a counter never matches one of an earlier run.
    run: u64,
    /// Turns true when the server ends, so that open sockets close; otherwise they would keep it running for ever.
    ending: watch::Receiver<bool>,
}

impl FromRef<Shared> for Arc<Access> {
    fn from_ref(shared: &Shared) -> Self {
        Arc::clone(&shared.access)
    }
}

/// A server that is bound to its address but does not serve yet.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    config: ServerConfig,
    access: Arc<Access>,
    tls: Option<Arc<Tls>>,
}

/// How long clients get to disconnect when the server ends.
const FAREWELL: Duration = Duration::from_millis(1500);

impl Server {
    /// Binds the configured address; port 0 takes a free port. Without `tls` it serves plain HTTP.
    ///
    /// # Errors
    ///
    /// If the address cannot be bound.
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

    /// The address that it listens on, as a URL.
    pub fn url(&self) -> String {
        format!("{}://{}", if self.tls.is_some() { "https" } else { "http" }, self.address)
    }

    /// The access rules, whose tokens a reload can replace.
    pub fn access(&self) -> Arc<Access> {
        Arc::clone(&self.access)
    }

    /// Serves until `end` completes, then tells the clients and gives them a moment to disconnect.
    pub async fn serve(self, backend: Backend, end: impl Future<Output = ()>) {
        let Backend { hub, control, calibrator, config, recordings, zones, crossings, history, publishers, metrics } =
            backend;
        let (tell, ending) = watch::channel(false);
        let shared = Shared {
            hub,
            control,
            calibrator,
            config,
            recordings,
            zones,
            crossings,
            history,
            turns: history::Turns::default(),
            publishers,
            metrics,
            pictures: Arc::default(),
            encoded: Arc::default(),
            uncertain: Arc::default(),
            clients: Arc::default(),
            jobs: Arc::default(),
            access: Arc::clone(&self.access),
            run: SystemTime::UNIX_EPOCH.elapsed().map_or(0, |since| since.as_micros() as u64),
            ending: ending.clone(),
        };
        // A task of its own: `end` also reloads the configuration, and connections must not wait for that.
        let router = routes(shared, self.access);
        let serving = tokio::spawn(connections::serve(self.listener, router, self.config, self.tls, ending));
        tokio::select! {
            // An error is a panic, which was reported when it happened.
            _ = serving => {}
            () = end => {}
        }
        tell.send_replace(true);
        // Each connection holds a receiver of `ending`, and so does each live socket, so this waits until all are
        // closed. Those still open at the timeout are cut off.
        let _ = timeout(FAREWELL, tell.closed()).await;
    }
}

/// Every route of the API with its description; no route is served without one.
fn described() -> OpenApiRouter<Shared> {
    let v1 = OpenApiRouter::new()
        .routes(routes!(api::status))
        .routes(routes!(api::geometry))
        .routes(routes!(room::room))
        .routes(routes!(api::reconstruction))
        .routes(routes!(api::reconstruction_png))
        .routes(routes!(api::difference_png))
        .routes(routes!(api::patches_png))
        .routes(routes!(signal::signal))
        .routes(routes!(people::tracks))
        .routes(routes!(people::track))
        .routes(routes!(history::events))
        .routes(routes!(history::occupancy))
        .routes(routes!(people::zones, zones::put, zones::delete))
        .routes(routes!(crossings::get, crossings::put))
        .routes(routes!(recording::get, recording::post, recording::delete))
        .routes(routes!(uncertainty::uncertainty))
        .routes(routes!(calibration::get, calibration::put))
        .routes(routes!(calibration::check))
        .routes(routes!(calibration::previous))
        .routes(routes!(calibration::reference))
        .routes(routes!(frame::frame))
        .routes(routes!(stream::stream))
        .routes(routes!(api::reset_background))
        .routes(routes!(live::live))
        .routes(routes!(access::session::tell, access::session::begin, access::session::end))
        .routes(routes!(api::config))
        .routes(routes!(openapi::live_schema))
        .routes(routes!(openapi::openapi));
    OpenApiRouter::with_openapi(openapi::About::openapi())
        .nest("/api/v1", v1)
        .routes(routes!(api::livez))
        .routes(routes!(api::readyz))
        .routes(routes!(api::prometheus))
}

fn routes(shared: Shared, access: Arc<Access>) -> Router {
    let all = Router::from(described())
        .fallback(not_found_or_asset)
        .method_not_allowed_fallback(|method: Method, uri: Uri| async move {
            ProblemDetails::method_not_allowed(&format!("{method} is not possible on {}", uri.path()))
        })
        .layer(CatchPanicLayer::custom(|_| {
            // The panic itself is in the log.
            ProblemDetails::internal("doorcam failed on an internal error").into_response()
        }))
        // For the page and JSON: images and the multipart stream are compressed already.
        .layer(CompressionLayer::new().compress_when(DefaultPredicate::new().and(NotForContentType::new("multipart/"))))
        .with_state(shared);
    access::layers(all, access)
}

async fn not_found_or_asset(request: axum::extract::Request) -> axum::response::Response {
    assets::serve(&request)
}
