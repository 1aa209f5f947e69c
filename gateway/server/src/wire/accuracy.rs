//! Messages about accuracy: calibrations, touched landmarks, predicted errors.

use arthro_geometry::Rotation;
use arthro_proto::gateway::v1 as gateway;
use arthro_proto::registration::v1 as registration;
use nalgebra::SMatrix;

use super::{point, point_message, pose};
use crate::calibrations::record::Measured;
use crate::config::{ErrorBudget, checked_covariance};
use crate::error::Violation;
use crate::error_budget::{BiteError, Part, Sources, Uncertainty};
use crate::verification::{Finding, Limits, Touch, Verdict};

/// Fewest poses that a calibration rests on, as the solvers ask.
const POSES_MIN: usize = 10;
/// Most poses that a solver takes.
const POSES_MAX: usize = 500;

// === reading ===

/// A hand-eye calibration of a camera beside the arm, with its covariance.
pub fn hand_eye(
    result: &registration::SolveHandEyeResponse,
    field: &str,
) -> Result<Measured, Violation> {
    let within = |name: &str| format!("{field}.{name}");
    kept_poses(&result.residuals, &within("residuals"))?;
    Ok(Measured::HandEye {
        pose: pose(result.mount_from_camera, &within("mount_from_camera"))?,
        covariance: covariance(
            &result.mount_from_camera_covariance,
            &within("mount_from_camera_covariance"),
        )?,
    })
}

/// The calibration of a tool's tip, with its covariance.
pub fn tool_tip(
    result: &registration::SolveToolTipResponse,
    field: &str,
) -> Result<Measured, Violation> {
    let within = |name: &str| format!("{field}.{name}");
    kept_poses(&result.residuals, &within("residuals"))?;
    let shaft = result.shaft.as_ref();
    let flange_from_tool: Option<Rotation> = shaft
        .and_then(|shaft| shaft.flange_from_tool?.rotation)
        .map(|rotation| super::rotation(Some(rotation), &within("shaft.flange_from_tool.rotation")))
        .transpose()?;
    Ok(Measured::ToolTip {
        tip: point(result.tip, &within("tip"))?,
        covariance_mm2: covariance(&result.tip_covariance_mm2, &within("tip_covariance_mm2"))?,
        flange_from_tool,
    })
}

fn kept_poses(
    residuals: &[registration::CalibrationResidual],
    field: &str,
) -> Result<(), Violation> {
    let kept = residuals
        .iter()
        .filter(|residual| !residual.rejected)
        .count();
    if kept >= POSES_MIN && residuals.len() <= POSES_MAX {
        return Ok(());
    }
    Err(Violation::new(
        field,
        format!(
            "holds {} poses, {kept} of them not rejected; must hold at most {POSES_MAX} and {POSES_MIN} or more",
            residuals.len()
        ),
    ))
}

fn covariance<const N: usize>(rows: &[f64], field: &str) -> Result<SMatrix<f64, N, N>, Violation> {
    checked_covariance(rows).map_err(|problem| Violation::new(field, problem))
}

/// How sure a registration is, if its result says so.
pub fn uncertainty(result: &registration::RegistrationResult) -> Option<Uncertainty> {
    let covariance = checked_covariance(&result.covariance).ok();
    let about = point(result.covariance_about, "covariance_about").ok();
    let scale_about = point(result.scale_about, "scale_about").ok();
    if let (Some(covariance), Some(about), Some(scale_about)) = (covariance, about, scale_about) {
        return Some(Uncertainty::Covariance {
            covariance: Box::new(covariance),
            about,
            scale_about,
        });
    }
    // Results from before the covariance said what it is about still have its root mean square over the model.
    let rms_mm = result.tre_predicted_mm;
    (rms_mm > 0.0 && rms_mm.is_finite()).then_some(Uncertainty::Rms(rms_mm))
}

/// A touch as it was stored.
pub fn touch(message: gateway::Touch) -> Result<Touch, Violation> {
    Ok(Touch {
        landmark: message.landmark,
        point: point(message.point, "point")?,
        expected: point(message.expected, "expected")?,
        tip: point(message.tip, "tip")?,
        operator: message.operator,
        touched_at_ms: message.touched_at_ms,
    })
}

// === writing ===

/// A touch.
pub fn touch_message(touch: &Touch) -> gateway::Touch {
    gateway::Touch {
        landmark: touch.landmark.clone(),
        point: Some(point_message(&touch.point)),
        expected: Some(point_message(&touch.expected)),
        tip: Some(point_message(&touch.tip)),
        distance_mm: touch.distance_mm(),
        operator: touch.operator.clone(),
        touched_at_ms: touch.touched_at_ms,
    }
}

/// What was touched, judged.
pub fn verification_message(touches: &[Touch], limits: &Limits) -> gateway::Verification {
    let finding = Finding::of(touches, limits);
    let verdict = match finding.verdict {
        Verdict::Absent => gateway::VerificationVerdict::Absent,
        Verdict::Pending => gateway::VerificationVerdict::Pending,
        Verdict::Passed => gateway::VerificationVerdict::Passed,
        Verdict::Failed => gateway::VerificationVerdict::Failed,
    };
    gateway::Verification {
        touches: touches.iter().map(touch_message).collect(),
        tre_rms_mm: finding.rms_mm,
        tre_max_mm: finding.max_mm,
        verdict: verdict.into(),
        limit_mm: limits.limit_mm,
        reasons: finding.missing,
        required: limits.required,
    }
}

/// Predicted errors of bites, and what is not known of them.
pub fn errors_message(
    bites: &[BiteError],
    sources: &Sources,
    budget: &ErrorBudget,
) -> gateway::PredictedErrors {
    let limit_mm = budget.bite_limit_mm;
    let messages = bites.iter().map(|bite| gateway::BiteError {
        rms_mm: bite.rms_mm,
        registration_mm: bite.part_mm(Part::Registration),
        hand_eye_mm: bite.part_mm(Part::HandEye),
        arm_mm: bite.part_mm(Part::Arm),
        tool_tip_mm: bite.part_mm(Part::ToolTip),
        dominant: part_message(bite.dominant()).into(),
        above_limit: bite.rms_mm > limit_mm,
    });
    gateway::PredictedErrors {
        bites: messages.collect(),
        rms_max_mm: bites.iter().map(|bite| bite.rms_mm).fold(0.0, f64::max),
        unknown: sources
            .unknown()
            .into_iter()
            .map(|part| part_message(part).into())
            .collect(),
        limit_mm,
    }
}

const fn part_message(part: Part) -> gateway::ErrorPart {
    match part {
        Part::Registration => gateway::ErrorPart::Registration,
        Part::HandEye => gateway::ErrorPart::HandEye,
        Part::Arm => gateway::ErrorPart::Arm,
        Part::ToolTip => gateway::ErrorPart::ToolTip,
    }
}
