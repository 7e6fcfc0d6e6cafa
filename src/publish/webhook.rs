use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use jiff::Timestamp;
use metrics::{Counter, counter, describe_counter};
use rustls::crypto::ring;
use serde::Serialize;
use ureq::tls::{Certificate, RootCerts, TlsConfig};
use utoipa::ToSchema;

use super::signature::sign;
use super::{PublishError, lock, secret};
use crate::config::{HookUrl, WebhookConfig, brief};
use doorcam_core::tracking::{Event, EventKind};
use doorcam_source::camera::Backoff;

/// Most events that wait for a receiver; further ones are given up.
const WAITING: usize = 1000;
/// Attempts to deliver an event before it is given up, over about four minutes.
const ATTEMPTS: u32 = 8;
/// First and longest delay between attempts.
const RETRY: [Duration; 2] = [Duration::from_secs(2), Duration::from_secs(120)];
/// How long a receiver may take to answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// Shortest time between two lines in the log about one receiver.
const LINE: Duration = Duration::from_secs(60);

/// The state of a webhook.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct WebhookReport {
    /// Its URL without the path, which may be secret.
    pub url: String,
    /// Events that wait to be delivered.
    pub waiting: u64,
    /// Events that were accepted.
    pub delivered: u64,
    /// Attempts that failed and were followed by another.
    pub retried: u64,
    /// Events that were given up (dead letters).
    pub dead: u64,
    /// What went wrong last; null after a success.
    #[schema(required)]
    pub error: Option<String>,
}

/// One receiver of events, which has its own thread.
pub(super) struct Webhook {
    kinds: Vec<EventKind>,
    queue: SyncSender<Event>,
    state: Arc<State>,
}

struct State {
    url: HookUrl,
    waiting: AtomicU64,
    delivered: AtomicU64,
    retried: AtomicU64,
    dead: AtomicU64,
    error: Mutex<Option<String>>,
    /// What the log said last about this receiver, and when.
    said: Mutex<Option<(String, Instant)>>,
    meters: [Counter; 3],
}

/// The body of a post.
#[derive(Serialize)]
struct Message<'a> {
    version: u32,
    /// The id of the doorway.
    site: &'a str,
    event: &'a Event,
}

struct Worker {
    state: Arc<State>,
    site: String,
    secret: String,
    agent: ureq::Agent,
    backoff: Backoff,
}

/// Why an attempt failed.
struct Failure {
    why: String,
    /// Whether another attempt may succeed.
    passing: bool,
}

impl Failure {
    fn of(error: ureq::Error) -> Self {
        match error {
            // ureq's message has the whole URL, which may contain a secret.
            ureq::Error::BadUri(_) => Self { why: "its url cannot be used".into(), passing: false },
            error => Self { why: one_line(&error.to_string()), passing: true },
        }
    }
}

/// A message that may contain parts of an answer, as one short line.
fn one_line(text: &str) -> String {
    let visible = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>();
    brief(&visible.split_whitespace().collect::<Vec<_>>().join(" "))
}

impl Webhook {
    pub(super) fn start(index: usize, config: &WebhookConfig, site: String) -> Result<Self, PublishError> {
        describe_counter!("doorcam_webhook_delivered_total", "Events that a webhook accepted");
        describe_counter!(
            "doorcam_webhook_retried_total",
            "Attempts to deliver an event that failed and were repeated"
        );
        describe_counter!("doorcam_webhook_dead_total", "Events that were given up");
        let secret = secret("webhooks.secret_file", &config.secret_file)?;
        let label = (index + 1).to_string();
        let meters = [
            counter!("doorcam_webhook_delivered_total", "webhook" => label.clone()),
            counter!("doorcam_webhook_retried_total", "webhook" => label.clone()),
            counter!("doorcam_webhook_dead_total", "webhook" => label),
        ];
        let state = Arc::new(State {
            url: config.url.clone(),
            waiting: AtomicU64::new(0),
            delivered: AtomicU64::new(0),
            retried: AtomicU64::new(0),
            dead: AtomicU64::new(0),
            error: Mutex::new(None),
            said: Mutex::new(None),
            meters,
        });
        let agent = ureq::Agent::config_builder()
            .timeout_global(Some(PATIENCE))
            .max_redirects(0)
            .http_status_as_error(false)
            .tls_config(tls())
            .user_agent(concat!("doorcam/", env!("CARGO_PKG_VERSION")))
            .build()
            .into();
        let [first, longest] = RETRY;
        let backoff = Backoff::new(first, longest, u64::from(std::process::id()) + index as u64);
        let mut worker = Worker { state: Arc::clone(&state), site, secret, agent, backoff };
        let (queue, events) = sync_channel(WAITING);
        let thread = std::thread::Builder::new().name(format!("webhook-{}", index + 1));
        thread.spawn(move || worker.run(&events)).map_err(PublishError::Thread)?;
        Ok(Self { kinds: config.events.clone(), queue, state })
    }

