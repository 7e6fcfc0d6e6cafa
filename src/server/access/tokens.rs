use std::ffi::OsString;
use std::fmt;
use std::path::Path;

use serde::Serialize;
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;
use utoipa::ToSchema;

use super::AccessError;
use crate::config::AccessConfig;
use crate::server::secret_file;

/// Shortest token, in characters: 20 hexadecimal digits are 80 bits, too many to guess.
const SHORTEST: usize = 20;
/// Longest token, in characters: it must fit into a header.
const LONGEST: usize = 256;

/// What a client may do; control includes read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(in crate::server) enum Scope {
    /// See everything.
    Read,
    /// See and change everything.
    Control,
}

/// A token, kept as its hash: nothing can show it, and hashes have one length and are compared in constant time.
#[derive(Clone, Copy)]
struct Token([u8; 32]);

impl Token {
    fn new(text: &[u8]) -> Self {
        Self(Sha256::digest(text).into())
    }

    fn is(self, other: Self) -> bool {
        self.0.ct_eq(&other.0).into()
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(redacted)")
    }
}

/// What a token lets its holder do. Sessions and open sockets keep it, to be held against the tokens in use.
#[derive(Debug, Clone, Copy)]
pub(in crate::server) struct Grant {
    /// What the holder may do.
    pub(super) scope: Scope,
    token: Token,
}

/// The tokens that doorcam was given.
#[derive(Debug, Clone, Default)]
pub(super) struct Tokens {
    control: Option<Token>,
    read: Option<Token>,
}

impl Tokens {
    /// Reads the tokens from the configured files or from the environment.
    pub(super) fn load(
        config: &AccessConfig,
        environment: impl Fn(&str) -> Option<OsString>,
    ) -> Result<Self, AccessError> {
        let one = |key: &'static str, file: &Path, variable: &'static str| match environment(variable) {
            Some(_) if !file.as_os_str().is_empty() => Err(AccessError::TwoTokens { key, variable }),
            Some(text) => parse(text.as_encoded_bytes(), variable).map(Some),
            None if file.as_os_str().is_empty() => Ok(None),
            None => {
                let bytes = secret_file::read(file).map_err(|e| AccessError::Secret(format!("{key}: {e}")))?;
                parse(bytes.trim_ascii(), &file.display().to_string()).map(Some)
            }
        };
        let control = one("access.token_file", &config.token_file, "DOORCAM_TOKEN")?;
        let read = one("access.read_token_file", &config.read_token_file, "DOORCAM_READ_TOKEN")?;
        if let (Some(control), Some(read)) = (control, read)
            && control.is(read)
        {
            return Err(AccessError::SameTokens);
        }
        Ok(Self { control, read })
    }

    /// Whether both sets of tokens are the same.
    pub(super) fn are(&self, others: &Self) -> bool {
        let same = |one: Option<Token>, other: Option<Token>| match (one, other) {
            (Some(one), Some(other)) => one.is(other),
            (one, other) => one.is_none() && other.is_none(),
        };
        same(self.control, others.control) && same(self.read, others.read)
    }

    /// Whether there are no tokens, so that nobody needs one.
    pub(super) fn is_empty(&self) -> bool {
        self.control.is_none() && self.read.is_none()
    }

    /// What the holder of a token may do. The time it takes does not depend on the token.
    pub(super) fn grant_of(&self, presented: &[u8]) -> Option<Grant> {
        let token = Token::new(presented);
        let scope = self.scope_of(token)?;
        Some(Grant { scope, token })
    }

    /// Whether the token of this grant is still in use, for the same.
    pub(super) fn still_give(&self, grant: &Grant) -> bool {
        self.scope_of(grant.token) == Some(grant.scope)
    }

    fn scope_of(&self, presented: Token) -> Option<Scope> {
        let is = |token: Option<Token>| token.is_some_and(|token| token.is(presented));
        let (control, read) = (is(self.control), is(self.read));
        if control { Some(Scope::Control) } else { read.then_some(Scope::Read) }
    }
}

