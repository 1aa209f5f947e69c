//! Mutual TLS: who a process shows itself to be, and whom it believes.
//!
//! Every certificate comes from the site's own authority. Both sides of every connection show one, and a client's names one
//! person or service and one role ([`certificate`]); without that the handshake fails. TLS 1.3 is the only version. No session is
//! taken up again, so that every connection is judged afresh by the files as they stand ([`credentials`]); these may be
//! replaced at any time.

pub mod certificate;
pub mod credentials;
pub mod dial;
pub(crate) mod incoming;
pub(crate) mod material;
pub(crate) mod verifier;

pub use certificate::Certified;
pub use credentials::{Credentials, Refreshed};
pub use dial::{Dial, DialError};
pub use material::TlsError;

#[cfg(test)]
mod tests;