    /// Queues an event if it is of a configured kind. Never waits.
    pub(super) fn take(&self, event: &Event) {
        if !self.kinds.is_empty() && !self.kinds.contains(&event.kind) {
            return;
        }
        self.state.waiting.fetch_add(1, Ordering::Relaxed);
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = self.queue.try_send(event.clone()) {
            self.state.waiting.fetch_sub(1, Ordering::Relaxed);
            self.state.died();
        }
    }

    pub(super) fn report(&self) -> WebhookReport {
        let State { url, waiting, delivered, retried, dead, error, .. } = &*self.state;
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        WebhookReport {
            url: url.to_string(),
            waiting: count(waiting),
            delivered: count(delivered),
            retried: count(retried),
            dead: count(dead),
            error: lock(error).clone(),
        }
    }
}

/// TLS with the certificates that the system trusts.
fn tls() -> TlsConfig {
    // Fails only if another part of the program has already installed a provider.
    let _ = ring::default_provider().install_default();
    // Certificates that cannot be read are left out; a receiver that needs one then fails with a reported error.
    let trusted = rustls_native_certs::load_native_certs().certs;
    let certificates = trusted.iter().map(|certificate| Certificate::from_der(certificate).to_owned());
    TlsConfig::builder().root_certs(RootCerts::from(certificates)).build()
}

impl State {
    fn delivered(&self) {
        self.delivered.fetch_add(1, Ordering::Relaxed);
        self.meters[0].increment(1);
        *lock(&self.error) = None;
    }

    fn died(&self) {
        self.dead.fetch_add(1, Ordering::Relaxed);
        self.meters[2].increment(1);
    }

    /// Keeps what went wrong, and logs it unless it is the same as before or was followed by much else just now.
    fn failed(&self, why: String) {
        let mut said = lock(&self.said);
        if said.as_ref().is_none_or(|(text, at)| *text != why && at.elapsed() >= LINE) {
            tracing::warn!("webhook {}: {why}", self.url);
            *said = Some((why.clone(), Instant::now()));
        }
        *lock(&self.error) = Some(why);
    }
}

impl Worker {
    /// Delivers the events in their order until the program ends.
    fn run(&mut self, events: &Receiver<Event>) {
        while let Ok(event) = events.recv() {
            self.deliver(&event);
            self.state.waiting.fetch_sub(1, Ordering::Relaxed);
        }
    }

    fn deliver(&mut self, event: &Event) {
        self.backoff.reset();
        for attempt in 1..=ATTEMPTS {
            match self.attempt(event) {
                Ok(()) => return self.state.delivered(),
                Err(Failure { why, passing }) => {
                    self.state.failed(why);
                    if !passing || attempt == ATTEMPTS {
                        break;
                    }
                }
            }
            self.state.retried.fetch_add(1, Ordering::Relaxed);
            self.state.meters[1].increment(1);
            std::thread::sleep(self.backoff.next_delay());
        }
        self.state.died();
    }

    fn attempt(&self, event: &Event) -> Result<(), Failure> {
        let Self { state, site, secret, agent, .. } = self;
        let message = serde_json::to_string(&Message { version: 1, site, event });
        let body = message.map_err(|e| Failure { why: e.to_string(), passing: false })?;
        // A new timestamp for each attempt, because receivers refuse old signatures.
        let timestamp = Timestamp::now().as_second();
        let answer = agent
            .post(state.url.secret())
            .header("content-type", "application/json")
            .header("x-doorcam-delivery", format!("{site}-{}", event.sequence))
            .header("x-doorcam-timestamp", timestamp.to_string())
            .header("x-doorcam-signature", format!("sha256={}", sign(secret, timestamp, &body)))
            .send(body.as_str());
        // The body is not read, however long it is or takes.
        let status = answer.map_err(Failure::of)?.status();
        match status.as_u16() {
            200..=299 => Ok(()),
            300..=399 => {
                let why = format!("it answered {status}, and redirections are not followed: expected its final url");
                Err(Failure { why, passing: false })
            }
            code => {
                let passing = code >= 500 || matches!(code, 408 | 425 | 429);
                Err(Failure { why: format!("it answered {status}"), passing })
            }
        }
    }
}
