//! Remembered operations: a command sent twice under one id acts once and is answered with its first outcome.

use std::collections::{HashMap, VecDeque};
use std::hash::{DefaultHasher, Hasher};

use crate::Refusal;

/// How many operations a device service remembers.
pub const REMEMBERED_OPERATIONS: usize = 10_000;
/// The longest operation id: room for any UUID with a prefix.
pub const OPERATION_ID_MAX_BYTES: usize = 128;

/// The operations of one device: those that run, and the newest of those that ended.
#[derive(Debug)]
pub struct Operations {
    limit: usize,
    by_id: HashMap<String, Remembered>,
    /// Ids in the order in which they began.
    order: VecDeque<String>,
    running: usize,
}

/// One command and where it stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Operation {
    /// Chosen by the caller.
    pub id: String,
    /// Where it stands.
    pub state: OperationState,
    /// A stable SCREAMING_SNAKE word if failed, stopped or in doubt, else empty.
    pub reason: String,
    /// What happened, for a person, with value and limit.
    pub detail: String,
}

/// Where an operation stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperationState {
    /// Under way.
    Running,
    /// Ended as commanded.
    Done,
    /// Ended otherwise.
    Failed,
    /// Halted on request, or because command was lost.
    Stopped,
    /// It is not known how it ended: the device went out of sight while it ran.
    InDoubt,
}

/// How an operation ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// As commanded.
    Done {
        /// What happened, for a person.
        detail: String,
    },
    /// Otherwise.
    Failed {
        /// Stable word.
        reason: String,
        /// What happened, with value and limit.
        detail: String,
    },
    /// Halted on request, or because command was lost.
    Stopped {
        /// Stable word.
        reason: String,
        /// Who stopped it and why.
        detail: String,
    },
    /// Not known: the device went out of sight while it ran.
    InDoubt {
        /// Stable word.
        reason: String,
        /// What was known last.
        detail: String,
    },
}

/// What to do with a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Begin {
    /// Not seen before: act, then [`Operations::finish`].
    New,
    /// Seen before: do not act, answer with this.
    Repeated(Operation),
}

#[derive(Debug)]
struct Remembered {
    operation: Operation,
    fingerprint: u64,
}

impl Operations {
    /// Remembers up to `limit` operations, at least one; [`REMEMBERED_OPERATIONS`] is the rule.
    #[must_use]
    pub fn new(limit: usize) -> Self {
        Self {
            limit: limit.max(1),
            by_id: HashMap::new(),
            order: VecDeque::new(),
            running: 0,
        }
    }

    /// Begins an operation unless it was begun before. `command` is the command's encoding without id and token; the
    /// same id with another command is refused.
    pub fn begin(&mut self, id: &str, command: &[u8]) -> Result<Begin, Refusal> {
        if !(1..=OPERATION_ID_MAX_BYTES).contains(&id.len()) {
            return Err(Refusal::OperationId { bytes: id.len() });
        }
        let fingerprint = fingerprint(command);
        if let Some(known) = self.by_id.get(id) {
            return if known.fingerprint == fingerprint {
                Ok(Begin::Repeated(known.operation.clone()))
            } else {
                Err(Refusal::OperationIdReused { id: id.to_owned() })
            };
        }
        if self.running >= self.limit {
            return Err(Refusal::TooManyOperations {
                running: self.running,
                limit: self.limit,
            });
        }
        self.forget_down_to(self.limit - 1);
        let operation = Operation {
            id: id.to_owned(),
            state: OperationState::Running,
            reason: String::new(),
            detail: String::new(),
        };
        self.by_id.insert(
            id.to_owned(),
            Remembered {
                operation,
                fingerprint,
            },
        );
        self.order.push_back(id.to_owned());
        self.running += 1;
        Ok(Begin::New)
    }

    /// Records how a running operation ended and returns it. The first outcome stands: a second one changes nothing.
    /// None for an id that is not remembered.
    pub fn finish(&mut self, id: &str, outcome: Outcome) -> Option<Operation> {
        let operation = &mut self.by_id.get_mut(id)?.operation;
        if operation.state == OperationState::Running {
            (operation.state, operation.reason, operation.detail) = match outcome {
                Outcome::Done { detail } => (OperationState::Done, String::new(), detail),
                Outcome::Failed { reason, detail } => (OperationState::Failed, reason, detail),
                Outcome::Stopped { reason, detail } => (OperationState::Stopped, reason, detail),
                Outcome::InDoubt { reason, detail } => (OperationState::InDoubt, reason, detail),
            };
            self.running -= 1;
        }
        Some(operation.clone())
    }

    /// The operation of this id, if remembered.
    #[must_use]
    pub fn get(&self, id: &str) -> Option<&Operation> {
        self.by_id.get(id).map(|remembered| &remembered.operation)
    }

