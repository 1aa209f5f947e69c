//! A procedure as a value: one performance of an approved plan, and where it stands.
//!
//! [`control::Procedures`] starts, commands and recovers procedures; [`sequencer::Run`] owns the one
//! that is under way; [`machine`], [`steps`], [`poses`], [`safety`] and [`recovery`] are the pure part.

pub mod control;
pub mod lease;
pub mod machine;
pub mod perform;
pub mod poses;
pub mod recovery;
pub mod safety;
pub mod sequencer;
pub mod situation;
pub mod standing;
pub mod steps;
pub mod wish;

use crate::approval::Digest;
use crate::clients::Acted;
use crate::error::{Error, Result};
use crate::procedure::machine::{Event, StepEvent};
use crate::procedure::sequencer::Interruption;
use crate::procedure::steps::{BiteOutcome, Step};
use crate::wall_clock::now_ms;
use crate::words::words;

words! {
    /// Where a procedure stands.
    State {
        /// Going from step to step.
        Running = "RUNNING",
        /// Holds before the next step.
        Paused = "PAUSED",
        /// Withdrawing after an abort.
        Aborting = "ABORTING",
        /// Ended as planned.
        Completed = "COMPLETED",
        /// Ended by abort, the arms withdrawn.
        Aborted = "ABORTED",
        /// Halted in the middle; nothing moves until the operator recovers it.
        Interrupted = "INTERRUPTED",
    }
}

/// One performance of an approved plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Procedure {
    /// Chosen by the gateway.
    pub id: String,
    /// Whose plan it is.
    pub case_id: String,
    /// Who started it.
    pub operator: String,
    /// Where it stands.
    pub state: State,
    /// What was approved.
    pub plan_digest: Digest,
    /// Bites of the plan.
    pub bites_planned: u32,
    /// The first bite whose cycle is not finished.
    pub next_bite: u32,
    /// Bites taken or held as done.
    pub bites_done: u32,
    /// The latest step.
    pub step: Option<Step>,
    /// Why it is interrupted: a stable word.
    pub reason: String,
    /// For a person.
    pub detail: String,
    /// Milliseconds since 1970-01-01 UTC.
    pub started_at_ms: i64,
    /// Unset until it is over.
    pub ended_at_ms: Option<i64>,
    /// Time on the forceps controller's clock, s.
    pub robot_seconds: f64,
    /// Largest shaft-to-portal distance that the motion service measured, mm.
    pub rcm_deviation_max_mm: f64,
}

/// A procedure with its journal.
#[derive(Clone, Debug)]
pub struct Report {
    /// As it stands.
    pub procedure: Procedure,
    /// The whole journal in order.
    pub steps: Vec<Step>,
    /// What the jaw did, in order.
    pub bites: Vec<BiteOutcome>,
}

impl State {
    /// Whether a task owns the procedure.
    pub const fn is_under_way(self) -> bool {
        matches!(self, Self::Running | Self::Paused | Self::Aborting)
    }

    /// Whether nothing more can happen to the procedure.
    pub const fn is_over(self) -> bool {
        matches!(self, Self::Completed | Self::Aborted)
    }
}

impl Procedure {
    /// Changes the state by the machine's table, which alone says what may follow.
    pub fn apply(&mut self, event: Event) -> Result<()> {
        self.state = self.after(event)?;
        Ok(())
    }

    /// The state that `event` leads to; refused with PROCEDURE_STATE where there is none.
    pub fn after(&self, event: Event) -> Result<State> {
        machine::next(self.state, event).map_err(|refused| Error::WrongState {
            procedure_id: self.id.clone(),
            state: self.state,
            needed: refused.needed(),
        })
    }

    /// Leaves the procedure to the operator. The step under way has failed, or is in doubt if it removes tissue and may
    /// have acted. A procedure that is over stays so.
    pub fn interrupt(&mut self, interruption: &Interruption) {
        if self.apply(Event::Interrupt).is_err() {
            return;
        }
        self.reason.clone_from(&interruption.reason);
        self.detail.clone_from(&interruption.detail);
        self.cut_off(
            interruption.acted,
            &interruption.reason,
            &interruption.detail,
        );
    }

    /// Ends the step under way otherwise than it was meant to.
    pub fn cut_off(&mut self, acted: Acted, reason: &str, detail: &str) {
        let event = match acted {
            Acted::No => StepEvent::Refused,
            Acted::Perhaps => StepEvent::CutOff,
        };
        if let Some(step) = &mut self.step
            && step.apply(event)
        {
            step.ended_at_ms = Some(now_ms());
            step.detail = format!("{reason}: {detail}");
        }
    }
}
