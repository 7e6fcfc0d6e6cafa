//! `[room]` and `[doorway]`: what is known of the hidden room and of the door.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{ConfigError, within};
use doorcam_core::geometry::{Leaf, Room, RoomLight};

/// Most lights that a room may have.
const MOST_LIGHTS: usize = 32;

/// `[room]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RoomConfig {
    /// Half of the width of the part of the room that the map covers, in metres.
    pub half_width_m: f64,
    /// Its depth behind the wall, in metres.
    pub depth_m: f64,
    /// Windows, lamps and screens that people may stand in front of.
    pub lights: Vec<RoomLight>,
}

impl Default for RoomConfig {
    fn default() -> Self {
        let Room { half_width_m, depth_m } = Room::default();
        Self { half_width_m, depth_m, lights: Vec::new() }
    }
}

impl RoomConfig {
    /// The part of the room that the map covers.
    pub fn mapped(&self) -> Room {
        Room { half_width_m: self.half_width_m, depth_m: self.depth_m }
    }

    pub(super) fn check(&self) -> Result<(), ConfigError> {
        within("room.half_width_m", self.half_width_m, 0.1, 100.0, "metres")?;
        within("room.depth_m", self.depth_m, 0.1, 100.0, "metres")?;
        if self.lights.len() > MOST_LIGHTS {
            let count = self.lights.len();
            return Err(ConfigError::new(format!("room.lights: there are {count}, expected at most {MOST_LIGHTS}")));
        }
        for (k, light) in self.lights.iter().enumerate() {
            light.check().map_err(|e| ConfigError::new(format!("room.lights: light {} {e}", k + 1)))?;
        }
        Ok(())
    }
}

/// `[doorway]`
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DoorwayConfig {
    /// The door, if it stands open into the room; for doorways whose calibration or recording says nothing of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leaf: Option<Leaf>,
}

impl DoorwayConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        self.leaf.map_or(Ok(()), |leaf| leaf.validate().map_err(|e| ConfigError::new(e.to_string())))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Change, Config, Preset, Takes};
    use super::*;
    use doorcam_core::geometry::{LightKind, Side};

    const WINDOW: &str =
        "[[room.lights]]\nkind = \"window\"\nfrom_m = [-0.2, 4.5]\nto_m = [1.0, 4.5]\nheight_m = [0.9, 2.1]\n";

    fn refused(text: &str) -> String {
        Config::parse(text).expect_err("refused").to_string()
    }

    #[test]
    fn lights_are_read_and_reach_the_engine() {
        let off = WINDOW.replace("window", "lamp") + "on = false\n";
        let config = Config::parse(&format!("[room]\ndepth_m = 4.5\n{WINDOW}{off}")).unwrap();
        let window = RoomLight {
            kind: LightKind::Window,
            from_m: [-0.2, 4.5],
            to_m: [1.0, 4.5],
            height_m: [0.9, 2.1],
            on: true,
        };
        let lights = [window, RoomLight { kind: LightKind::Lamp, on: false, ..window }];
        assert_eq!(config.room.lights, lights);
        assert_eq!(config.settings().lights, lights);
        assert_eq!(config.with_preset(Some(Preset::Published)).room.lights, lights);
    }

    #[test]
    fn wrong_lights_are_named() {
        let error = refused(&format!("{WINDOW}{}", WINDOW.replace("[0.9, 2.1]", "[2.1, 0.9]")));
        assert_eq!(
            error,
            "room.lights: light 2 has height_m [2.1, 0.9], expected its lower and its upper edge, from 0 to 10 metres"
        );
        assert!(
            refused(&WINDOW.replace("window", "sun")).starts_with("line 2: unknown variant `sun`, expected one of")
        );
        assert!(refused(&WINDOW.replace("kind", "type")).contains("unknown field `type`"));
        assert!(refused(&WINDOW.replace("height_m = [0.9, 2.1]\n", "")).contains("missing field `height_m`"));
        assert_eq!(refused(&WINDOW.repeat(33)), "room.lights: there are 33, expected at most 32");
    }

    #[test]
    fn a_room_of_unknown_size_is_searched_farther_than_it_is_mapped() {
        let searched = |text: &str| Config::parse(text).unwrap().settings().tracker.room;
        assert_eq!(searched(""), Room { half_width_m: 2.2, depth_m: 4.2 });
        assert_eq!(Config::default().settings().grid.room, Room { half_width_m: 1.5, depth_m: 3.0 });
        assert_eq!(searched("[room]\ndepth_m = 3.5\n"), Room { half_width_m: 1.5, depth_m: 3.5 });
        assert_eq!(searched("[room]\nhalf_width_m = 1.0\n"), Room { half_width_m: 1.0, depth_m: 3.0 });
    }

    #[test]
    fn a_leaf_is_read_and_a_wrong_one_named() {
        let text = "[doorway.leaf]\nhinge = \"left\"\nangle_deg = 98\nwidth_m = 0.84\n";
        let leaf = Leaf { hinge: Side::Left, angle_deg: 98.0, width_m: 0.84 };
        let config = Config::parse(text).unwrap();
        assert_eq!(config.settings().leaf, Some(leaf));
        let changes = Config::default().changes(&config);
        assert_eq!(changes, [Change { key: "doorway.leaf".into(), takes: Takes::Learning }]);
        assert_eq!(config.changes(&Config::default()), changes);
        assert!(refused(&text.replace("98", "270")).starts_with("doorway.leaf.angle_deg is 270, expected 5 to 180"));
        assert!(refused(&text.replace("left", "top")).starts_with("line 2: unknown variant `top`"));
        assert!(refused(&text.replace("width_m = 0.84\n", "")).contains("missing field `width_m`"));
    }
}
