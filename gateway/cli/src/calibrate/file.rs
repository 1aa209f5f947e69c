//! The JSON files that `arthro calibrate` reads and `arthro calibrate cell --keep` writes; `docs/calibration.md`
//! describes them.

use std::path::Path;

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Flange, Frame};
use arthro_registration::calibration::hand_eye::{self, Station};
use arthro_registration::calibration::input;
use arthro_registration::calibration::noise::{PoseCovariance, PoseNoise};
use arthro_registration::calibration::tool::{self, ShaftPoses};
use arthro_registration::error::{Error, Violation};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::commands::{read, unreadable};
use crate::exit::Failure;

/// Views of a board.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct HandEyeFile {
    /// Where the camera is.
    pub mounting: CameraMounting,
    #[serde(skip_serializing_if = "Option::is_none")]
    work_point_mm: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    arm_noise: Option<Noise>,
    #[serde(skip_serializing_if = "Option::is_none")]
    camera_noise: Option<Noise>,
    #[serde(skip_serializing_if = "Option::is_none")]
    residual_limit_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    uncertainty_limit_mm: Option<f64>,
    poses: Vec<View>,
}

/// Where the camera is.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraMounting {
    /// It stands beside the arm, the board is on the flange.
    BesideArm,
    /// It is on the flange, the board stands still.
    OnFlange,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct View {
    base_from_flange: Pose,
    camera_from_board: Pose,
    /// 36 numbers, row by row.
    #[serde(skip_serializing_if = "Option::is_none")]
    camera_covariance: Option<Vec<f64>>,
}

/// Poses about the tip, and optionally about the shaft.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ToolFile {
    poses: Vec<Pose>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    spin_poses: Vec<Pose>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    higher_poses: Vec<Pose>,
    #[serde(skip_serializing_if = "Option::is_none")]
    arm_noise: Option<Noise>,
    #[serde(skip_serializing_if = "Option::is_none")]
    divot_play_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    drawn_flange_from_tool: Option<Pose>,
    #[serde(skip_serializing_if = "Option::is_none")]
    residual_limit_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    uncertainty_limit_mm: Option<f64>,
}

#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Pose {
    rotation_wxyz: [f64; 4],
    translation_mm: [f64; 3],
}

#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Noise {
    rotation_deg: f64,
    translation_mm: f64,
}

/// What a tool's calibration starts from.
pub type ToolMeasurements = (Vec<Rigid<Base, Flange>>, ShaftPoses, tool::Options);

// === impl HandEyeFile ===

impl HandEyeFile {
    /// Reads `path`.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        parsed(path)
    }

    /// What was measured with the camera beside the arm.
    pub fn beside_arm(stations: &[Station], options: &hand_eye::Options) -> Self {
        let poses = stations.iter().map(|station| View {
            base_from_flange: (&station.base_from_flange).into(),
            camera_from_board: (&station.camera_from_board).into(),
            camera_covariance: station
                .camera_covariance
                .map(|covariance| covariance.transpose().iter().copied().collect()),
        });
        Self {
            mounting: CameraMounting::BesideArm,
            work_point_mm: Some(options.work_point.into()),
            arm_noise: options.arm_noise.map(Into::into),
            camera_noise: options.camera_noise.map(Into::into),
            residual_limit_mm: Some(options.residual_limit_mm),
            uncertainty_limit_mm: Some(options.uncertainty_limit_mm),
            poses: poses.collect(),
        }
    }

    /// Writes `path`.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        written(path, self)
    }

    /// As the solver takes it.
    pub fn stations(&self) -> Result<(Vec<Station>, hand_eye::Options), Error> {
        let mut fields = Fields::default();
        let stations = self.poses.iter().enumerate().map(|(index, view)| {
            let field = |name: &str| format!("poses[{index}].{name}");
            Station {
                base_from_flange: fields.pose(&field("base_from_flange"), &view.base_from_flange),
                camera_from_board: fields
                    .pose(&field("camera_from_board"), &view.camera_from_board),
                camera_covariance: view
                    .camera_covariance
                    .as_ref()
                    .and_then(|numbers| fields.covariance(&field("camera_covariance"), numbers)),
            }
        });
        let stations: Vec<Station> = stations.collect();
        let default = hand_eye::Options::default();
        let options = hand_eye::Options {
            work_point: self.work_point_mm.map_or(default.work_point, Into::into),
            arm_noise: self.arm_noise.map(Into::into),
            camera_noise: self.camera_noise.map(Into::into),
            residual_limit_mm: self.residual_limit_mm.unwrap_or(default.residual_limit_mm),
            uncertainty_limit_mm: self
                .uncertainty_limit_mm
                .unwrap_or(default.uncertainty_limit_mm),
        };
        fields.finish((stations, options))
    }
}

