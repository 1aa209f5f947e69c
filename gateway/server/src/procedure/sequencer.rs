//! The owner of a running procedure: takes one step after the other, writes each to the journal
//! before and after, and obeys pause, abort and stop between and within steps.
//!
//! No call owns a procedure. A call changes the [`Wish`]; the owner acts on it and publishes where
//! the procedure stands. Its states follow the table of [`machine`](super::machine) alone.

mod halting;

use std::collections::VecDeque;
use std::sync::Arc;

use tokio::sync::watch;
use uuid::Uuid;

use crate::clients::{Acted, Clients};
use crate::config::{PauseMode, Rules};
use crate::error::{Error, Result};
use crate::journal::Journal;
use crate::procedure::machine::{Event, StepEvent};
use crate::procedure::perform::{Performed, Performer};
use crate::procedure::sequencer::halting::Ended;
use crate::procedure::steps::{self, BiteOutcome, Kind, Planned, Step, StepState, around};
use crate::procedure::wish::Wish;
use crate::procedure::{Procedure, safety, standing};
use crate::wall_clock::now_ms;

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
    /// What halts do.
    pub rules: Rules,
    /// To those who watch.
    pub published: watch::Sender<Procedure>,
    /// From those who command.
    pub wish: watch::Receiver<Wish>,
    /// The wish that is being carried out, or was last.
    pub obeyed: Wish,
    /// How the procedure ends when all steps are done.
    pub end: Event,
    /// What a confirmed bite did, until that is written.
    pub unwritten: Option<BiteOutcome>,
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
        if let Err(interruption) = self.go().await {
            self.interrupt(interruption).await;
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
        while let Some(planned) = self.next_step(clock).await? {
            // Before the first motion of a run and before every bite's cycle; drawing back needs no approval.
            if matches!(planned.kind, Kind::Prepare | Kind::View | Kind::Approach) {
                self.approval.check().await?;
            }
            self.take(planned, clock).await?;
        }
        self.finish().await
    }

    /// The end of the last step. If that cannot be written the work is done and its record is not; the next start finds it
    /// unfinished.
    async fn finish(&mut self) -> Result<(), Interruption> {
        let mut finished = self.procedure.clone();
        finished.apply(self.end)?;
        finished.ended_at_ms = Some(now_ms());
        self.journal.save_procedure(&finished).await?;
        self.procedure = finished;
        Ok(())
    }

    /// The next step once nothing holds it back.
    async fn next_step(&mut self, clock: RunClock) -> Result<Option<Planned>, Interruption> {
        loop {
            let wish = self.wish.borrow_and_update().clone();
            match wish {
                Wish::Stop(reason, detail) => return Err(Interruption::stopped(reason, detail)),
                Wish::Abort if self.obeyed != Wish::Abort => {
                    self.obeyed = wish;
                    self.begin_retreat().await?;
                }
                Wish::Pause if self.obeyed != Wish::Pause => {
                    self.obeyed = wish;
                    self.begin_pause(clock).await?;
                }
                Wish::Pause if self.procedure.after(Event::Resume).is_ok() => {
                    self.wait_paused().await?;
                }
                Wish::Run if self.obeyed == Wish::Pause => {
                    self.obeyed = wish;
                    self.enter(Event::Resume).await?;
                }
                _ => return Ok(self.steps.pop_front()),
            }
        }
    }

    /// The arms hold where they are, or are drawn back where that is configured and safe; where they then stand is what a
    /// resume is held against.
    async fn begin_pause(&mut self, clock: RunClock) -> Result<(), Interruption> {
        if self.rules.pause == PauseMode::Retract {
            self.draw_back(clock).await?;
            let overtaken = *self.wish.borrow() != Wish::Pause;
            if overtaken {
                return Ok(());
            }
        }
        let arms = self.clients.motion.arms().await?;
        standing::recorded(&self.journal, &self.procedure, &arms).await?;
        self.enter(Event::Pause).await
    }

    async fn draw_back(&mut self, clock: RunClock) -> Result<(), Interruption> {
        let arms = self.clients.motion.arms().await?;
        if !(arms.forceps.inside || arms.arthroscope.inside) {
            return Ok(());
        }
        let axes = self.clients.instrument.axes().await?;
        if let Some(why) = safety::why_not_draw_back(&arms, &axes) {
            self.procedure.detail = format!("holds instead of drawing back: {why}");
            return Ok(());
        }
        let left = std::mem::take(&mut self.steps);
        let views = self.performer.view_moves();
        self.steps = steps::after_drawing_back(left, self.procedure.bites_done, &views).into();
        self.take(around(Kind::Retract), clock).await
    }

    async fn wait_paused(&mut self) -> Result<(), Interruption> {
        tokio::select! {
            failure = self.performer.command().lost() => Err(failure.into()),
            changed = self.wish.changed() => match changed {
                Ok(()) => Ok(()),
                Err(_) => Err(Interruption::abandoned()),
            },
        }
    }

    /// Out along the shafts, if that is known to be safe without a person.
    async fn begin_retreat(&mut self) -> Result<(), Interruption> {
        let arms = self.clients.motion.arms().await?;
        let axes = self.clients.instrument.axes().await?;
        if let Some(why) = safety::why_not_draw_back(&arms, &axes) {
            return Err(Interruption {
                reason: "ABORT_UNSAFE".to_owned(),
                detail: why,
                acted: Acted::No,
            });
        }
        self.steps = steps::retreat().into();
        self.end = Event::Retreated;
        self.enter(Event::Abort).await
    }

    /// One step: intended, performed, ended. One that was halted comes first again.
    async fn take(&mut self, planned: Planned, clock: RunClock) -> Result<(), Interruption> {
        let step = Step {
            sequence: standing::sequence(&self.procedure) + 1,
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

        match self.perform(planned, &operation_id, clock).await {
            Ok(performed) => {
                // What was confirmed is written even if the clock cannot be read any more; the next step finds that out.
                let ended_s = self.controller_time_s().await.ok();
                self.end_step(planned, performed, ended_s, clock).await
            }
            Err(Ended::Halted(wish)) => {
                self.steps.push_front(planned);
                self.end_halted(&wish).await
            }
            Err(Ended::Interrupted(interruption)) => Err(interruption),
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
        self.unwritten = performed.outcome;
        if let Some(step) = &mut procedure.step
            && step.apply(StepEvent::Confirmed)
        {
            step.ended_at_ms = Some(now_ms());
            step.ended_controller_s = ended_s;
            step.detail = performed.detail;
        }
        self.write_step().await?;
        self.publish();
        Ok(())
    }

    /// A reversible step that was halted, or a bite before its command left.
    async fn end_halted(&mut self, wish: &Wish) -> Result<(), Interruption> {
        let (reason, detail) = wish.why();
        self.procedure.cut_off(Acted::Perhaps, reason, detail);
        self.write_step().await?;
        self.publish();
        Ok(())
    }

    /// Halts everything and leaves the procedure to the operator.
    async fn interrupt(&mut self, interruption: Interruption) {
        if let Err(failure) = self.clients.stop_everything(&interruption.reason).await {
            tracing::error!(%failure, "not every device confirmed the stop");
        }
        self.procedure.interrupt(&interruption);
        if let Err(error) = self.write_step().await {
            // The next start finds the procedure as it stood before, which is in the middle of this step.
            tracing::error!(%error, "the interruption was not journalled");
        }
    }

    /// The latest step as it stands, with the procedure and with what a bite did that is not written yet.
    async fn write_step(&mut self) -> Result<()> {
        let Self {
            procedure,
            journal,
            unwritten,
            ..
        } = self;
        match &procedure.step {
            Some(step) => {
                journal
                    .end_step(procedure, step, unwritten.as_ref())
                    .await?
            }
            None => journal.save_procedure(procedure).await?,
        }
        *unwritten = None;
        Ok(())
    }

    async fn enter(&mut self, event: Event) -> Result<(), Interruption> {
        self.procedure.apply(event)?;
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
