//! Every way in which command of a device, or a command, is refused.

use std::time::Duration;

use thiserror::Error;

use crate::lease::{HOLDER_MAX_CHARS, TTL_MAX, TTL_MIN};
use crate::operation::OPERATION_ID_MAX_BYTES;

/// Why a lease or an operation was refused. [`Refusal::field`] tells bad input from a refusal by state.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Refusal {
    /// Somebody else commands the device.
    #[error("the lease is held by {holder:?} for another {:.3} s unless renewed", .remaining.as_secs_f64())]
    LeaseHeld {
        /// Who holds it, as named at acquisition.
        holder: String,
        /// Time until it runs out.
        remaining: Duration,
    },
    /// The token belongs to no lease in force: nobody acquired one, or it was released, or it was never granted.
    #[error("fencing token {token} belongs to no lease in force")]
    NoLease {
        /// The token given.
        token: u64,
    },
    /// A newer lease has been granted since.
    #[error("fencing token {token} is stale, the newest is {newest}")]
    StaleFencingToken {
        /// The token given.
        token: u64,
        /// The newest token ever granted.
        newest: u64,
    },
    /// The lease was not renewed in time.
    #[error(
        "the lease of {holder:?} with fencing token {token} expired {:.3} s ago, its time to live was {:.3} s",
        .ago.as_secs_f64(),
        .ttl.as_secs_f64()
    )]
    LeaseExpired {
        /// The token given.
        token: u64,
        /// Who held it.
        holder: String,
        /// Its time to live.
        ttl: Duration,
        /// How long ago it ran out.
        ago: Duration,
    },
    /// The holder's name is empty or too long.
    #[error("holder has {chars} characters, allowed are 1 to {HOLDER_MAX_CHARS}")]
    HolderName {
        /// The length given.
        chars: usize,
    },
    /// The time to live is outside its limits.
    #[error("ttl {} s is outside {} to {} s", .ttl.as_secs_f64(), TTL_MIN.as_secs_f64(), TTL_MAX.as_secs_f64())]
    Ttl {
        /// The time to live given.
        ttl: Duration,
    },
    /// The operation id is empty or too long.
    #[error("operation id has {bytes} bytes, allowed are 1 to {OPERATION_ID_MAX_BYTES}")]
    OperationId {
        /// The length given.
        bytes: usize,
    },
    /// The id was given before, to a different command.
    #[error("operation id {id:?} was given before, to a different command")]
    OperationIdReused {
        /// The id given.
        id: String,
    },
    /// As many operations run as can be remembered.
    #[error("{running} operations are running, no more than {limit} are remembered")]
    TooManyOperations {
        /// How many run.
        running: usize,
        /// How many are remembered.
        limit: usize,
    },
}

impl Refusal {
    /// The stable word for clients to act on.
    #[must_use]
    pub fn reason(&self) -> &'static str {
        match self {
            Self::LeaseHeld { .. } => "LEASE_HELD",
            Self::NoLease { .. } => "NO_LEASE",
            Self::StaleFencingToken { .. } => "STALE_FENCING_TOKEN",
            Self::LeaseExpired { .. } => "LEASE_EXPIRED",
            Self::HolderName { .. } => "INVALID_HOLDER",
            Self::Ttl { .. } => "INVALID_TTL",
            Self::OperationId { .. } => "INVALID_OPERATION_ID",
            Self::OperationIdReused { .. } => "OPERATION_ID_REUSED",
            Self::TooManyOperations { .. } => "TOO_MANY_OPERATIONS",
        }
    }

    /// The request field at fault (`holder`, `ttl_s`, `operation_id`) if the input itself is bad, none if the state
    /// refuses.
    #[must_use]
    pub fn field(&self) -> Option<&'static str> {
        match self {
            Self::HolderName { .. } => Some("holder"),
            Self::Ttl { .. } => Some("ttl_s"),
            Self::OperationId { .. } => Some("operation_id"),
            _ => None,
        }
    }

    /// The facts of the refusal, for programs to read. Times in s.
    #[must_use]
    pub fn metadata(&self) -> Vec<(&'static str, String)> {
        match self {
            Self::LeaseHeld { holder, remaining } => {
                vec![
                    ("holder", holder.clone()),
                    ("remaining_s", remaining.as_secs_f64().to_string()),
                ]
            }
            Self::NoLease { token } => vec![("fencing_token", token.to_string())],
            Self::StaleFencingToken { token, newest } => {
                vec![
                    ("fencing_token", token.to_string()),
                    ("newest_fencing_token", newest.to_string()),
                ]
            }
            Self::LeaseExpired {
                token,
                holder,
                ttl,
                ago,
            } => vec![
                ("fencing_token", token.to_string()),
                ("holder", holder.clone()),
                ("ttl_s", ttl.as_secs_f64().to_string()),
                ("expired_s_ago", ago.as_secs_f64().to_string()),
            ],
            Self::HolderName { chars } => vec![("chars", chars.to_string())],
            Self::Ttl { ttl } => vec![("ttl_s", ttl.as_secs_f64().to_string())],
            Self::OperationId { bytes } => vec![("bytes", bytes.to_string())],
            Self::OperationIdReused { id } => vec![("operation_id", id.clone())],
            Self::TooManyOperations { running, limit } => {
                vec![
                    ("running", running.to_string()),
                    ("limit", limit.to_string()),
                ]
            }
        }
    }
}
