//! How the broker is reached, and how that goes.

use std::path::Path;

use rumqttc::{LastWill, MqttOptions, QoS, Transport};
use rustls::crypto::ring;
use serde::Serialize;
use utoipa::ToSchema;

use super::client_id::Unique;
use super::topics::availability;
use super::{PublishError, certificates, secret};
use crate::config::{Config, MqttConfig};

/// Keep-alive interval in seconds. The broker considers a client dead after one and a half times this silence.
const KEEP_ALIVE: u16 = 10;
/// Longest message in bytes; the tracks of a full room take a few thousand.
const LONGEST: usize = 65_536;

/// How the broker is reached, and the names to publish under.
#[derive(Clone)]
pub(super) struct Settings {
    pub(super) options: MqttOptions,
    pub(super) broker: String,
    pub(super) root: String,
    /// Names of this doorway: `id` for programs, `name` for people.
    pub(super) id: String,
    pub(super) name: String,
    /// First level of Home Assistant's topics; empty to announce nothing there.
    pub(super) home_assistant: String,
    /// Whether it is told there who walks through the doorway.
    pub(super) crossings: bool,
    /// Tells this doorcam from every other one.
    pub(super) instance: Unique,
}

/// State of the connection to the broker.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct MqttReport {
    /// "connecting" or "connected".
    pub state: &'static str,
    /// The broker's address.
    pub broker: String,
    /// The topic below which everything is published.
    pub topic: String,
    /// The name that the broker knows this doorcam by.
    pub client_id: String,
    /// The last error; null while connected.
    #[schema(required)]
    pub error: Option<String>,
    /// What is wrong although there is a connection now and then: another doorcam publishes under the same id, or the
    /// broker ends each connection at once. Null if nothing is.
    #[schema(required)]
    pub warning: Option<String>,
    /// Messages handed to the connection.
    pub published: u64,
    /// Events that were never published because the broker was unreachable for too long.
    pub missed: u64,
}

impl MqttReport {
    pub(super) fn new(settings: &Settings) -> Self {
        let (broker, topic) = (settings.broker.clone(), settings.root.clone());
        let client_id = settings.options.client_id();
        Self { state: "connecting", broker, topic, client_id, error: None, warning: None, published: 0, missed: 0 }
    }
}

impl Settings {
    /// `None` if no broker is configured. `storage` is the directory of this doorway, if it has one.
    pub(super) fn of(config: &Config, storage: Option<&Path>) -> Result<Option<Self>, PublishError> {
        let MqttConfig { host, port, tls, ca_file, username, password_file, prefix, home_assistant } = &config.mqtt;
        if host.is_empty() {
            return Ok(None);
        }
        let id = config.site.id();
        let root = format!("{prefix}/{id}");
        let instance = Unique::load(storage);
        let mut options = MqttOptions::new(format!("doorcam-{id}-{}", instance.text), (host.as_str(), *port));
        options.set_keep_alive(KEEP_ALIVE);
        options.set_max_packet_size(LONGEST, LONGEST);
        options.set_last_will(LastWill::new(availability(&root), "offline", QoS::AtLeastOnce, true));
        if !username.is_empty() {
            // An empty password is not the same as none.
            if password_file.as_os_str().is_empty() {
                options.set_username(username);
            } else {
                options.set_credentials(username, secret("mqtt.password_file", password_file)?);
            }
        }
        if *tls {
            // Fails if another part of the program has already installed it, which is fine.
            let _ = ring::default_provider().install_default();
            options.set_transport(if ca_file.as_os_str().is_empty() {
                Transport::tls_with_default_config()
            } else {
                let pem = certificates("mqtt.ca_file", ca_file)?;
                Transport::tls(pem, None, None)
            });
        }
        let broker = format!("{}://{host}:{port}", if *tls { "mqtts" } else { "mqtt" });
        let (name, home_assistant) = (config.site.name(), home_assistant.clone());
        let crossings = config.crossings.enabled;
        Ok(Some(Self { options, broker, root, id, name, home_assistant, crossings, instance }))
    }
}
