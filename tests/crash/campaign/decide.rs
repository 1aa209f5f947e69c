//! Both accounts compared, and the operator's decision.

use arthro_proto::gateway::v1::{
    GetReportResponse, ProcedureState, RecoverProcedureRequest, RecoveryAction, StepState,
};
use rand::Rng as _;

use super::{Campaign, is_gone, word};
use crate::Result;
use crate::books::{Books, Difference, interrupted_bite};
use crate::tally::Outcome;

impl Campaign<'_> {
    /// Compares journal and referee, and learns from the journal.
    pub(super) async fn judge(
        &mut self,
        books: &mut Books,
        report: &GetReportResponse,
    ) -> Result<Outcome> {
        for step in &report.steps {
            if step.state() == StepState::Done
                && step.ended_controller_s > step.started_controller_s
            {
                let length_s = step.ended_controller_s - step.started_controller_s;
                self.lengths_s.insert(step.kind, length_s);
            }
        }
        let difference = books.compare(report, self.world.witness.closures().await?);
        self.differ(report, difference);
        let last = report.steps.last();
        if let Some(step) = last.filter(|step| step.state() == StepState::Intended) {
            self.tally.disagreements += 1;
            self.found(format!("{} is still INTENDED", word(step.kind())));
        }
        let in_doubt = last.is_some_and(|step| step.state() == StepState::InDoubt);
        Ok(if in_doubt {
            Outcome::InDoubt
        } else {
            Outcome::Interrupted
        })
    }

    pub(super) fn differ(&mut self, report: &GetReportResponse, difference: Difference) {
        self.tally.bites_lost += difference.lost;
        self.tally.bites_repeated += difference.repeated;
        self.tally.disagreements += difference.disagreements.len() as u32;
        for disagreement in difference.disagreements {
            let steps: Vec<String> = report
                .steps
                .iter()
                .map(|step| {
                    format!(
                        "{} {} {}",
                        word(step.kind()),
                        step.bite,
                        step.state().as_str_name()
                    )
                })
                .collect();
            self.found(format!("{disagreement}; journal: {}", steps.join(", ")));
        }
    }

    pub(super) fn found(&mut self, what: String) {
        let finding = format!("{}, after {}: {what}", self.name, self.last_blow);
        eprintln!("FOUND: {finding}");
        self.tally.findings.push(finding);
    }

    /// The operator knows what is true and mostly decides by it; now and then the bite is given up, or made again.
    pub(super) async fn decide(
        &mut self,
        books: &mut Books,
        report: &GetReportResponse,
        decided: &mut i32,
    ) -> Result<()> {
        let procedure = report
            .procedure
            .as_ref()
            .ok_or("a report without procedure")?;
        if procedure.state() != ProcedureState::Interrupted {
            self.tally.disagreements += 1;
            self.found(format!(
                "{} instead of INTERRUPTED",
                procedure.state().as_str_name()
            ));
        }
        let bite = interrupted_bite(report, *decided);
        let made = books.made(report, bite) > 0;
        let action = match self.rng.random_range(0..20) {
            0 => RecoveryAction::Withdraw,
            1 if made => {
                books.decide_repeat(bite);
                RecoveryAction::RepeatBite
            }
            _ if made => {
                *decided = bite + 1;
                RecoveryAction::MarkDone
            }
            _ => RecoveryAction::RepeatBite,
        };
        self.world.ready().await?;
        let request = RecoverProcedureRequest {
            procedure_id: procedure.procedure_id.clone(),
            action: action.into(),
            operator: "campaign".to_owned(),
            acknowledge: true,
            recover_faults: true,
        };
        match self.world.procedures()?.recover_procedure(request).await {
            Ok(_) => Ok(()),
            // It died in the call; `follow` sees that.
            Err(status) if is_gone(&status) && self.awaited.is_some() => Ok(()),
            Err(status) => Err(format!("{} refused: {status}", action.as_str_name()).into()),
        }
    }
}
