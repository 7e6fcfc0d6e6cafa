use std::net::SocketAddr;
use std::path::PathBuf;

use doorcam::config::{Config, TlsConfig};

/// Where a command listens, and who may see and change what there.
#[derive(Debug, clap::Args)]
pub(super) struct ListenOptions {
    /// Address and port to listen on; port 0 takes a free one; one that others can reach takes a token [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR:PORT")]
    pub(super) listen: Option<SocketAddr>,
    /// File with the token that lets its holder see and change everything [default: $DOORCAM_TOKEN]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// File with the token that lets its holder see everything [default: $DOORCAM_READ_TOKEN]
    #[arg(long, value_name = "FILE")]
    read_token_file: Option<PathBuf>,
    /// Listen where others can reach it without any token: all of them see and change everything
    #[arg(long)]
    allow_unauthenticated: bool,
    /// Serve HTTPS with the certificates of this PEM file; it is read again when it changes [default: tls.certificate_file]
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// PEM file with the certificate's private key [default: tls.key_file]
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
}

impl ListenOptions {
    /// Puts what the command line says in the place of what the configuration says.
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
