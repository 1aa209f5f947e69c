//! The two decisions that set arms in motion: to start an approved plan, and to recover what was
//! interrupted. Both check everything first, take command, write, and only then hand over.

use tokio::sync::watch;
use uuid::Uuid;

use super::Procedures;
use crate::approval::Digest;
use crate::clients::motion::Arm;
use crate::error::{Error, Result};
use crate::procedure::lease::{Command, WhenHeld};
use crate::procedure::machine::{Event, StepEvent};
use crate::procedure::perform::{Performer, Retraction};
use crate::procedure::poses::Poses;
use crate::procedure::recovery::{self, Action, Decision};
use crate::procedure::{Procedure, State, situation, steps};
use crate::wall_clock::now_ms;

impl Procedures {
    pub(super) async fn decide_start(
        &self,
        case_id: String,
        digest: Digest,
        operator: String,
    ) -> Result<Procedure> {
        let stops_before = self.stops();
        let _deciding = self.0.deciding.lock().await;
        if let Some(open) = self.latest().filter(|open| !open.state.is_over()) {
            return Err(Error::ProcedureActive {
                procedure_id: open.id,
                state: open.state,
            });
        }
        let approved = self.0.cases.approved(&case_id, digest).await?;
        let poses = Poses::of(&approved.plan, &approved.registration, &approved.cell)?;
        self.check_reach(&poses).await?;

        let procedure = Procedure {
            id: Uuid::now_v7().to_string(),
            case_id,
            operator,
            state: State::Running,
            plan_digest: digest,
            bites_planned: approved.plan.bites.len() as u32,
            next_bite: 0,
            bites_done: 0,
            step: None,
            reason: String::new(),
            detail: String::new(),
            started_at_ms: now_ms(),
            ended_at_ms: None,
            robot_seconds: 0.0,
            rcm_deviation_max_mm: 0.0,
        };
        let clients = self.0.clients.clone();
        let command =
            Command::acquire(clients.clone(), &holder(&procedure), WhenHeld::Refuse).await?;
        let performer = Performer::new(clients, command, &approved, self.retraction(false))?;
        if let Err(error) = self.0.journal.create_procedure(&procedure).await {
            performer.release().await;
            return Err(error.into());
        }
        let steps = steps::from_bite(0, &poses.view_moves());
        let published = watch::Sender::new(procedure.clone());
        self.launch(
            stops_before,
            procedure.clone(),
            steps,
            performer,
            published,
            Event::Finish,
        );
        Ok(procedure)
    }

    /// Refuses a plan of which any target cannot be reached, before anything moves.
    async fn check_reach(&self, poses: &Poses) -> Result<()> {
        let motion = &self.0.clients.motion;
        let targets: Vec<_> = poses.bites.iter().map(|bite| bite.center).collect();
        let portal = &poses.forceps.portal;
        let checks = motion.check(Arm::Forceps, &targets, portal).await?;
        let unreachable = checks
            .into_iter()
            .enumerate()
            .find(|(_, check)| !check.reachable);
        if let Some((bite, check)) = unreachable {
            return Err(Error::UnreachableBite {
                bite,
                check: check.reason,
                detail: check.detail,
            });
        }
        let portal = &poses.arthroscope.portal;
        let views: Vec<_> = poses.views.iter().map(|view| view.tip(portal)).collect();
        let checks = motion.check(Arm::Arthroscope, &views, portal).await?;
        let unreachable = checks
            .into_iter()
            .enumerate()
            .find(|(_, check)| !check.reachable);
        match unreachable {
            None => Ok(()),
            Some((bite, check)) => Err(Error::UnreachableView {
                bite,
                check: check.reason,
                detail: check.detail,
            }),
        }
    }

    fn retraction(&self, recover_faults: bool) -> Retraction {
        Retraction {
            recover_faults,
            portal_tolerance_mm: self.0.rules.portal_tolerance_mm,
        }
    }

