use std::os::unix::fs::MetadataExt;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, SystemTime};

use jiff::Timestamp;
use metrics::{describe_gauge, gauge};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ServerConfig, crypto};
use tokio_rustls::TlsAcceptor;

use super::certificate::{Standing, Validity};
use crate::config::TlsConfig;
use crate::server::secret_file;
use doorcam_source::files::{FileKind, ReadError, read as read_file};

/// How often the files are checked. Changed files are used once they are the same in two checks in a row, because
/// certificate and key are written one after the other.
const LOOK: Duration = Duration::from_secs(2);

/// A certificate or key that cannot be used: one line that names the configuration key and the file.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct TlsError(String);

/// The certificate in use, which is read again when its files change.
#[derive(Debug)]
pub struct Tls {
    files: TlsConfig,
    read: Stamp,
    in_use: RwLock<Arc<ServerConfig>>,
    /// When the certificate in use is valid, if that is known, and what the log said last about it.
    validity: Mutex<(Option<Validity>, Standing)>,
}

/// Modification time, length and inode of certificate and key, which change when the files are written or replaced.
type Stamp = [Option<(SystemTime, u64, u64)>; 2];

impl Tls {
    /// Reads certificate and key; `None` if TLS is not configured.
    ///
    /// # Errors
    ///
    /// If a file cannot be read or is not PEM, if the two do not belong together, or if others can read the key.
    pub fn load(files: &TlsConfig) -> Result<Option<Self>, TlsError> {
        if !files.is_on() {
            return Ok(None);
        }
        let read = stamp(files);
        let (config, validity) = load(files)?;
        let in_use = RwLock::new(Arc::new(config));
        let tls = Self { files: files.clone(), read, in_use, validity: Mutex::new((validity, Standing::Valid)) };
        tls.say_standing();
        Ok(Some(tls))
    }

    /// Accepts new connections with the certificate in use.
    pub(super) fn acceptor(&self) -> TlsAcceptor {
        TlsAcceptor::from(Arc::clone(&self.in_use.read().unwrap_or_else(PoisonError::into_inner)))
    }

    /// Watches the files for a new certificate; never returns. One that cannot be used is logged and not used.
    pub(super) async fn follow(self: Arc<Self>) {
        let (mut used, mut seen) = (self.read, self.read);
        describe_gauge!(
            "doorcam_tls_certificate_expiry_seconds",
            "When the certificate in use expires, in seconds since 1970"
        );
        loop {
            self.say_standing();
            tokio::time::sleep(LOOK).await;
            let tls = Arc::clone(&self);
            // The disk may hang, and nobody else may wait for it.
            let look = move || {
                let now = stamp(&tls.files);
                let renew = now != used && now == seen;
                if renew {
                    tls.renew();
                }
                (now, renew)
            };
            // An error is a panic, which is in the log.
            let Ok((now, renewed)) = tokio::task::spawn_blocking(look).await else { continue };
            if renewed {
                used = now;
            }
            seen = now;
        }
    }

    fn renew(&self) {
        match load(&self.files) {
            Ok((fresh, validity)) => {
                *self.in_use.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(fresh);
                tracing::info!("{}: the new certificate is in use", self.files.certificate_file.display());
                *self.validity.lock().unwrap_or_else(PoisonError::into_inner) = (validity, Standing::Valid);
                self.say_standing();
            }
            Err(e) => tracing::warn!("{e}: the certificate in use stays"),
        }
    }

    /// Says in the log if the certificate in use is not valid now, once.
    fn say_standing(&self) {
        let mut validity = self.validity.lock().unwrap_or_else(PoisonError::into_inner);
        let (Some(Validity { from, until }), said) = *validity else { return };
        gauge!("doorcam_tls_certificate_expiry_seconds").set(until.as_second() as f64);
        let standing = Validity { from, until }.standing(Timestamp::now());
        if standing == said {
            return;
        }
        validity.1 = standing;
        let file = self.files.certificate_file.display();
        match standing {
            Standing::Valid => tracing::info!("tls.certificate_file: {file}: valid from now on, until {until:.0}"),
            Standing::NotYet => {
                tracing::warn!(
                    "tls.certificate_file: {file}: not valid before {from:.0}, browsers refuse it until then"
                );
            }
            Standing::Expired => {
                tracing::warn!("tls.certificate_file: {file}: expired at {until:.0}, browsers refuse it");
            }
        }
    }
}

fn stamp(files: &TlsConfig) -> Stamp {
    [&files.certificate_file, &files.key_file].map(|file| {
        let data = std::fs::metadata(file).ok()?;
        Some((data.modified().ok()?, data.len(), data.ino()))
    })
}

fn load(files: &TlsConfig) -> Result<(ServerConfig, Option<Validity>), TlsError> {
    let certificate = |what: &dyn std::fmt::Display| {
        TlsError(format!("tls.certificate_file: {}: {what}", files.certificate_file.display()))
    };
    let key = |what: &dyn std::fmt::Display| TlsError(format!("tls.key_file: {}: {what}", files.key_file.display()));
    let chain = read_file(&files.certificate_file, FileKind::CERTIFICATES).map_err(|e| match e {
        e @ ReadError::Io(_) => certificate(&format!("cannot read it: {}", e.words())),
        e => certificate(&e),
    })?;
    let chain = CertificateDer::pem_slice_iter(&chain).collect::<Result<Vec<_>, _>>().map_err(|e| certificate(&e))?;
    if chain.is_empty() {
        return Err(certificate(&"no certificate in it, expected PEM (-----BEGIN CERTIFICATE-----)"));
    }
    let validity = Validity::of(&chain);
    let private = secret_file::read(&files.key_file).map_err(|e| TlsError(format!("tls.key_file: {e}")))?;
    let private = PrivateKeyDer::from_pem_slice(&private)
        .map_err(|_| key(&"no private key in it, expected PEM (-----BEGIN PRIVATE KEY-----)"))?;
    let mut config = ServerConfig::builder_with_provider(Arc::new(crypto::ring::default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|e| certificate(&e))?
        .with_no_client_auth()
        .with_single_cert(chain, private)
        .map_err(|e| certificate(&format!("cannot be used with {}: {e}", files.key_file.display())))?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok((config, validity))
}
