//! The gateway's section of the configuration, and the checked calibration it becomes.

use std::path::PathBuf;

use arthro_geometry::frame::{ArthroscopeBase, Camera, ForcepsBase, Frame, Tool};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use nalgebra::Quaternion;
use serde::{Deserialize, Serialize};

use crate::clients::motion::Arm;
use crate::journal::Place;

/// A quaternion's norm may differ from 1 by this much.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Characters of a gateway's name.
const NAME_LONGEST: usize = 100;

/// Section `gateway`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Where cases, procedures and steps are kept: the path of an SQLite file, created when absent, or the address of a
    /// PostgreSQL database (`postgres://user@host/database`), which several gateways may share.
    pub journal: Place,
    /// How this gateway is named to others that share its journal, e.g. its address; empty: host and process.
    pub name: String,
    /// Address of the registration service, host:port.
    pub registration: String,
    /// Address of the planning service, host:port.
    pub planning: String,
    /// Address of the motion service, host:port.
    pub motion: String,
    /// Address of the instrument service, host:port.
    pub instrument: String,
    /// How far from the middle of the bites the arthroscope's tip stays in a plan without views, mm.
    pub view_distance_mm: f64,
    /// How far the joint is opened, mm: the gap between the top of the meniscus and the condyle. Plans then keep the
    /// forceps' shaft clear of condyle and plateau. Without it nothing is known of the joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_opening_mm: Option<f64>,
    /// What a pause does once the step under way is halted.
    pub pause: PauseMode,
    /// An arm this far from where it stood when the procedure was halted refuses to go on, mm of its tip.
    pub pose_tolerance_mm: f64,
    /// The same for the tool's turning, deg.
    pub pose_tolerance_deg: f64,
    /// A motion service that was restarted with a tool inside is told the calibrated portal only if the measured shaft passes
    /// it this near, mm.
    pub portal_tolerance_mm: f64,
    /// The jaw of the forceps in use.
    pub jaw: Jaw,
    /// Where things are in the cell. Without it cases are registered, but nothing is planned and nothing moves:
    /// there is no safe default for a hand-eye transform.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

/// What a pause does with the arms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum PauseMode {
    /// They hold where they are.
    #[default]
    Hold,
    /// They are drawn back along their shafts.
    Retract,
}

/// What halts and goes on with a procedure, and within which limits: the checked keys of the configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// What a pause does once the step under way is halted.
    pub pause: PauseMode,
    /// How far an arm may be from where it stood, mm.
    pub pose_tolerance_mm: f64,
    /// How far a tool may have turned since, deg.
    pub pose_tolerance_deg: f64,
    /// How near a measured shaft must pass a portal that is stated with the tool inside, mm.
    pub portal_tolerance_mm: f64,
}

/// The forceps' jaw.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Jaw {
    /// Across the shaft, mm.
    pub width_mm: f64,
    /// Along the shaft, mm.
    pub length_mm: f64,
    /// How far behind the jaw its hinge needs room, mm.
    pub throat_mm: f64,
}

/// Section `gateway.calibration`, as written by the site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Hand-eye: the camera in the forceps arm's base.
    pub forceps_base_from_camera: Pose,
    /// The arthroscope arm's base in the forceps arm's base.
    pub forceps_base_from_arthroscope_base: Pose,
    /// The forceps' portal, in the forceps arm's base, mm.
    pub forceps_portal_mm: [f64; 3],
    /// The arthroscope's portal, in the arthroscope arm's base, mm.
    pub arthroscope_portal_mm: [f64; 3],
    /// The forceps over the tray, in the forceps arm's base.
    pub forceps_base_from_tool_at_tray: Pose,
    /// Where the arthroscope's tip rests outside the body, in the arthroscope arm's base, mm.
    pub arthroscope_rest_mm: [f64; 3],
}

/// A rigid transform as written in a file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Unit quaternion w, x, y, z.
    pub rotation: [f64; 4],
    /// mm.
    pub translation_mm: [f64; 3],
}

