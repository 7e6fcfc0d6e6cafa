//! From when until when a certificate is valid.

use std::time::Duration;

use jiff::Timestamp;
use rustls::pki_types::{CertificateDer, UnixTime};
use webpki::{EndEntityCert, Error, KeyUsage};

/// The times between which all certificates of a chain are valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Validity {
    pub(super) from: Timestamp,
    pub(super) until: Timestamp,
}

/// Whether a certificate is valid at some moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Standing {
    Valid,
    NotYet,
    Expired,
}

impl Validity {
    /// Of a chain; `None` if it has a certificate whose times cannot be read.
    pub(super) fn of(chain: &[CertificateDer<'_>]) -> Option<Self> {
        let each = chain.iter().map(of_one).collect::<Option<Vec<_>>>()?;
        let from = each.iter().map(|one| one.from).max()?;
        let until = each.iter().map(|one| one.until).min()?;
        Some(Self { from, until })
    }

    pub(super) fn standing(self, now: Timestamp) -> Standing {
        match now {
            now if now > self.until => Standing::Expired,
            now if now < self.from => Standing::NotYet,
            _ => Standing::Valid,
        }
    }
}

/// The verifier does not tell a certificate's times, but it checks them before anything else and names the one that it
/// misses: so it is asked about times before and after all others.
fn of_one(certificate: &CertificateDer<'_>) -> Option<Validity> {
    let certificate = EndEntityCert::try_from(certificate).ok()?;
    let asked = |at: Timestamp| {
        let time = UnixTime::since_unix_epoch(Duration::from_secs(u64::try_from(at.as_second()).unwrap_or_default()));
        certificate.verify_for_usage(&[], &[], &[], time, KeyUsage::server_auth(), None, None).err()
    };
    let time = |time: UnixTime| Timestamp::from_second(i64::try_from(time.as_secs()).ok()?).ok();
    let from = match asked(Timestamp::UNIX_EPOCH) {
        Some(Error::CertNotValidYet { not_before, .. }) => time(not_before)?,
        _ => Timestamp::UNIX_EPOCH,
    };
    let until = match asked(Timestamp::MAX) {
        Some(Error::CertExpired { not_after, .. }) => time(not_after)?,
        // Those that are meant to last for ever end a day later than times that can be written.
        _ => Timestamp::MAX,
    };
    Some(Validity { from, until })
}

#[cfg(test)]
mod tests {
    use rcgen::{CertificateParams, KeyPair, date_time_ymd};

    use super::*;

    fn certificate(from: i32, until: i32) -> CertificateDer<'static> {
        let mut params = CertificateParams::new(vec!["localhost".into()]).unwrap();
        (params.not_before, params.not_after) = (date_time_ymd(from, 1, 1), date_time_ymd(until, 12, 31));
        params.self_signed(&KeyPair::generate().unwrap()).unwrap().der().clone()
    }

    #[test]
    fn a_chain_is_valid_while_all_of_it_is() {
        let chain = [certificate(2001, 2031), certificate(2011, 2021)];
        let validity = Validity::of(&chain).unwrap();
        assert_eq!(
            validity,
            Validity { from: "2011-01-01T00:00:00Z".parse().unwrap(), until: "2021-12-31T00:00:00Z".parse().unwrap() }
        );
        for (now, standing) in [
            ("2010-12-31T23:59:59Z", Standing::NotYet),
            ("2011-01-01T00:00:00Z", Standing::Valid),
            ("2021-12-31T00:00:00Z", Standing::Valid),
            ("2021-12-31T00:00:01Z", Standing::Expired),
        ] {
            assert_eq!(validity.standing(now.parse().unwrap()), standing, "{now}");
        }
        assert_eq!(Validity::of(&[CertificateDer::from(&b"no certificate"[..])]), None);
        assert_eq!(Validity::of(&[]), None);
    }
}
