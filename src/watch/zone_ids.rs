//! Identities of zones. Topics and Home Assistant's entities are named after a zone's id, so an id must never pass from
//! one zone to another: automations would silently follow another part of the room.
//!
//! The rule, for a zone without an `id` of its own:
//!
//! 1. A name that had an id in the configuration before has it again.
//! 2. A name of ASCII characters alone gives the id that it always gave: lower case, `_` for everything but letters,
//!    digits and `-`. Except if that id belongs or ever belonged to another zone, or if two new names give the same.
//! 3. Every other name gives an id with a part of the hash of the whole name, so it depends on that name alone.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::config::{ConfigError, LONGEST_ZONE_ID, topic_level};
use crate::watch::ZonesRefused;
use doorcam_core::tracking::Zone;
use doorcam_source::files::replace;

/// Most ids that are remembered. When there are more, the oldest ones that are not in use are forgotten.
const MOST_KNOWN: usize = 1024;
/// Digits of a name's hash in an id. Two of the few names of one doorway have the same by one chance in billions.
const DIGITS: usize = 8;
/// Longest file of ids, in bytes: a few times what [`MOST_KNOWN`] take.
const LONGEST_FILE: u64 = 2_000_000;

/// An id that belongs, or belonged, to a zone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Known {
    id: String,
    /// The zone's last name.
    name: String,
    /// The name in the configuration that it was derived from, if it was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    derived_from: Option<String>,
}

/// What the file holds.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Kept {
    ids: Vec<Known>,
    /// Whether ids have been forgotten, so that one that is not known may have been used before.
    forgot: bool,
}

/// Gives ids to zones, and remembers them.
#[derive(Debug, Clone, Default)]
pub struct ZoneIds {
    /// Where they are kept between runs, if they are.
    file: Option<PathBuf>,
    kept: Kept,
    /// What is in the file.
    saved: Kept,
}

impl ZoneIds {
    /// The ids that were given in earlier runs. Without a file they are remembered in this run only.
    ///
    /// # Errors
    /// If there is a file that cannot be read.
    pub fn load(file: Option<PathBuf>) -> Result<Self, ZonesRefused> {
        let kept = file.as_deref().map(read).transpose()?.unwrap_or_default();
        Ok(Self { file, saved: kept.clone(), kept })
    }

    /// Configured or saved zones, each with its id. Ids do not depend on the order of the zones.
    pub fn identified(&mut self, zones: &[Zone]) -> Vec<Zone> {
        let mut zones = zones.to_vec();
        let mut taken: HashSet<String> = zones.iter().filter_map(|zone| zone.id.clone()).collect();
        for zone in zones.iter_mut().filter(|zone| zone.id.is_none()) {
            let mut before = self.kept.ids.iter().filter(|k| k.derived_from.as_ref() == Some(&zone.name));
            zone.id = before.find(|known| !taken.contains(&known.id)).map(|known| known.id.clone());
            taken.extend(zone.id.clone());
        }
        self.fill(&mut zones, true);
        self.remember(&zones);
        zones
    }

    /// Drawn zones, each with its id. A zone without one is that of the same name in use, if there is one, or else a
    /// new one, whose id no zone ever had.
    ///
    /// # Errors
    /// If a zone has the id of another one that was removed.
    pub(super) fn drawn(&mut self, mut zones: Vec<Zone>, in_use: &[Zone]) -> Result<Vec<Zone>, ConfigError> {
        for Zone { id, name, .. } in &zones {
            let Some(id) = id else { continue };
            let is_in_use = in_use.iter().any(|zone| zone.id.as_ref() == Some(id));
            let known = self.kept.ids.iter().find(|known| known.id == *id);
            if let Some(known) = known.filter(|known| !is_in_use && known.name != *name) {
                return Err(ConfigError::new(format!(
                    "zones: the id \"{id}\" of \"{name}\" was that of \"{}\", which was removed, expected none or another",
                    known.name
                )));
            }
        }
        let claimed: HashSet<String> = zones.iter().filter_map(|zone| zone.id.clone()).collect();
        for zone in zones.iter_mut().filter(|zone| zone.id.is_none()) {
            let same = in_use.iter().find(|other| other.name == zone.name).and_then(|other| other.id.clone());
            zone.id = same.filter(|id| !claimed.contains(id));
        }
        self.fill(&mut zones, false);
        self.remember(&zones);
        Ok(zones)
    }

