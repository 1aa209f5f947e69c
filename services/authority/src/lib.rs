//! Who may command a device, and what has been commanded already.
//!
//! [`Leases`] gives command of one device to one holder at a time and takes it back when the holder falls silent.
//! [`Operations`] remembers each command by the id its caller chose, so that a command sent twice acts once.
//! Both refuse with a [`Refusal`], whose reason word and metadata go to the client as they are.
//!
//! Everything here is pure and synchronous. Time comes in as the [`Duration`](std::time::Duration) since an arbitrary
//! start of the caller's monotonic clock, the same start for every call.

mod lease;
mod operation;
mod refusal;

pub use lease::{HOLDER_MAX_CHARS, Lease, Leases, TTL_MAX, TTL_MIN};
pub use operation::{
    Begin, OPERATION_ID_MAX_BYTES, Operation, OperationState, Operations, Outcome,
    REMEMBERED_OPERATIONS,
};
pub use refusal::Refusal;
