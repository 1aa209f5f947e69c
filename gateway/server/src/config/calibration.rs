//! Section `gateway.calibration`: where things are in the cell, as a site writes it, and checked.

use arthro_geometry::frame::{ArthroscopeBase, Camera, ForcepsBase, Frame, Tool};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use nalgebra::{Matrix3, Matrix6, Quaternion, SMatrix};
use serde::{Deserialize, Serialize};

use super::ConfigError;
use super::accuracy::covariance;
use crate::approval;
use crate::calendar::end_of_day_ms;
use crate::calibrations::record::{InForce, Kind, Standing};
use crate::clients::motion::Arm;

/// A quaternion's norm may differ from 1 by this much.
const UNIT_TOLERANCE: f64 = 1e-3;

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
    /// Last day on which this section may be used, `YYYY-MM-DD`, UTC. Without it, it has no end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub valid_until: Option<String>,
    /// Covariance of `forceps_base_from_camera`, 36 numbers row by row: rotation vector (rad), then displacement (mm),
    /// axes of the base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hand_eye_covariance: Option<Vec<f64>>,
    /// Covariance of the forceps' tip in the flange, nine numbers row by row, mm2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tool_tip_covariance_mm2: Option<Vec<f64>>,
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
    /// Which calibrations that rests on, how sure they are and how long they hold.
    pub calibrations: InForce,
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

impl Calibration {
    /// Checks where things are.
    pub(super) fn cell(
        &self,
        view_distance_mm: f64,
        joint_opening_mm: Option<f64>,
    ) -> Result<Cell, ConfigError> {
        Ok(Cell {
            forceps_base_from_camera: rigid(
                "calibration.forceps_base_from_camera",
                &self.forceps_base_from_camera,
            )?,
            forceps_base_from_arthroscope_base: rigid(
                "calibration.forceps_base_from_arthroscope_base",
                &self.forceps_base_from_arthroscope_base,
            )?,
            forceps_portal: point("calibration.forceps_portal_mm", self.forceps_portal_mm)?,
            arthroscope_portal: point(
                "calibration.arthroscope_portal_mm",
                self.arthroscope_portal_mm,
            )?,
            forceps_base_from_tool_at_tray: rigid(
                "calibration.forceps_base_from_tool_at_tray",
                &self.forceps_base_from_tool_at_tray,
            )?,
            arthroscope_rest: point("calibration.arthroscope_rest_mm", self.arthroscope_rest_mm)?,
            view_distance_mm,
            joint_opening_mm,
            calibrations: self.in_force()?,
        })
    }

    /// What the configuration says of its calibrations' accuracy and end.
    fn in_force(&self) -> Result<InForce, ConfigError> {
        let valid_until_ms = match &self.valid_until {
            None => None,
            Some(day) => Some(end_of_day_ms(day).ok_or_else(|| ConfigError {
                field: "calibration.valid_until",
                problem: format!("is {day:?}; must be a day as YYYY-MM-DD"),
            })?),
        };
        let hand_eye: Option<Matrix6<f64>> = covariance(
            "calibration.hand_eye_covariance",
            self.hand_eye_covariance.as_deref(),
        )?;
        let tool_tip: Option<Matrix3<f64>> = covariance(
            "calibration.tool_tip_covariance_mm2",
            self.tool_tip_covariance_mm2.as_deref(),
        )?;
        let pose = &self.forceps_base_from_camera;
        let numbers: Vec<f64> = pose
            .rotation
            .into_iter()
            .chain(pose.translation_mm)
            .collect();
        Ok(InForce {
            hand_eye: configured(Kind::HandEye, &numbers, hand_eye, valid_until_ms),
            tool_tip: configured(Kind::ToolTip, &[], tool_tip, valid_until_ms),
            flange_from_tool: drawn_flange_from_tool(),
        })
    }
}

/// A tool whose x lies along the flange's z, as tools are drawn.
fn drawn_flange_from_tool() -> Rotation {
    Rotation::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2)
}

fn configured<const N: usize>(
    kind: Kind,
    numbers: &[f64],
    covariance: Option<SMatrix<f64, N, N>>,
    valid_until_ms: Option<i64>,
) -> Standing<SMatrix<f64, N, N>> {
    let entries = covariance.as_ref().map_or(&[][..], |c| c.as_slice());
    Standing {
        id: kind.configured_id().to_owned(),
        digest: approval::configured_digest(kind, numbers, entries, valid_until_ms),
        covariance,
        valid_until_ms,
        revoked_at_ms: None,
    }
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
