//! Publishing to other systems: an MQTT broker, Home Assistant through it, and webhooks.
//!
//! Each has its own state and error in the status. None can hold up the frame loop, and none queues without bound.

mod broker;
mod client_id;
mod connection;
mod facts;
mod home_assistant;
mod mqtt;
mod neighbours;
mod signature;
mod topics;
mod webhook;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use tokio::sync::watch;
use utoipa::ToSchema;

use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;

pub use self::broker::MqttReport;
pub use self::signature::sign;
use self::webhook::Webhook;
pub use self::webhook::WebhookReport;
use crate::config::Config;
use crate::server::secret_file;
use crate::watch::Hub;
use doorcam_engine::Update;
use doorcam_source::files::{self, FileKind};

/// Why publishing cannot start.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// A file that the configuration names cannot be used.
    #[error("{key}: {}: {reason}", file.display())]
    File {
        /// The configuration key.
        key: &'static str,
        /// The file.
        file: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A file with a secret cannot be used: key, file and reason.
    #[error("{0}")]
    Secret(String),
    /// A webhook's thread could not be started.
    #[error("cannot start a webhook's thread: {0}")]
    Thread(std::io::Error),
}

/// How publishing goes.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct PublishReport {
    /// The broker; null if none is configured.
    #[schema(required)]
    pub mqtt: Option<MqttReport>,
    /// The webhooks, in the order of the configuration.
    pub webhooks: Vec<WebhookReport>,
}

/// Everything that publishes.
#[derive(Clone)]
pub struct Publishers {
    mqtt: Option<(broker::Settings, Arc<Mutex<MqttReport>>)>,
    webhooks: Arc<Vec<Webhook>>,
}

impl Publishers {
    /// The configured publishers. Reads the files with passwords and secrets, and starts the webhooks. `storage` is the
    /// directory of this doorway, if it has one: it keeps this doorcam's name at the broker.
    ///
    /// # Errors
    ///
    /// If a file cannot be used, or a webhook's thread cannot be started.
    pub fn new(config: &Config, storage: Option<&Path>) -> Result<Self, PublishError> {
        let mqtt = broker::Settings::of(config, storage)?;
        let mqtt = mqtt.map(|settings| {
            let report = Arc::new(Mutex::new(MqttReport::new(&settings)));
            (settings, report)
        });
        let webhooks = config.webhooks.iter().enumerate();
        let webhooks = webhooks.map(|(index, webhook)| Webhook::start(index, webhook, config.site.id()));
        Ok(Self { mqtt, webhooks: Arc::new(webhooks.collect::<Result<_, _>>()?) })
    }

    /// Passes the events of an update to the webhooks. Never waits.
    pub fn take_update(&self, update: &Update) {
        for event in &update.events {
            self.webhooks.iter().for_each(|webhook| webhook.take(event));
        }
    }

    /// Keeps the broker informed until `ending` turns true, and returns once the broker has been told of the end.
    pub async fn run(self, hub: Arc<Hub>, ending: watch::Receiver<bool>) {
        if let Some((settings, report)) = self.mqtt {
            mqtt::run(settings, &hub, &report, ending).await;
        }
    }

    /// How publishing goes.
    pub fn report(&self) -> PublishReport {
        PublishReport {
            mqtt: self.mqtt.as_ref().map(|(_, report)| lock(report).clone()),
            webhooks: self.webhooks.iter().map(Webhook::report).collect(),
        }
    }
}

/// Reads a file that holds only a secret. Like a token's, it must be closed to others.
fn secret(key: &'static str, file: &Path) -> Result<String, PublishError> {
    let refused = |reason: String| PublishError::File { key, file: file.into(), reason };
    let bytes = secret_file::read(file).map_err(|e| PublishError::Secret(format!("{key}: {e}")))?;
    let text = String::from_utf8(bytes).map_err(|_| refused("it is not UTF-8, expected a secret".into()))?;
    let secret = text.trim_end_matches(['\r', '\n']);
    if secret.is_empty() { Err(refused("it is empty, expected a secret".into())) } else { Ok(secret.into()) }
}

/// Reads a file of certificates.
fn certificates(key: &'static str, file: &Path) -> Result<Vec<u8>, PublishError> {
    let refused = |reason: String| PublishError::File { key, file: file.into(), reason };
    let pem = files::read(file, FileKind::CERTIFICATES).map_err(|e| refused(e.words()))?;
    let found = CertificateDer::pem_slice_iter(&pem).collect::<Result<Vec<_>, _>>();
    match found {
        Ok(found) if !found.is_empty() => Ok(pem),
        _ => Err(refused("no certificate in it, expected PEM (-----BEGIN CERTIFICATE-----)".into())),
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
