//! Opens connections to other servers, each with the identity that is in force at that moment.
//!
//! `https://host:port` shows the own certificate and asks for the other's; `http://host:port` does neither. An address without a
//! scheme is https for whoever has an identity.

use std::io;
use std::sync::Arc;

use hyper_util::rt::TokioIo;
use rustls::pki_types::ServerName;
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tonic::transport::{Channel, Endpoint, Error, Uri};
use tower::service_fn;

use super::credentials::{Credentials, Refreshed};

/// A server that can be called.
#[derive(Clone, Debug)]
pub struct Dial {
    endpoint: Endpoint,
    secured: Option<Secured>,
}

#[derive(Clone, Debug)]
struct Secured {
    credentials: Credentials,
    name: ServerName<'static>,
}

/// An address that cannot be called.
#[derive(Debug, thiserror::Error)]
pub enum DialError {
    /// It is none.
    #[error("{0:?} is no address; must be host:port, http://host:port or https://host:port")]
    NoAddress(String),
    /// A server with TLS knows only who shows a certificate.
    #[error("{0:?} needs an identity: certificate, key and authority")]
    NoIdentity(String),
}

// === impl Dial ===

impl Dial {
    /// The server at `address`; with TLS it must be certified as the host that stands there.
    ///
    /// # Errors
    /// No address, or https without credentials.
    pub fn to(address: &str, credentials: Option<&Credentials>) -> Result<Self, DialError> {
        let no_address = || DialError::NoAddress(address.to_owned());
        let (scheme, place) = match address.split_once("://") {
            Some((scheme, place)) => (scheme, place),
            None if credentials.is_some() => ("https", address),
            None => ("http", address),
        };
        // The transport must not meddle with TLS, which is done here; the other side is told the scheme that holds.
        let plain: Uri = format!("http://{place}")
            .parse()
            .map_err(|_| no_address())?;
        let host = plain.host().ok_or_else(no_address)?.to_owned();
        let endpoint = Endpoint::from(plain);
        match (scheme, credentials) {
            ("http", _) => Ok(Self {
                endpoint,
                secured: None,
            }),
            ("https", None) => Err(DialError::NoIdentity(address.to_owned())),
            ("https", Some(credentials)) => {
                let origin = format!("https://{place}")
                    .parse()
                    .map_err(|_| no_address())?;
                Ok(Self {
                    endpoint: endpoint.origin(origin),
                    secured: Some(Secured {
                        credentials: credentials.clone(),
                        name: server_name(&host).ok_or_else(no_address)?,
                    }),
                })
            }
            _ => Err(no_address()),
        }
    }

    /// The same server, certified as `name` instead of the host of its address.
    ///
    /// # Errors
    /// `name` is no DNS name and no IP address.
    pub fn certified_as(mut self, name: &str) -> Result<Self, DialError> {
        if let Some(secured) = &mut self.secured {
            secured.name =
                server_name(name).ok_or_else(|| DialError::NoAddress(name.to_owned()))?;
        }
        Ok(self)
    }

    /// The same server with other limits.
    pub fn with(self, limits: impl FnOnce(Endpoint) -> Endpoint) -> Self {
        Self {
            endpoint: limits(self.endpoint),
            secured: self.secured,
        }
    }

    /// A channel that is connected.
    ///
    /// # Errors
    /// The server cannot be reached, or is not the one it should be.
    pub async fn connect(self) -> Result<Channel, Error> {
        match self.secured {
            Some(secured) => {
                let connect = service_fn(move |uri| secured.clone().open(uri));
                self.endpoint.connect_with_connector(connect).await
            }
            None => self.endpoint.connect().await,
        }
    }

    /// A channel that connects when it is first used. Must be called within a Tokio runtime.
    pub fn connect_lazily(self) -> Channel {
        match self.secured {
            Some(secured) => {
                let connect = service_fn(move |uri| secured.clone().open(uri));
                self.endpoint.connect_with_connector_lazy(connect)
            }
            None => self.endpoint.connect_lazy(),
        }
    }
}

// === impl Secured ===

impl Secured {
    async fn open(self, uri: Uri) -> io::Result<TokioIo<TlsStream<TcpStream>>> {
        let (Some(host), Some(port)) = (uri.host(), uri.port_u16()) else {
            let problem = "the address has no host or no port";
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        };
        let stream = TcpStream::connect((bare(host), port)).await?;
        stream.set_nodelay(true)?;
        // A server looks at its files by itself; whoever only calls looks at them here.
        if let Refreshed::Kept(error) = self.credentials.refresh() {
            tracing::error!("new files of the identity cannot be used, the old ones stay: {error}");
        }
        let config = Arc::clone(&self.credentials.material().client);
        let secure = TlsConnector::from(config).connect(self.name, stream);
        secure.await.map(TokioIo::new)
    }
}

fn server_name(host: &str) -> Option<ServerName<'static>> {
    ServerName::try_from(bare(host))
        .ok()
        .map(|name| name.to_owned())
}

/// An IPv6 address without the brackets that it wears in an address.
fn bare(host: &str) -> &str {
    host.trim_start_matches('[').trim_end_matches(']')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_address_is_refused() {
        for address in ["", "ftp://host:1", "http://", "http://a b:1"] {
            let error = Dial::to(address, None).unwrap_err();
            assert!(matches!(error, DialError::NoAddress(_)), "{address:?}");
        }
    }

    #[test]
    fn https_needs_an_identity_and_nothing_else_does() {
        let error = Dial::to("https://127.0.0.1:1", None).unwrap_err();
        assert!(matches!(error, DialError::NoIdentity(_)));
        for address in ["127.0.0.1:1", "http://127.0.0.1:1", "http://[::1]:1"] {
            Dial::to(address, None).unwrap();
        }
    }
}
