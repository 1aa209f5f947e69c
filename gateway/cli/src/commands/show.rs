//! Answers of the gateway as JSON for programs and as lines for people.

use arthro_proto::gateway::v1::{Case, Procedure};
use arthro_proto::planning::v1::{BiteAccount, Planner, ResectionEvaluation, ResectionPlan};
use arthro_proto::registration::v1::RegistrationResult;
use serde_json::{Value, json};

use crate::gateway::state_word;

/// A case's state as one word.
pub fn case_state(case: &Case) -> &'static str {
    case.state().as_str_name().trim_start_matches("CASE_STATE_")
}

pub fn case(case: &Case) -> Value {
    json!({
        "case_id": case.case_id,
        "label": case.label,
        "state": case_state(case),
        "model_digest": case.model_digest,
        "scene_digest": case.scene_digest,
        "plan_digest": case.plan_digest,
        "approved_by": case.approved_by,
        "approved_digest": case.approved_digest,
        "approvals": case.approvals.iter().map(|approval| json!({
            "name": approval.name,
            "role": approval.role,
            "at_ms": approval.at_ms,
        })).collect::<Vec<_>>(),
        "approvals_needed": case.approvals_needed,
    })
}

pub fn registration(result: &RegistrationResult) -> Value {
    let transform = result.camera_from_ct.unwrap_or_default();
    let rotation = transform.rotation.unwrap_or_default();
    let translation = transform.translation.unwrap_or_default();
    json!({
        "scale": transform.scale,
        "rotation_wxyz": [rotation.w, rotation.x, rotation.y, rotation.z],
        "translation_mm": [translation.x_mm, translation.y_mm, translation.z_mm],
        "mse_mm2": result.mse_mm2,
        "coarse_mse_mm2": result.coarse_mse_mm2,
        "inlier_share": result.inlier_share,
        "overlap": result.overlap,
        "tre_predicted_mm": result.tre_predicted_mm,
        "ambiguity": result.ambiguity,
        "mirror": result.mirror,
        "misfit": result.misfit,
        "verdict": result.verdict().as_str_name().trim_start_matches("VERDICT_"),
        "reasons": result.reasons,
        "seconds": result.seconds,
    })
}

pub fn plan(plan: &ResectionPlan) -> Value {
    let mut value = plan
        .evaluation
        .as_ref()
        .map_or_else(|| json!({}), evaluation);
    value["targets"] = json!(plan.bites.len());
    value["views"] = json!(plan.views.len());
    value["seconds"] = json!(plan.seconds);
    value["planner"] = json!(planner(plan));
    if plan.planner() == Planner::Bites {
        value["bound"] = json!(plan.bound);
        value["complete"] = json!(plan.complete);
        value["ended"] = json!(ended(plan));
    }
    value
}

/// Who planned, as one word.
pub fn planner(plan: &ResectionPlan) -> &'static str {
    let name = plan.planner().as_str_name();
    name.trim_start_matches("PLANNER_")
}

/// Why the search for fewer bites ended, as one word.
pub fn ended(plan: &ResectionPlan) -> &'static str {
    let name = plan.ended().as_str_name();
    name.trim_start_matches("SEARCH_END_")
}

pub fn evaluation(evaluation: &ResectionEvaluation) -> Value {
    let accounts: Vec<Value> = evaluation.accounts.iter().map(account).collect();
    json!({
        "bites": evaluation.bites,
        "lesion_mm3": evaluation.lesion_mm3,
        "lesion_covered_percent": evaluation.lesion_covered_percent,
        "region_mm3": evaluation.region_mm3,
        "region_covered_percent": evaluation.region_covered_percent,
        "removed_mm3": evaluation.removed_mm3,
        "left_mm3": evaluation.left_mm3,
        "healthy_removed_mm3": evaluation.healthy_removed_mm3,
        "outside_removed_mm3": evaluation.outside_removed_mm3,
        "rim_min_mm": evaluation.rim_min_mm,
        "rim_min_angle_deg": evaluation.rim_min_angle_rad.to_degrees(),
        "rim_mean_mm": evaluation.rim_mean_mm,
        "scallop_rms_mm": evaluation.scallop_rms_mm,
        "scallop_max_mm": evaluation.scallop_max_mm,
        "edge_jumps": evaluation.edge_jumps,
        "predicted_seconds": evaluation.predicted_seconds,
        "order_feasible": evaluation.order_feasible,
        "infeasible_bites": evaluation.infeasible_bites,
        "accounts": accounts,
    })
}

fn account(account: &BiteAccount) -> Value {
    json!({
        "region_mm3": account.region_mm3,
        "outside_mm3": account.outside_mm3,
        "throat_blocked_percent": account.throat_blocked_percent,
        "seconds": account.seconds,
    })
}

pub fn procedure(procedure: &Procedure) -> Value {
    json!({
        "procedure_id": procedure.procedure_id,
        "case_id": procedure.case_id,
        "state": state_word(procedure.state()),
        "plan_digest": procedure.plan_digest,
        "bites_planned": procedure.bites_planned,
        "bites_done": procedure.bites_done,
        "reason": procedure.reason,
        "detail": procedure.detail,
        "robot_seconds": procedure.robot_seconds,
        "rcm_deviation_max_mm": procedure.rcm_deviation_max_mm,
    })
}

/// A JSON object as aligned lines, nested objects indented.
pub fn table(value: &Value) -> String {
    let mut lines = Vec::new();
    push_lines(value, 0, &mut lines);
    lines.join("\n")
}

fn push_lines(value: &Value, depth: usize, lines: &mut Vec<String>) {
    let Some(object) = value.as_object() else {
        lines.push(text(value));
        return;
    };
    let width = object.keys().map(String::len).max().unwrap_or(0);
    let indent = "  ".repeat(depth);
    for (key, value) in object {
        if value.is_object() {
            lines.push(format!("{indent}{key}"));
            push_lines(value, depth + 1, lines);
        } else if let Some(rows) = rows(value) {
            lines.push(format!("{indent}{key}"));
            lines.extend(rows.map(|row| format!("{indent}  {}", text(row))));
        } else {
            lines.push(format!("{indent}{key:width$}  {}", text(value)));
        }
    }
}

/// The items of a list of objects, a line each.
fn rows(value: &Value) -> Option<impl Iterator<Item = &Value>> {
    let items = value.as_array()?;
    items.first()?.is_object().then(|| items.iter())
}

fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => match number.as_f64() {
            Some(float) if number.is_f64() => format!("{float:.3}"),
            _ => number.to_string(),
        },
        Value::Array(items) => items.iter().map(text).collect::<Vec<_>>().join(", "),
        Value::Object(fields) => fields
            .iter()
            .map(|(key, field)| format!("{key} {}", text(field)))
            .collect::<Vec<_>>()
            .join("  "),
        Value::Null => "-".to_owned(),
        other => other.to_string(),
    }
}
