//! The state machine of a procedure and of its steps, each as one table. Nothing else changes a state.
//!
//! A call that wants something is admitted by the same row that its owner goes along once the wish is
//! carried out: a pause is taken in RUNNING, and the procedure is PAUSED when the arms hold. What has
//! no row is refused with its reason; [`drawing`] writes both tables for docs/procedure.md.

pub mod drawing;

use crate::procedure::State;
use crate::procedure::steps::{Effect, StepState};
use crate::words::words;

words! {
    /// What happens to a procedure.
    Event {
        /// The operator wants it to hold; it does.
        Pause = "PAUSE",
        /// The operator lets a held procedure go on, with acknowledgement.
        Resume = "RESUME",
        /// The operator ends it; the retreat begins.
        Abort = "ABORT",
        /// Somebody stops everything.
        Stop = "STOP",
        /// A fault, a lost lease, a crash, or a halt in mid-bite.
        Interrupt = "INTERRUPT",
        /// The operator goes on after an interruption: REPEAT_BITE or MARK_DONE.
        GoOn = "GO_ON",
        /// The operator withdraws after an interruption.
        Withdraw = "WITHDRAW",
        /// The last step is done.
        Finish = "FINISH",
        /// The retreat is done and bites are left.
        Retreated = "RETREATED",
        /// The retreat is done and no bite was left.
        RetreatedDone = "RETREATED_DONE",
    }
}

words! {
    /// What happens to a step.
    StepEvent {
        /// Its last command was confirmed.
        Confirmed = "CONFIRMED",
        /// It ended before its command acted: refused, or halted before it left.
        Refused = "REFUSED",
        /// It was cut off after a command had left: halted, failed, or out of sight.
        CutOff = "CUT_OFF",
        /// The operator decided what an outcome in doubt counts as.
        Decided = "DECIDED",
    }
}

/// From a state by an event to a state. What is not listed is refused.
pub const TRANSITIONS: &[(State, Event, State)] = &[
    (State::Running, Event::Pause, State::Paused),
    (State::Running, Event::Abort, State::Aborting),
    (State::Running, Event::Stop, State::Interrupted),
    (State::Running, Event::Interrupt, State::Interrupted),
    (State::Running, Event::Finish, State::Completed),
    (State::Paused, Event::Pause, State::Paused),
    (State::Paused, Event::Resume, State::Running),
    (State::Paused, Event::Abort, State::Aborting),
    (State::Paused, Event::Stop, State::Interrupted),
    (State::Paused, Event::Interrupt, State::Interrupted),
    (State::Aborting, Event::Abort, State::Aborting),
    (State::Aborting, Event::Stop, State::Interrupted),
    (State::Aborting, Event::Interrupt, State::Interrupted),
    (State::Aborting, Event::Retreated, State::Aborted),
    (State::Aborting, Event::RetreatedDone, State::Completed),
    (State::Interrupted, Event::Stop, State::Interrupted),
    (State::Interrupted, Event::GoOn, State::Running),
    (State::Interrupted, Event::Withdraw, State::Aborting),
    (State::Completed, Event::Stop, State::Completed),
    (State::Aborted, Event::Stop, State::Aborted),
];

/// From a step's state by an event, and the effect class where it matters, to a state.
pub const STEP_TRANSITIONS: &[(StepState, StepEvent, Option<Effect>, StepState)] = &[
    (
        StepState::Intended,
        StepEvent::Confirmed,
        None,
        StepState::Done,
    ),
    (
        StepState::Intended,
        StepEvent::Refused,
        None,
        StepState::Failed,
    ),
    (
        StepState::Intended,
        StepEvent::CutOff,
        Some(Effect::Pure),
        StepState::Failed,
    ),
    (
        StepState::Intended,
        StepEvent::CutOff,
        Some(Effect::Reversible),
        StepState::Failed,
    ),
    (
        StepState::Intended,
        StepEvent::CutOff,
        Some(Effect::Irreversible),
        StepState::InDoubt,
    ),
    (
        StepState::InDoubt,
        StepEvent::Decided,
        Some(Effect::Irreversible),
        StepState::Resolved,
    ),
];

