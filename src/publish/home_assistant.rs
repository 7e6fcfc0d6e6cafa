//! Home Assistant's MQTT discovery: <https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery>.

use serde_json::{Value, json};

use super::topics::Topics;

/// A retained message that makes entities appear in Home Assistant.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Announcement {
    pub(super) topic: String,
    pub(super) payload: String,
}

/// The announcements of occupancy and number of people in the room and in each zone, as entities of one device.
pub(super) fn announcements(prefix: &str, topics: &Topics, name: &str, zones: &[String]) -> Vec<Announcement> {
    let room = [(String::new(), topics.occupancy(None), topics.count(None), String::new())];
    let zones = zones.iter().enumerate().map(|(k, zone)| {
        (format!("_{}", topics.zone(k)), topics.occupancy(Some(k)), topics.count(Some(k)), format!("{zone} "))
    });
    let mut announcements = Vec::new();
    for (suffix, occupancy, count, of) in room.into_iter().chain(zones) {
        let entity = Entity { prefix, topics, device: name };
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

struct Entity<'a> {
    prefix: &'a str,
    topics: &'a Topics,
    device: &'a str,
}

impl Entity<'_> {
    fn announce(&self, (component, object): (&str, String), entity: Value) -> Announcement {
        let Self { prefix, topics, device } = self;
        let id = topics.id();
        let version = env!("CARGO_PKG_VERSION");
        let mut payload = entity;
        payload["unique_id"] = json!(format!("doorcam_{id}_{object}"));
        // Nothing is known about the room while doorcam is offline or its map cannot be trusted.
        payload["availability"] = json!([
            {"topic": topics.availability()},
            {"topic": topics.state(), "value_template": "{{ 'online' if value == 'watching' else 'offline' }}"},
        ]);
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
}
