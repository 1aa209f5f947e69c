//! Command as it comes and goes, where several gateways share one journal: whoever comes into command answers for
//! what is open, as interrupted; whoever loses it halts everything and from then on only reads, and stops.

use std::sync::{Arc, Weak};
use std::time::Duration;

use tokio::sync::watch;

use super::{Open, Procedures, Shared};
use crate::audit::witness;
use crate::clients::Acted;
use crate::error::Result;
use crate::journal::Duty;
use crate::procedure::State;
use crate::procedure::sequencer::Interruption;
use crate::procedure::wish::Wish;

/// What could not be taken over is tried again after this time.
const TAKEOVER_PERIOD: Duration = Duration::from_millis(500);

impl Procedures {
    /// Whether this gateway is in command and has taken over what is open; nothing else may be commanded here.
    pub fn duty(&self) -> watch::Receiver<Duty> {
        self.0.duty.subscribe()
    }

    /// Takes over what the journal holds, if this gateway is in command, and follows the journal's duty from then on.
    pub(super) async fn begin(&self) -> Result<()> {
        let mut journals = self.0.journal.duty();
        let now = journals.borrow_and_update().clone();
        if let Duty::InCommand { .. } = now {
            self.take_open("GATEWAY_RESTARTED", "the gateway ended")
                .await?;
        }
        self.0.duty.send_replace(now);
        tokio::spawn(follow(Arc::downgrade(&self.0), journals));
        Ok(())
    }

    /// Answers for every procedure that is not over. One that was under way is interrupted where it stood. Nothing
    /// moves.
    async fn take_open(&self, reason: &str, what: &str) -> Result<()> {
        let journal = &self.0.journal;
        for mut procedure in journal.claim_open().await? {
            if procedure.state.is_under_way() {
                procedure.interrupt(&Interruption {
                    reason: reason.to_owned(),
                    detail: format!("{what} while the procedure was {}", procedure.state),
                    acted: Acted::Perhaps,
                });
                match &procedure.step {
                    Some(step) => journal.end_step(&procedure, step, None).await?,
                    None => journal.save_procedure(&procedure).await?,
                }
                tracing::warn!(
                    procedure_id = procedure.id,
                    reason = procedure.reason,
                    "procedure taken over as interrupted"
                );
            }
            if procedure.state == State::Interrupted {
                let published = watch::Sender::new(procedure);
                tokio::spawn(witness::follow(self.0.audit.clone(), published.subscribe()));
                *self.open() = Some(Open {
                    published: published.clone(),
                    wish: watch::Sender::new(Wish::Run),
                });
                self.record_standing(&published);
            }
        }
        Ok(())
    }

    /// Tries until it is done, or command is lost again.
    async fn come_into_command(&self, now: &Duty) {
        let journals = self.0.journal.duty();
        while *journals.borrow() == *now {
            match self
                .take_open("GATEWAY_REPLACED", "the gateway in command was lost")
                .await
            {
                Ok(()) => {
                    self.0.duty.send_replace(now.clone());
                    return;
                }
                Err(error) => {
                    tracing::error!(error = crate::error::chain(&error), "not taken over yet");
                    tokio::time::sleep(TAKEOVER_PERIOD).await;
                }
            }
        }
    }

    /// Halts what is under way, waits until it has, and forgets it: the journal tells what becomes of it.
    async fn step_back(&self, now: Duty) {
        self.0.duty.send_replace(now);
        let under_way = self.latest().is_some_and(|open| open.state.is_under_way());
        if under_way {
            self.halt("FENCED", "this gateway is no longer in command");
            self.halted().await;
        }
        *self.open() = None;
    }
}

/// Until the journal is closed.
async fn follow(shared: Weak<Shared>, mut journals: watch::Receiver<Duty>) {
    while journals.changed().await.is_ok() {
        let now = journals.borrow_and_update().clone();
        let Some(shared) = shared.upgrade() else {
            return;
        };
        let procedures = Procedures(shared);
        match now {
            Duty::InCommand { .. } => {
                // Between two looks command may have been lost as well as taken.
                procedures.step_back(Duty::nobody()).await;
                procedures.come_into_command(&now).await;
            }
            Duty::Standby { .. } => procedures.step_back(now).await,
        }
    }
}
