//! Watching a procedure, striking what is due, and bringing back what was struck.

use std::time::Duration;

use arthro_proto::gateway::v1::{ProcedureState, Step, StepKind, StepState, WatchProcedureRequest};
use rand::Rng as _;

use super::{Campaign, Halt, is_gone, word};
use crate::Result;
use crate::strike::{AtStep, Moment, Victim};
use crate::tally::Outcome;
use crate::world::Cut;

/// Without a word of the procedure for so long, wall time, something hangs.
const SILENCE: Duration = Duration::from_secs(90);
/// A step whose length is not known yet is taken for so long, cell time.
const STEP_S: f64 = 1.0;

impl Campaign<'_> {
    /// Watches a procedure and strikes what is due, until it halts.
    pub(super) async fn follow(&mut self, procedure_id: &str) -> Result<Halt> {
        let request = WatchProcedureRequest {
            procedure_id: procedure_id.to_owned(),
            ..WatchProcedureRequest::default()
        };
        let mut states = match self.world.procedures()?.watch_procedure(request).await {
            Ok(states) => states.into_inner(),
            Err(status) if is_gone(&status) => return Ok(Halt::GatewayDied),
            Err(status) => return Err(status.into()),
        };
        let mut before: Option<Step> = None;
        loop {
            let message = match tokio::time::timeout(SILENCE, states.message()).await? {
                Ok(Some(message)) => message,
                Ok(None) | Err(_) => return Ok(Halt::GatewayDied),
            };
            let procedure = message.procedure.ok_or("a message without procedure")?;
            match procedure.state() {
                ProcedureState::Completed | ProcedureState::Aborted => {
                    let last = before.as_ref().or(procedure.step.as_ref());
                    if let Some(step) = last.cloned() {
                        self.strike_at_the_end(&step).await?;
                    }
                    return Ok(Halt::Over);
                }
                ProcedureState::Interrupted => return Ok(Halt::Interrupted(procedure.into())),
                _ => {}
            }
            let Some(step) = procedure.step else {
                continue;
            };
            for (kind, moment) in moments(before.as_ref(), &step) {
                while let Some(at) = self.schedule.take(kind, moment) {
                    let cut = self.strike(at, &step).await?;
                    if at.victim.is_needed() {
                        return Ok(Halt::Struck(at, cut));
                    }
                    self.world.service(at.victim)?.start().await?;
                    self.tally
                        .blow(at.victim.name(), &word(kind), Outcome::WentOn);
                }
            }
            before = Some(step);
        }
    }

    async fn strike(&mut self, at: AtStep, step: &Step) -> Result<Option<Cut>> {
        if at.moment == Moment::Middle {
            let length_s = self.lengths_s.get(&step.kind).copied().unwrap_or(STEP_S);
            let into_s = length_s * self.rng.random_range(0.1..0.9);
            let reached = self
                .world
                .controller_time(step.started_controller_s + into_s);
            tokio::time::timeout(SILENCE, reached).await??;
        }
        self.last_blow = format!(
            "{} at {} of {} {}",
            at.victim.name(),
            at.moment.name(),
            word(at.kind),
            step.sequence
        );
        if at.victim.is_process() {
            self.world.service(at.victim)?.kill().await?;
            return Ok(None);
        }
        Ok(Some(self.world.cut(at.victim).await?))
    }

    /// What was due at the end of the last step is struck when the procedure is over.
    async fn strike_at_the_end(&mut self, last: &Step) -> Result<()> {
        while let Some(at) = self.schedule.take(last.kind(), Moment::End) {
            let cut = self.strike(at, last).await?;
            self.bring_back(at, cut, false).await?;
            self.tally
                .blow(at.victim.name(), &word(at.kind), Outcome::WentOn);
        }
        Ok(())
    }

    /// Brings back what was struck, early or late, and waits until everything rests. Whether the procedure is over.
    pub(super) async fn after_blow(
        &mut self,
        procedure_id: &str,
        at: AtStep,
        cut: Option<Cut>,
    ) -> Result<bool> {
        let early = self.rng.random_bool(0.5);
        if at.victim.is_process() && early {
            self.world.service(at.victim)?.start().await?;
        }
        if at.victim != Victim::Gateway {
            match self.follow_to_halt(procedure_id).await? {
                Halt::Over => {
                    self.bring_back(at, cut, early).await?;
                    self.tally
                        .blow(at.victim.name(), &word(at.kind), Outcome::WentOn);
                    return Ok(true);
                }
                Halt::Interrupted(_) => {}
                _ => return Err("the gateway ended by itself".into()),
            }
        }
        let rest = self.rest().await?;
        self.bring_back(at, cut, early).await?;
        self.hold(&rest).await?;
        Ok(false)
    }

    async fn bring_back(&mut self, at: AtStep, cut: Option<Cut>, early: bool) -> Result<()> {
        if let Some(cut) = cut {
            self.world.mend(cut).await?;
        }
        if at.victim.is_process() && !early {
            self.world.service(at.victim)?.start().await?;
        }
        Ok(())
    }

    /// The same without blows.
    async fn follow_to_halt(&mut self, procedure_id: &str) -> Result<Halt> {
        let kept = std::mem::take(self.schedule);
        let halt = self.follow(procedure_id).await;
        *self.schedule = kept;
        halt
    }
}

/// The moments that have come between two messages. A message may tell of the next step without having told of the end of
/// the last.
fn moments(before: Option<&Step>, now: &Step) -> Vec<(StepKind, Moment)> {
    let mut moments = Vec::new();
    if let Some(before) = before.filter(|before| before.state() == StepState::Intended)
        && (before.sequence != now.sequence || now.state() == StepState::Done)
    {
        moments.push((before.kind(), Moment::End));
    }
    let is_new = before.is_none_or(|before| before.sequence != now.sequence);
    if is_new && now.state() == StepState::Intended {
        moments.push((now.kind(), Moment::Begin));
        moments.push((now.kind(), Moment::Middle));
    }
    moments
}
