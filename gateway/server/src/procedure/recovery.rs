//! What follows an interruption: which steps an operator's decision leads to, and which bites then
//! count as done.
//!
//! Every recovery begins with a retract along the shaft of both arms wherever they are inside.
//! Bites are numbered in order, and everything below `next_bite` is done, so one number says where a
//! procedure stands.

use crate::procedure::machine::Event;
use crate::procedure::steps::{self, Kind, Planned, Step, StepState, around};
use crate::words::words;

words! {
    /// What the operator decides after an interruption.
    Action {
        /// Retract, withdraw, and end the procedure.
        Withdraw = "WITHDRAW",
        /// Retract, and do the interrupted bite from its start.
        RepeatBite = "REPEAT_BITE",
        /// Retract, hold the interrupted bite as done, and go on with the next.
        MarkDone = "MARK_DONE",
    }
}

/// An operator's decision after an interruption.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decision {
    /// What shall happen.
    pub action: Action,
    /// Who decides.
    pub operator: String,
    /// Whether they have looked at the cell and let the arms move.
    pub acknowledged: bool,
    /// Whether latched faults are to be acknowledged first.
    pub recover_faults: bool,
}

/// Where the procedure goes on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovery {
    /// The first bite that is not done.
    pub next_bite: u32,
    /// How many bites are done.
    pub bites_done: u32,
    /// The steps to come.
    pub steps: Vec<Planned>,
}

impl Action {
    /// The event that the decision is in the machine's table.
    pub const fn event(self) -> Event {
        match self {
            Self::Withdraw => Event::Withdraw,
            Self::RepeatBite | Self::MarkDone => Event::GoOn,
        }
    }
}

/// What `action` leads to, given the journal so far and which bites of the plan have a view of their own (see
/// [`steps::from_bite`]). `None` when there is no bite to hold as done.
pub fn decide(
    action: Action,
    journal: &[Step],
    next_bite: u32,
    bites_done: u32,
    views: &[bool],
) -> Option<Recovery> {
    match action {
        Action::Withdraw => Some(Recovery {
            next_bite,
            bites_done,
            steps: steps::retreat(),
        }),
        Action::RepeatBite => Some(going_on(next_bite, views)),
        Action::MarkDone => was_begun(journal, next_bite).then(|| going_on(next_bite + 1, views)),
    }
}

/// Whether there is anything of a bite that could be held as done.
pub fn was_begun(journal: &[Step], bite: u32) -> bool {
    journal.iter().any(|step| step.planned.bite == Some(bite))
}

/// Whether a step is a bite whose outcome nobody knows.
pub fn in_doubt(step: &Step) -> bool {
    step.planned.kind == Kind::Bite && step.state == StepState::InDoubt
}

fn going_on(next_bite: u32, views: &[bool]) -> Recovery {
    let mut steps = vec![around(Kind::Retract)];
    steps.extend(steps::from_bite(next_bite, views));
    Recovery {
        next_bite,
        bites_done: next_bite,
        steps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn journal(kinds: &[(Kind, Option<u32>, StepState)]) -> Vec<Step> {
        (1..)
            .zip(kinds)
            .map(|(sequence, &(kind, bite, state))| Step {
                sequence,
                planned: Planned { kind, bite },
                state,
                operation_id: sequence.to_string(),
                intended_at_ms: 0,
                ended_at_ms: None,
                started_controller_s: 0.0,
                ended_controller_s: None,
                detail: String::new(),
            })
            .collect()
    }

    fn in_second_bite() -> Vec<Step> {
        journal(&[
            (Kind::Prepare, None, StepState::Done),
            (Kind::Bite, Some(0), StepState::Done),
            (Kind::Bite, Some(1), StepState::InDoubt),
        ])
    }

    #[test]
    fn every_recovery_begins_with_a_retract_of_both_arms() {
        for action in Action::ALL {
            let recovery = decide(*action, &in_second_bite(), 1, 1, &[true; 3]).unwrap();
            assert_eq!(recovery.steps[0], around(Kind::Retract), "{action}");
        }
    }

    #[test]
    fn repeating_goes_on_with_the_interrupted_bite() {
        let recovery = decide(Action::RepeatBite, &in_second_bite(), 1, 1, &[true; 3]).unwrap();
        assert_eq!((recovery.next_bite, recovery.bites_done), (1, 1));
        assert_eq!(recovery.steps[1], around(Kind::Prepare));
        assert_eq!(recovery.steps[2].kind, Kind::View);
        assert_eq!(recovery.steps[2].bite, Some(1));
    }

    #[test]
    fn repeating_a_finished_bite_does_not_count_it_as_done() {
        let recovery = decide(Action::RepeatBite, &in_second_bite(), 1, 2, &[true; 3]).unwrap();
        assert_eq!(recovery.bites_done, 1);
    }

    #[test]
    fn marking_done_goes_on_with_the_next_bite() {
        let recovery = decide(Action::MarkDone, &in_second_bite(), 1, 1, &[true; 3]).unwrap();
        assert_eq!((recovery.next_bite, recovery.bites_done), (2, 2));
        assert_eq!(recovery.steps[2].bite, Some(2));
    }

    #[test]
    fn marking_the_last_bite_done_leaves_only_the_withdrawal() {
        let recovery = decide(Action::MarkDone, &in_second_bite(), 1, 1, &[true; 2]).unwrap();
        assert_eq!(
            recovery.steps,
            [around(Kind::Retract), around(Kind::Withdraw)]
        );
    }

    #[test]
    fn a_bite_that_was_not_begun_cannot_be_marked_done() {
        let journal = journal(&[(Kind::Prepare, None, StepState::Failed)]);
        assert_eq!(decide(Action::MarkDone, &journal, 0, 0, &[true; 3]), None);
    }

    #[test]
    fn withdrawing_bites_no_more() {
        let recovery = decide(Action::Withdraw, &in_second_bite(), 1, 1, &[true; 3]).unwrap();
        assert_eq!(recovery.steps, steps::retreat());
        assert_eq!(recovery.bites_done, 1);
    }
}
