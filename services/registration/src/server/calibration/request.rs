//! Requests of a calibration as the domain takes them, every violation named at once.

use arthro_geometry::frame::{Base, Flange, Frame};
use arthro_geometry::{Point3, Rigid};
use arthro_proto::common::v1 as common;
use arthro_proto::registration::v1 as api;

use crate::calibration::gate::MAX_POSES;
use crate::calibration::hand_eye::{self, Station};
use crate::calibration::input;
use crate::calibration::noise::{PoseCovariance, PoseNoise};
use crate::calibration::tool::{self, ShaftPoses};
use crate::error::{Error, Violation};

/// Where the camera is.
pub(super) enum Mounting {
    BesideArm,
    OnFlange,
}

/// What a hand-eye calibration starts from.
pub(super) struct HandEye {
    pub(super) mounting: Mounting,
    pub(super) stations: Vec<Station>,
    pub(super) options: hand_eye::Options,
}

/// What a tool's calibration starts from.
pub(super) struct Tool {
    pub(super) poses: Vec<Rigid<Base, Flange>>,
    pub(super) shaft: ShaftPoses,
    pub(super) options: tool::Options,
}

pub(super) fn hand_eye(message: &api::SolveHandEyeRequest) -> Result<HandEye, Error> {
    let mut fields = Fields::default();
    let mounting = match message.mounting() {
        api::CameraMounting::BesideArm => Mounting::BesideArm,
        api::CameraMounting::OnFlange => Mounting::OnFlange,
        api::CameraMounting::Unspecified => {
            fields.wrong(
                "mounting",
                format!(
                    "is {}, must be CAMERA_MOUNTING_BESIDE_ARM or CAMERA_MOUNTING_ON_FLANGE",
                    message.mounting
                ),
            );
            Mounting::BesideArm
        }
    };
    fields.count("poses", message.poses.len());
    let stations = message
        .poses
        .iter()
        .take(MAX_POSES)
        .enumerate()
        .map(|(index, pose)| {
            let field = format!("poses[{index}]");
            Station {
                base_from_flange: fields
                    .pose(&format!("{field}.base_from_flange"), &pose.base_from_flange),
                camera_from_board: fields.pose(
                    &format!("{field}.camera_from_board"),
                    &pose.camera_from_board,
                ),
                camera_covariance: fields.covariance(
                    &format!("{field}.camera_covariance"),
                    &pose.camera_covariance,
                ),
            }
        })
        .collect();
    let default = hand_eye::Options::default();
    let options = hand_eye::Options {
        work_point: message
            .work_point
            .as_ref()
            .map_or(default.work_point, point),
        arm_noise: message.arm_noise.as_ref().map(noise),
        camera_noise: message.camera_noise.as_ref().map(noise),
        residual_limit_mm: stated_or(message.residual_limit_mm, default.residual_limit_mm),
        uncertainty_limit_mm: stated_or(message.uncertainty_limit_mm, default.uncertainty_limit_mm),
    };
    fields.finish(HandEye {
        mounting,
        stations,
        options,
    })
}

pub(super) fn tool(message: &api::SolveToolTipRequest) -> Result<Tool, Error> {
    let mut fields = Fields::default();
    let poses = fields.poses("poses", &message.poses);
    let spin = fields.poses("spin_poses", &message.spin_poses);
    let higher = fields.poses("higher_poses", &message.higher_poses);
    let shaft = match (spin.is_empty(), higher.is_empty()) {
        (true, true) => ShaftPoses::None,
        (false, true) => ShaftPoses::Spin(spin),
        (true, false) => ShaftPoses::Higher(higher),
        (false, false) => {
            fields.wrong("higher_poses", "must be empty beside spin_poses".to_owned());
            ShaftPoses::None
        }
    };
    let mut options = tool::Options::default();
    if message.drawn_flange_from_tool.is_some() {
        options.drawn = fields.pose("drawn_flange_from_tool", &message.drawn_flange_from_tool);
    }
    let tip = &mut options.tip;
    tip.arm_noise = message.arm_noise.as_ref().map(noise);
    tip.divot_play_mm = stated_or(message.divot_play_mm, tip.divot_play_mm);
    tip.residual_limit_mm = stated_or(message.residual_limit_mm, tip.residual_limit_mm);
    tip.uncertainty_limit_mm = stated_or(message.uncertainty_limit_mm, tip.uncertainty_limit_mm);
    fields.finish(Tool {
        poses,
        shaft,
        options,
    })
}

/// Zero is what an unset number is on the wire.
fn stated_or(value: f64, default: f64) -> f64 {
    if value == 0.0 { default } else { value }
}

fn point(point: &common::Point) -> Point3 {
    Point3::new(point.x_mm, point.y_mm, point.z_mm)
}

fn noise(noise: &api::PoseNoise) -> PoseNoise {
    PoseNoise {
        rotation_rad: noise.rotation_rad,
        translation_mm: noise.translation_mm,
    }
}

/// The violations found so far. What was wrong stands in as the identity, which nobody gets to see.
#[derive(Default)]
struct Fields(Vec<Violation>);

impl Fields {
    fn wrong(&mut self, field: &str, description: String) {
        self.0.push(Violation::new(field, description));
    }

    fn count(&mut self, field: &str, count: usize) {
        if count > MAX_POSES {
            self.wrong(
                field,
                format!("has {count} poses, must have at most {MAX_POSES}"),
            );
        }
    }

    fn poses(&mut self, field: &str, poses: &[common::Pose]) -> Vec<Rigid<Base, Flange>> {
        self.count(field, poses.len());
        poses
            .iter()
            .take(MAX_POSES)
            .enumerate()
            .map(|(index, pose)| self.pose(&format!("{field}[{index}]"), &Some(*pose)))
            .collect()
    }

    fn pose<A: Frame, B: Frame>(
        &mut self,
        field: &str,
        pose: &Option<common::Pose>,
    ) -> Rigid<A, B> {
        let Some((rotation, translation)) =
            pose.and_then(|pose| pose.rotation.zip(pose.translation))
        else {
            self.wrong(field, "must be set, rotation and translation".to_owned());
            return Rigid::identity();
        };
        let rotation_wxyz = [rotation.w, rotation.x, rotation.y, rotation.z];
        let translation_mm = [translation.x_mm, translation.y_mm, translation.z_mm];
        input::pose(field, rotation_wxyz, translation_mm).unwrap_or_else(|violation| {
            self.0.push(violation);
            Rigid::identity()
        })
    }

    fn covariance(&mut self, field: &str, numbers: &[f64]) -> Option<PoseCovariance> {
        if !matches!(numbers.len(), 0 | 36) {
            self.wrong(
                field,
                format!("has {} numbers, must have 36 or none", numbers.len()),
            );
            return None;
        }
        (!numbers.is_empty()).then(|| PoseCovariance::from_row_slice(numbers))
    }

    fn finish<T>(self, value: T) -> Result<T, Error> {
        if self.0.is_empty() {
            Ok(value)
        } else {
            Err(Error::Invalid(self.0))
        }
    }
}
