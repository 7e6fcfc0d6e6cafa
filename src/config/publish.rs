//! `[site]`, `[mqtt]` and `[[webhooks]]`: what is sent to other systems.

use std::fmt;
use std::net::Ipv6Addr;
use std::path::PathBuf;

use axum::http::Uri;
use serde::{Deserialize, Serialize, Serializer};
use utoipa::ToSchema;

use super::{ConfigError, brief, within};
use doorcam_core::tracking::EventKind;

/// Most webhooks that may be configured.
const MOST_WEBHOOKS: usize = 8;
/// Most characters in a site's id.
const LONGEST_ID: usize = 64;

/// Most characters in a site's name, which is part of every discovery message.
const LONGEST_SITE_NAME: usize = 100;
/// Longest host name there is, in bytes.
const LONGEST_HOST: usize = 253;
/// Longest first levels of topics, in bytes. Brokers take 65,535 for a whole topic, many of them less.
const LONGEST_TOPIC: usize = 200;
/// Longest user name at a broker, in bytes.
const LONGEST_USER: usize = 256;
/// Longest address of a webhook, in bytes: servers take a few thousand.
const LONGEST_URL: usize = 2048;

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

    /// Whether it is of reasonable length and each part of it can be used.
    fn is_usable(&self) -> bool {
        let Ok(uri) = self.0.parse::<Uri>() else { return false };
        let Some(authority) = uri.authority().filter(|_| self.0.len() <= LONGEST_URL) else { return false };
        let is_whole = authority.as_str().rsplit('@').next() == Some(authority.host());
        !authority.host().is_empty() && (is_whole || authority.port_u16().is_some_and(|port| port > 0))
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
    let refused = |key: &str, value: &str, expected: &str| {
        Err(ConfigError(format!("{key} is {:?}, expected {expected}", brief(value))))
    };
    if topic_level(&site.id) != site.id {
        return refused("site.id", &site.id, &format!("at most {LONGEST_ID} of a-z, A-Z, 0-9, - and _"));
    }
    if site.name.chars().nth(LONGEST_SITE_NAME).is_some() || site.name.chars().any(crate::text::is_control) {
        let expected = format!("at most {LONGEST_SITE_NAME} characters that can be seen");
        return refused("site.name", &site.name, &expected);
    }
    check_mqtt(mqtt, refused)?;
    if webhooks.len() > MOST_WEBHOOKS {
        return Err(ConfigError(format!("webhooks: there are {}, expected at most {MOST_WEBHOOKS}", webhooks.len())));
    }
    for (k, webhook) in webhooks.iter().enumerate() {
        let wrong = |what: &str| Err(ConfigError(format!("webhooks: {what}")));
        let url = &webhook.url;
        if !matches!(url.scheme_and_host(), Some(("http" | "https", _))) {
            return wrong(&format!("url of webhook {} is not http://... or https://...", k + 1));
        }
        if !url.is_usable() {
            return wrong(&format!(
                "url of webhook {} cannot be used, expected host, port and path of at most {LONGEST_URL} characters, \
                 with %20 and so on for those that are special",
                k + 1
            ));
        }
        if webhook.secret_file.as_os_str().is_empty() {
            return wrong(&format!("secret_file of webhook {} is empty, expected a file with its secret", k + 1));
        }
    }
    Ok(())
}

fn check_mqtt(
    mqtt: &MqttConfig,
    refused: impl Fn(&str, &str, &str) -> Result<(), ConfigError>,
) -> Result<(), ConfigError> {
    let MqttConfig { host, port, username, prefix, home_assistant, .. } = mqtt;
    let of_hosts = |c: char| c.is_ascii_alphanumeric() || "-._:".contains(c);
    if host.len() > LONGEST_HOST
        || !host.chars().all(of_hosts)
        || host.contains(':') && host.parse::<Ipv6Addr>().is_err()
    {
        return refused("mqtt.host", host, "a host name or an address, without scheme and port, such as broker.lan");
    }
    within("mqtt.port", f64::from(*port), 1.0, 65_535.0, "(a port)")?;
    if username.len() > LONGEST_USER || username.chars().any(char::is_control) {
        return refused("mqtt.username", username, &format!("at most {LONGEST_USER} bytes without control characters"));
    }
    for (key, topic, may_be_empty) in [("mqtt.prefix", prefix, false), ("mqtt.home_assistant", home_assistant, true)] {
        let level = |level: &str| {
            let is_plain = |c: char| !matches!(c, '+' | '#') && !crate::text::is_control(c);
            !level.is_empty() && level.chars().all(is_plain) && !level.starts_with('$')
        };
        let is_topic = topic.len() <= LONGEST_TOPIC && topic.split('/').all(level);
        if !(is_topic || topic.is_empty() && may_be_empty) {
            let expected = format!("a topic of at most {LONGEST_TOPIC} bytes without + and #, such as home/doors");
            return refused(key, topic, &expected);
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
        let long = "x".repeat(100_000);
        for (section, key, values) in [
            ("site", "id", &["a/b", "Küche", "#", "a b", "a\\u0000", &long][..]),
            ("site", "name", &["a\\nb", "\\u202ex", &long]),
            ("mqtt", "prefix", &["+", "a/+/b", "#", "$SYS", "a//b", "/", "a/", "a\\u0000", "a\\nb", &long]),
            ("mqtt", "home_assistant", &["+", "ha/#", "/", "a\\u0000", &long]),
            ("mqtt", "host", &["mqtt://x", "a b", "x:1883", "a\\u0000b", "Küche", "a/b", &long]),
            ("mqtt", "username", &["a\\u0000b", "a\\nb", &long]),
        ] {
            for value in values {
                let said = error(&format!("[{section}]\n{key} = \"{value}\"\n"));
                let is_clear = said.starts_with(&format!("{section}.{key} is \"")) && said.contains(", expected ");
                assert!(is_clear && said.len() < 400 && !said.contains('\n'), "{said}");
            }
        }
        for host in ["broker.lan", "127.0.0.1", "::1", "fe80::1", "b_1-x"] {
            assert!(Config::parse(&format!("[mqtt]\nhost = \"{host}\"\n")).is_ok(), "{host}");
        }
        assert!(Config::parse("[mqtt]\nhome_assistant = \"\"\nprefix = \"home/doors\"\n").is_ok());
        let hook = |url: &str, more: &str| format!("[[webhooks]]\nurl = \"{url}\"\nsecret_file = \"/x\"\n{more}");
        let wrong = error(&hook("ftp://token@example.org/secret", ""));
        assert_eq!(wrong, "webhooks: url of webhook 1 is not http://... or https://...");
        for url in ["http://a b", "http://x:port/", "http://x/\\u0000", "http://x/ y", &format!("http://x/{long}")] {
            let said = error(&hook(url, ""));
            assert!(said.starts_with("webhooks: url of webhook 1 cannot be used") && said.len() < 300, "{said}");
        }
        let none = error("[[webhooks]]\nurl = \"http://example.org\"\nsecret_file = \"\"\n");
        assert_eq!(none, "webhooks: secret_file of webhook 1 is empty, expected a file with its secret");
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
