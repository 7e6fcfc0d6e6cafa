use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use metrics::{counter, describe_counter, describe_gauge, gauge};
use rumqttc::{AsyncClient, Event, EventLoop, LastWill, MqttOptions, Outgoing, Packet, QoS, Transport};
use rustls::crypto::ring;
use serde::Serialize;
use tokio::sync::{mpsc, watch};
use tokio::time::{interval, sleep, timeout};
use utoipa::ToSchema;

use super::facts::Facts;
use super::home_assistant::{Announcement, announcements};
use super::topics::{Topics, availability};
use super::{PublishError, lock, secret};
use crate::config::{Config, MqttConfig};
use crate::watch::Hub;
use doorcam_source::camera::Backoff;

/// First and longest delay before reconnecting to the broker.
const RETRY: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(30)];
/// Keep-alive interval in seconds. The broker considers a client dead after one and a half times this silence.
const KEEP_ALIVE: u16 = 10;
/// Shortest time between two messages with tracks.
const TRACKS: Duration = Duration::from_millis(500);
/// How often to check whether the updates have become stale.
const TICK: Duration = Duration::from_secs(1);
/// Most messages that wait for the connection. What does not fit is sent later, with its value at that time.
const WAITING: usize = 256;
/// Longest message in bytes; the tracks of a full room take a few thousand.
const LONGEST: usize = 65_536;
/// How long to wait at the end for the broker to read everything.
const FAREWELL: Duration = Duration::from_secs(1);

/// How the broker is reached, and the names to publish under.
#[derive(Clone)]
pub(super) struct Settings {
    options: MqttOptions,
    broker: String,
    root: String,
    /// Names of this doorway: `id` for programs, `name` for people.
    id: String,
    name: String,
    /// First level of Home Assistant's topics; empty to announce nothing there.
    home_assistant: String,
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
    /// The last error; null while connected.
    #[schema(required)]
    pub error: Option<String>,
    /// Messages handed to the connection.
    pub published: u64,
    /// Events that were never published because the broker was unreachable for too long.
    pub missed: u64,
}

impl MqttReport {
    pub(super) fn new(settings: &Settings) -> Self {
        let (broker, topic) = (settings.broker.clone(), settings.root.clone());
        Self { state: "connecting", broker, topic, error: None, published: 0, missed: 0 }
    }
}

impl Settings {
    /// `None` if no broker is configured.
    pub(super) fn of(config: &Config) -> Result<Option<Self>, PublishError> {
        let MqttConfig { host, port, tls, ca_file, username, password_file, prefix, home_assistant } = &config.mqtt;
        if host.is_empty() {
            return Ok(None);
        }
        let id = config.site.id();
        let root = format!("{prefix}/{id}");
        let mut options = MqttOptions::new(format!("doorcam-{id}"), (host, *port));
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
                let key = "mqtt.ca_file";
                let unread =
                    |e: std::io::Error| PublishError::File { key, file: ca_file.clone(), reason: e.to_string() };
                Transport::tls(std::fs::read(ca_file).map_err(unread)?, None, None)
            });
        }
        let broker = format!("{}://{host}:{port}", if *tls { "mqtts" } else { "mqtt" });
        let (name, home_assistant) = (config.site.name(), home_assistant.clone());
        Ok(Some(Self { options, broker, root, id, name, home_assistant }))
    }
}

/// What has been published over this connection.
struct Session<'a> {
    settings: &'a Settings,
    hub: &'a Hub,
    report: &'a Mutex<MqttReport>,
    client: AsyncClient,
    topics: Topics,
    announcements: Vec<Announcement>,
    /// The hub's zone revision that `topics` and `announcements` were made for.
    zones: u32,
    /// The last payload of each retained topic.
    told: HashMap<String, String>,
    /// Whether the announcements and the availability have been published.
    introduced: bool,
    tracks_at: Option<Instant>,
    /// Number of the last published event.
    event: Option<u64>,
}

/// A change of the connection.
enum News {
    Made,
    Lost(String),
    Closed,
}