    pub(super) async fn decide_recovery(
        &self,
        procedure_id: String,
        decision: Decision,
    ) -> Result<Procedure> {
        let stops_before = self.stops();
        let _deciding = self.0.deciding.lock().await;
        let action = decision.action;
        let mut procedure = self.admitted(&procedure_id, action.event()).await?;
        if !decision.acknowledged {
            return Err(Error::AcknowledgementNeeded);
        }
        let shared = &*self.0;
        let journal = shared.journal.steps(&procedure_id).await?;
        let (arms, axes) = tokio::join!(
            shared.clients.motion.arms(),
            shared.clients.instrument.axes()
        );
        let looked = situation::Looked {
            arms: arms?,
            axes: axes?,
        };
        if !decision.recover_faults {
            looked.no_faults()?;
        }
        // Whoever goes on biting needs the approval as it was, and the arms where they stood; drawing back needs neither.
        let approved = match action {
            Action::Withdraw => None,
            Action::RepeatBite | Action::MarkDone => {
                let approved = shared
                    .cases
                    .approved(&procedure.case_id, procedure.plan_digest)
                    .await?;
                situation::stands(&shared.journal, &shared.rules, &procedure, &looked).await?;
                Some(approved)
            }
        };
        let cell = shared.cases.cell()?;
        let views = match &approved {
            Some(approved) => {
                Poses::of(&approved.plan, &approved.registration, &approved.cell)?.view_moves()
            }
            None => Vec::new(),
        };
        let recovery = recovery::decide(
            action,
            &journal,
            procedure.next_bite,
            procedure.bites_done,
            &views,
        )
        .ok_or(Error::NoBiteInterrupted { procedure_id })?;

        let clients = shared.clients.clone();
        let holder = holder(&procedure);
        let command = Command::acquire(clients.clone(), &holder, WhenHeld::WaitOneTtl).await?;
        let retraction = self.retraction(decision.recover_faults);
        let performer = match &approved {
            Some(approved) => Performer::new(clients, command, approved, retraction)?,
            None => Performer::for_retreat(clients, command, cell, retraction),
        };

        let all_done = recovery.bites_done == procedure.bites_planned;
        let end = match action {
            Action::Withdraw if all_done => Event::RetreatedDone,
            Action::Withdraw => Event::Retreated,
            Action::RepeatBite | Action::MarkDone => Event::Finish,
        };
        procedure.apply(action.event())?;
        procedure.next_bite = recovery.next_bite;
        procedure.bites_done = recovery.bites_done;
        procedure.reason.clear();
        procedure.detail = format!("{action} by {}", decision.operator);
        if let Err(error) = self.write_decision(&mut procedure, &decision).await {
            performer.release().await;
            return Err(error);
        }
        let published = self
            .publisher()
            .unwrap_or_else(|| watch::Sender::new(procedure.clone()));
        published.send_replace(procedure.clone());
        self.launch(
            stops_before,
            procedure.clone(),
            recovery.steps,
            performer,
            published,
            end,
        );
        Ok(procedure)
    }

    /// Writes the operator's decision. A bite in doubt is resolved by it, except by a withdrawal: then nobody has said
    /// whether the tissue is gone.
    async fn write_decision(&self, procedure: &mut Procedure, decision: &Decision) -> Result<()> {
        let journal = &self.0.journal;
        let Decision {
            action, operator, ..
        } = decision;
        let mut decided = None;
        if let Some(step) = &mut procedure.step
            && *action != Action::Withdraw
            && step.apply(StepEvent::Decided)
        {
            step.detail = format!("{action} by {operator}; was in doubt: {}", step.detail);
            decided = Some(step.clone());
        }
        match decided {
            Some(step) => journal.end_step(procedure, &step, None).await?,
            None => journal.save_procedure(procedure).await?,
        }
        Ok(())
    }
}

fn holder(procedure: &Procedure) -> String {
    format!("gateway, procedure {}", procedure.id)
}
