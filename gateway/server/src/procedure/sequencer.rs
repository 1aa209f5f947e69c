//! The owner of a running procedure: takes one step after the other, writes each to the journal
//! before and after, and obeys pause, abort and stop between and within steps.
//!
//! No call owns a procedure. A call changes the [`Wish`]; the owner acts on it and publishes where
//! the procedure stands.

use std::collections::VecDeque;
use std::sync::Arc;

use tokio::sync::watch;
use uuid::Uuid;

use crate::clients::motion::{Arm, MoveProgress};
use crate::clients::{Acted, Clients};
use crate::error::{Error, Result};
use crate::journal::Journal;
use crate::procedure::perform::{Performed, Performer};
use crate::procedure::steps::{self, Kind, Planned, Step, StepState};
use crate::procedure::{Procedure, State};
use crate::wall_clock::now_ms;

/// What the operator wants of a running procedure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Go on.
    Run,
    /// Hold before the next step.
    Pause,
    /// Retreat after the step under way, and end.
    Abort,
    /// Halt within the step under way. Stable word, and text for a person.
    Stop(&'static str, String),
}

impl Wish {
    /// Whether this wish takes the place of the one before: nothing undoes a stop, only a stop undoes an abort.
    pub fn overrides(&self, before: &Self) -> bool {
        match before {
            Self::Stop(..) => false,
            Self::Abort => matches!(self, Self::Abort | Self::Stop(..)),
            Self::Run | Self::Pause => true,
        }
    }
}

/// Why a procedure halts in the middle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interruption {
    /// The stable word.
    pub reason: String,
    /// For a person.
    pub detail: String,
    /// Whether the step under way may have acted.
    pub acted: Acted,
}

/// One run of a procedure, from its start or a recovery to its end or interruption.
pub struct Run {
    /// What is still to come.
    pub steps: VecDeque<Planned>,
    /// Where the procedure stands; published after every change.
    pub procedure: Procedure,
    /// The arms and drives.
    pub performer: Performer,
    /// For stopping.
    pub clients: Clients,
    /// Written before and after each step.
    pub journal: Arc<dyn Journal>,
    /// Tells whether the plan is still approved.
    pub approval: Box<dyn Approval>,
    /// To those who watch.
    pub published: watch::Sender<Procedure>,
    /// From those who command.
    pub wish: watch::Receiver<Wish>,
    /// How the procedure ends when all steps are done.
    pub end: State,
}

/// Tells whether what is being executed is still approved.
#[tonic::async_trait]
pub trait Approval: Send + Sync {
    /// Fails with APPROVAL_VOID when it is not.
    async fn check(&self) -> Result<()>;
}

/// The forceps controller's clock over a run.
#[derive(Clone, Copy, Debug)]
struct RunClock {
    /// Robot seconds of the runs before.
    before_s: f64,
    started_s: f64,
}

impl Run {
    /// Runs to the end or an interruption, publishes and journals it, and gives command back.
    pub async fn run(mut self) {
        match self.go().await {
            Ok(()) => {
                self.procedure.state = self.end;
                self.procedure.ended_at_ms = Some(now_ms());
                if let Err(error) = self.journal.save_procedure(&self.procedure).await {
                    // The work is done; only its record is not. The next start finds it unfinished.
                    tracing::error!(%error, "the procedure's end was not journalled");
                    self.procedure.state = State::Interrupted;
                    self.procedure.reason = "JOURNAL_FAILED".to_owned();
                    self.procedure.detail = error.to_string();
                }
            }
            Err(interruption) => self.interrupt(interruption).await,
        }
        tracing::info!(
            procedure_id = self.procedure.id,
            state = %self.procedure.state,
            reason = self.procedure.reason,
            detail = self.procedure.detail,
            "procedure ended or halted"
        );
        // Leases first: who hears of the end may start the next procedure at once.
        self.performer.release().await;
        self.published.send_replace(self.procedure);
    }

    async fn go(&mut self) -> Result<(), Interruption> {
        let started_s = self.controller_time_s().await?;
        let clock = RunClock {
            before_s: self.procedure.robot_seconds,
            started_s,
        };
        while let Some(planned) = self.next_step().await? {
            if matches!(planned.kind, Kind::View | Kind::Approach) {
                self.approval.check().await?;
            }
            self.take(planned, clock).await?;
        }
        Ok(())
    }

    /// The next step once nothing holds it back.
    async fn next_step(&mut self) -> Result<Option<Planned>, Interruption> {
        loop {
            let wish = self.wish.borrow_and_update().clone();
            match wish {
                Wish::Stop(reason, detail) => return Err(Interruption::stopped(reason, detail)),
                Wish::Abort if self.procedure.state != State::Aborting => {
                    self.steps = steps::retreat().into();
                    self.end = State::Aborted;
                    self.enter(State::Aborting).await?;
                }
                Wish::Pause if self.procedure.state == State::Running => {
                    self.enter(State::Paused).await?;
                }
                Wish::Run if self.procedure.state == State::Paused => {
                    self.enter(State::Running).await?;
                }
                Wish::Pause if self.procedure.state == State::Paused => {
                    tokio::select! {
                        failure = self.performer.command().lost() => return Err(failure.into()),
                        changed = self.wish.changed() => if changed.is_err() {
                            return Err(Interruption::abandoned());
                        },
                    }
                }
                _ => return Ok(self.steps.pop_front()),
            }
        }
    }