/// Publishes until `ending` turns true, reconnecting whenever the connection is lost.
pub(super) async fn run(settings: Settings, hub: &Hub, report: &Mutex<MqttReport>, mut ending: watch::Receiver<bool>) {
    describe_gauge!("doorcam_mqtt_connected", "1 while there is a connection to the MQTT broker");
    describe_counter!("doorcam_mqtt_published_total", "Messages handed to the connection to the MQTT broker");
    let (client, connection) = AsyncClient::new(settings.options.clone(), WAITING);
    let (tell, mut news) = mpsc::channel(1);
    // A separate task, because polling must not stall behind other work or be cancelled half-way.
    let polling = tokio::spawn(keep_connected(connection, tell));
    let (zones, topics, announcements) = described(&settings, hub);
    let mut session = Session {
        settings: &settings,
        hub,
        report,
        client,
        topics,
        announcements,
        zones,
        told: HashMap::new(),
        introduced: false,
        tracks_at: None,
        event: None,
    };
    let mut updates = hub.subscribe();
    let mut tick = interval(TICK);
    let mut connected = false;
    loop {
        tokio::select! {
            news = news.recv() => match news {
                Some(News::Made) => {
                    connected = true;
                    session.begin();
                }
                Some(News::Lost(why)) => {
                    connected = false;
                    session.lost(why);
                }
                Some(News::Closed) | None => break,
            },
            changed = updates.changed(), if connected => if changed.is_err() { break },
            _ = tick.tick(), if connected => {}
            () = until(&mut ending) => break,
        }
        if connected {
            updates.mark_unchanged();
            session.tell();
        }
    }
    // After a proper disconnect the broker does not publish the last will, so publish "offline" here.
    if connected && session.retain(session.topics.availability(), "offline".into()) {
        let closed = async { while !matches!(news.recv().await, Some(News::Closed) | None) {} };
        if session.client.try_disconnect().is_ok() {
            // Nothing more can be done if this times out.
            let _ = timeout(FAREWELL, closed).await;
        }
    }
    polling.abort();
}

/// Polls the connection and reconnects with increasing delays until a disconnect has been sent.
async fn keep_connected(mut connection: EventLoop, tell: mpsc::Sender<News>) {
    let [first, longest] = RETRY;
    let mut backoff = Backoff::new(first, longest, u64::from(std::process::id()));
    let mut leaving = false;
    loop {
        let news = match connection.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => News::Made,
            Ok(event) => {
                leaving |= event == Event::Outgoing(Outgoing::Disconnect);
                continue;
            }
            // Wait for the broker to close the connection once it has read everything. Closing it here with
            // unread acknowledgements would reset it, and the broker would miss the last messages.
            Err(_) if leaving => News::Closed,
            Err(error) => News::Lost(error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")),
        };
        let (delay, over) = match news {
            News::Made => {
                backoff.reset();
                (Duration::ZERO, false)
            }
            News::Lost(_) => (backoff.next_delay(), false),
            News::Closed => (Duration::ZERO, true),
        };
        if tell.send(news).await.is_err() || over {
            return;
        }
        sleep(delay).await;
    }
}

