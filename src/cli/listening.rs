use std::net::SocketAddr;
use std::path::PathBuf;

use doorcam::config::{Config, TlsConfig};

/// Where a command listens, and who may read and change things there.
#[derive(Debug, clap::Args)]
pub(super) struct ListenOptions {
    /// Address and port to listen on; port 0 picks a free one; an address that other machines can reach needs a token
    /// [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR:PORT")]
    pub(super) listen: Option<SocketAddr>,
    /// File with the token that lets its holder read and change everything [default: $DOORCAM_TOKEN]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// File with the token that lets its holder read everything [default: $DOORCAM_READ_TOKEN]
    #[arg(long, value_name = "FILE")]
    read_token_file: Option<PathBuf>,
    /// Listen without a token on an address that other machines can reach: everybody there can read and change
    /// everything
    #[arg(long)]
    allow_unauthenticated: bool,
    /// Serve HTTPS with the certificates in this PEM file; it is read again when it changes [default:
    /// tls.certificate_file]
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// PEM file with the certificate's private key [default: tls.key_file]
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
}

impl ListenOptions {
    /// Replaces values of the configuration with those given on the command line.
    pub(super) fn apply(&self, config: &mut Config) {
        let Config { server, access, tls, .. } = config;
        server.listen = self.listen.unwrap_or(server.listen);
        for (option, key) in
            [(&self.token_file, &mut access.token_file), (&self.read_token_file, &mut access.read_token_file)]
        {
            if let Some(file) = option {
                key.clone_from(file);
            }
        }
        if let (Some(certificate), Some(key)) = (&self.tls_cert, &self.tls_key) {
            *tls = TlsConfig { certificate_file: certificate.clone(), key_file: key.clone() };
        }
        access.allow_unauthenticated |= self.allow_unauthenticated;
    }
}