/// Where things are in the cell: the checked calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Hand-eye.
    pub forceps_base_from_camera: Rigid<ForcepsBase, Camera>,
    /// Between the two arms.
    pub forceps_base_from_arthroscope_base: Rigid<ForcepsBase, ArthroscopeBase>,
    /// In the forceps arm's base.
    pub forceps_portal: Point3,
    /// In the arthroscope arm's base.
    pub arthroscope_portal: Point3,
    /// The forceps over the tray.
    pub forceps_base_from_tool_at_tray: Rigid<ForcepsBase, Tool>,
    /// The arthroscope's tip at rest, in the arthroscope arm's base.
    pub arthroscope_rest: Point3,
    /// How far from the middle of the bites the arthroscope's tip stays in a plan without views, mm.
    pub view_distance_mm: f64,
    /// How far the joint is opened, mm, if that is known.
    pub joint_opening_mm: Option<f64>,
}

impl Cell {
    /// An arm's portal, in its own base.
    pub fn portal(&self, arm: Arm) -> &Point3 {
        match arm {
            Arm::Forceps => &self.forceps_portal,
            Arm::Arthroscope => &self.arthroscope_portal,
        }
    }
}

/// A value of the configuration that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("gateway.{field} {problem}")]
pub struct ConfigError {
    field: &'static str,
    problem: String,
}

// === impl Config ===

impl Default for Config {
    fn default() -> Self {
        Self {
            journal: PathBuf::from("arthro-gateway.sqlite").into(),
            name: String::new(),
            registration: "127.0.0.1:50051".to_owned(),
            planning: "127.0.0.1:50052".to_owned(),
            motion: "127.0.0.1:50053".to_owned(),
            instrument: "127.0.0.1:50054".to_owned(),
            view_distance_mm: 20.0,
            joint_opening_mm: None,
            pause: PauseMode::default(),
            pose_tolerance_mm: 1.0,
            pose_tolerance_deg: 1.0,
            portal_tolerance_mm: 5.0,
            jaw: Jaw::default(),
            calibration: None,
        }
    }
}

impl Config {
    /// Checks what governs halts.
    pub fn rules(&self) -> Result<Rules, ConfigError> {
        within("pose_tolerance_mm", self.pose_tolerance_mm, 0.01, 10.0)?;
        within("pose_tolerance_deg", self.pose_tolerance_deg, 0.01, 10.0)?;
        within("portal_tolerance_mm", self.portal_tolerance_mm, 0.1, 20.0)?;
        Ok(Rules {
            pause: self.pause,
            pose_tolerance_mm: self.pose_tolerance_mm,
            pose_tolerance_deg: self.pose_tolerance_deg,
            portal_tolerance_mm: self.portal_tolerance_mm,
        })
    }

    /// How this gateway is named to others.
    pub fn holder(&self) -> Result<String, ConfigError> {
        let length = self.name.chars().count();
        if length > NAME_LONGEST || self.name.chars().any(char::is_control) {
            return Err(ConfigError {
                field: "name",
                problem: format!(
                    "has {length} characters; must have at most {NAME_LONGEST}, none of them a control character"
                ),
            });
        }
        if !self.name.is_empty() {
            return Ok(self.name.clone());
        }
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let host = match host.trim() {
            "" => "gateway",
            host => host,
        };
        Ok(format!("{host}, process {}", std::process::id()))
    }

    /// Checks jaw and calibration; `None` when the cell is not calibrated.
    pub fn cell(&self) -> Result<Option<Cell>, ConfigError> {
        within("jaw.width_mm", self.jaw.width_mm, 0.5, 10.0)?;
        within("jaw.length_mm", self.jaw.length_mm, 0.5, 20.0)?;
        within("jaw.throat_mm", self.jaw.throat_mm, 0.1, 10.0)?;
        within("view_distance_mm", self.view_distance_mm, 1.0, 200.0)?;
        if let Some(opening_mm) = self.joint_opening_mm {
            within("joint_opening_mm", opening_mm, -20.0, 50.0)?;
        }
        let Some(calibration) = &self.calibration else {
            return Ok(None);
        };
        Ok(Some(Cell {
            forceps_base_from_camera: rigid(
                "calibration.forceps_base_from_camera",
                &calibration.forceps_base_from_camera,
            )?,
            forceps_base_from_arthroscope_base: rigid(
                "calibration.forceps_base_from_arthroscope_base",
                &calibration.forceps_base_from_arthroscope_base,
            )?,
            forceps_portal: point(
                "calibration.forceps_portal_mm",
                calibration.forceps_portal_mm,
            )?,
            arthroscope_portal: point(
                "calibration.arthroscope_portal_mm",
                calibration.arthroscope_portal_mm,
            )?,
            forceps_base_from_tool_at_tray: rigid(
                "calibration.forceps_base_from_tool_at_tray",
                &calibration.forceps_base_from_tool_at_tray,
            )?,
            arthroscope_rest: point(
                "calibration.arthroscope_rest_mm",
                calibration.arthroscope_rest_mm,
            )?,
            view_distance_mm: self.view_distance_mm,
            joint_opening_mm: self.joint_opening_mm,
        }))
    }
}

