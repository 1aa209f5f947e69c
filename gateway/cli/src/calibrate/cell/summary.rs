//! The figures of the routine, beside the limits they are held to. Errors are the referee's word.

use arthro_geometry::frame::{Base, Camera, Flange};
use arthro_geometry::{Point3, Rigid};
use arthro_proto::common::v1 as common;
use arthro_proto::simulator::v1::referee_service_client::RefereeServiceClient;
use arthro_proto::simulator::v1::{
    CameraScore, Collision, GetAccountRequest, ScoreCalibrationRequest, TipScore,
};
use arthro_registration::calibration::hand_eye::HandEye;
use arthro_registration::calibration::tool::Calibrated;
use arthro_registration::calibration::tool_tip::ToolTip;
use arthro_simulator::scenario::SystemView;
use serde_json::{Value, json};
use tonic::transport::Channel;

use super::board::WORK_POINT;
use crate::calibrate::show;
use crate::commanded::message;
use crate::exit::{Failure, Kind};

/// Error of the hand-eye transform allowed at the work point, mm.
const CAMERA_LIMIT_MM: f64 = 1.0;
/// Error of the tip allowed, mm.
const TIP_LIMIT_MM: f64 = 0.3;
/// An error may be this many times its expectation: normal errors in one direction are more once in 370 times.
const HONEST_RATIO: f64 = 3.0;

/// Everything the routine found out.
#[derive(Debug)]
pub struct Summary {
    hand_eye: HandEye<Base, Flange>,
    tool: ToolTip,
    /// True errors after and before.
    camera: [CameraScore; 2],
    tip: [TipScore; 2],
    collisions: Vec<Collision>,
}

struct Check {
    what: &'static str,
    measured: String,
    limit: String,
    kept: bool,
}

impl Summary {
    /// Has the referee grade the answers, and the drawing for comparison.
    pub async fn graded(
        mut referee: RefereeServiceClient<Channel>,
        drawn: &SystemView,
        hand_eye: HandEye<Base, Flange>,
        tool: ToolTip,
    ) -> Result<Self, Failure> {
        let found = claim(&hand_eye.mount_from_camera, &tool.tip_in_flange);
        let drawing = claim(
            &Rigid::from_isometry(*drawn.forceps_base_from_camera.isometry()),
            &drawn.flange_from_tool.origin(),
        );
        let after = referee.score_calibration(found).await?.into_inner();
        let before = referee.score_calibration(drawing).await?.into_inner();
        let account = referee
            .get_account(GetAccountRequest {})
            .await?
            .into_inner();
        let graded = |answer: Option<_>| {
            answer.ok_or_else(|| {
                Failure::new(
                    Kind::Failed,
                    "REFEREE_ANSWER_UNUSABLE",
                    "a claim was not scored",
                )
            })
        };
        let camera = [graded(after.camera)?, graded(before.camera)?];
        let tips = [after.tip, before.tip].map(|tip| tip.unwrap_or_default());
        Ok(Self {
            hand_eye,
            tool,
            camera,
            tip: tips,
            collisions: account.collisions,
        })
    }

    fn checks(&self) -> Vec<Check> {
        let at_most = |what, value: f64, limit: f64, unit: &str| Check {
            what,
            measured: format!("{value:.3}{unit}"),
            limit: format!("<= {limit}{unit}"),
            kept: value <= limit,
        };
        let (camera_mm, tip_mm) = (self.camera[0].error_mm, self.tip[0].error_mm);
        vec![
            at_most(
                "camera, true error at the work point",
                camera_mm,
                CAMERA_LIMIT_MM,
                " mm",
            ),
            at_most(
                "camera, true over expected error",
                camera_mm / self.hand_eye.work_point_deviation_mm,
                HONEST_RATIO,
                "",
            ),
            at_most("tip, true error", tip_mm, TIP_LIMIT_MM, " mm"),
            at_most(
                "tip, true over expected error",
                tip_mm / self.tool.tip_deviation_mm,
                HONEST_RATIO,
                "",
            ),
            Check {
                what: "collisions",
                measured: self.collisions.len().to_string(),
                limit: "0".to_owned(),
                kept: self.collisions.is_empty(),
            },
        ]
    }

