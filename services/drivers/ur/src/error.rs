//! What can go wrong between this process and a controller.

use std::{net::SocketAddr, time::Duration};

use tokio::{
    net::{TcpSocket, TcpStream, lookup_host},
    time::Instant,
};

use crate::{
    RobotMode, SafetyMode, primary,
    rtde::{ControllerVersion, Since, wire},
    script::Exception,
};

/// Errors of the link.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No connection to one of the services.
    #[error("cannot connect to {service} at {address}")]
    Connect {
        /// "dashboard", "rtde" or "script".
        service: &'static str,
        /// host:port.
        address: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A connection broke.
    #[error("{service} connection failed")]
    Io {
        /// "dashboard", "rtde" or "script".
        service: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The controller closed a connection.
    #[error("{service} connection closed by the controller")]
    Closed {
        /// "dashboard", "rtde" or "script".
        service: &'static str,
    },
    /// Something did not come in time.
    #[error("no {what} within {limit:?}")]
    Timeout {
        /// What was waited for.
        what: &'static str,
        /// How long.
        limit: Duration,
    },
    /// Bytes that are not the protocol.
    #[error("rtde protocol violated")]
    Wire(#[from] wire::Error),
    /// Bytes that are not the protocol of the primary interface.
    #[error("protocol of the primary interface violated")]
    Primary(#[source] primary::wire::Error),
    /// A packet of the realtime interface that no software since 3.0 sends.
    #[error(
        "packet of the realtime interface has size {size}; software since 3.0 sends 1044 to 4092"
    )]
    RealtimeSize {
        /// As the size field says.
        size: i32,
    },
    /// A text that is no program.
    #[error("the program {0}")]
    Script(&'static str),
    /// A program that the controller does not run.
    #[error("program {name} failed at {exception}")]
    Program {
        /// Its name.
        name: String,
        /// Where and why.
        exception: Exception,
    },
    /// A protective stop was to be unlocked within five seconds of its occurrence.
    #[error("a protective stop is unlocked 5 s after it happened at the earliest: {answer}")]
    UnlockTooEarly {
        /// What the controller answered.
        answer: String,
    },
    /// The controller said no.
    #[error("{request} refused: {answer}")]
    Refused {
        /// What was asked.
        request: String,
        /// What it answered.
        answer: String,
    },
    /// A recipe field is missing, taken or of another type.
    #[error("rtde field {name} is {answer}, wanted {wanted}")]
    Field {
        /// Name of the field.
        name: String,
        /// Type or refusal as the controller gave it.
        answer: wire::Type,
        /// Type this client needs.
        wanted: wire::Type,
    },
    /// The controller's software does not have a recipe field yet.
    #[error("rtde field {name} came with {since}; the controller has {found}")]
    FieldSince {
        /// Name of the field.
        name: String,
        /// First software that has it.
        since: Since,
        /// Software of the controller.
        found: ControllerVersion,
    },
    /// The controller's software is too old for something.
    #[error("{what} needs controller software {needs}, found {found}")]
    TooOld {
        /// What.
        what: &'static str,
        /// Software of the controller.
        found: ControllerVersion,
        /// First that would do.
        needs: &'static str,
    },
    /// Another client holds the inputs: somebody else commands this arm.
    #[error("rtde input {name} is in use by another client, which commands this arm")]
    InUse {
        /// Name of the input.
        name: String,
    },
    /// The pendant has not handed over control.
    #[error("the controller is in local control; switch it to remote control at the pendant")]
    LocalControl,
    /// Not the robot that was meant.
    #[error("the robot is {found}, wanted is {wanted}")]
    WrongRobot {
        /// What it says it is.
        found: String,
        /// [`Options::expected`](crate::Options::expected).
        wanted: String,
    },
    /// The arm is in no state to run a program.
    #[error("arm is not ready: robot mode {robot_mode}, safety mode {safety_mode}")]
    NotReady {
        /// Power and brakes.
        robot_mode: RobotMode,
        /// Safety system.
        safety_mode: SafetyMode,
    },
    /// A value that must not go to a robot.
    #[error("{field} is {value}, allowed is {limit}")]
    Value {
        /// Field of the command or option.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        limit: &'static str,
    },
}

/// Opens one of the controller's services.
pub(crate) async fn connect(
    service: &'static str,
    host: &str,
    port: u16,
    limit: Duration,
) -> Result<TcpStream, Error> {
    within(service, host, port, limit, TcpStream::connect((host, port))).await
}

/// As [`connect`], and lets the system keep no more than so many bytes that were not read.
pub(crate) async fn connect_with_buffer(
    service: &'static str,
    host: &str,
    port: u16,
    limit: Duration,
    receive_buffer_bytes: u32,
) -> Result<TcpStream, Error> {
    let attempt = async {
        let mut last = std::io::Error::from(std::io::ErrorKind::AddrNotAvailable);
        for address in lookup_host((host, port)).await? {
            let socket = match address {
                SocketAddr::V4(_) => TcpSocket::new_v4()?,
                SocketAddr::V6(_) => TcpSocket::new_v6()?,
            };
            socket.set_recv_buffer_size(receive_buffer_bytes)?;
            match socket.connect(address).await {
                Ok(stream) => return Ok(stream),
                Err(error) => last = error,
            }
        }
        Err(last)
    };
    within(service, host, port, limit, attempt).await
}

/// When so much time will be over; a time that clocks cannot tell is a year.
pub(crate) fn deadline(limit: Duration) -> Instant {
    let now = Instant::now();
    now.checked_add(limit)
        .unwrap_or_else(|| now + Duration::from_secs(365 * 24 * 3600))
}

async fn within(
    service: &'static str,
    host: &str,
    port: u16,
    limit: Duration,
    attempt: impl Future<Output = std::io::Result<TcpStream>>,
) -> Result<TcpStream, Error> {
    let stream = tokio::time::timeout(limit, attempt)
        .await
        .map_err(|_| Error::Timeout {
            what: "connection",
            limit,
        })?
        .map_err(|source| Error::Connect {
            service,
            address: format!("{host}:{port}"),
            source,
        })?;
    stream
        .set_nodelay(true)
        .map_err(|source| Error::Io { service, source })?;
    Ok(stream)
}
