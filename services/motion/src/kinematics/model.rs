//! Which arm it is: the drawing's lengths, the calibration of this one if there is one, and its travel.

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Flange};
use arthro_geometry::nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use super::Joints;
use super::dh::{Chain, Dh};
use super::flange_pose::FlangePose;
use super::joint_limits::JointLimits;
use super::links::Links;
use super::polish;
use super::singularity::{Singularities, manipulability_mm3};
use super::solutions::Solutions;

/// An arm that the manufacturer makes. Lengths: the manufacturer's Denavit-Hartenberg tables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Make {
    /// UR5 of the CB3 series.
    #[default]
    Ur5,
    /// UR5e of the e-Series.
    Ur5e,
}

impl Make {
    /// Its lengths.
    pub const fn links(self) -> Links {
        match self {
            Self::Ur5 => Links {
                d1_mm: 89.159,
                a2_mm: -425.0,
                a3_mm: -392.25,
                d4_mm: 109.15,
                d5_mm: 94.65,
                d6_mm: 82.3,
            },
            Self::Ur5e => Links {
                d1_mm: 162.5,
                a2_mm: -425.0,
                a3_mm: -392.2,
                d4_mm: 133.3,
                d5_mm: 99.7,
                d6_mm: 99.6,
            },
        }
    }
}

/// A calibrated flange farther than this from where the drawing has it is not of this arm, mm. The effect of
/// a real calibration is some millimetres.
const CALIBRATION_SHIFT_MAX_MM: f64 = 30.0;
/// The same for its orientation, rad.
const CALIBRATION_TURN_MAX_RAD: f64 = 0.1;
/// Where the two are compared, rad.
const COMPARED_AT: [Joints; 4] = [
    [0.0; 6],
    [0.5, -1.2, 1.4, -1.8, -1.6, 0.3],
    [-2.0, -2.0, -1.6, 0.7, 1.2, -2.5],
    [1.6, 0.4, 2.2, 1.9, 2.6, 1.4],
];

/// Why a calibration is not one of this arm.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A number that is none.
    #[error("{field}[{joint}] is not finite")]
    NotFinite {
        /// Which column.
        field: &'static str,
        /// Which joint, from 1.
        joint: usize,
    },
    /// It puts the flange elsewhere.
    #[error(
        "puts the flange {shift_mm:.1} mm and {turn_rad:.3} rad from where the drawing has it; limits {CALIBRATION_SHIFT_MAX_MM} mm and {CALIBRATION_TURN_MAX_RAD} rad"
    )]
    AnotherArm {
        /// Of the flange's origin, mm.
        shift_mm: f64,
        /// Of its orientation, rad.
        turn_rad: f64,
    },
}

/// The kinematics of one arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    make: Make,
    links: Links,
    calibrated: Option<Chain>,
    limits: JointLimits,
}

impl From<Make> for Model {
    fn from(make: Make) -> Self {
        Self {
            make,
            links: make.links(),
            calibrated: None,
            limits: JointLimits::default(),
        }
    }
}

impl Model {
    /// A UR5 as drawn.
    pub fn ur5() -> Self {
        Make::Ur5.into()
    }

    /// A UR5e as drawn.
    pub fn ur5e() -> Self {
        Make::Ur5e.into()
    }

    /// With the table of one arm, refused if it is that of another.
    pub fn calibrated(mut self, dh: &Dh) -> Result<Self, CalibrationError> {
        if let Some((field, joint)) = dh.not_finite() {
            return Err(CalibrationError::NotFinite { field, joint });
        }
        let chain = Chain::new(*dh);
        for joints in &COMPARED_AT {
            let (drawn, real) = (self.links.forward(joints), chain.forward(joints));
            let (shift, turn) = drawn.error_to(&real);
            let turn_rad = if drawn.faces(&real) {
                turn.norm()
            } else {
                f64::INFINITY
            };
            let near = (..=CALIBRATION_SHIFT_MAX_MM).contains(&shift.norm())
                && turn_rad <= CALIBRATION_TURN_MAX_RAD;
            if !near {
                return Err(CalibrationError::AnotherArm {
                    shift_mm: shift.norm(),
                    turn_rad,
                });
            }
        }
        self.calibrated = Some(chain);
        Ok(self)
    }

    /// The same arm as drawn, without its calibration.
    pub fn drawn(self) -> Self {
        Self {
            calibrated: None,
            ..self
        }
    }

    /// With other limits of travel.
    pub fn with_limits(mut self, limits: JointLimits) -> Self {
        self.limits = limits;
        self
    }

    /// What was made.
    pub fn make(&self) -> Make {
        self.make
    }

    /// Its lengths by the drawing.
    pub fn links(&self) -> &Links {
        &self.links
    }

    /// The table it computes with.
    pub fn dh(&self) -> Dh {
        self.calibrated
            .map_or_else(|| Dh::nominal(&self.links), |chain| *chain.dh())
    }

    /// Its travel.
    pub fn limits(&self) -> &JointLimits {
        &self.limits
    }

    /// The flange at the given joints.
    pub fn forward(&self, joints: &Joints) -> FlangePose {
        match &self.calibrated {
            None => self.links.forward(joints),
            Some(chain) => chain.forward(joints),
        }
    }

    /// The same as a rigid transform.
    pub fn base_from_flange(&self, joints: &Joints) -> Rigid<Base, Flange> {
        self.forward(joints).into()
    }

    /// Velocity of the flange in base axes, `[v mm/s; w rad/s] = J q'`.
    pub fn jacobian(&self, joints: &Joints) -> Matrix6<f64> {
        match &self.calibrated {
            None => self.links.jacobian(joints),
            Some(chain) => chain.forward_and_jacobian(joints).1,
        }
    }

    /// All joint angles that reach a pose, each in -pi .. pi, travel not regarded; none when it is out of reach.
    ///
    /// `reference` is the sample before: joint 6 is taken from it where the wrist is singular, and a calibrated arm
    /// also searches from there.
    pub fn inverse(&self, flange: &FlangePose, reference: &Joints) -> Solutions {
        match &self.calibrated {
            None => self.links.inverse(flange, reference[5]),
            Some(chain) => polish::inverse(chain, &self.links, flange, reference),
        }
    }

    /// The same for a stream, which goes on from `reference`: near a singularity of a calibrated arm another branch than
    /// that of the sample before may be missing.
    pub fn inverse_near(&self, flange: &FlangePose, reference: &Joints) -> Solutions {
        match &self.calibrated {
            None => self.links.inverse(flange, reference[5]),
            Some(chain) => polish::inverse_near(chain, &self.links, flange, reference),
        }
    }

    /// The smallest distance of any joint to its limit, rad; negative beyond it.
    pub fn limit_margin_rad(&self, joints: &Joints) -> f64 {
        self.limits.margin_rad(joints)
    }

    /// The distances to the singularities of the arm as drawn.
    pub fn singularities(&self, joints: &Joints) -> Singularities {
        Singularities::of(&self.links, joints)
    }

    /// Yoshikawa's manipulability `|det J|`, mm3.
    pub fn manipulability_mm3(&self, joints: &Joints) -> f64 {
        match &self.calibrated {
            None => manipulability_mm3(&self.links, joints),
            Some(chain) => chain.forward_and_jacobian(joints).1.determinant().abs(),
        }
    }
}