impl Session<'_> {
    fn begin(&mut self) {
        let Settings { broker, root, .. } = self.settings;
        gauge!("doorcam_mqtt_connected").set(1.0);
        {
            let mut report = lock(self.report);
            (report.state, report.error) = ("connected", None);
        }
        tracing::info!("{broker}: connected, publishing under {root}");
        // The broker may be another one, or may have lost its retained messages.
        self.told.clear();
        self.introduced = false;
    }

    /// Publishes the announcements and the availability. False if the queue is full.
    fn introduce(&mut self) -> bool {
        // Taken out because `retain` borrows all of `self`.
        let announcements = std::mem::take(&mut self.announcements);
        let mut each = announcements.iter();
        let told = each.all(|Announcement { topic, payload }| self.retain(topic.clone(), payload.clone()));
        self.announcements = announcements;
        told && self.retain(self.topics.availability(), "online".into())
    }

    /// Switches to new zones and clears the retained messages of those that are gone.
    fn rezone(&mut self) {
        (self.zones, self.topics, self.announcements) = described(self.settings, self.hub);
        self.introduced = false;
        let zones = (0..self.topics.zones())
            .flat_map(|zone| [self.topics.occupancy(Some(zone)), self.topics.count(Some(zone))]);
        let room =
            [self.topics.availability(), self.topics.state(), self.topics.occupancy(None), self.topics.count(None)];
        let kept: HashSet<String> =
            zones.chain(room).chain(self.announcements.iter().map(|announcement| announcement.topic.clone())).collect();
        let gone: Vec<String> = self.told.keys().filter(|topic| !kept.contains(*topic)).cloned().collect();
        for topic in gone {
            // An empty payload makes the broker delete its retained message.
            self.retain(topic.clone(), String::new());
            self.told.remove(&topic);
        }
    }

    fn lost(&mut self, why: String) {
        gauge!("doorcam_mqtt_connected").set(0.0);
        let mut report = lock(self.report);
        if report.error.as_ref() != Some(&why) {
            tracing::warn!("{}: {why}; trying again", report.broker);
        }
        (report.state, report.error) = ("connecting", Some(why));
    }

    /// Publishes everything that the broker does not know yet.
    fn tell(&mut self) {
        if self.zones != self.hub.zones_revision() {
            self.rezone();
        }
        self.introduced = self.introduced || self.introduce();
        let facts = Facts::of(self.hub);
        let topics = self.topics.clone();
        self.retain(topics.state(), facts.state_name().into());
        let zones = facts.zones.iter().enumerate().map(|(zone, &people)| (Some(zone), people));
        for (zone, people) in std::iter::once((None, facts.people)).chain(zones) {
            self.retain(topics.occupancy(zone), if people > 0 { "ON" } else { "OFF" }.into());
            self.retain(topics.count(zone), people.to_string());
        }
        if facts.time.is_some() && self.tracks_at.is_none_or(|at| at.elapsed() >= TRACKS) {
            self.tracks_at = Some(Instant::now());
            self.publish(&format!("{}/tracks", self.settings.root), QoS::AtMostOnce, false, facts.tracks_json());
        }
        self.tell_events();
    }

    fn tell_events(&mut self) {
        let topic = format!("{}/events", self.settings.root);
        let mut events = VecDeque::from(self.hub.events(self.event, WAITING));
        if let (Some(told), Some(next)) = (self.event, events.front()) {
            lock(self.report).missed += next.sequence - told - 1;
        }
        while let Some(event) = events.pop_front() {
            let Ok(payload) = serde_json::to_string(&event) else { continue };
            if !self.publish(&topic, QoS::AtLeastOnce, false, payload) {
                return;
            }
            self.event = Some(event.sequence);
        }
    }

    /// Publishes a retained value unless the broker has it already. False if the queue is full.
    fn retain(&mut self, topic: String, payload: String) -> bool {
        if self.told.get(&topic) == Some(&payload) {
            return true;
        }
        let taken = self.publish(&topic, QoS::AtLeastOnce, true, payload.clone());
        if taken {
            self.told.insert(topic, payload);
        }
        taken
    }

    /// Publishes a message. False if the queue is full.
    fn publish(&mut self, topic: &str, quality: QoS, retain: bool, payload: String) -> bool {
        let taken = self.client.try_publish(topic, quality, retain, payload).is_ok();
        if taken {
            counter!("doorcam_mqtt_published_total").increment(1);
            lock(self.report).published += 1;
        }
        taken
    }
}

/// Revision, topics and announcements of the zones in use.
fn described(settings: &Settings, hub: &Hub) -> (u32, Topics, Vec<Announcement>) {
    // Read before the zones: if they change in between, the old revision makes this run again.
    let revision = hub.zones_revision();
    let zones = hub.zones();
    let zones: Vec<&str> = zones.iter().map(|zone| zone.name.as_str()).collect();
    let topics = Topics::new(&settings.root, &settings.id, &zones);
    let announcements = match settings.home_assistant.as_str() {
        "" => Vec::new(),
        prefix => announcements(prefix, &topics, &settings.name, &zones),
    };
    (revision, topics, announcements)
}

/// Completes when `ending` turns true or its sender is gone.
async fn until(ending: &mut watch::Receiver<bool>) {
    let _ = ending.wait_for(|&ending| ending).await;
}
