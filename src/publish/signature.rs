use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

/// Signs a webhook's body: HMAC-SHA256 (RFC 2104) of the timestamp (seconds since 1970), a full stop and the body, in
/// hexadecimal. Because the time is signed, an old message cannot be passed off as a new one.
pub fn sign(secret: &str, timestamp: i64, body: &str) -> String {
    // HMAC accepts keys of any length, so this cannot fail.
    let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(secret.as_bytes()) else { return String::new() };
    mac.update(format!("{timestamp}.{body}").as_bytes());
    mac.finalize().into_bytes().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_signature_is_what_openssl_makes() {
        // printf '1700000000.{"event":1}' | openssl dgst -sha256 -hmac 'a secret'
        let expected = "b81d0d52281bc0b5e2ed7d642dbc0cd60ccf4fa8c27d3bcc5b8fed265333fdb9";
        assert_eq!(sign("a secret", 1_700_000_000, "{\"event\":1}"), expected);
    }
}
