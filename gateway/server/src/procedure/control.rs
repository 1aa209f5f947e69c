//! Procedures under control: one at a time, each owned by a task while it is under way.
//!
//! [`Procedures`] is a handle that clones cheaply. Starting and recovering end in a task that owns
//! the procedure ([`Run`]); everything else is a wish to that task. An interrupted procedure has no
//! owner: nothing moves until an operator recovers it, and no other can start.

mod command;
mod decisions;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use tokio::sync::watch;

use crate::approval::Digest;
use crate::audit::{Audit, witness};
use crate::cases::Cases;
use crate::clients::{Acted, Clients};
use crate::config::Rules;
use crate::error::{Error, Result};
use crate::journal::{Duty, Journal, Page};
use crate::procedure::machine::Event;
use crate::procedure::perform::Performer;
use crate::procedure::recovery::Decision;
use crate::procedure::sequencer::{Approval, Interruption, Run};
use crate::procedure::situation::Situation;
use crate::procedure::steps::Planned;
use crate::procedure::wish::Wish;
use crate::procedure::{Procedure, Report, State, safety, situation, standing};
use crate::recording::Recorder;

/// The procedures of this gateway.
#[derive(Clone)]
pub struct Procedures(Arc<Shared>);

struct Shared {
    journal: Arc<dyn Journal>,
    cases: Cases,
    clients: Clients,
    audit: Audit,
    rules: Rules,
    /// The procedure that is not over, if there is one.
    open: Mutex<Option<Open>>,
    /// Whether this gateway may command; see [`command`].
    duty: watch::Sender<Duty>,
    /// Held while a start or recovery is being decided.
    deciding: tokio::sync::Mutex<()>,
    /// Counts the stops, so that one that comes while a start is being decided is not lost.
    stops: AtomicU64,
    /// Set once, if procedures are recorded.
    recorder: OnceLock<Recorder>,
}

struct Open {
    published: watch::Sender<Procedure>,
    wish: watch::Sender<Wish>,
}

// === impl Procedures ===

impl Procedures {
    /// Takes over what the journal holds: a procedure that was under way when the last gateway ended is interrupted
    /// where it stood. Nothing moves. A gateway that is not in command does so when it comes into command.
    pub async fn take_over(
        journal: Arc<dyn Journal>,
        cases: Cases,
        clients: Clients,
        audit: Audit,
        rules: Rules,
    ) -> Result<Self> {
        let this = Self(Arc::new(Shared {
            journal,
            cases,
            clients,
            audit,
            rules,
            open: Mutex::default(),
            duty: watch::Sender::new(Duty::nobody()),
            deciding: tokio::sync::Mutex::default(),
            stops: AtomicU64::new(0),
            recorder: OnceLock::new(),
        }));
        this.begin().await?;
        Ok(this)
    }

    /// Has every procedure recorded from now on.
    pub fn recorded_by(&self, recorder: Recorder) {
        // It is set once, where the gateway is built; a second one would be told nothing.
        self.0.recorder.set(recorder).ok();
    }

    /// Starts the approved plan of a case.
    pub async fn start(
        &self,
        case_id: String,
        digest: Digest,
        operator: String,
    ) -> Result<Procedure> {
        let this = self.clone();
        // A task of its own: a caller that goes away must not leave half a start behind.
        owned(tokio::spawn(async move {
            this.decide_start(case_id, digest, operator).await
        }))
        .await
    }

    /// Decides what happens to an interrupted procedure.
    pub async fn recover(&self, procedure_id: String, decision: Decision) -> Result<Procedure> {
        let this = self.clone();
        owned(tokio::spawn(async move {
            this.decide_recovery(procedure_id, decision).await
        }))
        .await
    }

    /// What is known of a procedure that is halted, and what may be decided.
    pub async fn situation(&self, procedure_id: &str) -> Result<Situation> {
        let procedure = self.get(procedure_id).await?;
        let Shared {
            journal,
            cases,
            clients,
            rules,
            ..
        } = &*self.0;
        situation::look(journal, cases, clients, rules, procedure).await
    }

    /// Halts the step under way and holds. Answers when the wish is taken.
    pub async fn pause(&self, procedure_id: &str) -> Result<Procedure> {
        self.wish(procedure_id, Wish::Pause).await
    }

    /// Goes on after a pause, if the plan is still approved and the arms stand where they stood.
    pub async fn resume(&self, procedure_id: &str) -> Result<Procedure> {
        let procedure = self.admitted(procedure_id, Event::Resume).await?;
        let Shared {
            journal,
            cases,
            clients,
            rules,
            ..
        } = &*self.0;
        cases
            .approved(&procedure.case_id, procedure.plan_digest)
            .await?;
        let arms = clients.motion.arms().await?;
        let stood = standing::recorded(journal, &procedure, &arms).await?;
        safety::stand_where_they_stood(&stood, &arms, rules)?;
        self.wish(procedure_id, Wish::Run).await
    }