    /// Writes the ids if there are new ones and a file to keep them in.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&mut self) -> Result<(), ZonesRefused> {
        let Some(file) = self.file.as_deref().filter(|_| self.kept != self.saved) else { return Ok(()) };
        let mut text = serde_json::to_vec_pretty(&self.kept).unwrap_or_default();
        text.push(b'\n');
        replace(file, &text).map_err(|e| refused(file, format!("cannot be written: {e}")))?;
        self.saved.clone_from(&self.kept);
        Ok(())
    }

    /// Gives new ids to the zones that have none.
    fn fill(&mut self, zones: &mut [Zone], configured: bool) {
        let mut taken: HashSet<String> = zones.iter().filter_map(|zone| zone.id.clone()).collect();
        taken.extend(self.kept.ids.iter().map(|known| known.id.clone()));
        let mut new: Vec<&mut Zone> = zones.iter_mut().filter(|zone| zone.id.is_none()).collect();
        // In the order of their names, so that the order of the zones does not matter.
        new.sort_by(|one, other| one.name.cmp(&other.name));
        let plain: Vec<Option<String>> = new.iter().map(|zone| plain(&zone.name)).collect();
        let alone = |id: &Option<String>| id.is_some() && plain.iter().filter(|other| *other == id).count() == 1;
        // Where ids have been forgotten, one that looks free may have been another zone's.
        let may_repeat = configured || !self.kept.forgot;
        for (zone, id) in new.iter_mut().zip(&plain) {
            let base = id.as_deref().map_or("zone", |id| &id[..id.len().min(LONGEST_ZONE_ID - 1 - DIGITS)]);
            let of_name = [id.clone().filter(|_| alone(id)), Some(format!("{base}-{}", digits(zone.name.as_bytes())))];
            let of_name = of_name.into_iter().flatten().filter(|_| may_repeat);
            let any = std::iter::from_fn(|| Some(format!("{base}-{}", digits(&random()))));
            let id = of_name.chain(any).find(|id| !taken.contains(id)).unwrap_or_default();
            taken.insert(id.clone());
            if configured {
                self.kept.ids.push(Known {
                    id: id.clone(),
                    name: zone.name.clone(),
                    derived_from: Some(zone.name.clone()),
                });
            }
            zone.id = Some(id);
        }
    }

    /// Notes the ids and names of zones that come into use.
    fn remember(&mut self, zones: &[Zone]) {
        for Zone { id, name, .. } in zones {
            let Some(id) = id else { continue };
            match self.kept.ids.iter_mut().find(|known| known.id == *id) {
                Some(known) => known.name.clone_from(name),
                None => self.kept.ids.push(Known { id: id.clone(), name: name.clone(), derived_from: None }),
            }
        }
        let mut surplus = self.kept.ids.len().saturating_sub(MOST_KNOWN);
        self.kept.forgot |= surplus > 0;
        self.kept.ids.retain(|known| {
            let goes = surplus > 0 && !zones.iter().any(|zone| zone.id.as_ref() == Some(&known.id));
            surplus -= usize::from(goes);
            !goes
        });
    }
}

/// The id that a name of ASCII characters gives by itself.
fn plain(name: &str) -> Option<String> {
    name.is_ascii().then(|| topic_level(name).to_ascii_lowercase())
}

/// The first digits of a hash.
fn digits(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().take(DIGITS / 2).map(|byte| format!("{byte:02x}")).collect()
}

fn random() -> [u8; 16] {
    let mut bytes = [0; 16];
    // Without random numbers the time does: what matters is that the id was not used before, and that is checked.
    if getrandom::fill(&mut bytes).is_err() {
        bytes = jiff::Timestamp::now().as_nanosecond().to_le_bytes();
    }
    bytes
}

fn read(file: &Path) -> Result<Kept, ZonesRefused> {
    let failed = |reason: String| refused(file, reason);
    let metadata = match std::fs::metadata(file) {
        Ok(metadata) => metadata,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Kept::default()),
        Err(e) => return Err(failed(format!("cannot be read: {e}"))),
    };
    if !metadata.is_file() || metadata.len() > LONGEST_FILE {
        return Err(failed(format!("is no file of at most {LONGEST_FILE} bytes, expected the ids of zones")));
    }
    let text = std::fs::read_to_string(file).map_err(|e| failed(format!("cannot be read: {e}")))?;
    serde_json::from_str(&text).map_err(|e| failed(format!("has no ids of zones: {e}")))
}

