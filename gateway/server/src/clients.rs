//! The four services that the gateway calls, and what it makes of their refusals. Registration and planning may have
//! several replicas ([`replicas`]); motion and instrument are one a cell.
//!
//! A refusal of a service goes on to the gateway's client as it came, code and details included. A
//! service that cannot be reached is UNAVAILABLE with the reason `<SERVICE>_UNAVAILABLE`.

pub mod channel;
pub mod instrument;
pub mod motion;
pub mod planning;
pub mod registration;
pub mod replicas;

use std::error::Error as _;
use std::time::Duration;

use arthro_bootstrap::status;
use arthro_bootstrap::tls::DialError;
use arthro_proto::common::v1 as common;
use bytes::Bytes;
use tonic::{Code, Request, Response, Status, Streaming};

use crate::clients::channel::Connector;
use crate::clients::replicas::Replicas;
use crate::clients::replicas::addresses::Where;
use crate::words::words;

pub use instrument::Instrument;
pub use motion::Motion;
pub use planning::Planning;
pub use registration::Registration;

/// Streams carry their bytes in pieces of this size.
const CHUNK_BYTES: usize = 256 * 1024;
/// A call that only asks or grants is answered within this time or not at all.
const SHORT_DEADLINE: Duration = Duration::from_secs(5);
/// A stop is confirmed within this time or not at all.
const STOP_DEADLINE: Duration = Duration::from_secs(2);
/// No single motion of an arm or axis takes longer.
const MOTION_DEADLINE: Duration = Duration::from_secs(600);
/// No registration or planning takes longer.
const COMPUTATION_DEADLINE: Duration = Duration::from_secs(600);
/// A silent peer is asked for a sign of life this often, and given up when it gives none for as long.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// What a device service says to a command that a stop overtook: the motion service, and the instrument service.
const STOP_REFUSALS: [&str; 2] = ["STOPPED", "STOP_UNDER_WAY"];

/// All four.
#[derive(Clone, Debug)]
pub struct Clients {
    /// Where the model lies in the view.
    pub registration: Registration,
    /// Which bites to take.
    pub planning: Planning,
    /// The two arms.
    pub motion: Motion,
    /// The four axes of the instruments.
    pub instrument: Instrument,
}

words! {
    /// Which service.
    Peer {
        /// The registration service.
        Registration = "REGISTRATION",
        /// The planning service.
        Planning = "PLANNING",
        /// The motion service.
        Motion = "MOTION",
        /// The instrument service.
        Instrument = "INSTRUMENT",
    }
}

/// Whether a command that failed may have acted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Acted {
    /// The service refused it before it began.
    No,
    /// It began and ended otherwise, or nobody knows.
    Perhaps,
}

/// A fault that a device keeps until somebody acknowledges it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fault {
    /// The device service's word.
    pub reason: String,
    /// With value and limit.
    pub detail: String,
}

/// A call that did not end as asked.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{peer}: {}", status.message())]
pub struct Failure {
    peer: Peer,
    reason: String,
    acted: Acted,
    /// Whether a stop ended the operation, or came before it.
    stopped: bool,
    status: Box<Status>,
}

impl Clients {
    /// Clients that connect when first used. Must be called within a Tokio runtime.
    pub fn new(
        connector: &Connector,
        registration: Where,
        planning: Where,
        motion: &str,
        instrument: &str,
    ) -> Result<Self, DialError> {
        let replicas = |peer, place| Replicas::new(peer, place, connector.clone());
        Ok(Self {
            registration: Registration::new(replicas(Peer::Registration, registration)?),
            planning: Planning::new(replicas(Peer::Planning, planning)?),
            motion: Motion::new(connector.channel(motion)?),
            instrument: Instrument::new(connector.channel(instrument)?),
        })
    }

    /// Stops both arms and all drives, all at once; fails if either service does not confirm.
    pub async fn stop_everything(&self, reason: &str) -> Result<(), Failure> {
        let (arms, drives) = tokio::join!(self.motion.stop(reason), self.instrument.stop(reason));
        arms.and(drives)
    }
}

// === impl Fault ===