    /// The operations under way, oldest first.
    pub fn running(&self) -> impl Iterator<Item = &Operation> {
        self.order
            .iter()
            .filter_map(|id| self.get(id))
            .filter(|operation| operation.state == OperationState::Running)
    }

    /// Forgets the oldest operations that have ended until `count` are left, or only running ones.
    fn forget_down_to(&mut self, count: usize) {
        while self.order.len() > count {
            let ended = self.order.iter().position(|id| {
                self.by_id
                    .get(id)
                    .is_none_or(|remembered| remembered.operation.state != OperationState::Running)
            });
            let Some(id) = ended.and_then(|place| self.order.remove(place)) else {
                return;
            };
            self.by_id.remove(&id);
        }
    }
}

/// A fixed-key hash: a mix-up of commands is caught, memory stays bounded however large they are.
fn fingerprint(command: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(command);
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn done() -> Outcome {
        Outcome::Done {
            detail: "at 3 mm".into(),
        }
    }

    #[test]
    fn a_repeated_operation_answers_with_its_first_outcome() {
        let mut operations = Operations::new(REMEMBERED_OPERATIONS);
        assert_eq!(operations.begin("bite-1", b"bite").unwrap(), Begin::New);
        let Begin::Repeated(running) = operations.begin("bite-1", b"bite").unwrap() else {
            panic!("acted twice")
        };
        assert_eq!(running.state, OperationState::Running);
        let failed = Outcome::Failed {
            reason: "FOLLOWING_ERROR".into(),
            detail: "2100 of 2000 qc".into(),
        };
        operations.finish("bite-1", failed).unwrap();
        operations.finish("bite-1", done()).unwrap();
        let Begin::Repeated(ended) = operations.begin("bite-1", b"bite").unwrap() else {
            panic!("acted twice")
        };
        assert_eq!(
            (ended.state, &*ended.reason),
            (OperationState::Failed, "FOLLOWING_ERROR")
        );
        assert_eq!(ended.detail, "2100 of 2000 qc");
    }

    #[test]
    fn an_id_reused_for_another_command_is_refused() {
        let mut operations = Operations::new(REMEMBERED_OPERATIONS);
        operations.begin("move-1", b"to 3 mm").unwrap();
        let refusal = operations.begin("move-1", b"to 4 mm").unwrap_err();
        assert_eq!(refusal.reason(), "OPERATION_ID_REUSED");
        assert_eq!(refusal.field(), None);
    }

    #[test]
    fn empty_and_overlong_ids_are_refused() {
        let mut operations = Operations::new(REMEMBERED_OPERATIONS);
        for id in ["", &"x".repeat(129)] {
            assert_eq!(
                operations.begin(id, b"").unwrap_err().field(),
                Some("operation_id")
            );
        }
        assert_eq!(operations.begin(&"x".repeat(128), b"").unwrap(), Begin::New);
    }

    #[test]
    fn a_running_operation_is_never_forgotten() {
        let mut operations = Operations::new(3);
        operations.begin("long", b"").unwrap();
        for count in 0..10 {
            let id = format!("short-{count}");
            operations.begin(&id, b"").unwrap();
            operations.finish(&id, done());
        }
        assert_eq!(
            operations
                .running()
                .map(|operation| &*operation.id)
                .collect::<Vec<_>>(),
            ["long"]
        );
        assert!(operations.get("short-7").is_none());
        assert!(operations.get("short-8").is_some());
    }

    #[test]
    fn more_running_operations_than_remembered_are_refused() {
        let mut operations = Operations::new(1);
        operations.begin("first", b"").unwrap();
        assert_eq!(
            operations.begin("second", b"").unwrap_err().reason(),
            "TOO_MANY_OPERATIONS"
        );
        operations.finish("first", done());
        assert_eq!(operations.begin("second", b"").unwrap(), Begin::New);
    }

    #[test]
    fn an_unknown_operation_cannot_be_finished() {
        assert_eq!(Operations::new(1).finish("never", done()), None);
    }

    proptest! {
        #[test]
        fn memory_is_bounded_and_the_newest_are_kept(
            limit in 1_usize..20,
            steps in prop::collection::vec((0_u8..40, any::<bool>()), 0..300),
        ) {
            let mut operations = Operations::new(limit);
            for (number, finish) in steps {
                let id = number.to_string();
                let known = operations.get(&id).cloned();
                match operations.begin(&id, b"move") {
                    Ok(Begin::New) => prop_assert!(known.is_none()),
                    Ok(Begin::Repeated(operation)) => prop_assert_eq!(Some(operation), known),
                    Err(refusal) => prop_assert_eq!(refusal.reason(), "TOO_MANY_OPERATIONS"),
                }
                if finish {
                    operations.finish(&id, done());
                }
                prop_assert!(operations.order.len() <= limit);
                prop_assert_eq!(operations.order.len(), operations.by_id.len());
                prop_assert_eq!(operations.running().count(), operations.running);
            }
        }
    }
}
