//! Command of the cell: the lease that covers both arms, and the operations that it remembers.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use arthro_authority::{
    Begin, Lease, Leases, Operation, OperationState, Operations, Outcome, REMEMBERED_OPERATIONS,
    Refusal,
};
use tokio::sync::watch;

use crate::error::Error;

/// Time on the host since an arbitrary start.
pub type Clock = Box<dyn Fn() -> Duration + Send + Sync>;

/// Shared by the server and the owners of both arms. Clones are the same.
#[derive(Clone)]
pub struct Commander {
    shared: Arc<Shared>,
}

struct Shared {
    clock: Clock,
    leases: Mutex<Leases>,
    operations: Mutex<Remembered>,
}

struct Remembered {
    operations: Operations,
    /// The progress of those that run.
    running: HashMap<String, watch::Receiver<Progress>>,
}

/// Who asks and under which id.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Authorization {
    /// From the lease.
    pub fencing_token: u64,
    /// Chosen by the caller.
    pub operation_id: String,
}

/// How far a move is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// The operation.
    pub operation: Operation,
    /// 0 .. 1 of the path.
    pub fraction: f64,
    /// Largest measured distance of the shaft to the portal so far while inside, mm.
    pub rcm_deviation_max_mm: f64,
}

/// What came of beginning an operation.
pub enum Begun {
    /// Not seen before: act.
    New,
    /// Seen before: do not act. With its progress while it runs.
    Repeated(Operation, Option<watch::Receiver<Progress>>),
}

impl Commander {
    /// Nobody holds the lease. `start` is the wall clock in ms since 1970, see [`Leases::new`].
    pub fn new(start: u64, clock: Clock) -> Self {
        Self {
            shared: Arc::new(Shared {
                clock,
                leases: Mutex::new(Leases::new(start)),
                operations: Mutex::new(Remembered {
                    operations: Operations::new(REMEMBERED_OPERATIONS),
                    running: HashMap::new(),
                }),
            }),
        }
    }

    /// Grants a lease unless one is in force.
    pub fn acquire(&self, holder: &str, ttl: Duration) -> Result<Lease, Refusal> {
        lock(&self.shared.leases).acquire(holder, ttl, self.now())
    }

    /// Keeps it.
    pub fn renew(&self, token: u64) -> Result<Lease, Refusal> {
        lock(&self.shared.leases).renew(token, self.now())
    }

    /// Gives it back, unless an operation runs under it.
    pub fn release(&self, token: u64) -> Result<(), Error> {
        let remembered = lock(&self.shared.operations);
        let mut leases = lock(&self.shared.leases);
        let now = self.now();
        leases.check(token, now)?;
        if remembered.operations.running().next().is_some() {
            return Err(Error::Moving);
        }
        Ok(leases.release(token, now)?)
    }

    /// The lease in force.
    pub fn lease(&self) -> Option<Lease> {
        lock(&self.shared.leases).current(self.now()).cloned()
    }

    /// Whether a token is in force.
    pub fn check(&self, token: u64) -> Result<(), Refusal> {
        lock(&self.shared.leases)
            .check(token, self.now())
            .map(|_| ())
    }

    /// Begins an operation unless it was begun before; `command` is what it does, encoded.
    pub fn begin(&self, by: &Authorization, command: &[u8]) -> Result<Begun, Refusal> {
        let mut remembered = lock(&self.shared.operations);
        self.check(by.fencing_token)?;
        Ok(
            match remembered.operations.begin(&by.operation_id, command)? {
                Begin::New => Begun::New,
                Begin::Repeated(operation) => {
                    let progress = remembered.running.get(&by.operation_id).cloned();
                    Begun::Repeated(operation, progress)
                }
            },
        )
    }

    /// Lets others follow a running operation.
    pub fn follow(&self, operation_id: &str, progress: watch::Receiver<Progress>) {
        lock(&self.shared.operations)
            .running
            .insert(operation_id.to_owned(), progress);
    }

    /// Records how an operation ended.
    pub fn finish(&self, operation_id: &str, outcome: Outcome) -> Operation {
        let mut remembered = lock(&self.shared.operations);
        remembered.running.remove(operation_id);
        remembered
            .operations
            .finish(operation_id, outcome)
            .unwrap_or_else(|| Operation {
                id: operation_id.to_owned(),
                state: OperationState::Failed,
                reason: "FORGOTTEN".to_owned(),
                detail: "the operation is not remembered".to_owned(),
            })
    }

    /// Records a refusal as the outcome of its operation, and returns it.
    pub fn refuse(&self, operation_id: &str, error: Error) -> Error {
        self.finish(
            operation_id,
            Outcome::Failed {
                reason: error.reason().to_owned(),
                detail: error.to_string(),
            },
        );
        error
    }

    fn now(&self) -> Duration {
        (self.shared.clock)()
    }
}

impl Authorization {
    /// The operation as it begins.
    pub fn running(&self) -> Operation {
        Operation {
            id: self.operation_id.clone(),
            state: OperationState::Running,
            reason: String::new(),
            detail: String::new(),
        }
    }
}

/// A panic of another thread must not take the stop away: the data are valid between any two statements.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
