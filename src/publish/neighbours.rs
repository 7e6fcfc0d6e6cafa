//! What doorcam hears at the broker: another doorcam that publishes under the same id, what an earlier run left behind,
//! and Home Assistant's birth.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::topics::Topics;

/// Most topics of earlier runs that are remembered until they are cleared: some times what [`crate::config`] allows.
const MOST_LEFT: usize = 1024;
/// How long to listen before what earlier runs left is cleared: another doorcam of this id would have answered.
const SETTLE: Duration = Duration::from_secs(5);
/// How often to ask whether another doorcam of this id is still there, and for how long its last word counts.
const ASK: Duration = Duration::from_secs(60);
const BELIEVE: Duration = Duration::from_secs(150);
/// Shortest time between two answers to Home Assistant, or to another doorcam: what a broker says must not decide how
/// much is sent.
const PAUSE: Duration = Duration::from_secs(2);

/// Longest name of another doorcam that is shown: twice what doorcam itself uses.
const LONGEST_NAME: usize = 32;

/// A message that every doorcam publishes when it connects, retained, and that another one of its id answers.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Presence {
    /// The doorcam that says it.
    instance: String,
    /// Whether it is an answer, which nobody answers.
    #[serde(default)]
    answer: bool,
}

/// What to do about a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Todo {
    Nothing,
    /// Tell another doorcam of this id that this one is here.
    Answer,
}

/// What was heard from the broker.
#[derive(Debug)]
pub(super) struct Neighbours {
    begun: Instant,
    /// The instance of another doorcam with this id, and when it was last heard.
    twin: Option<(String, Instant)>,
    asked: Instant,
    answered: Option<Instant>,
    /// Whether another one, or an old connection, has said that doorcam is offline.
    denied: bool,
    corrected: Option<Instant>,
    /// Whether Home Assistant has started.
    born: bool,
    welcomed: Option<Instant>,
    /// Retained topics below doorcam's own.
    left: BTreeSet<String>,
    /// Whether what was left has been cleared, or is not listened to.
    pub(super) is_clean: bool,
}

impl Neighbours {
    /// Nothing was heard yet.
    pub(super) fn new() -> Self {
        let now = Instant::now();
        Self {
            begun: now,
            twin: None,
            asked: now,
            answered: None,
            denied: false,
            corrected: None,
            born: false,
            welcomed: None,
            left: BTreeSet::new(),
            is_clean: true,
        }
    }

    /// At the beginning of a connection. Who was heard over the one before is believed to be there still.
    pub(super) fn begin(&mut self, now: Instant) {
        (self.begun, self.asked, self.is_clean) = (now, now, true);
        self.left.clear();
    }

    /// Takes a message and says what to do about it. `instance` is this doorcam, `home_assistant` the first level of
    /// its discovery topics.
    pub(super) fn hear(
        &mut self,
        (topic, payload, is_retained): (&str, &[u8], bool),
        (topics, instance, home_assistant): (&Topics, &str, &str),
        now: Instant,
    ) -> Todo {
        if topic == topics.instance() {
            let Ok(said) = serde_json::from_slice::<Presence>(payload) else { return Todo::Nothing };
            // A retained message may be of one that is long gone.
            if is_retained || said.instance == instance {
                return Todo::Nothing;
            }
            // Of several, the first one is named for as long as any of them is there.
            let name = self.twin(now).map(str::to_owned);
            let name = name.unwrap_or_else(|| {
                said.instance.chars().filter(char::is_ascii_alphanumeric).take(LONGEST_NAME).collect()
            });
            self.twin = Some((name, now));
            let may = self.answered.is_none_or(|at| now.saturating_duration_since(at) >= PAUSE);
            if said.answer || !may {
                return Todo::Nothing;
            }
            self.answered = Some(now);
            return Todo::Answer;
        }
        if topic == topics.availability() {
            self.denied |= !is_retained && payload != b"online";
            return Todo::Nothing;
        }
        if !home_assistant.is_empty() && topic.strip_suffix("/status") == Some(home_assistant) {
            self.born |= payload == b"online";
            return Todo::Nothing;
        }
        let is_ours = topics.is_of_a_zone(topic) || is_announcement(payload, topics.id());
        if is_retained && !payload.is_empty() && is_ours && self.left.len() < MOST_LEFT {
            self.left.insert(topic.to_owned());
        }
        Todo::Nothing
    }

