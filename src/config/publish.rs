//! `[site]`, `[mqtt]` and `[[webhooks]]`: what is sent to other systems.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize, Serializer};
use utoipa::ToSchema;

use super::{ConfigError, within};
use doorcam_core::tracking::EventKind;

/// Most webhooks that may be configured.
const MOST_WEBHOOKS: usize = 8;
/// Most characters in a site's id.
const LONGEST_ID: usize = 64;

/// `[site]`
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SiteConfig {
    /// Identifies this doorway to programs; empty: the machine's name.
    pub id: String,
    /// Name of this doorway as shown to people; empty: the id.
    pub name: String,
}

/// `[mqtt]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MqttConfig {
    /// The broker's host; empty: none.
    pub host: String,
    /// The broker's port.
    pub port: u16,
    /// Whether the connection is encrypted and the broker's certificate checked.
    pub tls: bool,
    /// Certificates (PEM) of the authorities trusted to sign the broker's; empty: those that the system trusts.
    #[schema(value_type = String)]
    pub ca_file: PathBuf,
    /// User name; empty: none.
    pub username: String,
    /// A file that contains only the password; empty: none.
    #[schema(value_type = String)]
    pub password_file: PathBuf,
    /// First level of all topics.
    pub prefix: String,
    /// First level of Home Assistant's discovery topics; empty: no discovery.
    pub home_assistant: String,
}

impl Default for MqttConfig {
    fn default() -> Self {
        Self {
            host: String::new(),
            port: 1883,
            tls: false,
            ca_file: PathBuf::new(),
            username: String::new(),
            password_file: PathBuf::new(),
            prefix: "doorcam".into(),
            home_assistant: "homeassistant".into(),
        }
    }
}

/// One entry of `[[webhooks]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WebhookConfig {
    /// Where events are posted.
    #[schema(value_type = String)]
    pub url: HookUrl,
    /// The kinds of events to post; all if empty.
    #[serde(default)]
    pub events: Vec<EventKind>,
    /// A file that contains only the secret used to sign posts.
    #[schema(value_type = String)]
    pub secret_file: PathBuf,
}

/// A webhook's address. Many services put a secret in the path, so it is displayed and serialised without it.
#[derive(Clone, PartialEq, Deserialize)]
pub struct HookUrl(String);

impl HookUrl {
    /// The whole address, with any secret in it. Never log or show it.
    pub fn secret(&self) -> &str {
        &self.0
    }

    fn scheme_and_host(&self) -> Option<(&str, &str)> {
        let (scheme, rest) = self.0.split_once("://")?;
        let authority = rest.split(['/', '?', '#']).next()?;
        let host = authority.rsplit('@').next()?;
        (!host.is_empty()).then_some((scheme, host))
    }
}

impl fmt::Display for HookUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.scheme_and_host() {
            Some((scheme, host)) => write!(f, "{scheme}://{host}/..."),
            None => f.write_str("..."),
        }
    }
}

impl fmt::Debug for HookUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl Serialize for HookUrl {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl SiteConfig {
    /// The id of this doorway, as configured or from the machine's name: letters, digits, `-` and `_`.
    pub fn id(&self) -> String {
        if !self.id.is_empty() {
            return self.id.clone();
        }
        let node = rustix::system::uname();
        let id = topic_level(&node.nodename().to_string_lossy());
        if id.is_empty() { "doorcam".into() } else { id }
    }

    /// The name of this doorway as shown to people: as configured, or the id.
    pub fn name(&self) -> String {
        if self.name.is_empty() { self.id() } else { self.name.clone() }
    }
}

/// A name as one level of a topic: every character other than a letter, digit, `-` or `_` becomes `_`.
pub fn topic_level(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    name.chars().map(plain).take(LONGEST_ID).collect()
}

pub(super) fn check(site: &SiteConfig, mqtt: &MqttConfig, webhooks: &[WebhookConfig]) -> Result<(), ConfigError> {
    if topic_level(&site.id) != site.id {
        let what = format!("site.id is {:?}, expected at most {LONGEST_ID} of a-z, A-Z, 0-9, - and _", site.id);
        return Err(ConfigError(what));
    }
    within("mqtt.port", f64::from(mqtt.port), 1.0, 65_535.0, "(a port)")?;
    for (key, topic, may_be_empty) in
        [("mqtt.prefix", &mqtt.prefix, false), ("mqtt.home_assistant", &mqtt.home_assistant, true)]
    {
        let level = |level: &str| !level.is_empty() && !level.contains(['+', '#', '\0']) && !level.starts_with('$');
        if !(topic.split('/').all(level) || topic.is_empty() && may_be_empty) {
            return Err(ConfigError(format!(
                "{key} is {topic:?}, expected a topic without + and #, such as home/doors"
            )));
        }
    }
    if webhooks.len() > MOST_WEBHOOKS {
        return Err(ConfigError(format!("webhooks: there are {}, expected at most {MOST_WEBHOOKS}", webhooks.len())));
    }
    for (k, webhook) in webhooks.iter().enumerate() {
        if !matches!(webhook.url.scheme_and_host(), Some(("http" | "https", _))) {
            let what = format!("webhooks: url of webhook {} is not http://... or https://...", k + 1);
            return Err(ConfigError(what));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::Config;
    use super::*;

    fn error(text: &str) -> String {
        Config::parse(text).expect_err("refused").to_string()
    }

    #[test]
    fn wrong_values_name_their_key() {
        assert!(
            error("[site]\nid = \"front door\"\n").starts_with("site.id is \"front door\", expected at most 64 of")
        );
        assert_eq!(error("[mqtt]\nport = 0\n"), "mqtt.port is 0, expected 1 to 65535 (a port)");
        assert!(error("[mqtt]\nprefix = \"a/#\"\n").starts_with("mqtt.prefix is \"a/#\", expected a topic"));
        assert!(error("[mqtt]\nprefix = \"\"\n").starts_with("mqtt.prefix"));
        assert!(Config::parse("[mqtt]\nhome_assistant = \"\"\nprefix = \"home/doors\"\n").is_ok());
        let hook = |url: &str, more: &str| format!("[[webhooks]]\nurl = \"{url}\"\nsecret_file = \"/x\"\n{more}");
        let wrong = error(&hook("ftp://token@example.org/secret", ""));
        assert_eq!(wrong, "webhooks: url of webhook 1 is not http://... or https://...");
        assert!(error(&hook("http://example.org", "events = [\"arrive\"]")).contains("unknown variant `arrive`"));
        assert!(error("[[webhooks]]\nurl = \"http://example.org\"\n").contains("secret_file"));
    }

    #[test]
    fn addresses_are_shown_without_what_may_be_secret() {
        let text =
            "[[webhooks]]\nurl = \"https://me:pass@hooks.example.org:8443/T0/B1/xyz?key=1\"\nsecret_file = \"/x\"\n";
        let config = Config::parse(text).unwrap();
        let shown = format!("{config:?} {}", serde_json::to_string(&config).unwrap());
        assert!(shown.contains("https://hooks.example.org:8443/..."), "{shown}");
        assert!(!shown.contains("xyz") && !shown.contains("pass@") && !shown.contains("key=1"), "{shown}");
        assert_eq!(config.webhooks[0].url.secret(), "https://me:pass@hooks.example.org:8443/T0/B1/xyz?key=1");
    }

    #[test]
    fn a_site_without_an_id_has_the_machines_name() {
        let id = SiteConfig::default().id();
        assert!(!id.is_empty() && topic_level(&id) == id);
        assert_eq!(topic_level("bed/ room+é"), "bed__room__");
    }
}
