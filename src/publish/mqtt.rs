use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use metrics::{counter, describe_counter, describe_gauge, gauge};
use rumqttc::{AsyncClient, Publish, QoS};
use tokio::sync::{mpsc, watch};
use tokio::time::{interval, timeout};

use super::broker::{MqttReport, Settings};
use super::connection::{HEALTHY, Lost, News, keep_connected};
use super::facts::{Facts, Knowledge};
use super::home_assistant::{Announcement, announcements, crossing, crossing_announcements, view_announcements};
use super::lock;
use super::neighbours::{Neighbours, Todo, presence};
use super::topics::Topics;
use crate::watch::{CrossingsReport, Hub};
use doorcam_core::geometry::Side;
use doorcam_core::tracking::{Direction, Event};

/// Shortest time between two messages with tracks.
const TRACKS: Duration = Duration::from_millis(500);
/// How often to look without a new update: doorcam may have stopped watching, and neighbours may have to be told
/// something.
const TICK: Duration = Duration::from_secs(1);
/// Most messages that wait for the connection. What does not fit is sent later, with its value at that time.
const WAITING: usize = 256;
/// How long to wait at the end for the broker to read everything.
const FAREWELL: Duration = Duration::from_secs(1);
/// Most messages from the broker that wait to be looked at; then the connection waits.
const HEARD: usize = 64;
/// After this many connections in a row that ended before they were good, that is said. One less, and doorcam listens to
/// nothing at first, because some brokers end the connection of a client that may not.
const SHORT_ONES: u32 = 3;
/// Shortest time between two lines in the log about the same kind of thing.
const LINE: Duration = Duration::from_secs(60);

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
    /// Number of the last published event, and of the last crossing that was also published as one.
    event: Option<u64>,
    crossing: Option<u64>,
    neighbours: Neighbours,
    listening: Listening,
    /// When the present connection was made.
    made: Option<Instant>,
    /// Connections in a row that ended before they were good.
    short: u32,
    /// When the log last said that there is a connection, and what it said since then about a lost one.
    said: Option<Instant>,
    said_lost: Option<(String, Instant)>,
}

/// Whether doorcam listens to the broker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Listening {
    /// From the beginning of a connection.
    AtOnce,
    /// Once a connection has proved to be a good one.
    Later,
    /// It does, since then.
    Since(Instant),
    /// It must not: that ended a good connection.
    Never,
}

/// Publishes until `ending` turns true, reconnecting whenever the connection is lost.
pub(super) async fn run(settings: Settings, hub: &Hub, report: &Mutex<MqttReport>, mut ending: watch::Receiver<bool>) {
    describe_gauge!("doorcam_mqtt_connected", "1 while there is a connection to the MQTT broker");
    describe_counter!("doorcam_mqtt_published_total", "Messages handed to the connection to the MQTT broker");
    describe_gauge!("doorcam_mqtt_duplicate", "1 while another doorcam publishes under the same id");
    let (client, connection) = AsyncClient::new(settings.options.clone(), WAITING);
    let (tell, mut news) = mpsc::channel(HEARD);
    // A separate task, because polling must not stall behind other work or be cancelled half-way.
    let seed = u64::from_str_radix(&settings.instance.text, 16).unwrap_or_default();
    let polling = tokio::spawn(keep_connected(connection, seed, tell));
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
        crossing: None,
        neighbours: Neighbours::new(),
        listening: Listening::AtOnce,
        made: None,
        short: 0,
        said: None,
        said_lost: None,
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
                Some(News::Heard(message)) => {
                    session.hear(&message);
                    continue;
                }
                Some(News::Lost(lost)) => {
                    connected = false;
                    session.lost(lost);
                }
                Some(News::Closed) | None => break,
            },
            changed = updates.changed(), if connected => if changed.is_err() { break },
            _ = tick.tick(), if connected => session.look(),
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