// === impl ToolFile ===

impl ToolFile {
    /// Reads `path`.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        parsed(path)
    }

    /// Poses about the tip.
    pub fn pivot(poses: &[Rigid<Base, Flange>]) -> Self {
        Self {
            poses: poses.iter().map(Into::into).collect(),
            spin_poses: Vec::new(),
            higher_poses: Vec::new(),
            arm_noise: None,
            divot_play_mm: None,
            drawn_flange_from_tool: None,
            residual_limit_mm: None,
            uncertainty_limit_mm: None,
        }
    }

    /// Writes `path`.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        written(path, self)
    }

    /// As the solver takes it.
    pub fn measurements(&self) -> Result<ToolMeasurements, Error> {
        let mut fields = Fields::default();
        let poses = fields.poses("poses", &self.poses);
        let spin = fields.poses("spin_poses", &self.spin_poses);
        let higher = fields.poses("higher_poses", &self.higher_poses);
        let shaft = match (spin.is_empty(), higher.is_empty()) {
            (true, true) => ShaftPoses::None,
            (false, true) => ShaftPoses::Spin(spin),
            (true, false) => ShaftPoses::Higher(higher),
            (false, false) => {
                fields.wrong("higher_poses", "must be empty beside spin_poses");
                ShaftPoses::None
            }
        };
        let mut options = tool::Options::default();
        if let Some(drawn) = &self.drawn_flange_from_tool {
            options.drawn = fields.pose("drawn_flange_from_tool", drawn);
        }
        let tip = &mut options.tip;
        tip.arm_noise = self.arm_noise.map(Into::into);
        tip.divot_play_mm = self.divot_play_mm.unwrap_or(tip.divot_play_mm);
        tip.residual_limit_mm = self.residual_limit_mm.unwrap_or(tip.residual_limit_mm);
        tip.uncertainty_limit_mm = self
            .uncertainty_limit_mm
            .unwrap_or(tip.uncertainty_limit_mm);
        fields.finish((poses, shaft, options))
    }
}

fn parsed<T: DeserializeOwned>(path: &Path) -> Result<T, Failure> {
    serde_json::from_slice(&read(path)?).map_err(|error| unreadable(path, &error))
}

fn written(path: &Path, file: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string(file)
        .map_err(|error| Failure::failed("MEASUREMENTS_UNWRITABLE", error))?;
    Ok(std::fs::write(path, text)?)
}

impl<A: Frame, B: Frame> From<&Rigid<A, B>> for Pose {
    fn from(pose: &Rigid<A, B>) -> Self {
        let rotation = pose.rotation().into_inner();
        Self {
            rotation_wxyz: [rotation.w, rotation.i, rotation.j, rotation.k],
            translation_mm: pose.translation_mm().into(),
        }
    }
}

impl From<PoseNoise> for Noise {
    fn from(noise: PoseNoise) -> Self {
        Self {
            rotation_deg: noise.rotation_rad.to_degrees(),
            translation_mm: noise.translation_mm,
        }
    }
}

impl From<Noise> for PoseNoise {
    fn from(noise: Noise) -> Self {
        Self {
            rotation_rad: noise.rotation_deg.to_radians(),
            translation_mm: noise.translation_mm,
        }
    }
}

/// The violations found so far; what was wrong stands in as the identity, which nobody gets to see.
#[derive(Default)]
struct Fields(Vec<Violation>);

impl Fields {
    fn wrong(&mut self, field: &str, description: &str) {
        self.0.push(Violation::new(field, description));
    }

    fn poses(&mut self, field: &str, poses: &[Pose]) -> Vec<Rigid<Base, Flange>> {
        poses
            .iter()
            .enumerate()
            .map(|(index, pose)| self.pose(&format!("{field}[{index}]"), pose))
            .collect()
    }

    fn pose<A: Frame, B: Frame>(&mut self, field: &str, pose: &Pose) -> Rigid<A, B> {
        input::pose(field, pose.rotation_wxyz, pose.translation_mm).unwrap_or_else(|violation| {
            self.0.push(violation);
            Rigid::identity()
        })
    }

    fn covariance(&mut self, field: &str, numbers: &[f64]) -> Option<PoseCovariance> {
        if numbers.len() != 36 {
            self.wrong(
                field,
                &format!("has {} numbers, must have 36", numbers.len()),
            );
            return None;
        }
        Some(PoseCovariance::from_row_slice(numbers))
    }

    fn finish<T>(self, value: T) -> Result<T, Error> {
        if self.0.is_empty() {
            Ok(value)
        } else {
            Err(Error::Invalid(self.0))
        }
    }
}
