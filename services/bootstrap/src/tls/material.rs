//! The files of an identity, read and checked as a whole.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustls::client::Resumption;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::{NoServerSessionStorage, WebPkiClientVerifier};
use rustls::version::TLS13;
use rustls::{ClientConfig, RootCertStore, ServerConfig};

use super::certificate::{CertificateError, Certified};
use super::verifier::SiteVerifier;
use crate::config::TlsConfig;

/// What was read from the files.
#[derive(Debug)]
pub(crate) struct Material {
    /// The holder of the own certificate.
    pub holder: Certified,
    /// For those who connect.
    pub server: Arc<ServerConfig>,
    /// For connecting to others.
    pub client: Arc<ClientConfig>,
}

/// Files that make no identity.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file that cannot be read or holds nothing of its kind.
    #[error("{}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        source: rustls::pki_types::pem::Error,
    },
    /// A file without what it is for.
    #[error("{} holds no certificate", .0.display())]
    Empty(PathBuf),
    /// A certificate that names nobody.
    #[error("the certificate {}", path.display())]
    Nobody {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        source: CertificateError,
    },
    /// An authority or a key that does not go with its certificate.
    #[error("{} cannot be used", path.display())]
    Unusable {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        source: rustls::Error,
    },
    /// No authority that could vouch for anybody.
    #[error("{} cannot be used", path.display())]
    NoAuthority {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        source: rustls::server::VerifierBuilderError,
    },
}

// === impl Material ===

impl Material {
    pub(crate) fn read(files: &TlsConfig) -> Result<Self, TlsError> {
        let chain = certificates(&files.certificate)?;
        let first = chain
            .first()
            .ok_or_else(|| TlsError::Empty(files.certificate.clone()))?;
        let holder = Certified::read(first).map_err(|source| TlsError::Nobody {
            path: files.certificate.clone(),
            source,
        })?;
        let key = PrivateKeyDer::from_pem_file(&files.key).map_err(unreadable(&files.key))?;
        let roots = Arc::new(authorities(&files.client_ca)?);

        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let verifier = WebPkiClientVerifier::builder_with_provider(roots.clone(), provider.clone())
            .build()
            .map_err(|source| TlsError::NoAuthority {
                path: files.client_ca.clone(),
                source,
            })?;
        let mut server = ServerConfig::builder_with_provider(provider.clone())
            .with_protocol_versions(&[&TLS13])
            .map_err(unusable(&files.certificate))?
            .with_client_cert_verifier(Arc::new(SiteVerifier::new(verifier)))
            .with_single_cert(chain.clone(), key.clone_key())
            .map_err(unusable(&files.key))?;
        server.alpn_protocols = vec![b"h2".to_vec()];
        server.session_storage = Arc::new(NoServerSessionStorage {});
        server.send_tls13_tickets = 0;

        let mut client = ClientConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&TLS13])
            .map_err(unusable(&files.certificate))?
            .with_root_certificates(roots)
            .with_client_auth_cert(chain, key)
            .map_err(unusable(&files.key))?;
        client.alpn_protocols = vec![b"h2".to_vec()];
        client.resumption = Resumption::disabled();
        Ok(Self {
            holder,
            server: Arc::new(server),
            client: Arc::new(client),
        })
    }
}

fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let certificates: Vec<_> = CertificateDer::pem_file_iter(path)
        .and_then(Iterator::collect)
        .map_err(unreadable(path))?;
    if certificates.is_empty() {
        return Err(TlsError::Empty(path.to_owned()));
    }
    Ok(certificates)
}

fn authorities(path: &Path) -> Result<RootCertStore, TlsError> {
    let mut roots = RootCertStore::empty();
    for certificate in certificates(path)? {
        roots.add(certificate).map_err(unusable(path))?;
    }
    Ok(roots)
}

fn unreadable(path: &Path) -> impl FnOnce(rustls::pki_types::pem::Error) -> TlsError {
    let path = path.to_owned();
    move |source| TlsError::Unreadable { path, source }
}

fn unusable(path: &Path) -> impl FnOnce(rustls::Error) -> TlsError {
    let path = path.to_owned();
    move |source| TlsError::Unusable { path, source }
}