fn refused(file: &Path, reason: String) -> ZonesRefused {
    ZonesRefused::Store { file: file.to_owned(), reason }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;
    use crate::config::check_zones;

    fn zone(name: &str, id: Option<&str>) -> Zone {
        let polygon_m = vec![[0.0, 1.0], [1.0, 1.0], [1.0, 2.0]];
        Zone { name: name.into(), id: id.map(Into::into), polygon_m }
    }

    fn named(names: &[&str]) -> Vec<Zone> {
        names.iter().map(|name| zone(name, None)).collect()
    }

    fn ids(zones: &[Zone]) -> BTreeMap<String, String> {
        zones.iter().map(|zone| (zone.name.clone(), zone.id.clone().unwrap())).collect()
    }

    fn first(names: &[&str]) -> BTreeMap<String, String> {
        ids(&ZoneIds::default().identified(&named(names)))
    }

    #[test]
    fn ascii_names_keep_their_ids_and_all_others_have_that_of_their_whole_name() {
        for (name, id) in [
            ("bed", "bed"),
            ("Bed", "bed"),
            ("Near, left", "near__left"),
            ("bed/1", "bed_1"),
            ("desk-2", "desk-2"),
            ("a_b", "a_b"),
        ] {
            assert_eq!(first(&[name])[name], id);
        }
        // printf Спальня | sha256sum
        assert_eq!(first(&["Спальня"])["Спальня"], "zone-c980fe78");
        let both = first(&["Спальня", "Кабинет"]);
        assert_ne!(both["Спальня"], both["Кабинет"]);
        assert_eq!(first(&["Кабинет"])["Кабинет"], both["Кабинет"], "whatever else there is");
        let alike = first(&["Küche", "Kuche", "Ku\u{308}che"]);
        assert_eq!(alike["Kuche"], "kuche");
        assert_eq!(alike.values().collect::<HashSet<_>>().len(), 3);
    }

    #[test]
    fn names_that_look_alike_both_have_their_hash_and_keep_it() {
        let mut known = ZoneIds::default();
        let both = ids(&known.identified(&named(&["a b", "a_b"])));
        assert_eq!(both, first(&["a_b", "a b"]));
        assert!(both.values().all(|id| id.starts_with("a_b-") && id.len() == 12), "{both:?}");
        let one = ids(&known.identified(&named(&["a_b"])));
        assert_eq!(one["a_b"], both["a_b"], "alone from now on");
        let again = ids(&known.identified(&named(&["A B", "a b", "a_b"])));
        assert_eq!((&again["a b"], &again["a_b"]), (&both["a b"], &both["a_b"]));
    }

    #[test]
    fn what_looks_like_a_zone_that_was_there_first_does_not_get_its_id() {
        let mut known = ZoneIds::default();
        assert_eq!(ids(&known.identified(&named(&["a b"])))["a b"], "a_b");
        let later = ids(&known.identified(&named(&["a_b"])));
        assert_ne!(later["a_b"], "a_b", "although \"a b\" is gone");
        assert_eq!(ids(&known.identified(&named(&["a_b", "a b"])))["a b"], "a_b", "it is back");
    }

    #[test]
    fn an_id_of_its_own_comes_before_a_derived_one() {
        let zones = [zone("Guest bed", Some("bed")), zone("Bed", None)];
        let given = ids(&ZoneIds::default().identified(&zones));
        assert_eq!(given["Guest bed"], "bed");
        assert!(given["Bed"].starts_with("bed-"), "{given:?}");
    }

    #[test]
    fn drawn_zones_keep_their_ids_through_renames_and_nobody_gets_them_later() {
        let mut known = ZoneIds::default();
        let one = known.drawn(named(&["Спальня", "Desk"]), &[]).unwrap();
        let [bedroom, desk] = [one[0].id.clone().unwrap(), one[1].id.clone().unwrap()];
        assert_eq!(desk, "desk");
        // Renamed with its id, and the other one as before, without its id.
        let two = known.drawn(vec![zone("Table", Some("desk")), zone("Спальня", None)], &one).unwrap();
        assert_eq!(ids(&two), BTreeMap::from([("Table".into(), desk), ("Спальня".into(), bedroom.clone())]));
        let three = known.drawn(named(&["Кабинет"]), &two).unwrap();
        assert_ne!(three[0].id.as_ref(), Some(&bedroom));
        // New zones of the old names are other zones.
        let four = known.drawn(named(&["Спальня", "Desk", "Table"]), &three).unwrap();
        for zone in &four {
            assert!(![Some(&bedroom), Some(&"desk".to_owned())].contains(&zone.id.as_ref()), "{zone:?}");
        }
        // The removed one is put back with its id, but no other one gets it.
        let back = known.drawn(vec![zone("Table", Some("desk"))], &four).unwrap();
        assert_eq!(back[0].id.as_deref(), Some("desk"));
        let wrong = known.drawn(vec![zone("Sofa", Some(&bedroom))], &back).expect_err("refused").to_string();
        assert!(wrong.contains("was that of \"Спальня\""), "{wrong}");
    }

    #[test]
    fn a_zone_of_the_configuration_that_is_edited_on_the_page_stays_the_same() {
        let mut known = ZoneIds::default();
        let configured = known.identified(&named(&["Bed", "Кабинет"]));
        let drawn = known.drawn(vec![zone("Guest bed", configured[0].id.as_deref())], &configured).unwrap();
        assert_eq!(drawn[0].id.as_deref(), Some("bed"));
        assert_eq!(known.identified(&named(&["Bed", "Кабинет"])), configured, "back to the configuration");
    }

    #[test]
    fn ids_outlive_the_run_and_a_wrong_file_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("zone-ids.json");
        let mut known = ZoneIds::load(Some(file.clone())).unwrap();
        known.drawn(named(&["Desk"]), &[]).unwrap();
        known.save().unwrap();
        let mut known = ZoneIds::load(Some(file.clone())).unwrap();
        let again = known.drawn(named(&["Desk"]), &[]).unwrap();
        assert_ne!(again[0].id.as_deref(), Some("desk"));
        for (text, words) in [("[", "has no ids of zones"), ("{\"ids\": [1]}", "has no ids of zones")] {
            std::fs::write(&file, text).unwrap();
            let said = ZoneIds::load(Some(file.clone())).expect_err("refused").to_string();
            assert!(said.contains("zone-ids.json") && said.contains(words), "{said}");
        }
        let said = ZoneIds::load(Some(directory.path().into())).expect_err("refused").to_string();
        assert!(said.contains("expected the ids of zones"), "{said}");
    }

    #[test]
    fn what_is_remembered_has_an_end_and_still_no_id_comes_back() {
        let mut known = ZoneIds::default();
        let mut seen = HashSet::new();
        let mut in_use = Vec::new();
        for round in 0..2 * MOST_KNOWN / 16 {
            let names: Vec<String> = (0..16).map(|k| format!("zone {round} {k}")).collect();
            let zones = known.drawn(names.iter().map(|name| zone(name, None)).collect(), &in_use).unwrap();
            assert!(zones.iter().all(|zone| seen.insert(zone.id.clone().unwrap())));
            in_use = zones;
        }
        assert_eq!(known.kept.ids.len(), MOST_KNOWN);
        let again = known.drawn(named(&["zone 0 0"]), &in_use).unwrap();
        assert!(!seen.contains(again[0].id.as_ref().unwrap()));
    }

    /// Names of a few characters, so that many look alike.
    fn names() -> impl Strategy<Value = Vec<String>> {
        prop::collection::hash_set("[aAbB_ /äЖ-]{1,3}", 1..8)
            .prop_map(|names| names.into_iter().filter(|name| !name.trim().is_empty()).collect())
    }

    proptest! {
        #[test]
        fn ids_are_valid_and_different_and_do_not_depend_on_the_order(names in names(), by in 0_usize..8) {
            let zones: Vec<Zone> = names.iter().map(|name| zone(name, None)).collect();
            let given = ZoneIds::default().identified(&zones);
            prop_assert!(check_zones(&given).is_ok(), "valid, and each once: {:?}", given);
            let mut turned = zones.clone();
            turned.reverse();
            turned.rotate_left(by % names.len().max(1));
            prop_assert_eq!(ids(&given), ids(&ZoneIds::default().identified(&turned)));
        }

        #[test]
        fn zones_that_come_and_go_leave_the_ids_of_the_others(
            names in names(), steps in prop::collection::vec(0_u8..=255, 1..6)
        ) {
            let mut known = ZoneIds::default();
            let mut given: BTreeMap<String, String> = BTreeMap::new();
            for step in steps {
                let chosen: Vec<Zone> =
                    names.iter().enumerate().filter(|(k, _)| step >> k & 1 == 1).map(|(_, name)| zone(name, None)).collect();
                for (name, id) in ids(&known.identified(&chosen)) {
                    let before = given.entry(name.clone()).or_insert_with(|| id.clone());
                    prop_assert_eq!(&*before, &id, "{} has always the same", name);
                }
                let all: HashSet<&String> = given.values().collect();
                prop_assert_eq!(all.len(), given.len(), "and nobody else ever has it: {:?}", given);
            }
        }

        #[test]
        fn names_that_do_not_look_alike_do_not_matter_to_each_other(
            name in "[a-zA-Z0-9 äЖ-]{1,10}", other in "[x-z]{1,3}"
        ) {
            let plain_differs = plain(&name).is_none_or(|id| Some(id) != plain(&other));
            prop_assume!(plain_differs && !name.trim().is_empty());
            prop_assert_eq!(&first(&[&name])[&name], &first(&[&other, &name])[&name]);
        }
    }
}
