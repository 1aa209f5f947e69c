//! Serves a [`Bus`] as `can0` by linux-can's `socketcand` protocol. Frames carry the cell's time as their stamp.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use epos4_link::bus::CanBus;
use epos4_link::bus::socketcand::server::{self, Buses, Gone};

pub use epos4_link::bus::socketcand::server::Server;

use super::bus::Bus;

/// The name of the bus, as real machines name their first interface.
pub const BUS_NAME: &str = "can0";

/// Listens at `bind` and serves the bus.
pub async fn serve(bind: SocketAddr, bus: Arc<Bus>) -> io::Result<Server> {
    server::serve(bind, Cell(bus)).await
}

struct Cell(Arc<Bus>);

impl Buses for Cell {
    fn knows(&self, bus: &str) -> bool {
        bus == BUS_NAME
    }

    fn attach(&self, bus: &str) -> Option<Box<dyn CanBus>> {
        self.knows(bus)
            .then(|| Box::new(self.0.join()) as Box<dyn CanBus>)
    }

    fn on_gone(&self, client: SocketAddr, why: &Gone) {
        match why {
            Gone::Left => tracing::debug!(%client, "can client left"),
            Gone::TooMany | Gone::Dropped(_) => tracing::warn!(%client, %why, "can client dropped"),
        }
    }
}

#[cfg(test)]
mod tests;