/// An event that has no row in a state: reason PROCEDURE_STATE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Where the procedure stands.
    pub state: State,
    /// What was wanted.
    pub event: Event,
}

/// Where `event` leads from `state`.
pub fn next(state: State, event: Event) -> Result<State, Refused> {
    TRANSITIONS
        .iter()
        .find(|(from, by, _)| (*from, *by) == (state, event))
        .map(|(_, _, to)| *to)
        .ok_or(Refused { state, event })
}

/// Where `event` leads a step of this effect class; `None` where it has no row, and the step stays as it is.
pub fn next_of_step(state: StepState, event: StepEvent, effect: Effect) -> Option<StepState> {
    STEP_TRANSITIONS
        .iter()
        .find(|(from, by, of, _)| {
            (*from, *by) == (state, event) && of.is_none_or(|of| of == effect)
        })
        .map(|(_, _, _, to)| *to)
}

impl Refused {
    /// The states that have a row for the event, for a person.
    pub fn needed(&self) -> String {
        let states: Vec<_> = State::ALL
            .iter()
            .filter(|state| next(**state, self.event).is_ok())
            .map(|state| state.as_str())
            .collect();
        states.join(" or ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_state_has_two_rows_for_one_event() {
        for state in State::ALL {
            for event in Event::ALL {
                let rows = TRANSITIONS
                    .iter()
                    .filter(|(from, by, _)| (from, by) == (state, event));
                assert!(rows.count() <= 1, "{state} by {event}");
            }
        }
        for state in StepState::ALL {
            for event in StepEvent::ALL {
                for effect in Effect::ALL {
                    let rows = STEP_TRANSITIONS.iter().filter(|(from, by, of, _)| {
                        (from, by) == (state, event) && of.is_none_or(|of| of == *effect)
                    });
                    assert!(rows.count() <= 1, "{state} by {event} of {effect}");
                }
            }
        }
    }

    #[test]
    fn a_stop_is_taken_in_every_state_and_nothing_runs_after_it() {
        for state in State::ALL {
            let after = next(*state, Event::Stop).unwrap();
            assert!(!after.is_under_way(), "{state}");
        }
    }

    #[test]
    fn what_is_over_stays_over() {
        for state in [State::Completed, State::Aborted] {
            for event in Event::ALL {
                let after = next(state, *event).unwrap_or(state);
                assert_eq!(after, state, "by {event}");
            }
        }
    }

    #[test]
    fn only_the_operator_leads_out_of_an_interruption() {
        let ways_out: Vec<_> = Event::ALL
            .iter()
            .filter(|event| {
                next(State::Interrupted, **event).is_ok_and(|after| after != State::Interrupted)
            })
            .collect();
        assert_eq!(ways_out, [&Event::GoOn, &Event::Withdraw]);
    }

    #[test]
    fn a_pause_of_a_retreat_is_refused_and_says_what_it_needs() {
        let refused = next(State::Aborting, Event::Pause).unwrap_err();
        assert_eq!(refused.needed(), "RUNNING or PAUSED");
    }

    #[test]
    fn only_a_bite_that_was_cut_off_is_in_doubt_and_only_a_decision_resolves_it() {
        for effect in Effect::ALL {
            let cut_off = next_of_step(StepState::Intended, StepEvent::CutOff, *effect);
            let in_doubt = *effect == Effect::Irreversible;
            assert_eq!(cut_off == Some(StepState::InDoubt), in_doubt, "{effect}");
        }
        for event in StepEvent::ALL {
            let after = next_of_step(StepState::InDoubt, *event, Effect::Irreversible);
            let resolved = *event == StepEvent::Decided;
            assert_eq!(after, resolved.then_some(StepState::Resolved), "{event}");
        }
    }

    #[test]
    fn a_step_that_has_ended_is_not_changed_by_what_its_device_says_later() {
        for state in [StepState::Done, StepState::Failed, StepState::Resolved] {
            for event in StepEvent::ALL {
                for effect in Effect::ALL {
                    assert_eq!(next_of_step(state, *event, *effect), None);
                }
            }
        }
    }
}
