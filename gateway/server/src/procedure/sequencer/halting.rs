//! A step under way, and how it is brought to stand.
//!
//! A halted step is not dropped: no further command of it leaves, its device is stopped until its
//! operation has ended, and that end is what is known of it. So a bite that was over before the stop
//! came is done and not in doubt, and an arm has come to stand before anything else is asked of it.

use std::time::Duration;

use super::{Interruption, Run, RunClock};
use crate::clients::motion::{Arm, MoveProgress};
use crate::clients::{Acted, Clients};
use crate::procedure::perform::{Commanded, Performed, StepError};
use crate::procedure::steps::{Effect, Planned};
use crate::procedure::wish::{self, Wish};

/// A stop that ended nothing is given again after this time: it may have come before the command that it was for.
const STOP_AGAIN: Duration = Duration::from_millis(200);
/// An operation that a stop does not end within this time belongs to the operator.
const HALT_LIMIT: Duration = Duration::from_secs(5);

/// How a step ended otherwise than it was meant to.
pub(super) enum Ended {
    /// Halted by a wish, nothing lost: it can be done again.
    Halted(Wish),
    /// The procedure cannot go on without a decision.
    Interrupted(Interruption),
}

impl Run {
    /// Performs the step until it ends, the leases are lost, or the operator halts it.
    pub(super) async fn perform(
        &mut self,
        planned: Planned,
        operation_id: &str,
        clock: RunClock,
    ) -> Result<Performed, Ended> {
        let Self {
            performer,
            clients,
            wish,
            obeyed,
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
        let performing = performer.perform(planned, operation_id, &mut watch);
        tokio::pin!(performing);
        let halt = tokio::select! {
            biased;
            halt = wish::halted(wish, obeyed) => halt,
            failure = performer.command().lost() => return Err(Ended::lost(failure)),
            performed = &mut performing => return performed.map_err(Ended::failed),
        };
        let commanded = performer.halt();
        let ended = tokio::select! {
            biased;
            ended = &mut performing => Some(ended),
            failure = performer.command().lost() => return Err(Ended::lost(failure)),
            () = keep_stopping(clients, commanded, halt.why().1) => None,
            () = tokio::time::sleep(HALT_LIMIT) => None,
        };
        ended_by(halt, planned, ended)
    }
}

/// What a halted step has come to.
fn ended_by(
    halt: Wish,
    planned: Planned,
    ended: Option<Result<Performed, StepError>>,
) -> Result<Performed, Ended> {
    let error = match ended {
        Some(Ok(performed)) => return Ok(performed),
        Some(Err(error)) => Some(error),
        None => None,
    };
    let acted = error.as_ref().map_or(Acted::Perhaps, StepError::acted);
    if let Wish::Stop(reason, detail) = halt {
        return Err(Ended::Interrupted(Interruption {
            acted,
            ..Interruption::stopped(reason, detail)
        }));
    }
    let Some(error) = error else {
        return Err(Ended::Interrupted(Interruption {
            reason: "HALT_NOT_CONFIRMED".to_owned(),
            detail: format!(
                "the step did not end within {} s of its stop",
                HALT_LIMIT.as_secs_f64()
            ),
            acted,
        }));
    };
    if !error.was_halted() {
        return Err(Ended::failed(error));
    }
    if planned.kind.effect() == Effect::Irreversible && acted == Acted::Perhaps {
        return Err(Ended::Interrupted(Interruption {
            reason: "BITE_HALTED".to_owned(),
            detail: format!(
                "{} while the jaw closed; nobody knows how far it came: {error}",
                halt.why().1
            ),
            acted,
        }));
    }
    Err(Ended::Halted(halt))
}

/// Stops the device that has a command under way, again and again. The other one is left as it is: a stop of the drives
/// would let go of what the jaw holds.
async fn keep_stopping(clients: &Clients, commanded: Commanded, why: &str) {
    loop {
        let stopped = match commanded {
            Commanded::Nothing => Ok(()),
            Commanded::Arms => clients.motion.stop(why).await,
            Commanded::Drives => clients.instrument.stop(why).await,
        };
        if let Err(failure) = stopped {
            tracing::warn!(%failure, "a halted step's device did not confirm its stop");
        }
        tokio::time::sleep(STOP_AGAIN).await;
    }
}

impl Ended {
    /// Command was lost while the step was under way.
    fn lost(failure: crate::clients::Failure) -> Self {
        Self::Interrupted(Interruption {
            acted: Acted::Perhaps,
            ..failure.into()
        })
    }

    /// The step ended otherwise by itself.
    fn failed(error: StepError) -> Self {
        Self::Interrupted(Interruption {
            reason: error.reason().to_owned(),
            detail: error.to_string(),
            acted: error.acted(),
        })
    }
}