impl Fault {
    /// None when the service names none.
    fn of(reason: &str, detail: &str) -> Option<Self> {
        (!reason.is_empty()).then(|| Self {
            reason: reason.to_owned(),
            detail: detail.to_owned(),
        })
    }
}

// === impl Failure ===

impl Failure {
    /// The first answer to a call was an error.
    fn answered(peer: Peer, status: Status) -> Self {
        let acted = match status.code() {
            Code::FailedPrecondition
            | Code::InvalidArgument
            | Code::NotFound
            | Code::PermissionDenied
            | Code::ResourceExhausted
            | Code::Unauthenticated
            | Code::Unimplemented => Acted::No,
            _ => Acted::Perhaps,
        };
        Self::new(peer, status, acted)
    }

    /// The stream broke after its first message.
    fn broken(peer: Peer, status: Status) -> Self {
        Self::new(peer, status, Acted::Perhaps)
    }

    fn new(peer: Peer, status: Status, acted: Acted) -> Self {
        // A status that was made here and not sent by the peer has the transport's error as its source.
        let unreachable = status.source().is_some()
            || (status.code() == Code::Unavailable && status::reason(&status).is_none());
        if unreachable {
            let reason = format!("{peer}_UNAVAILABLE");
            let status = status::unavailable(
                &reason,
                format!("the service cannot be reached: {}", status.message()),
                &[("service", peer.as_str().to_lowercase())],
            );
            return Self {
                peer,
                reason,
                acted,
                stopped: false,
                status: Box::new(status),
            };
        }
        let reason = status::reason(&status)
            .unwrap_or_else(|| format!("{peer}_{}", code_word(status.code())));
        // The peer's headers are not ours to repeat.
        let status = Status::with_details(
            status.code(),
            status.message(),
            Bytes::copy_from_slice(status.details()),
        );
        Self {
            peer,
            stopped: STOP_REFUSALS.contains(&reason.as_str()),
            reason,
            acted,
            status: Box::new(status),
        }
    }

    /// An answer that cannot be used.
    fn unusable(peer: Peer, what: &str) -> Self {
        let reason = format!("{peer}_ANSWER_UNUSABLE");
        Self {
            peer,
            status: Box::new(status::with_reason(
                Code::Internal,
                &reason,
                format!("the answer cannot be used: {what}"),
                &[],
            )),
            reason,
            acted: Acted::Perhaps,
            stopped: false,
        }
    }

    /// The operation ended FAILED or STOPPED.
    fn ended(peer: Peer, operation: common::Operation) -> Self {
        let stopped = operation.state() == common::OperationState::Stopped;
        let reason = if operation.reason.is_empty() {
            operation
                .state()
                .as_str_name()
                .replace("OPERATION_STATE_", "")
        } else {
            operation.reason
        };
        Self {
            peer,
            status: Box::new(status::aborted(
                &reason,
                operation.detail,
                &[("operation_id", operation.operation_id)],
            )),
            reason,
            acted: Acted::Perhaps,
            stopped,
        }
    }

    /// No answer for as long as a lease lives.
    pub fn silent(peer: Peer, for_as_long_as: Duration) -> Self {
        let reason = "LEASE_LOST";
        Self {
            peer,
            status: Box::new(status::unavailable(
                reason,
                format!(
                    "no renewal was answered for {} s",
                    for_as_long_as.as_secs_f64()
                ),
                &[],
            )),
            reason: reason.to_owned(),
            acted: Acted::Perhaps,
            stopped: false,
        }
    }

    /// Whether a stop ended the operation, or came before it began.
    pub fn was_stopped(&self) -> bool {
        self.stopped
    }

    /// Whether the service could not be reached, so that asking again may help.
    pub fn is_unavailable(&self) -> bool {
        self.status.code() == Code::Unavailable
    }

    /// Whether the service has no room for the call, so that another replica may have.
    pub fn is_exhausted(&self) -> bool {
        self.status.code() == Code::ResourceExhausted
    }

    /// The stable word.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// The same failure of a call that commands nothing.
    pub fn before_acting(self) -> Self {
        Self {
            acted: Acted::No,
            ..self
        }
    }

