//! The way to the bus: how it is connected, and how its controller is brought back after bus-off.

use std::pin::Pin;

use epos4_link::bus::{self, Address, CanBus};

/// A bus, once it is connected.
pub(crate) type Connected = Result<Box<dyn CanBus>, bus::Error>;

/// The way to a bus.
pub(crate) trait Way: Send {
    /// Connects.
    fn connect(&self) -> Pin<Box<dyn Future<Output = Connected> + Send>>;

    /// Brings the controller back onto the bus, where it has left it and does not come back by itself. A bus behind a
    /// server is the server's.
    fn restart(&self) -> Result<(), bus::Error>;
}

/// By the address of the configuration.
pub(crate) struct ByAddress(pub(crate) Address);

impl Way for ByAddress {
    fn connect(&self) -> Pin<Box<dyn Future<Output = Connected> + Send>> {
        let address = self.0.to_string();
        Box::pin(async move { bus::connect(&address).await })
    }

    #[cfg(target_os = "linux")]
    fn restart(&self) -> Result<(), bus::Error> {
        use epos4_link::bus::socketcan::netlink;
        use epos4_link::frame::error::ControllerState;
        match &self.0 {
            Address::SocketCan { interface }
                if netlink::state(interface)?.state == Some(ControllerState::BusOff) =>
            {
                netlink::restart(interface)
            }
            _ => Ok(()),
        }
    }

    #[cfg(not(target_os = "linux"))]
    fn restart(&self) -> Result<(), bus::Error> {
        Ok(())
    }
}