    /// Another doorcam that publishes under this one's id, if there is one.
    pub(super) fn twin(&self, now: Instant) -> Option<&str> {
        let (name, at) = self.twin.as_ref()?;
        (now.saturating_duration_since(*at) < BELIEVE).then_some(name.as_str())
    }

    /// Whether to ask again whether another doorcam is there. Only if one was.
    pub(super) fn should_ask(&mut self, now: Instant) -> bool {
        let due = self.twin(now).is_some() && now.saturating_duration_since(self.asked) >= ASK;
        if due {
            self.asked = now;
        }
        due
    }

    /// Whether Home Assistant has started and must be told everything again.
    pub(super) fn should_welcome(&mut self, now: Instant) -> bool {
        due(&mut self.born, &mut self.welcomed, now)
    }

    /// Whether to say again that doorcam is online.
    pub(super) fn should_correct(&mut self, now: Instant) -> bool {
        due(&mut self.denied, &mut self.corrected, now)
    }

    /// The topics that earlier runs left behind, once it is known that they are nobody else's.
    pub(super) fn leftovers(&mut self, is_in_use: impl Fn(&str) -> bool, now: Instant) -> Option<Vec<String>> {
        if self.is_clean || self.twin(now).is_some() || now.saturating_duration_since(self.begun) < SETTLE {
            return None;
        }
        self.left.retain(|topic| !is_in_use(topic));
        Some(self.left.iter().cloned().collect())
    }

    /// A topic of an earlier run has been cleared.
    pub(super) fn cleared(&mut self, topic: &str) {
        self.left.remove(topic);
    }
}

/// Whether something wanted is to be done now, and was not done just before.
fn due(wanted: &mut bool, last: &mut Option<Instant>, now: Instant) -> bool {
    let due = *wanted && last.is_none_or(|at| now.saturating_duration_since(at) >= PAUSE);
    if due {
        (*wanted, *last) = (false, Some(now));
    }
    due
}

/// What to publish when a connection is made, or as an answer.
pub(super) fn presence(instance: &str, answer: bool) -> String {
    serde_json::to_string(&Presence { instance: instance.into(), answer }).unwrap_or_default()
}

/// Whether a discovery message is of doorcam, and of the doorway with this id.
fn is_announcement(payload: &[u8], id: &str) -> bool {
    let Ok(entity) = serde_json::from_slice::<Value>(payload) else { return false };
    let device = format!("doorcam_{id}");
    let identifiers = entity["device"]["identifiers"].as_array();
    entity["origin"]["name"] == "doorcam" && identifiers.is_some_and(|all| all.iter().any(|one| *one == device))
}

#[cfg(test)]
mod tests {
    use super::super::home_assistant::announcements;
    use super::*;

    fn topics() -> Topics {
        Topics::new("doorcam/hall", "hall", vec!["bed".into()])
    }

    fn started(now: Instant) -> Neighbours {
        let mut neighbours = Neighbours::new();
        neighbours.begin(now);
        neighbours.is_clean = false;
        neighbours
    }

    fn hear(neighbours: &mut Neighbours, topic: &str, payload: &str, is_retained: bool, now: Instant) -> Todo {
        neighbours.hear((topic, payload.as_bytes(), is_retained), (&topics(), "me", "homeassistant"), now)
    }

