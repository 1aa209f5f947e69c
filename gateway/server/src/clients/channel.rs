//! The one place where the gateway opens connections to the services that it calls.

use std::net::SocketAddr;

use tonic::transport::{Channel, Endpoint, Error};

use super::{KEEP_ALIVE, SHORT_DEADLINE};

/// How connections are opened. They connect when first used, and again after they broke.
#[derive(Clone, Debug, Default)]
pub struct Connector;

impl Connector {
    /// To `host:port`, with or without a scheme. Must be called within a Tokio runtime.
    pub fn channel(&self, address: &str) -> Result<Channel, Error> {
        let uri = if address.contains("://") {
            address.to_owned()
        } else {
            format!("http://{address}")
        };
        Ok(prepared(Endpoint::from_shared(uri)?).connect_lazy())
    }

    /// To one of the addresses that `name` stands for. The peer is addressed, and would be certified, as `name`.
    pub fn channel_to(&self, address: SocketAddr, name: &str) -> Result<Channel, Error> {
        let named = Endpoint::from_shared(format!("http://{name}:{}", address.port()))?;
        let endpoint = Endpoint::from_shared(format!("http://{address}"))?;
        Ok(prepared(endpoint.origin(named.uri().clone())).connect_lazy())
    }
}

fn prepared(endpoint: Endpoint) -> Endpoint {
    endpoint
        .connect_timeout(SHORT_DEADLINE)
        .http2_keep_alive_interval(KEEP_ALIVE)
        .keep_alive_timeout(KEEP_ALIVE)
        .tcp_nodelay(true)
}
