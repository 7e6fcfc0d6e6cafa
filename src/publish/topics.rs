//! Names of the MQTT topics of one doorway.

use super::facts::zone_levels;

/// The topics of one doorway, below its root.
#[derive(Debug, Clone)]
pub(super) struct Topics {
    root: String,
    id: String,
    zones: Vec<String>,
}

impl Topics {
    pub(super) fn new(root: &str, id: &str, zones: &[&str]) -> Self {
        Self { root: root.into(), id: id.into(), zones: zone_levels(zones) }
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

    /// Topic of the occupancy, `ON` or `OFF`, of the hidden room or of a zone.
    pub(super) fn occupancy(&self, zone: Option<usize>) -> String {
        format!("{}/occupancy", self.place(zone))
    }

    /// Topic of the number of people in the hidden room or in a zone.
    pub(super) fn count(&self, zone: Option<usize>) -> String {
        format!("{}/people", self.place(zone))
    }

    fn place(&self, zone: Option<usize>) -> String {
        zone.map_or_else(|| self.root.clone(), |zone| format!("{}/zones/{}", self.root, self.zone(zone)))
    }
}

pub(super) fn availability(root: &str) -> String {
    format!("{root}/availability")
}
