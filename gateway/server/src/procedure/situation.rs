//! What an operator is told of a halted procedure before deciding: where arms and jaw are, what is in
//! doubt, what the plan says is gone, and which decisions are open.

use std::sync::Arc;

use arthro_proto::planning::v1::ResectionPlan;
use prost::Message as _;

use crate::cases::Cases;
use crate::clients::Clients;
use crate::clients::instrument::Axes;
use crate::clients::motion::{Arm, ArmState, Arms, Standing};
use crate::config::{Cell, Rules};
use crate::error::{Error, Result};
use crate::journal::Journal;
use crate::procedure::recovery::{self, Action};
use crate::procedure::safety::{self, Placement};
use crate::procedure::steps::{Kind, Step, StepState};
use crate::procedure::{Procedure, standing};

/// All that is known.
#[derive(Clone, Debug)]
pub struct Situation {
    /// As it stands.
    pub procedure: Procedure,
    /// Both arms; empty while the motion service does not answer.
    pub arms: Vec<ArmSituation>,
    /// The drives; unset while the instrument service does not answer.
    pub axes: Option<Axes>,
    /// Why a service does not answer.
    pub unanswered: Vec<String>,
    /// By the plan's figures.
    pub tissue: Tissue,
    /// One an action.
    pub choices: Vec<Choice>,
    /// Whether the latest step is a bite whose outcome nobody knows.
    pub in_doubt: bool,
}

/// One arm now, and where it stood.
#[derive(Clone, Debug)]
pub struct ArmSituation {
    /// Which.
    pub arm: Arm,
    /// As measured now.
    pub state: ArmState,
    /// Whether the motion service has a portal for it.
    pub has_portal: bool,
    /// To the calibrated portal; unset without calibration.
    pub placement: Option<Placement>,
    /// Where it stood when the procedure was halted, and when that was seen.
    pub stood: Option<Standing>,
}

/// Tissue by the plan's own figures, mm3.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tissue {
    /// By all bites.
    pub planned_mm3: f64,
    /// By those that are done.
    pub removed_mm3: f64,
    /// By the one in doubt.
    pub in_doubt_mm3: f64,
}

/// Whether a decision would be taken now.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Which.
    pub action: Action,
    /// Stable word and text; unset when it would be.
    pub why_not: Option<(String, String)>,
    /// Only if faults are acknowledged with it.
    pub needs_recover_faults: bool,
}

/// Both device services' answers.
#[derive(Clone, Debug)]
pub struct Looked {
    /// The arms.
    pub arms: Arms,
    /// The drives.
    pub axes: Axes,
}

impl Looked {
    /// Refused with FAULT_LATCHED while a fault waits for its acknowledgement.
    pub fn no_faults(&self) -> Result<()> {
        let faults = safety::faults(&self.arms, &self.axes);
        if faults.is_empty() {
            return Ok(());
        }
        Err(Error::FaultsLatched { faults })
    }
}

/// Refused with POSE_MOVED or POSE_UNKNOWN unless the arms stand where they stood.
pub async fn stands(
    journal: &Arc<dyn Journal>,
    rules: &Rules,
    procedure: &Procedure,
    looked: &Looked,
) -> Result<()> {
    let stood = standing::recorded(journal, procedure, &looked.arms).await?;
    safety::stand_where_they_stood(&stood, &looked.arms, rules)
}

/// Asks both devices and the journal. A device that does not answer leaves its part empty.
pub async fn look(
    journal: &Arc<dyn Journal>,
    cases: &Cases,
    clients: &Clients,
    rules: &Rules,
    procedure: Procedure,
) -> Result<Situation> {
    let steps = journal.steps(&procedure.id).await?;
    let (motion, axes) = tokio::join!(
        async {
            let arms = clients.motion.arms().await?;
            let forceps = clients.motion.has_portal(Arm::Forceps).await?;
            let arthroscope = clients.motion.has_portal(Arm::Arthroscope).await?;
            Ok((arms, [forceps, arthroscope]))
        },
        clients.instrument.axes(),
    );
    let motion: Result<_, crate::clients::Failure> = motion;
    let unanswered: Vec<String> = [
        motion.as_ref().err().map(ToString::to_string),
        axes.as_ref().err().map(ToString::to_string),
    ]
    .into_iter()
    .flatten()
    .collect();
    let (motion, axes) = (motion.ok(), axes.ok());
    let looked = motion.as_ref().zip(axes.as_ref());
    let looked = looked.map(|((arms, _), axes)| Looked {
        arms: arms.clone(),
        axes: axes.clone(),
    });
    let mut choices = Vec::new();
    for action in Action::ALL {
        let refusal = why_not(
            journal,
            cases,
            rules,
            &procedure,
            &steps,
            looked.as_ref(),
            *action,
        )
        .await;
        choices.push(Choice {
            action: *action,
            why_not: refusal.map(|error| (error.reason().to_owned(), crate::error::chain(&error))),
            needs_recover_faults: looked
                .as_ref()
                .is_some_and(|looked| looked.no_faults().is_err()),
        });
    }
    if let (Some(first), None) = (unanswered.first(), &looked) {
        for choice in &mut choices {
            let reason = "DEVICE_UNANSWERED".to_owned();
            choice.why_not.get_or_insert((reason, first.clone()));
        }
    }
    // After the choices, which record where the arms stand if nobody did before.
    let sequence = standing::sequence(&procedure);
    let stood = journal.standing(&procedure.id, sequence).await?;
    let cell = cases.cell().ok();
    let arms = motion.map_or_else(Vec::new, |(arms, has_portal)| {
        arms_of(&arms, has_portal, cell.as_deref(), stood)
    });
    let case = cases.get(&procedure.case_id).await?;
    let executed = cases.plan_digest(&case) == Some(procedure.plan_digest);
    let plan = case.plan.filter(|_| executed);
    let plan = plan.map(|plan| plan.encoded).unwrap_or_default();
    Ok(Situation {
        tissue: tissue(&plan, &steps, procedure.bites_done),
        in_doubt: procedure.step.as_ref().is_some_and(recovery::in_doubt),
        procedure,
        arms,
        axes,
        unanswered,
        choices,
    })
}