/// Parses a token. `place` says where it is from, for the error, which must not show it.
fn parse(text: &[u8], place: &str) -> Result<Token, AccessError> {
    let place = || place.to_owned();
    if !(SHORTEST..=LONGEST).contains(&text.len()) {
        return Err(AccessError::Length { place: place(), length: text.len(), shortest: SHORTEST, longest: LONGEST });
    }
    if !text.iter().all(u8::is_ascii_graphic) {
        return Err(AccessError::Characters { place: place() });
    }
    Ok(Token::new(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTROL: &str = "control-control-control";
    const READ: &str = "read-read-read-read-read";

    fn environment(name: &str) -> Option<OsString> {
        match name {
            "DOORCAM_TOKEN" => Some(CONTROL.into()),
            "DOORCAM_READ_TOKEN" => Some(READ.into()),
            _ => None,
        }
    }

    #[test]
    fn each_token_has_its_scope_and_nothing_else_has_one() {
        let tokens = Tokens::load(&AccessConfig::default(), environment).unwrap();
        let scope_of = |presented: &[u8]| tokens.grant_of(presented).map(|grant| grant.scope);
        assert_eq!(scope_of(CONTROL.as_bytes()), Some(Scope::Control));
        assert_eq!(scope_of(READ.as_bytes()), Some(Scope::Read));
        for wrong in ["", "control", "control-control-controk", "control-control-control ", &CONTROL[..22]] {
            assert_eq!(scope_of(wrong.as_bytes()), None, "{wrong}");
        }
        assert!(Tokens::default().grant_of(b"").is_none());
        assert!(Tokens::default().is_empty() && !tokens.is_empty());
    }

    #[test]
    fn a_grant_lasts_while_its_token_is_in_use_for_the_same() {
        let load = |control: &'static str, read: &'static str| {
            let environment = move |name: &str| Some(if name == "DOORCAM_TOKEN" { control } else { read }.into());
            Tokens::load(&AccessConfig::default(), environment).unwrap()
        };
        let before = load(CONTROL, READ);
        let [control, read] = [CONTROL, READ].map(|token| before.grant_of(token.as_bytes()).unwrap());
        let other = load("another-another-another", READ);
        assert!(!other.still_give(&control) && other.still_give(&read));
        let swapped = load(READ, CONTROL);
        assert!(!swapped.still_give(&control) && !swapped.still_give(&read));
        assert!(load(CONTROL, READ).still_give(&control));
    }

    #[test]
    fn what_is_no_token_is_refused_without_being_shown() {
        let given = |text: &'static str| {
            let config = AccessConfig::default();
            let only = move |name: &str| (name == "DOORCAM_TOKEN").then(|| text.into());
            Tokens::load(&config, only).map(|_| ()).map_err(|e| e.to_string())
        };
        let short = "DOORCAM_TOKEN has 6 characters, expected a token of 20 to 256, as from openssl rand -hex 24";
        assert_eq!(given("secret"), Err(short.into()));
        assert!(given("").is_err());
        let odd = "DOORCAM_TOKEN has a character that a header cannot carry, expected a token of printable ASCII \
                   characters without spaces";
        assert_eq!(given("a pass phrase with spaces"), Err(odd.into()));
        assert_eq!(given(CONTROL), Ok(()));
        let same = |_: &str| Some(CONTROL.into());
        assert!(Tokens::load(&AccessConfig::default(), same).is_err(), "one token cannot have two scopes");
    }

    #[test]
    fn nothing_shows_a_token() {
        let tokens = Tokens::load(&AccessConfig::default(), environment).unwrap();
        let shown = format!("{tokens:?}");
        let hash = format!("{:?}", Sha256::digest(CONTROL));
        assert!(!shown.contains("control-") && !shown.contains(&hash), "{shown}");
    }
}
