//! How far the bites of a plan are expected to be off: the covariances of the chain carried to the middle of each bite.
//!
//! A bite goes from ct through the registration into the camera, through hand-eye into the base, and the arm brings the
//! tip there. To first order a link's error moves the bite by `J e`, so its part is `trace(J C J')`, and independent
//! parts add up:
//!
//! - registration: `J = s R [-[p - a]x, I, p - b]` for turn about `a`, shift, and logarithm of scale about `b`, all in ct;
//! - hand-eye: `J = [-[R c]x, I]` for a turn and a displacement in the base, `c` the bite in the camera;
//! - arm: as configured, the same in every direction;
//! - tool tip: `J` turns the flange into the base.
//!
//! What nobody told is no zero: a link without covariance is named as unknown, and the sum leaves it out.

use arthro_geometry::{Point3, Rotation, Vector3};
use nalgebra::{Matrix3, Matrix6, SMatrix};

use crate::calibrations::record::InForce;
use crate::cases::case::{Bite, Registration};
use crate::config::Cell;
use crate::procedure::poses::{base_from_ct, upright};
use crate::words::words;

/// Covariance of a registration's seven parameters: turn (rad), shift (mm), logarithm of scale.
pub type RegistrationCovariance = SMatrix<f64, 7, 7>;

words! {
    /// A link of the chain.
    Part {
        /// camera_from_ct.
        Registration = "REGISTRATION",
        /// base_from_camera.
        HandEye = "HAND_EYE",
        /// Where the arm is against where it says it is.
        Arm = "ARM",
        /// The tip in the flange.
        ToolTip = "TOOL_TIP",
    }
}

/// How sure a registration is.
#[derive(Clone, Debug, PartialEq)]
pub enum Uncertainty {
    /// By its covariance.
    Covariance {
        /// Turn (rad), shift (mm), logarithm of scale; axes of ct.
        covariance: Box<RegistrationCovariance>,
        /// What the turn is about, ct.
        about: Point3,
        /// What stays where it is when the scale changes, ct.
        scale_about: Point3,
    },
    /// Root mean square error over the model, mm of the model: of a result that tells no covariance.
    Rms(f64),
}

/// What is known of the chain beside its transforms.
#[derive(Clone, Debug, PartialEq)]
pub struct Sources {
    /// Of the registration.
    pub registration: Option<Uncertainty>,
    /// Of hand-eye: rotation vector (rad), then displacement (mm), axes of the base.
    pub hand_eye: Option<Matrix6<f64>>,
    /// Root mean square error of the arm at its tip, mm.
    pub arm_mm: f64,
    /// Of the tip, axes of the flange, mm2.
    pub tool_tip: Option<Matrix3<f64>>,
    /// The tool's axes in the flange.
    pub flange_from_tool: Rotation,
}

/// How far one bite is expected to be off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BiteError {
    /// Root mean square of all parts together, mm.
    pub rms_mm: f64,
    /// Root mean square of each part, mm, in the order of [`Part::ALL`]; 0 for a part of which nothing is known.
    pub parts_mm: [f64; 4],
}

impl Sources {
    /// What the calibrations in force say, beside a registration and an arm.
    pub fn of(registration: Option<Uncertainty>, calibrations: &InForce, arm_mm: f64) -> Self {
        Self {
            registration,
            hand_eye: calibrations.hand_eye.covariance,
            arm_mm,
            tool_tip: calibrations.tool_tip.covariance,
            flange_from_tool: calibrations.flange_from_tool,
        }
    }

    /// The links of which nothing is known.
    pub fn unknown(&self) -> Vec<Part> {
        let known = |part: &Part| match part {
            Part::Registration => self.registration.is_some(),
            Part::HandEye => self.hand_eye.is_some(),
            Part::Arm => true,
            Part::ToolTip => self.tool_tip.is_some(),
        };
        let parts = Part::ALL.iter().copied();
        parts.filter(|part| !known(part)).collect()
    }

    /// How far a bite is expected to be off.
    pub fn bite(&self, bite: &Bite, registration: &Registration, cell: &Cell) -> BiteError {
        let base_from_ct = base_from_ct(registration, cell);
        let shaft = base_from_ct.direction(&bite.approach);
        let base_from_flange = upright(shaft) * self.flange_from_tool.inverse();
        let variances = Part::ALL.iter().map(|part| match part {
            Part::Registration => self.registration.as_ref().map_or(0.0, |uncertainty| {
                // The turn into the base leaves the trace as it is.
                uncertainty.variance_mm2(&bite.center) * base_from_ct.scale.powi(2)
            }),
            Part::HandEye => {
                let in_camera = registration.camera_from_ct * bite.center;
                let lever = cell.forceps_base_from_camera.direction(&in_camera.coords);
                self.hand_eye
                    .map_or(0.0, |covariance| hand_eye_mm2(&covariance, &lever))
            }
            Part::Arm => self.arm_mm.powi(2),
            Part::ToolTip => self.tool_tip.map_or(0.0, |covariance| {
                let turn = base_from_flange.to_rotation_matrix().into_inner();
                (turn * covariance * turn.transpose()).trace()
            }),
        });
        let mut parts_mm = [0.0; 4];
        for (part_mm, variance) in parts_mm.iter_mut().zip(variances) {
            *part_mm = variance.max(0.0).sqrt();
        }
        BiteError {
            rms_mm: parts_mm
                .iter()
                .map(|part_mm| part_mm * part_mm)
                .sum::<f64>()
                .sqrt(),
            parts_mm,
        }
    }
}

impl Uncertainty {
    /// Mean square error of a point of ct, mm2 of the model.
    fn variance_mm2(&self, point: &Point3) -> f64 {
        match self {
            Self::Rms(rms_mm) => rms_mm * rms_mm,
            Self::Covariance {
                covariance,
                about,
                scale_about,
            } => {
                let mut moved = SMatrix::<f64, 3, 7>::zeros();
                let turned = -(point - about).cross_matrix();
                moved.fixed_view_mut::<3, 3>(0, 0).copy_from(&turned);
                moved.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
                moved.set_column(6, &(point - scale_about));
                (moved * **covariance * moved.transpose()).trace()
            }
        }
    }
}

impl BiteError {
    /// One of the parts, mm.
    pub fn part_mm(&self, part: Part) -> f64 {
        Part::ALL
            .iter()
            .zip(self.parts_mm)
            .find_map(|(other, part_mm)| (*other == part).then_some(part_mm))
            .unwrap_or(0.0)
    }

    /// The largest part.
    pub fn dominant(&self) -> Part {
        Part::ALL
            .iter()
            .copied()
            .max_by(|a, b| self.part_mm(*a).total_cmp(&self.part_mm(*b)))
            .unwrap_or(Part::Registration)
    }
}

fn hand_eye_mm2(covariance: &Matrix6<f64>, lever: &Vector3) -> f64 {
    let mut moved = SMatrix::<f64, 3, 6>::zeros();
    let turned = -lever.cross_matrix();
    moved.fixed_view_mut::<3, 3>(0, 0).copy_from(&turned);
    moved.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
    (moved * covariance * moved.transpose()).trace()
}

/// Root mean square error that a hand-eye covariance says of a point in front of the camera; `lever` is from the camera
/// to the point, in the axes of the base, mm.
pub fn hand_eye_deviation_mm(covariance: &Matrix6<f64>, lever: &Vector3) -> f64 {
    hand_eye_mm2(covariance, lever).max(0.0).sqrt()
}

#[cfg(test)]
mod tests;
