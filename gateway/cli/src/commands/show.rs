//! Answers of the gateway as JSON for programs and as lines for people.

use arthro_proto::gateway::v1::{Case, Procedure};
use arthro_proto::planning::v1::{ResectionEvaluation, ResectionPlan};
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
    value["seconds"] = json!(plan.seconds);
    value
}

pub fn evaluation(evaluation: &ResectionEvaluation) -> Value {
    json!({
        "lesion_mm3": evaluation.lesion_mm3,
        "lesion_covered_percent": evaluation.lesion_covered_percent,
        "region_mm3": evaluation.region_mm3,
        "region_covered_percent": evaluation.region_covered_percent,
        "healthy_removed_mm3": evaluation.healthy_removed_mm3,
        "outside_removed_mm3": evaluation.outside_removed_mm3,
        "rim_min_mm": evaluation.rim_min_mm,
        "rim_mean_mm": evaluation.rim_mean_mm,
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
        } else {
            lines.push(format!("{indent}{key:width$}  {}", text(value)));
        }
    }
}

fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => match number.as_f64() {
            Some(float) if number.is_f64() => format!("{float:.3}"),
            _ => number.to_string(),
        },
        Value::Array(items) => items.iter().map(text).collect::<Vec<_>>().join(", "),
        Value::Null => "-".to_owned(),
        other => other.to_string(),
    }
}