    #[test]
    fn another_doorcam_of_the_same_id_is_heard_answered_and_forgotten() {
        let start = Instant::now();
        let at = |s: u64| start + Duration::from_secs(s);
        let mut neighbours = started(start);
        let mut say = |payload: &str, retained, s| {
            let todo = hear(&mut neighbours, "doorcam/hall/instance", payload, retained, at(s));
            (todo, neighbours.twin(at(s)).map(str::to_owned))
        };
        assert_eq!(say(&presence("me", false), false, 0), (Todo::Nothing, None), "its own echo");
        assert_eq!(say(&presence("other", false), true, 0), (Todo::Nothing, None), "of an earlier run");
        for odd in ["", "x", "[]", "{}", "{\"instance\": 1}", "\u{0}"] {
            assert_eq!(say(odd, false, 0), (Todo::Nothing, None), "{odd}");
        }
        let other = Some("other".to_owned());
        assert_eq!(say(&presence("other", true), false, 1), (Todo::Nothing, other.clone()), "an answer");
        assert_eq!(say(&presence("other", false), false, 2), (Todo::Answer, other.clone()));
        assert_eq!(say(&presence("other", false), false, 3), (Todo::Nothing, other), "not as often as it likes");
        assert!(!neighbours.should_ask(at(59)) && neighbours.should_ask(at(60)) && !neighbours.should_ask(at(61)));
        assert_eq!(neighbours.leftovers(|_| false, at(152)), None, "nothing of another one is cleared");
        neighbours.begin(at(152));
        neighbours.is_clean = false;
        assert_eq!(neighbours.leftovers(|_| false, at(152) + SETTLE), Some(Vec::new()), "it has left");
        assert!(neighbours.twin(at(153)).is_none() && !neighbours.should_ask(at(900)));
    }

    #[test]
    fn only_what_doorcam_itself_left_is_cleared() {
        let start = Instant::now();
        let later = start + SETTLE;
        let mut neighbours = started(start);
        let ours = &announcements("homeassistant", &topics(), "Hall", &["Bed".into()])[2].payload;
        let of = |id: &str| ours.replace("doorcam_hall", &format!("doorcam_{id}"));
        for (topic, payload, retained) in [
            ("doorcam/hall/zones/old/people", "0", true),
            ("doorcam/hall/zones/bed/people", "0", true),
            ("doorcam/hall/zones/live/people", "0", false),
            ("doorcam/hall/zones/gone/people", "", true),
            ("doorcam/hall/zones/old/other", "0", true),
            ("homeassistant/sensor/hall/people_old/config", ours, true),
            ("homeassistant/sensor/hall/another/config", &of("attic"), true),
            ("homeassistant/sensor/hall/foreign/config", "{\"name\": \"a lamp\"}", true),
            ("homeassistant/sensor/hall/odd/config", "\u{fffd}", true),
        ] {
            assert_eq!(hear(&mut neighbours, topic, payload, retained, start), Todo::Nothing);
        }
        assert_eq!(neighbours.leftovers(|_| false, start), None, "not before others could answer");
        let left = neighbours.leftovers(|topic| topic.contains("/bed/"), later).unwrap();
        assert_eq!(left, ["doorcam/hall/zones/old/people", "homeassistant/sensor/hall/people_old/config"]);
        neighbours.cleared(&left[0]);
        assert_eq!(neighbours.leftovers(|_| false, later).unwrap(), left[1..]);
    }

    #[test]
    fn home_assistant_is_welcomed_whenever_it_starts_but_not_as_often_as_anybody_likes() {
        let start = Instant::now();
        let mut neighbours = started(start);
        assert!(!neighbours.should_welcome(start));
        hear(&mut neighbours, "homeassistant/status", "offline", false, start);
        assert!(!neighbours.should_welcome(start));
        hear(&mut neighbours, "homeassistant/status", "online", false, start);
        assert!(neighbours.should_welcome(start) && !neighbours.should_welcome(start + PAUSE));
        hear(&mut neighbours, "homeassistant/status", "online", false, start);
        assert!(!neighbours.should_welcome(start), "again at once");
        assert!(neighbours.should_welcome(start + PAUSE), "but not forgotten");
    }

    #[test]
    fn who_is_online_says_so_when_somebody_says_otherwise() {
        let start = Instant::now();
        let mut neighbours = started(start);
        let mut corrects = |payload, retained, now| {
            hear(&mut neighbours, "doorcam/hall/availability", payload, retained, now);
            neighbours.should_correct(now)
        };
        assert!(!corrects("offline", true, start), "of before this connection");
        assert!(!corrects("online", false, start));
        assert!(corrects("offline", false, start));
        assert!(!corrects("offline", false, start), "not as often as anybody likes");
        assert!(corrects("online", false, start + PAUSE), "but not forgotten");
    }
}
