//! What GetRecovery answers.

use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1::{self as proto};

use super::procedure_message;
use crate::clients::instrument::Axes;
use crate::clients::motion::Arm;
use crate::procedure::recovery::Action;
use crate::procedure::safety;
use crate::procedure::situation::{ArmSituation, Choice, Situation};
use crate::wire;

pub(super) fn situation_message(situation: &Situation) -> proto::GetRecoveryResponse {
    let tissue = &situation.tissue;
    proto::GetRecoveryResponse {
        procedure: Some(procedure_message(&situation.procedure)),
        arms: situation.arms.iter().map(arm_message).collect(),
        drives: situation.axes.as_ref().map(drives_message),
        unanswered: situation.unanswered.clone(),
        tissue: Some(proto::TissueEstimate {
            planned_mm3: tissue.planned_mm3,
            removed_mm3: tissue.removed_mm3,
            in_doubt_mm3: tissue.in_doubt_mm3,
        }),
        choices: situation.choices.iter().map(choice_message).collect(),
        in_doubt: situation.in_doubt,
    }
}

fn arm_message(at: &ArmSituation) -> proto::ArmSituation {
    let ArmSituation {
        arm,
        state,
        has_portal,
        placement,
        stood,
    } = at;
    let pose = &state.base_from_tool;
    let before = stood.as_ref().map(|stood| stood.get(*arm));
    let (moved_mm, moved_deg) = before.map_or((0.0, 0.0), |before| safety::moved(before, pose));
    let fault = state.fault.clone().unwrap_or_default();
    proto::ArmSituation {
        arm: match arm {
            Arm::Forceps => common::Arm::Forceps,
            Arm::Arthroscope => common::Arm::Arthroscope,
        }
        .into(),
        base_from_tool: Some(wire::pose_message(&pose.rotation(), &pose.origin())),
        connected: state.connected,
        moving: state.moving,
        has_portal: *has_portal,
        depth_mm: placement.map_or(0.0, |placement| placement.depth_mm),
        off_portal_mm: placement.map_or(0.0, |placement| placement.off_portal_mm),
        fault_reason: fault.reason,
        fault_detail: fault.detail,
        stood: before.map(|before| wire::pose_message(&before.rotation(), &before.origin())),
        stood_at_ms: stood.as_ref().map_or(0, |stood| stood.at_ms),
        moved_mm,
        moved_deg,
    }
}

fn drives_message(axes: &Axes) -> proto::DrivesSituation {
    let fault = |(axis, fault): &(&'static str, crate::clients::Fault)| proto::DriveFault {
        axis: (*axis).to_owned(),
        reason: fault.reason.clone(),
        detail: fault.detail.clone(),
    };
    proto::DrivesSituation {
        jaw: axes.jaw.to_string(),
        faults: axes.faults.iter().map(fault).collect(),
        unreferenced: axes
            .unreferenced()
            .into_iter()
            .map(ToOwned::to_owned)
            .collect(),
    }
}

fn choice_message(choice: &Choice) -> proto::RecoveryChoice {
    let (reason, detail) = choice.why_not.clone().unwrap_or_default();
    proto::RecoveryChoice {
        action: match choice.action {
            Action::Withdraw => proto::RecoveryAction::Withdraw,
            Action::RepeatBite => proto::RecoveryAction::RepeatBite,
            Action::MarkDone => proto::RecoveryAction::MarkDone,
        }
        .into(),
        allowed: choice.why_not.is_none(),
        reason,
        detail,
        needs_recover_faults: choice.needs_recover_faults,
    }
}
