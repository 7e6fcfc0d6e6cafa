//! Names of the MQTT topics of one doorway.

use doorcam_core::geometry::Side;
use doorcam_core::tracking::Direction;
use rumqttc::{QoS, SubscribeFilter};

/// The topics of one doorway, below its root.
#[derive(Debug, Clone)]
pub(super) struct Topics {
    root: String,
    id: String,
    /// The zones' ids.
    zones: Vec<String>,
}

impl Topics {
    pub(super) fn new(root: &str, id: &str, zones: Vec<String>) -> Self {
        Self { root: root.into(), id: id.into(), zones }
    }

    pub(super) fn id(&self) -> &str {
        &self.id
    }

    /// How many zones there are.
    pub(super) fn zones(&self) -> usize {
        self.zones.len()
    }

    /// The topic level of a zone.
    pub(super) fn zone(&self, zone: usize) -> &str {
        self.zones.get(zone).map_or("", String::as_str)
    }

    pub(super) fn availability(&self) -> String {
        availability(&self.root)
    }

    pub(super) fn state(&self) -> String {
        format!("{}/state", self.root)
    }

    /// Topic that tells whether doorcam is watching, and why not.
    pub(super) fn watching(&self) -> String {
        format!("{}/watching", self.root)
    }

    /// Topic that tells whether the values about the room are known: `online` or `offline`.
    pub(super) fn known(&self) -> String {
        format!("{}/known", self.root)
    }

    /// Topic that tells which doorcam publishes below this root.
    pub(super) fn instance(&self) -> String {
        format!("{}/instance", self.root)
    }

    /// Topic of the occupancy, `ON` or `OFF`, of the hidden room or of a zone.
    pub(super) fn occupancy(&self, zone: Option<usize>) -> String {
        format!("{}/occupancy", self.place(zone))
    }

    /// Topic of the number of people in the hidden room or in a zone.
    pub(super) fn count(&self, zone: Option<usize>) -> String {
        format!("{}/people", self.place(zone))
    }

    /// Topic of everything that is known about people who walk through the doorway.
    pub(super) fn crossings(&self) -> String {
        format!("{}/crossings", self.root)
    }

    /// Topic of how many people walked through since midnight.
    pub(super) fn crossed(&self, direction: Direction) -> String {
        format!("{}/crossings/{}", self.root, direction.name())
    }

    /// Topic of each person who walks through.
    pub(super) fn crossing(&self, direction: Direction) -> String {
        format!("{}/crossings/{}/event", self.root, direction.name())
    }

    /// Topic of the estimate of how many people are inside.
    pub(super) fn inside(&self) -> String {
        format!("{}/inside", self.root)
    }

    /// Topic of how much of a side's patch shows the floor: `clear`, `partial` or `blocked`.
    pub(super) fn view(&self, side: Side) -> String {
        format!("{}/view/{}", self.root, side.name())
    }

    /// The retained topics of the room, of the doorway and of every zone.
    pub(super) fn retained(&self) -> impl Iterator<Item = String> {
        let places = std::iter::once(None).chain((0..self.zones()).map(Some));
        let places = places.flat_map(|zone| [self.occupancy(zone), self.count(zone)]);
        let crossings = Direction::ALL.map(|direction| self.crossed(direction));
        let doorway = [self.availability(), self.state(), self.watching(), self.known(), self.instance()];
        let views = Side::BOTH.map(|side| self.view(side));
        places.chain(doorway).chain(crossings).chain([self.crossings(), self.inside()]).chain(views)
    }

    /// Whether a topic is the occupancy or the number of people of a zone, of now or of before.
    pub(super) fn is_of_a_zone(&self, topic: &str) -> bool {
        let below = topic.strip_prefix(&self.root).and_then(|below| below.strip_prefix("/zones/"));
        let value = below.and_then(|below| below.split_once('/')).map(|(_, value)| value);
        matches!(value, Some("occupancy" | "people"))
    }

    /// What to listen to as long as there is a connection: other doorcams of this id, and Home Assistant's birth.
    pub(super) fn of_others(&self, home_assistant: &str) -> Vec<SubscribeFilter> {
        let birth = (!home_assistant.is_empty()).then(|| format!("{home_assistant}/status"));
        filters([self.instance(), self.availability()].into_iter().chain(birth))
    }

    /// What to listen to at the beginning: what earlier runs left.
    pub(super) fn of_before(&self, home_assistant: &str) -> Vec<SubscribeFilter> {
        let zones = format!("{}/zones/+", self.root);
        let announced = |component| format!("{home_assistant}/{component}/{}/+/config", self.id);
        let announced =
            ["binary_sensor", "sensor", "event"].map(announced).into_iter().filter(|_| !home_assistant.is_empty());
        filters([format!("{zones}/occupancy"), format!("{zones}/people")].into_iter().chain(announced))
    }

    fn place(&self, zone: Option<usize>) -> String {
        zone.map_or_else(|| self.root.clone(), |zone| format!("{}/zones/{}", self.root, self.zone(zone)))
    }
}

pub(super) fn availability(root: &str) -> String {
    format!("{root}/availability")
}

fn filters(topics: impl Iterator<Item = String>) -> Vec<SubscribeFilter> {
    topics.map(|topic| SubscribeFilter::new(topic, QoS::AtMostOnce)).collect()
}