    /// One step: intended, performed, ended.
    async fn take(&mut self, planned: Planned, clock: RunClock) -> Result<(), Interruption> {
        let step = Step {
            sequence: self
                .procedure
                .step
                .as_ref()
                .map_or(1, |step| step.sequence + 1),
            planned,
            state: StepState::Intended,
            operation_id: Uuid::now_v7().to_string(),
            intended_at_ms: now_ms(),
            ended_at_ms: None,
            started_controller_s: self.controller_time_s().await?,
            ended_controller_s: None,
            detail: String::new(),
        };
        self.journal.intend(&self.procedure.id, &step).await?;
        let operation_id = step.operation_id.clone();
        self.procedure.step = Some(step);
        self.publish();

        let performed = self.perform(planned, &operation_id, clock).await?;
        // What was confirmed is written even if the clock cannot be read any more; the next step finds that out.
        let ended_s = self.controller_time_s().await.ok();
        self.end_step(planned, performed, ended_s, clock).await
    }

    /// Performs the step until it ends, the leases are lost, or the operator stops.
    async fn perform(
        &mut self,
        planned: Planned,
        operation_id: &str,
        clock: RunClock,
    ) -> Result<Performed, Interruption> {
        let Self {
            performer,
            wish,
            procedure,
            published,
            ..
        } = self;
        let mut watch = |arm: Arm, progress: MoveProgress| {
            procedure.rcm_deviation_max_mm = procedure
                .rcm_deviation_max_mm
                .max(progress.rcm_deviation_max_mm);
            if let (Arm::Forceps, Some(now_s)) = (arm, progress.controller_time_s) {
                procedure.robot_seconds = clock.robot_seconds(now_s);
            }
            published.send_replace(procedure.clone());
        };
        tokio::select! {
            biased;
            (reason, detail) = stop_wished(wish) => Err(Interruption::stopped(reason, detail)),
            failure = performer.command().lost() => Err(Interruption {
                acted: Acted::Perhaps,
                ..failure.into()
            }),
            performed = performer.perform(planned, operation_id, &mut watch) => {
                performed.map_err(|error| Interruption {
                    reason: error.reason().to_owned(),
                    detail: error.to_string(),
                    acted: error.acted(),
                })
            }
        }
    }

    async fn end_step(
        &mut self,
        planned: Planned,
        performed: Performed,
        ended_s: Option<f64>,
        clock: RunClock,
    ) -> Result<(), Interruption> {
        let procedure = &mut self.procedure;
        if let Some(ended_s) = ended_s {
            procedure.robot_seconds = clock.robot_seconds(ended_s);
        }
        match (planned.kind, planned.bite) {
            (Kind::Bite, Some(bite)) => procedure.bites_done = bite + 1,
            (Kind::Release, Some(bite)) => procedure.next_bite = bite + 1,
            _ => {}
        }
        if let Some(step) = &mut procedure.step {
            step.state = StepState::Done;
            step.ended_at_ms = Some(now_ms());
            step.ended_controller_s = ended_s;
            step.detail = performed.detail;
            let step = step.clone();
            self.journal
                .end_step(procedure, &step, performed.outcome.as_ref())
                .await?;
        }
        self.publish();
        Ok(())
    }

    /// Halts everything and leaves the procedure to the operator.
    async fn interrupt(&mut self, interruption: Interruption) {
        if let Err(failure) = self.clients.stop_everything(&interruption.reason).await {
            tracing::error!(%failure, "not every device confirmed the stop");
        }
        self.procedure.interrupt(&interruption);
        let written = match &self.procedure.step {
            Some(step) => self.journal.end_step(&self.procedure, step, None).await,
            None => self.journal.save_procedure(&self.procedure).await,
        };
        if let Err(error) = written {
            // The next start finds the procedure as it stood before, which is in the middle of this step.
            tracing::error!(%error, "the interruption was not journalled");
        }
    }

    async fn enter(&mut self, state: State) -> Result<(), Interruption> {
        self.procedure.state = state;
        self.journal.save_procedure(&self.procedure).await?;
        self.publish();
        Ok(())
    }

    async fn controller_time_s(&self) -> Result<f64, Interruption> {
        let arms = self.clients.motion.arms().await?;
        Ok(arms.forceps.controller_time_s)
    }

    fn publish(&self) {
        self.published.send_replace(self.procedure.clone());
    }
}

/// Resolves when the operator stops; never when everybody who could is gone.
async fn stop_wished(wish: &mut watch::Receiver<Wish>) -> (&'static str, String) {
    let stop = wish
        .wait_for(|wish| matches!(wish, Wish::Stop(..)))
        .await
        .map(|wish| wish.clone());
    match stop {
        Ok(Wish::Stop(reason, detail)) => (reason, detail),
        _ => std::future::pending().await,
    }
}

impl RunClock {
    fn robot_seconds(&self, now_s: f64) -> f64 {
        self.before_s + (now_s - self.started_s).max(0.0)
    }
}

// === impl Interruption ===

impl Interruption {
    fn stopped(reason: &'static str, detail: String) -> Self {
        Self {
            reason: reason.to_owned(),
            detail,
            acted: Acted::Perhaps,
        }
    }

    fn abandoned() -> Self {
        Self::stopped(
            "GATEWAY_STOPPING",
            "the gateway no longer commands this procedure".to_owned(),
        )
    }
}

/// Refusals before a step's commands leave: nothing acted.
impl<E: Into<Error>> From<E> for Interruption {
    fn from(error: E) -> Self {
        let error = error.into();
        Self {
            reason: error.reason().to_owned(),
            detail: crate::error::chain(&error),
            acted: Acted::No,
        }
    }
}
