//! `[tracker]` and `[[zones]]`: how people are tracked, and the named parts of the room.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ConfigError, brief, topic_level, within};
use doorcam_core::geometry::Room;
use doorcam_core::tracking::likelihood::MOST_PEOPLE;
use doorcam_core::tracking::{Dwelling, TrackerSettings, Zone};
use doorcam_engine::Settings;

/// Most zones that may be configured.
const MOST_ZONES: usize = 32;
/// Most characters in a zone's name.
const LONGEST_NAME: usize = 40;
/// Most characters in a zone's id, which is a level of topics.
pub const LONGEST_ZONE_ID: usize = 64;

/// `[tracker]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrackerConfig {
    /// Seconds for which somebody must be seen before the track is confirmed.
    pub confirm_s: f64,
    /// Seconds for which a confirmed track continues without a detection.
    pub coast_s: f64,
    /// How far outside the room people may be, in metres.
    pub margin_m: f64,
    /// A person's radius, in metres.
    pub body_radius_m: f64,
    /// Most confirmed people at once.
    pub max_people: usize,
    /// Seconds in one place after which there is a dwell event.
    pub dwell_s: f64,
    /// How far somebody may move, in metres, and still count as being in one place.
    pub dwell_radius_m: f64,
    /// Length of path that is kept of each track, in seconds.
    pub history_s: f64,
}

impl Default for TrackerConfig {
    fn default() -> Self {
        let Settings { tracker, dwelling, .. } = Settings::default();
        let TrackerSettings { room: _, margin_m, body_radius_m, confirm_s, coast_s, max_people } = tracker;
        let Dwelling { seconds: dwell_s, radius_m: dwell_radius_m } = dwelling;
        Self { confirm_s, coast_s, margin_m, body_radius_m, max_people, dwell_s, dwell_radius_m, history_s: 30.0 }
    }
}

impl TrackerConfig {
    /// The tracker's settings for a room.
    pub fn settings(&self, room: Room) -> TrackerSettings {
        TrackerSettings {
            room,
            margin_m: self.margin_m,
            body_radius_m: self.body_radius_m,
            confirm_s: self.confirm_s,
            coast_s: self.coast_s,
            max_people: self.max_people,
        }
    }

    /// When somebody who stays in one place makes a dwell event.
    pub fn dwelling(&self) -> Dwelling {
        Dwelling { seconds: self.dwell_s, radius_m: self.dwell_radius_m }
    }

    pub(super) fn check(&self) -> Result<(), ConfigError> {
        within("tracker.confirm_s", self.confirm_s, 0.0, 10.0, "seconds")?;
        within("tracker.coast_s", self.coast_s, 0.1, 30.0, "seconds")?;
        within("tracker.margin_m", self.margin_m, 0.0, 5.0, "metres")?;
        within("tracker.body_radius_m", self.body_radius_m, 0.0, 0.5, "metres")?;
        within("tracker.max_people", self.max_people as f64, 1.0, MOST_PEOPLE as f64, "people")?;
        within("tracker.dwell_s", self.dwell_s, 1.0, 86_400.0, "seconds")?;
        within("tracker.dwell_radius_m", self.dwell_radius_m, 0.05, 10.0, "metres")?;
        within("tracker.history_s", self.history_s, 1.0, 600.0, "seconds")
    }
}

