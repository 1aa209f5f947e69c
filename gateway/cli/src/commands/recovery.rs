//! What is known of a halted procedure, as JSON.

use arthro_proto::gateway::v1::{ArmSituation, GetRecoveryResponse, RecoveryChoice};
use serde_json::{Value, json};

use super::show;

/// One object, flat enough for a table.
pub fn show(recovery: &GetRecoveryResponse) -> Value {
    let tissue = recovery.tissue.unwrap_or_default();
    let drives = recovery.drives.clone().unwrap_or_default();
    json!({
        "procedure": recovery.procedure.as_ref().map(show::procedure),
        "in_doubt": recovery.in_doubt,
        "arms": recovery.arms.iter().map(arm).collect::<Vec<_>>(),
        "jaw": drives.jaw,
        "drive_faults": drives
            .faults
            .iter()
            .map(|fault| json!({"axis": fault.axis, "reason": fault.reason, "detail": fault.detail}))
            .collect::<Vec<_>>(),
        "unreferenced": drives.unreferenced,
        "unanswered": recovery.unanswered,
        "tissue_mm3": {
            "planned": tissue.planned_mm3,
            "removed": tissue.removed_mm3,
            "in_doubt": tissue.in_doubt_mm3,
        },
        "choices": recovery.choices.iter().map(choice).collect::<Vec<_>>(),
    })
}

fn arm(arm: &ArmSituation) -> Value {
    let tip = arm
        .base_from_tool
        .as_ref()
        .and_then(|pose| pose.translation.as_ref())
        .map(|tip| [tip.x_mm, tip.y_mm, tip.z_mm]);
    json!({
        "arm": arm.arm().as_str_name().trim_start_matches("ARM_"),
        "tip_mm": tip,
        "depth_mm": arm.depth_mm,
        "off_portal_mm": arm.off_portal_mm,
        "has_portal": arm.has_portal,
        "connected": arm.connected,
        "moving": arm.moving,
        "moved_mm": arm.moved_mm,
        "moved_deg": arm.moved_deg,
        "fault": arm.fault_reason,
        "fault_detail": arm.fault_detail,
    })
}

fn choice(choice: &RecoveryChoice) -> Value {
    json!({
        "action": choice.action().as_str_name().trim_start_matches("RECOVERY_ACTION_"),
        "allowed": choice.allowed,
        "reason": choice.reason,
        "detail": choice.detail,
        "needs_recover_faults": choice.needs_recover_faults,
    })
}
