//! Home Assistant's MQTT discovery: <https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery>.

use serde::Serialize;
use serde_json::{Value, json};

use super::topics::Topics;
use doorcam_core::geometry::Side;
use doorcam_core::tracking::{Direction, Event};
use doorcam_engine::ViewState;

/// A retained message that makes entities appear in Home Assistant.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Announcement {
    pub(super) topic: String,
    pub(super) payload: String,
}

/// The announcements of occupancy and number of people in the room and in each zone, as entities of one device.
pub(super) fn announcements(prefix: &str, topics: &Topics, name: &str, zones: &[String]) -> Vec<Announcement> {
    let entity = Entity { prefix, topics, device: name, known: json!({"topic": topics.known()}) };
    let room = [(String::new(), topics.occupancy(None), topics.count(None), String::new())];
    let zones = zones.iter().enumerate().map(|(k, zone)| {
        (format!("_{}", topics.zone(k)), topics.occupancy(Some(k)), topics.count(Some(k)), format!("{zone} "))
    });
    let mut announcements = Vec::new();
    for (suffix, occupancy, count, of) in room.into_iter().chain(zones) {
        announcements.push(entity.announce(
            ("binary_sensor", format!("occupancy{suffix}")),
            json!({
                "name": capitalised(format!("{of}occupancy")),
                "state_topic": occupancy,
                "device_class": "occupancy",
                "payload_on": "ON",
                "payload_off": "OFF",
            }),
        ));
        announcements.push(entity.announce(
            ("sensor", format!("people{suffix}")),
            json!({
                "name": capitalised(format!("{of}people")),
                "state_topic": count,
                "state_class": "measurement",
                "icon": "mdi:account-multiple",
            }),
        ));
    }
    announcements
}

/// The announcements of how much of each patch shows the floor, as entities of the same device.
pub(super) fn view_announcements(prefix: &str, topics: &Topics, name: &str) -> Vec<Announcement> {
    let entity = Entity { prefix, topics, device: name, known: judged(topics) };
    let view = |side: Side| {
        let payload = json!({
            "name": format!("View on the {}", side.name()),
            "state_topic": topics.view(side),
            "device_class": "enum",
            "options": ViewState::ALL.map(ViewState::name),
            "entity_category": "diagnostic",
            "icon": "mdi:eye",
        });
        entity.announce(("sensor", format!("view_{}", side.name())), payload)
    };
    Side::BOTH.map(view).into()
}

/// The announcements of people who walk through the doorway, as entities of the same device.
pub(super) fn crossing_announcements(prefix: &str, topics: &Topics, name: &str) -> Vec<Announcement> {
    let known = json!({
        "topic": topics.crossings(),
        "value_template": "{{ 'online' if value_json.available else 'offline' }}",
    });
    let entity = Entity { prefix, topics, device: name, known };
    let event = |direction: Direction, name: &str, icon: &str| {
        let kind = direction.kind().name();
        let payload = json!({
            "name": name,
            "state_topic": topics.crossing(direction),
            "event_types": [kind],
            "icon": icon,
        });
        entity.announce(("event", kind.into()), payload)
    };
    let count = |object: &str, topic: String, name: &str, class: &str, icon: &str| {
        let payload = json!({"name": name, "state_topic": topic, "state_class": class, "icon": icon});
        entity.announce(("sensor", object.into()), payload)
    };
    vec![
        event(Direction::In, "Came in", "mdi:location-enter"),
        event(Direction::Out, "Went out", "mdi:location-exit"),
        event(Direction::Back, "Turned around", "mdi:u-turn-left"),
        count("in_today", topics.crossed(Direction::In), "In today", "total_increasing", "mdi:location-enter"),
        count("out_today", topics.crossed(Direction::Out), "Out today", "total_increasing", "mdi:location-exit"),
        count("inside", topics.inside(), "People inside", "measurement", "mdi:home-account"),
    ]
}

/// Somebody who walks through, as an event of Home Assistant: the further keys become its attributes.
#[derive(Serialize)]
struct Crossing<'a> {
    event_type: &'a str,
    #[serde(flatten)]
    event: &'a Event,
}

/// The payload for an entity of [`crossing_announcements`].
pub(super) fn crossing(event: &Event) -> String {
    // Serialisation cannot fail, because all keys are strings.
    serde_json::to_string(&Crossing { event_type: event.kind.name(), event }).unwrap_or_default()
}

/// The patches are judged while there is a map, and while they are covered.
fn judged(topics: &Topics) -> Value {
    let template = "{{ 'online' if value in ['watching', 'obstructed'] else 'offline' }}";
    json!({"topic": topics.state(), "value_template": template})
}

struct Entity<'a> {
    prefix: &'a str,
    topics: &'a Topics,
    device: &'a str,
    /// When the entity's value is known, apart from that doorcam is online.
    known: Value,
}

