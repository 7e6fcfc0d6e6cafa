//! What differs between the configuration in use and another one, and what a running doorcam can make of it.

use serde_json::Value;

use super::Config;

/// What a changed key takes to be in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Takes {
    /// It is in use at once.
    Nothing,
    /// The empty room is learned anew.
    Learning,
    /// doorcam must be started again.
    Restart,
}

/// A key that differs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// As the configuration file has it: `solver.lambda`.
    pub key: String,
    /// What it takes.
    pub takes: Takes,
}

/// Sections and keys that can change while doorcam runs; the rest takes a restart.
const LIVE: [(&str, Takes); 12] = [
    ("zones", Takes::Nothing),
    ("history.keep_days", Takes::Nothing),
    ("history.max_bytes", Takes::Nothing),
    ("room.", Takes::Learning),
    ("grid.", Takes::Learning),
    ("patch.", Takes::Learning),
    ("averaging.", Takes::Learning),
    ("background.", Takes::Learning),
    ("transport.", Takes::Learning),
    ("solver.", Takes::Learning),
    ("scene.", Takes::Learning),
    ("tracker.", Takes::Learning),
];

impl Config {
    /// The keys in which `next` differs, in the order of the file.
    pub fn changes(&self, next: &Self) -> Vec<Change> {
        // Serialising it cannot fail: it has no maps and no numbers that JSON lacks after its check.
        let json = |config: &Self| serde_json::to_value(config).unwrap_or_default();
        let mut keys = Vec::new();
        differing("", &json(self), &json(next), &mut keys);
        // Of a webhook's address JSON shows the host alone.
        if self.webhooks != next.webhooks && !keys.iter().any(|key| key == "webhooks") {
            keys.push("webhooks".into());
        }
        let takes = |key: &str| LIVE.iter().find(|(live, _)| key.starts_with(live)).map_or(Takes::Restart, |(_, t)| *t);
        keys.into_iter().map(|key| Change { takes: takes(&key), key }).collect()
    }

    /// Takes over from `next` the keys that take just that, and no others.
    pub fn adopt(&mut self, next: &Self, takes: Takes) {
        match takes {
            Takes::Nothing => {
                self.zones.clone_from(&next.zones);
                (self.history.keep_days, self.history.max_bytes) = (next.history.keep_days, next.history.max_bytes);
            }
            Takes::Learning => {
                self.room = next.room;
                self.grid = next.grid.clone();
                self.patch = next.patch.clone();
                self.averaging = next.averaging.clone();
                self.background = next.background.clone();
                self.transport = next.transport.clone();
                self.solver = next.solver.clone();
                self.scene = next.scene.clone();
                self.tracker = next.tracker.clone();
            }
            Takes::Restart => {}
        }
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
        let next = "[server]\nlisten = \"127.0.0.1:1\"\n[room]\ndepth_m = 2.5\n[history]\nkeep_days = 1.0\nfile = \"x\"\n\
            [[zones]]\nname = \"bed\"\npolygon_m = [[0, 1], [1, 1], [1, 2]]\n[solver]\nlambda = 0.1\n";
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
            "[server]\nlisten = \"127.0.0.1:1\"\n[room]\ndepth_m = 2.5\n[history]\nkeep_days = 1.0\n[tracker]\ncoast_s = 2.0\n",
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