    /// Halts the step under way, retreats, and ends. Answers when the wish is taken.
    pub async fn abort(&self, procedure_id: &str) -> Result<Procedure> {
        self.wish(procedure_id, Wish::Abort).await
    }

    /// Stops both arms and all drives at once, whether a procedure is under way or not. Answers when the orders are on
    /// their way.
    pub fn stop(&self, reason: String) {
        let confirming = self.send_stop(reason);
        tokio::spawn(async move {
            if let Err(error) = confirming.await {
                tracing::error!(%error, "not every device confirmed the stop");
            }
        });
    }

    /// The same, and answers when both services have confirmed it.
    pub async fn stop_confirmed(&self, reason: String) -> Result<()> {
        self.send_stop(reason).await
    }

    /// Nothing is waited for before the orders are on their way, and nothing that the caller does calls them back.
    fn send_stop(&self, reason: String) -> impl Future<Output = Result<()>> + Send + 'static {
        self.halt("STOPPED", &reason);
        let clients = self.0.clients.clone();
        owned(tokio::spawn(async move {
            Ok(clients.stop_everything(&reason).await?)
        }))
    }

    /// Interrupts what is under way because the gateway ends; resolves when it is written.
    pub async fn leave(&self) {
        self.halt("GATEWAY_STOPPING", "the gateway was told to end");
        self.halted().await;
        if let Err(error) = self.0.journal.leave().await {
            // Its lease runs out.
            tracing::warn!(%error, "command was not given up");
        }
    }

    /// Resolves when nothing is under way.
    async fn halted(&self) {
        if let Some(published) = self.publisher() {
            let mut watching = published.subscribe();
            drop(published);
            // An error means that the owner is gone, which is what is waited for.
            watching
                .wait_for(|procedure| !procedure.state.is_under_way())
                .await
                .ok();
        }
    }

    /// Procedures, newest first.
    pub async fn list(&self, page: &Page) -> Result<Vec<Procedure>> {
        if let Some(procedure_id) = &page.after
            && self.0.journal.procedure(procedure_id).await?.is_none()
        {
            return Err(Error::page_token(procedure_id));
        }
        let mut procedures = self.0.journal.procedures(page).await?;
        if let Some(open) = self.latest() {
            for procedure in &mut procedures {
                if procedure.id == open.id {
                    procedure.clone_from(&open);
                }
            }
        }
        Ok(procedures)
    }

    /// A procedure with its journal.
    pub async fn report(&self, procedure_id: &str) -> Result<Report> {
        Ok(Report {
            procedure: self.get(procedure_id).await?,
            steps: self.0.journal.steps(procedure_id).await?,
            bites: self.0.journal.bite_outcomes(procedure_id).await?,
        })
    }

    /// The procedure as it goes on. The sender is dropped when the procedure is over.
    pub async fn watch(&self, procedure_id: &str) -> Result<watch::Receiver<Procedure>> {
        if let Some(published) = self.publisher()
            && published.borrow().id == procedure_id
        {
            return Ok(published.subscribe());
        }
        Ok(watch::channel(self.get(procedure_id).await?).1)
    }

    /// The procedure as it stands. An open one is not read from the journal.
    pub async fn get(&self, procedure_id: &str) -> Result<Procedure> {
        match self.latest() {
            Some(open) if open.id == procedure_id => Ok(open),
            _ => self
                .0
                .journal
                .procedure(procedure_id)
                .await?
                .ok_or_else(|| Error::UnknownProcedure(procedure_id.to_owned())),
        }
    }

    /// The procedure, if the machine has a row for `event` where it stands.
    async fn admitted(&self, procedure_id: &str, event: Event) -> Result<Procedure> {
        let procedure = self.get(procedure_id).await?;
        procedure.after(event)?;
        Ok(procedure)
    }

    /// Passes a wish on; one that has been overtaken by an abort or stop is refused. Waits for nothing while the procedure
    /// is the open one.
    async fn wish(&self, procedure_id: &str, wish: Wish) -> Result<Procedure> {
        let event = wish.event();
        let procedure = self.admitted(procedure_id, event).await?;
        let taken = match &*self.open() {
            Some(open) if open.published.borrow().id == procedure_id => {
                open.wish.send_if_modified(|current| {
                    let taken = wish.overrides(current);
                    if taken {
                        *current = wish;
                    }
                    taken
                })
            }
            _ => false,
        };
        if taken {
            return Ok(procedure);
        }
        // An abort or stop has been taken and is not carried out yet.
        let mut overtaken = procedure;
        overtaken.state = State::Aborting;
        Err(match overtaken.after(event) {
            Err(refusal) => refusal,
            Ok(state) => Error::WrongState {
                procedure_id: overtaken.id,
                state,
                needed: "not stopping".to_owned(),
            },
        })
    }

    /// Counted first: a procedure that opens after this line sees the count, one that is open before gets the wish.
    fn halt(&self, reason: &'static str, detail: &str) {
        self.0.stops.fetch_add(1, Ordering::SeqCst);
        if let Some(open) = &*self.open() {
            open.wish
                .send_replace(Wish::Stop(reason, detail.to_owned()));
        }
    }

    /// How many stops there were.
    fn stops(&self) -> u64 {
        self.0.stops.load(Ordering::SeqCst)
    }

    /// Hands the procedure to a task that owns it. It halts before its first step if a stop came after `stops_before`.
    fn launch(
        &self,
        stops_before: u64,
        procedure: Procedure,
        steps: Vec<Planned>,
        performer: Performer,
        published: watch::Sender<Procedure>,
        end: Event,
    ) {
        if let Some(recorder) = self.0.recorder.get() {
            recorder.follow(published.subscribe());
        }
        let wish = watch::Sender::new(Wish::Run);
        let run = Run {
            steps: steps.into(),
            approval: Box::new(StillApproved {
                cases: self.0.cases.clone(),
                case_id: procedure.case_id.clone(),
                digest: procedure.plan_digest,
            }),
            procedure,
            performer,
            clients: self.0.clients.clone(),
            journal: self.0.journal.clone(),
            rules: self.0.rules,
            published: published.clone(),
            wish: wish.subscribe(),
            obeyed: Wish::Run,
            end,
            unwritten: None,
        };
        let mut open = self.open();
        let followed = open
            .as_ref()
            .is_some_and(|open| open.published.same_channel(&published));
        if !followed {
            tokio::spawn(witness::follow(self.0.audit.clone(), published.subscribe()));
        }
        if self.stops() != stops_before {
            wish.send_replace(Wish::Stop(
                "STOPPED",
                "a stop came before the first step".to_owned(),
            ));
        }
        *open = Some(Open {
            published: published.clone(),
            wish,
        });
        drop(open);
        let this = self.clone();
        tokio::spawn(async move {
            if tokio::spawn(run.run()).await.is_err() {
                this.own_failed(&published).await;
            }
            this.record_standing(&published);
            let mut open = this.open();
            // By now a next procedure may be open.
            if open.as_ref().is_some_and(|open| {
                open.published.same_channel(&published) && published.borrow().state.is_over()
            }) {
                *open = None;
            }
        });
    }

    /// Records where the arms stand once they are seen, while the procedure waits for its operator.
    fn record_standing(&self, published: &watch::Sender<Procedure>) {
        let procedure = published.borrow().clone();
        if procedure.state != State::Interrupted {
            return;
        }
        let published = published.clone();
        let sequence = standing::sequence(&procedure);
        let halted = move || {
            let now = published.borrow();
            now.state == State::Interrupted && standing::sequence(&now) == sequence
        };
        let (journal, clients) = (self.0.journal.clone(), self.0.clients.clone());
        tokio::spawn(standing::record_when_seen(
            journal, clients, procedure, halted,
        ));
    }

    /// The owner ended without a word: its state is not known, so everything stops.
    async fn own_failed(&self, published: &watch::Sender<Procedure>) {
        let mut procedure = published.borrow().clone();
        procedure.interrupt(&Interruption {
            reason: "SEQUENCER_FAILED".to_owned(),
            detail: "the owner of the procedure ended unexpectedly".to_owned(),
            acted: Acted::Perhaps,
        });
        if let Err(failure) = self.0.clients.stop_everything(&procedure.reason).await {
            tracing::error!(%failure, "not every device confirmed the stop");
        }
        let written = match &procedure.step {
            Some(step) => self.0.journal.end_step(&procedure, step, None).await,
            None => self.0.journal.save_procedure(&procedure).await,
        };
        if let Err(error) = written {
            tracing::error!(%error, "the interruption was not journalled");
        }
        published.send_replace(procedure);
    }

    fn open(&self) -> MutexGuard<'_, Option<Open>> {
        // Nothing panics while it is held, and what it guards is whole at any time.
        self.0.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn publisher(&self) -> Option<watch::Sender<Procedure>> {
        self.open().as_ref().map(|open| open.published.clone())
    }

    fn latest(&self) -> Option<Procedure> {
        self.open()
            .as_ref()
            .map(|open| open.published.borrow().clone())
    }
}

/// Whether a plan is still approved, asked before each bite.
struct StillApproved {
    cases: Cases,
    case_id: String,
    digest: Digest,
}

#[tonic::async_trait]
impl Approval for StillApproved {
    async fn check(&self) -> Result<()> {
        self.cases
            .still_approved(&self.case_id, self.digest)
            .await
            .map(drop)
    }
}

/// The outcome of a task that goes on without its caller.
async fn owned<T>(task: tokio::task::JoinHandle<Result<T>>) -> Result<T> {
    match task.await {
        Ok(outcome) => outcome,
        Err(error) => match error.try_into_panic() {
            Ok(panic) => std::panic::resume_unwind(panic),
            // Only the end of the runtime cancels these tasks.
            Err(_) => std::future::pending().await,
        },
    }
}
