//! Calibrations as JSON for programs and as lines for people.

use arthro_geometry::Rigid;
use arthro_geometry::frame::Frame;
use arthro_geometry::nalgebra::SMatrix;
use arthro_registration::calibration::hand_eye::HandEye;
use arthro_registration::calibration::span::Span;
use arthro_registration::calibration::tool::{Calibrated, Shaft};
use serde_json::{Value, json};

/// A hand-eye calibration; the names are those of its two transforms.
pub fn hand_eye<M: Frame, C: Frame>(found: &HandEye<M, C>, camera: &str, board: &str) -> Value {
    let rejected = rejected(found.residuals.iter().map(|residual| residual.is_rejected));
    let closed = &found.closed_forms;
    let mut value = json!({
        "work_point_deviation_mm": found.work_point_deviation_mm,
        "work_point_jackknife_mm": found.work_point_jackknife_mm,
        "held_out_rms_mm": found.held_out_rms_mm,
        "residual_rms_mm": found.residual_rms.translation_mm,
        "residual_rms_deg": found.residual_rms.rotation_rad.to_degrees(),
        "noise_ratio": found.noise_ratio,
        "poses": found.residuals.len(),
        "rejected": rejected,
        "span": span(&found.span),
        "closed_forms": {
            "park": closed.park.as_ref().map(pose),
            "daniilidis": closed.daniilidis.as_ref().map(pose),
            "shah": closed.shah.as_ref().map(pose),
        },
        "residuals": found.residuals.iter().map(|residual| json!({
            "rotation_deg": residual.rotation_rad.to_degrees(),
            "translation_mm": residual.translation_mm,
            "deviations": residual.deviations,
            "rejected": residual.is_rejected,
        })).collect::<Vec<_>>(),
    });
    value[camera] = pose(&found.mount_from_camera);
    value[format!("{camera}_covariance")] = rows(&found.mount_from_camera_covariance);
    value[board] = pose(&found.carrier_from_board);
    value[format!("{board}_covariance")] = rows(&found.carrier_from_board_covariance);
    value
}

/// A tool's calibration.
pub fn tool(found: &Calibrated) -> Value {
    let tip = &found.tip;
    json!({
        "tip_in_flange_mm": numbers(tip.tip_in_flange.iter()),
        "tip_covariance_mm2": rows(&tip.tip_covariance_mm2),
        "tip_deviation_mm": tip.tip_deviation_mm,
        "divot_in_base_mm": numbers(tip.divot_in_base.iter()),
        "held_out_rms_mm": tip.held_out_rms_mm,
        "residual_rms_mm": tip.residual_rms_mm,
        "noise_ratio": tip.noise_ratio,
        "poses": tip.residuals.len(),
        "rejected": rejected(tip.residuals.iter().map(|residual| residual.is_rejected)),
        "span": span(&tip.span),
        "residuals": tip.residuals.iter().map(|residual| json!({
            "distance_mm": residual.distance_mm,
            "deviations": residual.deviations,
            "rejected": residual.is_rejected,
        })).collect::<Vec<_>>(),
        "shaft": found.shaft.as_ref().map(shaft),
    })
}

fn shaft(shaft: &Shaft) -> Value {
    let axis = &shaft.axis;
    json!({
        "direction": numbers(axis.direction_in_flange.iter()),
        "direction_deviation_deg": axis.direction_deviation_rad().to_degrees(),
        "point_mm": numbers(axis.point_in_flange.iter()),
        "point_deviation_mm": axis.point_deviation_mm(),
        "tip_off_line_mm": shaft.tip_off_line_mm,
        "flange_from_tool": pose(&shaft.flange_from_tool),
        "rejected": rejected(shaft.residuals.iter().map(|residual| residual.is_rejected)),
    })
}

/// A transform as the configuration files have it.
pub fn pose<A: Frame, B: Frame>(pose: &Rigid<A, B>) -> Value {
    let rotation = pose.rotation().into_inner();
    json!({
        "rotation_wxyz": [rotation.w, rotation.i, rotation.j, rotation.k],
        "translation_mm": numbers(pose.translation_mm().iter()),
    })
}

/// The figures of an answer as lines; what is long stays in the JSON.
pub fn table(value: &Value) -> String {
    let Value::Object(fields) = value else {
        return value.to_string();
    };
    let short = |value: &Value| !matches!(value, Value::Array(items) if items.len() > 4 || items.iter().any(Value::is_array));
    fields
        .iter()
        .filter(|(name, value)| !value.is_null() && (short(value) || *name == "rejected"))
        .map(|(name, value)| line(name, value))
        .collect::<Vec<_>>()
        .join("\n")
}

fn line(name: &str, value: &Value) -> String {
    match value {
        Value::Object(fields) => {
            let inner: Vec<String> = fields
                .iter()
                .map(|(inner, value)| line(&format!("{name}.{inner}"), value))
                .collect();
            inner.join("\n")
        }
        Value::Array(items) if items.is_empty() => format!("{name:<40} none"),
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(number).collect();
            format!("{name:<40} {}", items.join(", "))
        }
        other => format!("{name:<40} {}", number(other)),
    }
}

fn number(value: &Value) -> String {
    match value.as_f64() {
        Some(number) if !value.is_i64() && !value.is_u64() => format!("{number:.4}"),
        _ => value.to_string(),
    }
}

fn rejected(poses: impl Iterator<Item = bool>) -> Vec<usize> {
    poses
        .enumerate()
        .filter_map(|(index, is_rejected)| is_rejected.then_some(index))
        .collect()
}

fn span(span: &Span) -> Value {
    json!({
        "widest_deg": span.widest_rad.to_degrees(),
        "across_deg": span.across_rad.to_degrees(),
    })
}

fn rows<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Value {
    numbers(matrix.transpose().iter())
}

fn numbers<'a>(values: impl Iterator<Item = &'a f64>) -> Value {
    values.copied().collect::<Vec<f64>>().into()
}