/// The refusal that a decision would meet, acknowledged and with faults acknowledged.
async fn why_not(
    journal: &Arc<dyn Journal>,
    cases: &Cases,
    rules: &Rules,
    procedure: &Procedure,
    steps: &[Step],
    looked: Option<&Looked>,
    action: Action,
) -> Option<Error> {
    if let Err(refusal) = procedure.after(action.event()) {
        return Some(refusal);
    }
    if action == Action::Withdraw {
        return None;
    }
    if let Err(refusal) = cases
        .approved(&procedure.case_id, procedure.plan_digest)
        .await
    {
        return Some(refusal);
    }
    if action == Action::MarkDone && !recovery::was_begun(steps, procedure.next_bite) {
        return Some(Error::NoBiteInterrupted {
            procedure_id: procedure.id.clone(),
        });
    }
    stands(journal, rules, procedure, looked?).await.err()
}

fn arms_of(
    arms: &Arms,
    has_portal: [bool; 2],
    cell: Option<&Cell>,
    stood: Option<Standing>,
) -> Vec<ArmSituation> {
    Arm::ALL
        .iter()
        .zip(has_portal)
        .map(|(arm, has_portal)| {
            let state = arms.get(*arm).clone();
            ArmSituation {
                arm: *arm,
                placement: cell.map(|cell| Placement::of(&state.base_from_tool, cell.portal(*arm))),
                state,
                has_portal,
                stood: stood.clone(),
            }
        })
        .collect()
}

/// What the plan's account says of the bites taken. A bite counts once, however often it was repeated; a plan that has no
/// account tells nothing.
fn tissue(plan: &[u8], steps: &[Step], bites_done: u32) -> Tissue {
    let accounts = ResectionPlan::decode(plan)
        .ok()
        .and_then(|plan| plan.evaluation)
        .map(|evaluation| evaluation.accounts)
        .unwrap_or_default();
    let volumes = (0u32..).zip(
        accounts
            .iter()
            .map(|account| account.region_mm3 + account.outside_mm3),
    );
    let in_doubt = |bite: u32| {
        steps
            .iter()
            .rev()
            .find(|step| step.planned.kind == Kind::Bite && step.planned.bite == Some(bite))
            .is_some_and(|step| step.state == StepState::InDoubt)
    };
    let mut tissue = Tissue::default();
    for (bite, mm3) in volumes {
        tissue.planned_mm3 += mm3;
        if bite < bites_done {
            tissue.removed_mm3 += mm3;
        } else if in_doubt(bite) {
            tissue.in_doubt_mm3 += mm3;
        }
    }
    tissue
}

#[cfg(test)]
mod tests {
    use arthro_proto::planning::v1::{BiteAccount, ResectionEvaluation};

    use super::*;
    use crate::procedure::steps::Planned;

    fn plan() -> Vec<u8> {
        let account = |region_mm3, outside_mm3| BiteAccount {
            region_mm3,
            outside_mm3,
            ..BiteAccount::default()
        };
        ResectionPlan {
            evaluation: Some(ResectionEvaluation {
                accounts: vec![account(5.0, 1.0), account(4.0, 0.0), account(3.0, 0.5)],
                ..ResectionEvaluation::default()
            }),
            ..ResectionPlan::default()
        }
        .encode_to_vec()
    }

    fn bite(bite: u32, state: StepState) -> Step {
        Step {
            sequence: bite + 1,
            planned: Planned {
                kind: Kind::Bite,
                bite: Some(bite),
            },
            state,
            operation_id: String::new(),
            intended_at_ms: 0,
            ended_at_ms: None,
            started_controller_s: 0.0,
            ended_controller_s: None,
            detail: String::new(),
        }
    }

    #[test]
    fn tissue_of_a_bite_in_doubt_is_neither_gone_nor_there() {
        let steps = [bite(0, StepState::Done), bite(1, StepState::InDoubt)];
        assert_eq!(
            tissue(&plan(), &steps, 1),
            Tissue {
                planned_mm3: 13.5,
                removed_mm3: 6.0,
                in_doubt_mm3: 4.0
            }
        );
    }

    #[test]
    fn the_latest_word_on_a_repeated_bite_counts() {
        let steps = [
            bite(0, StepState::Resolved),
            bite(1, StepState::InDoubt),
            bite(1, StepState::Failed),
        ];
        assert_eq!(tissue(&plan(), &steps, 1).in_doubt_mm3, 0.0);
    }

    #[test]
    fn a_plan_without_figures_tells_nothing() {
        assert_eq!(
            tissue(&[], &[bite(0, StepState::Done)], 1),
            Tissue::default()
        );
    }
}
