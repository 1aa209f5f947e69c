//! Ending a computation from outside: at once, or with what it has so far.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::Error;

/// Two flags that the owner of a computation raises and the computation looks at every few milliseconds.
#[derive(Clone, Debug, Default)]
pub struct Budget(Arc<Flags>);

#[derive(Debug, Default)]
struct Flags {
    is_cancelled: AtomicBool,
    is_hurried: AtomicBool,
}

impl Budget {
    /// Nobody waits for the answer any more.
    pub fn cancel(&self) {
        self.0.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Time is nearly up: what was found so far shall be finished and answered.
    pub fn hurry(&self) {
        self.0.is_hurried.store(true, Ordering::Relaxed);
    }

    /// Whether nobody waits any more.
    pub fn is_cancelled(&self) -> bool {
        self.0.is_cancelled.load(Ordering::Relaxed)
    }

    /// Whether time is nearly up.
    pub fn is_hurried(&self) -> bool {
        self.0.is_hurried.load(Ordering::Relaxed)
    }

    /// `Err(Error::Cancelled)` once nobody waits any more.
    pub fn check(&self) -> Result<(), Error> {
        if self.is_cancelled() {
            return Err(Error::Cancelled);
        }
        Ok(())
    }
}