impl Session<'_> {
    fn begin(&mut self) {
        let now = Instant::now();
        gauge!("doorcam_mqtt_connected").set(1.0);
        {
            let mut report = lock(self.report);
            (report.state, report.error) = ("connected", None);
        }
        self.say_connected(now);
        // The broker may be another one, or may have lost its retained messages.
        self.told.clear();
        self.introduced = false;
        self.made = Some(now);
        self.neighbours.begin(now);
        if self.listening == Listening::AtOnce {
            self.listen();
        }
    }

    /// Says in the log that there is a connection, if that is news and was not said a moment ago.
    fn say_connected(&mut self, now: Instant) {
        let Settings { broker, root, .. } = self.settings;
        let is_news = self.said.is_none() || self.said_lost.is_some();
        if is_news && self.said.is_none_or(|at| now.saturating_duration_since(at) >= LINE) {
            tracing::info!("{broker}: connected, publishing under {root}");
            (self.said, self.said_lost) = (Some(now), None);
        }
    }

    /// Listens to other doorcams and Home Assistant, and to what earlier runs left.
    fn listen(&mut self) {
        let home_assistant = &self.settings.home_assistant;
        let filters = [self.topics.of_others(home_assistant), self.topics.of_before(home_assistant)].concat();
        self.neighbours.is_clean = self.client.try_subscribe_many(filters).is_err();
        self.ask();
    }

    /// Says anew which doorcam this is, so that another one of its id answers.
    fn ask(&mut self) {
        self.told.remove(&self.topics.instance());
        self.introduced = false;
    }

    /// Takes a message of the broker.
    fn hear(&mut self, message: &Publish) {
        let Settings { instance, home_assistant, .. } = self.settings;
        let Ok(topic) = std::str::from_utf8(&message.topic) else { return };
        let (now, heard) = (Instant::now(), (topic, &message.payload[..], message.retain));
        let todo = self.neighbours.hear(heard, (&self.topics, &instance.text, home_assistant), now);
        if todo == Todo::Answer {
            let answer = presence(&instance.text, true);
            self.publish(&self.topics.instance(), QoS::AtLeastOnce, false, answer);
        }
        self.warn(now);
    }

    /// Does what becomes due with time.
    fn look(&mut self) {
        let now = Instant::now();
        self.say_connected(now);
        let lasted = self.made.map_or(Duration::ZERO, |made| now.saturating_duration_since(made));
        if lasted >= HEALTHY {
            self.short = 0;
            if self.listening == Listening::Later {
                self.listening = Listening::Since(now);
                self.neighbours.begin(now);
                self.listen();
            }
        }
        if self.neighbours.should_welcome(now) {
            // Everything again: discovery, and the values that it names.
            self.told.clear();
            self.introduced = false;
        }
        if self.neighbours.should_correct(now) {
            self.told.remove(&self.topics.availability());
            self.introduced = false;
        }
        if self.neighbours.should_ask(now) {
            self.ask();
        }
        self.clear_leftovers(now);
        self.warn(now);
    }

    /// Clears the retained messages that earlier runs left: of zones that were removed while doorcam was off.
    fn clear_leftovers(&mut self, now: Instant) {
        if self.neighbours.is_clean {
            return;
        }
        let in_use = self.in_use();
        let Some(left) = self.neighbours.leftovers(|topic| in_use.contains(topic), now) else { return };
        for topic in left {
            // An empty payload makes the broker delete its retained message.
            if !self.publish(&topic, QoS::AtLeastOnce, true, String::new()) {
                return;
            }
            self.neighbours.cleared(&topic);
        }
        self.neighbours.is_clean = true;
        for filter in self.topics.of_before(&self.settings.home_assistant) {
            // Otherwise doorcam would hear its own values for ever. If this does not fit, it does.
            let _ = self.client.try_unsubscribe(filter.path);
        }
    }

    /// Keeps in the report, and says in the log, what is wrong although there is a connection now and then.
    fn warn(&mut self, now: Instant) {
        let Settings { options, root, .. } = self.settings;
        let twin = self.neighbours.twin(now);
        gauge!("doorcam_mqtt_duplicate").set(f64::from(u8::from(twin.is_some())));
        let warning = match twin {
            Some(twin) => Some(format!(
                "another doorcam ({twin}) publishes under {root}, too: give each doorway a site.id of its own"
            )),
            None if self.short >= SHORT_ONES => Some(format!(
                "the broker ends each connection within {} s: another client may have the client id \"{}\" (if the \
                 storage directory was copied, delete its file client-id), or this one may not do what it does",
                HEALTHY.as_secs(),
                options.client_id()
            )),
            None => None,
        };
        let mut report = lock(self.report);
        if report.warning != warning {
            match &warning {
                Some(warning) => tracing::warn!("{}: {warning}", report.broker),
                None => tracing::info!("{}: all is well again", report.broker),
            }
            report.warning = warning;
        }
    }

    /// Publishes the announcements and the availability. False if the queue is full.
    fn introduce(&mut self) -> bool {
        // Taken out because `retain` borrows all of `self`.
        let announcements = std::mem::take(&mut self.announcements);
        let mut each = announcements.iter();
        let told = each.all(|Announcement { topic, payload }| self.retain(topic.clone(), payload.clone()));
        self.announcements = announcements;
        told && self.retain(self.topics.instance(), presence(&self.settings.instance.text, false))
            && self.retain(self.topics.availability(), "online".into())
    }

    /// Switches to new zones and clears the retained messages of those that are gone.
    fn rezone(&mut self) {
        (self.zones, self.topics, self.announcements) = described(self.settings, self.hub);
        self.introduced = false;
        let in_use = self.in_use();
        let gone: Vec<String> = self.told.keys().filter(|topic| !in_use.contains(*topic)).cloned().collect();
        for topic in gone {
            // An empty payload makes the broker delete its retained message.
            self.retain(topic.clone(), String::new());
            self.told.remove(&topic);
        }
    }

    /// The retained topics in use.
    fn in_use(&self) -> HashSet<String> {
        self.topics.retained().chain(self.announcements.iter().map(|announcement| announcement.topic.clone())).collect()
    }

    fn lost(&mut self, Lost { why, lasted }: Lost) {
        let now = Instant::now();
        gauge!("doorcam_mqtt_connected").set(0.0);
        self.made = None;
        if let Some(lasted) = lasted {
            self.short = if lasted < HEALTHY { self.short + 1 } else { 0 };
        }
        self.listening = match self.listening {
            Listening::AtOnce if self.short + 1 >= SHORT_ONES => Listening::Later,
            Listening::Since(at) if now.saturating_duration_since(at) < HEALTHY => Listening::Never,
            Listening::Since(_) => Listening::AtOnce,
            as_before => as_before,
        };
        let is_said = self.said_lost.as_ref().is_some_and(|(said, at)| *said == why || at.elapsed() < LINE);
        {
            let mut report = lock(self.report);
            if !is_said {
                tracing::warn!("{}: {why}; trying again", report.broker);
                self.said_lost = Some((why.clone(), now));
            }
            (report.state, report.error) = ("connecting", Some(why));
        }
        self.warn(now);
    }

    /// Publishes everything that the broker does not know yet.
    fn tell(&mut self) {
        if self.zones != self.hub.zones_revision() {
            self.rezone();
        }
        let facts = Facts::of(self.hub);
        let knowledge = facts.knowledge();
        let topics = self.topics.clone();
        if !facts.watching.watching {
            // First of all: the values below are of before.
            self.tell_state(&facts, knowledge);
        }
        self.introduced = self.introduced || self.introduce();
        self.tell_state(&facts, knowledge);
        let zones = facts.zones.iter().enumerate().map(|(zone, &people)| (Some(zone), people));
        // Nobody can be seen to come or go while the patches are covered.
        let holds = knowledge == Knowledge::Held;
        for (zone, people) in std::iter::once((None, facts.people)).chain(zones) {
            if holds && self.told.contains_key(&topics.occupancy(zone)) {
                continue;
            }
            self.retain(topics.occupancy(zone), if people > 0 { "ON" } else { "OFF" }.into());
            self.retain(topics.count(zone), people.to_string());
        }
        if facts.time.is_some() && self.tracks_at.is_none_or(|at| at.elapsed() >= TRACKS) {
            self.tracks_at = Some(Instant::now());
            self.publish(&format!("{}/tracks", self.settings.root), QoS::AtMostOnce, false, facts.tracks_json());
        }
        if let Some(view) = facts.view {
            for (side, view) in [(Side::Left, view.left), (Side::Right, view.right)] {
                self.retain(topics.view(side), view.state.name().into());
            }
        }
        self.tell_crossings(&facts);
        self.tell_events();
    }

    fn tell_crossings(&mut self, facts: &Facts) {
        let CrossingsReport { available, inside, came_in, out, back, .. } = facts.crossings;
        if !available {
            // Before the values, which are of before.
            self.retain(self.topics.crossings(), facts.crossings_json());
        }
        for (direction, count) in Direction::ALL.into_iter().zip([came_in, out, back]) {
            self.retain(self.topics.crossed(direction), count.to_string());
        }
        self.retain(self.topics.inside(), inside.to_string());
        self.retain(self.topics.crossings(), facts.crossings_json());
    }

    fn tell_state(&mut self, facts: &Facts, knowledge: Knowledge) {
        self.retain(self.topics.state(), facts.watching.state.name().into());
        self.retain(self.topics.watching(), facts.watching_json());
        let known = if knowledge == Knowledge::Nothing { "offline" } else { "online" };
        self.retain(self.topics.known(), known.into());
    }

    fn tell_events(&mut self) {
        let topic = format!("{}/events", self.settings.root);
        let mut events = VecDeque::from(self.hub.events(self.event, WAITING));
        if let (Some(told), Some(next)) = (self.event, events.front()) {
            lock(self.report).missed += next.sequence - told - 1;
        }
        while let Some(event) = events.pop_front() {
            if !self.tell_crossing(&event) {
                return;
            }
            let Ok(payload) = serde_json::to_string(&event) else { continue };
            if !self.publish(&topic, QoS::AtLeastOnce, false, payload) {
                return;
            }
            self.event = Some(event.sequence);
        }
    }

    /// Publishes somebody who walks through in the form of Home Assistant's events, once. False if the queue is full.
    fn tell_crossing(&mut self, event: &Event) -> bool {
        let Some(direction) = event.kind.direction() else { return true };
        if self.crossing.is_some_and(|told| event.sequence <= told) {
            return true;
        }
        let taken = self.publish(&self.topics.crossing(direction), QoS::AtLeastOnce, false, crossing(event));
        if taken {
            self.crossing = Some(event.sequence);
        }
        taken
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
    let (ids, zones): (Vec<String>, Vec<String>) =
        hub.zones().into_iter().map(|zone| (zone.id.unwrap_or_default(), zone.name)).unzip();
    let topics = Topics::new(&settings.root, &settings.id, ids);
    let announcements = match settings.home_assistant.as_str() {
        "" => Vec::new(),
        prefix => {
            let mut all = announcements(prefix, &topics, &settings.name, &zones);
            all.extend(view_announcements(prefix, &topics, &settings.name));
            if settings.crossings {
                all.extend(crossing_announcements(prefix, &topics, &settings.name));
            }
            all
        }
    };
    (revision, topics, announcements)
}

/// Completes when `ending` turns true or its sender is gone.
async fn until(ending: &mut watch::Receiver<bool>) {
    let _ = ending.wait_for(|&ending| ending).await;
}