    /// `Ok` if every limit was kept.
    pub fn limits_kept(&self) -> Result<(), Failure> {
        let missed: Vec<String> = self
            .checks()
            .into_iter()
            .filter(|check| !check.kept)
            .map(|check| format!("{} {} (limit {})", check.what, check.measured, check.limit))
            .collect();
        if missed.is_empty() {
            return Ok(());
        }
        Err(Failure::new(
            Kind::LimitMissed,
            "LIMIT_MISSED",
            missed.join("; "),
        ))
    }

    /// For a person.
    pub fn table(&self) -> String {
        let (hand_eye, tool) = (&self.hand_eye, &self.tool);
        let mut lines = vec![
            String::new(),
            format!(
                "camera  {} views over {:.0} degrees, {} rejected; expected error {:.2} mm (jackknife {:.2} mm), held-out views {:.2} mm rms",
                hand_eye.residuals.len(),
                hand_eye.span.widest_rad.to_degrees(),
                hand_eye
                    .residuals
                    .iter()
                    .filter(|residual| residual.is_rejected)
                    .count(),
                hand_eye.work_point_deviation_mm,
                hand_eye.work_point_jackknife_mm,
                hand_eye.held_out_rms_mm,
            ),
            format!(
                "tip     {} poses over {:.0} degrees, {} rejected; expected error {:.3} mm, held-out poses {:.3} mm rms",
                tool.residuals.len(),
                tool.span.widest_rad.to_degrees(),
                tool.residuals
                    .iter()
                    .filter(|residual| residual.is_rejected)
                    .count(),
                tool.tip_deviation_mm,
                tool.held_out_rms_mm,
            ),
            format!(
                "before  the drawing was off by {:.1} mm at the work point and {:.1} mm at the tip",
                self.camera[1].error_mm, self.tip[1].error_mm
            ),
            String::new(),
            format!(
                "{:<38} {:>12}  {}",
                "referee's account", "measured", "asked"
            ),
        ];
        lines.extend(self.checks().iter().map(|check| {
            format!(
                "{:<38} {:>12}  {}{}",
                check.what,
                check.measured,
                check.limit,
                if check.kept { "" } else { "   MISSED" }
            )
        }));
        lines.extend(self.collisions.iter().map(|collision| {
            format!(
                "  collision at {:.1} s: {} with {}, {:.2} mm deep",
                collision.cell_time_s, collision.first, collision.second, collision.penetration_mm
            )
        }));
        lines.join("\n")
    }

    /// The last line of `--json`.
    pub fn json(&self) -> Value {
        let score = |camera: &CameraScore, tip: &TipScore| {
            json!({
                "work_point_error_mm": camera.error_mm,
                "rotation_error_deg": camera.rotation_error_rad.to_degrees(),
                "translation_error_mm": camera.translation_error_mm,
                "tip_error_mm": tip.error_mm,
            })
        };
        let tool = Calibrated {
            tip: self.tool.clone(),
            shaft: None,
        };
        json!({
            "hand_eye": show::hand_eye(&self.hand_eye, "base_from_camera", "flange_from_board"),
            "tool_tip": show::tool(&tool),
            "referee": score(&self.camera[0], &self.tip[0]),
            "referee_of_the_drawing": score(&self.camera[1], &self.tip[1]),
            "collisions": self.collisions.len(),
            "limits_kept": self.checks().iter().all(|check| check.kept),
        })
    }
}

fn claim(base_from_camera: &Rigid<Base, Camera>, tip: &Point3) -> ScoreCalibrationRequest {
    let point = |point: &Point3| common::Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    };
    ScoreCalibrationRequest {
        base_from_camera: Some(message(base_from_camera)),
        work_point: Some(point(&WORK_POINT)),
        tip_in_flange: Some(point(tip)),
    }
}