impl Entity<'_> {
    fn announce(&self, (component, object): (&str, String), entity: Value) -> Announcement {
        let Self { prefix, topics, device, known } = self;
        let id = topics.id();
        let version = env!("CARGO_PKG_VERSION");
        let mut payload = entity;
        payload["unique_id"] = json!(format!("doorcam_{id}_{object}"));
        payload["availability"] = json!([{"topic": topics.availability()}, known]);
        payload["availability_mode"] = json!("all");
        payload["device"] = json!({
            "identifiers": [format!("doorcam_{id}")],
            "name": device,
            "model": "doorcam",
            "sw_version": version,
        });
        payload["origin"] = json!({"name": "doorcam", "sw_version": version});
        Announcement { topic: format!("{prefix}/{component}/{id}/{object}/config"), payload: payload.to_string() }
    }
}

fn capitalised(name: String) -> String {
    let mut characters = name.chars();
    characters.next().map_or_else(String::new, |first| first.to_uppercase().chain(characters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_entity_has_a_topic_an_id_and_a_device() {
        let topics = Topics::new("doorcam/hall", "hall", vec!["bed".into()]);
        let announced = announcements("homeassistant", &topics, "Hall", &["Bed".into()]);
        let names: Vec<&str> = announced.iter().map(|a| a.topic.as_str()).collect();
        assert_eq!(
            names,
            [
                "homeassistant/binary_sensor/hall/occupancy/config",
                "homeassistant/sensor/hall/people/config",
                "homeassistant/binary_sensor/hall/occupancy_bed/config",
                "homeassistant/sensor/hall/people_bed/config",
            ]
        );
        let entity: Value = serde_json::from_str(&announced[2].payload).unwrap();
        assert_eq!(
            (&entity["name"], &entity["unique_id"]),
            (&json!("Bed occupancy"), &json!("doorcam_hall_occupancy_bed"))
        );
        assert_eq!(entity["state_topic"], "doorcam/hall/zones/bed/occupancy");
        assert_eq!(entity["availability"][0]["topic"], "doorcam/hall/availability");
        assert_eq!(entity["device"]["identifiers"], json!(["doorcam_hall"]));
    }

    #[test]
    fn each_patch_tells_how_much_of_it_is_seen() {
        let topics = Topics::new("doorcam/hall", "hall", Vec::new());
        let announced = view_announcements("homeassistant", &topics, "Hall");
        let retained: Vec<String> = topics.retained().collect();
        for (announced, side) in announced.iter().zip(["left", "right"]) {
            assert_eq!(announced.topic, format!("homeassistant/sensor/hall/view_{side}/config"));
            let entity: Value = serde_json::from_str(&announced.payload).unwrap();
            assert_eq!(entity["state_topic"], format!("doorcam/hall/view/{side}"));
            assert_eq!(entity["options"], json!(["clear", "partial", "blocked"]));
            assert!(retained.contains(&format!("doorcam/hall/view/{side}")));
            let known = entity["availability"][1]["value_template"].as_str().unwrap();
            assert!(known.contains("'watching', 'obstructed'"), "{known}");
        }
        assert_eq!(announced.len(), 2);
    }

    #[test]
    fn who_walks_through_is_an_event_and_a_count_while_that_is_seen() {
        let topics = Topics::new("doorcam/hall", "hall", Vec::new());
        let announced = crossing_announcements("homeassistant", &topics, "Hall");
        let entities: Vec<(&str, Value)> =
            announced.iter().map(|a| (a.topic.as_str(), serde_json::from_str(&a.payload).unwrap())).collect();
        let told = |k: usize| (entities[k].0, entities[k].1["state_topic"].as_str().unwrap());
        assert_eq!(told(0), ("homeassistant/event/hall/cross_in/config", "doorcam/hall/crossings/in/event"));
        assert_eq!(entities[0].1["event_types"], json!(["cross_in"]));
        assert_eq!(told(2), ("homeassistant/event/hall/cross_back/config", "doorcam/hall/crossings/back/event"));
        assert_eq!(told(4), ("homeassistant/sensor/hall/out_today/config", "doorcam/hall/crossings/out"));
        assert_eq!(entities[4].1["state_class"], "total_increasing");
        assert_eq!(told(5), ("homeassistant/sensor/hall/inside/config", "doorcam/hall/inside"));
        for (direction, (_, entity)) in Direction::ALL.into_iter().zip(&entities) {
            let event = Event {
                sequence: 7,
                kind: direction.kind(),
                time: jiff::Timestamp::UNIX_EPOCH,
                track: 3,
                x_m: 0.1,
                y_m: 0.0,
                zone: None,
                through: None,
                reason: None,
                speed_m_s: Some(1.25),
            };
            let payload: Value = serde_json::from_str(&crossing(&event)).unwrap();
            assert_eq!(entity["state_topic"], topics.crossing(direction));
            assert_eq!(entity["event_types"], json!([payload["event_type"]]), "no other type comes on its topic");
            assert_eq!((&payload["sequence"], &payload["speed_m_s"]), (&json!(7), &json!(1.25)));
        }
        let retained: Vec<String> = topics.retained().collect();
        for (topic, entity) in &entities {
            let is_event = topic.contains("/event/");
            let state = entity["state_topic"].as_str().unwrap().to_owned();
            assert_eq!(retained.contains(&state), !is_event, "{topic}: an event is of its moment only");
            assert_eq!(entity["availability"][1]["topic"], "doorcam/hall/crossings", "{topic}");
            assert_eq!(entity["device"]["identifiers"], json!(["doorcam_hall"]));
        }
    }
}
