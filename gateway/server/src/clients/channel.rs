//! The one place where the gateway opens connections to the services that it calls.

use std::net::SocketAddr;

use arthro_bootstrap::tls::{Credentials, Dial, DialError};
use tonic::transport::{Channel, Endpoint};

use super::{KEEP_ALIVE, SHORT_DEADLINE};

/// How connections are opened: with the gateway's own certificate, where it has one. They connect when first used, and again
/// after they broke.
#[derive(Clone, Debug, Default)]
pub struct Connector {
    credentials: Option<Credentials>,
}

impl Connector {
    /// Shows these credentials; without them nothing but loopback is reached.
    pub fn new(credentials: Option<Credentials>) -> Self {
        Self { credentials }
    }

    /// To `host:port`, with or without a scheme. Must be called within a Tokio runtime.
    pub fn channel(&self, address: &str) -> Result<Channel, DialError> {
        Ok(self.dial(address)?.connect_lazily())
    }

    /// To one of the addresses that `name` stands for. The peer is addressed as it is and certified as `name`.
    pub fn channel_to(&self, address: SocketAddr, name: &str) -> Result<Channel, DialError> {
        let dial = self.dial(&address.to_string())?;
        Ok(dial.certified_as(name)?.connect_lazily())
    }

    fn dial(&self, address: &str) -> Result<Dial, DialError> {
        Ok(Dial::to(address, self.credentials.as_ref())?.with(prepared))
    }
}

fn prepared(endpoint: Endpoint) -> Endpoint {
    endpoint
        .connect_timeout(SHORT_DEADLINE)
        .http2_keep_alive_interval(KEEP_ALIVE)
        .keep_alive_timeout(KEEP_ALIVE)
        .tcp_nodelay(true)
}