    /// The same failure with fields that begin with `prefix` named without it: what the service calls `options.x` is `x`
    /// in the request that the gateway was sent.
    pub fn without_prefix(self, prefix: &str) -> Self {
        let violations = status::violations(&self.status);
        if violations.is_empty() {
            return self;
        }
        let renamed = violations.into_iter().map(|(field, description)| {
            let field = field.strip_prefix(prefix).unwrap_or(&field).to_owned();
            (field, description)
        });
        Self {
            status: Box::new(status::invalid_all(renamed.collect())),
            ..self
        }
    }

    /// Whether the command may have acted.
    pub fn acted(&self) -> Acted {
        self.acted
    }

    /// The status that goes on to the client.
    pub fn into_status(self) -> Status {
        *self.status
    }
}

/// The answer to one call.
async fn ask<M>(
    peer: Peer,
    call: impl Future<Output = Result<Response<M>, Status>>,
) -> Result<M, Failure> {
    call.await
        .map(Response::into_inner)
        .map_err(|status| Failure::answered(peer, status))
}

/// The first message of a stream.
async fn first<M>(
    peer: Peer,
    call: impl Future<Output = Result<Response<Streaming<M>>, Status>>,
) -> Result<M, Failure> {
    ask(peer, call)
        .await?
        .message()
        .await
        .map_err(|status| Failure::answered(peer, status))?
        .ok_or_else(|| Failure::unusable(peer, "the stream is empty"))
}

/// Follows a command until its operation has ended as commanded; answers the last message.
async fn follow<M>(
    peer: Peer,
    call: impl Future<Output = Result<Response<Streaming<M>>, Status>>,
    mut operation_of: impl FnMut(&M) -> Option<common::Operation>,
) -> Result<M, Failure> {
    let mut messages = ask(peer, call).await?;
    let mut failed: fn(Peer, Status) -> Failure = Failure::answered;
    while let Some(message) = messages
        .message()
        .await
        .map_err(|status| failed(peer, status))?
    {
        failed = Failure::broken;
        let operation = operation_of(&message)
            .ok_or_else(|| Failure::unusable(peer, "a message without an operation"))?;
        match operation.state() {
            common::OperationState::Running | common::OperationState::Unspecified => {}
            common::OperationState::Done => return Ok(message),
            common::OperationState::Failed
            | common::OperationState::Stopped
            | common::OperationState::InDoubt => {
                return Err(Failure::ended(peer, operation));
            }
        }
    }
    Err(Failure::unusable(
        peer,
        "the stream ended before its operation",
    ))
}

/// A request that ends by itself.
fn within<T>(deadline: Duration, message: T) -> Request<T> {
    let mut request = Request::new(message);
    request.set_timeout(deadline);
    request
}

/// Cuts packed bytes into chunks without copying them.
fn chunks(mut bytes: Bytes) -> impl Iterator<Item = Bytes> {
    std::iter::from_fn(move || {
        (!bytes.is_empty()).then(|| bytes.split_to(bytes.len().min(CHUNK_BYTES)))
    })
}

fn code_word(code: Code) -> &'static str {
    match code {
        Code::Ok => "OK",
        Code::Cancelled => "CANCELLED",
        Code::Unknown => "UNKNOWN",
        Code::InvalidArgument => "INVALID_ARGUMENT",
        Code::DeadlineExceeded => "DEADLINE_EXCEEDED",
        Code::NotFound => "NOT_FOUND",
        Code::AlreadyExists => "ALREADY_EXISTS",
        Code::PermissionDenied => "PERMISSION_DENIED",
        Code::ResourceExhausted => "RESOURCE_EXHAUSTED",
        Code::FailedPrecondition => "FAILED_PRECONDITION",
        Code::Aborted => "ABORTED",
        Code::OutOfRange => "OUT_OF_RANGE",
        Code::Unimplemented => "UNIMPLEMENTED",
        Code::Internal => "INTERNAL",
        Code::Unavailable => "UNAVAILABLE",
        Code::DataLoss => "DATA_LOSS",
        Code::Unauthenticated => "UNAUTHENTICATED",
    }
}