impl Default for Jaw {
    fn default() -> Self {
        Self {
            width_mm: 3.0,
            length_mm: 4.5,
            throat_mm: 1.0,
        }
    }
}

fn within(field: &'static str, value: f64, lowest: f64, highest: f64) -> Result<(), ConfigError> {
    if (lowest..=highest).contains(&value) {
        return Ok(());
    }
    Err(ConfigError {
        field,
        problem: format!("is {value}; must be within {lowest} .. {highest}"),
    })
}

fn point(field: &'static str, [x, y, z]: [f64; 3]) -> Result<Point3, ConfigError> {
    if [x, y, z].iter().all(|value| value.is_finite()) {
        return Ok(Point3::new(x, y, z));
    }
    Err(ConfigError {
        field,
        problem: format!("is {x}, {y}, {z}; must be finite"),
    })
}

fn rigid<A: Frame, B: Frame>(field: &'static str, pose: &Pose) -> Result<Rigid<A, B>, ConfigError> {
    let [w, x, y, z] = pose.rotation;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    // Written so that NaN is refused too.
    if (norm - 1.0).abs() <= UNIT_TOLERANCE {
        let translation = point(field, pose.translation_mm)?.coords;
        return Ok(Rigid::new(
            Rotation::from_quaternion(quaternion),
            translation,
        ));
    }
    Err(ConfigError {
        field,
        problem: format!("has a rotation of norm {norm}; must be 1 within {UNIT_TOLERANCE}"),
    })
}

impl Pose {
    /// The pose of a transform, as it is written in a file.
    pub fn of<A: Frame, B: Frame>(rigid: &Rigid<A, B>) -> Self {
        let rotation = rigid.rotation();
        Self {
            rotation: [rotation.w, rotation.i, rotation.j, rotation.k],
            translation_mm: Vector3::into(rigid.translation_mm()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibration() -> Calibration {
        let pose = Pose {
            rotation: [1.0, 0.0, 0.0, 0.0],
            translation_mm: [0.0; 3],
        };
        Calibration {
            forceps_base_from_camera: pose,
            forceps_base_from_arthroscope_base: pose,
            forceps_portal_mm: [700.0, 0.0, 250.0],
            arthroscope_portal_mm: [0.0; 3],
            forceps_base_from_tool_at_tray: pose,
            arthroscope_rest_mm: [0.0; 3],
        }
    }

    fn problem(config: &Config) -> String {
        config.cell().unwrap_err().to_string()
    }

    #[test]
    fn a_non_unit_hand_eye_rotation_is_refused() {
        let mut calibration = calibration();
        calibration.forceps_base_from_camera.rotation = [1.0, 0.1, 0.0, 0.0];
        let config = Config {
            calibration: Some(calibration),
            ..Config::default()
        };
        assert!(
            problem(&config).contains("forceps_base_from_camera has a rotation of norm 1.00498")
        );
    }

    #[test]
    fn a_portal_that_is_not_a_number_is_refused() {
        let mut calibration = calibration();
        calibration.forceps_portal_mm[1] = f64::NAN;
        let config = Config {
            calibration: Some(calibration),
            ..Config::default()
        };
        assert!(problem(&config).contains("forceps_portal_mm is 700, NaN, 250; must be finite"));
    }

    #[test]
    fn a_jaw_in_metres_is_refused() {
        let config = Config {
            jaw: Jaw {
                width_mm: 0.003,
                length_mm: 0.0045,
                ..Jaw::default()
            },
            ..Config::default()
        };
        assert!(problem(&config).contains("jaw.width_mm is 0.003; must be within 0.5 .. 10"));
    }

    #[test]
    fn a_tolerance_that_would_take_any_pose_is_refused() {
        let config = Config {
            pose_tolerance_mm: 1000.0,
            ..Config::default()
        };
        assert_eq!(
            config.rules().unwrap_err().to_string(),
            "gateway.pose_tolerance_mm is 1000; must be within 0.01 .. 10"
        );
    }

    #[test]
    fn without_calibration_there_is_no_cell() {
        assert_eq!(Config::default().cell(), Ok(None));
    }
}
