//! Where frames go and come from: one small trait, and a connection by address.

pub mod in_process;
#[cfg(target_os = "linux")]
pub mod socketcan;
pub mod socketcand;

use std::fmt;
use std::future::poll_fn;
use std::str::FromStr;
use std::task::{Context, Poll};
use std::time::Duration;

use crate::frame::{Frame, Stamped};

/// A CAN bus as one of its participants sees it: what the others send is received in the order in which it was on the
/// bus, own frames are not.
pub trait CanBus: Send {
    /// Sends a frame, or puts it behind those that wait. Does not wait itself: a queue that is full means that the bus
    /// does not take frames, and is an error.
    fn send(&mut self, frame: Frame) -> Result<(), Error>;

    /// The next frame of the others. An error is final: the connection is gone.
    ///
    /// Also carries what [`CanBus::send`] could not do at once; ask again after sending, for what is answered at once
    /// need not wake anybody.
    fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, Error>>;
}

impl dyn CanBus {
    /// The next frame of the others. Nothing is lost when the future is dropped.
    pub async fn receive(&mut self) -> Result<Stamped, Error> {
        poll_fn(|context| self.poll_receive(context)).await
    }
}

impl Error {
    const SERVER_CLOSED: &str = "the server closed it";
}

/// Why a bus cannot be reached or used.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Error {
    /// The address cannot be read.
    #[error(
        "bus address {address:?}: {problem}; use socketcan:can0 or socketcand://host:port/can0"
    )]
    BadAddress {
        /// As given.
        address: String,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// Nobody there, or no such interface.
    #[error("cannot reach {address}: {detail}")]
    Unreachable {
        /// The bus.
        address: Address,
        /// What the system says.
        detail: String,
    },
    /// The other side does not open the bus as the protocol says.
    #[error("{address} did not open the bus: {detail}")]
    Handshake {
        /// The bus.
        address: Address,
        /// What was answered instead.
        detail: String,
    },
    /// The bus does not take frames: nobody acknowledges them, or the controller is bus-off.
    #[error(
        "the bus takes no frames, {SEND_QUEUE_LEN} wait or one has waited {} ms: nobody acknowledges, or the controller is bus-off",
        SEND_PATIENCE.as_millis()
    )]
    QueueFull,
    /// A report of the controller is no frame of a node.
    #[error("{0:?} is an error frame, which a controller reports and nobody sends")]
    NotSendable(Frame),
    /// The connection broke.
    #[error("the connection to the bus is gone: {0}")]
    Closed(String),
}

/// How many frames wait for the bus at most.
pub const SEND_QUEUE_LEN: usize = 64;
/// How long frames wait for an interface that takes none. Then the bus is given up: a command must not come late.
pub const SEND_PATIENCE: Duration = Duration::from_millis(100);
/// How many received frames wait for the reader at most.
const RECEIVE_QUEUE_LEN: usize = 1024;

/// Where a bus is.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Address {
    /// A CAN interface of this machine.
    SocketCan {
        /// Its name, e.g. `can0`.
        interface: String,
    },
    /// A CAN interface behind a `socketcand` server.
    Socketcand {
        /// Name or IP address.
        host: String,
        /// TCP port; socketcand's own is 29536.
        port: u16,
        /// The interface's name at the server.
        bus: String,
    },
}

impl FromStr for Address {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let bad = |problem| Error::BadAddress {
            address: text.to_owned(),
            problem,
        };
        if let Some(interface) = text.strip_prefix("socketcan:") {
            let interface = interface_name(interface)
                .ok_or_else(|| bad("an interface name of 1 to 15 characters expected"))?;
            return Ok(Self::SocketCan { interface });
        }
        let rest = text
            .strip_prefix("socketcand://")
            .ok_or_else(|| bad("unknown kind of bus"))?;
        let (authority, bus) = rest
            .split_once('/')
            .ok_or_else(|| bad("no bus name after the port"))?;
        let (host, port) = authority.rsplit_once(':').ok_or_else(|| bad("no port"))?;
        let host = host.trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() {
            return Err(bad("no host"));
        }
        let port = port
            .parse()
            .ok()
            .filter(|port| *port != 0)
            .ok_or_else(|| bad("port is not within 1 to 65535"))?;
        let bus =
            interface_name(bus).ok_or_else(|| bad("a bus name of 1 to 15 characters expected"))?;
        Ok(Self::Socketcand {
            host: host.to_owned(),
            port,
            bus,
        })
    }
}

/// What the kernel takes as the name of an interface.
fn interface_name(name: &str) -> Option<String> {
    let fits = (1..=15).contains(&name.len())
        && name
            .bytes()
            .all(|byte| byte.is_ascii_graphic() && !b"/<>".contains(&byte));
    fits.then(|| name.to_owned())
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SocketCan { interface } => write!(f, "socketcan:{interface}"),
            Self::Socketcand { host, port, bus } if host.contains(':') => {
                write!(f, "socketcand://[{host}]:{port}/{bus}")
            }
            Self::Socketcand { host, port, bus } => write!(f, "socketcand://{host}:{port}/{bus}"),
        }
    }
}

/// Connects to the bus at an address such as `socketcan:can0` or `socketcand://127.0.0.1:29536/can0`.
pub async fn connect(address: &str) -> Result<Box<dyn CanBus>, Error> {
    match address.parse()? {
        #[cfg(target_os = "linux")]
        Address::SocketCan { interface } => Ok(Box::new(socketcan::open(&interface)?)),
        #[cfg(not(target_os = "linux"))]
        address @ Address::SocketCan { .. } => Err(Error::Unreachable {
            address,
            detail: "socketcan exists on linux alone".to_owned(),
        }),
        Address::Socketcand { host, port, bus } => {
            Ok(Box::new(socketcand::open(&host, port, &bus).await?))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_survive_being_written() {
        for text in [
            "socketcan:can0",
            "socketcand://127.0.0.1:29536/can0",
            "socketcand://[::1]:1/vcan1",
        ] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn a_bad_address_is_named_with_its_problem() {
        for (text, problem) in [
            ("can0", "unknown kind of bus"),
            ("socketcan:", "interface name"),
            ("socketcan:a-name-that-is-too-long", "interface name"),
            ("socketcand://localhost/can0", "no port"),
            ("socketcand://localhost:29536", "no bus name"),
            ("socketcand://localhost:99999/can0", "1 to 65535"),
            ("socketcand://localhost:29536/a >< b", "bus name"),
            ("socketcand://:29536/can0", "no host"),
        ] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains(problem) && error.contains(text), "{error}");
        }
    }
}
