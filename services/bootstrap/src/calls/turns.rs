//! Turns at the processors.
//!
//! Whatever is ready to run waits in one queue, first come, first served, and a stop is put at its end like everything else.
//! So the queue is kept short: a call that is ready waits for a turn outside of it, and has the turn from its handler's first
//! step until its answer is written. Whoever waits for something else than the processor gives the turn back, so that slow
//! work does not keep others waiting.

use std::num::NonZero;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// For each processor: one that runs, and enough others that none idles while answers and next requests are on their way.
const TURNS_A_PROCESSOR: usize = 4;
/// Clients that do not read their answers could keep all turns. After this time a call goes on without one.
const PATIENCE: Duration = Duration::from_millis(50);

/// The turns of one server.
#[derive(Clone, Debug)]
pub(super) struct Turns(Arc<Semaphore>);

/// A turn, given back when it is dropped.
#[derive(Debug)]
pub(super) struct Turn(
    #[expect(dead_code, reason = "held, not read")] Option<OwnedSemaphorePermit>,
);

impl Turns {
    /// So many at the same time; 0 for so many as suit the machine.
    pub(super) fn new(at_the_same_time: usize) -> Self {
        let processors = std::thread::available_parallelism().map_or(1, NonZero::get);
        let turns = match at_the_same_time {
            0 => TURNS_A_PROCESSOR * processors,
            given => given.min(Semaphore::MAX_PERMITS),
        };
        Self(Arc::new(Semaphore::new(turns)))
    }

    /// The next turn, in the order of asking.
    pub(super) async fn take(&self) -> Turn {
        if let Ok(turn) = self.0.clone().try_acquire_owned() {
            return Turn(Some(turn));
        }
        match tokio::time::timeout(PATIENCE, self.0.clone().acquire_owned()).await {
            Ok(Ok(turn)) => Turn(Some(turn)),
            Ok(Err(_)) | Err(_) => Turn::NOT_NEEDED,
        }
    }
}

impl Turn {
    /// Of a call that goes on without one.
    pub(super) const NOT_NEEDED: Self = Self(None);
}
