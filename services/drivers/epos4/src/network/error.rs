//! Why what was asked of a node did not succeed.

use std::time::Duration;

use crate::canopen::nmt;
use crate::canopen::object::Address;
use crate::canopen::sdo::AbortCode;
use crate::canopen::sdo::client::Failure;

use super::LANE_LEN;

/// Why a request to a node did not succeed.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Error {
    /// The node does not answer.
    #[error("node {node_id} did not answer the request for {address} within {} s", .timeout.as_secs_f64())]
    NoAnswer {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
        /// How long it was waited for.
        timeout: Duration,
    },
    /// The node refused, or broke the protocol.
    #[error("node {node_id}, object {address}: {failure}")]
    Failed {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
        /// How.
        failure: Failure,
    },
    /// The object has another size than its type.
    #[error("node {node_id}, object {address} has {len} bytes, {expected} expected")]
    Size {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
        /// What came.
        len: usize,
        /// What the type has.
        expected: usize,
    },
    /// The node confirmed a value and has another one all the same.
    #[error("node {node_id}, object {address} is {found:02X?} after {wrote:02X?} was written")]
    ReadBack {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
        /// Little-endian.
        wrote: Vec<u8>,
        /// Little-endian.
        found: Vec<u8>,
    },
    /// The node started anew and knows nothing of the request.
    #[error("node {node_id} restarted before it answered the request for {address}")]
    Restarted {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
    },
    /// The node's heartbeat did not tell the state that was ordered.
    #[error("node {node_id} is {} and not {wanted} {} s after the order", heard_text(.heard), .timeout.as_secs_f64())]
    NotInState {
        /// Which node.
        node_id: u8,
        /// What was ordered.
        wanted: nmt::State,
        /// What its newest heartbeat since the order says.
        heard: Option<nmt::State>,
        /// How long it was waited for.
        timeout: Duration,
    },
    /// Too many requests wait for the node.
    #[error("{LANE_LEN} requests wait for node {node_id} already")]
    Busy {
        /// Which node.
        node_id: u8,
    },
    /// The network is gone.
    #[error("the can network is gone")]
    Gone,
}

fn heard_text(heard: &Option<nmt::State>) -> String {
    heard.map_or_else(|| "silent".to_owned(), |state| state.to_string())
}

impl Error {
    /// The node's abort code, when it refused.
    pub fn abort_code(&self) -> Option<AbortCode> {
        match self {
            Self::Failed {
                failure: Failure::Aborted(code),
                ..
            } => Some(*code),
            _ => None,
        }
    }
}