/// Checks that each zone has its own name and id, and corners that enclose an area.
///
/// # Errors
///
/// If there are too many zones, or one has a missing, overlong or repeated name, an id that is not of letters, digits,
/// `-` and `_` or is repeated, or an invalid polygon.
pub fn check_zones(zones: &[Zone]) -> Result<(), ConfigError> {
    if zones.len() > MOST_ZONES {
        return Err(ConfigError(format!("zones: there are {}, expected at most {MOST_ZONES}", zones.len())));
    }
    for (k, zone) in zones.iter().enumerate() {
        let Zone { name, id, .. } = zone;
        let what = |what: String| Err(ConfigError(format!("zones: {what}")));
        if name.trim().is_empty() || name.chars().nth(LONGEST_NAME).is_some() {
            let name = brief(name);
            return what(format!("the name of zone {} is {name:?}, expected 1 to {LONGEST_NAME} characters", k + 1));
        }
        if name.chars().any(crate::text::is_control) {
            return what(format!("the name of zone {} is {name:?}, expected characters that can be seen", k + 1));
        }
        if zones[..k].iter().any(|other| other.name == *name) {
            return what(format!("two are named \"{name}\", expected each name once"));
        }
        if let Some(id) = id {
            if id.is_empty() || topic_level(id) != *id {
                let id = brief(id);
                return what(format!(
                    "the id of \"{name}\" is {id:?}, expected 1 to {LONGEST_ZONE_ID} of a-z, A-Z, 0-9, - and _"
                ));
            }
            if zones[..k].iter().any(|other| other.id.as_ref() == Some(id)) {
                return what(format!("two have the id \"{id}\", expected each id once"));
            }
        }
        zone.check().map_err(|e| ConfigError(format!("zones: polygon_m of \"{name}\" {e}")))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::Config;

    #[test]
    fn values_out_of_range_name_their_key() {
        let error = |text: &str| Config::parse(text).expect_err("refused").to_string();
        assert_eq!(error("[tracker]\ncoast_s = 0\n"), "tracker.coast_s is 0, expected 0.1 to 30 seconds");
        assert_eq!(error("[tracker]\nmax_people = 0\n"), "tracker.max_people is 0, expected 1 to 6 people");
        assert!(error("[tracker]\nmax_people = -1\n").starts_with("line 2: "));
        assert!(error("[tracker]\ndwell_s = nan\n").starts_with("tracker.dwell_s is NaN"));
    }

    #[test]
    fn zones_are_read_and_wrong_ones_named() {
        let zone = |name: &str, points: &str| format!("[[zones]]\nname = \"{name}\"\npolygon_m = {points}\n");
        let good = zone("bed", "[[0.5, 1.0], [1.5, 1.0], [1.5, 2.0]]");
        let config = Config::parse(&good).unwrap();
        assert_eq!((config.zones[0].name.as_str(), config.zones[0].polygon_m.len()), ("bed", 3));
        let error = |text: String| Config::parse(&text).expect_err("refused").to_string();
        assert_eq!(error(format!("{good}{good}")), "zones: two are named \"bed\", expected each name once");
        assert_eq!(
            error(zone("sofa", "[[0, 1], [1, 1]]")),
            "zones: polygon_m of \"sofa\" has 2 points, expected 3 to 100"
        );
        let crossing = error(zone("sofa", "[[0, 0], [1, 1], [1, 0], [0, 1]]"));
        assert!(crossing.starts_with("zones: polygon_m of \"sofa\" crosses or touches itself"), "{crossing}");
        assert!(error(zone(" ", "[[0, 0], [1, 1], [1, 0]]")).starts_with("zones: the name of zone 1 is \" \""));
        for name in ["a\\nb", "a\\u001b[31m", "a\\u2028b", "a\\u202eb"] {
            assert!(error(zone(name, "[[0, 0], [1, 1], [1, 0]]")).contains("expected characters that can be seen"));
        }
        let long = error(zone(&"Ж".repeat(100_000), "[[0, 0], [1, 1], [1, 0]]"));
        assert!(long.ends_with("expected 1 to 40 characters") && long.len() < 300, "{long}");
        assert!(Config::parse(&zone(&"Ж".repeat(40), "[[0, 0], [1, 1], [1, 0]]")).is_ok());
        for id in ["", "a b", "a/b", "+", "#", "Ж", "a\\u0000b", &"a".repeat(65)] {
            let said = error(zone("sofa", &format!("[[0, 0], [1, 1], [1, 0]]\nid = \"{id}\"")));
            assert!(said.starts_with("zones: the id of \"sofa\" is ") && said.len() < 300, "{said}");
        }
        let same = |name| zone(name, "[[0, 0], [1, 1], [1, 0]]\nid = \"x\"");
        let twice = error(format!("{}{}", same("bed"), same("sofa")));
        assert_eq!(twice, "zones: two have the id \"x\", expected each id once");
        assert!(error("[[zones]]\nname = \"x\"\n".into()).contains("polygon_m"));
        assert!(error(good.replace("polygon_m", "polygon")).contains("unknown field `polygon`"));
    }
}
