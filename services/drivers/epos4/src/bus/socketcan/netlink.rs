//! What the kernel knows of an interface beyond its frames, by netlink. Each call is one request to the kernel and
//! blocks for that.

use std::io;
use std::time::Duration;

use socketcan::nl::CanState;
use socketcan::{CanInterface, NlError};

use crate::bus::{Address, Error};
use crate::frame::error::{ControllerState, Counters};

/// An interface and its controller. A virtual interface has no controller: its parts are none.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct InterfaceState {
    /// Whether it is up.
    pub up: bool,
    /// The controller's error state.
    pub state: Option<ControllerState>,
    /// Bits a second.
    pub bitrate: Option<u32>,
    /// When the controller is restarted by itself after bus-off; zero: never.
    pub restart_after: Option<Duration>,
    /// The controller's error counters, if its driver tells them.
    pub counters: Option<Counters>,
}

/// Asks for the state of an interface such as `can0`.
pub fn state(interface: &str) -> Result<InterfaceState, Error> {
    let details = CanInterface::open(interface)
        .and_then(|link| link.details())
        .map_err(|error| unreachable(interface, detail(&error)))?;
    Ok(InterfaceState {
        up: details.is_up,
        state: details.can.state.map(|state| match state {
            CanState::ErrorActive => ControllerState::ErrorActive,
            CanState::ErrorWarning => ControllerState::ErrorWarning,
            CanState::ErrorPassive => ControllerState::ErrorPassive,
            CanState::BusOff => ControllerState::BusOff,
            CanState::Stopped => ControllerState::Stopped,
            CanState::Sleeping => ControllerState::Sleeping,
        }),
        bitrate: details.can.bit_timing.map(|timing| timing.bitrate),
        restart_after: details
            .can
            .restart_ms
            .map(|ms| Duration::from_millis(ms.into())),
        counters: details.can.berr_counter.map(|counters| Counters {
            transmit: counters.txerr,
            receive: counters.rxerr,
        }),
    })
}

/// Restarts the controller of an interface after bus-off. Needs the right to administrate the network, and that
/// the controller is bus-off and not restarted by itself.
pub fn restart(interface: &str) -> Result<(), Error> {
    CanInterface::open(interface)
        .and_then(|link| link.restart())
        .map_err(|error| {
            let why = match errno_kind(&error) {
                Some(io::ErrorKind::PermissionDenied) => {
                    "restarting needs CAP_NET_ADMIN".to_owned()
                }
                Some(io::ErrorKind::ResourceBusy) => {
                    "the controller is not bus-off, nothing to restart".to_owned()
                }
                Some(io::ErrorKind::InvalidInput) => {
                    "the interface is down, or restarts by itself (restart-ms)".to_owned()
                }
                _ => detail(&error),
            };
            unreachable(interface, why)
        })
}

fn errno_kind(error: &socketcan::Error) -> Option<io::ErrorKind> {
    match error {
        socketcan::Error::Nl(error) => NlError::io_kind(error),
        socketcan::Error::Io(error) => Some(error.kind()),
        _ => None,
    }
}

fn detail(error: &socketcan::Error) -> String {
    match error {
        socketcan::Error::Io(error) => super::detail(error),
        other => other.to_string(),
    }
}

fn unreachable(interface: &str, detail: String) -> Error {
    Error::Unreachable {
        address: Address::SocketCan {
            interface: interface.to_owned(),
        },
        detail,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_absent_interface_is_told_by_name() {
        for error in [state("nocan9").unwrap_err(), restart("nocan9").unwrap_err()] {
            assert!(
                error
                    .to_string()
                    .contains("socketcan:nocan9: there is no such interface"),
                "{error}"
            );
        }
    }

    #[test]
    fn what_is_no_can_interface_has_no_controller() {
        let loopback = state("lo").unwrap();
        assert_eq!((loopback.up, loopback.state), (true, None));
        assert!(restart("lo").is_err());
    }
}
