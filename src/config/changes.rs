//! The differences between two configurations, and which of them a running doorcam can apply.

use serde_json::Value;

use super::Config;

/// What it takes to apply a changed key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Takes {
    /// It applies at once.
    Nothing,
    /// The background must be learned again.
    Learning,
    /// doorcam must be restarted.
    Restart,
}

/// A key that differs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// Its name with its section: `solver.lambda`.
    pub key: String,
    /// What it takes to apply it.
    pub takes: Takes,
}

/// A key, or a section with all of its keys, that can change while doorcam runs; all others need a restart.
struct Live {
    key: &'static str,
    takes: Takes,
    /// Copies it.
    adopt: fn(&mut Config, &Config),
}

const LIVE: [Live; 13] = [
    now("zones", |used, next| used.zones.clone_from(&next.zones)),
    now("history.keep_days", |used, next| used.history.keep_days = next.history.keep_days),
    now("history.max_bytes", |used, next| used.history.max_bytes = next.history.max_bytes),
    learning("doorway", |used, next| used.doorway = next.doorway),
    learning("room", |used, next| used.room.clone_from(&next.room)),
    learning("grid", |used, next| used.grid.clone_from(&next.grid)),
    learning("patch", |used, next| used.patch.clone_from(&next.patch)),
    learning("averaging", |used, next| used.averaging.clone_from(&next.averaging)),
    learning("background", |used, next| used.background.clone_from(&next.background)),
    learning("transport", |used, next| used.transport.clone_from(&next.transport)),
    learning("solver", |used, next| used.solver.clone_from(&next.solver)),
    learning("scene", |used, next| used.scene.clone_from(&next.scene)),
    learning("tracker", |used, next| used.tracker.clone_from(&next.tracker)),
];

const fn now(key: &'static str, adopt: fn(&mut Config, &Config)) -> Live {
    Live { key, takes: Takes::Nothing, adopt }
}

const fn learning(key: &'static str, adopt: fn(&mut Config, &Config)) -> Live {
    Live { key, takes: Takes::Learning, adopt }
}

impl Live {
    fn holds(&self, key: &str) -> bool {
        key.strip_prefix(self.key).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    }
}

impl Config {
    /// The keys in which `next` differs, in the order of the file.
    pub fn changes(&self, next: &Self) -> Vec<Change> {
        // Serialising cannot fail: a checked configuration has no maps and no non-finite numbers.
        let json = |config: &Self| serde_json::to_value(config).unwrap_or_default();
        let mut keys = Vec::new();
        differing("", &json(self), &json(next), &mut keys);
        // A webhook's address serialises as its host alone, so a change of its path does not show in the JSON.
        if self.webhooks != next.webhooks && !keys.iter().any(|key| key == "webhooks") {
            keys.push("webhooks".into());
        }
        let takes = |key: &str| LIVE.iter().find(|live| live.holds(key)).map_or(Takes::Restart, |live| live.takes);
        keys.into_iter().map(|key| Change { takes: takes(&key), key }).collect()
    }

    /// Copies from `next` the keys that need exactly `takes`, and no others.
    pub fn adopt(&mut self, next: &Self, takes: Takes) {
        LIVE.iter().filter(|live| live.takes == takes).for_each(|live| (live.adopt)(self, next));
    }
}

/// The keys below `at` whose values differ; a list is one value.
fn differing(at: &str, one: &Value, other: &Value, keys: &mut Vec<String>) {
    match (one, other) {
        (Value::Object(ones), Value::Object(others)) => {
            for (key, one) in ones {
                let below = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
                differing(&below, one, others.get(key).unwrap_or(&Value::Null), keys);
            }
            // What is left out of one while it has no value.
            let added = others.keys().filter(|key| !ones.contains_key(*key));
            keys.extend(added.map(|key| if at.is_empty() { key.clone() } else { format!("{at}.{key}") }));
        }
        _ if one == other => {}
        _ => keys.push(at.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> Config {
        Config::parse(text).unwrap()
    }

    #[test]
    fn each_change_is_named_with_what_it_takes() {
        let next = "[server]\nlisten = \"127.0.0.1:1\"\n[room]\ndepth_m = 2.5\n[history]\nkeep_days = 1.0\n\
            file = \"x\"\n[[zones]]\nname = \"bed\"\npolygon_m = [[0, 1], [1, 1], [1, 2]]\n[solver]\nlambda = 0.1\n";
        let changes = Config::default().changes(&config(next));
        let mut told: Vec<(&str, Takes)> = changes.iter().map(|change| (change.key.as_str(), change.takes)).collect();
        told.sort_unstable();
        assert_eq!(
            told,
            [
                ("history.file", Takes::Restart),
                ("history.keep_days", Takes::Nothing),
                ("room.depth_m", Takes::Learning),
                ("server.listen", Takes::Restart),
                ("solver.lambda", Takes::Learning),
                ("zones", Takes::Nothing),
            ]
        );
        assert_eq!(config(next).changes(&config(next)), []);
    }

    #[test]
    fn what_can_be_adopted_is_adopted_and_nothing_else() {
        let next = config(
            "[server]\nlisten = \"127.0.0.1:1\"\n[room]\ndepth_m = 2.5\n[history]\nkeep_days = 1.0\n\
             [tracker]\ncoast_s = 2.0\n",
        );
        let mut used = Config::default();
        used.adopt(&next, Takes::Nothing);
        used.adopt(&next, Takes::Learning);
        let left: Vec<String> = used.changes(&next).into_iter().map(|change| change.key).collect();
        assert_eq!(left, ["server.listen"]);
    }

    #[test]
    fn a_webhook_whose_secret_path_changed_has_changed() {
        let hook = |path: &str| config(&format!("[[webhooks]]\nurl = \"http://a.org/{path}\"\nsecret_file = \"/x\"\n"));
        let changes = hook("one").changes(&hook("two"));
        assert_eq!(changes, [Change { key: "webhooks".into(), takes: Takes::Restart }]);
    }
}
