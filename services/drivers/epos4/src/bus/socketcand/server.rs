//! Serves buses by linux-can's `socketcand` protocol in raw mode to many clients at once.
//!
//! Clients compare a whole segment with `< ok >`, so each answer of the handshake goes out alone and frames are held
//! back for a moment after the last one. Each client is a participant of the bus of its own and is served by one task:
//! what it sends, what the bus answers at once and the writing of that are one step. A client that does not read is put
//! off, and nobody waits for it.

mod client;

use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use tokio::net::TcpListener;
use tokio::task::{AbortHandle, JoinSet};

use crate::bus::{CanBus, in_process};

/// The buses of a server.
pub trait Buses: Send + Sync + 'static {
    /// Whether there is a bus of this name, e.g. `can0`.
    fn knows(&self, bus: &str) -> bool;

    /// A new participant of a bus; none when there is no such bus, or not any more.
    fn attach(&self, bus: &str) -> Option<Box<dyn CanBus>>;

    /// A client is gone, or was not let in. For a log.
    fn on_gone(&self, _client: SocketAddr, _why: &Gone) {}
}

/// Why a client is gone.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Gone {
    /// It closed the connection.
    Left,
    /// It was not let in: [`CLIENTS_MAX`] are there.
    TooMany,
    /// It was put off, or the connection broke.
    Dropped(String),
}

/// Real masters on one bus are few.
pub const CLIENTS_MAX: usize = 64;

/// A running server. Ends with all its connections when dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    clients: AbortHandle,
}

/// Listens at `bind` and serves the buses.
pub async fn serve(bind: SocketAddr, buses: impl Buses) -> io::Result<Server> {
    let listener = TcpListener::bind(bind).await?;
    let address = listener.local_addr()?;
    let clients = tokio::spawn(accept(listener, Arc::new(buses))).abort_handle();
    Ok(Server { address, clients })
}

impl Server {
    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.clients.abort();
    }
}

impl fmt::Display for Gone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Left => f.write_str("it left"),
            Self::TooMany => write!(f, "{CLIENTS_MAX} clients are there already"),
            Self::Dropped(why) => f.write_str(why),
        }
    }
}

/// Buses within the process, by their names.
impl Buses for BTreeMap<String, in_process::Bus> {
    fn knows(&self, bus: &str) -> bool {
        self.contains_key(bus)
    }

    fn attach(&self, bus: &str) -> Option<Box<dyn CanBus>> {
        Some(Box::new(self.get(bus)?.attach()))
    }
}

async fn accept(listener: TcpListener, buses: Arc<impl Buses>) {
    let mut clients = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            Some(_) = clients.join_next() => continue,
        };
        match accepted {
            Ok((_, peer)) if clients.len() >= CLIENTS_MAX => buses.on_gone(peer, &Gone::TooMany),
            Ok((stream, peer)) => {
                let buses = Arc::clone(&buses);
                clients.spawn(async move {
                    let why = match client::serve(stream, &*buses).await {
                        Ok(()) => Gone::Left,
                        Err(error) => Gone::Dropped(error.to_string()),
                    };
                    buses.on_gone(peer, &why);
                });
            }
            // The client went while it waited, or the process is out of descriptors: those who are there go on.
            Err(_) => tokio::time::sleep(client::HOLD_BACK).await,
        }
    }
}

#[cfg(test)]
mod tests;
