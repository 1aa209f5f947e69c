//! The audit: every command, decision, refusal, alarm and approval, with who, when and about what, in a chain that cannot be
//! changed without being found out.
//!
//! Each entry carries the hash of the one before, and a signature of its own ([`entry`], [`key`]). One task writes them in
//! their order ([`keeper`]) and keeps each end of the chain in a second file ([`heads`]), so that a cut is found too. The
//! gateway's calls are seen by one layer ([`layer`]), procedures by a witness ([`witness`]), and calls that the server
//! refuses before they come here by their reports ([`refusals`]). [`verify`] says whether a chain is whole.

mod body;
pub mod entry;
pub mod heads;
pub mod keeper;
pub mod key;
pub mod layer;
pub mod lines;
pub mod read;
pub mod refusals;
pub mod subject;
pub mod verify;
pub mod witness;

pub use entry::{Entry, Kind, Link, Who};
pub use keeper::{Audit, AuditFailed, Options};
pub use layer::AuditLayer;
